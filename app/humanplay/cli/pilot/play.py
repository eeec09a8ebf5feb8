"""`play`: from an environment to a link."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import gymnasium

from humanplay.cli.pilot.environments import task_of
from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.in_place import Stepper, in_place_task
from humanplay.cli.pilot.links import (
    LOCAL_HOST,
    check_place,
    in_notebook,
    is_in_hub,
    shared_address,
    show,
)
from humanplay.cli.pilot.plays import Plays
from humanplay.cli.pilot.recreation import COMPARED, Env, NotRecreatedError
from humanplay.cli.pilot.running import Request, RunningServer
from humanplay.jobs import held

MOST_PEOPLE = 1000
_open: list[Plays] = []


def play(
    env: object,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    people: int = 0,
    wait: bool | None = None,
    database: str | Path = "plays.db",
    public_url: str | None = None,
    browser: bool = True,
    keep_mb: int = 500,
) -> Plays:
    """Let people play an environment in a browser, and record what they play.

    Calling it again closes the page of the call before; plays are added to the same file.

    Args:
        env: An id of Gymnasium's, a class or function that makes an environment, a file, or an environment that
            `gymnasium.make` made, in wrappers of yours: it is recreated with a picture if both agree on twenty steps.
            Else this program steps it itself, on one board, until the page is closed.
        host: Where to listen; "0.0.0.0" lets other machines in.
        port: Where to listen; 0 takes a free one.
        people: So many people get a link each. Without it, whoever comes is asked for a name.
        wait: Whether to return only after Ctrl-C; by default in a program, not in a notebook.
        database: The file that is played in.
        public_url: Where browsers find the page, behind a proxy.
        browser: Whether a new tab is opened.
        keep_mb: Megabytes that pictures and observations may take beside the database, of an environment that
            this program steps itself: nothing else can show these plays again, and nothing verifies them.

    Raises:
        PilotError: It cannot be played; the text says why, and the way out.
    """
    check_place()
    if not 0 <= people <= MOST_PEOPLE:
        raise PilotError(f"expected at most {MOST_PEOPLE:,} people, got {people}")
    stepped: Env | None = None
    try:
        task = task_of(env)
    except NotRecreatedError as error:
        stepped = error.env
        task = _task_in_place(error, people, wait)
        print(f"{error.reason}. So this program steps it itself, on one board.", flush=True)
    if stepped is None and isinstance(env, gymnasium.Env):
        print(
            f"Recreated with a picture: it agrees with the one you hold on {COMPARED} steps.",
            flush=True,
        )
    while _open:
        _open.pop().close()
    path = Path(database).resolve()
    settings: dict[str, object] = {
        "task": task, "host": host, "port": port, "database": str(path), "confined": False, "asks_name": True,
        # a hub does not tell its name; this machine alone reaches the page, and the hub's proxy
        "any_host": host == LOCAL_HOST and public_url is None and is_in_hub(),
    }  # fmt: skip
    if public_url is not None:
        settings["public_url"] = public_url
    stepper = None if stepped is None else Stepper(stepped, task, path, keep_mb << 20)
    request: Request = {
        "settings": settings,
        "held": held.payloads(),
        "people": people,
        "board": None,
    }
    server = RunningServer(request, steps=stepper is not None)
    plays = Plays(path, task, server, (public_url or shared_address(server.address)).rstrip("/"))
    _open.append(plays)
    show(server.address, plays.links, browser, public_url)
    waits = (not in_notebook()) if wait is None else wait
    if stepper is not None or waits:
        end = "Interrupting the kernel" if in_notebook() else "Ctrl-C"
        print(f"Every move is recorded in {path}. {end} closes the page.", flush=True)
    if stepper is not None:
        with suppress(KeyboardInterrupt):
            stepper.serve(server.boards)
        plays.close()
    elif waits:
        plays.wait()
    return plays


def _task_in_place(error: NotRecreatedError, people: int, wait: bool | None) -> str:
    """The task of an environment that this program steps; PilotError if it cannot."""
    if people or wait is False:
        raise PilotError(
            f"{error.reason}. This program would step it itself: one board, while the call lasts. "
            f"Leave `people` and `wait` out, or write {error.line}"
        )
    try:
        return in_place_task(error.env)
    except Exception as reason:  # whatever the environment raises
        raise PilotError(
            f"{error.reason}; and in place it cannot be played: {reason}; {error.line}"
        ) from reason
