"""All synthetic players of a study at once, in one event loop; and the file from which they come back as themselves."""

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
from app.simulate.outcome_log import Tally
from app.simulate.participant import Participant, Place, Seat, StudyOverError
from app.simulate.persona import persona
from app.simulate.population import POPULATIONS
from marsexplorer.files import write_whole

FORMAT = "marsexplorer-simulate-1"
JOIN_EVERY_MS = 500.0
"""Between two players' joining, compressed as everything else."""

Progress = Callable[[int, int], None]


class StudyNotReadyError(Exception):
    """The study cannot be played: no server, no such study, or a closed one; one sentence."""


@dataclass(frozen=True)
class Plan:
    """A simulated study.

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


async def check(url: str, name: str) -> dict[str, Any]:
    """Return what the server says of the study; StudyNotReadyError when it cannot be played."""
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


async def simulate(plan: Plan, tally: Tally, progress: Progress = lambda done, total: None) -> None:
    """Return when every player is done, `tally` up to date all the time; StudyNotReadyError or StudyOverError otherwise.

    progress  called with (episodes ended, episodes in all)
    """
    study = await check(plan.url, plan.study)
    seats = Seats.read(plan)
    try:
        seats.write()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise StudyNotReadyError(f"cannot write {plan.state}: {why}; name another file with --state") from error
    place = Place(plan.url, plan.study, study["config"]["sensor_radius"], plan.speed, plan.patience_s)
    people: list[Participant] = []
    for number, kind in enumerate(plan.kinds):
        who = persona(number, kind, POPULATIONS[plan.population], plan.seed)
        people.append(Participant(who, place, seats.of(number), tally, people))
    watch = asyncio.create_task(_watch(people, study, tally, seats, progress))
    try:
        async with asyncio.TaskGroup() as group:
            for number, each in enumerate(people):
                group.create_task(_arrive(each, JOIN_EVERY_MS * number / 1000 / plan.speed))
    except ExceptionGroup as errors:
        over = errors.subgroup(StudyOverError)
        raise first_of(over or errors) from None
    finally:
        watch.cancel()
        seats.write()
    progress(1, 1)


def first_of(group: ExceptionGroup[Exception]) -> Exception:
    """Return the first exception in a group, whatever it is nested in."""
    first = group.exceptions[0]
    return first_of(first) if isinstance(first, ExceptionGroup) else first


async def _arrive(player: Participant, wait_s: float) -> None:
    await asyncio.sleep(wait_s)
    await player.play()


async def _watch(people: list[Participant], study: dict[str, Any], tally: Tally, seats: Seats, progress: Progress) -> None:
    """Move the bar and keep the seats, for ever."""
    each = 1 + int(study["warm_up"]) + int(study["ranked"])
    while True:
        done = sum(each if player.line.is_done else player.progress for player in people)
        progress(done, each * len(people))
        seats.write()
        await asyncio.sleep(0.3)


class Seats:
    """The players' seats and the file that keeps them (readable by its owner alone: cookies are keys)."""

    def __init__(self, plan: Plan, seats: list[Seat]) -> None:
        self._plan, self._seats = plan, seats
        self._written = ""

    @classmethod
    def read(cls, plan: Plan) -> Seats:
        """Return the seats of a plan, from its file if that is there; StudyNotReadyError when it belongs to another plan."""
        run = secrets.token_hex(4)
        fresh = [Seat(outside_ids={"PROLIFIC_PID": f"simulated-{run}-{number}"}) for number in range(len(plan.kinds))]
        if plan.state is None or not plan.state.exists():
            return cls(plan, fresh)
        try:
            kept = json.loads(plan.state.read_text())
            told = {name: kept[name] for name in cls._head(plan)}
            seats = [Seat(**seat) for seat in kept["seats"]]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StudyNotReadyError(
                f"{plan.state} is no state of a simulation ({error}); name another file with --state"
            ) from error
        for name, value in cls._head(plan).items():
            if told[name] != value:
                raise StudyNotReadyError(
                    f"{plan.state} belongs to a simulation with {name} {told[name]!r}, not {value!r}; "
                    "give the same options as then, or another file with --state"
                )
        return cls(plan, seats)

    def of(self, number: int) -> Seat:
        """Return a player's seat."""
        return self._seats[number]

    def write(self) -> None:
        """Return with the file up to date, whole."""
        text = json.dumps({**self._head(self._plan), "seats": [asdict(seat) for seat in self._seats]}, indent=1)
        if self._plan.state is None or text == self._written:
            return
        with write_whole(self._plan.state) as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(text.encode())
        self._written = text

    @staticmethod
    def _head(plan: Plan) -> dict[str, Any]:
        """Return what a state file and a plan must agree on."""
        return {
            "format": FORMAT, "study": plan.study, "kinds": list(plan.kinds), "population": plan.population, "seed": plan.seed,
        }  # fmt: skip
