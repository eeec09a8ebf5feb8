"""Erases a person for good from the database and its log.

Hashes of the person and of the erased trajectories stay, so that a merge or an import cannot bring
them back: the table `forgotten` holds an episode's trajectory at its time; `forgotten_people` a
participant's id and, under any pseudonym, the time when they came. Their entries in the chain stay
too; nobody can read them any longer, since their salts are deleted.
"""

from __future__ import annotations

import hashlib
import json
import secrets
import sqlite3
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from humanplay.db import chain, names, volunteers
from humanplay.db.backup import check_room
from humanplay.db.chain import Thing
from humanplay.db.database import (
    COUNT_COMMIT,
    RUNS,
    StoreError,
    check_writable,
    open_database,
    reading,
    rows,
    transaction,
)
from humanplay.db.file import DatabaseLock, log_path, note_commit, recordings_beside
from humanplay.db.recording_files import (
    UNENDED_ERASURE,
    delete_marked,
    mark_for_deletion,
    recorded_episodes,
)
from humanplay.db.releases import mark_outdated_releases
from humanplay.db.rows import AskedBy, ErasedPerson
from humanplay.db.study_rows import ARM_EVENT, Participant, SeriesRow, participant_label
from humanplay.task import counted

FORGOTTEN_TABLES = ("forgotten", "forgotten_people")
ERASED = "erased"
"""Rows of the table `meta` called `erased|STUDY|HASH` count the people who were erased from each study (`note_erased`)."""

ARRIVALS = "arrivals"
"""A row of `meta` called `arrivals|STUDY` counts the people whom a release of that study left out; the value is JSON."""

ANSWERS = "answers"
"""A row of `meta` called `answers|STUDY` holds how many people gave which answer, as a release noted it; the value is JSON."""

WITHIN_S = 60.0
"""Seconds within which the bytes of what was erased are gone from file and log, or it is said why they are not."""

TRAJECTORY = "e.trajectory_hash, e.started_ms, e.ended_ms"
"""The arguments of `trajectory_hash`, as SQL columns of an episode `e`."""


@dataclass(frozen=True)
class Erasure:
    """What was erased.

    Attributes:
        episodes: How many were erased, those played outside the study too.
        keeps: Whether the protocol keeps episodes: they stay, under new ids.
        outdated: Versions of the study's releases that hold the person.
    """

    study: str
    episodes: int
    keeps: bool
    outdated: tuple[int, ...]


class ParticipantLookupError(StoreError):
    """A name stands for no participant, or for several; the text says what to do."""


def find_participant(database: Path, name: str, study: str | None = None) -> Participant:
    """The one participant with this id, label or outside id, in one study or in all.

    Raises:
        ParticipantLookupError: If there is none, or several.
    """
    with reading(database) as conn:
        return _find(conn, database, name, study)


def identity_of_person(database: Path, person: Participant) -> str | None:
    """The value of the study's first outside id for a participant; None without one."""
    sql = """SELECT value FROM identities i JOIN series s ON s.name = ?
        WHERE participant_id = ? AND i.name = json_extract(s.protocol, '$.outside_ids[0]')"""
    with reading(database) as conn:
        row = conn.execute(sql, (person.study, person.id)).fetchone()
    return None if row is None else str(row[0])


def forget(
    database: Path, name: str, study: str | None = None, asked_by: AskedBy | None = None
) -> Erasure:
    """Erase a participant and rewrite the file.

    A server may run meanwhile; it unloads the person's board.

    Args:
        name: The participant's id, the label on their page, or an outside id.
        asked_by: Who asked for it. None: the participant, if they asked on their page; else unknown.
    """
    with _lock_unless_served(database) as lock, _rewritten(database, lock) as conn:
        return _erase_rows(conn, _find(conn, database, name, study), asked_by)


def finish_erasure(database: Path) -> None:
    """Finish an erasure that was killed before the file was written anew."""
    with reading(database) as conn:
        is_interrupted = conn.execute(
            "SELECT 1 FROM meta WHERE name = ?", [UNENDED_ERASURE]
        ).fetchone()
    if is_interrupted:
        with _lock_unless_served(database) as lock, _rewritten(database, lock):
            pass


@contextmanager
def _lock_unless_served(database: Path) -> Iterator[DatabaseLock | None]:
    """Keep servers out of the database during the block; None if one has it."""
    check_writable(database)  # the lock would wait for the other end of a pipe
    try:
        lock = DatabaseLock(database)
    except StoreError:
        yield None
        return
    with closing(lock):
        yield lock


@contextmanager
def _rewritten(database: Path, lock: DatabaseLock | None) -> Iterator[sqlite3.Connection]:
    """Let the block delete rows, then rewrite the file and empty its log.

    Args:
        lock: Keeps servers out; None if one may go on writing.

    Raises:
        StoreError: If the disk has too little room for a copy of the database, or another program
            reads an older moment for so long that copies stay in the log. The text says what is
            left to do.
    """
    if not database.exists():
        raise StoreError(f"no database at {database}: give its path with --database")
    try:
        conn: sqlite3.Connection = open_database(database).conn
        try:
            check_room(conn, database.parent, "make room there; nothing was erased")
            # the deleted rows of this transaction are overwritten even before the file is written anew
            conn.execute("PRAGMA secure_delete = ON")
            # the commit is on the disk before recordings are deleted, which nothing would bring back
            conn.execute("PRAGMA synchronous = FULL")
            with transaction(conn):
                conn.execute("PRAGMA defer_foreign_keys = ON")
                recorded = recorded_episodes(conn, recordings_beside(database))
                yield conn
                mark_for_deletion(conn, database, recorded)
                (commits,) = conn.execute(COUNT_COMMIT).fetchone()
                if lock is not None:  # a file that is written anew has nothing to compare
                    conn.execute("DELETE FROM meta WHERE name = ?", [RUNS])
            if lock is None:
                note_commit(database, commits)
            else:
                lock.clear_note()
            delete_marked(conn, database)  # after the commit: a failed erasure takes nothing away
            _write_anew(conn, database)
            conn.execute("DELETE FROM meta WHERE name = ?", [UNENDED_ERASURE])
        finally:
            conn.close()
    except sqlite3.Error as error:
        raise StoreError(
            f"the database {database} did not take the erasure: {error}; try again"
        ) from error


def _write_anew(conn: sqlite3.Connection, database: Path) -> None:
    """Rewrite every page of the file, and empty the log.

    Raises:
        StoreError: If that fails or takes too long; the text says what is left to do.
    """
    until, command = time.monotonic() + WITHIN_S, f"sqlite3 {database}"
    while True:
        try:
            conn.execute("VACUUM")
            break
        except sqlite3.Error as error:
            if "locked" in str(error) and time.monotonic() < until:
                continue
            way_out = (
                "end the other program that has it open"
                if "locked" in str(error)
                else "make room, also where temporary files are"
            )
            raise StoreError(
                f"the database {database} erased the rows, but could not be written anew: {error}; {way_out}, and "
                f"run `{command} VACUUM`"
            ) from error
    while conn.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]:
        if time.monotonic() >= until:
            raise StoreError(
                f"the database {database} erased the rows, but another program still reads an older moment of it, and copies "
                f"stay in it and in {log_path(database)}: end that program, then run "
                f"`{command} 'PRAGMA wal_checkpoint(TRUNCATE)'`"
            )
        time.sleep(0.2)


def unlink(database: Path, study: SeriesRow) -> int:
    """Delete all outside ids and completion codes of a study; return how many had one.

    Invitations get new ids, equal ones for equal ones. The chain notes it, and the file is rewritten.
    """
    # no invitation that was issued begins as another one's
    linked = """SELECT id, invitation FROM participants p WHERE study = ? AND (completion_code IS NOT NULL
        OR invitation NOT LIKE 'I%' OR EXISTS (SELECT 1 FROM identities WHERE participant_id = p.id)) ORDER BY id"""
    other_ids = defaultdict[str, str](_other_invitation)
    with _lock_unless_served(database) as lock, _rewritten(database, lock) as conn:
        people = conn.execute(linked, [study.name]).fetchall()
        for person, invitation in people:
            with chain.changing(conn, "participant", person):
                conn.execute("DELETE FROM identities WHERE participant_id = ?", [person])
                sql = "UPDATE participants SET completion_code = NULL, invitation = ? WHERE id = ?"
                conn.execute(sql, [invitation and other_ids[invitation], person])
        chain.append_marks(conn, [chain.act_of(study, "unlinked", people=len(people))])
    return len(people)


def _find(conn: sqlite3.Connection, database: Path, name: str, study: str | None) -> Participant:
    sql = """SELECT DISTINCT p.* FROM participants p LEFT JOIN identities i ON i.participant_id = p.id
        WHERE (p.id = ?1 OR i.value = ?1 OR label(p.id) = upper(?1))
        AND (?2 IS NULL OR p.study = ?2)"""
    conn.create_function("label", 1, participant_label, deterministic=True)
    people = [Participant(**row) for row in rows(conn, sql, name, study)]
    if not people:
        place = f"the study {study!r} of {database}" if study else str(database)
        raise ParticipantLookupError(
            f"no participant {name!r} in {place}: give their id, label or the outside id of their link"
        )
    if len(people) > 1:
        studies = ", ".join(sorted({person.study for person in people}))
        raise ParticipantLookupError(
            f"{name!r} stands for {counted(len(people), 'participant')} (studies: {studies}): give --study, or "
            "one participant's id; nothing was erased"
        )
    return people[0]


def _erase_rows(conn: sqlite3.Connection, person: Participant, asked_by: AskedBy | None) -> Erasure:
    now = int(time.time() * 1000)
    protocol, closed_ms = conn.execute(
        "SELECT protocol, closed_ms FROM series WHERE name = ?", [person.study]
    ).fetchone()
    keeps = bool(json.loads(protocol).get("keep_episodes_when_forgotten", False))
    # if the episodes stay, the time of coming stays too, so only the id is forgotten
    hashes = person_hashes(person)[:1] if keeps else person_hashes(person)
    if person.invitation is not None and person.consent_ms is not None:
        hashes = (*hashes, invitation_hash(person.study, person.invitation))
    forgotten = [(hash_, now) for hash_ in hashes]
    conn.executemany("INSERT OR IGNORE INTO forgotten_people VALUES (?, ?)", forgotten)
    if not keeps and person.kind == "human":
        asked = asked_by or ("participant" if asks_erasure(conn, person.id) else None)
        note_erased(conn, person, now, closed_ms is not None, asked)
    sql = "SELECT session_id FROM participants WHERE player_id = ? AND id <> ?"
    elsewhere = conn.execute(sql, (person.player_id, person.id)).fetchall()
    sessions = _sessions_of(conn, person, {row[0] for row in elsewhere})
    entries = _entries_of(conn, person, sessions)
    # what did not fit its entry in the chain must not fit its new entry either
    hashes_now = {
        thing: chain.unsound_hash(conn, thing.kind, thing.id) for thing in entries if keeps
    }
    unsound = {thing: hash_ for thing, hash_ in hashes_now.items() if hash_}
    for table in ("identities", "answers", "free_texts"):
        conn.execute(f"DELETE FROM {table} WHERE participant_id = ?", [person.id])
    new = _rename(conn, person) if keeps else {}
    of_session = "SELECT id FROM episodes WHERE session_id = ?"
    episodes = [row[0] for session in sessions for row in conn.execute(of_session, [session])]
    _delete_episodes(conn, episodes, now)
    outdated: tuple[int, ...] = ()
    if not keeps:
        conn.execute("DELETE FROM stage_events WHERE participant_id = ?", [person.id])
        conn.execute("DELETE FROM participants WHERE id = ?", [person.id])
        outdated = mark_outdated_releases(conn, person.study, person.joined_ms, now)
    for session in sessions:
        conn.execute("DELETE FROM sessions WHERE id = ?", [session])
    _forget_challenges(conn)
    volunteers.renew(conn)
    if not elsewhere:
        _delete_player(conn, person.player_id)
    _renew_chain(conn, entries, unsound, new)
    return Erasure(person.study, len(episodes), keeps, outdated)


def forget_player(database: Path, name: str) -> int:
    """Erase a player by their chosen name, and their episodes; return how many.

    Raises:
        ParticipantLookupError: If nobody has the name.
        StoreError: While a server has the database: it would not know that boards are gone.
    """
    with closing(DatabaseLock(database)) as lock, _rewritten(database, lock) as conn:
        player = _named(conn, database, name)
        now = int(time.time() * 1000)
        of_player = """SELECT id FROM sessions s WHERE ?1 IN (player_id, owner_id)
            AND NOT EXISTS (SELECT 1 FROM participants p WHERE p.session_id = s.id)"""
        sessions = [row[0] for row in conn.execute(of_player, [player])]
        of_session = "SELECT id FROM episodes WHERE session_id = ?"
        episodes = [row[0] for session in sessions for row in conn.execute(of_session, [session])]
        things = [Thing("session", session) for session in sessions]
        things += [Thing("episode", episode) for episode in episodes]
        _delete_episodes(conn, episodes, now)
        conn.executemany("DELETE FROM sessions WHERE id = ?", [(session,) for session in sessions])
        _forget_challenges(conn)
        volunteers.renew(conn)
        _delete_player(conn, player)
        _renew_chain(conn, things, {}, {})
    return len(episodes)


def find_player(database: Path, name: str) -> None:
    """Raise ParticipantLookupError unless a player of the database chose this name."""
    with reading(database) as conn:
        _named(conn, database, name)


def _named(conn: sqlite3.Connection, database: Path, name: str) -> str:
    if (player := names.named(conn, name)) is None:
        raise ParticipantLookupError(
            f"no player of {database} chose the name {name!r}: the page /leaderboard has the names"
        )
    return player


def _delete_player(conn: sqlite3.Connection, player_id: str) -> None:
    """Delete a player's name and row; the row stays where a study knows it."""
    conn.execute("DELETE FROM names WHERE player_id = ?", [player_id])
    names.forget_invitation(conn, player_id)
    sql = "DELETE FROM players WHERE id = ?1 AND NOT EXISTS (SELECT 1 FROM participants WHERE player_id = ?1)"
    conn.execute(sql, [player_id])


def _entries_of(
    conn: sqlite3.Connection, person: Participant, sessions: Sequence[str]
) -> list[Thing]:
    """What may have an entry in the chain: the person, their sessions and episodes."""
    of_session = "SELECT id FROM episodes WHERE session_id = ?"
    episodes = [row[0] for session in sessions for row in conn.execute(of_session, [session])]
    return [
        Thing("participant", person.id),
        *(Thing("session", session) for session in sessions),
        *(Thing("episode", episode) for episode in episodes),
    ]


def _renew_chain(
    conn: sqlite3.Connection,
    entries: Sequence[Thing],
    unsound: Mapping[Thing, str],
    new: Mapping[str, str],
) -> None:
    """Make the entries unreadable, and append entries of what stays under new ids.

    Args:
        unsound: Entries that did not fit their rows -> the hash that keeps them so.
        new: Old id -> new id; empty if nothing stays.
    """
    chain.forget(conn, entries)
    if new:
        renamed = {thing: Thing(thing.kind, new.get(thing.id, thing.id)) for thing in entries}
        remaining = set(renamed.values()) & chain.things(conn)
        unsound_renamed = {renamed[thing]: hash_ for thing, hash_ in unsound.items()}
        chain.append_all(conn, remaining, unsound_renamed)
    chain.append_marks(conn)


def _sessions_of(
    conn: sqlite3.Connection, person: Participant, others: set[str | None]
) -> list[str]:
    """The person's sessions, without those of participants of other studies."""
    mine = "SELECT id FROM sessions WHERE ?1 IN (player_id, owner_id) OR id = ?2"
    played = """SELECT DISTINCT e.session_id FROM episodes e JOIN series_episodes s ON s.episode_id = e.id
        WHERE s.participant_id {} ?"""
    sessions = {row[0] for row in conn.execute(mine, (person.player_id, person.session_id))}
    sessions |= {row[0] for row in conn.execute(played.format("="), [person.id])}
    others = others | {row[0] for row in conn.execute(played.format("<>"), [person.id])}
    return sorted(sessions - others)


def _delete_episodes(conn: sqlite3.Connection, episodes: Sequence[str], now: int) -> None:
    for ident in episodes:
        sql = f"SELECT {TRAJECTORY} FROM episodes e WHERE e.id = ? AND e.ended_ms IS NOT NULL"
        for driven in conn.execute(sql, [ident]).fetchall():
            values = (trajectory_hash(*driven), now)
            conn.execute("INSERT OR IGNORE INTO forgotten VALUES (?, ?)", values)
        for table in (
            "event_batches",
            "page_loads",
            "input_events",
            "steps",
            "series_episodes",
        ):
            conn.execute(f"DELETE FROM {table} WHERE episode_id = ?", [ident])
        conn.execute("DELETE FROM episodes WHERE id = ?", [ident])


def _forget_challenges(conn: sqlite3.Connection) -> None:
    """Let no board name an episode that is gone as the one it is played against."""
    gone = "challenges NOT IN (SELECT id FROM episodes)"
    conn.execute(f"UPDATE sessions SET challenges = NULL WHERE {gone}")


def _other_invitation() -> str:
    return "I" + secrets.token_hex(6)


def _rename(conn: sqlite3.Connection, person: Participant) -> dict[str, str]:
    """Give participant, player and session new ids, and delete what else names them.

    Returns:
        Old id -> new id.
    """
    old, player = person.id, person.player_id
    session, invitation = person.session_id, person.invitation
    prefixes = ((old, "P"), (player, "B"), (session, "S"), (invitation, "I"))
    new = {ident: prefix + secrets.token_hex(6) for ident, prefix in prefixes if ident}
    sql = "INSERT INTO players SELECT ?, created_ms FROM players WHERE id = ?"
    conn.execute(sql, (new[player], player))
    if session:
        values = (new[session], new[player], new[player], session)
        conn.execute("UPDATE sessions SET id = ?, player_id = ?, owner_id = ? WHERE id = ?", values)
        sql = "UPDATE episodes SET session_id = ? WHERE session_id = ?"
        conn.execute(sql, (new[session], session))
    conn.execute(
        "UPDATE participants SET id = ?, player_id = ?, session_id = ?, completion_code = NULL, invitation = ? WHERE id = ?",
        (new[old], new[player], new.get(session or ""), new.get(invitation or ""), old),
    )
    for table in ("series_episodes", "stage_events"):
        sql = f"UPDATE {table} SET participant_id = ? WHERE participant_id = ?"
        conn.execute(sql, (new[old], old))
    for was, now in new.items():
        conn.execute(
            "UPDATE stage_events SET detail = replace(detail, ?, ?) WHERE participant_id = ?",
            (was, now, new[old]),
        )
    return new


def learn_forgotten(target: sqlite3.Connection, source: sqlite3.Connection) -> None:
    """Add the source's lists of erased people and trajectories to the target's."""
    learn_counts(target, source)
    for table in FORGOTTEN_TABLES:
        target.executemany(
            f"INSERT OR IGNORE INTO {table} VALUES (?, ?)",
            source.execute(f"SELECT * FROM {table}").fetchall(),
        )


def learn_counts(target: sqlite3.Connection, source: sqlite3.Connection) -> None:
    """Add the source's counts of people who were erased or left out."""
    for name in (ERASED, ARRIVALS, ANSWERS):
        counts = source.execute("SELECT * FROM meta WHERE name LIKE ? || '|%'", [name]).fetchall()
        target.executemany("INSERT OR IGNORE INTO meta VALUES (?, ?)", counts)
    chain.append_marks(target, chain.stored_marks(source))


def asks_erasure(conn: sqlite3.Connection, participant_id: str) -> bool:
    """Whether a participant withdrew and asked that what they had played be erased."""
    sql = """SELECT 1 FROM stage_events WHERE participant_id = ? AND kind = 'withdrawn'
        AND json_extract(detail, '$.erase')"""
    return conn.execute(sql, [participant_id]).fetchone() is not None


def note_erased(
    conn: sqlite3.Connection,
    person: Participant,
    at_ms: int,
    is_closed: bool,
    asked_by: AskedBy | None,
) -> None:
    """Count a person who is erased from a study, without what identifies them.

    Call it while their episodes are still there: how many ranked ones they had is noted.
    """
    sql = """SELECT count(*), count(e.ended_ms) FROM series_episodes s JOIN episodes e ON e.id = s.episode_id
        WHERE s.participant_id = ? AND s.phase = 'ranked'"""
    begun, ended = conn.execute(sql, [person.id]).fetchone()
    assigned = """SELECT json_extract(detail, '$.arm'), json_extract(detail, '$.number') FROM stage_events
        WHERE participant_id = ? AND kind = ?"""
    arm, number = conn.execute(assigned, (person.id, ARM_EVENT)).fetchone() or (None, None)
    tombstone: ErasedPerson = {
        "at_ms": at_ms,
        "stage": person.stage,
        "after_closing": is_closed,
        "ranked_begun": begun,
        "ranked_ended": ended,
        "completed": person.completed_ms is not None,
        "asked_by": asked_by,
        "arm": arm,
        "arm_number": number,
    }
    name = f"{ERASED}|{person.study}|{person_hashes(person)[0]}"
    conn.execute("INSERT OR IGNORE INTO meta VALUES (?, ?)", (name, json.dumps(tombstone)))


def person_hashes(person: Participant) -> tuple[str, str]:
    """Hashes of a participant's id and of when they came, for `forgotten_people`."""
    came = f"{person.study}|{person.joined_ms}|{person.consent_ms}"
    return _hash(person.id), _hash(came)


def invitation_hash(study: str, invitation: str) -> str:
    """Hash of a used invitation for `forgotten_people`: it lets nobody in again."""
    return _hash(f"invitation|{study}|{invitation}")


def trajectory_hash(trajectory: str, started_ms: int, ended_ms: int) -> str:
    """Hash of an episode for `forgotten`, with its times: two people may play alike."""
    return _hash(f"{trajectory}|{started_ms}|{ended_ms}")


def forgotten_people(target: sqlite3.Connection, source: sqlite3.Connection) -> list[Participant]:
    """The source's participants whom the target has erased, whatever their ids are."""
    people = {row[0] for row in target.execute("SELECT id_hash FROM forgotten_people")}
    trajectories = {row[0] for row in target.execute("SELECT trajectory_hash FROM forgotten")}
    if not people | trajectories:
        return []
    played = f"""SELECT s.participant_id, {TRAJECTORY} FROM episodes e JOIN series_episodes s ON s.episode_id = e.id
        WHERE e.ended_ms IS NOT NULL"""
    drove = {row[0] for row in source.execute(played) if trajectory_hash(*row[1:]) in trajectories}
    everybody = [Participant(**row) for row in rows(source, "SELECT * FROM participants")]
    return [
        person for person in everybody if person.id in drove or people & set(person_hashes(person))
    ]


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
