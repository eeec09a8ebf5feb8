"""A release read back, and everything that its report is made from derived again: moves, policies' episodes, the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import progress
from app.cli.study.study_report import build_report, play_compared, replay_pictures

if TYPE_CHECKING:
    from app.moves.analysis import KnownMoves
    from app.moves.regret import RegretRow
    from app.report.model import Report
    from app.report.reproduction import Section
    from app.storage.reader import Reader
    from app.study.data import StudyData
    from app.study.policy_episodes import PolicyEpisode


@dataclass
class Derivation:
    """What was derived from a bundle: its data, the policies' episodes, what was compared, and what was not (sentences)."""

    folder: Path
    data: StudyData
    episodes: tuple[PolicyEpisode, ...]
    regret_policy_hash: str | None = None
    at_hand: dict[str, bool] = field(default_factory=dict)
    sections: dict[str, Section] = field(default_factory=dict)
    not_compared: list[str] = field(default_factory=list)

    def section(self, name: str) -> Section:
        """Return a section, made when it is new."""
        from app.report.reproduction import Section

        return self.sections.setdefault(name, Section())


def read_bundle(folder: Path) -> Derivation:
    """Return the bundle's data and its policies' episodes."""
    from app.moves.regret import POLICY
    from app.release.derived import read_policy_episodes
    from app.release.header import BUNDLE_DATABASE
    from app.release.manifest import read_manifest
    from app.storage.database import reading
    from app.study.data import load
    from app.study.policy_files import FOLDER, PolicyFiles

    manifest, _ = read_manifest(folder)
    with reading(folder / BUNDLE_DATABASE) as conn:
        episodes = read_policy_episodes(conn)
    data = load(folder / BUNDLE_DATABASE, str(manifest["study"]))
    played = {each.policy: each.policy_hash for each in episodes} | {
        POLICY: manifest.get("regret_policy_hash")
    }
    recorded = {name: digest for name, digest in played.items() if digest}
    data = replace(
        data, policy_files=PolicyFiles({**data.policy_files.hashes, **recorded}, folder / FOLDER)
    )
    return Derivation(folder, data, episodes, manifest.get("regret_policy_hash"))


def derive(made: Derivation, synthetic: bool, known: KnownMoves | None = None) -> Report:
    from app.moves.analysis import analyse_known
    from app.release.header import BUNDLE_DATABASE
    from app.storage.reader import Reader

    reader = Reader.open(made.folder / BUNDLE_DATABASE)
    try:
        pictures = replay_pictures(reader, made.data, synthetic)
        names = list(dict.fromkeys(each.policy for each in made.episodes))
        moves = (
            analyse_known(reader, made.data, names, synthetic, progress, known) if known else None
        )
    finally:
        reader.close()
    return build_report(made.data, made.episodes, synthetic, pictures, moves)


def known_moves(made: Derivation, cache: Path, plays_again: bool) -> KnownMoves | None:
    """Return the agreements of moves with the policies: computed again for those at hand, as recorded for the others.

    They and the regrets are compared with the recorded ones. None where nobody played, or where the policy that regrets are
    relative to is another one here.

    plays_again  False takes the recorded agreements of every policy
    """
    from app.moves.analysis import KnownMoves
    from app.moves.likeness import NO_PLAN, episode_agreements
    from app.moves.regret import POLICY
    from app.release.derived import read_agreements, read_regrets
    from app.release.header import BUNDLE_DATABASE
    from app.storage.database import reading
    from app.storage.reader import Reader
    from marsexplorer.policies import PolicyNotFoundError

    with reading(made.folder / BUNDLE_DATABASE) as conn:
        recorded, regrets = read_agreements(conn), read_regrets(conn)
    if not recorded and not regrets:
        return None
    try:
        made.data.policy_files.source(POLICY)
    except PolicyNotFoundError as error:
        made.not_compared.append(f"regret and likeness of moves: {error}")
        return None
    policies = dict.fromkeys(policy for _, policy in recorded)
    names = [
        name for name in policies if plays_again and name != NO_PLAN and is_at_hand(made, name)
    ]
    reader = Reader.open(made.folder / BUNDLE_DATABASE)
    try:
        with progress("comparing moves with the policies'") as advance:
            again = episode_agreements(reader, made.data, names, advance)
        for key, found in again.items():
            made.section("agreement of moves").add(
                ", ".join(key), recorded.get(key), found, recorded.get(key) == found
            )
        _compare_regrets(made, reader, regrets, cache)
    finally:
        reader.close()
    return KnownMoves({**recorded, **again}, cache)


def _compare_regrets(
    made: Derivation, reader: Reader, regrets: Sequence[RegretRow], cache: Path
) -> None:
    """Work the regret of every ranked move out again and compare it with the recorded one."""
    from app.moves.regret import regret_rows, study_estimator

    if not regrets:
        return
    ranked = [each for each in made.data.trials if each.phase == "ranked"]
    with progress("regret of each move") as advance:
        rows = regret_rows(reader, made.data, ranked, study_estimator(made.data, cache), advance)
        found = {(each.episode, each.step): each for each in rows}
    for row in regrets:
        other = found.get((row.episode, row.step))
        made.section("regret of each move").add(
            f"{row.episode}, move {row.step}", row, other, row == other
        )


def replay_policies(made: Derivation) -> None:
    """Compare the policies' recorded episodes with their replay on the terrains that follow from the study's secret."""
    from app.study.policy_episodes import ranked_seeds

    data, section = made.data, made.section("policies' episodes, replayed")
    seeds = ranked_seeds(data.protocol, data.protocol_hash, data.secret) if data.secret else {}
    for each in made.episodes:
        where = f"{each.policy}, terrain {each.terrain}"
        section.add(
            f"{where}: seed",
            each.seed,
            seeds.get(each.terrain),
            each.seed == seeds.get(each.terrain),
        )
        found = each.replay(data.protocol.env_config).record().trajectory_hash
        section.add(
            f"{where}: trajectory hash", each.trajectory_hash, found, each.trajectory_hash == found
        )


def play_again(made: Derivation) -> None:
    """Play each policy again whose file is at hand and the same, and compare the moves."""
    from marsexplorer.config import CORE_VERSION

    recorded = {(each.policy, each.terrain): each for each in made.episodes}
    names = [
        name
        for name in dict.fromkeys(each.policy for each in made.episodes)
        if is_at_hand(made, name)
    ]
    if not names or made.data.protocol.core_version != CORE_VERSION:
        return
    seeds = {each.terrain: each.seed for each in made.episodes}
    section = made.section("policies' episodes, played again")
    for each in play_compared(made.data, seeds, names):
        before = recorded[each.policy, each.terrain]
        hashes = before.trajectory_hash, each.trajectory_hash
        section.add(
            f"{each.policy}, terrain {each.terrain}: trajectory hash",
            *hashes,
            hashes[0] == hashes[1],
        )


def is_at_hand(made: Derivation, name: str) -> bool:
    """Return whether the policy that played is here; what is not is noted once."""
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load, policy_hash

    if name not in made.at_hand:
        (recorded, *_) = (each.policy_hash for each in made.episodes if each.policy == name)
        try:
            source = made.data.policy_files.source(name)
            load(source, made.data.protocol.env_config.sensor_radius)
            is_same = policy_hash(source) == recorded
            why = f"its file here has another SHA-256 than {recorded}"
        except (PolicyNotFoundError, PolicyFileError) as error:
            is_same, why = False, str(error)
        if not is_same:
            made.not_compared.append(
                f"{name} was not played again, its recorded moves were replayed: {why}"
            )
        made.at_hand[name] = is_same
    return made.at_hand[name]


def play_at_hand(made: Derivation) -> tuple[PolicyEpisode, ...]:
    """Return episodes of those policies of the protocol that are here, for a bundle that holds none."""
    from app.study.policy_episodes import compared_policies, ranked_seeds
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load

    data, names = made.data, []
    for name in compared_policies(data.protocol):
        try:
            load(data.policy_files.source(name), data.protocol.env_config.sensor_radius)
            names.append(name)
        except (PolicyNotFoundError, PolicyFileError) as error:
            click.echo(f"- {name} is left out: {error}")
    seeds = (
        ranked_seeds(data.protocol, data.protocol_hash, data.secret)
        if data.secret
        else data.seeds()
    )
    return play_compared(data, seeds, names)
