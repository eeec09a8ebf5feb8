"""A study's report from a database, as `report`, `release` and `reproduce` make it: read, replay, play or replay policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from app.cli.console import progress

if TYPE_CHECKING:
    from app.moves.analysis import MoveAnalysis
    from app.release.build import ReleasedReport
    from app.report.model import Report
    from app.storage.reader import Reader
    from app.study.data import StudyData
    from app.study.policy_episodes import PolicyEpisode

REPORT_FILES = {
    False: ("report.json", "report.html"),
    True: ("report-synthetic.json", "report-synthetic.html"),
}
"""The files of a report in a release: of the people, and of the scripts."""


def has_played(data: StudyData, synthetic: bool) -> bool:
    """Return whether a person (or a script, when synthetic) has finished a ranked episode."""
    kind = "script" if synthetic else "human"
    return any(
        each.kind == kind and each.ended_ms is not None and each.phase == "ranked"
        for each in data.trials
    )


def replay_pictures(reader: Reader, data: StudyData, synthetic: bool) -> dict[str, dict[str, Any]]:
    """Return the curves and visit maps of the people or the scripts, behind a progress bar."""
    from app.statistics.group_summaries import summarize_groups

    with progress("replaying episodes") as advance:
        return summarize_groups(reader, data, synthetic, advance)


def build_report(
    data: StudyData,
    episodes: Sequence[PolicyEpisode],
    synthetic: bool,
    pictures: dict[str, dict[str, Any]],
    moves: dict[str, MoveAnalysis] | None = None,
) -> Report:
    """Return the report of a study over its people or its scripts, compared with the policies' episodes.

    moves  what single moves say, by group's name
    """
    from app.report.build import build
    from app.report.policies import runs_of

    runs = (
        runs_of(episodes, data.protocol.env_config, data.protocol.ranked)
        if has_played(data, synthetic)
        else ()
    )
    return build(data, runs, synthetic, pictures, moves)


def play_compared(
    data: StudyData, seeds: dict[int, int], names: Sequence[str]
) -> tuple[PolicyEpisode, ...]:
    """Return the policies' episodes on the terrains of these seeds, played now behind a progress bar."""
    from app.study.policy_episodes import play_policies

    with progress("policies on the same terrains") as advance:
        return play_policies(names, data.protocol.env_config, seeds, advance, data.policy_files)


def released_report(
    study: str, without: Sequence[str], cache: Path | None = None
) -> Callable[[Path], ReleasedReport]:
    """Return what makes the report of a release from its database alone.

    without  policies to leave out, because their files are not at hand
    cache    the folder in which regrets are kept; None keeps nothing
    """

    def make(database: Path) -> ReleasedReport:
        from app.release.build import ReleasedReport
        from app.storage.reader import Reader
        from app.study.data import load
        from app.study.policy_episodes import compared_policies, ranked_seeds
        from app.study.policy_files import FOLDER

        reader = Reader.open(database)
        try:
            data = load(reader, study).with_policies_in(database.parent / FOLDER)
            if not any(has_played(data, synthetic) for synthetic in (False, True)):
                return ReleasedReport(_report_files(build_report(data, (), False, {}), False))
            names = [name for name in compared_policies(data.protocol) if name not in without]
            seeds = (
                ranked_seeds(data.protocol, data.protocol_hash, data.secret) if data.secret else {}
            )
            return _played_report(reader, data, names, play_compared(data, seeds, names), cache)
        finally:
            reader.close()

    return make


def _played_report(
    reader: Reader,
    data: StudyData,
    names: Sequence[str],
    episodes: tuple[PolicyEpisode, ...],
    cache: Path | None,
) -> ReleasedReport:
    """Return the reports of people and scripts with everything that they are made from."""
    from app.moves.analysis import KnownMoves, analyse_known
    from app.moves.likeness import episode_agreements
    from app.moves.regret import POLICY, has_regret, regret_rows, study_estimator
    from app.release.build import ReleasedReport
    from marsexplorer.policies import policy_hash

    with progress("comparing moves with the policies'") as advance:
        agreements = episode_agreements(reader, data, names, advance)
    with TemporaryDirectory() as own:
        known = KnownMoves(agreements, cache or Path(own))
        files: dict[str, bytes] = {}
        for synthetic in (synthetic for synthetic in REPORT_FILES if has_played(data, synthetic)):
            moves = analyse_known(reader, data, names, synthetic, progress, known)
            pictures = replay_pictures(reader, data, synthetic)
            files |= _report_files(
                build_report(data, episodes, synthetic, pictures, moves), synthetic
            )
        if not has_regret(data.protocol.env_config):
            return ReleasedReport(files, episodes, (), agreements)
        ranked = [each for each in data.trials if each.phase == "ranked"]
        with progress("regret of each move") as advance:
            regrets = tuple(
                regret_rows(reader, data, ranked, study_estimator(data, known.cache), advance)
            )
    return ReleasedReport(
        files, episodes, regrets, agreements, policy_hash(data.policy_files.source(POLICY)) or ""
    )


def _report_files(found: Report, synthetic: bool) -> dict[str, bytes]:
    from app.report.page import render

    json_name, html_name = REPORT_FILES[synthetic]
    return {json_name: (found.to_json() + "\n").encode(), html_name: render(found).encode()}
