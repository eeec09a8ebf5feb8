"""Where the players of a study lose moves: the regret of each move of their episodes, and what it comes to.

`marsexplorer.evaluation.regret` says what a regret is. Ranked episodes of an open study are refused here, so that nothing of
their terrains leaves before it is closed.
"""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.db.trial import Trial
from app.jobs import Progress
from app.report.statistics.comparisons import new_terrains_interval, player_means
from app.report.statistics.exclusion_sets import (
    Cohort,
    members,
    people_of,
    scripts_of,
    unspoilt,
)
from app.report.statistics.intervals import Interval, printed_interval
from app.report.statistics.study_figures import primary_set
from app.series.data import StudyData, trial_records
from app.series.policy_files import REGRET_POLICY
from app.series.protocol import Protocol, StudyError
from app.task import MARS, Record
from marsexplorer.intervals import Floats

POLICY = REGRET_POLICY
"""The policy that goes on after each action, and whose own regret is stated as the ground to compare with."""
ProgressBar = Callable[[str], AbstractContextManager[Progress]]
"""Opens a progress bar of a name."""


@contextmanager
def no_bar(name: str) -> Iterator[Progress]:
    """Show no progress."""
    yield lambda done, total: None


@dataclass(frozen=True)
class RegretRow:
    """One move of an episode: `step` from 0, `regret` in moves, actions in words, `kind` None where nothing was lost."""

    episode: str
    step: int
    action: str
    regret: int
    best_action: str
    kind: str | None


@dataclass(frozen=True)
class PlayerRegret:
    """One player's mean regret per episode, and its parts by kind of loss, in moves."""

    player: str
    episodes: int
    mean: float
    by_kind: dict[str, float]


@dataclass(frozen=True)
class RegretPart:
    """All regret or a part of it, in moves an episode, every player weighing the same.

    Intervals are 95 %, None without a spread.

    mean, interval  of players, with the interval over players by the report's rule
    policy          the policy's own, the mean over the terrains that players met
    excess          players minus policy, paired by terrain: the mean over players of a player's mean difference
    excess_interval for other players and other terrains, as in comparisons with policies
    """

    mean: float
    interval: Interval | None
    policy: float
    excess: float
    excess_interval: Interval | None


@dataclass(frozen=True)
class RegretSummary:
    """Regret per episode over players.

    total, by_kind  all of it, and by kind of loss
    by_tenth        of the moves made while 0-10 %, 10-20 %, ... of the cells were known; without what giving up cost
    policy          that goes on after each action
    """

    phase: str
    episodes: int
    total: RegretPart
    by_kind: dict[str, RegretPart]
    by_tenth: tuple[RegretPart, ...]
    policy: str
    by_player: tuple[PlayerRegret, ...]


def regret_cache(database: Path) -> Path:
    """Return the folder next to a database in which regrets are kept."""
    return database.with_name(f"{database.name}-regret")


def forget_regrets(database: Path) -> None:
    """Delete the folder in which regrets are kept; what is asked for again is worked out again."""
    shutil.rmtree(regret_cache(database), ignore_errors=True)


def has_regret(protocol: Protocol) -> bool:
    """Return whether moves on boards of a study have regrets."""
    players = protocol.rules.players
    return players is not None and bool(players.has_regret(protocol.env_config))


def study_estimator(data: StudyData, cache: Path | None) -> Any:
    """Return what works out a study's regrets: with POLICY's file of the time at which the study was frozen.

    cache  the folder in which regrets are kept; None keeps nothing
    """
    return _players(data).RegretEstimator(data.policy_files.source(POLICY), cache)


def trial_regrets(
    reader: Reader,
    data: StudyData,
    trials: Sequence[Trial],
    estimator: Any,
    progress: Progress | None = None,
) -> Iterator[tuple[Trial, Record, Any]]:
    """Yield the regret of each finished trial that this core version can replay; StudyError for a ranked one of an open study.

    progress  called with (episodes done, in all)
    """
    if data.closed_ms is None and any(trial.phase == "ranked" for trial in trials):
        raise StudyError(
            f"the study {data.protocol.name!r} is open, and nothing of its ranked terrains may leave before it is closed; "
            "close it first, or ask for the warm-up"
        )
    ended = [trial for trial in trials if trial.ended_ms is not None]
    own = [trial for trial in ended if trial.core_version == trial.rules.version]
    for done, (trial, record) in enumerate(trial_records(reader, own), 1):
        yield trial, record, estimator.regret(record)
        if progress:
            progress(done, len(own))


def regret_rows(
    reader: Reader,
    data: StudyData,
    trials: Sequence[Trial],
    estimator: Any,
    progress: Progress | None = None,
) -> Iterator[RegretRow]:
    """Yield every move of the trials with its regret, as tables of it have them; see `trial_regrets`."""
    names = data.protocol.rules.actions
    for trial, _, found in trial_regrets(reader, data, trials, estimator, progress):
        for step in range(len(found.actions)):
            loss = found.loss(step)
            kind = None if loss.kind is None else str(loss.kind)
            action, best = names[loss.action], names[loss.best_action]
            yield RegretRow(trial.id, step, action, loss.regret, best, kind)


def regret_of_study(
    reader: Reader, data: StudyData, progress: Progress | None = None
) -> tuple[RegretSummary, list[dict[str, Any]]]:
    """Return the summary over everybody who played, under pseudonyms, and every move of theirs as a dictionary.

    ValueError for another task than MarsExplorer, where the boards are too large, and where nobody's finished episode can be
    shown yet.
    """
    if data.protocol.task != MARS:
        raise ValueError(
            f"the study {data.protocol.name!r} is of another environment, whose moves have no regret"
        )
    _players(data).check_size(data.protocol.env_config)
    cohort, estimator = people_of(data), study_estimator(data, regret_cache(reader.path))
    is_closed = data.closed_ms is not None
    practised = sorted(id for id, own in cohort.warm_up.items() if own)
    ids = members(cohort, {}) if is_closed else practised
    summary = summarize_regret(reader, data, cohort, ids, estimator, progress)
    if summary is None:
        raise ValueError(f"nobody's finished episode of {data.protocol.name!r} can be shown yet")
    names = {person: f"P{number:02d}" for number, person in enumerate(ids, 1)}
    own = cohort.ranked if is_closed else cohort.warm_up
    told = ((each, regret_rows(reader, data, unspoilt(own[each]), estimator)) for each in ids)
    rows = [{"player": names[each], **asdict(row)} for each, found in told for row in found]
    players = tuple(replace(each, player=names[each.player]) for each in summary.by_player)
    return replace(summary, by_player=players), rows


def summarize_regret(
    reader: Reader,
    data: StudyData,
    cohort: Cohort,
    ids: Sequence[str],
    estimator: Any,
    progress: Progress | None = None,
) -> RegretSummary | None:
    """Return where some players of a cohort lose moves: in ranked episodes of a closed study, else in the warm-up.

    Spoilt ones are left out. None where no episode has a regret.
    """
    phase = "warm_up" if data.closed_ms is None else "ranked"
    own = cohort.warm_up if data.closed_ms is None else cohort.ranked
    trials = [trial for player in ids for trial in unspoilt(own[player])]
    if not has_regret(data.protocol):
        return None
    episodes: dict[str, dict[int, Any]] = defaultdict(dict)
    terrains: dict[int, Record] = {}
    for trial, record, found in trial_regrets(reader, data, trials, estimator, progress):
        episodes[trial.participant][trial.terrain_index] = found
        terrains[trial.terrain_index] = record
    if not episodes:
        return None
    policy = _policy_regrets(data, terrains, estimator)
    kinds = tuple(_players(data).LossKind)
    rest = [np.nan] * (1 + len(kinds) + 10)
    every = episodes.values()
    table = [[_amounts(own[at], kinds) if at in own else rest for at in terrains] for own in every]
    cells = np.array(table, np.float64)
    alone = np.array([_amounts(policy[at], kinds) for at in terrains], np.float64)
    total, *parts = (_part(cells[..., at], alone[:, at]) for at in range(alone.shape[1]))
    return RegretSummary(
        phase=phase,
        episodes=sum(map(len, episodes.values())),
        total=total,
        by_kind=dict(zip(map(str, kinds), parts, strict=False)),
        by_tenth=tuple(parts[-10:]),
        policy=POLICY,
        by_player=tuple(
            _player(player, list(own.values()), kinds) for player, own in episodes.items()
        ),
    )


def _amounts(found: Any, kinds: Sequence[Any]) -> list[float]:
    """Return the regret of an episode: all, by kind, by tenth."""
    return [found.total, *(found.by_kind()[kind] for kind in kinds), *found.by_tenth()]


def _part(table: Floats, policy: Floats) -> RegretPart:
    """Return a part of the regret from the players' float64[players, terrains], NaN for a gap, and float64[terrains]."""
    means, differences = player_means(table), table - policy
    ends = None
    if len(means) > 1 and np.ptp(means) > 0:
        low, high = map(float, printed_interval(means))
        ends = max(0.0, low), high
    varies = np.nanmax(differences) > np.nanmin(differences)
    return RegretPart(
        mean=float(means.mean()),
        interval=ends,
        policy=float(policy.mean()),
        excess=float(player_means(differences).mean()),
        excess_interval=new_terrains_interval(differences) if varies else None,
    )


def _players(data: StudyData) -> Any:
    return data.protocol.rules.players


def _player(player: str, episodes: Sequence[Any], kinds: Sequence[Any]) -> PlayerRegret:
    lost = [each.by_kind() for each in episodes]
    return PlayerRegret(
        player=player,
        episodes=len(episodes),
        mean=float(np.mean([each.total for each in episodes])),
        by_kind={str(kind): float(np.mean([each[kind] for each in lost])) for kind in kinds},
    )


def _policy_regrets(
    data: StudyData, terrains: Mapping[int, Record], estimator: Any
) -> dict[int, Any]:
    """Return the regret of the policy's own episode on the terrain of each record."""
    players = _players(data)
    policy = players.load(data.policy_files.source(POLICY), data.protocol.env_config)
    runs = {at: players.play_terrain(policy, record) for at, record in terrains.items()}
    return {at: estimator.regret(run.record()) for at, run in runs.items()}


def regrets_of_groups(
    reader: Reader, data: StudyData, synthetic: bool, progress: ProgressBar, cache: Path | None
) -> dict[str, RegretSummary]:
    """Return the regret of a closed study's people under the primary set, or of each kind of script, by group's name.

    Nothing where a study is open or its moves have no regret. cache: the folder in which regrets are kept; None keeps nothing
    """
    found: dict[str, RegretSummary] = {}
    if data.closed_ms is None or not has_regret(data.protocol):
        return found
    primary = data.protocol.exclusion.get(primary_set(data), {})
    estimator = study_estimator(data, cache)
    for cohort in scripts_of(data) if synthetic else [people_of(data)]:
        with progress("regret of each move") as advance:
            ids = members(cohort, primary)
            summary = summarize_regret(reader, data, cohort, ids, estimator, advance)
        if summary is not None:
            found[cohort.name] = summary
    return found


def renamed(summary: RegretSummary, names: Mapping[str, str]) -> RegretSummary:
    """Return the same with the players' ids replaced by names."""
    players = (replace(each, player=names[each.player]) for each in summary.by_player)
    return replace(summary, by_player=tuple(sorted(players, key=lambda each: each.player)))
