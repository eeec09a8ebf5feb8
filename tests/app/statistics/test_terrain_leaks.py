"""The trend over earlier finishers: found where terrains leaked, absent where they did not, and silent where it cannot know."""

import numpy as np
import pytest

from app.report.statistics.terrain_leaks import leak_trend
from app.task import rules_of
from tests.support.made_studies import FROZEN_MS, person, trial

MINUTE = 60_000


def play_in_turn(rng, players=12, terrains=12, leak=0.0, at_once=False):
    """Return the ranked episodes of people who come one after the other; each earlier finisher saves `leak` steps."""
    skill, difficulty = rng.normal(0, 8, players), rng.normal(0, 10, terrains)
    finished, found = [[] for _ in range(terrains)], {}
    for number in range(players):
        who = person(number)
        begin = FROZEN_MS + (0 if at_once else number * 3 * MINUTE)
        for index, terrain in enumerate(rng.permutation(terrains)):
            started, ended = begin + index * MINUTE, begin + (index + 1) * MINUTE
            before = sum(end <= started for end in finished[terrain])
            finished[terrain].append(ended)
            steps = int(
                90 + skill[number] + difficulty[terrain] + rng.normal(0, 10) - leak * before
            )
            rest = {"terrain": int(terrain), "started_ms": started, "ended_ms": ended}
            found.setdefault(who.id, []).append(trial(who, index, 0.9, steps, **rest))
    return found


def test_a_leak_is_found_and_its_size_is_right():
    trend = leak_trend(play_in_turn(np.random.default_rng(1), players=20, leak=4.0))
    assert trend.slope == pytest.approx(-4.0, abs=1.5)
    assert trend.interval[1] < 0
    assert trend.p_value < 0.01
    assert trend.most == 19
    assert "as they would if terrains had leaked" in trend.sentence(rules_of("mars").words)


def test_without_a_leak_it_is_found_in_about_one_study_of_twenty():
    rng = np.random.default_rng(2)
    alarms = np.mean([leak_trend(play_in_turn(rng)).p_value < 0.05 for _ in range(100)])
    assert alarms <= 0.10
    assert "No sign" in leak_trend(play_in_turn(rng)).sentence(rules_of("mars").words)


def test_it_is_silent_for_few_people_and_where_nobody_came_later():
    rng = np.random.default_rng(3)
    assert leak_trend({}).slope is None
    few = leak_trend(play_in_turn(rng, players=4))
    assert (few.players, few.p_value) == (4, None)
    alone = {
        who: [each for each in own if each.terrain_index == index]
        for index, (who, own) in enumerate(play_in_turn(rng).items())
    }
    nobody = leak_trend(alone)
    assert (nobody.most, nobody.slope) == (0, None)
    assert "was not tested" in nobody.sentence(rules_of("mars").words)


def test_ones_own_episodes_and_other_terrains_are_nobodys_leak():
    """One person plays everything twice as often as wanted: no terrain has an earlier finisher but themselves."""
    rng = np.random.default_rng(4)
    ((who, own),) = play_in_turn(rng, players=1).items()
    assert leak_trend({who: own}).most == 0
