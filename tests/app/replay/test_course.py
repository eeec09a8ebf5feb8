"""An episode's course against its frames and against the policy's own episode."""

import re

import numpy as np
import pytest

from humanplay import STATIC
from humanplay.task import GhostError
from humanplay.tasks.mars.course import (
    course_of,
    play_ghost,
    preferred,
)
from humanplay.tasks.mars.drawn import PLAIN_LEVELS, PLAIN_POLICIES, sentence
from humanplay.tasks.mars.run import CELL_CHARACTERS
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.episodes import play_terrain
from marsexplorer.policies import load
from tests.support.recorded import free_moves, tour

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)


def played(actions=tour, seed=4):
    episode = Episode.begin(CONFIG, seed=seed)
    for action in actions(episode):
        if not episode.ended:
            episode.step(action)
    return episode


def test_a_course_shows_at_each_move_what_was_known_then():
    record = played().record()
    course, again = course_of("A person", record), Episode.begin(CONFIG, seed=4)
    for step in range(course.moves + 1):
        shown = np.where((course.known_since >= 0) & (course.known_since <= step), course.codes, 0)
        shown[again.position] = 2
        assert (shown == again.codes).all(), step
        assert (course.path[step], course.discovered[step]) == (again.position, again.discovered)
        if step < course.moves:
            again.step(course.actions[step])
    assert (course.outcome, course.score) == ("explored", again.score)
    answer = course.to_dict()
    text = "".join(answer["grid"]).encode()
    assert text == course.codes.tobytes().translate(CELL_CHARACTERS)
    assert b"@" not in text
    assert answer["sentence"] == f"mapped {share(again)} of the ground in {course.moves} moves"
    assert record.seed is not None
    assert str(record.terrain.hex()) not in str(answer)


def share(episode):
    """Coverage as the pages write it: in tenths of a percent, rounded down."""
    return f"{int(1000 * episode.coverage + 1e-6) / 10:.1f} %"


@pytest.mark.parametrize(("before", "moves"), [(0, "1 move"), (2, "3 moves")])
def test_an_ending_in_words(before, moves):
    episode = played(lambda episode: [*free_moves(episode)[:before], 0])
    words = sentence(course_of("A person", episode.record()))
    assert words == f"drove off the map at {share(episode)} after {moves}"


def test_an_abandoned_episode_was_left():
    episode = played(lambda episode: free_moves(episode)[:4])
    episode.abandon()
    course = course_of("A person", episode.record())
    assert (course.outcome, course.score) == ("abandoned", episode.score)
    assert course.headline == f"A person left at {share(episode)} after 4 moves"
    assert course_of("ppo", episode.record()).headline.startswith("Expert left at ")


def test_pages_and_pictures_have_the_same_plain_names():
    script = (STATIC / "task/mars/words.js").read_text()
    tables = "".join(re.findall(r"Object\.freeze\(\{.*?\}\)", script, re.S))
    plain = re.sub(r't\("[\w.]+", ("[^"]*")\)', r"\1", tables)
    pairs = dict(re.findall(r'"?([\w-]+)"?: "([^"]+)"', plain))
    assert pairs == {**PLAIN_POLICIES, **PLAIN_LEVELS}


def test_a_ghost_is_the_policys_own_episode_on_that_terrain():
    record = played(free_moves).record()
    ghost, episode = (
        play_ghost("frontier-cost", record),
        play_terrain(load("frontier-cost", 3), record),
    )
    assert ghost.actions == bytes(episode.actions)
    assert (ghost.outcome, ghost.score) == (episode.outcome, episode.score)


def test_a_ghost_that_cannot_be_had_says_why(monkeypatch):
    record = played(free_moves).record()
    with monkeypatch.context() as patch:
        # as a file's that knows one size
        patch.setattr(type(load("frontier-cost", 3)), "size", (9, 9), raising=False)
        with pytest.raises(GhostError, match="plays no boards of 9x13"):
            play_ghost("frontier-cost", record)
    with pytest.raises(GhostError, match="cannot be loaded"):
        play_ghost("/nowhere/gone.onnx", record)


def test_a_policy_is_compared_with_another_one():
    names = ["frontier-cost", "random", "ppo"]
    rivals = [preferred(driver, names) for driver in ("A person", "ppo", "random")]
    assert rivals == ["ppo", "frontier-cost", "ppo"]
    assert preferred("own", ["own"]) is None
