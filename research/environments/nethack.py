"""NetHack that obeys the seed of `reset`, which it ignores by itself.

Another folder and time zone still make a difference.
"""

from __future__ import annotations

from typing import Any

import gymnasium


class Seeded(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Gives the seed of `reset` to NetHack's own generators of random numbers."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Return what the game of a seed begins with."""
        if seed is not None:
            self.unwrapped.seed(core=seed, disp=seed, reseed=False)  # type: ignore[attr-defined]
        return self.env.reset(options=options)
