"""Synthetic participants go through whole studies and enter no human score."""

import threading
from collections import Counter
from contextlib import closing
from itertools import groupby

import numpy as np
import pytest

from humanplay.db.reader import Reader
from humanplay.report.build import build
from humanplay.report.statistics.human_level import human_level
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.web.simulate import NoisyPolicy, Plan, RefusedError, ServerAwayError, simulate
from tests.support.command import command
from tests.support.declared import DECLARATIONS
from tests.support.recorded import ask
from tests.support.servers import eventually
from tests.support.study import freeze

FAST = 1e6
ENDLESS = {"warm_up": 20, "ranked": 60}
"""A study that lasts until it is interrupted, however fast its participants are."""


class Simulation(threading.Thread):
    """Participants at work in a thread of their own; `result()` waits for them."""

    def __init__(self, url, study, participants, **rest):
        super().__init__(daemon=True)
        self.plan = Plan(url, study.name, participants, **{"speed": FAST, **rest})
        self.summaries, self.error = [], None
        self.start()

    def run(self):
        try:
            simulate(self.plan, self.summaries)
        except BaseException as error:
            self.error = error

    @property
    def moves(self):
        return sum(len(summary.round_trips_ms) for summary in self.summaries)

    def result(self, seconds=180.0):
        self.join(seconds)
        assert not self.is_alive(), "the participants are still at it"
        if self.error is not None:
            raise self.error
        return self.summaries

    def reaches(self, moves, seconds=120.0):
        """Wait until so many moves were answered."""
        eventually(lambda: self.error or self.moves >= moves, seconds)


def check_database(path, study, moves, kills):
    """Every participant has exactly their episodes, every episode its moves.

    All of it is a script's.
    """
    protocol = study.protocol
    people = ask(path, "SELECT id, kind, stage FROM participants")
    assert {kind for _, kind, _ in people} == {"script"}
    assert ask(path, "SELECT DISTINCT driver FROM episodes") == [("script",)]
    for person, _, stage in people:
        sql = """SELECT t.phase, t.trial, t.terrain, e.seed, e.outcome FROM series_episodes t
            JOIN episodes e ON e.id = t.episode_id WHERE t.participant_id = ? ORDER BY t.phase, t.trial"""
        played = {
            phase: list(group)
            for phase, group in groupby(ask(path, sql, person), lambda row: row[0])
        }
        phases = (("warm_up", "warm-up", protocol.warm_up), ("ranked", "ranked", protocol.ranked))
        for phase, label, of in phases:
            trials = played.get(phase, [])
            assert [trial for _, trial, *_ in trials] == list(range(len(trials)))
            assert all(seed == study.seed(label, terrain) for _, _, terrain, seed, _ in trials)
            assert len({terrain for _, _, terrain, *_ in trials}) == len(trials)
            if stage == "complete":
                assert len(trials) == of
        assert len(played["tutorial"]) == 1
        if stage == "complete":
            assert all(outcome for trials in played.values() for *_, outcome in trials)
    steps = "SELECT episode_id, count(*), min(step), max(step) FROM steps GROUP BY episode_id"
    counts = ask(path, steps)
    assert all((low, high) == (0, count - 1) for _, count, low, high in counts)
    # a kill can lose the frame of a move that is in the database: one a participant, never the move
    assert 0 <= sum(count for _, count, _, _ in counts) - moves <= kills * len(people)
    assert ask(path, "SELECT count(*) FROM identities")[0][0] == len(people)
    events = ask(path, "SELECT count(*) FROM input_events WHERE kind = 'keydown'")[0][0]
    assert moves <= events <= moves + 2 * kills * len(people)


def check_no_human_score(path, study):
    """Nothing of it enters a figure about people."""
    with closing(Reader.open(path)) as reader:
        assert human_level(reader)["figures"] == []
    report = build(load(path, study.name))
    assert [group.figure.players for group in report.groups] == [0]
    assert report.scripts


def check_whole_study(spawn, tmp_path, study, participants, moves, **rest):
    """Kill the server after some moves: everything is there once, and a script's."""
    server = spawn()
    simulation = Simulation(server.url, study, participants, **rest)
    simulation.reaches(moves, 1800)
    server.kill()
    spawn(port=server.port)
    summaries, path = simulation.result(3000), tmp_path / "playground.db"
    check_database(path, study, simulation.moves, kills=1)
    check_no_human_score(path, study)
    verified = verify_database(path, secrets={study.name: study.secret})
    assert verified.findings == ()
    return summaries, verified


def test_a_small_study_survives_a_kill_and_enters_no_human_score(spawn, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", size=9)
    summaries, verified = check_whole_study(spawn, tmp_path, study, 3, 40, seed=3)
    assert [summary.stage for summary in summaries] == ["complete"] * 3
    assert all(summary.code for summary in summaries)
    assert (verified.episodes, verified.still_open) == (3 * 6, 0)


@pytest.mark.long
def test_ten_participants_of_a_whole_study_survive_a_kill(spawn, tmp_path):
    """10 x (15 + 30) at 21x21, some of whom leave, and a kill -9 in the middle."""
    sizes = {"size": 21, "warm_up": 15, "ranked": 30, "players": 10, "break_every": 10}
    study = freeze(tmp_path / "playground.db-studies", **sizes)
    summaries, _ = check_whole_study(spawn, tmp_path, study, 10, 15_000, seed=11, leaving=0.2)
    stages = Counter(summary.stage for summary in summaries)
    assert set(stages) == {"complete", "left"}


def test_those_who_leave_withdraw_or_close_the_page(server, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", size=7, ranked=4)
    simulation = Simulation(server.url, study, 6, seed=4, leaving=1.0)
    assert {summary.stage for summary in simulation.result()} == {"left"}
    path = tmp_path / "playground.db"
    stages = Counter(stage for (stage,) in ask(path, "SELECT stage FROM participants"))
    assert stages["withdrawn"] > 0 < stages["ranked"]
    assert stages.total() == stages["withdrawn"] + stages["ranked"]
    check_database(path, study, simulation.moves, kills=0)
    assert any(trial.outcome is None for trial in load(path, study.name).trials)


def test_the_command_prints_who_came_how_far(server, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies")
    options = "--study", "small", "--url", server.url, "--speed", "1e6"
    code, out, err = command(capsys, "simulate", *options)
    assert code == 0, err
    assert out.count("complete") == 2  # as many as the study plans
    assert "moves; act to frame in ms: p50" in out


def test_whoever_guesses_is_not_sent_away_where_the_tries_of_people_are_limited(server, tmp_path):
    question = {"question": "How many?", "choices": ("1", "2", "3", "4"), "answer": 3}
    study = freeze(tmp_path / "playground.db-studies", question_tries=2, questions=(question,))
    assert [summary.stage for summary in Simulation(server.url, study, 1).result()] == ["complete"]
    answers = "SELECT count(*) FROM stage_events WHERE kind = 'answers'"
    assert ask(tmp_path / "playground.db", answers) == [(4,)]


def test_moves_at_random_are_those_that_can_be_chosen(serve, tmp_path, briefly_examined):
    task = "gymnasium:tests.support.masked_environments:Doors-v0"
    protocol = default_protocol(
        "doors", environment_of(task).default, task=task, declarations=DECLARATIONS, debrief_policy=None,
        policies=(), warm_up=1, ranked=2, players=1,
    )  # fmt: skip
    folder = Folder(tmp_path / "playground.db-studies")
    folder.create(protocol)
    study = folder.freeze("doors")
    summaries = Simulation(serve(task=task).url, study, 1).result()
    assert [(summary.stage, summary.ranked) for summary in summaries] == [("complete", 2)]


@pytest.mark.parametrize("noise", [0.0, 0.5, 1.0])
def test_the_noise_is_the_share_of_random_moves(noise):
    grid = ["@" + "." * 8, *["." * 9] * 5, "." * 8 + "?"]
    frame = {"grid": grid}
    quiet, noisy = (
        NoisyPolicy(environment_of("mars"), "frontier-cost", 0.0, None),
        NoisyPolicy(environment_of("mars"), "frontier-cost", noise, None, 1),
    )
    quiet.reset()
    noisy.reset()
    wanted = quiet.choose(frame)
    share = np.mean([noisy.choose(frame) != wanted for _ in range(400)])
    assert share == pytest.approx(noise / 2, abs=0.08)  # two moves are valid in the corner


def test_each_mistake_is_a_sentence(server, tmp_path, capsys):
    study = freeze(tmp_path / "playground.db-studies")

    def refused(**rest):
        """What the command says, which must be one line."""
        arguments = {"study": study.name, "url": server.url, **rest}
        options = (f"--{name}={value}" for name, value in arguments.items())
        code, _, errors = command(capsys, "simulate", *options)
        assert code in (1, 2)
        assert "Traceback" not in errors
        return errors

    assert "there is no such study here" in refused(study="nobody")
    assert "start one with `humanplay serve`" in refused(url="http://127.0.0.1:9")
    assert "nothing answers GET /prefix/api/studies" in refused(url=f"{server.url}/prefix")
    for url in ("localhost:8000", "http://"):
        assert "must be like http://127.0.0.1:8000" in refused(url=url)
    assert 'no policy "nobodys"' in refused(policy="nobodys")
    Folder(tmp_path / "playground.db-studies").close(study.name)
    assert "is closed" in refused()


def test_closing_the_study_ends_it_for_everybody_with_a_sentence(server, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", size=9, **ENDLESS)
    simulation = Simulation(server.url, study, 2, seed=6, speed=400)
    simulation.reaches(30)
    Folder(tmp_path / "playground.db-studies").close(study.name)
    with pytest.raises(RefusedError, match="closed"):
        simulation.result()


def test_a_server_that_stays_away_ends_it_with_a_sentence(spawn, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", size=9, **ENDLESS)
    server = spawn()
    simulation = Simulation(server.url, study, 1, seed=6, speed=400, wait_s=0.5)
    simulation.reaches(10)
    server.kill()
    with pytest.raises(ServerAwayError, match="has been away"):
        simulation.result()
