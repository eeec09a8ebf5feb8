"""An episode as everything but the board itself knows it: one type for all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Literal

from humanplay.db.columns import TABLES
from humanplay.db.rows import Attestation, MoveRow, Phase
from humanplay.task import Configuration, Ending, Environment, Record
from humanplay.task.registration import environment_of

ParticipantKind = Literal["human", "script"]
Required = Literal["unattested", "attested", "supervised"]
"""What a study may ask for."""

LEFT = frozenset({"abandoned", "environment_failed"})
"""Outcomes of episodes that were left where they stood."""

DAILY: Literal["daily"] = "daily"
"""The kind of a series that is the terrain of a day, and what its name begins with."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """An episode, open or finished, with what it belongs to.

    Its columns are those of `columns.txt`. What fixes it is known from its start; from `ended_ms`
    to `attestation_reason` all are None while it runs. What is marked * is there if the query asked
    for it. What is marked + is a study's; outside of one it is "" or -1.

    Attributes:
        task: Whose rules it was played under; `core_version` is theirs.
        driver: "human", "script" or "policy:NAME".
        owner_id: * The player on whose page it ran.
        counts: * Whether it counts for the estimate of the playground's volunteers.
        series: The study or the day that it is of; "" if it is of none.
        moves, moved_ms: * How many moves were made so far, and when the last one was (None without
            one).
        participant, kind: + Who played it.
        trial: + 0.. in the order played, within its phase.
        terrain_index: + Of its seed, within its phase.
        pause_share: + Share (0..1) of the time from first to last move that was paused or out of
            sight, if it was worked out.
        touch_share: + Share (0..1) of the moves by key or touch that were made by touch, likewise.
        active_ms: + From the start to the last move without pauses and time out of sight, likewise.
        labels: + Of `humanplay.study.plausibility`, likewise.
    """

    id: str
    session_id: str
    number: int
    task: str
    core_version: str
    config: Configuration
    seed: int | None = field(repr=False)
    seed_chosen: bool
    terrain: bytes = field(repr=False)
    start: tuple[int, int]
    policy_seed: int
    driver: str
    assisted: bool
    started_ms: int
    terrain_met_before: bool = False
    ended_ms: int | None = None
    outcome: str | None = None
    failure: str | None = field(default=None, repr=False, compare=False)
    steps: int | None = None
    discovered: int | None = None
    total: float | None = None
    score: float | None = None
    trajectory_hash: str | None = None
    attestation: Attestation | None = None
    attestation_reason: str | None = None
    owner_id: str | None = field(default=None, compare=False)
    counts: bool = field(default=False, compare=False)
    series: str = ""
    moves: int = field(default=0, compare=False)
    moved_ms: int | None = field(default=None, compare=False)
    participant: str = ""
    kind: ParticipantKind = "human"
    phase: Phase | Literal[""] = ""
    trial: int = -1
    terrain_index: int = -1
    pause_share: float = 0.0
    touch_share: float = 0.0
    active_ms: float = 0.0
    labels: tuple[str, ...] = ()

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Trial:
        """The episode of a row of the table `episodes`, with the query's further fields.

        Raises:
            ValueError, TypeError: If its configuration is none.
        """
        values = {name: row[name] for name in _FIELDS & row.keys() if row[name] is not None}
        values["seed"] = row["seed"]
        for name in ("seed_chosen", "assisted", "terrain_met_before", "counts"):
            values[name] = bool(row.get(name))
        values["config"] = parse_config(row["task"], row["config"])
        values["start"] = (row["start_row"], row["start_col"])
        return cls(**values)

    def row(self) -> dict[str, object]:
        """What the table `episodes` holds of it, by column."""
        derived = {
            "level": self.config.level,
            "config": json.dumps(self.config.to_dict(), sort_keys=True, separators=(",", ":")),
            "config_hash": self.config_hash,
            "terrain_hash": self.terrain_hash,
            "start_row": self.start[0],
            "start_col": self.start[1],
        }
        return {
            name: derived[name] if name in derived else getattr(self, name) for name in _COLUMNS
        }

    @property
    def day(self) -> str | None:
        """The day (UTC) of the daily terrain that it is played on; None for another."""
        kind, _, rest = self.series.partition(":")
        return rest.partition(":")[0] if kind == DAILY else None

    @property
    def config_hash(self) -> str:
        """SHA-256 (hex) of the configuration's canonical JSON."""
        return str(self.config.hash)

    @property
    def environment(self) -> Environment:
        """The rules of its task."""
        return environment_of(self.task)

    @property
    def terrain_hash(self) -> str:
        """SHA-256 (hex) of the instance: the same for two seeds that draw the same one."""
        return self.environment.instance_hash(self)

    @property
    def cells(self) -> int:
        """How many cells coverage refers to; 0 if the task is not about discovering."""
        return self.environment.cells(self)

    @property
    def coverage(self) -> float | None:
        """The share of these cells that was discovered, 0..1."""
        return self.discovered / self.cells if self.discovered is not None and self.cells else None

    @property
    def succeeded(self) -> bool:
        """Whether it ended in an outcome that is a success."""
        return self.outcome in self.environment.successes

    @property
    def steps_to_target(self) -> int | None:
        """Moves to success; the most that there may be for any other ending."""
        if self.outcome is None or self.steps is None:
            return None
        return self.steps if self.succeeded else int(self.config.limit)

    def forfeited(self) -> Trial:
        """The episode as it counts if it is spoilt: given up at its last move.

        So spoiling an episode is worth what leaving it is.
        """
        if self.outcome is None or self.total is None or self.score is None:
            return self
        score = self.environment.given_up_score(self, self.outcome, self.total, self.score)
        return replace(self, outcome="abandoned", score=score)

    def as_left(self) -> Trial:
        """The episode as it counts if it is not spoilt: leaving costs what spoiling does."""
        left = self.outcome in LEFT
        return replace(self.forfeited(), outcome=self.outcome) if left else self

    def record(self, steps: Sequence[MoveRow]) -> Record:
        """The cause of a finished episode, ready to be replayed.

        Args:
            steps: Its moves in order.

        Raises:
            ValueError: If it has not ended, or is not one that can be replayed.
        """
        if (
            self.outcome is None
            or self.total is None
            or self.score is None
            or self.steps is None
            or self.discovered is None
            or self.trajectory_hash is None
        ):
            raise ValueError(f"the episode {self.id} has not come to its end")
        ending: Ending = {
            "outcome": self.outcome,
            "total": self.total,
            "score": self.score,
            "steps": self.steps,
            "discovered": self.discovered,
            "trajectory_hash": self.trajectory_hash,
            "core_version": self.core_version,
        }
        return self.environment.record(self, bytes(step["action"] for step in steps), ending)


_FIELDS = {column.name for column in fields(Trial)}
_COLUMNS = TABLES["episodes"].names()


@lru_cache(maxsize=256)
def parse_config(task: str, text: str) -> Configuration:
    """The configuration that a column holds as JSON.

    Raises:
        ValueError, TypeError: If it is none of the task's.
    """
    return environment_of(task).configuration(json.loads(text))
