"""A task refuses another task's configuration."""

import pytest

from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig

TASKS = {
    "mars": EnvConfig.of("random", 5).to_dict(),
    "gymnasium:FrozenLake-v1": {},
}


@pytest.mark.parametrize(("task", "other"), [tuple(TASKS), tuple(TASKS)[::-1]])
def test_a_configuration_of_another_task_is_refused(task, other):
    foreign = environment_of(other).configuration(TASKS[other])
    mine = environment_of(task).configuration(TASKS[task])
    assert not environment_of(task).run(mine, seed=1).ended
    with pytest.raises(TypeError, match=f"expected .*, got a {type(foreign).__name__}"):
        environment_of(task).run(foreign, seed=1)
