"""What a look from each cell is expected to show a policy: the numbers that the frontier rules, the planner and `ppo` weigh.

They follow from the observation alone, so nothing of the terrain is in them: unknown cells are taken to hide nothing. They are
worked out for whoever asks, once for each frame, and never for a board that a person plays.
"""

from __future__ import annotations

import json

import numpy as np

from app.play.session import Session
from marsexplorer.episode import Episode
from marsexplorer.policies.kernels.visibility import VisibilityMap


class ExpectedDiscoveries:
    """The newest answer of one session."""

    def __init__(self) -> None:
        self._asked: tuple[str, int] | None = None
        self._answer = ""
        self._map: VisibilityMap | None = None

    def of(self, session: Session) -> str:
        """Return the message about the newest frame; PermissionError on a board that a person plays."""
        if session.is_human or session.participation is not None:
            raise PermissionError(
                "what a look is expected to show is told of a policy's own board alone"
            )
        episode, asked = session.episode, (session.current.id, session.episode.steps)
        if asked != self._asked:
            self._asked, self._answer = asked, self._encode(session.current.id, episode)
        return self._answer

    def _encode(self, episode_id: str, episode: Episode) -> str:
        shape, radius = episode.codes.shape, episode.config.sensor_radius
        if self._map is None or (self._map.shape, self._map.radius) != (shape, radius):
            self._map = VisibilityMap(shape, radius)
        visited = np.zeros(shape, np.uint8)
        visited[tuple(np.array(episode.path).T)] = 1
        new_cells = self._map.expected_everywhere(episode.codes, visited)
        places = np.argwhere(new_cells)
        cells = np.column_stack([places, new_cells[tuple(places.T)]]).tolist()
        message = {"kind": "expected", "episode": episode_id, "step": episode.steps, "cells": cells}
        return json.dumps(message, separators=(",", ":"))
