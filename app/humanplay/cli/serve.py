"""The commands `humanplay serve` and `play`: page, API and 3-D view on one port."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import ClickException, UsageError, argument, option

from humanplay.cli.settings import settings_of, task_name
from humanplay.command.extras import EXTRAS
from humanplay.command.options import PATH, PORT, check_more, flag, path_option, several
from humanplay.task.registration import DEFAULT_TASK, environment_of, registration_of

if TYPE_CHECKING:
    from humanplay.web.settings import Settings


@contextmanager
def _without_collecting() -> Iterator[None]:
    """Look for no garbage during a start.

    Nearly all that it makes stays, and the search takes a tenth of it. The server looks again once
    it answers (`AnnouncingServer`).
    """
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@click.command(short_help="Play and watch in a browser; record every move.")
@option("--host", help="Address to listen on; 0.0.0.0 lets others in.  [default: 127.0.0.1]")
@option("--port", type=PORT, help="Port to listen on; 0 takes a free one.  [default: 8000]")
@path_option(
    "--database",
    "SQLite file to record in; made if absent.  [default: data/playground.db in a checkout, else ./playground.db]",
)
@several(
    "--env",
    "envs",
    "Play another environment: Gymnasium's id, your MODULE:CLASS or FILE.py, a TOML file, or a world's folder; repeatable.  "
    "[default: MarsExplorer]",
    metavar="ENV",
)
@several(
    "--policy",
    "policies",
    "A trained policy's file to offer; with --env also a function, MODULE:NAME. Repeatable.",
    type=PATH,
)
@flag(
    "--paper",
    "In a checkout: offer the agents of the paper's four algorithms too; ppo-paper had 240,000 of its 9,000,000 moves.",
)
@several("--map", "maps", "A map_server file (YAML) to play on; repeatable.", type=PATH)
@option(
    "--cell",
    "cell_m",
    type=float,
    help="Side of a map's cells in metres.  [default: the largest that fit]",
)
@option("--public-url", metavar="URL", help="Where browsers find the pages: https://mars.example.")
@several(
    "--trusted-proxy",
    "trusted_proxies",
    "A proxy whose X-Forwarded headers count, or a network of proxies; repeatable.",
    metavar="ADDRESS",
)
@flag("--durable", "Survive a power cut; costs milliseconds.", default=None)
@flag("--accept-loss", "Start although commits are missing, or may be.", default=None)
@option("--backup-every", type=float, metavar="MINUTES", help="Make a verified backup this often.")
@path_option("--backup-to", "Keep them there.  [default: backups beside it]", metavar="DIR")
@flag(
    "--admin",
    "Open the operator's page /admin; prints a password if HUMANPLAY_ADMIN_PASSWORD is not set.",
    default=None,
)
@option(
    "--metrics-port",
    type=PORT,
    help="Serve metrics to Prometheus on this port too; 0: a free one.",
)
@option("--metrics-host", help="Address for metrics.  [default: 127.0.0.1, this machine alone]")
@option("--log-format", type=click.Choice(["text", "json"]), help="json: requests too, one a line.")
@argument("more", type=PATH, nargs=-1, metavar="")
@_without_collecting()
def serve(
    more: tuple[Path, ...],
    envs: tuple[str, ...],
    policies: tuple[Path, ...],
    maps: tuple[Path, ...],
    trusted_proxies: tuple[str, ...],
    **options: Any,
) -> None:
    """Serve the playground until Ctrl-C: page, API and 3-D view on one port.

    Every move is in the database before its frame is sent: killing the server loses nothing, and the next start
    goes on with the unfinished episodes. Without --database it is data/playground.db in a checkout,
    ./playground.db elsewhere. HUMANPLAY_HOST, HUMANPLAY_PORT, HUMANPLAY_DATABASE and HUMANPLAY_DURABLE stand in for absent
    flags. A study of this database is offered at /study/NAME as soon as it is frozen.

    A ranked episode that nobody moves for 30 minutes counts as abandoned; HUMANPLAY_ABANDON_AFTER_S holds other seconds.

    --env serves a Gymnasium environment instead of MarsExplorer: with discrete actions, turn by turn, shown as its own
    picture. A package's is written MODULE:ID; docs/environments.md describes the file. Given
    again, the first is at /, each further one at /play/NAME with a
    database of its own beside the first one's, and /play lists them; --env mars is MarsExplorer. --policy and --map are the
    first one's.

    --map offers an occupancy map as robots use them (YAML of map_server) in the dialog of the terrains, under its file's
    name. What can be seen from where the rover can go counts there. Episodes keep their map: they replay without the file.

    The server answers for IP addresses, localhost, the names of this machine and the host of --public-url. Behind a proxy,
    --trusted-proxy names it, so that visitors are told apart; what others put into X-Forwarded headers is ignored.

    The operator's page /admin is open with --admin, and when HUMANPLAY_ADMIN_PASSWORD holds its password; else there is none.

    With --metrics-port, Prometheus finds counts, latencies and the state of the disk at /metrics of that port, which is not
    the port of the page. --log-format json logs each request with an id that its answer carries in X-Request-ID. Neither
    names a player, a session, a participant or a token.

    \b
    Examples:
      humanplay serve
      humanplay serve --admin
      humanplay serve --port 9000 --database lab.db
      humanplay serve --public-url https://mars.example --trusted-proxy 127.0.0.1
      humanplay serve --host 0.0.0.0 --policy mine.onnx
      humanplay serve --paper                          ppo-works, a2c-works, rainbow-works, sac-works, ppo-paper too
      humanplay serve --env FrozenLake-v1 --database lake.db
      humanplay serve --env mars --env FrozenLake-v1 --env ale_py:ALE/Breakout-v5
      humanplay serve --map office.yaml --map garage.yaml
    """
    check_more(more, policies)
    of_the_paper = _policies_of_the_paper() if options.pop("paper") else ()
    flags = {name: chosen for name, chosen in options.items() if chosen is not None}
    if envs:
        flags["task"], *flags["more"] = map(task_name, envs)
    if trusted_proxies:
        flags["trusted_proxies"] = trusted_proxies
    if maps:
        flags["maps"] = maps
    if policies or more or of_the_paper:
        flags["policies"] = (*policies, *more, *of_the_paper)
    settings = settings_of(**flags)
    _run(settings)


@click.command(short_help="Play an environment on this machine, in its browser.")
@argument("env", default=DEFAULT_TASK)
@option("--port", type=PORT, default=0, show_default="a free one", help="Port to listen on.")
@path_option("--database", "SQLite file to record in; made when absent.  [default: as for serve]")
@flag("--no-browser", "Print the address and open nothing.")
@_without_collecting()
def play(env: str, port: int, database: Path | None, no_browser: bool) -> None:
    """Play ENV in a browser; without one it is MarsExplorer.

    ENV is an id of Gymnasium's, a package's MODULE:ID, your own MODULE:CLASS or FILE.py in this folder, or a TOML file.
    Every move is recorded, and the page goes on where it stood. `humanplay serve --env ENV` lets others play too;
    `humanplay doctor ENV` says what its keys are and whether its episodes can be verified.

    \b
    Examples:
      humanplay play
      humanplay play FrozenLake-v1
      humanplay play minigrid:MiniGrid-FourRooms-v0
      humanplay play myenv.py
      humanplay play rooms.toml --database rooms.db
    """
    from humanplay.cli.pilot.links import open_browser

    place = {} if database is None else {"database": database}
    settings = settings_of(task=task_name(env), port=port, confined=False, **place)
    _run(settings, *([] if no_browser else [open_browser]))


def _run(settings: Settings, *opened: Callable[[str], object]) -> None:
    from humanplay.db.store import StoreError
    from humanplay.web.server import ServerError, run

    for task in (settings.task, *settings.more):
        _check_extras(task)
    try:
        run(settings, *opened)
    except (ServerError, StoreError) as error:
        raise ClickException(str(error)) from error


def _policies_of_the_paper() -> Iterable[Path]:
    """The files of the paper's agents; UsageError if they are not here."""
    if not (files := environment_of(DEFAULT_TASK).policies.unlisted()):
        raise UsageError(
            "the agents of the paper are not installed: they are files of the repository, in data/policies/paper. "
            "Run `humanplay serve --paper` in a checkout, or give a copy of a file with --policy"
        )
    return files.values()


def _check_extras(task: str) -> None:
    """Raise UsageError if what plays a task is not installed."""
    extras = registration_of(task).extras
    if not all(find_spec(module) for extra in extras for module in EXTRAS[extra]):
        extra = extras[-1]
        raise UsageError(
            f"the environment {task} needs the extra [{extra}]: pip install 'humanplay[{extra}]'. "
            "One of Gymnasium works now: humanplay serve --env FrozenLake-v1"
        )
