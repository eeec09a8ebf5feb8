"""What happened in a simulated study: counts, round trips, and everything that a server must not do and did."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass
class PlayerOutcome:
    """What one player has done so far.

    stage       where it stands: a stage of the study, "left" when it has gone for ever
    episodes    ended while this command ran, by phase
    debrief     the study's summary of the player at the end, None before
    """

    number: int
    kind: str
    stage: str = "joining"
    episodes: dict[str, int] = field(
        default_factory=lambda: {"tutorial": 0, "warm_up": 0, "ranked": 0}
    )
    debrief: dict[str, Any] | None = None
    code: str | None = None

    @property
    def is_done(self) -> bool:
        """Whether this player will not do anything any more."""
        return self.stage in ("complete", "left", "withdrawn")


@dataclass
class OutcomeLog:
    """The counts of a simulated study, kept up to date while it is played.

    players           one entry for each player that joined
    round_trips_ms    from each act to its frame
    events_recorded   input events of the players, each of which is to be kept once
    lost_connections  connections that broke, the server's restarts among them
    reloads           pages that the players closed and opened again
    attempts          what cheaters tried, by name: (times tried, times refused)
    faults            sentences: what a server must not do and did
    """

    players: list[PlayerOutcome] = field(default_factory=list)
    round_trips_ms: list[float] = field(default_factory=list)
    events_recorded: int = 0
    lost_connections: int = 0
    reloads: int = 0
    attempts: dict[str, tuple[int, int]] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    began: float = field(default_factory=time.perf_counter)

    @property
    def moves(self) -> int:
        """Moves that were answered by their frame."""
        return len(self.round_trips_ms)

    @property
    def episodes(self) -> int:
        """Episodes ended by now."""
        return sum(sum(player.episodes.values()) for player in self.players)

    def seconds(self) -> float:
        """Return the seconds since the beginning."""
        return time.perf_counter() - self.began

    def count_attempt(self, name: str, got_through: str | None) -> None:
        """Count an attempt; `got_through` says what a cheater was given, None when it was refused."""
        times, refused = self.attempts.get(name, (0, 0))
        self.attempts[name] = (times + 1, refused + (got_through is None))
        if got_through is not None:
            self.add_fault(f"a cheater got through ({name}): {got_through}")

    def add_fault(self, sentence: str) -> None:
        """Add a fault; one that is there already is not added again."""
        if sentence not in self.faults:
            self.faults.append(sentence)

    def latency_ms(self) -> dict[str, float]:
        """Return percentiles of act to frame; empty before the first move."""
        if not self.round_trips_ms:
            return {}
        names = {"p50": 50, "p95": 95, "p99": 99, "max": 100}
        return {
            name: float(np.percentile(self.round_trips_ms, share)) for name, share in names.items()
        }
