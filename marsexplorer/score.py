"""The normalized score of section 3.2, and the steps to 99 % that are always given with it."""

from __future__ import annotations

from marsexplorer.config import EnvConfig


def score(config: EnvConfig, episode_return: float, cells: int | None = None) -> float:
    """Return the normalized score: 0 is an invalid first move, 1 the theoretical maximum; never clipped.

    cells  that count on the terrain (`world.cells_that_count`); None: all n

    (return + r_invalid) / (r_invalid + r_bonus + cells), Koutras et al. 2021, section 3.2, where cells is n.
    """
    return (episode_return + config.r_invalid) / (
        config.r_invalid + config.r_bonus + (config.n if cells is None else cells)
    )


def steps_to_target(config: EnvConfig, outcome: str, steps: int) -> int:
    """Return the moves an explored episode took; any other finished episode counts `max_steps`."""
    return steps if outcome == "explored" else config.limit
