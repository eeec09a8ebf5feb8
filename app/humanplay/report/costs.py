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
    """One move of an episode: `step` from 0, `cost` in moves, actions in words, `kind` None outside
    all mistakes.

    An episode that ended without a move has one more row, whose `action` is None: its costs then
    add up as all others'.
    """

    episode: str
    step: int
    action: str | None
    cost: int
    expert_action: str
    kind: str | None


@dataclass(frozen=True)
class PlayerCosts:
    """One player's mean cost per episode, in moves: what it counts more than the expert's, and the
    parts of that."""

    player: str
    episodes: int
    mean: float
    by_kind: dict[str, float]
    gained: float


@dataclass(frozen=True)
class CostPart:
    """All cost or a part of it, in moves an episode: the mean of players' means, and its 95 %
    interval.

    The interval is for other players and, where the protocol fixes no terrains, other terrains;
    None without a spread and below five players.
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
    """Return the folder next to a database in which costs are kept."""
    return database.with_name(f"{database.name}-costs")


def forget_costs(database: Path) -> None:
    """Delete the folder in which costs are kept; what is asked for again is worked out again."""
    shutil.rmtree(cost_cache(database), ignore_errors=True)


def why_not_judged(data: StudyData) -> str | None:
    """Return the sentence that says why no move of a study is judged; None where moves are."""
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
    """Return what works out a study's costs, by the expert's file of the time at which the study
    was frozen.

    Args:
        cache: The folder in which costs are kept; None keeps nothing.
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
    """Yield the costs of each finished trial that this core version can replay; StudyError for a
    ranked one of an open study.

    Args:
        progress: Called with (episodes done, in all).
    """
    if data.closed_ms is None and any(trial.phase == "ranked" for trial in trials):
        raise StudyError(
            f"the study {data.protocol.name!r} is open, and nothing of its ranked instances may leave before it is closed; "
            "close it first, or ask for the warm-up"
        )
    ended = [trial for trial in trials if trial.ended_ms is not None]
    own = [trial for trial in ended if trial.core_version == trial.environment.version]
    for done, (trial, record) in enumerate(trial_records(reader, own), 1):
        yield trial, record, estimator.costs(record)
        if progress:
            progress(done, len(own))


def cost_rows(
    reader: Reader,
    data: StudyData,
    trials: Sequence[Trial],
    estimator: CostEstimator,
    progress: Progress | None = None,
) -> Iterator[CostRow]:
    """Yield every move of the trials with its cost, as tables of it have them; see `trial_costs`."""
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
    """Return the summary over everybody who played, under pseudonyms, and every move of theirs as a
    dictionary.

    ValueError where no move is judged, and where nobody's finished episode can be shown yet.
    """
    if (reason := why_not_judged(data)) is not None:
        raise ValueError(reason)
    cohort, estimator = people_of(data), study_estimator(data, cost_cache(reader.path))
    is_closed = data.closed_ms is not None
    practised = sorted(id for id, own in cohort.warm_up.items() if own)
    ids = members(cohort, {}) if is_closed else practised
    summary = summarize_costs(reader, data, cohort, ids, estimator, progress)
    if summary is None:
        raise ValueError(f"nobody's finished episode of {data.protocol.name!r} can be shown yet")
    names = {person: f"P{number:02d}" for number, person in enumerate(ids, 1)}
    own = cohort.ranked if is_closed else cohort.warm_up
    rows = [
        {"player": names[person], **asdict(row)}
        for person in ids
        for row in cost_rows(reader, data, unspoilt(own[person]), estimator)
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
    """Return what the moves of some players of a cohort cost: in ranked episodes of a closed study,
    else in the warm-up.

    Spoilt ones are left out. None where no episode is left.
    """
    phase = "warm_up" if data.closed_ms is None else "ranked"
    own = cohort.warm_up if data.closed_ms is None else cohort.ranked
    trials = [trial for player in ids for trial in unspoilt(own[player])]
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
    """Return what `CostSummary` has of an episode: the two lengths, the difference, and its parts."""
    lengths = (costs.counts, costs.expert_moves, costs.total, costs.given_up, costs.gained)
    return [*lengths, *(costs.by_kind()[kind] for kind in kinds), *costs.by_tenth()]


def _part(table: Floats, terrains_drawn: bool) -> CostPart:
    """Return a part of the cost from float64[players, terrains], NaN for a gap."""
    low, high = map(float, interval(table, None, terrains_drawn))
    ends = None if math.isnan(low) or low == high else (low, high)
    return CostPart(float(player_means(table).mean()), ends)


def _courses(data: StudyData) -> tuple[Courses, str]:
    """What prices the moves of a study, and the expert's name; ValueError if they are not judged."""
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
        by_kind={str(kind): float(np.mean([own[kind] for own in by_kind])) for kind in kinds},
        gained=float(np.mean([costs.gained for costs in episodes])),
    )


def costs_of_people(
    reader: Reader, data: StudyData, progress: ProgressBar, cache: Path | None
) -> dict[str, CostSummary]:
    """Return the costs of a closed study's people under the primary set, by the group's name.

    Nothing where a study is open or its moves are not judged. cache: the folder in which costs are
    kept; None keeps nothing
    """
    if data.closed_ms is None or why_not_judged(data) is not None:
        return {}
    cohort, estimator = people_of(data), study_estimator(data, cache)
    with progress("cost of each move") as advance:
        ids = members(cohort, data.protocol.per_protocol)
        summary = summarize_costs(reader, data, cohort, ids, estimator, advance)
    return {} if summary is None else {cohort.name: summary}


def ranked_of_people(data: StudyData) -> list[Trial]:
    """Return the trials whose moves a release judges: a program's are judged only where that is
    asked for."""
    return [trial for trial in data.trials if trial.phase == "ranked" and trial.kind == "human"]


def renamed(summary: CostSummary, names: Mapping[str, str]) -> CostSummary:
    """Return the same with the players' ids replaced by names."""
    players = (replace(player, player=names[player.player]) for player in summary.by_player)
    return replace(summary, by_player=tuple(sorted(players, key=lambda player: player.player)))
