"""The wiring: settings become an app with its services, which `run` serves.

Nothing here is global: each app has a store, a lobby and a viewer of its own, alive for its
lifespan.
"""

from __future__ import annotations

import asyncio
import logging
import re
import signal
import sys
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import (
    AsyncExitStack,
    ExitStack,
    aclosing,
    asynccontextmanager,
    closing,
    contextmanager,
)
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from anyio.to_thread import current_default_thread_limiter
from fastapi import FastAPI
from starlette.types import Receive, Scope, Send

from humanplay import STATIC
from humanplay.agents import wiring as agents
from humanplay.board.lobby import Lobby
from humanplay.board.messages import MAX_MESSAGE_BYTES
from humanplay.board.ranked import PageBoards
from humanplay.board.sources import PlayerTokens, Sources
from humanplay.board.spectators import Replayer, Spectators
from humanplay.db.backup import Backups
from humanplay.db.checks import quick_check
from humanplay.db.columns import check_words
from humanplay.db.database import StoreError, damaged
from humanplay.db.metrics import Metrics
from humanplay.db.mounts import NETWORK, network_file_system
from humanplay.db.series import StudyStore
from humanplay.db.store import Store
from humanplay.jobs import Jobs
from humanplay.results.daily import DailyBoards
from humanplay.results.daily_table import DailyPolicies
from humanplay.results.leaderboard import Leaderboard
from humanplay.results.people import PeopleBoard
from humanplay.study.debrief import Debriefs
from humanplay.study.folder import Folder
from humanplay.study.participation import Participations
from humanplay.study.progress import ParticipantProgress
from humanplay.task import Environment, Policies, Task
from humanplay.task.registration import Start, environment_of, serve, static_of
from humanplay.web import (
    access,
    admin,
    api,
    api_docs,
    daily,
    files,
    pages,
    people,
    puzzles,
    replay,
    results,
    sockets,
    study,
    viewer,
    watch,
)
from humanplay.web.answers.openapi import PlaygroundApp
from humanplay.web.downloads import Downloads
from humanplay.web.errors import add_error_handlers, answer
from humanplay.web.listening import (
    AnnouncingServer,
    ServerError,
    address_of,
    bound_connections,
    inherited_socket,
    listen,
    raise_file_limit,
    uvicorn_config,
)
from humanplay.web.logs import log_config
from humanplay.web.operator.health import Health
from humanplay.web.operator.login import AdminPassword
from humanplay.web.operator.services import AdminServices
from humanplay.web.protection import (
    OWNERS,
    BudgetedCharges,
    Gate,
    LimitedClients,
    Protection,
    Proxies,
    own_names,
)
from humanplay.web.replays.service import Replays
from humanplay.web.requests import HeadRequests, NotedRoute, ObservedRequests
from humanplay.web.services import Services
from humanplay.web.settings import Settings
from humanplay.web.templates import names_of

__all__ = ["ServerError", "create_app", "run"]

_log = logging.getLogger(__name__)

WORKERS = 3
"""Processes for what takes long, at most: one owner has one of them."""
MOST_WAITING_JOBS = 2
"""Jobs of one owner that wait, at most."""


READERS = 1
"""Threads for lists and volunteers' figures: each keeps the event loop, hence moves, waiting for
its turn.

FastAPI takes them for everything of a request that is no coroutine, so nothing else may be a plain
function.
"""


@dataclass(frozen=True)
class AppParts:
    """What exists before the app starts; what is None is made then, from the settings.

    A store that is given stays open when the app has ended: whoever opened it closes it. Several
    apps behind one address share what limits their clients, and the jobs, which end with the first
    of them.
    """

    sources: Sources | None = None
    policies: Policies | None = None
    task: Task | None = None
    store: Store | None = None
    protection: Protection | None = None
    jobs: Jobs | None = None


def create_app(settings: Settings, prepared: AppParts | None = None) -> FastAPI:
    """The app: pages, API, sockets and 3-D view on one database.

    Raises:
        ValueError: If the admin password is too short.
    """
    return _app_of(settings, prepared or AppParts(), AdminPassword.of(settings))


def _app_of(
    settings: Settings, prepared: AppParts, password: AdminPassword | None, name: str = ""
) -> FastAPI:
    metrics = Metrics() if prepared.store is None else prepared.store.metrics
    protection = prepared.protection or _protection(settings, metrics)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        task = prepared.task
        if task is None:
            task = await asyncio.to_thread(_task, settings, prepared.policies)
        with _opened(settings, prepared.store, metrics) as store:
            sources, charges = prepared.sources or Sources(), protection.charges
            jobs = prepared.jobs or _jobs()
            opening = _services(settings, store, task, sources, charges, jobs, password)
            async with _threads_of(store), aclosing(opening) as services:
                app.state.services = services
                await agents.start(app, services)
                lobby, page_boards = services.lobby, services.page_boards
                running = [lobby.sweep(), page_boards.sweep(), metrics.measure_lag()]
                running += [services.progress.watch_commands()]
                if (backups := _backups(settings, store)) is not None:
                    running.append(backups.run())
                running.append(asyncio.to_thread(services.health.check))
                sweepers = [asyncio.create_task(work, name="sweep") for work in running]
                for sweeper in sweepers:
                    sweeper.add_done_callback(_log_failure)
                current_default_thread_limiter().total_tokens = READERS
                try:
                    yield
                finally:
                    for sweeper in sweepers:
                        sweeper.cancel()

    environment = environment_of(settings.task)
    app = PlaygroundApp(
        environment.messages,
        title="MarsExplorer Playground", version=environment.version,
        description=api_docs.DESCRIPTION.format(environment.about.title),
        lifespan=lifespan, docs_url=None, redoc_url=None,
    )  # fmt: skip
    _add_protection(app, settings, metrics, protection, name)
    played = pages.PlayedTask(environment, Folder.beside(settings.database))
    app.state.offers = {offer_name(environment): played}
    add_error_handlers(app)
    drawn_by = static_of(settings.task)
    folders = {} if drawn_by is None else {f"task/{environment.assets}/": drawn_by}
    app.state.public_url = settings.public_url
    app.state.offered = pages.offered(environment)
    app.state.names = names_of(settings.task)
    app.state.files = files.PageFiles({"": STATIC, **folders})
    boards = api.board_router(environment.messages)
    # first what is asked for most: routes are tried in turn
    modules = [files, pages, sockets, api, watch, results, people, replay, daily, puzzles, study]
    modules += [viewer]
    further = (results.mine, results.leaderboard, daily.page_router, api.probes)
    for router in (boards, *(module.router for module in modules), *further):
        # as they are: `include_router` would build each again for this app
        app.router.routes.extend(router.routes)
    agents.add_routes(app)
    if password is not None:
        app.router.routes.extend([*admin.router.routes, *pages.admin_router.routes])
    return app


def _log_failure(sweeper: asyncio.Task[None]) -> None:
    """Log the error that has ended something beside play.

    Nobody else waits for it.
    """
    if not sweeper.cancelled() and (error := sweeper.exception()) is not None:
        _log.error(
            "a task beside play has failed, and begins again when the server is started again",
            exc_info=error,
        )


def _add_protection(
    app: FastAPI, settings: Settings, metrics: Metrics, protection: Protection, name: str
) -> None:
    """Put the middleware around the app.

    What is added last sees a request first. The app's cookies end with its name.
    """
    app.state.protection, app.state.cookies = protection, f"_{name}" if name else ""
    app.state.framed_by = settings.framed_by
    metrics.add_gauge("sockets", "Sockets that are open.", lambda: protection.sockets)
    for kind in OWNERS:
        metrics.add_gauge(
            f"stored_bytes_{kind}",
            f"Bytes stored today (UTC) or charged to open boards, of the {kind} with the most.",
            partial(protection.charges.most, kind),
        )
    app.add_middleware(NotedRoute)
    app.add_middleware(HeadRequests)
    app.add_middleware(LimitedClients, protection=protection, most_bytes=MAX_MESSAGE_BYTES)
    app.add_middleware(
        Gate,
        names=None if settings.any_host else own_names(settings.public_url, settings.host),
        proxies=Proxies(settings.trusted_proxies, settings.public_url),
        public_url=settings.public_url,
        cookies=tuple(
            cookie.name + app.state.cookies
            for cookie in (access.PLAYER, access.PARTICIPANT, access.ADMIN)
        ),
        answer=answer,
    )
    app.add_middleware(ObservedRequests, metrics=metrics)  # it counts what the others refuse


@contextmanager
def _opened(settings: Settings, store: Store | None, metrics: Metrics) -> Iterator[Store]:
    """Yield a store, or one of the settings' database that is open for this long.

    Args:
        store: Of whoever opened it, who closes it too; None opens one.
    """
    if store is not None:
        yield store
        return
    with closing(
        Store(settings.database, settings.durable, metrics, settings.accept_loss)
    ) as opened:
        yield opened


@asynccontextmanager
async def _threads_of(store: Store) -> AsyncIterator[None]:
    """Let threads write and read the database during the block.

    After it everything that was asked for is written.
    """
    store.start_threads()
    try:
        yield
    finally:
        await asyncio.to_thread(store.stop_threads)


def _services(
    settings: Settings,
    store: Store,
    task: Task,
    sources: Sources,
    charges: BudgetedCharges,
    jobs: Jobs,
    password: AdminPassword | None,
) -> Services:
    """The services of an app; call it on the running loop."""
    offers = () if task.boards is None else task.policies.offers()
    folder, study_store = Folder.beside(store.path), StudyStore(store)
    of_session = Participations(folder, study_store, sources).of_session
    limits = settings.limits
    lobby = Lobby(store, task, sources, settings.idle_s, of_session, limits.decision_s, charges)
    progress, health = ParticipantProgress(lobby, folder, study_store), Health(store.path)
    downloads, replayer = Downloads(store.path, jobs), Replayer()
    _add_gauges(store.metrics, lobby, health)
    store.metrics.add_gauge(
        "waiting_jobs", "Jobs that wait: ghosts, costs, exports, policies' episodes.", jobs.waiting
    )
    return Services(
        store=store,
        jobs=jobs,
        downloads=downloads,
        lobby=lobby,
        page_boards=PageBoards(lobby, settings.abandon_after_s, settings.limits.unplayed_h),
        replayer=replayer,
        spectators=Spectators(lobby, replayer),
        daily_boards=DailyBoards(lobby),
        daily_policies=DailyPolicies(
            store.path.with_name(store.path.name + "-daily.json"), offers, jobs, task.name
        ),
        viewer=task.viewer(),
        player_tokens=PlayerTokens(store.secret()),
        progress=progress,
        debriefs=Debriefs(store, task),
        leaderboard=Leaderboard(store.path, offers, jobs, task.name),
        people=PeopleBoard(store.path, jobs, task.name) if task.boards and task.expert else None,
        replays=Replays(store.path, offers, jobs, task, replayer),
        health=health,
        admin=None
        if password is None
        else AdminServices(password, progress, health, jobs, downloads),
        asks_name=settings.asks_name,
    )


def _protection(settings: Settings, metrics: Metrics) -> Protection:
    return Protection(settings.limits, settings.database, metrics.count_refusal)


def _jobs() -> Jobs:
    return Jobs(WORKERS, per_owner=1, most_waiting=MOST_WAITING_JOBS, nice=19)


class EnvironmentApps:
    """Apps of several environments behind one address.

    The first stands there, and each of the others below /play/NAME.
    """

    def __init__(self, first: FastAPI, others: Mapping[str, FastAPI]) -> None:
        self._first, self._others = first, others
        lifespan = first.router.lifespan_context

        @asynccontextmanager
        async def together(app: FastAPI) -> AsyncIterator[None]:
            async with AsyncExitStack() as stack:
                await stack.enter_async_context(lifespan(app))
                for other in others.values():
                    await stack.enter_async_context(other.router.lifespan_context(other))
                yield

        first.router.lifespan_context = together
        for app in (first, *others.values()):
            app.state.offers = first.state.offers | {
                name: offer
                for other in others.values()
                for name, offer in other.state.offers.items()
            }

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand a request to its app."""
        parts = scope.get("path", "").split("/", 3)  # "", "play", NAME, the rest
        if parts[1:2] == ["play"] and len(parts) == 4 and parts[2] in self._others:
            root = f"{scope.get('root_path', '')}/play/{parts[2]}"
            await self._others[parts[2]]({**scope, "root_path": root}, receive, send)
        else:
            await self._first(scope, receive, send)


def offer_name(environment: Environment) -> str:
    """What an environment is called in addresses: its title in small letters."""
    return re.sub(r"[^a-z0-9.]+", "-", environment.about.title.lower()).strip("-")


def _of_another(settings: Settings, task: str) -> Settings:
    """The settings of a further environment.

    Its database stands beside the first one's.
    """
    name, database = offer_name(environment_of(task)), settings.database
    return settings.model_copy(
        update={
            "task": task, "more": (), "policies": (), "maps": (),
            "database": database.with_name(f"{database.stem}-{name}{database.suffix}"),
            "backup_to": settings.backups / name,
        }
    )  # fmt: skip


def _task(
    settings: Settings,
    policies: Policies | None = None,
    hidden: Sequence[Path] = (),
    compiles_beside: bool = False,
) -> Task:
    """The task that the settings name.

    Raises:
        ValueError: If it, or a file of it, is none.
        LookupError: If there is none of this name.
        OSError: If a file of it cannot be read.
    """
    hides = (settings.database, settings.studies, settings.backups, *hidden)
    start = Start(
        settings.policies,
        settings.maps,
        settings.cell_m,
        hides,
        settings.confined,
        compiles_beside,
        policies,
    )
    return serve(settings.task, start)


def _add_gauges(metrics: Metrics, lobby: Lobby, health: Health) -> None:
    """Let the metrics hold what can be read of the services at any time."""
    metrics.add_gauge("sessions", "Sessions in memory.", lambda: len(lobby))
    metrics.add_gauge(
        "waiting_decisions",
        "Boards of policies that wait for a decision.",
        lambda: lobby.waiting_decisions,
    )
    metrics.add_gauge(
        "waiting_writes", "Writes that wait to be made.", lambda: len(lobby.store.writes)
    )
    metrics.add_gauge("disk_free_bytes", "Free space where the database is.", health.free_bytes)
    metrics.add_gauge(
        "database_bytes", "Size of the database without its log.", health.database_bytes
    )
    metrics.add_gauge("database_log_bytes", "Size of the write-ahead log.", health.log_bytes)


def _backups(settings: Settings, store: Store) -> Backups | None:
    """The backups that the settings ask for; None where they ask for none.

    The metrics hold them in either case.
    """
    backups = None
    if settings.backup_every is not None:
        backups = Backups(store.path, settings.backups, 60 * settings.backup_every)
    store.metrics.add_gauge(
        "backup_age_seconds",
        "Seconds since the newest backup; -1: there is none.",
        lambda: -1.0 if backups is None else backups.age_s(),
    )
    store.metrics.add_gauge(
        "backup_failures",
        "Backups that could not be made.",
        lambda: 0 if backups is None else backups.failures,
    )
    return backups


@contextmanager
def _metrics_served(settings: Settings, metrics: Metrics) -> Iterator[None]:
    """Serve the metrics on their own port where the settings name one.

    Raises:
        ServerError: If the port is taken.
    """
    if settings.metrics_port is None:
        yield
        return
    with ExitStack() as stack:
        try:
            served = metrics.serve(settings.metrics_host, settings.metrics_port)
            address = stack.enter_context(served)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise ServerError(
                f"cannot serve metrics on {settings.metrics_host} port {settings.metrics_port}: "
                f"{reason}; choose another with --metrics-port"
            ) from error
        print(f"metrics for Prometheus are at {address}", flush=True)
        yield


@contextmanager
def _file_errors() -> Iterator[None]:
    """Raise what is wrong with the file of a policy or a map as a ServerError."""
    try:
        yield
    except (LookupError, ValueError, OSError) as error:
        raise ServerError(str(error)) from error


def _started(settings: Settings, hidden: Sequence[Path]) -> Task:
    """The task of the settings, whose processes can start.

    Raises:
        ValueError: If they cannot start, the task is invalid, or it describes a column that does not exist.
        LookupError: If there is no task of this name.
        OSError: If a file of it cannot be read.
    """
    task = _task(settings, hidden=hidden, compiles_beside=True)
    try:
        check_words(task.about.columns)
        if guards := task.guards():
            print(f"{task.about.title}: {guards}", flush=True)
    except ValueError:
        task.close()
        raise
    return task


def _check_may_be_missing(settings: Settings, name: str, is_first: bool, error: ValueError) -> None:
    """Check that the server may start without an environment that does not start.

    Raises:
        ValueError: If it is the first one, or one of a running study.
    """
    if is_first:
        raise error
    folder = Folder(settings.studies)
    running = [study for study in folder.names() if folder.status(study) == "open"]
    if running:
        raise ValueError(
            f"{name} does not start, and its study {running[0]!r} is running: {error}"
        ) from error


def run(settings: Settings, opened: Callable[[str], object] = lambda address: None) -> None:
    """Serve until Ctrl-C or SIGTERM.

    Args:
        opened: Called with the page's address once it can be opened.

    Raises:
        ServerError: Before anything starts, if the server cannot.
        StoreError: Before anything starts, if its database cannot be used.
    """
    try:
        password = AdminPassword.of(settings)
    except ValueError as error:
        raise ServerError(f"{error}; set another HUMANPLAY_ADMIN_PASSWORD") from error
    # it ends as by Ctrl-C: the store is closed
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    raise_file_limit()
    metrics = Metrics()
    listening = inherited_socket() or listen(settings.host, settings.port)
    with listening as sock, _metrics_served(settings, metrics):
        bound_connections(sock, settings.limits.answer_s)
        with ExitStack() as stack:
            # an app closes its task too; this closes those of a start that fails before it
            with _file_errors():
                served = [settings, *(_of_another(settings, task) for task in settings.more)]
                names = [offer_name(environment_of(site.task)) for site in served]
                if len(set(names)) < len(names):
                    raise ValueError(
                        f"two environments are called alike: {', '.join(names)}; "
                        "give one another title in its file"
                    )
                hidden = [path for site in served for path in (site.database, site.studies)]
                tasks = {}
                for site, name in zip(served, names, strict=True):
                    try:
                        task = stack.enter_context(closing(_started(site, hidden)))
                    except ValueError as error:
                        _check_may_be_missing(site, name, site is settings, error)
                        print(f"{name} is left out: {error}", flush=True)
                    else:
                        tasks[name] = site, task
            shared = AppParts(protection=_protection(settings, metrics), jobs=_jobs())
            apps = []
            for name, (site, task) in tasks.items():
                is_first = site is settings
                counted = metrics if is_first else Metrics()
                # the store comes last: a start that fails leaves no new file behind
                opened_store = Store(site.database, site.durable, counted, site.accept_loss)
                store = stack.enter_context(closing(opened_store))
                if kind := network_file_system(store.path):
                    _log.warning(NETWORK, store.path, kind)
                # else it is checked beside play
                if store.missing and (fault := quick_check(store.path)) != "ok":
                    raise StoreError(damaged(store.path, fault))
                prepared = replace(shared, task=task, store=store)
                apps.append(_app_of(site, prepared, password, "" if is_first else name))
            if password is not None and password.drawn:
                print(
                    "the operator's page is /admin, its password until the server stops: "
                    f"{password.drawn}",
                    flush=True,
                )
            app = EnvironmentApps(apps[0], dict(zip([*tasks][1:], apps[1:], strict=True)))
            # a policy that decides in a thread lets a move through within a millisecond
            sys.setswitchinterval(0.001)
            try:
                logging.captureWarnings(True)
                config = uvicorn_config(
                    app if settings.more else apps[0], log_config=log_config(settings.log_format)
                )
                AnnouncingServer(config, address_of(sock), opened).run(sockets=[sock])
            except KeyboardInterrupt:
                return
