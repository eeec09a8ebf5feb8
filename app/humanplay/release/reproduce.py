"""A release's figures derived again from the bundle alone, and compared value by value with what it
holds.

Numbers agree when they differ by less than one part in 10^9, since libraries of other versions add
in another order. Texts agree when they are equal, apart from the software's version. Times and
versions of the derivation itself are not compared.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from humanplay.db.resimulation import Finding
from humanplay.release.bundle import Bundle
from humanplay.release.manifest import check_files
from humanplay.release.signing import SignerCheck, check_signer, fingerprint_of
from humanplay.report.costs import (
    CostSummary,
    ProgressBar,
    cost_rows,
    costs_of_people,
    no_bar,
    ranked_of_people,
    study_estimator,
)
from humanplay.report.making import REPORT_STEMS, has_played, make_report, play_compared
from humanplay.report.model import Report
from humanplay.report.page import pages
from humanplay.study.policy_episodes import PolicyEpisode, closed_seeds, compared_policies
from humanplay.task import PolicyError

NOT_COMPARED = ("made_at", "software_version")
"""Keys of a report that tell when and by what it was made."""

MOVE_KEYS = ("costs", "no_costs", "cautions")
"""Keys of a group that cannot be derived without the policies that its moves are judged by."""

RELATIVE, ABSOLUTE = 1e-9, 1e-12
SECTIONS = ["figures", "metrics", "comparisons", "players", "pictures", "costs", "flow", "labels"]
SECTIONS += ["outcomes", "stages", "answers"]
MOST_NAMED = 20
"""Differences that are kept with their values, in each section."""

Place = tuple[str | int, ...]
_ABSENT = object()


@dataclass
class Section:
    """What came of one part of a report.

    Attributes:
        compared: Values: numbers and texts.
        differ: Of these.
        differences: The first of them, each a sentence.
    """

    compared: int = 0
    differ: int = 0
    differences: list[str] = field(default_factory=list)

    def add(self, where: str, recorded: object, derived: object, is_same: bool) -> None:
        """Count one value."""
        self.compared += 1
        if not is_same:
            self.differ += 1
            if len(self.differences) < MOST_NAMED:
                both = f"{_shown(recorded)} in the release, {_shown(derived)} derived again"
                self.differences.append(f"{where}: {both}")


@dataclass
class Reproduction:
    """What came of deriving a bundle's figures again.

    Attributes:
        files: How many the bundle has; findings: what of them is not as signed, and signer:
            what is known of who signed.
        sections: What was compared, by part of the report.
        not_compared: What was not, a sentence each.
        derived: The report that the bundle gives, where it holds none to compare with;
            left_out: policies whose file is lost.
    """

    files: int
    findings: list[Finding]
    signer: SignerCheck
    sections: dict[str, Section] = field(default_factory=dict)
    not_compared: list[str] = field(default_factory=list)
    derived: Report | None = None
    left_out: list[str] = field(default_factory=list)

    @property
    def differ(self) -> int:
        """How many values differ."""
        return sum(each.differ for each in self.sections.values())

    def compare(self, section: str, where: str, recorded: object, derived: object) -> None:
        """Compare one value of a section."""
        made = self.sections.setdefault(section, Section())
        made.add(where, recorded, derived, recorded == derived)


def reproduce(
    folder: Path,
    pins: Path,
    key: str | None = None,
    plays_again: bool = True,
    bar: ProgressBar = no_bar,
) -> Reproduction:
    """Derive every figure of a bundle again, and compare.

    ReleaseError where the folder holds no release; StoreError and StudyError where its database
    cannot be read.

    Args:
        pins: The file of pinned keys; key: a fingerprint, or the file of a public key, that
            must have signed the bundle.
        plays_again: False: no policy is played again, its recorded moves are replayed alone.
    """
    with Bundle(folder) as bundle:
        expected = None if key is None else fingerprint_of(key)
        found = list(check_files(folder, bundle.manifest, expected))
        signer = check_signer(bundle.manifest, expected, pins)
        made = Reproduction(files=len(bundle.manifest["files"]), findings=found, signer=signer)
        _Derivation(bundle, made, bar, plays_again).run()
        return made


class _Derivation:
    """The work of one reproduction."""

    def __init__(self, bundle: Bundle, made: Reproduction, bar: ProgressBar, plays_again: bool):
        self._bundle, self._made, self._bar, self._plays_again = bundle, made, bar, plays_again
        self._data, self._episodes = bundle.data, bundle.policy_episodes
        self._at_hand: dict[str, bool] = {}

    def run(self) -> None:
        folder = self._bundle.folder
        stems = REPORT_STEMS.items()
        held = [synthetic for synthetic, stem in stems if (folder / f"{stem}.json").exists()]
        if held:
            with TemporaryDirectory() as cache:
                kept = Path(cache) if self._compare_costs(Path(cache)) else None
                for synthetic in held:
                    self._compare_report(synthetic, kept)
            self._replay_policies()
        else:
            episodes = self._episodes
            if not episodes and has_played(self._data, synthetic=False):
                episodes = self._play_at_hand()
            self._made.derived = self._derive(False, None, episodes)
        if self._plays_again:
            self._play_again()

    def _derive(
        self, synthetic: bool, cache: Path | None, episodes: Sequence[PolicyEpisode]
    ) -> Report:
        reader = self._bundle.reader
        costs: dict[str, CostSummary] | None = None
        if cache is not None and not synthetic:
            costs = costs_of_people(reader, self._data, self._bar, cache)
        return make_report(reader, self._data, episodes, synthetic, self._bar, costs)

    def _compare_costs(self, cache: Path) -> bool:
        """Compare the cost of each move with the recorded one, and keep it in `cache`; return
        whether it could be derived.

        It cannot where nobody played, or where the policy that judges moves is another one here.
        """
        reader, data = self._bundle.reader, self._data
        if not (costs := self._bundle.costs()):
            return False
        try:
            study_estimator(data, None)
        except PolicyError as error:
            self._made.not_compared.append(f"cost of moves: {error}")
            return False
        ranked = ranked_of_people(data)
        with self._bar("cost of each move") as advance:
            rows = cost_rows(reader, data, ranked, study_estimator(data, cache), advance)
            derived = {(each.episode, each.step): each for each in rows}
        for row in costs:
            where = f"{row.episode}, move {row.step}"
            other = derived.get((row.episode, row.step))
            self._made.compare("cost of each move", where, row, other)
        return True

    def _compare_report(self, synthetic: bool, cache: Path | None) -> None:
        """Compare one report's numbers, and its pages as text."""
        stem = REPORT_STEMS[synthetic]
        json_name, html_name = f"{stem}.json", f"{stem}.html"
        recorded: dict[str, object] = json.loads((self._bundle.folder / json_name).read_bytes())
        derived = self._derive(synthetic, cache, self._episodes)
        has_moves = cache is not None or not self._bundle.expert_hash
        mark = "scripts: " if synthetic else ""
        sections = compare_reports(recorded, derived.to_dict(), () if has_moves else MOVE_KEYS)
        self._made.sections |= {mark + name: section for name, section in sections.items()}
        not_compared = self._made.not_compared
        why = "which say when and by what it was made"
        not_compared.append(f"{json_name}: {' and '.join(NOT_COMPARED)}, {why}")
        software = recorded["software_version"]
        if software != derived.software_version:
            not_compared.append(f"{html_name}: version {software} of the software set it")
        elif not has_moves:
            not_compared.append(f"{html_name}, and in {json_name} what the moves say")
        else:
            as_recorded = replace(derived, made_at=str(recorded["made_at"]))
            for name, page in pages(as_recorded, html_name).items():
                path = self._bundle.folder / name
                is_same = path.is_file() and page == path.read_text(encoding="utf-8")
                other = "the page" if is_same else "another page"
                self._made.compare(f"{mark}page", name, "the page", other)

    def _replay_policies(self) -> None:
        """Compare the policies' recorded episodes with their replay on the terrains that follow
        from the study's secret."""
        seeds, section = closed_seeds(self._data), "policies' episodes, replayed"
        for each in self._episodes:
            where = f"{each.policy}, instance {each.terrain}"
            self._made.compare(section, f"{where}: seed", each.seed, seeds.get(each.terrain))
            found = each.replayed_hash(
                self._data.protocol.environment, self._data.protocol.env_config
            )
            self._made.compare(section, f"{where}: trajectory hash", each.trajectory_hash, found)

    def _play_again(self) -> None:
        """Play each policy again whose file is at hand and the same, and compare the moves."""
        recorded = {(each.policy, each.terrain): each for each in self._episodes}
        names = [each for each in dict(recorded.keys()) if self._is_at_hand(each)]
        if not names or self._data.protocol.core_version != self._data.protocol.environment.version:
            return
        seeds = {each.terrain: each.seed for each in self._episodes}
        for each in play_compared(self._data, seeds, names, self._bar):
            where = f"{each.policy}, instance {each.terrain}: trajectory hash"
            before = recorded[each.policy, each.terrain].trajectory_hash
            section = "policies' episodes, played again"
            self._made.compare(section, where, before, each.trajectory_hash)

    def _play_at_hand(self) -> tuple[PolicyEpisode, ...]:
        """Return episodes of those policies of the protocol that are here, for a bundle that holds
        none."""
        names = []
        for name in compared_policies(self._data.protocol):
            try:
                self._load(name)
                names.append(name)
            except PolicyError as error:
                self._made.left_out.append(f"{name} is left out: {error}")
        seeds = closed_seeds(self._data) or self._data.seeds()
        return play_compared(self._data, seeds, names, self._bar)

    def _is_at_hand(self, name: str) -> bool:
        """Return whether the policy that played is here; what is not is noted once."""
        if name not in self._at_hand:
            (recorded, *_) = (each.policy_hash for each in self._episodes if each.policy == name)
            why = None
            try:
                source = self._load(name)
                if self._data.protocol.environment.policies.hash_of(source) != recorded:
                    why = f"its file here has another SHA-256 than {recorded}"
            except PolicyError as error:
                why = str(error)
            if why is not None:
                replayed = "was not played again, its recorded moves were replayed"
                self._made.not_compared.append(f"{name} {replayed}: {why}")
            self._at_hand[name] = why is None
        return self._at_hand[name]

    def _load(self, name: str) -> str:
        """Return what `Policies.load` takes for a policy, which it did take; PolicyError otherwise."""
        source = self._data.policy_files.source(name)
        self._data.protocol.environment.policies.load(source, self._data.protocol.env_config)
        return source


def compare_reports(
    recorded: Mapping[str, object], derived: Mapping[str, object], left_out: Sequence[str] = ()
) -> dict[str, Section]:
    """Return section -> its comparison, for two reports as `Report.to_dict` gives them.

    Every number and text of the recorded report is compared; what only the derived one has is a
    later version's, and new.

    Args:
        left_out: Keys of groups that are not compared.
    """
    sections: dict[str, Section] = {}
    leaves = dict(_leaves(derived))
    versions = str(recorded.get("software_version")), str(derived.get("software_version"))
    for place, value in _leaves(recorded):
        is_left_out = place[0] == "groups" and len(place) > 2 and place[2] in left_out
        if place[0] in NOT_COMPARED or is_left_out:
            continue
        again = leaves.get(place, _ABSENT)
        section = sections.setdefault(_section(place), Section())
        section.add(_words(place), value, again, _is_same(value, again, versions))
    return sections


def _leaves(value: object, place: Place = ()) -> Iterator[tuple[Place, object]]:
    """Yield (place, value) of every number and text, and the length of every list."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _leaves(part, (*place, key))
    elif isinstance(value, (list, tuple)):
        yield (*place, "length"), len(value)
        for index, part in enumerate(value):
            yield from _leaves(part, (*place, index))
    else:
        yield place, value


def _section(place: Place) -> str:
    if place[0] == "groups" and len(place) > 2:
        return str(place[2]) if place[2] in SECTIONS else "participants and cautions"
    return str(place[0]) if place[0] in ("policies", "protocol", "checklist") else "study"


def _words(place: Place) -> str:
    return ".".join(str(part) for part in place)


def _is_same(one: object, other: object, versions: tuple[str, str]) -> bool:
    if isinstance(one, float) and isinstance(other, (int, float)) and not isinstance(other, bool):
        return math.isclose(one, other, rel_tol=RELATIVE, abs_tol=ABSOLUTE)
    if isinstance(one, str) and isinstance(other, str):
        return one.replace(*versions) == other
    return type(one) is type(other) and bool(one == other)


def _shown(value: object) -> str:
    if value is _ABSENT:
        return "nothing"
    return f"{value[:60]}..." if isinstance(value, str) and len(value) > 63 else repr(value)
