"""Processor time of the volunteers' figures with thousands of players: figures are printed; only ratios of one run gate."""

import time

import numpy as np
import pytest

from app.statistics.human_level import VolunteerFigures, human_level
from app.statistics.intervals import estimate
from app.statistics.study_figures import metric_bounds
from app.storage.store import Store
from marsexplorer.config import EnvConfig
from tests.support.recorded import play

pytestmark = pytest.mark.bench

EPISODES = 4500
CONFIG = EnvConfig.of("random", 9)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A database in which each of so many players has one counted episode, every tenth of them abandoned."""
    store = Store(tmp_path_factory.mktemp("volunteers") / "play.db")
    with store.transaction():
        for seed in range(EPISODES):
            play(store, seed, f"player-{seed}", explore=seed % 10 > 0, config=CONFIG)
    yield store
    store.close()


def cpu_ms(work):
    """Milliseconds of processor time of the whole process, and the result."""
    began = time.process_time()
    found = work()
    return 1000 * (time.process_time() - began), found


def every_interval(store):
    """The estimates of score and steps as a report has them; each reading worked them out before."""
    rows = store.totals("human")
    scores = np.array([row["score"] for row in rows])
    steps = np.array([row["steps"] if row["outcome"] == "explored" else CONFIG.limit for row in rows], np.float64)
    return [estimate(values, metric_bounds(CONFIG, name)) for name, values in (("score", scores), ("steps", steps))]


def test_a_second_reading_of_thousands_of_players_costs_little(store):
    kept = VolunteerFigures()
    human_level(store)  # what happens once has happened
    whole_ms, estimates = cpu_ms(lambda: every_interval(store))
    first_ms, first = cpu_ms(lambda: kept.human_level(store))
    second_ms, second = cpu_ms(lambda: kept.human_level(store))
    play(store, EPISODES, "one-more", config=CONFIG)
    more_ms, more = cpu_ms(lambda: kept.human_level(store))
    print(f"\n{EPISODES:,} players, processor time: first reading {first_ms:.0f} ms, unchanged {second_ms:.0f} ms, ", end="")
    print(f"after one more episode {more_ms:.0f} ms; with every interval of a report {whole_ms:.0f} ms")
    assert first == second
    assert more == human_level(store) != first
    assert [tuple(first["figures"][0][name].values()) for name in ("score", "steps")] == [
        (each.mean, *each.interval) for each in estimates
    ]
    assert second_ms < first_ms
    assert max(first_ms, more_ms) < whole_ms / 10
