"""Whether episodes of a Gymnasium environment are the same here as elsewhere."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from humanplay.task import Configuration, Record, counted
from humanplay.task.registration import environment_of
from humanplay.tasks.base import give_up, seed_of
from humanplay.tasks.gymnasium.description import Description, canonical, spec_of
from humanplay.tasks.gymnasium.doctor import examine
from humanplay.tasks.lock import differences, lock_of

EXAMINED = 200
"""Moves on a seed that are compared before a study is frozen."""


class GymnasiumLock:
    """What an environment computes with (`humanplay.task.Lock`)."""

    def __init__(self, task: str, description: Description) -> None:
        self._task, self._description = task, description

    def current(self) -> dict[str, Any]:
        """Gymnasium's description of the environment, and what this machine computes with."""
        registered = spec_of(self._description.id)
        try:
            spec = json.loads(registered.to_json())
        except (TypeError, ValueError, AttributeError):  # of an entry point that is no text
            spec = str(registered)
        return {"spec": canonical(spec), **lock_of(tuple(self._description.packages))}

    def differences(self, recorded: Mapping[str, Any]) -> str:
        """Describe how this machine differs from a recorded lock; empty if it does not."""
        return ", ".join(differences(recorded, self.current()))

    def check_exact(self, config: Configuration) -> str:
        """Compare `EXAMINED` moves on each of five seeds; ValueError if they differ."""
        examination = examine(self._task, steps=EXAMINED, config=config.to_dict())
        if examination.differences:
            raise ValueError(
                f"{examination.verdict}; mend the environment or name a wrapper that does; "
                "`humanplay doctor` says more"
            )
        used = ""
        if examination.used:
            used = f"; a used environment differs, which does not count: {examination.used}"
        return f"{counted(examination.steps, 'move')} came to the same in fresh processes{used}"

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """How another version's episode differs if its actions are played here."""
        played = dict(package.rsplit(" ", 1) for package in record.core_version.split(", "))
        here = dict(package.rsplit(" ", 1) for package in self._description.versions.split(", "))
        reason = f"cannot be simulated here: {', '.join(differences(played, here))}"
        run = environment_of(self._task).run(record.config, seed_of(record))
        for step, (action, reward) in enumerate(zip(record.actions, rewards, strict=True), 1):
            if run.ended or run.step(action) != reward:
                return f"{reason}; first difference at step {step}"
        give_up(record, run)
        replayed = run.record()
        is_same = replayed.outcome == record.outcome
        is_same = is_same and replayed.trajectory_hash == record.trajectory_hash
        difference = "no difference" if is_same else "other observations"
        return f"{reason}; {difference} in {counted(len(rewards), 'step')}"
