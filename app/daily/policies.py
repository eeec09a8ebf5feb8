"""The shipped policies on the daily terrains: played once a day in a process of low priority, and kept in a file."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from app.leaderboard.evaluations import PolicyEvaluations
from app.leaderboard.jobs import EvaluationJob
from app.play.daily_terrain import seed_of
from app.play.policy_catalogue import PolicyOffer
from app.storage.playground import DailyTerrain
from marsexplorer import policies

WAIT_S = 3.0
"""How long the evaluation waits after somebody has begun: the page that was just opened comes first."""
_SLOW = ("planner", "random")


class DailyPolicies:
    """Figures of the shipped policies among those on offer; `path` is the file that keeps them."""

    def __init__(self, path: Path, offers: Sequence[PolicyOffer]) -> None:
        shipped = policies.names()
        self._offers = [offer for offer in offers if offer.name in shipped]
        self._offers.sort(
            key=lambda offer: _SLOW.index(offer.name) + 1 if offer.name in _SLOW else 0
        )
        self._evaluations = PolicyEvaluations(path)
        self._soon: asyncio.Task[None] | None = None

    def prepare(self, terrain: DailyTerrain) -> None:
        """Have the figures of a terrain made soon, so that they are there when somebody has finished it."""
        if self._soon is None or self._soon.done():
            self._soon = asyncio.create_task(self._later(terrain), name="daily policies")

    def results(self, terrain: DailyTerrain) -> list[dict[str, Any]]:
        """Return per policy {"name", "state", "moves", "coverage"}, the best first; what is missing is begun.

        state     "ready", "waiting", "computing" or "failed"
        moves     to 99 %, None where it was not reached or is not known yet
        coverage  0..1 at the end; None while it is not known
        """
        offers = [
            offer
            for offer in self._offers
            if offer.size in (None, (terrain.config.rows, terrain.config.cols))
        ]
        jobs = [
            EvaluationJob(offer.source, terrain.config, (seed_of(terrain.key),)) for offer in offers
        ]
        found = [
            _described(offer.name, state)
            for offer, state in zip(offers, self._evaluations.request(jobs), strict=True)
        ]
        return sorted(
            found,
            key=lambda each: (each["moves"] is None, each["moves"] or 0, -(each["coverage"] or 0)),
        )

    async def close(self) -> None:
        """End the evaluation under way."""
        if self._soon is not None:
            self._soon.cancel()
        await self._evaluations.close()

    async def _later(self, terrain: DailyTerrain) -> None:
        await asyncio.sleep(WAIT_S)
        self.results(terrain)


def _described(name: str, state: dict[str, Any]) -> dict[str, Any]:
    figure = state["figure"]
    if figure is None:
        return {"name": name, "state": state["state"], "moves": None, "coverage": None}
    moves = round(figure["steps"]["mean"]) if figure["completed"] else None
    return {"name": name, "state": "ready", "moves": moves, "coverage": figure["curve"]["mean"][-1]}
