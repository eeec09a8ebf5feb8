"""A release's results derived again from the bundle alone, and compared.

They are compared value by value with what the bundle holds. Numbers agree when they differ by less
than one part in 10^9, since libraries of other versions add in another order. Texts agree when they
are equal, apart from the software's version. Times and versions of the derivation itself are not
compared.
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
    judged_trials,
    no_bar,
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
"""Keys of a group that follow from the policy that judges its moves."""

RELATIVE, ABSOLUTE = 1e-9, 1e-12
SECTIONS = ["figures", "metrics", "comparisons", "players", "pictures", "costs", "flow", "labels"]
SECTIONS += ["outcomes", "stages", "answers"]
MOST_NAMED = 20
"""Differences of a section that are named with their values."""

Place = tuple[str | int, ...]
_ABSENT = object()


@dataclass
class Section:
    """How one part of a report compares.

    Attributes:
        compared: Values: numbers and texts.
        differ: Of these.
        differences: The first of them, each a sentence.
    """

    compared: int = 0
    differ: int = 0
    differences: list[str] = field(default_factory=list)

    def add(self, name: str, recorded: object, derived: object, is_same: bool) -> None:
        """Count one value."""
        self.compared += 1
        if not is_same:
            self.differ += 1
            if len(self.differences) < MOST_NAMED:
                self.differences.append(
                    f"{name}: {_shown(recorded)} in the release, {_shown(derived)} derived again"
                )


@dataclass
class Reproduction:
    """How a bundle's results compare with what is derived again.

    Attributes:
        files: How many the bundle has.
        findings: What of them is not as signed.
        signer: What is known of who signed.
        sections: What was compared, by part of the report.
        not_compared: What was not, a sentence each.
        derived: The report that the bundle gives, if it holds none to compare with.
        left_out: Policies whose file is lost, a sentence each.
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
        return sum(section.differ for section in self.sections.values())

    def compare(self, section: str, name: str, recorded: object, derived: object) -> None:
        """Compare one value of a section."""
        self.sections.setdefault(section, Section()).add(
            name, recorded, derived, recorded == derived
        )


def reproduce(
    folder: Path,
    pins: Path,
    key: str | None = None,
    plays_again: bool = True,
    bar: ProgressBar = no_bar,
) -> Reproduction:
    """Derive every number of a bundle's report again, and compare.

    Args:
        pins: The file of pinned keys.
        key: A fingerprint, or the file of a public key, that must have signed the bundle.
        plays_again: If False no policy is played again; its recorded moves are replayed alone.

    Raises:
        ReleaseError: If the folder holds no release.
        StoreError, StudyError: If its database cannot be read.
    """
    with Bundle(folder) as bundle:
        expected = None if key is None else fingerprint_of(key)
        findings = list(check_files(folder, bundle.manifest, expected))
        signer = check_signer(bundle.manifest, expected, pins)
        reproduction = Reproduction(
            files=len(bundle.manifest["files"]), findings=findings, signer=signer
        )
        _Derivation(bundle, reproduction, bar, plays_again).run()
        return reproduction


class _Derivation:
    """The work of one reproduction."""

    def __init__(
        self, bundle: Bundle, reproduction: Reproduction, bar: ProgressBar, plays_again: bool
    ):
        self._bundle, self._bar, self._plays_again = bundle, bar, plays_again
        self._reproduction = reproduction
        self._data, self._episodes = bundle.data, bundle.policy_episodes
        self._at_hand: dict[str, bool] = {}

    def run(self) -> None:
        folder = self._bundle.folder
        stems = REPORT_STEMS.items()
        present = [synthetic for synthetic, stem in stems if (folder / f"{stem}.json").exists()]
        if present:
            with TemporaryDirectory() as cache:
                cache_folder = Path(cache) if self._compare_costs(Path(cache)) else None
                for synthetic in present:
                    self._compare_report(synthetic, cache_folder)
            self._replay_policies()
        else:
            episodes = self._episodes
            if not episodes and has_played(self._data, synthetic=False):
                episodes = self._play_at_hand()
            self._reproduction.derived = self._derive(False, None, episodes)
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
        """Compare the cost of each move with the recorded one, and store it in `cache`.

        Returns:
            Whether it could be derived: not if nobody played, or if the policy that judges moves is
                another one here.
        """
        reader, data = self._bundle.reader, self._data
        if not (costs := self._bundle.costs()):
            return False
        try:
            study_estimator(data, None)
        except PolicyError as error:
            self._reproduction.not_compared.append(f"cost of moves: {error}")
            return False
        ranked = judged_trials(data)
        with self._bar("cost of each move") as advance:
            rows = cost_rows(reader, data, ranked, study_estimator(data, cache), advance)
            derived = {(row.episode, row.step): row for row in rows}
        for row in costs:
            move = f"{row.episode}, move {row.step}"
            other = derived.get((row.episode, row.step))
            self._reproduction.compare("cost of each move", move, row, other)
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
        self._reproduction.sections |= {mark + name: section for name, section in sections.items()}
        not_compared = self._reproduction.not_compared
        not_compared.append(
            f"{json_name}: {' and '.join(NOT_COMPARED)}, which say when and by what it was made"
        )
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
                self._reproduction.compare(f"{mark}page", name, "the page", other)

    def _replay_policies(self) -> None:
        """Compare the policies' recorded episodes with their replay.

        The terrains follow from the study's secret.
        """
        seeds, section = closed_seeds(self._data), "policies' episodes, replayed"
        compare, protocol = self._reproduction.compare, self._data.protocol
        for episode in self._episodes:
            name = f"{episode.policy}, instance {episode.terrain}"
            compare(section, f"{name}: seed", episode.seed, seeds.get(episode.terrain))
            replayed = episode.replayed_hash(protocol.environment, protocol.env_config)
            compare(section, f"{name}: trajectory hash", episode.trajectory_hash, replayed)

    def _play_again(self) -> None:
        """Play the policies again whose files here are the same, and compare moves."""
        recorded = {(episode.policy, episode.terrain): episode for episode in self._episodes}
        names = [name for name in dict(recorded.keys()) if self._is_at_hand(name)]
        if not names or self._data.protocol.core_version != self._data.protocol.environment.version:
            return
        seeds = {episode.terrain: episode.seed for episode in self._episodes}
        section = "policies' episodes, played again"
        for episode in play_compared(self._data, seeds, names, self._bar):
            name = f"{episode.policy}, instance {episode.terrain}: trajectory hash"
            before = recorded[episode.policy, episode.terrain].trajectory_hash
            self._reproduction.compare(section, name, before, episode.trajectory_hash)

    def _play_at_hand(self) -> tuple[PolicyEpisode, ...]:
        """Play the protocol's policies that are here, for a bundle without episodes."""
        names = []
        for name in compared_policies(self._data.protocol):
            try:
                self._load(name)
                names.append(name)
            except PolicyError as error:
                self._reproduction.left_out.append(f"{name} is left out: {error}")
        seeds = closed_seeds(self._data) or self._data.seeds()
        return play_compared(self._data, seeds, names, self._bar)

    def _is_at_hand(self, name: str) -> bool:
        """Whether the policy that played is here; if not, that is noted once."""
        if name not in self._at_hand:
            (recorded, *_) = (
                episode.policy_hash for episode in self._episodes if episode.policy == name
            )
            obstacle = None
            try:
                source = self._load(name)
                if self._data.protocol.environment.policies.hash_of(source) != recorded:
                    obstacle = f"its file here has another SHA-256 than {recorded}"
            except PolicyError as error:
                obstacle = str(error)
            if obstacle is not None:
                self._reproduction.not_compared.append(
                    f"{name} was not played again, its recorded moves were replayed: {obstacle}"
                )
            self._at_hand[name] = obstacle is None
        return self._at_hand[name]

    def _load(self, name: str) -> str:
        """What `Policies.load` takes for a policy, once it has taken it.

        Raises:
            PolicyError: If it cannot be loaded.
        """
        source = self._data.policy_files.source(name)
        self._data.protocol.environment.policies.load(source, self._data.protocol.env_config)
        return source


def compare_reports(
    recorded: Mapping[str, object], derived: Mapping[str, object], left_out: Sequence[str] = ()
) -> dict[str, Section]:
    """Compare two reports as `Report.to_dict` gives them.

    Every number and text of the recorded report is compared; what only the derived one has is a
    later version's, and new.

    Args:
        left_out: Keys of groups that are not compared.

    Returns:
        Section -> its comparison.
    """
    sections: dict[str, Section] = {}
    leaves = dict(_leaves(derived))
    versions = str(recorded.get("software_version")), str(derived.get("software_version"))
    for place, leaf in _leaves(recorded):
        is_left_out = place[0] == "groups" and len(place) > 2 and place[2] in left_out
        if place[0] in NOT_COMPARED or is_left_out:
            continue
        again = leaves.get(place, _ABSENT)
        section = sections.setdefault(_section(place), Section())
        section.add(_words(place), leaf, again, _is_same(leaf, again, versions))
    return sections


def _leaves(content: object, place: Place = ()) -> Iterator[tuple[Place, object]]:
    """Yield (place, content) of every number and text, and the length of every list."""
    if isinstance(content, Mapping):
        for key, part in content.items():
            yield from _leaves(part, (*place, key))
    elif isinstance(content, (list, tuple)):
        yield (*place, "length"), len(content)
        for index, part in enumerate(content):
            yield from _leaves(part, (*place, index))
    else:
        yield place, content


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


def _shown(leaf: object) -> str:
    if leaf is _ABSENT:
        return "nothing"
    return f"{leaf[:60]}..." if isinstance(leaf, str) and len(leaf) > 63 else repr(leaf)
