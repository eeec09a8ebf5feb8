"""All synthetic players of a study at once, in one event loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from app.simulate.client import ConnectionLostError, Page, detail_of
from app.simulate.outcome_log import OutcomeLog
from app.simulate.participant import PlaySettings, SimulatedParticipant, StudyOverError
from app.simulate.persona import draw_persona
from app.simulate.population import SIMULATED_POPULATIONS
from app.simulate.state_file import SavedPlayers, SimulationConfig, StudyNotReadyError

JOIN_EVERY_MS = 500.0
"""The time between two players' joining, compressed like all times."""

Progress = Callable[[int, int], None]


async def fetch_study(url: str, name: str) -> dict[str, Any]:
    """Fetch what the server says of the study; StudyNotReadyError when it cannot be played."""
    try:
        page = Page(url, name)
    except ValueError as error:
        raise StudyNotReadyError(
            f"--url must be like http://127.0.0.1:8000, got {url!r}"
        ) from error
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


async def simulate(
    config: SimulationConfig, log: OutcomeLog, progress: Progress = lambda done, total: None
) -> None:
    """Simulate a study until every player is done, and keep `log` up to date; StudyNotReadyError or StudyOverError otherwise.

    progress  called with (episodes ended, episodes in all)
    """
    study = await fetch_study(config.url, config.study)
    saved = SavedPlayers.read(config)
    try:
        saved.write()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise StudyNotReadyError(
            f"cannot write {config.state}: {why}; name another file with --state"
        ) from error
    settings = PlaySettings(
        config.url, config.study, study["config"]["sensor_radius"], config.speed, config.patience_s
    )
    people: list[SimulatedParticipant] = []
    for number, kind in enumerate(config.kinds):
        who = draw_persona(number, kind, SIMULATED_POPULATIONS[config.population], config.seed)
        people.append(SimulatedParticipant(who, settings, saved.of(number), log, people))
    watch = asyncio.create_task(_report_progress(people, study, log, saved, progress))
    try:
        async with asyncio.TaskGroup() as group:
            for number, each in enumerate(people):
                group.create_task(
                    _join_and_play(each, JOIN_EVERY_MS * number / 1000 / config.speed)
                )
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
    people: list[SimulatedParticipant],
    study: dict[str, Any],
    log: OutcomeLog,
    saved: SavedPlayers,
    progress: Progress,
) -> None:
    """Report progress and save the players, for ever."""
    each = 1 + int(study["warm_up"]) + int(study["ranked"])
    while True:
        done = sum(each if player.outcome.is_done else player.episodes_done for player in people)
        progress(done, each * len(people))
        saved.write()
        await asyncio.sleep(0.3)
