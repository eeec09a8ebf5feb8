"""Where the players of a study lose moves: the regret of each move of their episodes, and what it comes to.

`marsexplorer.evaluation.regret` says what a regret is. Ranked episodes of an open study are refused here, so that nothing of
their terrains leaves before it is closed.
"""

from __future__ import annotations

import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from app.db.reader import Reader
from app.db.trial import Trial
from app.jobs import Progress
from app.report.statistics.exclusion_sets import Cohort, members, people_of
from app.report.statistics.intervals import Interval, printed_interval
from app.series.data import StudyData, trial_records
from app.series.policy_files import REGRET_POLICY
from app.series.protocol import Protocol, StudyError
from app.task import Record

POLICY = REGRET_POLICY
"""The policy that goes on after each action, and whose own regret is stated as the ground to compare with."""


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
class RegretSummary:
    """Regret per episode over players, every player weighing the same.

    mean, interval  moves an episode, with the 95 % interval over players by the report's rule; None for one player
    by_kind         share of the regret by kind of loss, 0..1
    by_tenth        mean regret of an episode's moves made while 0-10 %, 10-20 %, ... of the cells were known, moves
    policy          that goes on after each action; policy_mean: its own mean regret on the terrains played, moves an episode
    """

    phase: str
    episodes: int
    mean: float
    interval: Interval | None
    by_kind: dict[str, float]
    by_tenth: tuple[float, ...]
    policy: str
    policy_mean: float
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

    ValueError where the boards are too large, and where nobody's finished episode can be shown yet.
    """
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
    rows = [
        {"player": names[person], **asdict(row)}
        for person in ids
        for row in regret_rows(reader, data, own[person], estimator)
    ]
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

    None where no episode has a regret.
    """
    phase = "warm_up" if data.closed_ms is None else "ranked"
    own = cohort.warm_up if data.closed_ms is None else cohort.ranked
    trials = [trial for player in ids for trial in own[player]]
    if not has_regret(data.protocol):
        return None
    episodes: dict[str, list[Any]] = defaultdict(list)
    terrains: dict[bytes, Record] = {}
    for trial, record, found in trial_regrets(reader, data, trials, estimator, progress):
        episodes[trial.participant].append(found)
        terrains[record.terrain] = record
    if not episodes:
        return None
    kinds = tuple(map(str, _players(data).LossKind))
    players = tuple(_player(player, own, kinds) for player, own in episodes.items())
    means = np.sort(np.array([player.mean for player in players]))
    total = float(means.mean())
    interval = None
    if len(means) > 1:
        low, high = map(float, printed_interval(means))
        interval = max(0.0, low), high
    lost = {kind: float(np.mean([player.by_kind[kind] for player in players])) for kind in kinds}
    tenths = [np.mean([each.by_tenth() for each in own], axis=0) for own in episodes.values()]
    return RegretSummary(
        phase=phase,
        episodes=sum(map(len, episodes.values())),
        mean=total,
        interval=interval,
        by_kind={kind: moves / total if total else 0.0 for kind, moves in lost.items()},
        by_tenth=tuple(np.mean(tenths, axis=0).tolist()),
        policy=POLICY,
        policy_mean=_policy_mean(data, list(terrains.values()), estimator),
        by_player=players,
    )


def _players(data: StudyData) -> Any:
    return data.protocol.rules.players


def _player(player: str, episodes: Sequence[Any], kinds: Sequence[str]) -> PlayerRegret:
    lost = [{str(kind): moves for kind, moves in each.by_kind().items()} for each in episodes]
    return PlayerRegret(
        player=player,
        episodes=len(episodes),
        mean=float(np.mean([each.total for each in episodes])),
        by_kind={kind: float(np.mean([each[kind] for each in lost])) for kind in kinds},
    )


def _policy_mean(data: StudyData, records: Sequence[Record], estimator: Any) -> float:
    """Return the mean regret of the policy's own episodes on the terrains of some records."""
    players = _players(data)
    policy = players.load(data.policy_files.source(POLICY), records[0].config)
    played = [players.play_terrain(policy, record).record() for record in records]
    return float(np.mean([estimator.regret(each).total for each in played]))
