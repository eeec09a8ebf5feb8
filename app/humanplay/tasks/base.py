"""What a task has unless it says otherwise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from humanplay.task import Configuration, Policy, PolicyError, PolicyOffer


class BasePolicies:
    """Policies that decide one by one, on boards of any size; none is shipped (`humanplay.task.Policies`)."""

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
