"""Processor time of the volunteers' figures with thousands of players.

Only ratios of one run gate.
"""

import time

import pytest

from humanplay.db.store import Store
from humanplay.report.statistics.human_level import VolunteerFigures, human_level
from humanplay.results.leaderboard import MAX_EPISODES, HumanSummaries
from marsexplorer.config import EnvConfig
from tests.support.recorded import play

pytestmark = pytest.mark.bench

EPISODES = 4500
CONFIG = EnvConfig.of("random", 9)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A database of players with one counted episode each, every tenth abandoned."""
    store = Store(tmp_path_factory.mktemp("volunteers") / "play.db")
    with store.transaction():
        for seed in range(EPISODES):
            play(store, seed, f"player-{seed}", explore=seed % 10 > 0, config=CONFIG)
    yield store
    store.close()


def cpu_ms(work):
    """Milliseconds of processor time of the whole process, and the result."""
    began = time.process_time()
    answer = work()
    return 1000 * (time.process_time() - began), answer


def test_a_second_reading_of_thousands_of_players_costs_little(store):
    figures = VolunteerFigures()
    human_level(store)  # what happens once has happened
    first_ms, first = cpu_ms(lambda: figures.human_level(store))
    second_ms, second = cpu_ms(lambda: figures.human_level(store))
    play(store, EPISODES, "one-more", config=CONFIG)
    more_ms, more = cpu_ms(lambda: figures.human_level(store))
    print(
        f"\n{EPISODES:,} players, processor time: first reading {first_ms:.0f} ms, unchanged "
        f"{second_ms:.0f} ms, "
        f"after one more episode {more_ms:.0f} ms"
    )
    assert first == second
    assert more == human_level(store) != first
    assert second_ms < first_ms / 2


def test_pictures_after_one_more_episode_cost_a_part_of_the_first(store):
    summaries, before = HumanSummaries(), human_level(store)["figures"][0]
    first_ms, _ = cpu_ms(lambda: summaries.pictures(store, CONFIG, before))
    play(store, EPISODES + 1, "one-other", explore=True, config=CONFIG)
    after = human_level(store)["figures"][0]
    more_ms, more = cpu_ms(lambda: summaries.pictures(store, CONFIG, after))
    again_ms, again = cpu_ms(lambda: summaries.pictures(store, CONFIG, after))
    print(
        f"\npictures of {MAX_EPISODES:,} episodes, processor time: the first time "
        f"{first_ms:.0f} ms, ",
        end="",
    )
    print(f"after one more episode {more_ms:.0f} ms, unchanged {again_ms:.1f} ms")
    assert more == again == HumanSummaries().pictures(store, CONFIG, after)
    assert more_ms < first_ms / 2
