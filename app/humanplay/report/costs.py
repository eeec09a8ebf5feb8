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
from typing import Any, NamedTuple

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

    If an episode ended without a move, as by giving up, a last row holds what that cost. So the
    rows of every episode add up to its cost.

    Attributes:
        step: The number of the move, from 0.
        action, expert_action: In words; `action` is None in a last row without a move.
        cost: In moves.
        kind: The kind of mistake; None if the move is no mistake.
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
        mean: How many more moves an episode counts than the expert's on the same terrain.
        by_kind, gained: The parts of `mean`, as in `CostSummary`.
    """

    player: str
    episodes: int
    mean: float
    by_kind: dict[str, float]
    gained: float


@dataclass(frozen=True)
class CostPart:
    """The whole cost or a part of it, in moves an episode.

    Attributes:
        mean: Of the players' means.
        interval: At 95 %, for other players and, unless the protocol fixes the terrains, for other
            terrains; None below five players, or if all have the same cost.
    """

    mean: float
    interval: Interval | None


@dataclass(frozen=True)
class CostSummary:
    """Cost per episode over players.

    Attributes:
        counts: Moves that an episode counts, the mean over players.
        expert_moves: Moves of the expert's episodes on the same terrains, the mean over players.
        total: `counts` less `expert_moves`.
        by_kind: The cost of mistakes by kind; giving up is the kind `ended early`.
        gained: The cost of all moves that are no mistake, at most 0.
        by_tenth: The cost of the moves made at 0-10 %, 10-20 %, ... of the way.
        without_move: The cost of ends without a move, such as giving up.
        policy: The name of the expert's policy.

    `by_kind` and `gained` add up to `total`, and so do `by_tenth` and `without_move`.
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
    """Delete the folder in which costs are stored; they can be computed again."""
    shutil.rmtree(cost_cache(database), ignore_errors=True)


def reason_not_judged(data: StudyData) -> str | None:
    """Why no move of a study can be judged, in a sentence; None if they can."""
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
    """The estimator of a study's costs, with the expert's file of the freezing.

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
        progress: Is called with how many episodes are done, and of how many.

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
    courses, _ = _courses(data)
    names = data.protocol.environment.actions
    for trial, _, costs in trial_costs(reader, data, trials, estimator, progress):
        advised = [names[action] for action in costs.advice.actions]
        moves = zip(costs.actions, costs.costs, advised, costs.kinds, strict=False)
        for step, (action, cost, expert_action, kind) in enumerate(moves):
            words = None if kind is None else str(kind)
            yield CostRow(trial.id, step, names[action], int(cost), expert_action, words)
        # the expert is asked once more where the player ended without a move
        last = len(costs.actions)
        if len(advised) > last:
            words = str(courses.ended_early) if costs.without_move else None
            yield CostRow(trial.id, last, None, costs.without_move, advised[last], words)


def costs_of_study(
    reader: Reader, data: StudyData, progress: Progress | None = None
) -> tuple[CostSummary, list[dict[str, Any]]]:
    """The costs of a study's people, under pseudonyms.

    They are those of the ranked episodes if the study is closed, else of the warm-up.

    Returns:
        The summary, and every move as the fields of a `CostRow` with its `player`.

    Raises:
        ValueError: If no move is judged, or nobody's finished episode can be shown yet.
    """
    if (reason := reason_not_judged(data)) is not None:
        raise ValueError(reason)
    cohort, estimator = people_of(data), study_estimator(data, cost_cache(reader.path))
    if data.closed_ms is None:
        trials = cohort.warm_up
        people = sorted(person for person in trials if trials[person])
    else:
        trials = cohort.ranked
        people = list(members(cohort, {}))
    summary = summarize_costs(reader, data, cohort, people, estimator, progress)
    if summary is None:
        raise ValueError(f"nobody's finished episode of {data.protocol.name!r} can be shown yet")
    names = {person: f"P{number:02d}" for number, person in enumerate(people, 1)}
    rows = [
        {"player": names[person], **asdict(row)}
        for person in people
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
    """The cost of the moves of some players of a cohort; None if they have no episode.

    It is that of the ranked episodes if the study is closed, else of the warm-up. Spoilt episodes
    are left out.

    Args:
        ids: Of the players.
    """
    phase = "warm_up" if data.closed_ms is None else "ranked"
    by_player = cohort.warm_up if data.closed_ms is None else cohort.ranked
    trials = [trial for player in ids for trial in unspoilt(by_player[player])]
    episodes: dict[str, dict[int, EpisodeCosts]] = defaultdict(dict)
    for trial, _, costs in trial_costs(reader, data, trials, estimator, progress):
        episodes[trial.participant][trial.terrain_index] = costs
    if not episodes:
        return None
    courses, expert = _courses(data)
    kinds = courses.kinds
    tables = _tables(episodes, kinds)
    drawn = data.protocol.terrains_drawn
    return CostSummary(
        phase=phase,
        episodes=sum(map(len, episodes.values())),
        counts=float(player_means(tables.counts).mean()),
        expert_moves=float(player_means(tables.expert_moves).mean()),
        total=_cost_part(tables.total, drawn),
        by_kind={str(kind): _cost_part(tables.by_kind[kind], drawn) for kind in kinds},
        gained=_cost_part(tables.gained, drawn),
        by_tenth=tuple(_cost_part(table, drawn) for table in tables.by_tenth),
        without_move=_cost_part(tables.without_move, drawn),
        policy=expert,
        by_player=tuple(
            _player_costs(player, list(by_terrain.values()), kinds)
            for player, by_terrain in episodes.items()
        ),
    )


class _Tables(NamedTuple):
    """The amounts of `CostSummary`: float64[players, terrains], NaN for a gap."""

    counts: Floats
    expert_moves: Floats
    total: Floats
    gained: Floats
    without_move: Floats
    by_kind: Mapping[str, Floats]
    by_tenth: Sequence[Floats]


def _tables(episodes: Mapping[str, Mapping[int, EpisodeCosts]], kinds: Sequence[str]) -> _Tables:
    """The amounts of each player's episode on each terrain.

    Args:
        episodes: Player -> index of the terrain -> the costs of the episode.
    """
    indices = (index for by_terrain in episodes.values() for index in by_terrain)
    terrains = list(dict.fromkeys(indices))
    gaps = np.full((len(episodes), len(terrains)), np.nan)
    tables = _Tables(
        counts=gaps.copy(),
        expert_moves=gaps.copy(),
        total=gaps.copy(),
        gained=gaps.copy(),
        without_move=gaps.copy(),
        by_kind={kind: gaps.copy() for kind in kinds},
        by_tenth=[gaps.copy() for _ in range(10)],
    )
    for row, by_terrain in enumerate(episodes.values()):
        for index, costs in by_terrain.items():
            cell = row, terrains.index(index)
            tables.counts[cell] = costs.counts
            tables.expert_moves[cell] = costs.expert_moves
            tables.total[cell] = costs.total
            tables.gained[cell] = costs.gained
            tables.without_move[cell] = costs.without_move
            by_kind = costs.by_kind()
            for kind, table in tables.by_kind.items():
                table[cell] = by_kind[kind]
            for table, cost in zip(tables.by_tenth, costs.by_tenth(), strict=True):
                table[cell] = cost
    return tables


def _cost_part(table: Floats, terrains_drawn: bool) -> CostPart:
    """The mean and the interval of a table: float64[players, terrains], NaN for a gap."""
    low, high = map(float, interval(table, None, terrains_drawn))
    has_spread = not math.isnan(low) and low < high
    return CostPart(float(player_means(table).mean()), (low, high) if has_spread else None)


def _courses(data: StudyData) -> tuple[Courses, str]:
    """The courses that judge a study's moves, and the expert's name.

    Raises:
        ValueError: If its moves are not judged.
    """
    environment = data.protocol.environment
    if environment.courses is None or environment.expert is None:
        raise ValueError(f"the moves of {environment.about.title} are not judged")
    return environment.courses, environment.expert


def _player_costs(
    player: str, episodes: Sequence[EpisodeCosts], kinds: Sequence[str]
) -> PlayerCosts:
    kind_costs = [costs.by_kind() for costs in episodes]
    return PlayerCosts(
        player=player,
        episodes=len(episodes),
        mean=float(np.mean([costs.total for costs in episodes])),
        by_kind={
            str(kind): float(np.mean([by_kind[kind] for by_kind in kind_costs])) for kind in kinds
        },
        gained=float(np.mean([costs.gained for costs in episodes])),
    )


def costs_of_people(
    reader: Reader, data: StudyData, progress: ProgressBar, cache: Path | None
) -> dict[str, CostSummary]:
    """Name of the group -> the costs of its per-protocol people.

    Empty if the study is open or its moves are not judged.

    Args:
        cache: The folder in which costs are stored; None stores nothing.
    """
    if data.closed_ms is None or reason_not_judged(data) is not None:
        return {}
    cohort, estimator = people_of(data), study_estimator(data, cache)
    with progress("cost of each move") as advance:
        ids = members(cohort, data.protocol.per_protocol)
        summary = summarize_costs(reader, data, cohort, ids, estimator, advance)
    return {} if summary is None else {cohort.name: summary}


def judged_trials(data: StudyData) -> list[Trial]:
    """The trials whose moves a release judges: people's ranked ones."""
    return [trial for trial in data.trials if trial.phase == "ranked" and trial.kind == "human"]


def with_player_names(summary: CostSummary, names: Mapping[str, str]) -> CostSummary:
    """The summary with names in place of the players' IDs, sorted by them."""
    players = (replace(player, player=names[player.player]) for player in summary.by_player)
    return replace(summary, by_player=tuple(sorted(players, key=lambda player: player.player)))
