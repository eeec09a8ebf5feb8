"""What a task has unless it says otherwise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from humanplay.task import Configuration, Policy, PolicyError, PolicyOffer, Record


class ExactLock:
    """The lock of rules that are the same everywhere: whole numbers alone (`humanplay.task.Lock`)."""

    def __init__(self, version: str) -> None:
        self._version = version

    def current(self) -> dict[str, Any]:
        """Nothing: the version says it all."""
        return {}

    def differences(self, recorded: Mapping[str, Any]) -> str:
        """None."""
        return ""

    def check_exact(self, config: Configuration) -> None:
        """Do nothing: the task's own tests have examined it."""

    def why_not_replayable(self, record: Record, rewards: Sequence[float]) -> str:
        """Another version's episode needs that version."""
        return f"{self._version} here: only the release that made it can simulate it"


class BasePolicies:
    """Policies that decide one by one, on boards of any size; none is shipped (`humanplay.task.Policies`)."""

    compared: tuple[str, ...] = ("random",)
    shown: str | None = None
    sees_frames: bool = False

    def offers(self) -> Sequence[PolicyOffer]:
        """What may be chosen by name."""
        return ()

    def check(self, name: str, *others: str) -> str:
        """The name, if it is on offer; ValueError naming the choices (and `others`) otherwise."""
        names = [offer.name for offer in self.offers()]
        if name not in names:
            raise ValueError(f"no policy {name!r}; choose one of: {', '.join((*others, *names))}")
        return name

    def check_size(self, names: Iterable[str], config: Configuration) -> None:
        """Do nothing: they play boards of any size."""

    def reset(self, policy: Policy, config: Configuration, seed: int) -> None:
        """Reset a policy for an episode."""
        policy.reset(seed)

    def act_many(
        self, policies: Sequence[Any], observations: Sequence[Any]
    ) -> Sequence[int | Exception]:
        """Each one's action, or why it has none."""
        actions: list[int | Exception] = []
        for policy, observation in zip(policies, observations, strict=True):
            try:
                actions.append(policy.act(observation))
            except PolicyError as error:
                actions.append(error)
        return actions

    def shared_net(self, policy: Any) -> object | None:
        """None: each decides by itself."""
        return None

    def observation_in(self, frame: Mapping[str, Any]) -> Any:
        """Raise PolicyError: a frame is a picture, and no observation."""
        raise PolicyError("a frame does not hold what a policy is given")

    def hash_of(self, source: str) -> str | None:
        """None: all of them are code."""
        return None

    def hash_with_code(self, source: str) -> str | None:
        """SHA-256 (hex) of its file; None for code, which may have changed unseen."""
        return self.hash_of(source)

    def find_shipped(self, digest: str) -> Path | None:
        """None: no file is shipped."""
        return None

    def unlisted(self) -> Mapping[str, Path]:
        """No files."""
        return {}

    def title(self, name: str) -> str:
        """The policy's name."""
        return name
