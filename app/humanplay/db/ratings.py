"""Names that players gave themselves, the games that they are rated by, and their ratings.

A game is a counted ranked episode beside what policies need on the same terrain, or a day's terrain among people. The games
are kept in the order in which they were rated, so that the ratings follow from them and the episodes alone: `verify` makes
them again. A rating is a Plackett-Luce estimate (openskill); policies are as strong as MEASURED at any time.
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import astuple, dataclass, field
from typing import Any, NamedTuple

from openskill.models import PlackettLuce

from humanplay.db.columns import TABLES
from humanplay.db.database import rows
from humanplay.db.reader import ATTESTED, HUMAN_SCORE_CONDITION, JOINED, TRIAL, Reader
from humanplay.db.resimulation import Finding
from humanplay.db.trial import Trial

MEASURED: Mapping[str, float] = {"ppo": 39.5, "frontier-cost": 25.0}
"""Strength of the policies that people are rated against: `ppo` took fewer moves on 136 and as many on 3 of the 150 terrains of
21x21 cells, level `random`, seeds 1,000,000,000 and the next, which is what the model expects of this difference."""
SURE = 1.0
"""Uncertainty of these strengths."""
MODEL = PlackettLuce()
HEAT = 16
"""People of a day who are compared at a time: the work grows with the square of it."""
LATE_MS = 60_000
"""How much later than others an episode may be recorded and still be rated."""
SHOWN = 100
"""People in the list."""

_DAY_MS = 86_400_000
_NEXT = f"""SELECT * FROM (SELECT e.id, NULL AS day, e.ended_ms AS at_ms FROM episodes e {JOINED} WHERE e.ended_ms > ?1
        AND {HUMAN_SCORE_CONDITION} AND NOT EXISTS (SELECT 1 FROM rated_games g WHERE g.episode_id = e.id)
        ORDER BY e.ended_ms LIMIT 1)
    UNION ALL SELECT * FROM (SELECT NULL, y.name, y.closed_ms FROM series y WHERE y.name GLOB 'daily:*' AND y.closed_ms > ?1
        AND y.closed_ms + {LATE_MS} <= ?2 AND NOT EXISTS (SELECT 1 FROM rated_games g WHERE g.day = y.name)
        ORDER BY y.closed_ms LIMIT 1)
    ORDER BY at_ms LIMIT 1"""
_EPISODE = f"SELECT {TRIAL} FROM episodes e {JOINED} WHERE e.id = ?"
_OF_DAY = f"""SELECT x.player_id, e.outcome, e.steps, e.discovered FROM series_episodes x JOIN episodes e ON e.id = x.episode_id
    WHERE x.series = ?1 AND {ATTESTED} AND e.ended_ms < ?2 ORDER BY e.ended_ms, e.id"""
_PEOPLE = """SELECT n.name, r.* FROM names n JOIN ratings r ON r.player_id = n.player_id WHERE NOT n.hidden
    ORDER BY r.rating DESC, n.chosen_ms LIMIT ?"""
_STANDING = """SELECT n.name, n.hidden, r.*, EXISTS (SELECT 1 FROM rated_games WHERE episode_id = ?2) AS rated
    FROM (SELECT ?1 AS id) p LEFT JOIN names n ON n.player_id = p.id LEFT JOIN ratings r ON r.player_id = p.id"""


class Game(NamedTuple):
    """A game that is to be rated: an episode's, or a day's."""

    episode_id: str | None
    day: str | None
    at_ms: int


class NameTakenError(ValueError):
    """Somebody has this name, or one that looks like it."""


@dataclass
class Rating:
    """Of one player, as the table keeps it."""

    mu: float = MODEL.mu
    sigma: float = MODEL.sigma
    before: float | None = None
    games: int = 0
    days: int = 0
    beaten: dict[str, int] = field(default_factory=dict)

    @property
    def shown(self) -> float:
        """What pages show: 1,000 for a newcomer."""
        return shown(self.mu, self.sigma)

    def row(self, player_id: str) -> tuple[Any, ...]:
        """Return the row of the table."""
        beaten = json.dumps(self.beaten, sort_keys=True)
        shown = self.shown, self.before
        return player_id, self.mu, self.sigma, *shown, self.games, self.days, beaten

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Rating:
        """Return that of a row."""
        beaten = json.loads(row["beaten"])
        return cls(row["mu"], row["sigma"], row["before"], row["games"], row["days"], beaten)


def shown(mu: float, sigma: float) -> float:
    """Return a rating as pages show it: what somebody's strength is at least, almost surely."""
    return 1000 + 40 * (mu - 3 * sigma)


def next_game(reader: Reader, now_ms: int) -> Game | None:
    """Return the oldest game that is not rated yet; None where there is none. What is older than a day is left alone."""
    (last,) = reader.query("SELECT max(at_ms) AS at_ms FROM rated_games")
    since = max(now_ms - _DAY_MS, (last["at_ms"] or 0) - LATE_MS)
    found = reader.query(_NEXT, [since, now_ms])
    return Game(found[0]["id"], found[0]["day"], found[0]["at_ms"]) if found else None


def rate(conn: sqlite3.Connection, game: Game, policies: Mapping[str, int | None] | None) -> None:
    """Rate a game and keep it; call it inside a transaction.

    policies  moves that policies need on the terrain of a ranked episode, None for one that did not get there
    """
    if game.episode_id is not None and not rows(conn, _EPISODE, game.episode_id):
        return  # it was erased meanwhile
    told = None if policies is None else json.dumps(policies, sort_keys=True)
    sql = "INSERT OR IGNORE INTO rated_games VALUES ((SELECT coalesce(max(number), 0) + 1 FROM rated_games), ?, ?, ?, ?)"
    if not conn.execute(sql, (game.at_ms, game.episode_id, game.day, told)).rowcount:
        return
    played = _played(conn, game.episode_id, game.day, told)
    found = {each: _rating(conn, each) for each in played.people}
    played.rate(found)
    insert = TABLES["ratings"].insert(how="INSERT OR REPLACE")
    conn.executemany(insert, [r.row(p) for p, r in found.items()])


def renew(conn: sqlite3.Connection) -> None:
    """Make all ratings again from the games; call it inside a transaction."""
    found = _from_games(conn)
    conn.execute("DELETE FROM ratings")
    conn.executemany(TABLES["ratings"].insert(), [each.row(who) for who, each in found.items()])


def forget(conn: sqlite3.Connection, player_id: str) -> None:
    """Delete a player's name and rating; the others' follow from what is left where they had met. Their episodes are gone."""
    conn.execute("DELETE FROM names WHERE player_id = ?", [player_id])
    if conn.execute("DELETE FROM ratings WHERE player_id = ?", [player_id]).rowcount:
        renew(conn)


def differences(conn: sqlite3.Connection) -> Iterator[Finding]:
    """Yield the ratings that are not as the games give them."""
    made = _from_games(conn)
    kept = {row["player_id"]: Rating.of(row) for row in rows(conn, "SELECT * FROM ratings")}
    for who in sorted(kept.keys() | made.keys()):
        stored, again = kept.get(who), made.get(who)
        if stored is None or again is None or not _is_same(stored, again):
            values = [None if each is None else astuple(each) for each in (stored, again)]
            yield Finding("ratings", "a player's rating", *values)


def people(reader: Reader) -> list[dict[str, Any]]:
    """Return the named players with a rating and their ids, the highest first, without those whom an operator has hidden."""
    return [{"player_id": row["player_id"], **_told(row)} for row in reader.query(_PEOPLE, [SHOWN])]


def standing(reader: Reader, player_id: str, episode_id: str = "") -> dict[str, Any]:
    """Return a player's own name, rating, and what it was before its newest game, None for what there is not.

    `rated` says whether an episode is in it.
    """
    (row,) = reader.query(_STANDING, [player_id, episode_id])
    none: dict[str, Any] = {"rating": None, "games": 0, "days": 0, "beaten": {}}
    rated = none if row["mu"] is None else _told(row)
    before = None if row["before"] is None else round(row["before"])
    is_so = {each: bool(row[each]) for each in ("hidden", "rated")}
    return {**rated, "before": before, "name": row["name"], **is_so}


def set_name(
    conn: sqlite3.Connection, player_id: str, name: str, likeness: str, at_ms: int
) -> bool:
    """Give a player a name, and return whether there is such a player: who has played; NameTakenError for one that is taken.

    One that an operator has hidden stays hidden, whatever the new name is.
    """
    sql = """INSERT INTO names SELECT id, ?2, ?3, ?4, 0 FROM players WHERE id = ?1
        ON CONFLICT (player_id) DO UPDATE SET name = ?2, likeness = ?3, chosen_ms = ?4"""
    try:
        return conn.execute(sql, (player_id, name, likeness, at_ms)).rowcount > 0
    except sqlite3.IntegrityError as error:
        why = "somebody has this name, or one that looks like it"
        raise NameTakenError(f"{why}: choose another") from error


def remove_name(conn: sqlite3.Connection, player_id: str) -> None:
    """Let a player have no name; one that is hidden stays, so that it is not chosen again."""
    conn.execute("DELETE FROM names WHERE player_id = ? AND NOT hidden", [player_id])


def hide_name(conn: sqlite3.Connection, name: str, hidden: bool) -> bool:
    """Show a name no more, or again; return whether anybody has it."""
    return conn.execute("UPDATE names SET hidden = ? WHERE name = ?", (hidden, name)).rowcount > 0


def newest_names(reader: Reader) -> list[dict[str, Any]]:
    """Return the names that were chosen last, and whether each is hidden."""
    sql = "SELECT name, chosen_ms, hidden FROM names ORDER BY chosen_ms DESC LIMIT ?"
    return [{**row, "hidden": bool(row["hidden"])} for row in reader.query(sql, [SHOWN])]


def named(conn: sqlite3.Connection, name: str) -> str | None:
    """Return the id of the player with a name; None for nobody's."""
    found = conn.execute("SELECT player_id FROM names WHERE name = ?", [name]).fetchone()
    return None if found is None else str(found[0])


@dataclass(frozen=True)
class _Played:
    """A game as it went: people with their places, 0 the best, equal ones alike; policies' places in a ranked episode."""

    people: Mapping[str, int]
    policies: Mapping[str, int]

    def rate(self, found: Mapping[str, Rating]) -> None:
        """Change the ratings of these people by it: those of a large field in heats, in the order in which they ended."""
        everybody = list(self.people.items())
        for at in range(0, len(everybody), HEAT):
            heat = everybody[at : at + HEAT]
            teams = [[MODEL.rating(mu=found[each].mu, sigma=found[each].sigma)] for each, _ in heat]
            teams += [[MODEL.rating(mu=MEASURED[each], sigma=SURE)] for each in self.policies]
            if len(teams) < 2:
                continue
            ranks = [float(place) for place in (*dict(heat).values(), *self.policies.values())]
            for (who, place), (after,) in zip(heat, MODEL.rate(teams, ranks=ranks), strict=False):
                self._note(found[who], place, after.mu, after.sigma)

    def _note(self, each: Rating, place: int, mu: float, sigma: float) -> None:
        each.before = each.shown if each.games + each.days else None
        each.mu, each.sigma = mu, sigma
        each.games += bool(self.policies)
        each.days += not self.policies
        for policy, other in self.policies.items():
            each.beaten[policy] = each.beaten.get(policy, 0) + (place < other)


def _played(
    conn: sqlite3.Connection, episode_id: str | None, day: str | None, policies: str | None
) -> _Played:
    if episode_id is None:
        (closed_ms,) = conn.execute("SELECT closed_ms FROM series WHERE name = ?", [day]).fetchone()
        attempts = rows(conn, _OF_DAY, day, closed_ms)
        keys = [
            (each["steps"], 0) if each["outcome"] == "explored" else (math.inf, -each["discovered"])
            for each in attempts
        ]
        places = {key: place for place, key in enumerate(sorted(set(keys)))}
        pairs = zip(attempts, keys, strict=True)
        return _Played({each["player_id"]: places[key] for each, key in pairs}, {})
    (row,) = rows(conn, _EPISODE, episode_id)
    trial = Trial.of(row)
    ended = trial.forfeited() if trial.attestation == "spoilt" else trial
    mine = ended.steps if ended.outcome == "explored" else None
    told = json.loads(policies or "{}").items()
    theirs = {each: moves for each, moves in told if each in MEASURED}
    order = sorted({math.inf if each is None else each for each in (mine, *theirs.values())})
    ranks = {each: math.inf if each is None else each for each in (mine, *theirs.values())}
    place = {each: order.index(rank) for each, rank in ranks.items()}
    people = {str(trial.owner_id): place[mine]}
    return _Played(people, {each: place[moves] for each, moves in theirs.items()})


def _from_games(conn: sqlite3.Connection) -> dict[str, Rating]:
    """Return everybody's rating as the games give it, in their order."""
    found: dict[str, Rating] = {}
    for game in rows(conn, "SELECT * FROM rated_games ORDER BY number"):
        played = _played(conn, game["episode_id"], game["day"], game["policies"])
        for each in played.people:
            found.setdefault(each, Rating())
        played.rate(found)
    return found


def _rating(conn: sqlite3.Connection, player_id: str) -> Rating:
    kept = rows(conn, "SELECT * FROM ratings WHERE player_id = ?", player_id)
    return Rating.of(kept[0]) if kept else Rating()


def _is_same(one: Rating, other: Rating) -> bool:
    same = (one.games, one.days, one.beaten) == (other.games, other.days, other.beaten)
    pairs = [(one.mu, other.mu), (one.sigma, other.sigma), (one.before or 0, other.before or 0)]
    return same and all(math.isclose(*pair) for pair in pairs)


def _told(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "name": row["name"], "rating": round(row["rating"]), "games": row["games"], "days": row["days"],
        "beaten": json.loads(row["beaten"]),
    }  # fmt: skip
