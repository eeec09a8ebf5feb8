"""The call `score`: people beside policies on the instances that people played."""

import json

import numpy as np
import pytest

from humanplay import score
from humanplay.cli.pilot.errors import PilotError
from humanplay.tasks.gymnasium.values import packed, unpacked
from tests.app.tasks.test_gymnasium import begin, play
from tests.support.recorded import ask

LAKE = "gymnasium:FrozenLake-v1"
POLE = "gymnasium:CartPole-v1"
WALLED = "gymnasium:tests.support.four_ways:Walled"
LEVERS = "gymnasium:tests.support.four_ways:Levers"
STRAIGHT = ("down", "down", "right", "right", "down", "right")


@pytest.fixture
def database(tmp_path):
    return tmp_path / "playground.db"


def played(server, people, episodes=1, moves=STRAIGHT):
    """Let people play episodes by keys, and return their clients."""
    clients = [server.page() for _ in range(people)]
    for client in clients:
        for _ in range(episodes):
            play(server, client, begin(server, client, player="human"), moves)
    return clients


def leave(server, client, moves=1):
    """Make some moves of an episode and begin another board."""
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        for action in STRAIGHT[:moves]:
            socket.act(frame, action, input="key")
            frame = socket.frame_after(frame["step"])
    assert frame["outcome"] is None
    return begun


class Model:
    """Decides by the observation and by what it remembers, as recurrent models do."""

    def __init__(self):
        self.starts = []

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert deterministic
        assert (observation.dtype, observation.shape) == (np.float32, (4,))
        self.starts.append(bool(episode_start[0]))
        assert (state is None) == self.starts[-1]
        return np.array([1]), (state or 0) + 1


def test_a_policy_that_raises_is_named_once_with_the_seed(serve, database):
    server = serve(task=LAKE)
    played(server, people=1)
    ((seed,),) = ask(database, "SELECT seed FROM episodes WHERE seed IS NOT NULL")
    server.stop()

    def broken(observation):
        raise KeyError("north")

    with pytest.raises(PilotError) as raised:
        score(database, {"mine": broken})
    assert str(raised.value) == f"the policy 'mine' failed: KeyError: 'north'; on seed {seed}"


def test_people_stand_beside_random_actions_and_policies_on_what_they_played(serve, database):
    server = serve(task=POLE)
    played(server, 5, moves=("left", "right"))
    played(server, 1, episodes=3, moves=("left", "right"))
    model = Model()
    shown = score(database, {"mine": model, "by hand": lambda observation: 0})
    rows = ask(
        database, "SELECT owner_id, score FROM episodes e JOIN sessions s ON s.id = session_id"
    )
    people = {person: [value for owner, value in rows if owner == person] for person, _ in rows}
    mean = np.mean([np.mean(values) for values in people.values()])
    assert shown.people.mean == pytest.approx(mean)
    assert (shown.count, shown.fewest, shown.most) == (6, 1, 3)
    assert shown.people.interval[0] <= mean <= shown.people.interval[1]
    assert [line.name for line in shown.policies] == ["random", "mine", "by hand"]
    assert model.starts.count(True) == 8, "each instance is played once"
    text = str(shown)
    assert "6 people, 1 to 3 episodes each · random " in text
    assert "pilot: people chose how often to play." in text
    assert "humanplay study new NAME --env CartPole-v1" in text
    assert json.loads(json.dumps(shown.to_dict()))["count"] == 6
    assert "<table>" in shown._repr_html_()


def test_people_who_are_surely_worse_than_random_have_no_normalized_score(serve, database):
    played(serve(task=POLE), 6, moves=("left",))
    shown = score(database, {"by hand": lambda observation: 0})
    random, mine = shown.policies
    assert shown.people.interval[1] < random.mean
    assert (mine.normalized, mine.normalized_interval) == (None, None)
    assert "human-normalized" not in shown.headline


def pull(server, *levers):
    """Let as many people make the first move of an episode."""
    for lever in levers:
        client = server.page()
        begun = begin(server, client, player="human")
        with server.socket(begun["session"], client) as socket:
            socket.act(socket.receive("frame"), lever, input="touch")
            while socket.receive("frame")["outcome"] is None:
                pass


def test_an_environment_that_fails_at_the_first_move_is_named_beside_the_score(serve, database):
    server = serve(task=LEVERS)
    pull(server, *"01")
    server.stop()
    shown = score(database)
    assert shown.count == 1
    text = "not counted: 1 episode in which the environment failed at the first move"
    assert text in str(shown)


def test_random_actions_that_break_the_environment_hide_nobody(serve, database):
    server = serve(task=LEVERS)
    pull(server, *"0000")
    server.stop()
    shown = score(database, {"mine": lambda observation: 0})
    assert (shown.people.mean, shown.count) == (1, 4)
    assert [line.name for line in shown.policies] == ["mine"]
    assert "random actions are left out: the episode of 'random' on seed" in str(shown)
    assert "the lever is broken" in str(shown)


def test_no_policy_takes_the_place_of_random_actions(serve, database):
    played(serve(task=LAKE), 1)
    with pytest.raises(PilotError, match="call your policy something else"):
        score(database, {"random": lambda observation: 0})


def test_below_five_people_there_is_no_interval_and_the_number_stands_beside(serve, database):
    played(serve(task=LAKE), 1)
    shown = score(database)
    assert shown.people.interval is None
    assert "1 person, 1 episode each" in str(shown)
    assert "no interval below 5 people" in str(shown)


def test_leaving_never_raises_the_figure_where_the_lowest_score_is_known(serve, database):
    server = serve(task=LAKE)
    clients = played(server, 3)
    before = score(database)
    assert before.states == {"ended": 3, "left": 0, "failed": 0, "open": 0}
    for number, client in enumerate(clients, 1):
        leave(server, client)  # it stays open, and then counts as left
        still_open = score(database)
        assert still_open.states["open"] == 1
        assert still_open.people.mean <= before.people.mean
        begin(server, client, player="human", seed=5)  # which abandons it
        after = score(database)
        assert after.states == {"ended": 3, "left": number, "failed": 0, "open": 0}
        assert after.people.mean == still_open.people.mean
        before = after
    assert before.left_as == 0.0
    text = str(before)
    assert "of 6 episodes: 3 left; each counts 0.00, the lowest score that there can be" in text
    assert "50 % of the episodes did not end: people" in text


def test_without_a_known_bound_it_says_that_leaving_can_raise_the_figure(serve, database):
    server = serve(task=POLE)
    (client,) = played(server, 1, moves=("left",))
    leave_pole = begin(server, client, player="human")
    with server.socket(leave_pole["session"], client) as socket:
        socket.act(socket.receive("frame"), "left", input="key")
        socket.receive("frame")
    begin(server, client, player="human", seed=5)
    shown = score(database)
    (ended,) = ask(database, "SELECT score FROM episodes WHERE outcome = 'ended'")[0]
    assert shown.left_as == ended, "the worst score of an episode that ended"
    assert "leaving an episode can raise the figure" in str(shown)


def test_chosen_and_repeated_instances_do_not_count(serve, database):
    server = serve(task=LAKE)
    client = server.page()
    play(server, client, begin(server, client, player="human", seed=3), STRAIGHT)
    with pytest.raises(
        PilotError,
        match=r"nothing counts yet.*; not counted: 1 episode on an instance that was chosen or met before$",
    ):
        score(database)


def test_episodes_that_no_person_moved_do_not_count_and_are_named(serve, database):
    server = serve(task=LAKE)
    client = server.page()
    # as a page sends moves if `navigator.webdriver` is true
    play(server, client, begin(server, client, player="human"), STRAIGHT, input=None)
    with pytest.raises(PilotError, match="not counted: 1 episode of a program, such as a browser"):
        score(database)
    played(server, 1)
    assert "not counted: 1 episode of a program" in str(score(database))


def test_where_no_episode_has_ended_and_no_bound_is_known_there_is_no_figure(serve, database):
    server = serve(task=POLE)
    client = server.page()
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "left", input="key")
        socket.receive("frame")
    with pytest.raises(PilotError, match=r"no lowest score is known.*name `bounds`"):
        score(database)


@pytest.mark.parametrize(
    ("policy", "text"),
    [
        (lambda observation: [1, 2], "expected an action of Discrete"),
        (lambda observation: 9, "expected an action of Discrete"),
        (
            3,
            "expected a policy's file, a function of the observation, or an object with predict; got int",
        ),
        ("no-file.onnx", "no-file.onnx"),
    ],
)
def test_a_policy_that_cannot_play_is_refused(serve, database, policy, text):
    played(serve(task=LAKE), 1)
    with pytest.raises(PilotError, match=text):
        score(database, {"mine": policy})


def test_a_policy_that_ends_at_what_is_not_allowed_is_advised_to_take_masks(serve, database):
    server = serve(task=WALLED)
    client = server.page()
    begun = begin(server, client, player="human")
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            is_open = "0" in (frame["allowed"] or "0")
            socket.act(frame, "0" if is_open else "2", input="touch")
            frame = socket.frame_after(frame["step"])
    server.stop()
    with pytest.raises(PilotError, match=r"there is a wall.*'3' was not allowed .*`action_masks`"):
        score(database, {"up": lambda observation: 3})

    class Masked:
        def predict(self, observation, action_mask):
            return 2 * (not action_mask[0]), None

    def mine(observation, action_masks):
        return 2 * (not action_masks[0])

    shown = score(database, {"mine": mine, "model": Masked()})
    assert [line.mean for line in shown.policies[1:]] == [1.0, 1.0]


@pytest.mark.parametrize(
    "observation",
    [
        np.int64(3),
        np.arange(6, dtype=np.uint8).reshape(2, 3),
        {"image": np.zeros((2, 2), np.float32), "mission": "go"},
        (np.int32(1), np.array([1.5])),
    ],
)
def test_observations_cross_with_type_and_shape(observation):
    (other,) = unpacked(packed(observation))

    def same(one, two):
        if isinstance(one, dict):
            return all(same(one[name], two[name]) for name in one)
        if isinstance(one, tuple):
            return all(map(same, one, two))
        return (
            type(one) is type(two)
            and np.array_equal(one, two)
            and getattr(one, "dtype", 0) == getattr(two, "dtype", 0)
        )

    assert same(observation, other)
