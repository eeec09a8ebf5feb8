"""What holders of cards do in sealed evaluations of agents, on one server; the wire (`humanplay.web`) is an adapter to it.

A card is a participant of kind `script`, and each of its attempts a board of its own, which steps, records and then tells as
any other (`humanplay.board.session`). A card has one attempt at each instance; one that was abandoned counts. Nothing tells
a score, a reward or an outcome while the evaluation is open, and no answer depends on an instance but by what was seen of
it.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from humanplay.board.session import Move, RefusedError, Session
from humanplay.db.study_rows import Participant
from humanplay.db.trial import Trial
from humanplay.series.evaluation import CardList, IssuedCard
from humanplay.series.folder import Study
from humanplay.series.participation import Participations
from humanplay.series.progress import ParticipantProgress, StageError
from humanplay.series.protocol import Agents, StudyError
from humanplay.task import TaskFullError

NO_CARD = "no open card goes by this address: check it, or ask whoever gave it to you"
SPLIT = "evaluation"
DESCRIBED = ("agent", "version", "model", "prompts_sha256", "cost")
"""What an author says of their agent; all but the cost is fixed by the first attempt."""
MOST_CHARACTERS = 200


class CardError(Exception):
    """What was asked for with a card is refused, and nothing has changed; `status` is that of HTTP."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


@dataclass(frozen=True)
class Card:
    """A card as its holder may know it; `number` counts the author's cards in this evaluation from 1."""

    id: str
    evaluation: str
    author: str
    number: int
    description: Mapping[str, str]


@dataclass(frozen=True)
class Seen:
    """What the agent may see now: no reward, no return, no outcome.

    step         moves made so far
    done         whether the attempt has ended
    observation  what the environment gives policies, ready for JSON; None where pictures alone are shown
    picture      a PNG as a data URL; `text` where people see a text instead
    """

    index: int
    step: int
    done: bool
    observation: Any
    picture: str | None
    text: str | None


@dataclass
class _Attempt:
    session_id: str
    started_ms: int
    has_ended: bool


@dataclass
class _Held:
    """A card in use: what the database holds of it, and its calls, after a start those that left an attempt or a move."""

    evaluation: str
    issued: IssuedCard
    participant: Participant | None
    attempts: dict[int, _Attempt]
    calls: int = 0
    changing: asyncio.Lock = field(default_factory=asyncio.Lock)

    @property
    def is_closed(self) -> bool:
        return self.participant is not None and self.participant.stage == "complete"


class Cards:
    """The cards of one server's evaluations."""

    def __init__(self, progress: ParticipantProgress) -> None:
        self._progress, self._lobby = progress, progress.lobby
        self._folder, self._list = progress.folder, CardList(progress.folder)
        self._store, self._known = progress.lobby.store, progress.study_store
        self._participations = Participations(self._folder, self._known, self._lobby.sources)
        self._keys: dict[str, tuple[str, str]] = {}
        """SHA-256 of a card's token -> its evaluation and its id."""
        self._held: dict[tuple[str, str], _Held] = {}

    async def find(self, token: str) -> Card:
        """Return the card with a token; CardError 404, one sentence for an unknown, a revoked and a closed one."""
        digest = hashlib.sha256(token.encode()).hexdigest()
        key = self._keys.get(digest)
        if key is None:
            key = self._keys[digest] = self._key(token)
        held = self._held.get(key)
        if held is None:  # another call may have loaded it meanwhile
            held = self._held.setdefault(key, await self._load(*key))
        study = self._study(held)
        issued = self._list.of(held.evaluation).get(held.issued.id)
        if issued is None or issued.revoked_at is not None or not study.is_running:
            raise CardError(404, NO_CARD)
        if held.attempts and self._is_over(held, study):
            await self._close(held)
        if held.is_closed:
            raise CardError(404, NO_CARD)
        return self._card(held)

    def task_name(self, card: Card) -> str:
        """Return the short name of what is played, without a slash: `mars`, or the environment's id."""
        rules = self._study(self._of(card)).protocol.rules
        _, _, rest = rules.name.partition(":")
        return "mars" if not rest else rules.title.replace("/", "-").replace(" ", "-")

    def about(self, card: Card) -> dict[str, Any]:
        """Return what is played and under which rules, ready for JSON; the same for every instance."""
        held = self._count(card)
        protocol = self._study(held).protocol
        rules, config, agents = protocol.rules, protocol.env_config, self._agents(held)
        return {
            "evaluation": protocol.name, "title": rules.title, "instructions": rules.briefing(config),
            "actions": list(rules.actions), "sees": agents.sees, "seen": rules.sees(config), "config": config.to_dict(),
            "limit": int(config.limit), "instances": protocol.ranked, "hours": agents.hours, "minutes": agents.minutes,
            "calls": agents.calls * protocol.ranked,
        }  # fmt: skip

    def instances(self, card: Card) -> list[dict[str, Any]]:
        """Return the instances as OpenEnv lists them, named alike for every card, in an order that says nothing of them."""
        count = self._study(self._count(card)).protocol.ranked
        return [{"task": _ident(i), "split": SPLIT, "index": i} for i in range(count)]

    def index_of(self, card: Card, ident: str) -> int:
        """Return the index of an instance by its id; CardError 404 where there is none."""
        for index in range(self._study(self._of(card)).protocol.ranked):
            if _ident(index) == ident:
                return index
        raise CardError(404, f"expected the id of an instance like {_ident(0)}, got {ident[:40]!r}")

    def begun(self, card: Card) -> Collection[int]:
        """Return the indices of the attempts that were begun; it is no call."""
        return self._of(card).attempts

    async def begin(self, card: Card, index: int) -> Seen:
        """Begin the attempt at an instance, or go on where it stands; CardError 409 once it is finished."""
        held = self._count(card)
        self._check_index(held, index)
        await asyncio.shield(self._begin(held, index))  # a lost connection interrupts nothing
        return await self._seen(held, index)

    async def act(self, card: Card, index: int, action: int | str, step: int | None = None) -> Seen:
        """Make a move and return what may be seen then; CardError 409 where the attempt has ended, 422 for no action.

        step  the moves made so far, for a client that must not move twice; None: whatever they are
        """
        held = self._count(card)
        actions = self._study(held).protocol.rules.actions
        code = actions.index(action) if action in actions else action
        if isinstance(code, bool) or not isinstance(code, int) or not 0 <= code < len(actions):
            named = f"0 to {len(actions) - 1}, or one of {', '.join(actions)}"
            raise CardError(422, f"expected an action, {named}; got {str(action)[:40]!r}")
        session = await self._session(held, index)
        made = session.shown.steps if step is None else step
        try:
            await session.act(Move(session.current.id, made, code, "script"))
        except RefusedError as error:
            self._note_end(held, index, session)
            why = f": {error}".replace(session.current.id, "")
            if session.shown.ended:  # the reason would tell the outcome
                why = " is finished: no move is made any more"
            raise CardError(409, f"instance {index}{why}") from error
        return await self._seen(held, index)

    async def state(self, card: Card) -> dict[str, Any]:
        """Return which attempts were begun and which are finished; no score."""
        held = self._count(card)
        finished = [i for i, attempt in held.attempts.items() if attempt.has_ended]
        instances = self._study(held).protocol.ranked
        told = {"begun": sorted(held.attempts), "finished": sorted(finished)}
        return {"instances": instances, **told, "calls": held.calls, "closed": held.is_closed}

    async def close(self, card: Card) -> None:
        """Close the card: what runs is abandoned, and its address answers as one that is unknown."""
        await self._close(self._of(card))

    async def describe(self, card: Card, given: Mapping[str, Any]) -> Card:
        """Keep what the author says of their agent and return the card; CardError 422 for other fields, 409 for late ones."""
        held = self._count(card)
        if unknown := [name for name in given if name not in DESCRIBED]:
            raise CardError(422, f"expected {', '.join(DESCRIBED)}, got {str(unknown[0])[:40]!r}")
        for name, value in given.items():
            is_text = isinstance(value, str) and len(value) <= MOST_CHARACTERS
            if not (is_text and value.isprintable()):
                what = f"a text of at most {MOST_CHARACTERS} characters"
                raise CardError(422, f"{name}: expected {what}")
        async with held.changing:
            if held.attempts and set(given) - {"cost"}:
                raise CardError(409, "an attempt was begun: only the cost can be changed")
            participant = await self._participant(held)
            settings = {**json.loads(participant.settings), **given}
            now = self._lobby.sources.clock_ms()
            note = partial(self._known.set_settings, participant.id, now, settings)
            await self._store.write(note)
            await self._read_again(held, participant.id)
        return self._card(held)

    def _key(self, token: str) -> tuple[str, str]:
        """Return the evaluation and the id of the card with a token; CardError for any other text."""
        found = None
        for study in self._folder.evaluations():  # all of them, so that the time says nothing
            issued = self._list.read_token(study, token)
            found = found if issued is None else (study.name, issued.id)
        if found is None:
            raise CardError(404, NO_CARD)
        return found

    async def _load(self, evaluation: str, ident: str) -> _Held:
        """Return a card as the database holds it."""

        def read() -> tuple[Participant | None, list[Trial], int]:
            if (participant := self._known.card(evaluation, ident)) is None:
                if self._known.is_invitation_forgotten(evaluation, ident):
                    raise CardError(404, NO_CARD)
                return None, [], 0
            trials = self._known.trials(participant.id)
            return participant, trials, len(trials) + self._known.count_moves(participant.id)

        participant, trials, calls = await self._store.read(read)
        attempts = {}
        for each in trials:
            made = _Attempt(each.session_id, each.started_ms, each.ended_ms is not None)
            attempts[each.terrain_index] = made
        return _Held(evaluation, self._list.of(evaluation)[ident], participant, attempts, calls)

    def _of(self, card: Card) -> _Held:
        return self._held[card.evaluation, card.id]

    def _count(self, card: Card) -> _Held:
        """Return a card in use, with one call more; CardError 429 where that is one too many."""
        held = self._of(card)
        most = self._agents(held).calls * self._study(held).protocol.ranked
        if held.calls >= most:
            raise CardError(429, f"the card has made its {most} calls: it can only be closed")
        held.calls += 1
        return held

    def _study(self, held: _Held) -> Study:
        try:
            return self._folder.study(held.evaluation)
        except StudyError as error:
            why = "the evaluation cannot go on now: tell whoever gave you the card"
            raise CardError(503, why) from error

    def _agents(self, held: _Held) -> Agents:
        agents = self._study(held).protocol.agents
        assert agents is not None  # only evaluations have cards
        return agents

    def _card(self, held: _Held) -> Card:
        issued, who = held.issued, held.participant
        said = {} if who is None else json.loads(who.settings)
        return Card(issued.id, held.evaluation, issued.author, issued.number, said)

    def _is_over(self, held: _Held, study: Study) -> bool:
        """Return whether the time of the whole card is over."""
        since = min(each.started_ms for each in held.attempts.values())
        return self._lobby.sources.clock_ms() - since > self._agents(held).hours * 3_600_000

    def _check_index(self, held: _Held, index: int) -> None:
        count = self._study(held).protocol.ranked
        if not 0 <= index < count:
            raise CardError(404, f"expected an instance 0 to {count - 1}, got {index}")

    async def _begin(self, held: _Held, index: int) -> None:
        """Begin the attempt at an instance on a board of its own, unless it runs; CardError 409 once it is finished."""
        async with held.changing:
            if held.is_closed:
                raise CardError(404, NO_CARD)
            if (attempt := held.attempts.get(index)) is None:
                await self._begin_new(held, index)
            elif attempt.has_ended:
                why = "is finished: a card has one attempt at each instance"
                raise CardError(409, f"instance {index} {why}")

    async def _begin_new(self, held: _Held, index: int) -> None:
        study, participant = self._study(held), await self._participant(held)
        participation = self._participations.of(participant)
        board = self._lobby.new_board(participant.player_id, participation)

        @contextmanager
        def within(row: Trial) -> Iterator[None]:
            self._progress.check_open(study)
            self._store.add_session(board.row)
            yield
            self._known.add_trial(participant.id, row.id, "ranked", len(held.attempts), index)

        config, seed = study.protocol.env_config, study.seed("ranked", index)
        try:
            await self._lobby.begin(board, config, seed, within, study.name)
        except StageError as error:
            raise CardError(409, str(error)) from error
        except (TaskFullError, ValueError) as error:
            raise CardError(503, f"it could not be begun: {error}; try again later") from error
        held.attempts[index] = _Attempt(board.id, board.current.started_ms, False)

    async def _participant(self, held: _Held) -> Participant:
        """Return who plays with a card, written at its first use; hold `changing`."""
        if held.participant is None:
            sources, issued = self._lobby.sources, held.issued
            now = sources.clock_ms()
            held.participant = Participant(
                id=sources.participant_id(), study=held.evaluation, player_id=sources.player_id(), session_id=None,
                kind="script", script=f"{issued.author} (card {issued.id})", stage="ranked", consent_version=None,
                consent_ms=None, joined_ms=now, completed_ms=None, completion_code=None, settings="{}",
                invitation=issued.id,
            )  # fmt: skip
            try:
                add = partial(self._add, held.participant, self._study(held), issued)
                await self._store.write(add)
            except BaseException as error:
                held.participant = None
                if isinstance(error, StageError):
                    raise CardError(409, str(error)) from error
                raise
        return held.participant

    async def _read_again(self, held: _Held, participant_id: str) -> None:
        held.participant = await self._store.read(partial(self._known.participant, participant_id))

    def _add(self, participant: Participant, study: Study, issued: IssuedCard) -> None:
        with self._store.transaction():
            self._progress.add_study(self._progress.check_open(study))
            card = {"card": issued.id, "author": issued.author, "number": issued.number}
            self._known.add_participant(participant, {}, card)

    async def _session(self, held: _Held, index: int) -> Session:
        """Return the board of an attempt, which is given up where its time is over; CardError 409 before it was begun."""
        self._check_index(held, index)
        attempt = held.attempts.get(index)
        if attempt is None:
            raise CardError(409, f"instance {index} has not begun: reset it first")
        session = await self._lobby.get(attempt.session_id)
        minutes = self._agents(held).minutes
        age_ms = self._lobby.sources.clock_ms() - attempt.started_ms
        if minutes is not None and age_ms > 60_000 * minutes and not session.shown.ended:
            await session.abandon(session.current.id, None)
        return session

    async def _seen(self, held: _Held, index: int) -> Seen:
        session, sees = await self._session(held, index), self._agents(held).sees
        try:
            view, seen = await session.seen(sees != "observation", sees != "picture")
        except ValueError as error:
            raise CardError(503, f"instance {index}: {error}; try again later") from error
        self._note_end(held, index, session)
        return Seen(index, view.steps, view.ended, **seen)

    def _note_end(self, held: _Held, index: int, session: Session) -> None:
        held.attempts[index].has_ended = session.shown.ended

    async def _close(self, held: _Held) -> None:
        async with held.changing:
            if held.is_closed:
                return
            for index in held.attempts:
                session = await self._session(held, index)
                if not session.shown.ended:
                    await session.abandon(session.current.id, None)
            participant, now = await self._participant(held), self._lobby.sources.clock_ms()
            await self._store.write(partial(self._known.set_stage, participant.id, now, "complete"))
            await self._read_again(held, participant.id)


def _ident(index: int) -> str:
    return f"i{index:04d}"
