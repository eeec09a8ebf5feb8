"""Sessions by id: create, join, restart, resume, and let sleep.

A session in memory is a convenience; the store is the truth. One that nobody follows or asks for leaves memory, and any
access brings it back where it stood, after a restart of the server as well.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial

from app.play.agent import ALONE_PER_SECOND, Agent, Decisions, Policies
from app.play.messages import ChangePace, NewEpisode, NewSession, Pace, PaceMode
from app.play.session import HUMAN, Participation, Session, resume
from app.storage.store import EpisodeRow, SessionRow, Store, StoreError
from marsexplorer.config import MAX_SEED, EnvConfig
from marsexplorer.episode import Episode


class UnknownSessionError(LookupError):
    """No session goes by this id, or none that is the asker's to see."""

    def __init__(self, session_id: str, why: str | None = None) -> None:
        super().__init__(why or f"no session {session_id!r}; begin one with POST /api/sessions")


def now_ms() -> int:
    """Return milliseconds since 1970."""
    return time.time_ns() // 1_000_000


@dataclass(frozen=True)
class Sources:
    """Where ids, seeds and the time come from: unguessable, unless a test says otherwise."""

    session_id: Callable[[], str] = lambda: secrets.token_urlsafe(16)
    episode_id: Callable[[], str] = lambda: secrets.token_hex(8)
    player_id: Callable[[], str] = lambda: secrets.token_hex(16)
    seed: Callable[[], int] = lambda: secrets.randbelow(MAX_SEED + 1)
    clock_ms: Callable[[], int] = now_ms
    participant_id: Callable[[], str] = lambda: secrets.token_hex(16)
    completion_code: Callable[[], str] = lambda: secrets.token_hex(4).upper()


@dataclass
class Group:
    """A player's board and, beside it, its rival's: they begin and sleep together."""

    player: Session
    rival: Session | None
    lock: asyncio.Lock
    agents: dict[str, Agent]

    @property
    def boards(self) -> list[Session]:
        """The player's, then the rival's if there is one."""
        return [self.player] if self.rival is None else [self.player, self.rival]


Within = Callable[[EpisodeRow], AbstractContextManager[None]]
"""What else is written in the transaction that opens an episode: before it, then after it."""


class Lobby:
    """All sessions of one server; `participation_of` gives a session's participation in a study by its id."""

    def __init__(self, store: Store, policies: Policies, sources: Sources, idle_s: float) -> None:
        self.store, self.policies, self.sources, self._idle_s = store, policies, sources, idle_s
        self.participation_of: Callable[[str], Participation | None] = lambda session_id: None
        self._groups: dict[str, Group] = {}
        self._waking = asyncio.Lock()
        self._thread = ThreadPoolExecutor(1, "policies")
        self._decisions = Decisions(self._thread)
        found = store.sessions_to_resume(sources.clock_ms())
        self._rivals = {each.session.rival_of: each.session.id for each in found if each.session.rival_of}

    def __len__(self) -> int:
        """How many sessions are in memory."""
        return len(self._groups)

    def sessions(self) -> list[Session]:
        """Return the sessions in memory, in the order they came."""
        return [next(board for board in group.boards if board.id == id_) for id_, group in self._groups.items()]

    async def create(self, wanted: NewSession, player_id: str) -> Session:
        """Return a new player's session, its rival beside it; ValueError for an unknown policy or an unsolvable level."""
        if wanted.player != HUMAN:
            self.policies.check(wanted.player, HUMAN)
        drivers = [wanted.player] if wanted.rival is None else [wanted.player, self.policies.check(wanted.rival)]
        config = EnvConfig.of(wanted.level or "random", wanted.size or 21)
        self.policies.check_size(drivers, config)
        shown = None if wanted.replays is None else await self._ended(wanted.replays, wanted.player)
        seed, episodes = await self._draw(config, wanted.seed, len(drivers))
        rows = self._session_rows(drivers, player_id)
        for row in rows:
            self.store.add_session(row)
        boards = [Session(row, self.store, self.sources.clock_ms) for row in rows]
        if len(boards) == 2:
            self._rivals[boards[0].id] = boards[1].id
        self._open(boards, episodes, seed, wanted.seed is not None)
        player = self._admit(boards).player
        if shown is not None:
            player.is_second, player.paired_with, shown.paired_with = True, shown, player
            shown.channel.nudge()
        return player

    async def get(self, session_id: str) -> Session:
        """Return the session, brought back to memory if it slept; UnknownSessionError when there is none."""
        group = self._groups.get(session_id) or await self._wake(session_id)
        session = next(board for board in group.boards if board.id == session_id)
        session.touched = time.monotonic()
        return session

    def rival_of(self, session: Session) -> Session | None:
        """Return the board beside a player's; None when it plays alone or is a rival's itself."""
        group = self._groups.get(session.id)
        return group.rival if group is not None and group.player is session else None

    async def restart(self, session: Session, wanted: NewEpisode) -> None:
        """Return with the running episodes abandoned and the next ones begun, the rival's on the same terrain."""
        group = self._groups.get(session.id) or await self._wake(session.id)
        if session is group.rival:
            raise ValueError("a rival plays its player's terrain; begin the next episode in the player's session")
        async with group.lock:
            was = session.current.config
            config = EnvConfig.of(wanted.level or was.level, wanted.size or (was.rows, was.cols))
            self.policies.check_size((board.row.driver_name for board in group.boards), config)
            seed, episodes = await self._draw(config, wanted.seed, len(group.boards))
            self._open(group.boards, episodes, seed, wanted.seed is not None)
            group.player.paired_with = group.rival  # a replay belonged to the episode before

    def new_board(self, player_id: str, participation: Participation) -> Session:
        """Return a participant's board, known to nobody before `begin` opens its first episode."""
        id_, now = self.sources.session_id(), self.sources.clock_ms()
        row = SessionRow(id_, player_id, HUMAN, None, "paused", ALONE_PER_SECOND, now)
        return Session(row, self.store, self.sources.clock_ms, participation)

    async def begin(self, board: Session, config: EnvConfig, seed: int, within: Within) -> None:
        """Return with the next episode of a participant's board begun, on the terrain of a seed that the study fixed."""
        _, episodes = await self._draw(config, seed, 1)
        self._open([board], episodes, seed, False, within)
        if board.id not in self._groups:
            self._admit([board])

    def change_pace(self, session: Session, change: ChangePace) -> Pace:
        """Return the pace after the change; ValueError when the session has none or cannot follow."""
        if session.pace is None:
            raise ValueError("this session is driven by a person; only a policy's session (a rival's, say) has a pace")
        if change.follow and session.row.rival_of is None:
            raise ValueError("only a rival can follow; give moves_per_second, pause or step")
        rate = change.moves_per_second or session.pace.moves_per_second
        mode = "timed" if change.moves_per_second else "follow" if change.follow else "paused"
        session.fault = None
        session.set_pace(Pace.model_validate({"mode": mode, "moves_per_second": rate}))
        if change.step:
            self._groups[session.id].agents[session.id].move_once()
        return session.pace

    async def sweep(self) -> None:
        """Let sleep, for ever, what nobody follows or asks for."""
        while True:
            await asyncio.sleep(min(60.0, self._idle_s / 4))
            horizon = time.monotonic() - self._idle_s
            for group in {id(group): group for group in self._groups.values()}.values():
                if all(board.channel.followers == 0 and board.touched < horizon for board in group.boards):
                    self._dismiss(group)

    def close(self) -> None:
        """Let everything sleep."""
        for group in list(self._groups.values()):
            self._dismiss(group)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _session_rows(self, drivers: list[str], player_id: str) -> list[SessionRow]:
        now, rows = self.sources.clock_ms(), list[SessionRow]()
        self.store.add_player(player_id, now)
        for number, driver in enumerate(drivers):
            rival_of, owner = (rows[0].id, None) if number else (None, player_id)
            mode: PaceMode = "follow" if number else "paused" if driver == HUMAN else "timed"
            id_ = self.sources.session_id()
            rows.append(SessionRow(id_, owner, driver, rival_of, mode, ALONE_PER_SECOND, now))
        return rows

    async def _ended(self, session_id: str, driver: str) -> Session:
        """Return the session whose ended episode a policy is to be shown on; ValueError where there is none."""
        session = await self.get(session_id)
        if driver == HUMAN:
            raise ValueError("only a policy replays another session's episode; name one as player")
        if session.participation is not None or not session.episode.ended:
            raise ValueError(f"session {session_id!r} has no ended episode to be replayed beside")
        return session

    async def _draw(self, config: EnvConfig, seed: int | None, boards: int) -> tuple[int, list[Episode]]:
        """Return the seed, drawn when None, and an episode on its terrain for each board."""
        chosen = self.sources.seed() if seed is None else seed
        return chosen, await asyncio.to_thread(lambda: [Episode.begin(config, seed=chosen) for _ in range(boards)])

    def _open(
        self, boards: list[Session], episodes: list[Episode], seed: int, seed_chosen: bool, within: Within | None = None
    ) -> None:
        """Close what runs and open the next in one transaction, then show it; after an error all is as it was."""
        now = self.sources.clock_ms()
        rows = [
            EpisodeRow(
                id=self.sources.episode_id(),
                session_id=board.id,
                number=board.number + 1,
                config=episode.config,
                seed=seed,
                seed_chosen=seed_chosen,
                terrain=episode.record().terrain,
                start=episode.start,
                policy_seed=self.sources.seed(),
                driver=board.driver,
                assisted=len(boards) > 1,
                started_ms=now,
            )
            for board, episode in zip(boards, episodes, strict=True)
        ]
        running = [board for board in boards if board.number and not board.episode.ended]
        closing = [board.give_up() for board in running]
        try:
            with self.store.transaction(), within(rows[0]) if within else nullcontext():
                self.store.next_episode(closing, rows)
        except StoreError:
            for board in running:
                board.rewind(board.episode.steps)
            raise
        for board, row, episode in zip(boards, rows, episodes, strict=True):
            board.begin(row, episode)

    def _admit(self, boards: list[Session]) -> Group:
        """Return the boards as a group in memory, an agent at the controls of each that is not a person's."""
        player, rival = boards[0], boards[1] if len(boards) > 1 else None
        group = Group(player, rival, asyncio.Lock(), {})
        if rival is not None:
            player.paired_with, rival.paired_with = rival, player
        for board in boards:
            self._groups[board.id] = group
            if not board.is_human:
                load = partial(self.policies.load, board.row.driver_name)
                group.agents[board.id] = Agent(board, player if board is rival else None, load, self._decisions)
        return group

    async def _wake(self, session_id: str) -> Group:
        async with self._waking:
            if session_id in self._groups:
                return self._groups[session_id]
            found = self.store.resume_session(session_id, self.sources.clock_ms())
            player_id = session_id if found is None else found.session.rival_of or session_id
            ids = [player_id, self._rivals.get(player_id)]
            rows = [self.store.resume_session(each, self.sources.clock_ms()) for each in ids if each is not None]
            if found is None or rows[0] is None:
                raise UnknownSessionError(session_id)
            kept = [row for row in rows if row is not None]
            try:
                clock = self.sources.clock_ms
                boards = [await asyncio.to_thread(resume, row, self.store, clock) for row in kept]
            except ValueError as error:
                raise UnknownSessionError(session_id, f"session {session_id!r} cannot be resumed: {error}") from error
            for board in boards:
                board.participation = self.participation_of(board.id)
                if board.participation is not None:
                    board.tell()
            return self._admit(boards)

    def _dismiss(self, group: Group) -> None:
        for agent in group.agents.values():
            agent.close()
        for board in group.boards:
            self._groups.pop(board.id, None)
