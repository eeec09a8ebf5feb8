"""The debrief: a participant's figures, and a policy's on the study's terrains.

Until the study is closed, replays show warm-up terrains alone, because the ranked ones are secret.
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
from humanplay.study.folder import Study
from humanplay.study.progress import StageError
from humanplay.task import PolicyError, Record, RunEndedError, Task, on_threads
from humanplay.task.sentences import Sentence

_log = logging.getLogger(__name__)
Shown = Literal["warm_up", "ranked"]
"""The phases whose terrains a debrief can show."""
SHOWN_ONCE_CLOSED = Sentence(
    "refused.shown_once_closed",
    "ranked instances are shown once the study is closed: come back then",
)
KEPT_SECRET = Sentence(
    "refused.secret_kept",
    "the study '{name}' is closed and its secret kept: its ranked instances are shown later",
)
NOT_PLAYED = Sentence(
    "refused.not_played",
    "no instance {index} that you have played to its end; they count from 0",
)
NO_POLICY = Sentence(
    "refused.no_policy",
    "the policy '{policy}' is not there any more, so no run of its can be shown",
)


class NoTerrainError(LookupError):
    """The participant has not finished such a terrain, or nothing of it can be shown."""


class Debriefs:
    """The debriefs of one server's studies.

    A study's debrief policy plays the terrains of a phase once, on a thread.
    """

    def __init__(self, store: Store, task: Task) -> None:
        self._store, self._task = store, task
        self._runs: dict[tuple[str, Shown], list[Record]] = {}
        self._working = asyncio.Lock()

    async def summary(
        self, study: Study, participant: Participant, trials: Sequence[Trial]
    ) -> dict[str, object]:
        """The participant's figures, as the page gets them under `debrief`."""
        runs = await self._policy_runs(study, "warm_up")
        ended = [trial for trial in trials if trial.ended_ms is not None]
        ranked = [trial for trial in ended if trial.phase == "ranked"]
        # whoever needed another try at the practice is compared by the first one
        first_try = study.protocol.warm_up
        warm_ups = [t for t in trials if t.phase == "warm_up" and t.trial < first_try]
        policy = None
        if runs and warm_ups:
            successes = study.protocol.environment.successes
            policy_steps = [
                run.steps if run.outcome in successes else run.config.limit for run in runs
            ]
            policy = {
                "name": study.protocol.debrief_policy,
                "mean_steps_warm_up": _mean(policy_steps),
                "own_mean_steps_warm_up": _mean([t.steps_to_target or 0 for t in warm_ups]),
            }
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
            "policy": policy,
            "warm_up_terrains": len(warm_ups) if runs else 0,
            "ranked_terrains": 0 if study.is_open or not runs else len(ranked),
        }

    async def replays(
        self, study: Study, trials: Sequence[Trial], phase: Shown, index: int
    ) -> dict[str, object]:
        """The participant's own episode and the policy's on the same terrain.

        Raises:
            StageError, NoTerrainError: As `own_trial` does, and if the policy cannot be played.
        """
        trial = own_trial(study, trials, phase, index)
        runs = await self._policy_runs(study, phase)
        terrain, policy = trial.terrain_index, study.protocol.debrief_policy
        if terrain >= len(runs):
            raise NoTerrainError(NO_POLICY.format(policy=policy))
        record = await self._store.read(lambda: self._store.load_record(trial.id))
        is_served = study.protocol.task == self._task.name
        environment = self._task if is_served else study.protocol.environment
        try:
            own_frames = await on_threads(self._task, environment.frames, record, trial.id)
            policy_frames = await on_threads(
                self._task, environment.frames, runs[terrain], f"policy-{terrain}"
            )
        except RunEndedError as error:
            raise NoTerrainError(str(error)) from error
        return {"own": own_frames, "policy": {"name": policy, "frames": policy_frames}}

    async def _policy_runs(self, study: Study, phase: Shown) -> list[Record]:
        async with self._working:
            key = study.protocol_hash, phase
            if key not in self._runs:
                self._runs[key] = await asyncio.to_thread(_play, study, phase)
            return self._runs[key]


def own_trial(study: Study, trials: Sequence[Trial], phase: Shown, index: int) -> Trial:
    """A trial that the participant has ended.

    Args:
        index: Of the terrain in the warm-up; of the trial, in the order played, if ranked.

    Raises:
        StageError: For a ranked trial of an open study.
        NoTerrainError: If there is none.
    """
    if phase == "ranked" and study.keeps_secret:
        raise StageError(KEPT_SECRET.format(name=study.name))
    if phase == "ranked" and study.is_open:
        raise StageError(SHOWN_ONCE_CLOSED)
    for trial in trials:
        number = trial.terrain_index if phase == "warm_up" else trial.trial
        if trial.phase == phase and number == index and trial.ended_ms is not None:
            return trial
    raise NoTerrainError(NOT_PLAYED.format(index=index))


def _play(study: Study, phase: Shown) -> list[Record]:
    """The debrief policy's runs on a phase's terrains; empty if it cannot be loaded."""
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
