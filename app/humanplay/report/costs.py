"""What the moves of a study's players cost, beside the expert's own episodes.

`humanplay.tasks.costs` says what a cost is. Ranked episodes of an open study are refused here, so
that nothing of their terrains leaves before it is closed.
"""

from __future__ import annotations

import math
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from humanplay.db.reader import Reader
from humanplay.db.trial import Trial
from humanplay.jobs import Progress
from humanplay.report.statistics.exclusion_sets import (
    Cohort,
    members,
    people_of,
    unspoilt,
)
from humanplay.report.statistics.intervals import Interval, interval, player_means
from humanplay.study.data import StudyData, trial_records
from humanplay.study.protocol import StudyError
from humanplay.task import CostEstimator, Courses, EpisodeCosts, PolicyError, Record
from marsexplorer.intervals import Floats

ProgressBar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a name."""


@contextmanager
def no_bar(name: str) -> Iterator[Progress]:
    """Show no progress."""
    yield lambda done, total: None


@dataclass(frozen=True)
class CostRow:
    """One move of an episode and its cost.

    An episode that ended without a move has one more row, so that its costs add up as all others'
    do.

    Attributes:
        step: From 0.
        action, expert_action: In words; `action` is None in the row of an end without a move.
        cost: In moves.
        kind: Of mistake; None if the move is none.
    """

    episode: str
    step: int
    action: str | None
    cost: int
    expert_action: str
    kind: str | None


@dataclass(frozen=True)
class PlayerCosts:
    """One player's mean cost per episode, in moves.

    Attributes:
        mean: How many more moves it counts than the expert's.
        by_kind, gained: The parts of that.
    """

    player: str
    episodes: int
    mean: float
    by_kind: dict[str, float]
    gained: float


@dataclass(frozen=True)
class CostPart:
    """All cost or a part of it, in moves an episode.

    Attributes:
        mean: Of players' means.
        interval: At 95 %, for other players and, unless the protocol fixes the terrains, for other
            terrains; None without a spread and below five players.
    """

    mean: float
    interval: Interval | None


@dataclass(frozen=True)
class CostSummary:
    """Cost per episode over players.

    Attributes:
        counts: Moves that an episode counts, the mean over players.
        expert_moves: Of the expert's own episodes on the same terrains, likewise.
        total: The difference of the two.
        by_kind: Of mistakes, and `ended early` with what giving up cost.
        gained: Below 0: of the moves outside all mistakes; with `by_kind` it adds up to
            `total`.
        by_tenth: Of the moves made at 0-10 %, 10-20 %, ... of the way.
        without_move: What ends without a move, such as giving up, cost; with `by_tenth` it adds
            up to `total`.
        policy: That is the expert.
    """

    phase: str
    episodes: int
    counts: float
    expert_moves: float
    total: CostPart
    by_kind: dict[str, CostPart]
    gained: CostPart
    by_tenth: tuple[CostPart, ...]
    without_move: CostPart
    policy: str
    by_player: tuple[PlayerCosts, ...]


def cost_cache(database: Path) -> Path:
    """The folder next to a database in which costs are stored."""
    return database.with_name(f"{database.name}-costs")


def forget_costs(database: Path) -> None:
    """Delete the folder in which costs are stored; they can be worked out again."""
    shutil.rmtree(cost_cache(database), ignore_errors=True)


def why_not_judged(data: StudyData) -> str | None:
    """The sentence that says why no move of a study is judged; None if moves are."""
    environment = data.protocol.environment
    if environment.courses is None or environment.expert is None:
        return f"the moves of {environment.about.title} are not judged"
    try:
        environment.courses.check_judged(data.protocol.env_config)
        data.policy_files.expert(environment.expert)
    except (ValueError, PolicyError) as error:
        return str(error)
    return None


def study_estimator(data: StudyData, cache: Path | None) -> CostEstimator:
    """What works out a study's costs, by the expert's file of the freezing.

    Args:
        cache: The folder in which costs are stored; None stores nothing.
    """
    courses, expert = _courses(data)
    return courses.estimator(data.policy_files.expert(expert), cache)


def trial_costs(
    reader: Reader,
    data: StudyData,
    trials: Sequence[Trial],
    estimator: CostEstimator,
    progress: Progress | None = None,
) -> Iterator[tuple[Trial, Record, EpisodeCosts]]:
    """Yield the costs of each finished trial that this core version can replay.

    Args:
        progress: Called with (episodes done, episodes in all).

    Raises:
        StudyError: If a trial is a ranked one of an open study.
    """
    if data.closed_ms is None and any(trial.phase == "ranked" for trial in trials):
        raise StudyError(
            f"the study {data.protocol.name!r} is open, and nothing of its ranked instances may leave before it is closed; "
            "close it first, or ask for the warm-up"
        )
    ended = [trial for trial in trials if trial.ended_ms is not None]
    replayable = [trial for trial in ended if trial.core_version == trial.environment.version]
    for done, (trial, record) in enumerate(trial_records(reader, replayable), 1):
        yield trial, record, estimator.costs(record)
        if progress:
            progress(done, len(replayable))


def cost_rows(
    reader: Reader,
    data: StudyData,
    trials: Sequence[Trial],
    estimator: CostEstimator,
    progress: Progress | None = None,
) -> Iterator[CostRow]:
    """Yield every move of the trials with its cost (`trial_costs`), for a table."""
    names = data.protocol.environment.actions
    for trial, _, costs in trial_costs(reader, data, trials, estimator, progress):
        moves = zip(costs.actions, costs.costs, costs.advice.actions, costs.kinds, strict=False)
        for step, (action, cost, expert_action, kind) in enumerate(moves):
            words = None if kind is None else str(kind)
            yield CostRow(trial.id, step, names[action], int(cost), names[expert_action], words)
        if len(costs.advice.actions) > (last := len(costs.actions)):
            kind = _courses(data)[0].ended_early if costs.given_up else None
            expert_action = names[costs.advice.actions[last]]
            yield CostRow(trial.id, last, None, costs.given_up, expert_action, kind and str(kind))


def costs_of_study(
    reader: Reader, data: StudyData, progress: Progress | None = None
) -> tuple[CostSummary, list[dict[str, Any]]]:
    """The costs of everybody who played, under pseudonyms.

    Returns:
        The summary, and every move as a dictionary.

    Raises:
        ValueError: If no move is judged, or nobody's finished episode can be shown yet.
    """
    if (reason := why_not_judged(data)) is not None:
        raise ValueError(reason)
    cohort, estimator = people_of(data), study_estimator(data, cost_cache(reader.path))
    is_closed = data.closed_ms is not None
    practised = sorted(id for id, trials in cohort.warm_up.items() if trials)
    ids = members(cohort, {}) if is_closed else practised
    summary = summarize_costs(reader, data, cohort, ids, estimator, progress)
    if summary is None:
        raise ValueError(f"nobody's finished episode of {data.protocol.name!r} can be shown yet")
    names = {person: f"P{number:02d}" for number, person in enumerate(ids, 1)}
    trials = cohort.ranked if is_closed else cohort.warm_up
    rows = [
        {"player": names[person], **asdict(row)}
        for person in ids
        for row in cost_rows(reader, data, unspoilt(trials[person]), estimator)
    ]
    players = tuple(replace(player, player=names[player.player]) for player in summary.by_player)
    return replace(summary, by_player=players), rows


def summarize_costs(
    reader: Reader,
    data: StudyData,
    cohort: Cohort,
    ids: Sequence[str],
    estimator: CostEstimator,
    progress: Progress | None = None,
) -> CostSummary | None:
    """What the moves of some players of a cohort cost.

    They are those of ranked episodes of a closed study, else of the warm-up; spoilt episodes are
    left out.

    Returns:
        None if no episode is left.
    """
    phase = "warm_up" if data.closed_ms is None else "ranked"
    by_player = cohort.warm_up if data.closed_ms is None else cohort.ranked
    trials = [trial for player in ids for trial in unspoilt(by_player[player])]
    episodes: dict[str, dict[int, EpisodeCosts]] = defaultdict(dict)
    terrains: dict[int, None] = {}
    for trial, _, costs in trial_costs(reader, data, trials, estimator, progress):
        episodes[trial.participant][trial.terrain_index] = costs
        terrains[trial.terrain_index] = None
    if not episodes:
        return None
    courses, expert = _courses(data)
    kinds = courses.kinds
    gap = [np.nan] * (5 + len(kinds) + 10)
    table = [
        [_amounts(played[terrain], kinds) if terrain in played else gap for terrain in terrains]
        for played in episodes.values()
    ]
    cells = np.array(table, np.float64)
    counts, expert_moves = (float(player_means(cells[..., at]).mean()) for at in range(2))
    drawn = data.protocol.terrains_drawn
    total, without_move, gained, *parts = (
        _part(cells[..., at], drawn) for at in range(2, len(gap))
    )
    return CostSummary(
        phase=phase,
        episodes=sum(map(len, episodes.values())),
        counts=counts,
        expert_moves=expert_moves,
        total=total,
        by_kind=dict(zip(map(str, kinds), parts, strict=False)),
        gained=gained,
        by_tenth=tuple(parts[-10:]),
        without_move=without_move,
        policy=expert,
        by_player=tuple(
            _player(player, list(played.values()), kinds) for player, played in episodes.items()
        ),
    )


def _amounts(costs: EpisodeCosts, kinds: Sequence[str]) -> list[float]:
    """An episode's numbers for `CostSummary`: two lengths, the difference, its parts."""
    lengths = (costs.counts, costs.expert_moves, costs.total, costs.given_up, costs.gained)
    return [*lengths, *(costs.by_kind()[kind] for kind in kinds), *costs.by_tenth()]


def _part(table: Floats, terrains_drawn: bool) -> CostPart:
    """A part of the cost from float64[players, terrains], NaN for a gap."""
    low, high = map(float, interval(table, None, terrains_drawn))
    ends = None if math.isnan(low) or low == high else (low, high)
    return CostPart(float(player_means(table).mean()), ends)


def _courses(data: StudyData) -> tuple[Courses, str]:
    """What prices the moves of a study, and the expert's name.

    Raises:
        ValueError: If its moves are not judged.
    """
    environment = data.protocol.environment
    if environment.courses is None or environment.expert is None:
        raise ValueError(f"the moves of {environment.about.title} are not judged")
    return environment.courses, environment.expert


def _player(player: str, episodes: Sequence[EpisodeCosts], kinds: Sequence[str]) -> PlayerCosts:
    by_kind = [costs.by_kind() for costs in episodes]
    return PlayerCosts(
        player=player,
        episodes=len(episodes),
        mean=float(np.mean([costs.total for costs in episodes])),
        by_kind={
            str(kind): float(np.mean([episode[kind] for episode in by_kind])) for kind in kinds
        },
        gained=float(np.mean([costs.gained for costs in episodes])),
    )


def costs_of_people(
    reader: Reader, data: StudyData, progress: ProgressBar, cache: Path | None
) -> dict[str, CostSummary]:
    """The costs of a closed study's people per protocol, by the group's name.

    Empty if the study is open or its moves are not judged.

    Args:
        cache: The folder in which costs are stored; None stores nothing.
    """
    if data.closed_ms is None or why_not_judged(data) is not None:
        return {}
    cohort, estimator = people_of(data), study_estimator(data, cache)
    with progress("cost of each move") as advance:
        ids = members(cohort, data.protocol.per_protocol)
        summary = summarize_costs(reader, data, cohort, ids, estimator, advance)
    return {} if summary is None else {cohort.name: summary}


def ranked_of_people(data: StudyData) -> list[Trial]:
    """The trials whose moves a release judges.

    A program's are judged only if that is asked for.
    """
    return [trial for trial in data.trials if trial.phase == "ranked" and trial.kind == "human"]


def renamed(summary: CostSummary, names: Mapping[str, str]) -> CostSummary:
    """The same summary with the players' ids replaced by names."""
    players = (replace(player, player=names[player.player]) for player in summary.by_player)
    return replace(summary, by_player=tuple(sorted(players, key=lambda player: player.player)))
