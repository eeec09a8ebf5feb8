"""What the single moves of a group say: where its players lose moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from app.db.reader import Reader
from app.jobs import Progress
from app.report.moves.regret import (
    RegretSummary,
    has_regret,
    study_estimator,
    summarize_regret,
)
from app.report.statistics.exclusion_sets import members, people_of, scripts_of
from app.report.statistics.study_figures import primary_set
from app.series.data import StudyData

ProgressBar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a name."""


@contextmanager
def no_bar(name: str) -> Iterator[Progress]:
    """Show no progress."""
    yield lambda done, total: None


@dataclass(frozen=True)
class MoveAnalysis:
    """A group's regret under the primary set, None where it is not worked out."""

    regret: RegretSummary | None = None

    def renamed(self, names: Mapping[str, str]) -> MoveAnalysis:
        """Return the same with the players' ids replaced by names."""
        if self.regret is None:
            return self
        players = (replace(each, player=names[each.player]) for each in self.regret.by_player)
        ordered = tuple(sorted(players, key=lambda each: each.player))
        return MoveAnalysis(replace(self.regret, by_player=ordered))


def analyse_moves(
    reader: Reader,
    data: StudyData,
    synthetic: bool,
    progress: ProgressBar,
    cache: Path | None,
) -> dict[str, MoveAnalysis]:
    """Return the analysis of a closed study's people, or of each kind of script, by group's name.

    Nothing where a study is open or its moves have no regret. cache: the folder in which regrets are kept; None keeps nothing
    """
    found: dict[str, MoveAnalysis] = {}
    if data.closed_ms is None or not has_regret(data.protocol):
        return found
    primary = data.protocol.exclusion.get(primary_set(data), {})
    estimator = study_estimator(data, cache)
    for cohort in scripts_of(data) if synthetic else [people_of(data)]:
        with progress("regret of each move") as advance:
            ids = members(cohort, primary)
            regret = summarize_regret(reader, data, cohort, ids, estimator, advance)
        found[cohort.name] = MoveAnalysis(regret)
    return found
