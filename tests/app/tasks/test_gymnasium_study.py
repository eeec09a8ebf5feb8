"""A study of FourRooms by its commands, from two participants to its derivation."""

import csv
import json
import random
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from humanplay.db.trial import Trial
from humanplay.db.volunteers import Sums
from humanplay.report import cautions
from humanplay.report.statistics.exclusion_sets import everybody_of, people_of
from humanplay.report.statistics.intervals import estimate
from humanplay.report.statistics.study_figures import study_figures
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description
from humanplay.web.simulate import KEY_CODES, Participant, RefusedError
from tests.support import made_studies
from tests.support.absent import environment_without
from tests.support.command import run
from tests.support.declared import DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft
from tests.support.recorded import ask

LAKE = "gymnasium:FrozenLake-v1"
ROOMS = 'gymnasium:{"id": "minigrid:MiniGrid-FourRooms-v0", "max_steps": 3}'


class Wanderer:
    """Chooses any action, again the same with the same seed."""

    def __init__(self, seed, task=LAKE):
        self._dice, self._task = random.Random(seed), task

    def reset(self):
        pass

    def choose(self, frame):
        return self._dice.choice(
            [action for action in environment_of(self._task).actions if action in KEY_CODES]
        )


DECLARED = ("--declarations", DECLARATIONS_FILE)


@pytest.fixture(params=[LAKE, pytest.param(ROOMS, marks=pytest.mark.long)])
def played(request, serve, tmp_path, briefly_examined):
    """The database, once two people have played and the study is closed."""
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--warm-up", 1, "--ranked", 4, "--players", 2, "--recruitment", "open", *DECLARED)
    env = request.param.removeprefix("gymnasium:")
    assert run("study", "new", "any", "--env", env, *sizes, *database) == 0
    edit_draft(draft_of(tmp_path / "playground.db-studies", "any"), debrief_policy="random")
    assert run("study", "freeze", "any", "--underpowered", *database) == 0
    server = serve(task=request.param)
    done, other = (
        Participant(server.page(), "any", Wanderer(number, request.param), server.clock, number)
        for number in range(2)
    )
    for person, stages in ((done, ("debrief",)), (other, ("ranked",))):
        person.call("join")
        while person.me()["stage"] not in stages:
            person.take_step()
    other.take_step()
    other.me()
    secret = [str(seed) for seed in Folder(tmp_path / "playground.db-studies").study("any").seeds()]
    check_that_no_policy_plays(server, done, other, secret)
    for person in (done, other):
        while person.me()["stage"] != "complete":
            person.take_step()
    server.stop()
    assert run("study", "close", "any", "--yes", *database) == 0
    return database


def check_that_no_policy_plays(server, done, other, secret):
    """While the study is open, nobody is shown a policy on its instances."""
    rows, texts = server.services.store.connection.execute, []
    episodes = rows("SELECT id FROM episodes").fetchall()
    assert len(episodes) == 6 + 3, "with the tutorials"
    stranger = server.page()
    assert stranger.post("/api/sessions", json={"player": "random"}).status_code == 201

    def check(client, path, *statuses, **body):
        answer = client.post(path, json=body) if body else client.get(path)
        assert answer.status_code in statuses, (path, body, answer.status_code, answer.text[:300])
        texts.append(answer.text)

    for client in (done.client, other.client, stranger):
        for (episode,) in episodes:
            for ending in ("", "/replay", "/costs", "/ghost?policy=random"):
                check(client, f"/api/episodes/{episode}{ending}", 404)
            for ending in ("", ".html?ghost=random"):
                check(client, f"/replay/{episode}{ending}", 404)
            check(client, f"/api/watch/{episode}", 404)
        for person in (done, other):
            session, frame = person.where["session"], person.frame
            at, refused = f"/api/sessions/{session}", 409 if client is person.client else 404
            check(client, f"/api/watch/{session}", 404)
            check(client, f"{at}/pace", refused, follow=True)
            check(client, f"{at}/episodes", refused, seed=1)
            check(client, f"{at}/act", refused, episode=frame["episode"], step=0, action="left")
            for rival in (None, "random"):
                statuses = 404, 422
                check(
                    client,
                    "/api/sessions",
                    *statuses,
                    player="random",
                    rival=rival,
                    replays=session,
                )
        for ending in ("", "/costs"):
            check(client, f"/api/studies/any/debrief/0{ending}?phase=ranked", 404, 409)
    assert not [seed for seed in secret for text in texts if seed in text]
    warm_up = done.client.get("/api/studies/any/debrief/0?phase=warm_up").json()
    assert warm_up["policy"]["frames"], "it does play the warm-up"
    ((seed,),) = rows("SELECT seed FROM episodes WHERE driver LIKE 'policy:%'").fetchall()
    assert str(seed) not in secret, "what was begun above"


def reported_with_study_alone(database, folder):
    """The same report's numbers with only the extra [study] installed."""
    numbers = folder / "alone.json"
    command = [sys.executable, "-m", "humanplay.cli", "report", "--study", "any", *database]
    absent = ("numba", "llvmlite", "viser", "onnx", "onnxruntime", "torch", "pyarrow")
    files = ("--html", folder / "alone.html", "--json", numbers)
    subprocess.run([*command, *files], env=environment_without(absent, folder), check=True)
    return json.loads(numbers.read_text())


def test_a_study_is_played_reported_released_verified_and_derived_again(played, tmp_path, capsys):
    database = played
    assert verify_database(database[1]).findings == ()
    page, numbers = tmp_path / "report.html", tmp_path / "report.json"
    files = ("--html", page, "--json", numbers)
    assert run("report", "--study", "any", *database, *files) == 0
    report = json.loads(numbers.read_text())
    alone = reported_with_study_alone(database, tmp_path)
    assert alone | {"made_at": report["made_at"]} == report
    (group,) = report["groups"]
    (scores,) = ask(
        database[1],
        "SELECT avg(score) FROM episodes e JOIN series_episodes s ON s.episode_id = e.id WHERE phase = 'ranked'",
    )
    figure = group["figures"][0]
    assert figure["score"]["mean"] == pytest.approx(scores[0])
    assert (figure["players"], figure["episodes"]) == (2, 8)
    text = page.read_text()
    assert (tmp_path / "report-methods.html").is_file()
    assert (tmp_path / "report-checklist.html").is_file()
    assert "Moves to success" in text
    share = figure["completed"]["mean"]
    mean = f"{figure['score']['mean']:.4f}"
    cells = r'scope="row">per protocol</th><td [^>]*>2</td><td [^>]*>' + re.escape(mean)
    assert re.search(cells, text)
    assert f"{100 * share:.1f} %" in text
    sees = "People see the whole grid from above; agents are given 7x7 cells before the agent."
    is_rooms = "FourRooms" in report["protocol"]["task"]
    assert (sees in text) == is_rooms
    assert [word for word in ("99 %", "lidar", "rover", "obstacle") if word in text] == []
    assert run("release", "--study", "any", *database, "--out", tmp_path / "bundle") == 0
    datasheet = (tmp_path / "bundle/DATASHEET.md").read_text()
    assert (sees in datasheet) == is_rooms
    with (tmp_path / "bundle/csv/steps.csv").open(newline="") as file:
        steps = list(csv.DictReader(file))
    moves = [(row["episode"], row["action"]) for row in steps]
    assert {(row["row"], row["col"]) for row in steps} == {("", "")}, "no rover stands anywhere"
    path = tmp_path / "bundle/study.sqlite"
    (task,) = {task for (task,) in ask(path, "SELECT task FROM episodes")}
    actions = environment_of(task).actions
    stored = ask(path, "SELECT episode_id, action FROM steps")
    assert sorted(moves) == sorted((episode, actions[code]) for episode, code in stored)
    assert run("verify", "--dataset", tmp_path / "bundle") == 0
    assert run("reproduce", tmp_path / "bundle") == 0
    assert ", 0 differ" in capsys.readouterr().out
    assert run("costs", "--study", "any", *database) == 1
    assert "the moves of FrozenLake-v1 are not judged" in capsys.readouterr().err


@pytest.mark.long
def test_a_server_of_another_task_says_what_to_do_and_one_of_this_takes_its_keys(
    serve, tmp_path, capsys
):
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--warm-up", 0, "--ranked", 1, "--players", 2, "--recruitment", "open", *DECLARED)
    for name, task in (("lake", ("--env", "FrozenLake-v1")), ("mars", ())):
        assert run("study", "new", name, *task, *sizes, *database) == 0
        assert run("study", "freeze", name, "--underpowered", *database) == 0
        cautioned = "of 20 seeds only 1 looks different at the start" in capsys.readouterr().out
        assert cautioned == (name == "lake")
    for name, of, plays in (("lake", LAKE, "mars"), ("mars", "mars", LAKE)):
        server = serve(task=plays)
        answer = server.page().post(f"/api/studies/{name}/join")
        server.stop()
        assert answer.status_code == 409
        titles = environment_of(of).about.title, environment_of(plays).about.title
        assert "is of {}, and this server plays {}".format(*titles) in answer.json()["detail"]
    server = serve(task=LAKE)
    person = Participant(server.page(), "lake", Wanderer(0), server.clock)
    person.call("join")
    person.call("settings", {"keys": {"left": ["KeyH"]}})
    with pytest.raises(RefusedError, match="expected keys of left, down, right, up, ") as refused:
        person.call("settings", {"keys": {"north": ["KeyH"]}})
    assert refused.value.status == 422


def test_what_was_left_is_worth_what_is_spoilt_and_a_score_beyond_its_bounds_stops_no_report():
    task = f"gymnasium:{Description(id='FrozenLake-v1', bounds=(1, 500)).told}"
    config = environment_of(task).default
    protocol = default_protocol("lake", config, task, ranked=3)

    def trial(person, number, outcome, score, attestation="attested"):
        return Trial(
            id=f"{person}{number}", session_id=person, number=number, task=task, core_version="", config=config, seed=number,
            seed_chosen=False, terrain=b"", start=(0, 0), policy_seed=0, driver="human", assisted=False, started_ms=1,
            ended_ms=2, outcome=outcome, steps=9, total=score, score=score, attestation=attestation, participant=person,
            phase="ranked", trial=number, terrain_index=number,
        )  # fmt: skip

    played = [("ended", 300.0), ("ended", 700.0)]
    left = [("abandoned", 499.0), ("environment_failed", 400.0), ("ended", 450.0, "spoilt")]
    trials = [trial("a", number, *fields) for number, fields in enumerate(played)]
    trials += [trial("b", number, *fields) for number, fields in enumerate(left)]
    people = [made_studies.person(0), made_studies.person(1)]
    trials = [replace(trial, participant=people[trial.participant == "b"].id) for trial in trials]
    data = replace(made_studies.study(people, trials), protocol=protocol)
    cohort = people_of(data)
    assert [trial.score for trial in cohort.ranked[people[1].id]] == [1, 1, 1]
    assert [Sums.of(trial).score for trial in trials[2:]] == [1, 1, 1]
    finished, everybody, *_ = study_figures(data, cohort, everybody_of(data, cohort))
    spoilt_mean = (1 + 1 + 450) / 3  # spoilt without a sign of a program: as it was played
    assert everybody.score.mean == pytest.approx(((300 + 700 + 1) / 3 + spoilt_mean) / 2)
    assert finished.players == 0, "one lacks a terrain, the other gave up two of three"
    (caution,) = cautions._about_bounds(data)
    assert "1 ranked episode of 5 ended with a score outside the bounds" in caution
    assert estimate(np.array([[120.0], [300.0], [0.0]]), (1, 500), 1).mean == 140
