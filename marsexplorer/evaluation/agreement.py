"""Agreement with a policy: how many of an episode's moves are those that the policy would have made in the same places."""

from __future__ import annotations

from dataclasses import dataclass

from marsexplorer.episode import Record, moves_of
from marsexplorer.policies import Policy, begin


@dataclass(frozen=True)
class Agreement:
    """Moves made, and how many of them a policy would have made too."""

    moves: int = 0
    agreed: int = 0

    def __add__(self, other: Agreement) -> Agreement:
        return Agreement(self.moves + other.moves, self.agreed + other.agreed)

    @property
    def share(self) -> float:
        """Agreed moves over all moves, 0..1; NaN without a move."""
        return self.agreed / self.moves if self.moves else float("nan")


def agreement_with(policy: Policy, record: Record, seed: int = 0) -> Agreement:
    """Return how many moves of an episode agree with a policy that is shown what the rover saw, from the first move on.

    seed  of what the policy draws, if it draws anything
    """
    begin(policy, record.config.level, seed)
    agreed = sum(policy.act(episode.codes) == action for episode, action in moves_of(record))
    return Agreement(len(record.actions), agreed)
