"""What holders of cards do in evaluations of agents, on one server.

`wire` and `mcp` are adapters to it. A card has one attempt at each instance; one that was abandoned
counts. A move is answered once its row is committed, and an attempt goes on where its rows stand,
after a restart of the server too. While the evaluation is open nothing tells a score, a reward or
an outcome, and no answer depends on an instance except by what was seen of it.
"""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections import OrderedDict, defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypedDict, TypeVar

from humanplay.agents.evaluation import (
    Attempt,
    CardRow,
    Evaluation,
    Protocol,
    actions_of,
    attempts_of,
    card_of_token,
    card_with_id,
    cause_of,
    end_attempt,
    ending_of,
)
from humanplay.agents.turns import Turns
from humanplay.db.store import Store
from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError
from humanplay.task import (
    Choice,
    Run,
    RunEndedError,
    Task,
    TaskFullError,
    not_allowed,
    on_threads,
)

T = TypeVar("T")

NO_CARD = "no open card goes by this address: check it, or ask whoever gave it to you"
SPLIT = "evaluation"
DESCRIBED = ("agent", "version", "model", "prompts_sha256", "cost")
"""What an author says of their agent; all but the cost is fixed by the first attempt."""
MOST_CHARACTERS = 200
MOST_RUNS = 32
"""Most attempts in memory; any other is replayed from its moves when it goes on."""


class CardError(Exception):
    """What was asked for with a card is refused, and nothing has changed.

    Attributes:
        status: Of HTTP.
    """

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


@dataclass
class Card:
    """A card that holds, as the database had it when the call came."""

    evaluation: Evaluation
    row: CardRow
    attempts: dict[int, Attempt]
    calls: int = field(default=0)

    @property
    def protocol(self) -> Protocol:
        """What is played."""
        return self.evaluation.protocol

    @property
    def description(self) -> dict[str, str]:
        """What the author says of the agent."""
        return dict(json.loads(self.row.description))


@dataclass(frozen=True)
class InstanceView:
    """What the agent may see now: no reward, no return, no outcome.

    Attributes:
        step: Moves made so far.
        done: Whether the attempt has ended.
        observation: What the environment gives policies, ready for JSON; None where pictures
            alone are shown.
        picture: A PNG as a data URL; `text` where people see a text instead.
        allowed: The actions that may be chosen; None: all of them.
    """

    index: int
    step: int
    done: bool
    observation: object
    picture: str | None
    text: str | None
    allowed: Sequence[str] | None


class AboutCard(TypedDict):
    """What is played with a card and under which rules, the same for every instance.

    Attributes:
        seen: What is seen, in words.
        minutes: From the first attempt on; None without a limit.
        calls: That its agent may make in all.
    """

    evaluation: str
    title: str
    instructions: str
    actions: list[str]
    sees: str
    seen: str
    config: dict[str, object]
    limit: int
    instances: int
    hours: float
    minutes: float | None
    calls: int


class Cards:
    """The cards of one server's evaluations.

    Attributes:
        turns: In which agents have their moves made.
    """

    def __init__(
        self, store: Store, task: Task, folder: Folder, clock_ms: Callable[[], int]
    ) -> None:
        self.turns = Turns()
        self._store, self._task, self._folder, self._clock_ms = store, task, folder, clock_ms
        self._runs: OrderedDict[int, Run] = OrderedDict()
        """The runs of attempts where their rows stand."""
        self._calls: dict[str, int] = {}
        self._changing: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def find(self, token: str) -> Card:
        """The card with a token.

        Raises:
            CardError: 404, one sentence for an unknown, a revoked and a closed card; 503 if the
                evaluation cannot go on now.
        """
        try:
            card = await self._store.read(partial(self._read_card, token))
        except StudyError as error:
            raise CardError(
                503, "the evaluation cannot go on now: tell whoever gave you the card"
            ) from error
        if card is None:
            raise CardError(404, NO_CARD)
        card.calls = self._calls.setdefault(card.row.id, card.calls)
        if card.attempts and self._is_over(card):
            await self.close(card)
            raise CardError(404, NO_CARD)
        return card

    def task_name(self, card: Card) -> str:
        """The short name of what is played, without a slash: `mars`, say, or a title."""
        environment = card.protocol.environment
        package, _, rest = environment.name.partition(":")
        return package if not rest else environment.about.title.replace("/", "-").replace(" ", "-")

    def about(self, card: Card) -> AboutCard:
        """What is played and under which rules, ready for JSON; alike for every instance."""
        self._count(card)
        protocol = card.protocol
        environment, config = protocol.environment, protocol.env_config
        return {
            "evaluation": protocol.name,
            "title": environment.about.title,
            "instructions": environment.texts(config).briefing,
            "actions": list(environment.actions),
            "sees": protocol.sees,
            "seen": environment.texts(config).observations,
            "config": config.to_dict(),
            "limit": int(config.limit),
            "instances": protocol.instances,
            "hours": protocol.hours,
            "minutes": protocol.minutes,
            "calls": protocol.calls * protocol.instances,
        }

    def instances(self, card: Card) -> list[dict[str, object]]:
        """The instances, named alike for every card, in an order that says nothing."""
        self._count(card)
        count = card.protocol.instances
        return [{"task": _ident(i), "split": SPLIT, "index": i} for i in range(count)]

    def index_of(self, card: Card, ident: str) -> int:
        """The index of an instance by its id; CardError 404 if there is none."""
        for index in range(card.protocol.instances):
            if _ident(index) == ident:
                return index
        raise CardError(404, f"expected the id of an instance like {_ident(0)}, got {ident[:40]!r}")

    def begun(self, card: Card) -> Collection[int]:
        """The indices of the attempts that were begun; this counts as no call."""
        return card.attempts

    async def begin(self, card: Card, index: int) -> InstanceView:
        """Begin the attempt at an instance, or go on where it stands.

        Raises:
            CardError: 409 once it is finished.
        """
        self._count(card)
        self._check_index(card, index)
        # a lost connection interrupts nothing
        return await asyncio.shield(self._begin(card, index))

    async def act(
        self, card: Card, index: int, action: int | str, step: int | None = None
    ) -> InstanceView:
        """Make a move and return what may be seen then.

        Args:
            step: The moves made so far, for a client that must not move twice; None: whatever they
                are.

        Raises:
            CardError: 409 if the attempt has ended, 422 if the action is none.
        """
        self._count(card)
        actions = card.protocol.environment.actions
        code = actions.index(action) if action in actions else action
        if isinstance(code, bool) or not isinstance(code, int) or not 0 <= code < len(actions):
            raise CardError(
                422,
                f"expected an action, 0 to {len(actions) - 1}, or one of {', '.join(actions)}; "
                f"got {str(action)[:40]!r}",
            )
        self._check_index(card, index)
        return await asyncio.shield(self._act(card, index, code, step))

    async def state(self, card: Card) -> dict[str, object]:
        """Which attempts were begun and which are finished; no score."""
        self._count(card)
        finished = [i for i, attempt in card.attempts.items() if attempt.ended_ms is not None]
        return {
            "instances": card.protocol.instances,
            "begun": sorted(card.attempts),
            "finished": sorted(finished),
            "calls": card.calls,
        }

    async def close(self, card: Card) -> None:
        """Close the card: what runs is abandoned, and its address answers as unknown."""
        async with self._changing[card.row.id]:
            for attempt in (await self._read_attempts(card)).values():
                if attempt.ended_ms is None:
                    await self._abandon(card, attempt)
            sql = "UPDATE agents_cards SET closed_ms = ? WHERE id = ? AND closed_ms IS NULL"
            values = self._clock_ms(), card.row.id
            await self._write(lambda conn: conn.execute(sql, values).rowcount)

    async def describe(self, card: Card, texts: Mapping[str, object]) -> dict[str, str]:
        """Store what the author says of their agent, and return all of it.

        Raises:
            CardError: 422 for other fields, 409 for fields that are fixed by now.
        """
        self._count(card)
        if unknown := [name for name in texts if name not in DESCRIBED]:
            raise CardError(422, f"expected {', '.join(DESCRIBED)}, got {str(unknown[0])[:40]!r}")
        for name, text in texts.items():
            is_text = isinstance(text, str) and len(text) <= MOST_CHARACTERS
            if not (is_text and str(text).isprintable()):
                raise CardError(
                    422, f"{name}: expected a text of at most {MOST_CHARACTERS} characters"
                )
        async with self._changing[card.row.id]:
            if await self._read_attempts(card) and set(texts) - {"cost"}:
                raise CardError(409, "an attempt was begun: only the cost can be changed")

            def describe(conn: sqlite3.Connection) -> dict[str, str]:
                row = card_with_id(conn, card.row.id)
                texts_now = {**json.loads("{}" if row is None else row.description), **texts}
                sql = "UPDATE agents_cards SET description = ? WHERE id = ?"
                conn.execute(sql, (json.dumps(texts_now), card.row.id))
                return texts_now

            return await self._write(describe)

    async def _begin(self, card: Card, index: int) -> InstanceView:
        async with self._changing[card.row.id]:
            attempt = (await self._read_attempts(card)).get(index)
            if attempt is None:
                attempt, run = await self._begin_new(card, index)
            else:
                await self._check_running(card, attempt)
                run = await self._take(card, attempt)
            return await self._shown(card, attempt, run)

    async def _begin_new(self, card: Card, index: int) -> tuple[Attempt, Run]:
        """Begin an attempt.

        Raises:
            CardError: 409 if this server plays something else, 503 if it has no room.
        """
        protocol, task = card.protocol, self._task
        if protocol.task != task.name:
            raise CardError(
                409,
                f"the evaluation is of {protocol.environment.about.title}, and this server plays {task.about.title}: "
                "whoever gave you the card must start it with --env",
            )
        if protocol.core_version != task.version or task.lock.differences(protocol.lock):
            raise CardError(
                409,
                "the evaluation cannot be played here: this server has other versions than it was begun with; tell whoever "
                "gave you the card",
            )
        choice = Choice(protocol.env_config, card.evaluation.seed(index))
        try:
            run = await on_threads(task, task.begin, choice)
        except (TaskFullError, ValueError) as error:
            raise CardError(503, f"it could not be begun: {error}; try again later") from error
        now = self._clock_ms()

        def begin(conn: sqlite3.Connection) -> int:
            sql = "INSERT INTO agents_attempts (card, instance, started_ms) VALUES (?, ?, ?)"
            self._check_holds(conn, card)
            return int(conn.execute(sql, (card.row.id, index, now)).lastrowid or 0)

        ident = await self._write(begin)
        return Attempt(ident, card.row.id, index, now, None, None, 0), run

    async def _act(self, card: Card, index: int, action: int, step: int | None) -> InstanceView:
        async with self._changing[card.row.id]:
            attempt = (await self._read_attempts(card)).get(index)
            if attempt is None:
                raise CardError(409, f"instance {index} has not begun: reset it first")
            await self._check_running(card, attempt, "no move is made any more")
            if step not in (None, attempt.moves):
                raise CardError(
                    409, f"instance {index}: step {step} is not the current one, {attempt.moves}"
                )
            run = await self._take(card, attempt)
            allowed = run.view().allowed
            if allowed is not None and action not in allowed:
                self._runs[attempt.id] = run
                refusal = not_allowed(self._task.actions, allowed, action)
                raise CardError(409, f"instance {index}: {refusal}")
            try:
                await self._step(run, action)
            except RunEndedError as error:
                await self._end(attempt, run)
                raise CardError(
                    409, f"instance {index} is finished: no move is made any more"
                ) from error
            await self._write(partial(self._add_move, card, attempt, action, run))
            return await self._shown(card, attempt, run)

    async def _step(self, run: Run, action: int) -> None:
        if self._task.steps_on is None:
            run.step(action)
        else:
            await on_threads(self._task, run.step, action)

    def _add_move(
        self, card: Card, attempt: Attempt, action: int, run: Run, conn: sqlite3.Connection
    ) -> None:
        """Write a move of an attempt, and the attempt's ending if it ends with it."""
        self._check_holds(conn, card)
        now = self._clock_ms()
        row = attempt.id, attempt.moves, action, now
        conn.execute("INSERT INTO agents_moves VALUES (?, ?, ?, ?)", row)
        if run.view().ended:
            end_attempt(conn, attempt.id, now, ending_of(run))

    def _check_holds(self, conn: sqlite3.Connection, card: Card) -> None:
        """Check that neither the card nor its evaluation was closed meanwhile.

        A command can do that.

        Raises:
            CardError: 404.
        """
        if card_of_token(conn, self._folder, card.evaluation.token(card.row.id)) is None:
            raise CardError(404, NO_CARD)

    async def _check_running(self, card: Card, attempt: Attempt, reason: str = "") -> None:
        """Check that an attempt is not finished; if its time is over it is finished now.

        Args:
            reason: For the error.

        Raises:
            CardError: 409.
        """
        minutes = card.protocol.minutes
        age_ms = self._clock_ms() - attempt.started_ms
        if attempt.ended_ms is None and minutes is not None and age_ms > 60_000 * minutes:
            await self._abandon(card, attempt)
        elif attempt.ended_ms is None:
            return
        reason = reason or "a card has one attempt at each instance"
        raise CardError(409, f"instance {attempt.instance} is finished: {reason}")

    async def _shown(self, card: Card, attempt: Attempt, run: Run) -> InstanceView:
        """What is seen of a run whose moves are committed.

        A run that goes on stays in memory.
        """
        sees, index = card.protocol.sees, attempt.instance
        try:
            shown = await on_threads(
                self._task, run.agent_observation, sees != "observation", sees != "picture"
            )
        except ValueError as error:
            raise CardError(503, f"instance {index}: {error}; try again later") from error
        view = run.view()
        if not view.ended:
            self._runs[attempt.id] = run
            if len(self._runs) > MOST_RUNS:
                self._runs.popitem(last=False)
        return InstanceView(index, view.steps, view.ended, **shown)

    async def _take(self, card: Card, attempt: Attempt) -> Run:
        """Take the run of an attempt out of memory, or replay it from its moves.

        `_shown` puts it back.
        """
        run = self._runs.pop(attempt.id, None)
        if run is not None:
            return run

        actions = await self._store.read(lambda: actions_of(self._store.connection, attempt.id))

        def replay() -> Run:
            cause = cause_of(card.protocol, card.evaluation.seed(attempt.instance))
            return self._task.replay(cause, actions)

        try:
            return await on_threads(self._task, replay)
        except (TaskFullError, ValueError) as error:
            raise CardError(
                503, f"instance {attempt.instance} cannot go on now: {error}; try again later"
            ) from error

    async def _abandon(self, card: Card, attempt: Attempt) -> None:
        run = await self._take(card, attempt)
        run.abandon()
        await self._end(attempt, run)

    async def _end(self, attempt: Attempt, run: Run) -> None:
        now, came_to = self._clock_ms(), ending_of(run)
        await self._write(lambda conn: end_attempt(conn, attempt.id, now, came_to))

    async def _write(self, change: Callable[[sqlite3.Connection], T]) -> T:
        def write() -> T:
            with self._store.transaction():
                return change(self._store.connection)

        return await self._store.write(write)

    def _read_card(self, token: str) -> Card | None:
        conn = self._store.connection
        signed = card_of_token(conn, self._folder, token)
        if signed is None:
            return None
        evaluation, row = signed
        attempts = {attempt.instance: attempt for attempt in attempts_of(conn, row.id)}
        calls = len(attempts) + sum(attempt.moves for attempt in attempts.values())
        return Card(evaluation, row, attempts, calls)

    async def _read_attempts(self, card: Card) -> dict[int, Attempt]:
        """The attempts of a card as they stand; hold its lock."""
        attempts = await self._store.read(lambda: attempts_of(self._store.connection, card.row.id))
        return {attempt.instance: attempt for attempt in attempts}

    def _count(self, card: Card) -> None:
        """Count a call of a card; CardError 429 if it is one too many."""
        most = card.protocol.calls * card.protocol.instances
        if self._calls[card.row.id] >= most:
            raise CardError(429, f"the card has made its {most} calls: it can only be closed")
        self._calls[card.row.id] += 1
        card.calls = self._calls[card.row.id]

    def _is_over(self, card: Card) -> bool:
        """Whether the time of the whole card is over."""
        since = min(attempt.started_ms for attempt in card.attempts.values())
        return self._clock_ms() - since > card.protocol.hours * 3_600_000

    def _check_index(self, card: Card, index: int) -> None:
        count = card.protocol.instances
        if not 0 <= index < count:
            raise CardError(404, f"expected an instance 0 to {count - 1}, got {index}")


def _ident(index: int) -> str:
    return f"i{index:04d}"
