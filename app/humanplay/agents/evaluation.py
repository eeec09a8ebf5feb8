"""An evaluation of agents: what fixes it, and its cards.

They are in tables of their own in the database. An evaluation plays the ranked terrains of a study
whose secret is kept, or instances of a task that follow from a secret of its own. Each card belongs
to an author; a further one of the same author is numbered, has seen these instances, and never
ranks. A card's token is its id and a signature under the evaluation's secret.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypedDict

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from humanplay.board.messages import describe_errors
from humanplay.db.database import open_database, reading, rows, writing
from humanplay.db.study_rows import is_same_study
from humanplay.study.folder import Folder, Study
from humanplay.study.invitations import ID_LENGTH, new_id, signature
from humanplay.study.policy_files import PolicyFiles
from humanplay.study.protocol import NAME, StudyError, canonical_json
from humanplay.study.seeds import commitment, seed
from humanplay.task import Configuration, DrawnInstance, Environment, Run, draw_instance
from humanplay.task.registration import environment_of

TABLES = (
    """CREATE TABLE IF NOT EXISTS agents_evaluations (
        name TEXT PRIMARY KEY, protocol TEXT NOT NULL, secret TEXT NOT NULL, frozen_ms INTEGER NOT NULL, closed_ms INTEGER)""",
    """CREATE TABLE IF NOT EXISTS agents_cards (
        id TEXT PRIMARY KEY, evaluation TEXT NOT NULL REFERENCES agents_evaluations(name), author TEXT NOT NULL,
        number INTEGER NOT NULL, issued_ms INTEGER NOT NULL, revoked_ms INTEGER, closed_ms INTEGER,
        description TEXT NOT NULL DEFAULT '{}')""",
    """CREATE TABLE IF NOT EXISTS agents_attempts (
        id INTEGER PRIMARY KEY, card TEXT NOT NULL REFERENCES agents_cards(id), instance INTEGER NOT NULL,
        started_ms INTEGER NOT NULL, ended_ms INTEGER, came_to TEXT, UNIQUE (card, instance))""",
    """CREATE TABLE IF NOT EXISTS agents_moves (
        attempt INTEGER NOT NULL REFERENCES agents_attempts(id), step INTEGER NOT NULL, action INTEGER NOT NULL,
        at_ms INTEGER NOT NULL, PRIMARY KEY (attempt, step)) WITHOUT ROWID""",
)
"""A move counts once its row is committed; `came_to` is JSON, how the attempt ended
(`EpisodeEnding`)."""


class EpisodeEnding(TypedDict):
    """How an episode ended, as a receipt says it and as it is simulated again."""

    outcome: str
    steps: int
    score: float
    total: float
    trajectory_hash: str


OPENING, RECEIPTS = "opening.json", "receipts"
POLICIES, COMPARISON = "policies.json", "comparison.json"
"""What a closed evaluation publishes."""
SEEN_BEFORE = "has seen these instances"
TOKEN_LENGTH = 20  # 100 bits that nobody can guess
ACTIVE_MS = 10 * 60_000
"""An agent that has moved within this time is at it."""
_CARDS = """SELECT c.*, (SELECT max(m.at_ms) FROM agents_moves m JOIN agents_attempts a ON a.id = m.attempt
    WHERE a.card = c.id) AS moved_ms FROM agents_cards c"""


_ATTEMPTS = """SELECT a.*, coalesce((SELECT max(m.step) + 1 FROM agents_moves m WHERE m.attempt = a.id), 0) AS moves
    FROM agents_attempts a"""


class EvaluationError(StudyError):
    """An evaluation cannot be begun, changed or closed as asked; the text says why."""


class PlayedStudy(BaseModel):
    """The study whose ranked terrains are played, as it was frozen."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    name: str
    protocol_hash: str
    commitment: str


class Protocol(BaseModel):
    """What is fixed before any agent plays.

    Attributes:
        sees: What agents are shown: what people see, what the environment gives policies, or
            both.
        hours: From a card's first attempt until the card is closed.
        minutes: From the beginning of an attempt until it is abandoned; None: no limit but that
            of the moves.
        calls: Calls of a card, times the number of instances.
        policies: Compared with the agents.
        lock: What must be the same where it is played.
        study: Whose ranked terrains are played; None: instances of its own.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)

    name: str = Field(pattern=f"^{NAME}$")
    task: str
    config: dict[str, object]
    core_version: str
    lock: dict[str, object]
    instances: int = Field(ge=1, le=500)
    sees: Literal["picture", "observation", "both"] = "both"
    hours: float = Field(default=168.0, gt=0, le=8760, allow_inf_nan=False)
    minutes: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    calls: int = Field(default=20_000, ge=1)
    policies: tuple[str, ...] = ()
    study: PlayedStudy | None = None

    @property
    def environment(self) -> Environment:
        """The rules of the task."""
        return environment_of(self.task)

    @property
    def env_config(self) -> Configuration:
        """The configuration of the task."""
        return self.environment.configuration(self.config)

    @property
    def hash(self) -> str:
        """SHA-256 (hex) of the protocol's canonical JSON."""
        return hashlib.sha256(canonical_json(self.model_dump(mode="json"))).hexdigest()


@dataclass(frozen=True)
class Evaluation:
    """An evaluation as it was begun.

    Attributes:
        study: Whose ranked terrains are played, from the folder of studies; None: instances of
            its own.
    """

    protocol: Protocol
    secret: bytes = field(repr=False)
    frozen_ms: int
    closed_ms: int | None
    study: Study | None = None

    @property
    def name(self) -> str:
        """Its name."""
        return self.protocol.name

    @property
    def is_open(self) -> bool:
        """Whether cards can be played.

        It is not closed then, and the terrains of its study are secret.
        """
        return self.closed_ms is None and (self.study is None or self.study.is_open)

    @property
    def commitment(self) -> str:
        """SHA-256 (hex) of the secret."""
        return commitment(self.secret)

    @property
    def policy_files(self) -> PolicyFiles:
        """The kept files of its study's policies."""
        return PolicyFiles() if self.study is None else self.study.policy_files

    def seed(self, index: int) -> int:
        """The seed of an instance."""
        if self.study is not None:
            return self.study.seed("ranked", index)
        return seed(self.secret, self.protocol.hash, "ranked", index)

    def token(self, card: str) -> str:
        """The token of a card: whoever has it plays with the card."""
        return card + signature(self.secret, f"{self.protocol.hash}|card|{card}", TOKEN_LENGTH)

    def link(self, card: str, base: str) -> str:
        """A card's address on the server at `base`."""
        return f"{base.rstrip('/')}/agents/{self.token(card)}"


@dataclass(frozen=True)
class CardRow:
    """A card as it was issued.

    Attributes:
        number: Counts the cards of its author from 1.
        moved_ms: Of its last move.
    """

    id: str
    evaluation: str
    author: str
    number: int
    issued_ms: int
    revoked_ms: int | None
    closed_ms: int | None
    description: str
    moved_ms: int | None

    @property
    def note(self) -> str | None:
        """What a receipt says of a further card of an author."""
        if self.number == 1:
            return None
        return f"card {self.number} of this author: it {SEEN_BEFORE}, and does not rank"


@dataclass(frozen=True)
class Attempt:
    """An attempt at an instance.

    Attributes:
        came_to: None while it runs.
        moves: How many it has.
    """

    id: int
    card: str
    instance: int
    started_ms: int
    ended_ms: int | None
    came_to: EpisodeEnding | None
    moves: int


def published_folder(database: Path, name: str) -> Path:
    """Where a closed evaluation publishes its files."""
    return database.with_name(f"{database.name}-agents") / name


def create_tables(conn: sqlite3.Connection) -> None:
    """Create the evaluations' tables if they are not there yet."""
    for statement in TABLES:
        conn.execute(statement)


@contextmanager
def changing(database: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection that writes the evaluations' tables, in one transaction.

    The database is created if it is absent.
    """
    if not database.exists():
        open_database(database).close()
    with writing(database) as conn:
        create_tables(conn)
        yield conn


@contextmanager
def looking(database: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection that reads the evaluations' tables.

    They are there afterwards.
    """
    with changing(database):
        pass
    with reading(database) as conn:
        yield conn


def evaluations(conn: sqlite3.Connection, folder: Folder) -> list[Evaluation]:
    """All evaluations, by name; StudyError if the study of one is damaged."""
    stored = rows(conn, "SELECT * FROM agents_evaluations ORDER BY name")
    return [_evaluation(row, folder) for row in stored]


def find_evaluation(conn: sqlite3.Connection, folder: Folder, name: str) -> Evaluation:
    """The evaluation of a name; EvaluationError if there is none."""
    for row in rows(conn, "SELECT * FROM agents_evaluations WHERE name = ?", name):
        return _evaluation(row, folder)
    names = ", ".join(row[0] for row in conn.execute("SELECT name FROM agents_evaluations"))
    raise EvaluationError(
        f"no evaluation {name!r}; there are: {names or 'none'} (`humanplay agents new` begins one)"
    )


def _evaluation(row: dict[str, Any], folder: Folder) -> Evaluation:
    protocol = Protocol.model_validate_json(row["protocol"])
    study = None
    if protocol.study is not None:
        study = folder.study(protocol.study.name)
        if not is_same_study(study, protocol.study):
            raise EvaluationError(
                f"the evaluation {protocol.name!r} is of another study {study.name!r} than the one in {folder.root}: "
                "put that back"
            )
    secret = bytes.fromhex(row["secret"])
    return Evaluation(protocol, secret, row["frozen_ms"], row["closed_ms"], study)


def begin_evaluation(
    database: Path,
    folder: Folder,
    wanted: dict[str, Any],
    now_ms: int,
    draw: Callable[[int], bytes] = secrets.token_bytes,
) -> Evaluation:
    """Fix a new evaluation.

    Args:
        wanted: The fields of its protocol; with `study` the name of a study, the task is that
            study's.
        draw: Gives so many random bytes for the secret.

    Raises:
        EvaluationError: If it cannot be played.
    """
    wanted, study = dict(wanted), None
    if (name := wanted.pop("study", None)) is not None:
        study = folder.study(name)
        if not study.is_open:
            raise EvaluationError(
                f"the study {name!r} was closed without --keep-secret, and its terrains are known: --task evaluates agents "
                "on instances of their own"
            )
        wanted |= {
            "task": study.protocol.task,
            "config": study.protocol.config,
            "instances": study.protocol.ranked,
            "policies": study.protocol.policies,
            "study": PlayedStudy(
                name=name, protocol_hash=study.protocol_hash, commitment=study.commitment
            ),
        }
    environment = environment_of(wanted["task"])
    config = environment.configuration(wanted["config"])
    try:
        environment.lock.check_exact(config)
        protocol = Protocol(
            **{**wanted, "config": config.to_dict(), "core_version": environment.version},
            lock=environment.lock.current(),
        )
        evaluation = Evaluation(protocol, draw(32), now_ms, None, study)
        for index in range(protocol.instances):
            environment.instance(config, evaluation.seed(index))
    except ValidationError as error:
        raise EvaluationError(describe_errors(error.errors(include_url=False))) from error
    except ValueError as error:
        raise EvaluationError(f"the evaluation cannot be played: {error}") from error
    with changing(database) as conn:
        for other in evaluations(conn, folder):
            if other.name == protocol.name:
                raise EvaluationError(f"there is an evaluation {protocol.name!r} already")
            if study is not None and other.protocol.study == protocol.study and other.is_open:
                raise EvaluationError(
                    f"the evaluation {other.name!r} plays the terrains of {study.name!r} already: close that first"
                )
        values = (protocol.name, protocol.model_dump_json(), evaluation.secret.hex(), now_ms)
        conn.execute("INSERT INTO agents_evaluations VALUES (?, ?, ?, ?, NULL)", values)
    return evaluation


def cards_of(conn: sqlite3.Connection, name: str) -> list[CardRow]:
    """The cards of an evaluation, in the order of issuing."""
    sql = f"{_CARDS} WHERE c.evaluation = ? ORDER BY c.issued_ms, c.number, c.id"
    return [CardRow(**row) for row in rows(conn, sql, name)]


def card_with_id(conn: sqlite3.Connection, ident: str) -> CardRow | None:
    """The card with an id, None if there is none."""
    for row in rows(conn, f"{_CARDS} WHERE c.id = ?", ident):
        return CardRow(**row)
    return None


def issue_card(
    conn: sqlite3.Connection, evaluation: Evaluation, author: str, now_ms: int
) -> CardRow:
    """Issue a card to an author, numbered among theirs.

    Raises:
        EvaluationError: If the evaluation is closed, or the author is no printable name.
    """
    author = re.sub(r"\s+", " ", author).strip()
    if not evaluation.is_open:
        raise EvaluationError(
            f"the evaluation {evaluation.name!r} is closed: it has no further cards"
        )
    if not (1 <= len(author) <= 100 and author.isprintable()):
        raise EvaluationError(
            f"an author is named by 1 to 100 printable characters, got {author!r}"
        )
    number = 1 + sum(_same(card.author, author) for card in cards_of(conn, evaluation.name))
    ids = {row[0] for row in conn.execute("SELECT id FROM agents_cards")}
    ident = new_id(ids)
    sql = "INSERT INTO agents_cards (id, evaluation, author, number, issued_ms) VALUES (?, ?, ?, ?, ?)"
    conn.execute(sql, (ident, evaluation.name, author, number, now_ms))
    return CardRow(ident, evaluation.name, author, number, now_ms, None, None, "{}", None)


def find_card(conn: sqlite3.Connection, evaluation: str, ident: str) -> CardRow:
    """A card of an evaluation by its id; EvaluationError if there is none."""
    cards = {card.id: card for card in cards_of(conn, evaluation)}
    if ident not in cards:
        ids = ", ".join(cards) or "none"
        raise EvaluationError(f"the evaluation {evaluation!r} has no card {ident!r}; it has {ids}")
    return cards[ident]


def card_of_token(
    conn: sqlite3.Connection, folder: Folder, token: str
) -> tuple[Evaluation, CardRow] | None:
    """The card that a token was signed for, with its evaluation.

    None for any other text, and if the card was revoked or closed.
    """
    card = card_with_id(conn, token[:ID_LENGTH])
    if card is None:
        return None
    evaluation = find_evaluation(conn, folder, card.evaluation)
    if not hmac.compare_digest(token.encode(), evaluation.token(card.id).encode()):
        return None
    holds = card.revoked_ms is None and card.closed_ms is None and evaluation.is_open
    return (evaluation, card) if holds else None


def attempts_of(conn: sqlite3.Connection, card: str) -> list[Attempt]:
    """The attempts of a card, in the order in which they were begun."""
    return [
        Attempt(**{**row, "came_to": row["came_to"] and json.loads(row["came_to"])})
        for row in rows(conn, f"{_ATTEMPTS} WHERE a.card = ? ORDER BY a.id", card)
    ]


def actions_of(conn: sqlite3.Connection, attempt: int) -> bytes:
    """The moves of an attempt, one byte each."""
    sql = "SELECT action FROM agents_moves WHERE attempt = ? ORDER BY step"
    return bytes(row[0] for row in conn.execute(sql, (attempt,)))


def end_attempt(conn: sqlite3.Connection, attempt: int, at_ms: int, came_to: EpisodeEnding) -> None:
    """Write how a running attempt ended; one that has ended stays as it is."""
    sql = "UPDATE agents_attempts SET ended_ms = ?, came_to = ? WHERE id = ? AND ended_ms IS NULL"
    conn.execute(sql, (at_ms, json.dumps(came_to), attempt))


def forget_card(conn: sqlite3.Connection, card: str) -> None:
    """Delete a card, with all that was played with it."""
    conn.execute(
        "DELETE FROM agents_moves WHERE attempt IN (SELECT id FROM agents_attempts WHERE card = ?)",
        (card,),
    )
    conn.execute("DELETE FROM agents_attempts WHERE card = ?", (card,))
    conn.execute("DELETE FROM agents_cards WHERE id = ?", (card,))


def cause_of(protocol: Protocol, number: int) -> DrawnInstance:
    """What fixes an episode on the instance of a seed."""
    return draw_instance(protocol.environment, protocol.env_config, number)


def simulate_episode(protocol: Protocol, number: int, actions: bytes) -> EpisodeEnding:
    """How an episode on a seed ends.

    Raises:
        ValueError, RuntimeError: If its actions do not fit.
    """
    return ending_of(protocol.environment.replay(cause_of(protocol, number), actions, True))


def ending_of(run: Run) -> EpisodeEnding:
    """How a run ended."""
    record = run.record()
    return {
        "outcome": record.outcome,
        "steps": record.steps,
        "score": record.score,
        "total": record.total,
        "trajectory_hash": record.trajectory_hash,
    }


def _same(one: str, other: str) -> bool:
    """Whether two authors are one, whatever the case and marks between the letters."""
    plain = [re.sub(r"\W+", "", author).casefold() for author in (one, other)]
    return plain[0] == plain[1] or one == other
