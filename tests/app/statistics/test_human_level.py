"""The volunteers' figure: one a configuration, with players as the unit."""

import itertools
import math

import numpy as np
import pytest
import scipy

from humanplay.db import volunteers
from humanplay.report.statistics import human_level as module
from humanplay.report.statistics.human_level import (
    NOBODY_PLAYED,
    VolunteerFigures,
    human_level,
    mean_interval,
)
from humanplay.report.statistics.intervals import estimate
from humanplay.report.statistics.study_figures import metric_bounds, worst_value
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from tests.support.recorded import SMALL, add_session, open_episode, play

WIDE = EnvConfig("1-1-1", 7, 9, sensor_radius=2)


def test_nobody_has_played(store):
    open_episode(store, add_session(store), seed=1)
    play(store, seed=1, player="bob", driver="script")
    play(store, seed=2, player="bob", assisted=True)
    play(store, seed=3, player="bob", seed_chosen=True)
    assert human_level(store) == {"figures": [], "sentence": NOBODY_PLAYED}


MISSING = {"of": 5, "episodes": 5}
NONE = dict.fromkeys(("as_played", "score", "steps", "completed"))


def play_each(store, episodes):
    """Let players play so many ranked episodes each, the first of them without a move."""
    seeds = itertools.count()
    for number, count in enumerate(episodes):
        for left in range(count):
            play(store, next(seeds), f"player-{number}", explore=left > 0)


@pytest.mark.parametrize(
    ("episodes", "missing", "sentence"),
    [
        ([1], 5, "1 player and 1 episode so far, 1 of them abandoned"),
        ([5], 4, "1 player and 5 episodes so far, 1 of them abandoned"),
        ([9, 4, 4, 4, 4, 4], 4, "6 players and 29 episodes so far, 6 of them abandoned"),
        ([5, 5, 5, 5, 4], 1, "5 players and 24 episodes so far, 5 of them abandoned"),
    ],
)
def test_there_is_no_mean_below_five_players_with_five_episodes_each(
    store, episodes, missing, sentence
):
    play_each(store, episodes)
    level = human_level(store)
    (figure,) = level["figures"]
    assert figure | NONE | {"missing": MISSING | {"players": missing}} == figure
    assert (figure["players"], figure["episodes"]) == (len(episodes), sum(episodes))
    assert sentence in level["sentence"]
    lacks = f"{missing} {'is' if missing == 1 else 'are'} missing."
    assert level["sentence"].endswith(f"It needs 5 players with 5 ranked episodes each: {lacks}")


def test_the_mean_is_that_of_players_with_enough_episodes_each_of_whom_weighs_the_same(store):
    play_each(store, [5, 5, 6, 9, 5, 4, 1])
    level = human_level(store)
    (figure,) = level["figures"]
    for name, value in (("score", "score"), ("steps", "steps_to_target")):
        by_player = {}
        for row in store.query("SELECT id, session_id FROM episodes"):
            (session,) = store.query(
                "SELECT player_id FROM sessions WHERE id = ?", [row["session_id"]]
            )
            by_player.setdefault(session["player_id"], []).append(store.episode(row["id"])[value])
        means = np.array(
            [math.fsum(scores) / len(scores) for scores in by_player.values() if len(scores) >= 5]
        )
        bounds, worst = (
            of_metric(environment_of("mars"), SMALL, name)
            for of_metric in (metric_bounds, worst_value)
        )
        whole = estimate(means[:, None], bounds, worst, terrains_drawn=False)
        assert tuple(figure[name].values()) == pytest.approx((whole.mean, *whole.interval))
    assert (figure["players"], figure["missing"]) == (7, None)
    entering = {"players": 5, "episodes": 30, "abandoned": 5, "spoilt": 0}
    assert figure["entering"] == entering
    assert figure["population"] == "volunteers"
    assert figure["completed"] == pytest.approx(np.mean([4 / 5, 4 / 5, 5 / 6, 8 / 9, 4 / 5]))
    assert (figure["level"], figure["rows"], figure["cols"]) == ("random", 5, 7)
    assert (figure["config_hash"], EnvConfig(**figure["config"])) == (SMALL.hash, SMALL)
    assert level["sentence"].endswith(
        "Each of the 5 players with at least 5 episodes weighs the same; "
        "7 players and 35 episodes in all, 7 of them abandoned."
    )


@pytest.fixture
def computed(monkeypatch):
    """How many episodes each figure was made from, in the order of making."""
    counts, make = [], module._figure
    monkeypatch.setattr(
        module,
        "_figure",
        lambda task, config, players: (
            counts.append(sum(player.episodes for player in players)) or make(task, config, players)
        ),
    )
    return counts


def test_volunteers_who_never_reach_the_aim_have_a_mean_and_no_interval(store):
    seeds = itertools.count()
    for number in range(5):
        for _ in range(5):
            play(store, next(seeds), f"player-{number}")
    level = human_level(store)
    (figure,) = level["figures"]
    assert figure["steps"] == {"mean": SMALL.limit, "low": None, "high": None}
    assert "(no interval)" in level["sentence"]


def test_a_figure_is_made_again_only_when_its_counted_episodes_are_others(store, computed):
    for seed in range(4):
        play(store, seed, f"player-{seed}", explore=True)
    play(store, 1, config=WIDE)
    figures = VolunteerFigures()
    first = figures.human_level(store)
    assert sorted(computed) == [1, 4]
    open_episode(store, add_session(store), seed=5)
    play(store, 6, driver="script")
    assert figures.human_level(store) == first
    assert len(computed) == 2
    play(store, 9, "player-9")
    newest = figures.human_level(store)
    assert computed[2:] == [5], "the other configuration's figure is kept"
    assert newest == human_level(store) != first


LAST = "(SELECT id FROM episodes WHERE seed = 3)"


@pytest.mark.parametrize(
    "changes",
    [
        (
            *(
                f"DELETE FROM {table} WHERE episode_id = {LAST}"
                for table in ("steps", "input_events", "page_loads", "event_batches")
            ),
            "DELETE FROM episodes WHERE seed = 3",
        ),
        ("UPDATE episodes SET attestation = 'unattested' WHERE seed = 3",),
        ("UPDATE episodes SET driver = 'script' WHERE seed = 3",),
        ("UPDATE episodes SET assisted = 1 WHERE seed = 3",),
        ("UPDATE episodes SET score = score - 1e-9 WHERE seed = 3",),
        (
            f"UPDATE sessions SET owner_id = 'player-1' WHERE id = (SELECT session_id FROM episodes WHERE id = {LAST})",
        ),
    ],
    ids=[
        "erased",
        "no longer attested",
        "a script's",
        "assisted",
        "another score",
        "another player's",
    ],
)
def test_an_episode_that_leaves_or_changes_does_so_in_the_next_reading(store, changes):
    for seed in range(30):
        play(store, seed, f"player-{seed % 5}", explore=seed > 0)
    figures = VolunteerFigures()
    before = figures.human_level(store)
    with store.transaction():
        for sql in changes:
            assert store.connection.execute(sql).rowcount > 0
        volunteers.renew(store.connection)
    assert figures.human_level(store) == human_level(store) != before


def test_nothing_of_erased_people_is_kept_after_the_next_reading(store):
    play(store, 1, "player-1")
    figures = VolunteerFigures()
    figures.human_level(store)
    assert "player-1" not in repr(vars(figures)), "nobody's id at any time"
    with store.transaction():
        store.connection.execute("UPDATE episodes SET driver = 'script'")
        volunteers.renew(store.connection)
    assert figures.human_level(store) == {"figures": [], "sentence": NOBODY_PLAYED}
    assert figures._cached == {}


def test_the_interval_is_the_t_interval_of_the_mean():
    values = [0.5, 0.7, 0.9, 0.4]
    low, high = scipy.stats.t.interval(0.95, 3, loc=np.mean(values), scale=scipy.stats.sem(values))
    assert mean_interval(values) == {
        "mean": pytest.approx(0.625),
        "low": pytest.approx(low),
        "high": pytest.approx(high),
    }
    assert mean_interval([0.5, 0.5]) == {"mean": 0.5, "low": 0.5, "high": 0.5}
