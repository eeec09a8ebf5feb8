"""All synthetic players of a study at once, in one event loop, and the state file from which they come back as themselves."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.simulate.client import ConnectionLostError, Page, detail_of
from app.simulate.outcome_log import OutcomeLog
from app.simulate.participant import PlaySettings, SavedPlayer, SimulatedParticipant, StudyOverError
from app.simulate.persona import draw_persona
from app.simulate.population import POPULATIONS
from marsexplorer.files import write_whole

STATE_FORMAT = "marsexplorer-simulate-1"
JOIN_EVERY_MS = 500.0
"""The time between two players' joining, compressed like all times."""

Progress = Callable[[int, int], None]


class StudyNotReadyError(Exception):
    """The study cannot be played: no server, no such study, or a closed one; one sentence."""


@dataclass(frozen=True)
class SimulationConfig:
    """What is simulated, and how.

    kinds        of each player, in order
    population   a name in POPULATIONS
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


async def fetch_study(url: str, name: str) -> dict[str, Any]:
    """Fetch what the server says of the study; StudyNotReadyError when it cannot be played."""
    try:
        page = Page(url, name)
    except ValueError as error:
        raise StudyNotReadyError(f"--url must be like http://127.0.0.1:8000, got {url!r}") from error
    try:
        answer = await page.ask("GET", f"api/studies/{name}")
        if answer.is_error:
            raise StudyNotReadyError(f"the server at {url} declined: {detail_of(answer)}")
        found: dict[str, Any] = answer.json()
        if found["status"] == "closed":
            raise StudyNotReadyError(f"the study {name!r} is closed: nobody can take part any more")
    except ConnectionLostError as error:
        raise StudyNotReadyError(
            f"no server at {url} ({error}): start one with `marsexplorer serve`, or say where with --url"
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise StudyNotReadyError(
            f"what answers at {url} is no MarsExplorer Playground: expected a study, got something else"
        ) from error
    finally:
        await page.close()
    return found


async def simulate(config: SimulationConfig, log: OutcomeLog, progress: Progress = lambda done, total: None) -> None:
    """Simulate a study until every player is done, and keep `log` up to date; StudyNotReadyError or StudyOverError otherwise.

    progress  called with (episodes ended, episodes in all)
    """
    study = await fetch_study(config.url, config.study)
    saved = SavedPlayers.read(config)
    try:
        saved.write()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise StudyNotReadyError(f"cannot write {config.state}: {why}; name another file with --state") from error
    settings = PlaySettings(config.url, config.study, study["config"]["sensor_radius"], config.speed, config.patience_s)
    people: list[SimulatedParticipant] = []
    for number, kind in enumerate(config.kinds):
        who = draw_persona(number, kind, POPULATIONS[config.population], config.seed)
        people.append(SimulatedParticipant(who, settings, saved.of(number), log, people))
    watch = asyncio.create_task(_report_progress(people, study, log, saved, progress))
    try:
        async with asyncio.TaskGroup() as group:
            for number, each in enumerate(people):
                group.create_task(_join_and_play(each, JOIN_EVERY_MS * number / 1000 / config.speed))
    except ExceptionGroup as errors:
        over = errors.subgroup(StudyOverError)
        raise first_exception(over or errors) from None
    finally:
        watch.cancel()
        saved.write()
    progress(1, 1)


def first_exception(group: ExceptionGroup[Exception]) -> Exception:
    """Return the first exception in a group, whatever it is nested in."""
    first = group.exceptions[0]
    return first_exception(first) if isinstance(first, ExceptionGroup) else first


async def _join_and_play(player: SimulatedParticipant, wait_s: float) -> None:
    await asyncio.sleep(wait_s)
    await player.play()


async def _report_progress(
    people: list[SimulatedParticipant], study: dict[str, Any], log: OutcomeLog, saved: SavedPlayers, progress: Progress
) -> None:
    """Report progress and save the players, for ever."""
    each = 1 + int(study["warm_up"]) + int(study["ranked"])
    while True:
        done = sum(each if player.outcome.is_done else player.episodes_done for player in people)
        progress(done, each * len(people))
        saved.write()
        await asyncio.sleep(0.3)


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
        fresh = [SavedPlayer(outside_ids={"PROLIFIC_PID": f"simulated-{run}-{number}"}) for number in range(len(config.kinds))]
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
        text = json.dumps({**self._identity(self._config), "seats": [asdict(player) for player in self._players]}, indent=1)
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
