"""Pictures of people's episodes: kept replays change nothing, and are bounded."""

import pytest

from humanplay.db import volunteers
from humanplay.db.store import Store
from humanplay.jobs import Jobs
from humanplay.report.statistics.human_level import human_level
from humanplay.results import leaderboard
from humanplay.results.leaderboard import HumanSummaries, Leaderboard
from humanplay.tasks.mars import environment as replays
from marsexplorer.config import EnvConfig
from tests.support.recorded import SMALL, play

WIDE = EnvConfig("random", 7, 9, sensor_radius=2)


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "play.db")
    for number in range(25):  # no two of these terrains are alike
        play(store, 800 + number, f"player-{number // 5}", explore=number > 0)
        play(store, number, f"player-{number // 5}", config=WIDE)
    yield store
    store.close()


@pytest.fixture
def replayed(monkeypatch):
    """The configurations of the episodes that were replayed, in order."""
    configs, replay = [], replays.replay
    monkeypatch.setattr(
        replays, "replay", lambda record: configs.append(record.config) or replay(record)
    )
    return configs


def figure_of(store, config):
    return next(
        figure for figure in human_level(store)["figures"] if figure["config_hash"] == config.hash
    )


def pictures(summaries, store, config=SMALL):
    return summaries.pictures(store, config, figure_of(store, config))


def test_only_the_episodes_that_have_come_are_replayed(store, replayed):
    summaries = HumanSummaries()
    first = pictures(summaries, store)
    assert pictures(summaries, store) == first
    assert replayed == [SMALL] * 25
    row = play(store, 50, "player-1", explore=True)
    later = pictures(summaries, store)
    assert replayed == [SMALL] * 26
    assert later == pictures(HumanSummaries(), store) != first
    with store.transaction():
        store.connection.execute("UPDATE episodes SET driver = 'script' WHERE id = ?", [row.id])
        volunteers.renew(store.connection)
    del replayed[:]
    assert pictures(summaries, store) == first == pictures(HumanSummaries(), store)
    assert replayed == [SMALL] * 25, "by the new ones alone"


def test_the_pictures_are_of_the_newest_episodes(store, monkeypatch):
    monkeypatch.setattr(leaderboard, "MAX_EPISODES", 2)
    summaries = HumanSummaries()
    pictures(summaries, store)
    newest = store.query("SELECT trajectory_hash AS hash FROM episodes WHERE seed IN (823, 824)")
    assert {hash_ for hash_, *_ in summaries._replays[SMALL.hash]} == {
        row["hash"] for row in newest
    }


def test_an_episode_that_has_left_is_dropped_when_its_board_is_read(store):
    summaries = HumanSummaries()
    pictures(summaries, store)
    (gone,) = store.query("SELECT id, trajectory_hash FROM episodes WHERE seed = 803")
    assert gone["trajectory_hash"] in repr(summaries._replays)
    with store.transaction():
        for table in ("steps", "input_events", "page_loads", "event_batches"):
            store.connection.execute(f"DELETE FROM {table} WHERE episode_id = ?", [gone["id"]])
        store.connection.execute("DELETE FROM episodes WHERE id = ?", [gone["id"]])
        volunteers.renew(store.connection)
    assert pictures(summaries, store) == pictures(HumanSummaries(), store)
    assert gone["trajectory_hash"] not in repr(summaries._replays)
    assert len(summaries._replays[SMALL.hash]) == 24


def test_a_reading_of_the_leaderboard_drops_what_no_figure_is_made_from(store, tmp_path):
    board = Leaderboard(store.path, [], Jobs(1))
    for entry in board.entries():
        board._people_of(entry)
    assert set(board._people._made) == set(board._people._replays) == {SMALL.hash, WIDE.hash}
    play(store, 50, "player-9")
    with store.transaction():
        store.connection.execute(
            "UPDATE episodes SET driver = 'script' WHERE config_hash = ?", [WIDE.hash]
        )
        volunteers.renew(store.connection)
    board.entries()
    assert (list(board._people._made), list(board._people._replays)) == ([], [SMALL.hash])


def test_the_replays_that_are_kept_have_a_bound_and_those_of_the_latest_board_stay(
    store, replayed, monkeypatch
):
    summaries = HumanSummaries()
    pictures(summaries, store, WIDE)
    pictures(summaries, store)
    assert list(summaries._replays) == [WIDE.hash, SMALL.hash], "there is room for both"
    most = 4 * leaderboard.OVERHEAD
    monkeypatch.setattr(leaderboard, "MAX_MOVES", most)
    play(store, 40, explore=True)
    assert pictures(summaries, store) == pictures(HumanSummaries(), store)
    fit = summaries._replays[SMALL.hash]
    assert list(summaries._replays) == [SMALL.hash]
    assert 0 < len(fit) < 26
    assert sum(leaderboard.OVERHEAD + len(summary.path) for summary in fit.values()) <= most
    play(store, 41, explore=True)
    del replayed[:]
    pictures(summaries, store)
    assert len(replayed) == 27 - len(fit), "what did not fit is replayed again"
