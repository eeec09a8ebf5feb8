"""What a participant is shown at the end: their own figures, and those of a policy on the study's terrains.

Replays show warm-up terrains alone until the study is closed, because the ranked ones stay secret so long.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from functools import partial
from typing import Literal

from humanplay.db.store import Store
from humanplay.db.study_rows import Participant
from humanplay.db.trial import Trial
from humanplay.study.folder import SECRET_KEPT, Study
from humanplay.study.progress import StageError
from humanplay.task import PolicyError, Record, RunEndedError, Task, on_threads

_log = logging.getLogger(__name__)
Shown = Literal["warm_up", "ranked"]
"""The phases whose terrains a debrief can show."""


class NoTerrainError(LookupError):
    """The participant has played no such terrain to its end, or nothing can be shown of it."""


class Debriefs:
    """Debriefs of one server; a study's debrief policy plays the terrains of a phase once, in a thread."""

    def __init__(self, store: Store, task: Task) -> None:
        self._store, self._task = store, task
        self._runs: dict[tuple[str, Shown], list[Record]] = {}
        self._working = asyncio.Lock()

    async def summary(
        self, study: Study, participant: Participant, trials: Sequence[Trial]
    ) -> dict[str, object]:
        """Return the participant's figures as the page gets them under `debrief`."""
        runs = await self._policy_runs(study, "warm_up")
        ranked = [each for each in trials if each.phase == "ranked" and each.ended_ms is not None]
        first = (
            study.protocol.warm_up
        )  # of those who needed another try at the practice, the first one
        own = [
            trial.steps_to_target or 0
            for trial in trials
            if trial.phase == "warm_up" and trial.trial < first
        ]
        successes = study.protocol.environment.successes
        its = [run.steps if run.outcome in successes else run.config.limit for run in runs]
        return {
            "mean_score": _mean([trial.score or 0.0 for trial in ranked]),
            "mean_steps": _mean([trial.steps_to_target or 0 for trial in ranked]),
            "episodes": [
                {
                    "trial": trial.trial,
                    "outcome": trial.outcome,
                    "steps": trial.steps,
                    "score": trial.score,
                }
                for trial in ranked
            ],
            "policy": {
                "name": study.protocol.debrief_policy,
                "mean_steps_warm_up": _mean(its),
                "own_mean_steps_warm_up": _mean(own),
            }
            if runs and own
            else None,
            "warm_up_terrains": len(own) if runs else 0,
            "ranked_terrains": 0 if study.is_open or not runs else len(ranked),
        }

    async def replays(
        self, study: Study, trials: Sequence[Trial], phase: Shown, index: int
    ) -> dict[str, object]:
        """Return the participant's own episode and the policy's on the same terrain; errors as `own_trial`."""
        own = own_trial(study, trials, phase, index)
        runs = await self._policy_runs(study, phase)
        if own.terrain_index >= len(runs):
            raise NoTerrainError(
                f"the policy {study.protocol.debrief_policy!r} is not there any more, so no run of its can be shown"
            )
        record = await self._store.read(lambda: self._store.load_record(own.id))
        environment = (
            self._task if study.protocol.task == self._task.name else study.protocol.environment
        )
        index = own.terrain_index
        try:
            mine = await on_threads(self._task, environment.frames, record, own.id)
            its = await on_threads(self._task, environment.frames, runs[index], f"policy-{index}")
        except RunEndedError as error:
            raise NoTerrainError(str(error)) from error
        return {"own": mine, "policy": {"name": study.protocol.debrief_policy, "frames": its}}

    async def _policy_runs(self, study: Study, phase: Shown) -> list[Record]:
        async with self._working:
            key = study.protocol_hash, phase
            if key not in self._runs:
                self._runs[key] = await asyncio.to_thread(_play, study, phase)
            return self._runs[key]


def own_trial(study: Study, trials: Sequence[Trial], phase: Shown, index: int) -> Trial:
    """Return a participant's ended trial: on warm-up terrain `index`, or the ranked one that they played as number `index`.

    StageError for a ranked one of an open study, NoTerrainError when there is none.
    """
    if phase == "ranked" and study.keeps_secret:
        raise StageError(SECRET_KEPT.format(study.name))
    if phase == "ranked" and study.is_open:
        raise StageError("ranked instances are shown once the study is closed: come back then")
    for trial in trials:
        number = trial.terrain_index if phase == "warm_up" else trial.trial
        if trial.phase == phase and number == index and trial.ended_ms is not None:
            return trial
    what = f"no {phase.replace('_', '-')} instance {index} that you have played to its end"
    raise NoTerrainError(f"{what}; they count from 0")


def _play(study: Study, phase: Shown) -> list[Record]:
    """Return what the debrief policy does on the terrains of a phase; nothing when it cannot be loaded any more."""
    config, name = study.protocol.env_config, study.protocol.debrief_policy
    policies = study.protocol.environment.policies
    if name is None:
        return []
    count = study.protocol.warm_up if phase == "warm_up" else study.protocol.ranked
    try:
        policy = policies.load(study.policy_files.source(name), config)
    except PolicyError as error:
        _log.warning("the debrief of study %s does without its policy: %s", study.name, error)
        return []
    seed = partial(study.seed, "warm-up" if phase == "warm_up" else "ranked")
    return [policies.play(policy, config, seed(i), i).record() for i in range(count)]


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
