"""What a participant is shown at the end: their own figures, and those of a policy on the study's warm-up terrains.

Replays show warm-up terrains alone, because the ranked ones stay secret until the study is closed.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.play.replays import frames
from app.storage.store import Store
from app.storage.study_rows import Participant, TrialRow
from app.study.folder import Study
from marsexplorer.episode import Episode, Record
from marsexplorer.policies import load
from marsexplorer.score import steps_to_target

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class WarmUpRun:
    """What the debrief policy did on a warm-up terrain."""

    record: Record
    steps: int


class Debriefs:
    """Debriefs of one server; a study's debrief policy plays the warm-up terrains once, in a thread."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._runs: dict[str, list[WarmUpRun]] = {}
        self._working = asyncio.Lock()

    async def summary(self, study: Study, participant: Participant, trials: Sequence[TrialRow]) -> dict[str, Any]:
        """Return the participant's figures as the page gets them under `debrief`."""
        config, runs = study.protocol.env_config, await self._policy_runs(study)
        ranked = [trial for trial in trials if trial.phase == "ranked" and trial.ended_ms is not None]
        own = [steps_to_target(config, trial.outcome or "", trial.steps or 0) for trial in trials if trial.phase == "warm_up"]
        steps = [steps_to_target(config, trial.outcome or "", trial.steps or 0) for trial in ranked]
        url, code = study.protocol.return_url, participant.completion_code or ""
        return {
            "mean_score": _mean([trial.score or 0.0 for trial in ranked]),
            "mean_steps": _mean(steps),
            "episodes": [
                {"trial": trial.trial, "outcome": trial.outcome, "steps": trial.steps, "score": trial.score} for trial in ranked
            ],
            "policy": {
                "name": study.protocol.debrief_policy,
                "mean_steps_warm_up": _mean([run.steps for run in runs]),
                "own_mean_steps_warm_up": _mean(own),
            }
            if runs and own
            else None,
            "warm_up_terrains": len(own) if runs else 0,
            "completion_code": participant.completion_code,
            "return_url": None if url is None else url.replace("{code}", code),
        }

    async def replays(self, study: Study, trials: Sequence[TrialRow], index: int) -> dict[str, Any]:
        """Return the participant's own warm-up episode on terrain `index` and the policy's; LookupError when there is none."""
        own = [trial for trial in trials if trial.phase == "warm_up" and trial.terrain == index and trial.ended_ms is not None]
        runs = await self._policy_runs(study)
        if not own or index >= len(runs):
            raise LookupError(f"no warm-up terrain {index}: there are {len(runs)}, counted from 0")
        record = self._store.load_record(own[0].episode_id)
        mine = await asyncio.to_thread(frames, record, own[0].episode_id)
        its = await asyncio.to_thread(frames, runs[index].record, f"policy-{index}")
        return {"own": mine, "policy": {"name": study.protocol.debrief_policy, "frames": its}}

    async def _policy_runs(self, study: Study) -> list[WarmUpRun]:
        async with self._working:
            if study.protocol_hash not in self._runs:
                self._runs[study.protocol_hash] = await asyncio.to_thread(_play, study)
            return self._runs[study.protocol_hash]


def _play(study: Study) -> list[WarmUpRun]:
    """Return what the debrief policy does on the warm-up terrains; nothing when it cannot be loaded any more."""
    config, runs = study.protocol.env_config, list[WarmUpRun]()
    try:
        policy = load(study.protocol.debrief_policy, config.sensor_radius)
    except (LookupError, ValueError, OSError) as error:
        _log.warning("the debrief of study %s does without its policy: %s", study.name, error)
        return []
    for i in range(study.protocol.warm_up):
        episode = Episode.begin(config, seed=study.seed("warm-up", i))
        policy.reset(i)
        while not episode.ended:
            episode.step(policy.act(episode.codes.copy()))
        runs.append(WarmUpRun(episode.record(), steps_to_target(config, episode.outcome, episode.steps)))
    return runs


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None
