"""What public reads cost does not grow with the database."""

import sqlite3
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

from humanplay.db.reader import Reader
from humanplay.web.access import PLAYER_COOKIE
from tests.support.many_episodes import make_episodes, public_reads
from tests.support.recorded import SMALL
from tests.support.servers import eventually, hasty_limits, running_server

FEW, MANY = 400, 4_000
PLAYERS = 50
"""As many with few episodes as with many; the one who asks has as many episodes, too."""
MOST = 1.2
"""How often what is done at FEW may be done at MANY."""
SLACK = 500
"""Instructions that make no difference: a count over an index of a study's participants, say."""
INSTRUCTIONS = 50
"""Of SQLite's machine between two looks at it; a row of a list takes some 200."""
PAGES, PAGES_AN_EPISODE = 60, 14
"""Read for a schema and one episode, and for each further one: its row, session, place and moves, each with an index, and
where only those that count are listed as much of the ones between them."""


class Cost(NamedTuple):
    """What an answer took: instructions of SQLite's machine, and pages from files."""

    instructions: int
    pages: int


class Counting(sqlite3.Connection):
    """A connection whose instructions are counted."""

    made = 0

    def __init__(self, *given, **named):
        super().__init__(*given, **named)
        self.set_progress_handler(self.count, INSTRUCTIONS)

    def count(self):
        Counting.made += INSTRUCTIONS


def so_far():
    lines = Path("/proc/self/io").read_text().splitlines()
    read = int(dict(line.split(": ") for line in lines)["rchar"])
    return Cost(Counting.made, read // 4096)


def is_quiet(seconds=0.05):
    """Whether SQLite has had nothing to do for a while.

    What a server does at its start or after an answer is over then.
    """
    before = Counting.made
    time.sleep(seconds)
    return Counting.made == before


def cost_of(read):
    """The least of some readings, and how many episodes the answer lists.

    The server also reads by itself, so that single readings are too high.
    """
    measured = []
    read()
    eventually(is_quiet)  # the first may have set off what takes long
    for _ in range(4):
        before = so_far()
        answer = read()
        measured.append(Cost(*(b - a for a, b in zip(before, so_far(), strict=True))))
    return Cost(*map(min, zip(*measured, strict=True))), len(answer) if isinstance(
        answer, list
    ) else 1


def get(client, path):
    answer = client.get(path)
    assert answer.status_code in (200, 303), (path, answer.text)
    return answer.json() if path.startswith("/api/episodes") else None


def newest(database):
    with closing(Reader.open(database)) as reader:
        return reader.newest_counted(SMALL.hash, 100)


def costs(folder, policies):
    """What is read, and what each reading costs a server that has answered it before."""
    database = folder / "playground.db"
    reads, settings = public_reads(database), {"database": database}
    with running_server(policies, limits=hasty_limits(), **settings) as server:
        eventually(lambda: is_quiet(0.2))
        cookie = server.services.player_tokens.sign("a")
        client = server.client(cookies={PLAYER_COOKIE: cookie})
        measured = [cost_of(partial(get, client, path)) for path in reads]
    return [*reads, "a board's newest episodes"], [*measured, cost_of(partial(newest, database))]


@pytest.mark.skipif(not Path("/proc/self/io").exists(), reason="counts pages as Linux does")
def test_public_reads_cost_no_more_in_a_database_ten_times_as_large(
    tmp_path, shipped_policies, monkeypatch
):
    folders = tmp_path / "few", tmp_path / "many"
    for folder, episodes in zip(folders, (FEW, MANY), strict=True):
        make_episodes(
            folder / "playground.db", folder / "playground.db-studies", episodes, (SMALL,), PLAYERS
        )
    monkeypatch.setattr(sqlite3, "connect", partial(sqlite3.connect, factory=Counting))
    (reads, few), (_, many) = (costs(folder, shipped_policies) for folder in folders)
    grown = []
    for path, (at_few, _), (at_many, listed) in zip(reads, few, many, strict=True):
        print(path[:60], *at_few, *at_many)
        is_more = at_many.instructions > MOST * at_few.instructions + SLACK
        if is_more or at_many.pages > PAGES + PAGES_AN_EPISODE * listed:
            grown.append(path)
    assert few[reads.index("/api/episodes")][0].instructions > 5_000, "they are counted"
    assert grown == []
