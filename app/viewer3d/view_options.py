"""What one browser asks of its 3-D view: camera, effects, and whether it draws what the policy thinks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

LARGE_SIDE = 30
"""A board with a side longer than this, in cells, is followed unless the browser asks for the whole map."""


@dataclass(frozen=True)
class ViewOptions:
    """The wishes of one browser, as they stand in the query of its socket's address.

    camera          map: all of the board; follow: the rover and what is around it; None: by the size of the board
    has_effects     shadows, haze, movement between cells: for browsers that draw with a GPU
    shows_thoughts  arrows for the policy's probabilities
    """

    camera: Literal["map", "follow"] | None = None
    has_effects: bool = False
    shows_thoughts: bool = False

    @classmethod
    def from_query(cls, query: Mapping[str, str]) -> ViewOptions:
        """Read `camera`, `effects` and `thoughts` (on or off) from a query; whatever else stands there is ignored."""
        camera = query.get("camera")
        return cls(
            camera="map" if camera == "map" else "follow" if camera == "follow" else None,
            has_effects=query.get("effects") == "on",
            shows_thoughts=query.get("thoughts") == "on",
        )

    def follows(self, rows: int, cols: int) -> bool:
        """Return whether the camera follows the rover on a board of this size."""
        return self.camera == "follow" or (self.camera is None and max(rows, cols) > LARGE_SIDE)
