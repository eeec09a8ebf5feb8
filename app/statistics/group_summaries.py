"""Coverage against steps and visits of a study's people, or of each kind of script, by replay of what is stored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from app.statistics.exclusion_sets import Cohort, members, people_of, scripts_of
from app.statistics.summaries import EpisodeSummary, coverage_curve, summary_of, visit_counts
from app.storage.reader import Reader
from app.study.data import StudyData, trial_records
from marsexplorer.config import CORE_VERSION
from marsexplorer.episode import replay
from marsexplorer.evaluation.table import Progress


def summarize_groups(
    reader: Reader, data: StudyData, synthetic: bool, progress: Progress | None = None
) -> dict[str, dict[str, Any]]:
    """Return {"curve", "visits"} by group's name, over the ranked episodes of everybody (a player weighs once).

    Episodes of another core version cannot be replayed and are left out. progress: (episodes replayed, in all)
    """
    cohorts = scripts_of(data) if synthetic else [people_of(data)]
    total = sum(len(trials) for cohort in cohorts for trials in cohort.ranked.values())
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    return {cohort.name: _pictures(reader, data, cohort, advance) for cohort in cohorts}


def _pictures(
    reader: Reader, data: StudyData, cohort: Cohort, advance: Callable[[], None]
) -> dict[str, Any]:
    groups: list[Sequence[EpisodeSummary]] = []
    for person in members(cohort, {}):
        own = []
        for trial, record in trial_records(reader, cohort.ranked[person]):
            if trial.core_version == CORE_VERSION:
                own.append(summary_of(replay(record)))
            advance()
        if own:
            groups.append(own)
    config = data.protocol.env_config
    return (
        {"curve": coverage_curve(config, groups), "visits": visit_counts(config, groups)}
        if groups
        else {}
    )
