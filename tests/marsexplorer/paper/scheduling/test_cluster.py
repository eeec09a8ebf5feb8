"""On a local Ray: the same jobs with the same results, a failure alone, a stop that saves."""

import importlib.util

import pytest

from marsexplorer.evaluation.cluster import LOCAL, session
from marsexplorer.paper.scheduling.cluster import run_on_ray
from tests.support.paper_jobs import Counting

pytestmark = [
    pytest.mark.long,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(
        importlib.util.find_spec("ray") is None,
        reason="RAY IS ABSENT: pip install 'marsexplorer-playground[ray]'",
    ),
]
FOREVER = 100_000


@pytest.fixture(scope="module")
def cluster():
    with session(LOCAL, workers=2) as ray:
        yield ray


def numbers(folder, name, file="result"):
    return [int(word) for word in (folder / name / file).read_text().split()]


def test_the_jobs_run_and_a_failure_leaves_the_others_running(cluster, tmp_path):
    assert cluster.is_initialized()
    jobs = [
        Counting("bad", trouble="fails"),
        Counting("killed", trouble="dies"),
        Counting("good", 60),
    ]
    seen = []
    failures = run_on_ray(jobs, tmp_path, LOCAL, lambda forecast: seen.append(forecast))
    assert [(each.name, each.error) for each in failures] == [("bad", "ValueError: this job fails")]
    assert (numbers(tmp_path, "killed"), numbers(tmp_path, "good")) == (
        list(range(20)),
        list(range(60)),
    )
    assert (seen[-1].done, seen[-1].workers) == (2, 2)
    assert (
        run_on_ray(jobs[1:], tmp_path, LOCAL, lambda forecast: pytest.fail("nothing was to do"))
        == []
    )


def test_ctrl_c_saves_what_is_under_way(cluster, tmp_path):
    jobs = [Counting("one", FOREVER), Counting("two", FOREVER), Counting("three", FOREVER)]

    def interrupt(forecast):
        if any(course.share > 0 for course in forecast.courses.values()):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_on_ray(jobs, tmp_path, LOCAL, interrupt)
    saved = [numbers(tmp_path, path.parent.name, "state") for path in tmp_path.glob("*/state")]
    assert saved
    assert all(each == list(range(len(each))) for each in saved)
