"""Policies of an environment, each in a process of its own."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from humanplay.release.bundle import initials
from humanplay.study.verification import verify_database
from humanplay.task import Choice, PolicyError
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from humanplay.tasks.gymnasium.task import GymnasiumTask
from humanplay.tasks.policies import chooser, prepare_source
from humanplay.tasks.processes import NO_NETWORK, NO_OTHER_FILES
from tests.support import environments

PATH, OWN = "tests.support.environments:Path-v0", "tests.support.environments"


def network(path, shape, nodes, weights, out, kind=TensorProto.FLOAT, name="input"):
    """Write a network as Stable-Baselines3 exports it: a batch of one in, actions out."""
    observed = helper.make_tensor_value_info(name, kind, [1, *shape])
    actions = helper.make_tensor_value_info("actions", out, None)
    held = [
        helper.make_tensor(key, TensorProto.FLOAT, value.shape, value.ravel())
        for key, value in weights.items()
    ]
    graph = helper.make_graph(nodes, "policy", [observed], [actions], held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, path)
    return path


@pytest.fixture
def balancing(tmp_path):
    """Pushes the cart to the side that its pole falls to."""
    weights = {"w": np.array([[0, 0], [0, 0], [-1, 1], [-1, 1]], np.float32)}
    nodes = [
        helper.make_node("MatMul", ["input", "w"], ["q"]),
        helper.make_node("ArgMax", ["q"], ["actions"], axis=1, keepdims=0),
    ]
    return network(tmp_path / "balancing.onnx", [4], nodes, weights, TensorProto.INT64)


@pytest.fixture
def new_task():
    tasks = []

    def make(text, *policies):
        tasks.append(GymnasiumTask(text, policies))
        return tasks[-1]

    yield make
    for task in tasks:
        task.close()


def played(task, name, seed=3):
    policy = task.policies.load(name)
    return task.policies.play(policy, task.default, seed, seed)


def test_an_onnx_file_decides_by_observations_alone(new_task, balancing):
    task = new_task("CartPole-v1", str(balancing))
    assert [offer.name for offer in task.policies.offers()] == ["random", "balancing"]
    assert len(played(task, "balancing").actions) > 3 * len(played(task, "random").actions)


def test_a_picture_is_given_channels_first_where_the_network_has_them_so(tmp_path):
    nodes = [helper.make_node("ReduceSum", ["input", "axes"], ["actions"], keepdims=0)]
    path = network(tmp_path / "n.onnx", [3, 2, 5], nodes, {}, TensorProto.FLOAT)
    model = onnx.load(path)
    model.graph.initializer.append(helper.make_tensor("axes", TensorProto.INT64, [2], [2, 3]))
    onnx.save(model, path)
    picture = np.zeros((2, 5, 3), np.uint8)
    picture[..., 2] = 7
    assert chooser(str(path), 0)(picture, np.ones(3, bool)) == 2


def test_an_entry_of_an_observation_is_given_by_its_name(tmp_path):
    nodes = [helper.make_node("Identity", ["direction"], ["actions"])]
    kind = TensorProto.INT64
    path = network(tmp_path / "n.onnx", [], nodes, {}, kind, kind, "direction")
    observation = {"image": np.zeros(3), "direction": 2}
    assert chooser(str(path), 0)(observation, np.ones(4, bool)) == 2


def test_random_actions_are_valid_and_follow_from_the_seed(new_task):
    draw = chooser("random", 5)
    drawn = {draw(None, np.array([0, 1, 0, 0, 1, 0], bool)) for _ in range(50)}
    assert drawn == {1, 4}
    task = new_task("FrozenLake-v1")
    first, again, other = (bytes(played(task, "random", seed).actions) for seed in (1, 1, 2))
    assert first == again != other


def test_what_it_decided_is_remembered_as_an_episode_goes_on_elsewhere(new_task):
    """On a resumed board, the policy decides as it did before."""
    task = new_task("FrozenLake-v1")
    whole = bytes(played(task, "random", 1).actions)
    policy = task.policies.load("random")
    policy.reset(1)
    run = task.begin(Choice(task.default, 1))
    for step, action in enumerate(whole):
        if step == 2:
            policy = task.policies.load("random")
            policy.reset(1)
        for _ in range(2):  # asked again, it has decided
            assert policy.act(run.view().observation()) == action
        run.step(action)
    assert run.outcome != "running"


def test_what_cannot_play_says_why(new_task):
    with pytest.raises(PolicyError, match="expected random, module:function or an ONNX file"):
        new_task(PATH, "there_is_none.onnx")
    with pytest.raises(PolicyError, match="expected an action of Discrete"):
        new_task(PATH, f"{OWN}:nowhere").guards()
    with pytest.raises(ValueError, match="expected a function as module:function"):
        prepare_source(f"{OWN}:none")


@pytest.mark.usefixtures("executed_preparers")
def test_a_function_is_guarded_as_a_board_is(new_task):
    task = new_task(PATH, f"{OWN}:nosy")
    guards = task._boards.preparer.guards()
    if guards[NO_NETWORK] or guards[NO_OTHER_FILES]:
        pytest.skip(task.guards())
    with pytest.raises(RuntimeError, match="it sees"):
        environments.nosy(0)
    policy = task.policies.load(f"{OWN}:nosy")
    run = task.begin(Choice(task.default, 3))
    assert policy.act(run.view().observation()) == 1


def test_it_plays_beside_a_person_and_by_itself_and_both_are_verified(serve, tmp_path):
    rule = f"{OWN}:forward"
    server = serve(task=f"gymnasium:{PATH}", offered=(Path(rule),))
    client = server.page()
    assert [policy["name"] for policy in client.get("/api/policies").json()] == ["random", rule]
    begun = client.post("/api/sessions", json={"rival": rule}).json()
    with (
        server.socket(begun["session"], client) as mine,
        server.socket(begun["rival"]["session"], client) as theirs,
    ):
        frame = mine.receive("frame")
        for step in (1, 2):
            mine.act(frame, "back")
            frame = mine.frame_after(frame["step"])
            seen = theirs.receive("frame")
            while seen["step"] < step:
                seen = theirs.receive("frame")
        assert seen["text"].index("@") >= 2
    alone = client.post("/api/sessions", json={"player": rule}).json()
    with server.socket(alone["session"], client) as board:
        frame = board.receive("frame")
        while frame["outcome"] is None:
            frame = board.receive("frame")
    assert frame["outcome"] == "ended"
    refused = client.post("/api/sessions", json={"rival": "ppo"})
    assert (refused.status_code, "choose one of: random" in refused.text) == (422, True)
    server.stop()
    assert verify_database(tmp_path / "playground.db").findings == ()


def test_moves_of_actions_that_share_an_initial_are_told_apart_in_a_release():
    assert initials(environment_of("mars")) == "NESW"
    for name in ("gymnasium:minigrid:MiniGrid-FourRooms-v0", "gymnasium:Taxi-v4"):
        letters = initials(environment_of(name))
        assert len(set(letters)) == len(environment_of(name).actions)


def test_a_study_measures_them_on_its_seeds(new_task, balancing):
    environment = GymnasiumEnvironment("CartPole-v1")
    episodes = [
        *environment.policies.play_all(["random", str(balancing)], environment.default, [4, 5])
    ]
    environment.policies.close()
    assert [(source, seed) for source, seed, _, _ in episodes] == [
        ("random", 4), ("random", 5), (str(balancing), 4), (str(balancing), 5),
    ]  # fmt: skip
    for _, seed, moves, digest in episodes:
        assert environment.run(environment.default, seed, moves).digest == digest
    assert environment.policies.compared == ("random",)
