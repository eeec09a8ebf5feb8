"""A study's report from a database, as `report`, `release` and `reproduce` make it: read, replay, play or replay policies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.cli.console import interruptible, progress

if TYPE_CHECKING:
    from app.moves.analysis import MoveAnalysis
    from app.release.build import ReleasedReport
    from app.report.model import Report
    from app.storage.reader import Reader
    from app.study.data import StudyData
    from app.study.policy_episodes import PolicyEpisode

REPORT_FILES = {False: ("report.json", "report.html"), True: ("report-synthetic.json", "report-synthetic.html")}
"""The files of a report in a release: of the people, and of the scripts."""


def has_played(data: StudyData, synthetic: bool) -> bool:
    """Return whether a person (or a script, when synthetic) has finished a ranked episode."""
    kind = "script" if synthetic else "human"
    return any(each.kind == kind and each.ended_ms is not None and each.phase == "ranked" for each in data.trials)


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

    moves  what single moves say, by group's name; a release leaves it out
    """
    from app.report.build import build
    from app.report.policies import runs_of

    runs = runs_of(episodes, data.protocol.env_config, data.protocol.ranked) if has_played(data, synthetic) else ()
    return build(data, runs, synthetic, pictures, moves)


def play_compared(data: StudyData, seeds: dict[int, int], names: Sequence[str]) -> tuple[PolicyEpisode, ...]:
    """Return the policies' episodes on the terrains of these seeds, played now behind a progress bar."""
    from app.study.policy_episodes import play_policies

    with progress("policies on the same terrains") as advance:
        return interruptible(lambda: play_policies(names, data.protocol.env_config, seeds, advance))


def released_report(study: str, without: Sequence[str]) -> Callable[[Path], ReleasedReport]:
    """Return what makes the report of a release from its database alone.

    without  policies to leave out, because their files are not at hand
    """

    def make(database: Path) -> ReleasedReport:
        from app.release.build import ReleasedReport
        from app.report.page import render
        from app.storage.reader import Reader
        from app.study.data import load
        from app.study.looks import LOOKS_FILE, read_looks
        from app.study.policy_episodes import compared_policies, ranked_seeds

        reader = Reader.open(database)
        try:
            data = replace(load(reader, study), looks=read_looks(database.parent / LOOKS_FILE))
            kinds = [synthetic for synthetic in (False, True) if has_played(data, synthetic)]
            names = [name for name in compared_policies(data.protocol) if name not in without]
            seeds = ranked_seeds(data.protocol, data.protocol_hash, data.secret) if data.secret else {}
            episodes = play_compared(data, seeds, names) if kinds else ()
            files = {}
            for synthetic in kinds or [False]:
                found = build_report(data, episodes, synthetic, replay_pictures(reader, data, synthetic))
                texts = (found.to_json() + "\n", render(found))
                files.update({name: text.encode() for name, text in zip(REPORT_FILES[synthetic], texts, strict=True)})
        finally:
            reader.close()
        return ReleasedReport(files, episodes)

    return make
