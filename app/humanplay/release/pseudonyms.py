"""A study's rows with pseudonyms instead of ids, written into an empty database.

Nothing is copied as a file. Identities, cookies' keys, completion codes and everything of other studies stay behind, and so
do people who did not agree to the consent text, and episodes that were never finished.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import sqlite3
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from humanplay.db import chain
from humanplay.db.columns import TABLES
from humanplay.db.database import Row, open_database, rows, stream, transaction
from humanplay.db.erasure import ANSWERS, ARRIVALS, ERASED
from humanplay.db.rows import ErasedPerson, NotedArrivals
from humanplay.db.series import DRY_RUNS
from humanplay.db.study_rows import Participant
from humanplay.release.errors import ReleaseError
from humanplay.study.flow import Arrivals, arrivals_of, with_invitations, with_noted
from humanplay.study.invitations import Invitation
from humanplay.study.language_counts import ANOTHER_LANGUAGE, count_languages

_NOT_WITHIN_A_WORD = r"(?:(?<!\w)|(?!\w))"
_LONG_ID = 5
"""Characters of an id from which on it is no part of a text by chance."""
PREFIXES = {"participants": "P", "players": "B", "sessions": "S"}
KEPT_SETTINGS = ("modality", "palette", "keys", "language")
_AGREED = "study = ? AND consent_ms IS NOT NULL ORDER BY joined_ms, id"
_PEOPLE = f"SELECT * FROM participants WHERE {_AGREED}"
_OF = "participant_id IN (SELECT id FROM participants WHERE study = ? AND consent_ms IS NOT NULL)"
_EPISODE_IDS = (
    f"SELECT episode_id FROM series_episodes WHERE {_OF}"
    " AND episode_id IN (SELECT id FROM episodes WHERE ended_ms > 0)"
)
_QUESTION = "participant_id, block, turn, question"
_SELECTS = {
    "episodes": f"SELECT * FROM episodes WHERE id IN ({_EPISODE_IDS}) ORDER BY started_ms, id",
    "steps": f"SELECT * FROM steps WHERE episode_id IN ({_EPISODE_IDS}) ORDER BY episode_id, step",
    "series_episodes": f"SELECT * FROM series_episodes WHERE episode_id IN ({_EPISODE_IDS}) ORDER BY episode_id",
    "input_events": f"SELECT * FROM input_events WHERE episode_id IN ({_EPISODE_IDS}) ORDER BY episode_id, number",
    "stage_events": f"SELECT * FROM stage_events WHERE {_OF} ORDER BY participant_id, number",
    "answers": f"SELECT * FROM answers WHERE {_OF} ORDER BY {_QUESTION}, part",
    "free_texts": f"SELECT * FROM free_texts WHERE {_OF} ORDER BY {_QUESTION}",
}
MASKED = "[masked]"
"""What stands in a free text where it named somebody."""
_NAMES_SOMEBODY = re.compile(
    r"""\S+@\S+\.\w+ | https?://\S+ | www\.\S+ | (?<!\w)@\w+ | \+?\d[\d ()/.-]{5,}\d""", re.VERBOSE
)
"""An address of a person or a page, a name in a network, a long number."""


@dataclass(frozen=True)
class ReleasedAnswers:
    """What a release holds of the answers to questions about people.

    Attributes:
        counts: JSON of how many people gave which answer.
        numbers: Whether each answer is in it.
        texts: Whether each free text is, masked.
    """

    counts: str = "[]"
    numbers: bool = False
    texts: bool = False

    def leaves_out(self, table: str) -> bool:
        """Whether a table of answers stays behind."""
        return (table == "answers" and not self.numbers) or (
            table == "free_texts" and not self.texts
        )


class Pseudonyms:
    """Pseudonyms by a release's key, without which nobody can find a pseudonym's id."""

    def __init__(self, key: bytes) -> None:
        self._key = key
        self.known: dict[str, str] = {}

    def of(self, table: str, ident: str | None) -> str | None:
        """Return the pseudonym of an id, remembered; None for none."""
        if ident is None:
            return None
        pseudonym = self.once(PREFIXES[table], ident, table)
        assert pseudonym is not None
        self.known[ident] = pseudonym
        return pseudonym

    def once(self, prefix: str, ident: str | None, table: str = "") -> str | None:
        """The pseudonym of an id that occurs in no other text; None for None."""
        if ident is None:
            return None
        message = f"{table or prefix}|{ident}".encode()
        return prefix + hmac.new(self._key, message, hashlib.sha256).hexdigest()[:12]


def write_pseudonymized(
    source: sqlite3.Connection,
    study: str,
    target: Path,
    key: bytes,
    closed: tuple[int | None, str | None],
    arrivals: Arrivals,
    answers: ReleasedAnswers,
) -> dict[str, int]:
    """Write a study's rows into a new database with a chain of its own.

    source  a connection that reads one moment
    key     of this release's pseudonyms; forget it afterwards
    closed  (closed_ms, the secret in hex) of a closed study, (None, None) of an open one
    arrivals  people who stay out, counted
    """
    pseudonyms = Pseudonyms(key)
    conn: sqlite3.Connection = open_database(target).conn
    try:
        with transaction(conn):
            conn.execute("PRAGMA defer_foreign_keys = ON")
            conn.execute("INSERT INTO meta VALUES (:name, :value)", _arrivals_row(study, arrivals))
            if answers.counts != "[]":
                noted = {"name": f"{ANSWERS}|{study}", "value": answers.counts}
                conn.execute("INSERT INTO meta VALUES (:name, :value)", noted)
            for name, row in _rows(source, study, pseudonyms, closed, answers):
                table = TABLES[name]
                conn.execute(table.insert(), [row[column] for column in table.names()])
            chain.append_all(conn, chain.things(conn))
            chain.append_marks(conn, chain.stored_marks(source, study))
        conn.execute("PRAGMA journal_mode = DELETE")
        conn.execute("VACUUM")
    finally:
        conn.close()
    return _left_out(source, study)


def _rows(
    source: sqlite3.Connection,
    study: str,
    pseudonyms: Pseudonyms,
    closed: tuple[int | None, str | None],
    answers: ReleasedAnswers,
) -> Iterator[tuple[str, Row]]:
    for row in rows(source, "SELECT * FROM meta WHERE name LIKE ?", f"{ERASED}|{study}|%"):
        erased: ErasedPerson = json.loads(row["value"])
        # their place among people is a trace; the arm alone is counted
        yield "meta", {**row, "value": json.dumps({**erased, "arm_number": None})}
    row = rows(source, "SELECT * FROM series WHERE name = ?", study)[0]
    yield "series", {**row, "closed_ms": closed[0], "secret": closed[1]}
    people = [Participant(**row) for row in rows(source, _PEOPLE, study)]
    yield from _players_and_sessions(source, study, people, pseudonyms)
    for person in people:
        pseudonyms.of("participants", person.id)
    pseudonymizer = RowPseudonymizer(pseudonyms, _identities(source, study))
    languages = _named_languages(people)
    for person in people:
        invitation = pseudonyms.once("I", person.invitation)
        yield (
            "participants",
            pseudonymizer.row(
                "participants", {**_without_traces(person, languages), "invitation": invitation}
            ),
        )
    for table, sql in _SELECTS.items():
        if answers.leaves_out(table):
            continue
        for row in stream(source, sql, study):
            if table == "free_texts":
                row["words"] = pseudonymizer.masked(row["words"])
            if table == "stage_events" and row["kind"] == "settings":
                row["detail"] = _without_language(row["detail"])
            yield table, pseudonymizer.row(table, row)


def _without_traces(person: Participant, languages: Container[str]) -> Row:
    """A participant's row without completion code and without settings but covariates.

    Args:
        languages: Those that are released.
    """
    settings = json.loads(person.settings)
    covariates = {name: settings[name] for name in KEPT_SETTINGS if name in settings}
    if covariates.get("language") not in languages:
        covariates.pop("language", None)
    text = json.dumps(covariates, sort_keys=True)
    return {**vars(person), "completion_code": None, "settings": text}


def _named_languages(people: Iterable[Participant]) -> Container[str]:
    """The languages that nobody stands nearly alone with."""
    humans = (person for person in people if person.kind == "human")
    read = count_languages(json.loads(person.settings).get("language") for person in humans)
    return read.keys() - {ANOTHER_LANGUAGE}


def _without_language(detail: str) -> str:
    """A change of settings without the language, which the participant's row has."""
    settings = json.loads(detail)
    settings.pop("language", None)
    return json.dumps(settings, sort_keys=True)


def _players_and_sessions(
    source: sqlite3.Connection, study: str, people: list[Participant], pseudonyms: Pseudonyms
) -> Iterator[tuple[str, Row]]:
    """Return the players and sessions that the people and their episodes refer to."""
    played_on = f"SELECT DISTINCT session_id FROM episodes WHERE id IN ({_EPISODE_IDS})"
    used = {row["session_id"] for row in rows(source, played_on, study)}
    used |= {person.session_id for person in people if person.session_id}
    one = "SELECT * FROM sessions WHERE id = ?"
    sessions = [row for ident in sorted(used) for row in rows(source, one, ident)]
    players: set[str | None] = {person.player_id for person in people}
    players |= {row[name] for row in sessions for name in ("player_id", "owner_id")}
    for ident in sorted(player for player in players if player is not None):
        for row in rows(source, "SELECT * FROM players WHERE id = ?", ident):
            yield "players", {**row, "id": pseudonyms.of("players", ident)}
    for row in sorted(sessions, key=lambda row: row["created_ms"]):
        owners = {name: pseudonyms.of("players", row[name]) for name in ("player_id", "owner_id")}
        session = pseudonyms.of("sessions", row["id"])
        yield "sessions", {**row, **owners, "id": session, "rival_of": None}


class RowPseudonymizer:
    """Replaces every id in a row by its pseudonym, inside free text too."""

    def __init__(self, pseudonyms: Pseudonyms, identities: Mapping[str, str]) -> None:
        self._pseudonyms = pseudonyms
        self._identities = identities
        self._texts: dict[str, str] = {}

    def row(self, table: str, row: Row) -> Row:
        """Return the row renamed; ReleaseError when its free text holds an identity."""
        if table == "episodes":
            row["failure"] = None  # its author's paths
        of_columns = {name: of for name, (of, _) in TABLES[table].references().items()}
        if table in PREFIXES:
            of_columns["id"] = table
        for name, of in of_columns.items():
            ident = row[name]
            if of in PREFIXES and isinstance(ident, str):
                row[name] = self._pseudonyms.of(of, ident)
        for column in TABLES[table].columns("database"):
            text = row[column.name]
            if column.is_free and isinstance(text, str):
                row[column.name] = self._text(text, f"{table}.{column.name}")
        return row

    def masked(self, words: str | None) -> str | None:
        """A free text without addresses, long numbers and outside ids."""
        if words is None:
            return None
        for ident in sorted(self._identities, key=len, reverse=True):
            words = re.sub(_as_word(ident), MASKED, words, flags=re.IGNORECASE)
        return _NAMES_SOMEBODY.sub(MASKED, words)

    def _text(self, text: str, place: str) -> str:
        if text not in self._texts:
            leaves = _leaves(text)
            for ident, name in self._identities.items():
                if any(_holds(leaf, ident) for leaf in leaves):
                    raise ReleaseError(
                        f"{place} holds somebody's {name}: nothing was written; "
                        "correct that row and try again"
                    )
            replaced = text
            for ident, pseudonym in self._pseudonyms.known.items():
                replaced = replaced.replace(ident, pseudonym)
            self._texts[text] = replaced
        return self._texts[text]


def _leaves(text: str) -> list[str]:
    """Every text in a JSON object or array; of anything else the text itself."""
    try:
        content = json.loads(text)
    except ValueError:
        return [text]
    return list(_texts_in(content)) if isinstance(content, (dict, list)) else [text]


def _holds(text: str, ident: str) -> bool:
    """Whether a text is an id or holds a long one, not as a part of a longer word."""
    if len(ident) < _LONG_ID or ident not in text:
        return text == ident
    return re.search(_as_word(ident), text) is not None


def _as_word(ident: str) -> str:
    """The pattern of an id that is no part of a longer word."""
    return _NOT_WITHIN_A_WORD + re.escape(ident) + _NOT_WITHIN_A_WORD


def _texts_in(content: object) -> Iterator[str]:
    """Yield every text in parsed JSON, names of fields too."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, dict):
        for name, part in content.items():
            yield name
            yield from _texts_in(part)
    elif isinstance(content, list):
        for part in content:
            yield from _texts_in(part)


def _identities(source: sqlite3.Connection, study: str) -> dict[str, str]:
    """Return the names of the outside ids of a study's people, by the id."""
    sql = "SELECT name, value FROM identities WHERE participant_id IN (SELECT id FROM participants WHERE study = ?)"
    return {value: name for name, value in source.execute(sql, [study])}


def _left_out(source: sqlite3.Connection, study: str) -> dict[str, int]:
    """How many unfinished episodes, and people without consent, a release leaves out."""
    sql = f"""SELECT (SELECT count(*) FROM series_episodes WHERE {_OF}) - (SELECT count(*) FROM ({_EPISODE_IDS})),
        (SELECT count(*) FROM participants WHERE study = ? AND consent_ms IS NULL)"""
    counts = source.execute(sql, (study, study, study)).fetchone()
    return dict(zip(("open_episodes", "without_consent"), counts, strict=True))


def count_arrivals(
    conn: sqlite3.Connection, study: str, invitations: Mapping[str, Invitation] | None
) -> Arrivals:
    """Return the arrivals of a study in the database that a release is made from.

    invitations  of the study by id, where its folder is at hand
    """
    left_as = """(SELECT json_extract(v.detail, '$.outcome') FROM stage_events v
        WHERE v.participant_id = p.id AND v.kind = 'withdrawn')"""
    undecided = f"""SELECT coalesce(sum(stage = 'withdrawn' AND {left_as} IS NULL), 0) AS declined,
        coalesce(sum(stage <> 'withdrawn'), 0) AS undecided,
        coalesce(sum({left_as} IS 'unfit_device'), 0) AS unfit,
        coalesce(sum({left_as} IS 'over_quota'), 0) AS over_quota
        FROM participants p WHERE study = ? AND kind = 'human' AND consent_ms IS NULL"""
    (counted,) = rows(conn, undecided, study)
    erased = rows(conn, "SELECT value FROM meta WHERE name LIKE ?", f"{ERASED}|{study}|%")
    before = NotedArrivals()
    for row in rows(conn, "SELECT value FROM meta WHERE name = ?", f"{ARRIVALS}|{study}"):
        before = json.loads(row["value"])
    people = [json.loads(row["value"]) for row in erased]
    (dry_runs,) = rows(conn, DRY_RUNS, study)
    arrivals = with_noted(arrivals_of(**counted, **dry_runs, erased=people), before)
    if invitations is None:
        return arrivals
    sql = "SELECT invitation FROM participants WHERE study = ? AND invitation IS NOT NULL"
    opened = rows(conn, sql, study)
    return with_invitations(arrivals, invitations, [row["invitation"] for row in opened])


def _arrivals_row(study: str, arrivals: Arrivals) -> dict[str, str]:
    """The row of `meta` that holds a study's arrivals, without erased people."""
    counts = {name: n for name, n in asdict(arrivals).items() if not name.startswith("erased")}
    return {"name": f"{ARRIVALS}|{study}", "value": json.dumps(counts, sort_keys=True)}
