"""Finished episodes as the database holds them.

There are lists for the API, causes for replay, and the episodes that count. A reader works on the
server's own connection or on a read-only one of its own, and writes nothing. No answer for the API
holds a player's or a session's id, because a session's id is all that is needed to drive it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from humanplay.db.database import SqlValue, StoreError, open_read_only
from humanplay.db.file import hold
from humanplay.db.rows import CountedEpisode, FailureRow, MoveRow
from humanplay.db.study_rows import SeriesRow
from humanplay.db.trial import Trial
from humanplay.task import Configuration, Record
from humanplay.task.registration import environment_of

if TYPE_CHECKING:
    from sqlite_utils import Database

Who = Literal["all", "human"]

ATTESTED = "e.driver = 'human' AND e.attestation IN ('attested', 'supervised') AND e.steps > 0"
"""The condition (SQL) for an episode to be a person's as it was played. One without a move is not,
since nothing shows that a person drove it, nor is one with a move that fits no input event of its
own (`humanplay.board.attestation`)."""

HUMAN_SCORE_CONDITION = f"""(({ATTESTED} OR e.attestation = 'spoilt') AND NOT e.assisted AND NOT e.seed_chosen
    AND NOT e.terrain_met_before AND s.owner_id IS NOT NULL AND x.series IS NULL)"""
"""The condition (SQL) for an episode to count for the volunteers' figure: a spoilt one does, as
abandoned. Those of a series make a figure of their own."""

# A rival that ended first would show the terrain that its player is still exploring.
FINISHED_CONDITION = """(e.ended_ms IS NOT NULL AND NOT EXISTS (SELECT 1 FROM episodes o WHERE o.session_id = s.rival_of
    AND o.ended_ms IS NULL AND o.terrain_hash = e.terrain_hash))"""

SECRET_KEPT_CONDITION = "(y.secret_kept_ms IS NOT NULL AND y.closed_ms IS NULL)"
"""The condition (SQL) for a study to be closed while its secret is kept."""

TRIAL = "e.*, s.owner_id, x.series"
"""What `Trial.of` takes of an episode `e`, its session `s` and its place `x` in a series `y` (SQL)."""
JOINED = """JOIN sessions s ON s.id = e.session_id LEFT JOIN series_episodes x ON x.episode_id = e.id
    LEFT JOIN series y ON y.name = x.series"""

_SELECT = f"""SELECT {TRIAL}, {HUMAN_SCORE_CONDITION} AS counts FROM episodes e {JOINED}
    WHERE {FINISHED_CONDITION}"""
_DRIVEN_BY_PLAYER = " AND s.owner_id = ? AND e.driver NOT LIKE 'policy:%'"
# SQLite takes `id` and `is_fresh` from the row with the least: the fewest moves, and of these the first.
_BESTS = """SELECT id, is_fresh, min(iif(is_fresh, steps, 1000000) * 10000000000000 + ended_ms),
        count(*) AS episodes, sum(succeeded) AS successes
    FROM (SELECT *, succeeded AND driver = 'human' AND NOT seed_chosen AND NOT terrain_met_before AS is_fresh
        FROM (SELECT *, succeeded(task, outcome) AS succeeded FROM ({})))
    GROUP BY config_hash ORDER BY episodes DESC, config_hash"""
_FILTER = {"all": "", "human": f" AND {HUMAN_SCORE_CONDITION}"}


def now_ms() -> int:
    """Milliseconds since 1970."""
    return time.time_ns() // 1_000_000


def utc_day(at_ms: int) -> str:
    """The date (UTC) of a time in milliseconds since 1970: "2026-11-22"."""
    return datetime.fromtimestamp(at_ms / 1000, UTC).date().isoformat()


class Best(NamedTuple):
    """What a player has played on a configuration.

    Attributes:
        episodes, successes: How many, and how many of them succeeded.
        best: The one that succeeded with the fewest moves on a terrain that was new to the
            player, by their own hand.
    """

    task: str
    config: Configuration
    episodes: int
    successes: int
    best: Trial | None


class Reader:
    """Queries over finished episodes.

    A public reader sees nothing of a series that is open: of a study before it is closed, of a
    daily terrain before its day is over. It reads at `at_ms` (None: now). Others see nothing of an
    open study either, unless `open_studies`. None sees anything of one whose secret is kept
    (`SECRET_KEPT_CONDITION`).
    """

    def __init__(
        self,
        db: Database,
        path: Path,
        public: bool = False,
        at_ms: int | None = None,
        open_studies: bool = False,
    ) -> None:
        self._db = db
        self.path = path
        at_ms = now_ms() if at_ms is None else at_ms
        is_over = "y.kind != 'study' OR y.closed_ms IS NOT NULL"
        if public:
            is_over = f"y.closed_ms <= {at_ms:d}"
        elif open_studies:
            is_over = f"NOT {SECRET_KEPT_CONDITION}"
        self._select = f"{_SELECT} AND (x.series IS NULL OR {is_over})"
        self._select_played = f"{_SELECT} AND (x.participant_id IS NULL OR {is_over})"
        self._release = hold(path)

    @classmethod
    def open(
        cls,
        path: Path | str,
        public: bool = False,
        at_ms: int | None = None,
        open_studies: bool = False,
    ) -> Reader:
        """Open a reader on a read-only connection of its own.

        Raises:
            StoreError: If the file is not one of ours.
        """
        return cls(open_read_only(Path(path)), Path(path), public, at_ms, open_studies)

    def close(self) -> None:
        """Close the connection."""
        self._db.close()
        self._release()

    @contextmanager
    def snapshot(self) -> Iterator[None]:
        """Let the block see the database as it is at the first query."""
        self._db.conn.execute("BEGIN")
        try:
            yield
        finally:
            self._db.conn.execute("ROLLBACK")

    def query(self, sql: str, values: Sequence[SqlValue] = ()) -> list[Any]:
        """A query's rows by column, for this package; `values` fill the question marks."""
        return list(self._db.query(sql, list(values)))

    def count(self, who: Who = "all") -> int:
        """The number of finished episodes."""
        (row,) = self.query(f"SELECT count(*) AS n FROM ({self._select}{_FILTER[who]})")
        return int(row["n"])

    def open_studies(self) -> list[SeriesRow]:
        """The studies that are not closed, those whose secrets are kept too."""
        sql = "SELECT * FROM series WHERE kind = 'study' AND closed_ms IS NULL ORDER BY name"
        return [SeriesRow(**row) for row in self.query(sql)]

    def finished(self, who: Who = "all", player: str | None = None) -> Iterator[CountedEpisode]:
        """Yield finished episodes as they are stored, oldest first.

        They are for exports, not for the API; `Trial.of` takes them.

        Args:
            player: Theirs alone: what they drove, not what policies did beside them.
        """
        driven, values = ("", []) if player is None else (_DRIVEN_BY_PLAYER, [player])
        sql = f"{self._select}{_FILTER[who]}{driven} ORDER BY e.started_ms, e.id"
        episodes: Iterator[Any] = self._db.query(sql, values)
        return episodes

    def newest_failures(self, most: int) -> list[FailureRow]:
        """What environments raised, the newest first.

        Of a series with a secret that is not known yet no seed, time or step is told.
        """
        is_told = "s.name IS NULL OR s.secret IS NOT NULL"
        after_step = "substr(e.failure, instr(e.failure, ', ') + 2)"
        sql = f"""SELECT e.id AS episode,
            CASE WHEN {is_told} THEN e.ended_ms END AS ended_ms,
            CASE WHEN {is_told} THEN e.seed END AS seed,
            CASE WHEN {is_told} THEN e.failure ELSE {after_step} END AS report
            FROM episodes e LEFT JOIN series_episodes x ON x.episode_id = e.id
            LEFT JOIN series s ON s.name = x.series
            WHERE e.failure IS NOT NULL ORDER BY e.ended_ms DESC, e.id LIMIT ?"""
        return self.query(sql, [most])

    def newest_counted(self, config_hash: str, most: int) -> list[Trial]:
        """The newest counted episodes of a configuration, oldest first."""
        sql = f"""{self._select}{_FILTER["human"]} AND e.config_hash = ?
            ORDER BY e.started_ms DESC, e.id DESC LIMIT ?"""
        return list(map(Trial.of, self._db.query(sql, [config_hash, most])))[::-1]

    def played_by(self, player: str, limit: int = 50, after: str | None = None) -> list[Trial]:
        """The finished episodes that a player drove, newest first, for their own page.

        There is none of open studies. That of today's terrain is among them: whoever shows it tells
        no seed, no terrain and no moves.

        Args:
            after: As for `episodes`.
        """
        return self._page(self._select_played + _DRIVEN_BY_PLAYER, "", limit, after, player)

    def bests_of(self, player: str) -> list[Best]:
        """What a player has played by configuration, the most played first."""
        bests = []
        self._db.conn.create_function("succeeded", 2, _succeeded, deterministic=True)
        for row in self.query(_BESTS.format(self._select_played + _DRIVEN_BY_PLAYER), [player]):
            (shown,) = self.query(f"{self._select_played} AND e.id = ?", [row["id"]])
            trial = Trial.of(shown)
            best = trial if row["is_fresh"] else None
            bests.append(Best(trial.task, trial.config, row["episodes"], row["successes"], best))
        return bests

    def steps(self, episode_id: str) -> list[MoveRow]:
        """An episode's moves in order."""
        return self.query("SELECT * FROM steps WHERE episode_id = ? ORDER BY step", [episode_id])

    def episodes(
        self, limit: int = 50, after: str | None = None, who: Who = "all"
    ) -> list[dict[str, object]]:
        """Finished episodes, newest first, with seed, totals and the actions in words.

        Args:
            after: Id of the last episode of the page before.

        Raises:
            LookupError: If no finished episode has that id.
        """
        trials = self._page(self._select, _FILTER[who], limit, after)
        return [_described(trial, self._actions(trial.id)) for trial in trials]

    def _page(
        self, select: str, which: str, limit: int, after: str | None, *filled: str
    ) -> list[Trial]:
        """The newest episodes of a query that fit an SQL condition.

        Args:
            which: The condition, with an AND before it.
            after: Id of an episode of the query; it need not fit the condition.
            filled: For the question marks of the query.
        """
        following, values = "", list(filled)
        if after is not None:
            values.append(after)
            last = self.query(f"SELECT ended_ms FROM ({select} AND e.id = ?)", values)
            if not last:
                raise LookupError(f"no finished episode {after!r} to go on after; begin without")
            at = last[0]["ended_ms"]
            following = f" AND e.ended_ms <= {at:d} AND (e.ended_ms < {at:d} OR e.id > ?)"
        sql = f"{select}{which}{following} ORDER BY e.ended_ms DESC, e.id LIMIT {limit:d}"
        return list(map(Trial.of, self.query(sql, values)))

    def _actions(self, episode_id: str) -> list[int]:
        sql = "SELECT action FROM steps WHERE episode_id = ? ORDER BY step"
        return [row["action"] for row in self.query(sql, [episode_id])]

    def trial(self, episode_id: str) -> Trial | None:
        """One finished episode without its moves; None if there is none."""
        rows = self.query(f"{self._select} AND e.id = ?", [episode_id])
        return Trial.of(rows[0]) if rows else None

    def episode(self, episode_id: str) -> dict[str, object] | None:
        """One finished episode as `episodes` gives it, or None.

        The times of every move are under `moves`.
        """
        if (trial := self.trial(episode_id)) is None:
            return None
        steps = self.steps(episode_id)
        moves = [_move(step, trial.environment.actions) for step in steps]
        actions = [step["action"] for step in steps]
        return {**_described(trial, actions), "moves": moves}

    def who_drove(self, episode_id: str, viewer: str | None = None) -> str:
        """Who drove an episode: its driver, but for two cases.

        It is "you" for the viewer's own, and "synthetic" for a synthetic participant's.
        """
        sql = """SELECT e.driver, s.owner_id = ?2 AND e.driver NOT LIKE 'policy:%' AS own, EXISTS (SELECT 1 FROM participants p
            WHERE p.session_id = s.id AND p.kind = 'script') AS synthetic
            FROM episodes e JOIN sessions s ON s.id = e.session_id WHERE e.id = ?1"""
        for row in list(self._db.query(sql, [episode_id, viewer])):
            is_synthetic = row["synthetic"] and not row["driver"].startswith("policy:")
            return "you" if row["own"] else "synthetic" if is_synthetic else str(row["driver"])
        raise StoreError(f"no episode {episode_id!r} in {self.path}")

    def ids_beginning(self, prefix: str, limit: int) -> list[str]:
        """Ids of finished episodes that begin with a text, in order, at most `limit`."""
        sql = f"SELECT id FROM ({self._select} AND substr(e.id, 1, length(?)) = ?) ORDER BY id LIMIT ?"
        return [str(row["id"]) for row in self._db.query(sql, [prefix, prefix, limit])]

    def load_record(self, episode_id: str) -> Record:
        """The cause of a finished episode, ready to be replayed.

        Raises:
            StoreError: If there is no such episode.
        """
        for row in list(
            self._db.query(
                "SELECT * FROM episodes WHERE id = ? AND ended_ms IS NOT NULL", [episode_id]
            )
        ):
            return Trial.of(row).record(self.steps(episode_id))
        raise StoreError(f"no finished episode {episode_id!r} in {self.path}: see `episodes`")


def _succeeded(task: str, outcome: str) -> bool:
    """Whether an outcome is a success; False if the task is not here."""
    try:
        return outcome in environment_of(task).successes
    except ValueError:
        return False


def _move(step: MoveRow, actions: Sequence[str]) -> dict[str, object]:
    rest = {name: field for name, field in step.items() if name not in ("episode_id", "action")}
    return {"action": actions[step["action"]], **rest}


def _described(trial: Trial, actions: list[int]) -> dict[str, object]:
    """An episode for the API."""
    config = trial.config.to_dict()
    plain = ("seed", "driver", "assisted", "seed_chosen", "terrain_met_before", "counts", "config_hash", "core_version",
             "started_ms", "ended_ms", "outcome", "steps", "discovered", "score", "attestation", "attestation_reason",
             "coverage", "steps_to_target", "trajectory_hash")  # fmt: skip
    return {
        "episode": trial.id,
        "task": trial.task,
        "level": trial.config.level,
        **{side: config[side] for side in ("rows", "cols") if side in config},
        "config": config,
        "daily": trial.day,
        "start": list(trial.start),
        **{name: getattr(trial, name) for name in plain},
        "return": trial.total,
        "actions": [trial.environment.actions[action] for action in actions],
    }
