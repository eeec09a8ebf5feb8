"""The volunteers' figure: players are the unit, one figure a configuration, nothing where nobody has played."""

import math

import numpy as np
import pytest
import scipy

from app.db import volunteers
from app.report.statistics import human_level as module
from app.report.statistics.human_level import (
    NOBODY_PLAYED,
    VolunteerFigures,
    human_level,
    mean_interval,
)
from app.report.statistics.intervals import estimate_of_means
from app.report.statistics.study_figures import metric_bounds
from app.task import rules_of
from marsexplorer.config import EnvConfig
from tests.support.recorded import SMALL, add_session, open_episode, play

WIDE = EnvConfig("1-1-1", 7, 9, sensor_radius=2)


def test_nobody_has_played(store):
    open_episode(store, add_session(store), seed=1)
    play(store, seed=1, player="bob", driver="script")
    play(store, seed=2, player="bob", assisted=True)
    play(store, seed=3, player="bob", seed_chosen=True)
    assert human_level(store) == {"figures": [], "sentence": NOBODY_PLAYED}


def test_one_player_gives_a_mean_without_an_interval(store):
    rows = [play(store, seed=seed, explore=True) for seed in (1, 2)]
    found = human_level(store)
    (figure,) = found["figures"]
    scores = [store.episode(row.id)["score"] for row in rows]
    assert (figure["players"], figure["episodes"], figure["completed"]) == (1, 2, 1.0)
    assert figure["score"] == {"mean": pytest.approx(np.mean(scores)), "low": None, "high": None}
    assert (figure["level"], figure["rows"], figure["cols"]) == ("random", 5, 7)
    assert figure["config_hash"] == SMALL.hash
    assert EnvConfig(**figure["config"]) == SMALL
    assert "1 player, 2 episodes" in found["sentence"]
    assert "One player gives no interval." in found["sentence"]


def test_each_player_weighs_the_same_however_much_they_played(store):
    seeds = iter(range(100))
    own = {"ada": [True], "bob": [True, False, False, False], "cid": [False]}
    episodes = {
        p: [store.episode(play(store, next(seeds), p, e).id) for e in plays]
        for p, plays in own.items()
    }
    (figure,) = human_level(store)["figures"]
    means = [np.mean([each["score"] for each in played]) for played in episodes.values()]
    interval = estimate_of_means(
        np.array(means), metric_bounds(rules_of("mars"), SMALL, "score")
    ).interval
    assert (figure["players"], figure["episodes"], figure["population"]) == (3, 6, "volunteers")
    assert tuple(figure["score"].values()) == pytest.approx((np.mean(means), *interval))
    assert figure["completed"] == pytest.approx(np.mean([1, 0.25, 0]))


@pytest.mark.parametrize(("failing", "headline"), [("player-1", "guaranteed"), (None, "printed")])
def test_the_figures_are_those_of_the_whole_estimate(store, failing, headline):
    scores, steps = {}, {}
    for seed in range(24):
        player = f"player-{seed % 8}"
        row = store.episode(play(store, seed, player, explore=player != failing).id)
        scores.setdefault(player, []).append(row["score"])
        steps.setdefault(player, []).append(row["steps_to_target"])
    (figure,) = human_level(store)["figures"]
    assert figure["headline"] == headline
    for name, values in (("score", scores), ("steps", steps)):
        means = np.array([math.fsum(own) / len(own) for own in values.values()])
        whole = estimate_of_means(
            means,
            metric_bounds(rules_of("mars"), SMALL, name),
            is_guaranteed=headline == "guaranteed",
        )
        assert tuple(figure[name].values()) == pytest.approx(
            (whole.mean, *whole.interval), rel=1e-12
        )


@pytest.fixture
def made(monkeypatch):
    """How many episodes each figure was made from, in the order of making."""
    counts, make = [], module._figure
    monkeypatch.setattr(
        module,
        "_figure",
        lambda task, config, players: (
            counts.append(sum(each.episodes for each in players)) or make(task, config, players)
        ),
    )
    return counts


def test_a_figure_is_made_again_only_when_its_counted_episodes_are_others(store, made):
    for seed in range(4):
        play(store, seed, f"player-{seed}", explore=True)
    play(store, 1, config=WIDE)
    kept = VolunteerFigures()
    first = kept.human_level(store)
    assert sorted(made) == [1, 4]
    open_episode(store, add_session(store), seed=5)
    play(store, 6, driver="script")
    assert kept.human_level(store) == first
    assert len(made) == 2
    play(store, 9, "player-9")
    found = kept.human_level(store)
    assert made[2:] == [5], "the other configuration's figure is kept"
    assert found == human_level(store) != first


LAST = "(SELECT id FROM episodes WHERE seed = 3)"


@pytest.mark.parametrize(
    "changes",
    [
        (
            *(
                f"DELETE FROM {each} WHERE episode_id = {LAST}"
                for each in ("steps", "input_events", "event_batches")
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
    for seed in range(4):
        play(store, seed, f"player-{seed}", explore=seed > 0)
    kept = VolunteerFigures()
    before = kept.human_level(store)
    with store.transaction():
        for sql in changes:
            assert store.connection.execute(sql).rowcount > 0
        volunteers.renew(store.connection)
    assert kept.human_level(store) == human_level(store) != before


def test_nothing_of_erased_people_is_kept_after_the_next_reading(store):
    play(store, 1, "player-1")
    kept = VolunteerFigures()
    kept.human_level(store)
    assert "player-1" not in repr(vars(kept)), "nobody's id at any time"
    with store.transaction():
        store.connection.execute("UPDATE episodes SET driver = 'script'")
        volunteers.renew(store.connection)
    assert kept.human_level(store) == {"figures": [], "sentence": NOBODY_PLAYED}
    assert kept._made == {}


def test_an_abandoned_episode_counts_max_steps_and_is_named(store):
    play(store, seed=1)
    found = human_level(store)
    (figure,) = found["figures"]
    assert figure["steps"]["mean"] == SMALL.limit
    assert figure["abandoned"] == 1
    assert found["sentence"].startswith(
        "Volunteers on this playground, self-selected: level random, 5 x 7 (1 player, 1 episode, 1 of "
    )
    assert figure["completed"] == 0.0


def test_the_interval_is_the_t_interval_of_the_mean():
    values = [0.5, 0.7, 0.9, 0.4]
    low, high = scipy.stats.t.interval(0.95, 3, loc=np.mean(values), scale=scipy.stats.sem(values))
    assert mean_interval(values) == {
        "mean": pytest.approx(0.625),
        "low": pytest.approx(low),
        "high": pytest.approx(high),
    }
    assert mean_interval([0.5, 0.5]) == {"mean": 0.5, "low": 0.5, "high": 0.5}
