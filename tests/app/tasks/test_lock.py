"""An episode of another version is named with its first difference."""

import json

import pytest

from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.lock import GymnasiumLock
from humanplay.tasks.lock import differences
from tests.app.tasks.test_gymnasium import begin, play
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.recorded import alter

LAKE = "gymnasium:FrozenLake-v1"


def test_what_differs_is_said_in_a_few_words():
    here = environment_of(LAKE).lock.current()
    assert [*differences(here, here)] == []
    other = json.loads(json.dumps(here))
    other["packages"]["numpy"]["version"] = "1.26.4"
    other["packages"]["gymnasium"]["record"] = "0"
    other["packages"]["gone"] = {"version": "3", "record": ""}
    other["python"], other["processor"] = "3.9.1", here["processor"] + " AVX9"
    other["setting"]["OPENBLAS_CORETYPE"] = "Prescott"
    numpy, gymnasium = (here["packages"][name]["version"] for name in ("numpy", "gymnasium"))
    assert [*differences(other, here)] == [
        "no gone instead of 3",
        f"gymnasium {gymnasium} with other files",
        f"numpy {numpy} instead of 1.26.4",
        "a processor that differs in AVX9",
        f"python {here['python']} instead of 3.9.1",
        f"OPENBLAS_CORETYPE {here['setting']['OPENBLAS_CORETYPE'] or 'unset'} instead of Prescott",
    ]


def test_an_episode_of_another_version_is_named_with_its_first_difference(monkeypatch):
    environment = environment_of(LAKE)
    run = environment.run(environment.default, 3, bytes([0, 1, 0]))
    run.abandon()
    record, was = run.record(), "gymnasium 0.29.1, numpy 1.26.4"
    object.__setattr__(record, "core_version", was)
    reason = environment.lock.why_not_replayable(record, [0.0, 0.0, 0.0])
    assert reason.startswith("cannot be simulated here: gymnasium ")
    assert "instead of 0.29.1, numpy " in reason
    assert reason.endswith("; no difference in 3 steps")
    assert environment.lock.why_not_replayable(record, [0.0, 1.0, 0.0]).endswith(
        "; first difference at step 2"
    )
    object.__setattr__(record, "trajectory_hash", "0")
    assert environment.lock.why_not_replayable(record, [0.0, 0.0, 0.0]).endswith(
        "; other observations in 3 steps"
    )


def test_a_changed_version_is_found_by_the_chain(serve, tmp_path):
    server = serve(task=LAKE)
    client = server.page()
    play(server, client, begin(server, client), ["right"], input=None)
    server.stop()
    database = tmp_path / "playground.db"
    assert verify_database(database).findings == ()
    alter(database, "UPDATE episodes SET core_version = 'gymnasium 0.29.1, numpy 1.26.4'")
    sentences = [str(finding) for finding in verify_database(database).findings]
    assert "digest of its stored fields" in sentences[0], "what was changed is said first"
    assert "cannot be simulated here: gymnasium" in sentences[-1]
    assert "; no difference in" in sentences[-1]


@pytest.mark.parametrize("part", [pytest.param("python", marks=pytest.mark.long), "packages"])
def test_a_study_is_served_where_it_was_frozen_alone(
    serve, tmp_path, capsys, caplog, part, briefly_examined
):
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--warm-up", 0, "--ranked", 1, "--players", 2, "--recruitment", "open")
    new = ("study", "new", "lake", "--env", "FrozenLake-v1", "--declarations", DECLARATIONS_FILE)
    assert command(capsys, *new, *sizes, *database)[0] == 0
    assert command(capsys, "study", "freeze", "lake", "--underpowered", *database)[0] == 0
    protocol = json.loads((tmp_path / "playground.db-studies/lake/protocol.json").read_text())
    assert protocol["lock"] == json.loads(json.dumps(environment_of(LAKE).lock.current()))
    server = serve(task=LAKE)
    assert server.page().post("/api/studies/lake/join").status_code < 300
    other = {**protocol["lock"], part: {} if part == "packages" else "3.9.1"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(GymnasiumLock, "current", lambda self: other)
        answer = server.page().post("/api/studies/lake/join")
    assert (answer.status_code, "cannot be played on this server now" in answer.text) == (409, True)
    assert {"python": "python 3.9.1 instead", "packages": "no gymnasium instead"}[
        part
    ] in caplog.text
