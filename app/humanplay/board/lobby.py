"""Sessions by id: create, find, restart, resume and unload.

The store holds everything about a session, and memory holds only those in use. One that nobody
subscribes to or asks for is unloaded. Any access resumes it where it stood, after a restart of the
server as well.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import (
    AbstractContextManager,
    AsyncExitStack,
    closing,
    contextmanager,
    nullcontext,
)
from dataclasses import dataclass, field, replace
from functools import partial
from weakref import WeakValueDictionary

from humanplay.board.agent import (
    DECISION_S,
    DEFAULT_MOVES_PER_SECOND,
    THREADS,
    Agent,
    DecisionQueue,
)
from humanplay.board.attestation import AttestationResult
from humanplay.board.charges import Charges, most_bytes
from humanplay.board.messages import ChangePace, Pace, PaceMode
from humanplay.board.participation import HUMAN, Participation
from humanplay.board.session import Session
from humanplay.board.sources import Sources, WatchIds
from humanplay.db.reader import Reader
from humanplay.db.store import Control, SessionRow, Store, StoredEpisode, Trial
from humanplay.task import Choice, Configuration, Run, Task, WantedBoard, WantedEpisode, on_threads


@dataclass
class BoardGroup:
    """A player's board and its rival's, if there is one.

    They begin together and are unloaded together.

    Attributes:
        lock: Held while the next episodes begin.
        agents: Session id -> the policy that drives the board.
        touched_s: When somebody asked for one of the boards last, monotonic seconds.
    """

    player: Session
    rival: Session | None
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    agents: dict[str, Agent] = field(default_factory=dict)
    touched_s: float = field(default_factory=time.monotonic)

    @property
    def boards(self) -> list[Session]:
        """The player's board, then the rival's if there is one."""
        return [self.player] if self.rival is None else [self.player, self.rival]

    def board(self, session_id: str) -> Session:
        """The board of the group that has this session's id."""
        return next(board for board in self.boards if board.id == session_id)


class Locks:
    """A lock for each key, there for as long as somebody holds it or waits for it."""

    def __init__(self) -> None:
        self._locks: WeakValueDictionary[str, asyncio.Lock] = WeakValueDictionary()

    def of(self, key: str) -> asyncio.Lock:
        """The lock of a key."""
        if (lock := self._locks.get(key)) is None:
            lock = self._locks[key] = asyncio.Lock()
        return lock


class UnknownSessionError(LookupError):
    """There is no session with this id, or none that the asker may see."""

    def __init__(self, session_id: str, detail: str | None = None) -> None:
        super().__init__(detail or f"no session {session_id!r}; begin one with POST /api/sessions")


EpisodeTransaction = Callable[[Trial], AbstractContextManager[None]]
"""What else is written in the transaction that opens an episode: before it, then after it."""

ParticipationOf = Callable[[str], Participation | None]
"""Finds a session's participation in a study by the session's id."""


def no_participation(session_id: str) -> None:
    """Return None: without studies no session is a participant's."""


class Lobby:
    """All sessions of one server."""

    def __init__(
        self,
        store: Store,
        task: Task,
        sources: Sources,
        idle_s: float,
        participation_of: ParticipationOf = no_participation,
        decision_s: float = DECISION_S,
        charges: Charges | None = None,
    ) -> None:
        self.store, self.task, self.sources, self._idle_s = store, task, sources, idle_s
        self.watch_ids = WatchIds(store)
        self.charges = charges or Charges()
        self._participation_of = participation_of
        self._groups: dict[str, BoardGroup] = {}
        self._resuming = Locks()
        self._thread = ThreadPoolExecutor(THREADS, "policies")
        self._decisions = DecisionQueue(self._thread, task.policies, decision_s)

    def __len__(self) -> int:
        """How many sessions are in memory."""
        return len(self._groups)

    @property
    def waiting_decisions(self) -> int:
        """How many boards of policies wait for a decision."""
        return len(self._decisions)

    def sessions(self) -> list[Session]:
        """The sessions in memory, in the order they came."""
        return [group.board(session_id) for session_id, group in self._groups.items()]

    async def create(
        self,
        wanted: WantedBoard,
        player_id: str,
        control: Control = "bearer",
        left: Sequence[Session] = (),
    ) -> Session:
        """Begin a new player's session, and its rival's if one is wanted.

        A session that replays another's episode without naming a terrain plays that episode's.

        Args:
            control: Who moves it: whoever knows its id, or its player's cookie alone.
            left: Boards whose running episodes are abandoned in the transaction that opens this
                one.

        Raises:
            ValueError: If a policy or map is unknown, or there is no terrain.
        """
        if wanted.player != HUMAN:
            self.task.policies.check(wanted.player, HUMAN)
        rival = [] if wanted.rival is None else [self.task.policies.check(wanted.rival)]
        drivers = [wanted.player, *rival]
        replayed = None
        if wanted.replays is not None:
            replayed = await self._ended_session(wanted.replays, wanted.player)
        is_same = replayed is not None and wanted.leaves_terrain
        again = self.task.again(replayed.current) if replayed and is_same else None
        terrain = again or await self.first_terrain(wanted)
        self.task.policies.check_size(drivers, terrain.config)
        seed, runs = await self._begin_episodes(terrain, len(drivers))
        rows = self._session_rows(drivers, player_id, control, wanted.challenges)
        boards = [self._session(row) for row in rows]
        adding = contextmanager(partial(self._adding, player_id, rows))
        await self._open_episodes(boards, runs, seed, terrain.is_chosen, lambda _: adding(), left)
        player = self._add_group(boards).player
        if replayed is not None:
            replayed.pair_with(player)
        return player

    async def first_terrain(self, wanted: WantedBoard) -> Choice:
        """Choose the terrain of a new board; ValueError if there is none."""
        if wanted.challenges is None:
            return self.task.first(wanted)
        challenged = await asyncio.to_thread(self._public_trial, wanted.challenges)
        if challenged is None:
            raise ValueError(
                f"no finished episode {wanted.challenges!r} to play against: check the link"
            )
        if (challenged.task, challenged.core_version) != (self.task.name, self.task.version):
            played = f"{challenged.task} {challenged.core_version}"
            raise ValueError(
                f"the episode was played on {played}, and this server plays {self.task.name} {self.task.version}"
            )
        return self.task.again(challenged)

    async def get(self, session_id: str) -> Session:
        """The session of an id, resumed if it was not in memory.

        Raises:
            UnknownSessionError: If there is none.
        """
        group = self._groups.get(session_id) or await self._resume(session_id)
        group.touched_s = time.monotonic()
        return group.board(session_id)

    def in_memory(self, session_id: str) -> Session | None:
        """The session if it is in memory. Asking does not keep it there, unlike `get`."""
        group = self._groups.get(session_id)
        return None if group is None else group.board(session_id)

    def rival_of(self, session: Session) -> Session | None:
        """The rival's board of a player's; None if it has none or is a rival's itself."""
        group = self._groups.get(session.id)
        return group.rival if group is not None and group.player is session else None

    def owner_of(self, session: Session) -> str | None:
        """The player whose screen shows a session in memory: a rival's is its player's."""
        group = self._groups.get(session.id)
        return session.row.player_id if group is None else group.player.row.player_id

    def hand_over(self, session_id: str, player_id: str) -> None:
        """Let another cookie drive a board: the sockets of the one before are closed."""
        if (session := self.in_memory(session_id)) is not None:
            session.row = replace(session.row, player_id=player_id)
            session.channel.notify()

    async def restart(
        self, session: Session, wanted: WantedEpisode, left: Sequence[Session] = ()
    ) -> None:
        """Abandon the running episodes and begin the next ones.

        A rival begins on the same terrain.

        Args:
            left: Other boards whose running episodes are abandoned too.
        """
        group = self._groups.get(session.id) or await self._resume(session.id)
        if session is group.rival:
            raise ValueError(
                "a rival plays its player's terrain; begin the next episode in the player's session"
            )
        async with group.lock:
            terrain = self.task.next(session.current, wanted)
            drivers = (board.row.driver_name for board in group.boards)
            self.task.policies.check_size(drivers, terrain.config)
            seed, runs = await self._begin_episodes(terrain, len(group.boards))
            await self._open_episodes(group.boards, runs, seed, terrain.is_chosen, left=left)
            self._pair(group)  # a replay belonged to the episode before

    def new_board(self, player_id: str, participation: Participation | None = None) -> Session:
        """Create a board for episodes of a series.

        Nobody can find it before `begin` opens the first of them.
        """
        (row,) = self._session_rows([HUMAN], player_id, "cookie")
        return self._session(row, participation)

    async def begin(
        self,
        board: Session,
        config: Configuration,
        seed: int,
        within: EpisodeTransaction,
        series: str,
    ) -> None:
        """Begin the next episode of a series' board, on the terrain of a seed."""
        _, runs = await self._begin_episodes(Choice(config, seed), 1)
        await self._open_episodes([board], runs, seed, False, within, series=series)
        if board.id not in self._groups:
            self._add_group([board])

    async def change_pace(self, session: Session, change: ChangePace) -> Pace:
        """Change a session's pace and return it.

        Raises:
            ValueError: If the session has no pace or cannot follow.
        """
        if session.pace is None:
            raise ValueError(
                "this session is driven by a person; only a policy's session (a rival's, say) has a pace"
            )
        if change.follow and session.row.rival_of is None:
            raise ValueError("only a rival can follow; give moves_per_second, pause or step")
        rate = change.moves_per_second or session.pace.moves_per_second
        mode = "timed" if change.moves_per_second else "follow" if change.follow else "paused"
        await session.set_pace(Pace.model_validate({"mode": mode, "moves_per_second": rate}))
        if change.step and (group := self._groups.get(session.id)) is not None:
            group.agents[session.id].move_once()
        return session.pace

    async def sweep(self) -> None:
        """Unload, until cancelled, every group that has been idle for `idle_s`."""
        while True:
            await asyncio.sleep(min(60.0, self._idle_s / 4))
            self._unload_idle(time.monotonic() - self._idle_s)

    def forget(self, deleted: Sequence[str], episodes: Sequence[str] = ()) -> None:
        """Unload some sessions, which are deleted with their episodes."""
        for episode in episodes:
            self.charges.close(episode, 0)
        for session_id in deleted:
            # somebody asked for it just then
            if (group := self._groups.get(session_id)) is not None:
                self._unload(group)

    def close(self) -> None:
        """Unload everything, end the policies' thread and what runs for the task."""
        for group in list(self._groups.values()):
            self._unload(group)
        self.task.close()
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _session(self, row: SessionRow, participation: Participation | None = None) -> Session:
        clock = self.sources.clock_ms
        return Session(row, self.task, self.store, clock, self.charges, participation)

    def _session_rows(
        self, drivers: list[str], player_id: str, control: Control, challenges: str | None = None
    ) -> list[SessionRow]:
        now, rows = self.sources.clock_ms(), list[SessionRow]()
        for number, driver in enumerate(drivers):
            rival_of, owner = (rows[0].id, None) if number else (None, player_id)
            mode: PaceMode = "follow" if number else "paused" if driver == HUMAN else "timed"
            id_ = self.sources.session_id()
            pace = (mode, DEFAULT_MOVES_PER_SECOND)
            rows.append(SessionRow(id_, owner, driver, rival_of, *pace, now, control, challenges))
        return rows

    def _adding(self, player_id: str, rows: list[SessionRow]) -> Iterator[None]:
        """Add a player and their sessions as the first episodes open, in one transaction."""
        self.store.add_player(player_id, rows[0].created_ms)
        for row in rows:
            self.store.add_session(row)
        yield

    def _public_trial(self, episode_id: str) -> Trial | None:
        """A finished episode that anybody may see; None if there is none."""
        now_ms = self.sources.clock_ms()
        with closing(Reader.open(self.store.path, public=True, at_ms=now_ms)) as reader:
            return reader.trial(episode_id)

    async def _ended_session(self, session_id: str, driver: str) -> Session:
        """The session whose ended episode a policy is to be shown on.

        Raises:
            ValueError: If there is none.
        """
        session = await self.get(session_id)
        if driver == HUMAN:
            raise ValueError("only a policy replays another session's episode; name one as player")
        if session.current.series or not session.shown.ended:
            raise ValueError(f"session {session_id!r} has no ended episode to be replayed beside")
        return session

    async def _begin_episodes(self, terrain: Choice, boards: int) -> tuple[int | None, list[Run]]:
        """Begin an episode for each board, all on one terrain.

        Returns:
            The seed and the runs. The seed is fresh if no terrain was chosen, and None on a map.
        """
        chosen = terrain if terrain.is_chosen else replace(terrain, seed=self.sources.seed())
        return chosen.seed, await on_threads(
            self.task, lambda: [self.task.begin(chosen) for _ in range(boards)]
        )

    async def _open_episodes(
        self,
        boards: list[Session],
        runs: list[Run],
        seed: int | None,
        seed_chosen: bool,
        within: EpisodeTransaction | None = None,
        left: Sequence[Session] = (),
        series: str = "",
    ) -> None:
        """Close the running episodes and open the next ones in one transaction.

        The frames are published after it is committed. An error changes nothing.
        """
        async with AsyncExitStack() as locks:
            # 1. hold every board that changes, in one order: two callers must not wait for each other
            for board in sorted({*boards, *left}, key=lambda board: board.id):
                await locks.enter_async_context(board.changing)
            # 2. the rows of the next episodes, and the charge for them
            now = self.sources.clock_ms()
            rows = [
                Trial(
                    id=self.sources.episode_id(),
                    session_id=board.id,
                    number=board.number + 1,
                    task=self.task.name,
                    core_version=record.core_version,
                    config=record.config,
                    seed=seed,
                    seed_chosen=seed_chosen,
                    terrain=record.terrain,
                    start=record.start,
                    policy_seed=self.sources.seed(),
                    driver=board.driver,
                    assisted=len(boards) > 1,
                    started_ms=now,
                    series=series,
                )
                for board, record in zip(boards, [run.record() for run in runs], strict=True)
            ]
            locks.enter_context(self._charging(boards, rows))
            # 3. abandon what still runs, and compare its moves with its input events; on the thread of the
            #    writes that would hold up everybody's moves
            running = [
                board for board in (*boards, *left) if board.number and not board.shown.ended
            ]
            abandoned = [
                (board, board.current, await board.take_abandoned(), board.now_ms())
                for board in running
            ]
            endings = [
                await board.inputs.prepare_end(current, run) for board, current, run, _ in abandoned
            ]

            # 4. record all of it, then tell
            def record() -> tuple[list[AttestationResult | None], list[bool], list[Trial]]:
                with self.store.transaction(), within(rows[0]) if within else nullcontext():
                    closings = [
                        board.inputs.closing(current, run, at_ms, ending)
                        for (board, current, run, at_ms), ending in zip(
                            abandoned, endings, strict=True
                        )
                    ]
                    opened = self.store.next_episode([closing for closing, _ in closings], rows)
                hidden = [
                    board.hides_scores(row.id) for board, row in zip(boards, rows, strict=True)
                ]
                return [attestation for _, attestation in closings], hidden, opened

            def publish(
                recorded: tuple[list[AttestationResult | None], list[bool], list[Trial]],
            ) -> None:
                levels, hidden, opened = recorded
                for (board, current, run, _), ending in zip(abandoned, endings, strict=True):
                    board.charge(current, run.view().steps, ending)
                for board, row, run, hides in zip(boards, opened, runs, hidden, strict=True):
                    board.begin(row, run, hides)
                for (board, current, run, _), level in zip(abandoned, levels, strict=True):
                    if board not in boards:
                        # it shows the end of its episode; none of a study is left in this way
                        board.go_on(current, run, run.view(), level, hides_scores=False)

            await self.store.write(record, then=publish)

    @contextmanager
    def _charging(self, boards: list[Session], rows: list[Trial]) -> Iterator[None]:
        """Check that episodes may begin, and charge the most that they can store.

        If they fail to begin, the charge is taken back.
        """
        self.charges.check(boards[0].study)
        for board, row in zip(boards, rows, strict=True):
            size = most_bytes(row, board.inputs.is_persons)
            self.charges.open(row.id, board.study, size)
        try:
            yield
        except Exception:
            for row in rows:
                self.charges.close(row.id, 0)
            raise

    def _add_group(self, boards: list[Session]) -> BoardGroup:
        """Keep boards in memory as a group, with an agent for each policy's board."""
        player, rival = boards[0], boards[1] if len(boards) > 1 else None
        group = BoardGroup(player, rival)
        self._pair(group)
        for board in boards:
            self._groups[board.id] = group
            if board.has_policy:
                load = partial(self.task.policies.load, board.row.driver_name)
                followed = player if board is rival else None
                group.agents[board.id] = Agent(board, followed, load, self._decisions)
        return group

    def _pair(self, group: BoardGroup) -> None:
        """Pair a player's board with its rival's, or with none."""
        if group.rival is None:
            group.player.unpair()
        else:
            group.player.pair_with(group.rival)

    async def _resume(self, session_id: str) -> BoardGroup:
        """The group of a session, read from the store.

        Raises:
            UnknownSessionError: If it is not there.
        """
        player = await self.store.read(partial(self.store.player_session, session_id))
        async with self._resuming.of(player):
            # somebody else may have resumed it while this waited for the lock
            if session_id in self._groups:
                return self._groups[session_id]
            rows = await self.store.read(partial(self._read_stored, session_id))
            try:
                boards = [await self._restore(*row) for row in rows]
            except ValueError as error:
                detail = f"session {session_id!r} cannot be resumed: {error}"
                raise UnknownSessionError(session_id, detail) from error
            return self._add_group(boards)

    def _read_stored(
        self, session_id: str
    ) -> list[tuple[StoredEpisode, Participation | None, bool]]:
        """A player's session and its rival's, as the store holds them.

        Returns:
            Each with its participation and whether its scores are hidden.

        Raises:
            UnknownSessionError: If it is not there.
        """
        now = self.sources.clock_ms()
        asked = self.store.resume_session(session_id, now)
        player_id = session_id if asked is None else asked.session.rival_of or session_id
        # both boards: one that came back alone would never be paired again
        ids = [player_id, self.store.rival_of(player_id)]
        rows = [self.store.resume_session(id_, now) for id_ in ids if id_ is not None]
        if asked is None or rows[0] is None:
            raise UnknownSessionError(session_id)
        stored = [(row, self._participation_of(row.session.id)) for row in rows if row is not None]
        return [
            (row, study, study is not None and study.hides_scores(row.episode.id))
            for row, study in stored
        ]

    async def _restore(
        self, row: StoredEpisode, participation: Participation | None, hides_scores: bool
    ) -> Session:
        """A session as it stood.

        Raises:
            ValueError: If its actions do not fit the rules any more.
        """
        run = await on_threads(self.task, self.task.replay, row.episode, row.actions, row.ended)
        session = self._session(row.session, participation)
        session.begin(row.episode, run, hides_scores, row.newest_ms, row.batches)
        return session

    def _unload_idle(self, since_s: float) -> None:
        """Unload what has been idle since a time (monotonic seconds)."""
        for group in {id(group): group for group in self._groups.values()}.values():
            if group.touched_s < since_s and not any(map(_is_in_use, group.boards)):
                self._unload(group)

    def _unload(self, group: BoardGroup) -> None:
        for agent in group.agents.values():
            agent.close()
        for board in group.boards:
            self._groups.pop(board.id, None)


def _is_in_use(board: Session) -> bool:
    """Whether somebody watches a board, or something of it is being written."""
    return board.channel.subscribers > 0 or board.changing.locked()
