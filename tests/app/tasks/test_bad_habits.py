"""Environments with bad habits play, are refused, or end their own episode."""

import re

import pytest

from humanplay.study.folder import Folder
from humanplay.task import Choice, RunEndedError
from humanplay.task.registration import Start, environment_of, serve
from humanplay.tasks.gymnasium.task import GymnasiumTask
from humanplay.web import server
from humanplay.web.settings import Settings
from tests.app.admin.test_admin import PASSWORD
from tests.app.tasks.test_gymnasium import begin
from tests.support import bad_habits
from tests.support.recorded import ask

ADAPTERS = 'wrappers = ["humanplay.tasks.gymnasium.adapters'
PLAYS = {
    "StartsAtOne": ("1", "2", "3"),
    "TwoWheels": ("0_0", "0_1", "1_0", "1_1", "2_0", "2_1"),
    "Switches": ("0_0_0", "0_0_1", "0_1_0", "0_1_1", "1_0_0", "1_0_1", "1_1_0", "1_1_1"),
    "Grey": ("0", "1"),
    "Transparent": ("0", "1"),
    "Listed": ("0", "1"),
    "Talks": ("0", "1"),
}
REFUSED = {
    "ManyWheels": f'{ADAPTERS}:OneAtATime"]',
    "Crowd": f'{ADAPTERS}:FirstActions"] in its file offers the first 64',
    "Throttle": f'{ADAPTERS}:OneAtATime"]',
    "Words": "name a wrapper of your own that has discrete actions",
    "FloatPicture": "from 0.5 to 0.5: expected a picture (uint8, rows x columns x 3); return (255 * picture)",
    "NoPicture": "render returned nothing: expected a picture",
    "ChannelsFirst": "return np.moveaxis(picture, 0, -1)",
    "TwoGoals": "LinearReward",
    "OldReset": "reset returned int: expected (observation, info)",
    "NoReset": "KeyError: 'no level file'",
    "Objects": "return numbers and texts, and dictionaries and tuples of them",
    "NoMode": "let it make the environment with render_mode='rgb_array'",
    "Asks": "EOFError",
}
ENDS = {
    "TwoRewards": "LinearReward",
    "OldStep": "not enough values to unpack (expected 5, got 4)",
    "Raises": "KeyError: 'no such room'",
    "Exits": "its process ended by itself",
    "NotANumber": "its return is nan, which is no finite number",
}


def test_the_table_has_every_habit():
    named = {
        name
        for name, kind in vars(bad_habits).items()
        if isinstance(kind, type) and kind.__module__ == bad_habits.__name__
    }
    assert named - {"Habit"} == {*PLAYS, *REFUSED, *ENDS}
    assert len(named) > 20


def task_of(name):
    return f"gymnasium:tests.support.bad_habits:{name}"


@pytest.mark.parametrize("name", PLAYS)
def test_it_plays_by_every_action(name):
    task = serve(task_of(name), Start())
    try:
        assert task.actions == PLAYS[name]
        assert all(task.keys.values())
        run = task.begin(Choice(task.configuration({}), 1))
        for code in range(len(task.actions)):
            run.step(code)
        assert (run.outcome, run.total) == ("running", len(task.actions))
    finally:
        task.close()


@pytest.mark.parametrize("name", REFUSED)
def test_it_is_refused_before_the_page_opens_with_the_way_out(name):
    with pytest.raises(ValueError, match=re.escape(REFUSED[name])):
        serve(task_of(name), Start())


@pytest.mark.parametrize("name", ENDS)
def test_it_ends_its_own_episode_and_the_author_reads_why(name, caplog):
    task = serve(task_of(name), Start())
    try:
        run = task.begin(Choice(task.configuration({}), 1))
        with pytest.raises(RunEndedError):
            run.step(1)
        assert run.outcome == "environment_failed"
        assert ENDS[name] in caplog.text
        assert "seed 1, step 1, action 1 (1)" in caplog.text
    finally:
        task.close()


def test_what_it_raises_is_on_the_episode_s_row_and_on_the_operator_s_page(serve, tmp_path):
    server = serve(task=task_of("Raises"), admin_password=PASSWORD)
    client = server.page()
    begun = begin(server, client, player="human", seed=7)
    with server.socket(begun["session"], client) as socket:
        socket.act(socket.receive("frame"), "1")
        assert socket.receive("frame")["outcome"] == "environment_failed"
    ((report,),) = ask(tmp_path / "playground.db", "SELECT failure FROM episodes")
    assert report.startswith("step 1, action 1 (1): KeyError: 'no such room'\nTraceback")
    assert "bad_habits.py" in report
    operator = server.page()
    assert operator.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    (failure,) = operator.get("/api/admin/overview").json()["failures"]
    assert (failure["report"], failure["seed"]) == (report, 7)
    answer = client.get(f"/api/episodes/{begun['frame']['episode']}")
    assert "Traceback" not in answer.text


def test_policies_and_exports_have_the_environment_s_own_action():
    rule = "tests.support.bad_habits:decide_as_it_is"
    task = GymnasiumTask("tests.support.bad_habits:TwoWheels", [rule])
    config = task.configuration({"max_steps": 3})
    try:
        run = task.policies.play(task.policies.load(rule), config, 1, 1)
        assert [task.actions[code] for code in run.actions] == ["2_1"] * 3
    finally:
        task.close()
    actions = environment_of(task.name).own_actions(config, bytes(run.actions))
    assert actions.tolist() == [[2, 1]] * 3


def test_one_that_does_not_start_is_left_out_and_named_unless_a_study_of_it_runs(tmp_path, capsys):
    first, other = "gymnasium:FrozenLake-v1", task_of("NoPicture")
    settings = Settings(database=tmp_path / "play.db", port=0, task=first, more=(other,))

    class OpenedError(Exception):
        """The server answers: the test has seen enough."""

    def opened(address):
        raise OpenedError

    with pytest.raises(OpenedError):
        server.run(settings, opened)
    assert "nopicture is left out: render returned nothing" in capsys.readouterr().out
    rooms = Folder.beside(tmp_path / "play-nopicture.db").root / "rooms"
    rooms.mkdir(parents=True)
    for file in ("protocol.json", "frozen.json"):
        (rooms / file).write_text("{}")
    with pytest.raises(server.ServerError, match="nopicture does not start, and its study 'rooms'"):
        server.run(settings, opened)
