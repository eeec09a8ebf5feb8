"""A study of Breakout at 60 frames a second, from its keys to its derivation."""

import json

import minari
import numpy as np
import pytest

from humanplay.study.verification import verify_database
from humanplay.web.simulate import Participant
from tests.support.command import run
from tests.support.declared import DECLARATIONS_FILE
from tests.support.keyboard import Keyboard
from tests.support.recorded import ask

pytest.importorskip("ale_py")
BREAKOUT = {"id": "ale_py:ALE/Breakout-v5", "max_steps": 300}
TASK = "gymnasium:" + json.dumps(BREAKOUT, sort_keys=True, separators=(",", ":"))


class Player(Participant):
    """A participant who plays by holding keys, until time is over."""

    def play(self, moves=None, **act):
        with self.socket() as socket:
            me = Keyboard(socket)
            self.histories = [socket.receive("history")]
            me.go_on()
            codes = ("Space", "ArrowLeft", "ArrowRight")
            self.scores = set()
            while me.frame["outcome"] is None:
                self.scores |= {me.frame["return"], self.histories[0]["headlines"][-1]}
                me.hold(codes[self._tempo.randrange(3)], self._tempo.randint(3, 15))
        return [me.frame]


@pytest.fixture
def played(serve, tmp_path):
    """The database, once two people have played and the study is closed."""
    file = tmp_path / "breakout.toml"
    file.write_text('id = "ale_py:ALE/Breakout-v5"\nmax_steps = 300\n')
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--warm-up", 0, "--ranked", 1, "--players", 2, "--recruitment", "open")
    declared = ("--declarations", DECLARATIONS_FILE)
    assert run("study", "new", "breakout", "--env", file, *sizes, *declared, *database) == 0
    assert run("study", "freeze", "breakout", "--underpowered", *database) == 0
    out = tmp_path / "preregistration.md"
    assert run("study", "preregister", "breakout", "--out", out, *database) == 0
    assert "Time runs at 60 frames a second." in out.read_text()
    server = serve(task=TASK)
    for number in range(2):
        person = Player(server.page(), "breakout", None, server.clock, number)
        person.call("join")
        while person.me()["stage"] != "complete":
            ranked = person.where["stage"] == "ranked"
            person.take_step()
            if ranked:
                assert person.scores == {None}  # hidden until the end, of the path as well
    server.stop()
    assert run("study", "close", "breakout", "--yes", *database) == 0
    return database


@pytest.mark.long
def test_a_study_is_played_reported_released_verified_and_derived_again(
    played, tmp_path, capsys, monkeypatch
):
    database = played
    assert verify_database(database[1]).findings == ()
    sql = "SELECT phase, attestation, steps FROM episodes e JOIN series_episodes s ON s.episode_id = e.id"
    rows = ask(database[1], sql)
    assert [row for row in rows if row[0] == "ranked"] == [("ranked", "attested", 300)] * 2
    numbers = tmp_path / "report.json"
    report = ("report", "--study", "breakout", "--html", tmp_path / "r.html", "--json", numbers)
    assert run(*report, *database) == 0
    (group,) = json.loads(numbers.read_text())["groups"]
    figure = group["figures"]["all"] if isinstance(group["figures"], dict) else group["figures"][0]
    assert (figure["players"], figure["episodes"]) == (2, 2)
    bundle = tmp_path / "bundle"
    assert run("release", "--study", "breakout", *database, "--out", bundle) == 0
    assert run("verify", "--dataset", bundle) == 0
    assert run("reproduce", bundle) == 0
    assert ", 0 differ" in capsys.readouterr().out
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(bundle / "minari"))
    dataset = minari.load_dataset("marsexplorer/breakout/human-v1")
    about = list(dataset.storage.get_episode_metadata(range(dataset.total_episodes)))
    env = dataset.recover_environment()
    for described, episode in zip(about, dataset, strict=True):
        seen = [
            env.reset(seed=described["seed"])[0],
            *(env.step(action)[0] for action in episode.actions),
        ]
        assert np.array_equal(seen, episode.observations), "every frame of 60 a second"
