"""What the single moves of a group say: where its players lose moves, and how much they move like the policies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from app.db.reader import Reader
from app.jobs import Progress
from app.report.moves.likeness import (
    EpisodeAgreements,
    Likeness,
    episode_agreements,
    find_likeness,
    player_agreements,
)
from app.report.moves.regret import (
    RegretSummary,
    has_regret,
    regret_cache,
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
    """A group's regret under the primary set, None where it is not worked out, and the likeness of everybody who played."""

    regret: RegretSummary | None = None
    likeness: tuple[Likeness, ...] = ()

    def renamed(self, names: Mapping[str, str]) -> MoveAnalysis:
        """Return the same with the players' ids replaced by names."""
        regret = self.regret
        if regret is not None:
            players = (replace(each, player=names[each.player]) for each in regret.by_player)
            regret = replace(regret, by_player=tuple(sorted(players, key=lambda each: each.player)))
        likeness = (replace(each, participant=names[each.participant]) for each in self.likeness)
        ordered = sorted(likeness, key=lambda each: (each.participant, each.policy))
        return MoveAnalysis(regret, tuple(ordered))


@dataclass(frozen=True)
class KnownMoves:
    """What is known before an analysis.

    agreements  of every finished ranked episode, by (episode id, policy)
    cache       the folder in which regrets are kept; None keeps nothing
    """

    agreements: EpisodeAgreements
    cache: Path | None


def analyse_moves(
    reader: Reader, data: StudyData, policies: Sequence[str], synthetic: bool, progress: ProgressBar
) -> dict[str, MoveAnalysis]:
    """Return the analysis of a study's people, or of each kind of script, by group's name.

    The regret is worked out once a study is closed, and kept next to the database. Likeness is to `policies` (names or paths).
    Errors are those of `policies.load`.
    """
    with progress("comparing moves with the policies'") as advance:
        agreements = episode_agreements(reader, data, policies, advance)
    known = KnownMoves(agreements, regret_cache(reader.path))
    return analyse_known(reader, data, policies, synthetic, progress, known)


def analyse_known(
    reader: Reader,
    data: StudyData,
    policies: Sequence[str],
    synthetic: bool,
    progress: ProgressBar,
    known: KnownMoves,
) -> dict[str, MoveAnalysis]:
    """Return what `analyse_moves` does, from agreements that are known; nothing where episodes have no courses."""
    if data.protocol.rules.courses is None:
        return {}
    found, primary = {}, data.protocol.exclusion.get(primary_set(data), {})
    for cohort in scripts_of(data) if synthetic else [people_of(data)]:
        regret, ids = None, members(cohort, primary)
        if data.closed_ms is not None and has_regret(data.protocol):
            estimator = study_estimator(data, known.cache)
            with progress("regret of each move") as advance:
                regret = summarize_regret(reader, data, cohort, ids, estimator, advance)
        likeness = find_likeness(player_agreements(cohort, policies, known.agreements))
        found[cohort.name] = MoveAnalysis(regret, likeness)
    return found
