"""What makes other environments playable and exact."""

import warnings

import gymnasium
import numpy as np
import pytest

from humanplay.study.protocol import StudyError, default_protocol
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.adapters import Fresh, OneAtATime
from humanplay.tasks.gymnasium.doctor import examine

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # as an error, SWIG's deprecation would end the process
    import Box2D  # noqa: F401

WALKER = "BipedalWalker-v3"


def played(env, seed, steps):
    """The observations of so many steps."""
    dice, seen = np.random.default_rng(seed), [env.reset(seed=seed)[0]]
    for _ in range(steps):
        seen.append(env.step(dice.uniform(-1, 1, 4).astype(np.float32))[0])
    return np.array(seen)


def test_a_walker_that_is_made_anew_has_nothing_of_episodes_before():
    fresh, used = Fresh(gymnasium.make(WALKER)), gymnasium.make(WALKER)
    alone = played(gymnasium.make(WALKER), 2, 20)
    for env in (fresh, used):
        played(env, 1, 50)
        played(env, 3, 50)
    assert np.array_equal(played(fresh, 2, 20), alone)
    assert not np.array_equal(played(used, 2, 20), alone), "without it, it has"


def test_an_action_moves_one_number_to_an_end():
    env = OneAtATime(gymnasium.make(WALKER))
    assert env.action_space.n == 9
    assert [env.action(action).tolist() for action in (0, 1, 8)] == [
        [0, 0, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1],
    ]  # fmt: skip
    assert len(environment_of(f"gymnasium:{walker()}").actions) == 9


def walker():
    wrappers = [f"humanplay.tasks.gymnasium.adapters:{name}" for name in ("Fresh", "OneAtATime")]
    return f'{{"id":"{WALKER}","wrappers":["{wrappers[0]}","{wrappers[1]}"]}}'


def test_crafter_has_names_keys_and_a_version():
    environment = environment_of("gymnasium:humanplay.tasks.gymnasium.adapters:Crafter-v0")
    assert (environment.about.title, environment.limit, len(environment.actions)) == (
        "Crafter",
        10_000,
        17,
    )
    assert environment.keys["do"] == ("Space",)
    assert "crafter 1." in environment.version
    run = environment.run(environment.default, 5, bytes([5, 5, 1]))
    assert run.digest == environment.run(environment.default, 5, bytes([5, 5, 1])).digest
    assert run.digest != environment.run(environment.default, 6, bytes([5, 5, 1])).digest


@pytest.mark.long
def test_crafter_is_exact_with_the_adapter_and_not_as_shipped():
    exact = examine("gymnasium:humanplay.tasks.gymnasium.adapters:Crafter-v0", seeds=1, steps=300)
    assert (exact.differences, exact.used) == ((), None)
    shipped = examine("gymnasium:tests.support.environments:Shipped-v0", seeds=1, steps=300)
    assert {difference.variant for difference in shipped.differences} >= {"without rendering"}


def test_an_arm_may_have_a_key_of_the_tasks_own_that_nobody_could_choose():
    environment = environment_of("gymnasium:humanplay.tasks.gymnasium.adapters:Crafter-v0")
    keys = {action: list(codes) for action, codes in environment.keys.items()}
    keys["do"], keys["sleep"] = keys["sleep"], keys["do"]
    arms = [{"name": "swapped", "keys": keys}, {"name": "control"}]
    protocol = default_protocol("arms", environment.default, environment.name, arms=arms)
    assert protocol.arms[0].keys["sleep"] == ("Space",)
    with pytest.raises(StudyError, match=r"keys of the arm 'swapped' must be codes .* 'Tab'"):
        default_protocol(
            "arms",
            environment.default,
            environment.name,
            arms=[{"name": "swapped", "keys": {**keys, "do": ["Tab"]}}, {"name": "control"}],
        )
