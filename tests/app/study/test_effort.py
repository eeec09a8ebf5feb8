"""The effort check: random movers are labelled, people who explore are not."""

from types import SimpleNamespace

from humanplay.db.reader import Reader
from humanplay.study.data import load
from humanplay.tasks.mars.environment import MarsEnvironment
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.effort import SHORTEST, makes_no_effort, random_mean_known
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load as load_policy
from tests.support.stored_studies import StudyRecorder, freeze

CONFIG = EnvConfig("random", 17, 22)


def course_of(policy, seed):
    """Return the cells known after each move of a policy's episode."""
    return play_episode(load_policy(policy), CONFIG, seed).discoveries[1:]


def test_random_movers_are_labelled_and_who_explores_is_not():
    seeds = range(7 * 10**12, 7 * 10**12 + 20)
    assert sum(makes_no_effort(CONFIG, course_of("random", seed)) for seed in seeds) >= 19
    assert not any(makes_no_effort(CONFIG, course_of("frontier-cost", seed)) for seed in seeds)


def test_few_moves_say_nothing():
    course = [5] * (int(CONFIG.limit * SHORTEST))
    assert not makes_no_effort(CONFIG, course)
    assert makes_no_effort(CONFIG, [*course, 5])
    assert not makes_no_effort(CONFIG, [])


def test_searching_in_vain_for_the_last_cells_is_an_effort():
    almost = CONFIG.target - 3
    assert not makes_no_effort(CONFIG, [min(almost, 40 + 4 * move) for move in range(CONFIG.limit)])


def test_an_episode_explored_within_half_the_limit_is_an_effort_on_a_small_board():
    small = EnvConfig("random", 9, 11)
    assert not makes_no_effort(small, [40] * 42 + [small.target] * 4)


def test_the_bound_is_the_same_each_time_and_rises():
    bound = random_mean_known(CONFIG, 0.99)
    random_mean_known.cache_clear()
    assert (random_mean_known(CONFIG, 0.99) == bound).all()
    assert len(bound) == CONFIG.limit + 1
    assert bound[0] == 0
    assert (bound[2:] > bound[1:-1]).all()


def test_a_random_movers_course_is_labelled():
    trial = SimpleNamespace(config=CONFIG, terrain=b"", start=(0, 0))
    assert MarsEnvironment().labels(trial, course_of("random", 7 * 10**12)) == ("no effort",)


def test_a_studys_episodes_are_labelled(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    person = recorder.join(0, stage="ranked")
    recorder.play(person, "ranked", 0, "dawdle")
    recorder.close()
    reader = Reader.open(tmp_path / "play.db")
    (trial,) = load(reader, study.name).trials
    reader.close()
    assert "no effort" in trial.labels


def test_what_can_be_discovered_is_all_of_a_building():
    building = EnvConfig.of("building", (12, 17))
    cells = Episode.begin(building, 1).cells
    assert cells < building.target
    course = [20] * 90 + [cells] * 4
    assert not makes_no_effort(building, course, cells), "explored within half the limit"
    assert makes_no_effort(building, [*course[:-4], cells // 2], cells)
    assert makes_no_effort(building, course), "as if walls that nothing can see were left"
