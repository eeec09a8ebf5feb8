"""The configuration of a simulation, and the state file from which its players come back as themselves."""

from __future__ import annotations

import json
import os
import secrets
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from marsexplorer.files import write_whole

STATE_FORMAT = "marsexplorer-simulate-1"


class StudyNotReadyError(Exception):
    """The study cannot be played: no server, no such study, or a closed one; one sentence."""


@dataclass(frozen=True)
class SimulationConfig:
    """What is simulated, and how.

    kinds        of each player, in order
    population   a name in SIMULATED_POPULATIONS
    speed        how many times faster than people
    patience_s   how long to wait for a server that has gone away
    state        where the players' cookies are kept, so that a stopped command can go on; None: nowhere
    """

    url: str
    study: str
    kinds: tuple[str, ...]
    population: str = "mixed"
    seed: int = 0
    speed: float = 20.0
    patience_s: float = 60.0
    state: Path | None = None


@dataclass
class SavedPlayer:
    """What a player needs to come back as itself; the names of the fields are keys of the state file.

    has_left  whether the player has left for ever
    """

    cookie: str | None = None
    outside_ids: dict[str, str] | None = None
    has_left: bool = False


class SavedPlayers:
    """The saved players and their state file, which only its owner can read because it holds cookies.

    The keys of the file, `seats` among them, are those of the first version and stay.
    """

    def __init__(self, config: SimulationConfig, players: list[SavedPlayer]) -> None:
        self._config, self._players = config, players
        self._written = ""

    @classmethod
    def read(cls, config: SimulationConfig) -> SavedPlayers:
        """Return the players of the state file, or new ones; StudyNotReadyError when the file belongs to another simulation."""
        run = secrets.token_hex(4)
        fresh = [
            SavedPlayer(outside_ids={"PROLIFIC_PID": f"simulated-{run}-{number}"})
            for number in range(len(config.kinds))
        ]
        if config.state is None or not config.state.exists():
            return cls(config, fresh)
        try:
            kept = json.loads(config.state.read_text())
            found = {name: kept[name] for name in cls._identity(config)}
            players = [SavedPlayer(**player) for player in kept["seats"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StudyNotReadyError(
                f"{config.state} is no state of a simulation ({error}); name another file with --state"
            ) from error
        for name, value in cls._identity(config).items():
            if found[name] != value:
                raise StudyNotReadyError(
                    f"{config.state} belongs to a simulation with {name} {found[name]!r}, not {value!r}; "
                    "give the same options as then, or another file with --state"
                )
        return cls(config, players)

    def of(self, number: int) -> SavedPlayer:
        """Return what is saved of a player."""
        return self._players[number]

    def write(self) -> None:
        """Write the file whole, if anything has changed."""
        text = json.dumps(
            {**self._identity(self._config), "seats": [asdict(player) for player in self._players]},
            indent=1,
        )
        if self._config.state is None or text == self._written:
            return
        with write_whole(self._config.state) as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(text.encode())
        self._written = text

    @staticmethod
    def _identity(config: SimulationConfig) -> dict[str, Any]:
        """Return what a state file and a configuration must agree on."""
        return {
            "format": STATE_FORMAT, "study": config.study, "kinds": list(config.kinds),
            "population": config.population, "seed": config.seed,
        }  # fmt: skip
