"""Whole studies by synthetic players against a real server that is killed on the way: nothing lost, doubled or mistaken."""

import asyncio
import json
import signal
import sqlite3
import subprocess
import sys
import threading
from collections import Counter
from contextlib import closing
from itertools import groupby

import pytest

from app.cli.main import main
from app.report.build import build
from app.simulate.cheating import ATTEMPTS
from app.simulate.outcome_log import OutcomeLog
from app.simulate.participant import StudyOverError
from app.simulate.population import SIMULATED_POPULATIONS
from app.simulate.run import simulate
from app.simulate.state_file import SavedPlayers, SimulationConfig, StudyNotReadyError
from app.simulate.true_level import true_level
from app.statistics.human_level import human_level
from app.storage.reader import Reader
from app.study.data import load
from app.study.folder import Folder
from app.study.verification import verify_database
from tests.support.servers import eventually
from tests.support.study import freeze

FAST = 1e6
ENDLESS = {"warm_up": 20, "ranked": 60}
"""A study that lasts until it is interrupted, however fast its players are."""


class Simulation(threading.Thread):
    """Players at work in a thread of their own; `result()` waits for them."""

    def __init__(self, config):
        super().__init__(daemon=True)
        self.config, self.log, self.error = config, OutcomeLog(), None
        self.start()

    def run(self):
        try:
            asyncio.run(simulate(self.config, self.log))
        except BaseException as error:
            self.error = error

    def result(self, seconds=180.0):
        self.join(seconds)
        assert not self.is_alive(), "the players are still at it"
        if self.error is not None:
            raise self.error
        return self.log

    def reaches(self, moves, seconds=120.0):
        """Wait until so many moves were answered."""
        eventually(lambda: self.error or self.log.moves >= moves, seconds)


def rows(path, sql, *values):
    with closing(sqlite3.connect(path)) as db:
        return db.execute(sql, values).fetchall()


def check_database(path, study, log, kills):
    """Every participant has exactly its episodes, every episode exactly its moves, and all of it is a script's."""
    protocol = study.protocol
    people = rows(path, "SELECT id, kind, script, stage FROM participants")
    assert sorted(script for _, _, script, _ in people) == sorted(
        player.kind for player in log.players
    )
    assert {kind for _, kind, _, _ in people} == {"script"}
    assert rows(path, "SELECT DISTINCT driver FROM episodes") == [("script",)]
    for person, _, _, stage in people:
        sql = """SELECT t.phase, t.trial, t.terrain, e.seed, e.outcome FROM study_episodes t
            JOIN episodes e ON e.id = t.episode_id WHERE t.participant_id = ? ORDER BY t.phase, t.trial"""
        played = {
            phase: list(group)
            for phase, group in groupby(rows(path, sql, person), lambda row: row[0])
        }
        for phase, label, of in (
            ("warm_up", "warm-up", protocol.warm_up),
            ("ranked", "ranked", protocol.ranked),
        ):
            trials = played.get(phase, [])
            assert [trial for _, trial, *_ in trials] == list(range(len(trials)))
            assert all(seed == study.seed(label, terrain) for _, _, terrain, seed, _ in trials)
            assert len({terrain for _, _, terrain, *_ in trials}) == len(trials)
            if stage == "complete":
                assert len(trials) == of
        assert len(played["tutorial"]) == 1
        if stage == "complete":
            assert all(outcome for trials in played.values() for *_, outcome in trials)
    moves = rows(
        path, "SELECT episode_id, count(*), min(step), max(step) FROM steps GROUP BY episode_id"
    )
    assert all((low, high) == (0, count - 1) for _, count, low, high in moves)
    # a kill can lose the frame of a move that is in the database: one a player, never the move
    assert (
        0
        <= sum(count for _, count, _, _ in moves) - log.moves
        <= (kills + log.reloads) * len(people)
    )
    assert rows(path, "SELECT count(*) FROM identities")[0][0] == len(people)
    # an input event is never lost, though its batch may be on its way when the server is killed, and never kept twice
    columns = "episode_id, kind, code, repeat, trusted, client_ms, step, round_trip_ms"
    kept = rows(path, f"SELECT {columns} FROM input_events")
    assert len(kept) == len(set(kept)) == log.events_recorded > log.moves


def check_no_human_figure(path, study):
    """Nothing of it enters a figure about people."""
    with closing(Reader.open(path)) as reader:
        assert human_level(reader)["figures"] == []
    report = build(load(path, study.name))
    assert [group.figure.players for group in report.groups] == [0]
    assert report.scripts


def check_labels(data):
    """A cheater's episodes are labelled, those of the others are not (a beat shows only where round trips are short).

    For studies of label rules 1: the effort check of rules 2 has rates of its own (`tests/app/study/test_effort.py`).
    """
    scripts = {person.id: person.script for person in data.people}
    found = {}
    for trial in data.trials:
        if trial.ended_ms is not None and trial.steps >= 10:
            found.setdefault(scripts[trial.participant], Counter()).update(trial.labels or ["none"])
    for script, counts in found.items():
        if script == "cheater":
            assert counts["none"] == 0 < counts["no key-up"]
        else:
            assert set(counts) == {"none"}, (script, counts)
    return found


def test_a_small_study_survives_a_kill_and_reloads_and_refuses_a_cheater(spawn, tmp_path):
    study = freeze(tmp_path / "studies", size=9, labels_version="1")
    server = spawn()
    kinds = ("noisy-frontier", "reloader", "cheater")
    simulation = Simulation(SimulationConfig(server.url, study.name, kinds, seed=3, speed=FAST))
    simulation.reaches(40)
    server.kill()
    server = spawn(port=server.port)
    log = simulation.result()
    path = tmp_path / "playground.db"
    assert [player.stage for player in log.players] == ["complete"] * 3
    assert all(player.code for player in log.players)
    assert log.faults == []
    assert log.lost_connections >= 3
    assert log.reloads > 0
    assert set(log.attempts) == set(ATTEMPTS)
    assert all(times == refused for times, refused in log.attempts.values())
    check_database(path, study, log, kills=1)
    check_no_human_figure(path, study)
    assert set(check_labels(load(path, study.name))) == set(kinds)
    verified = verify_database(path, secrets={study.name: study.secret})
    assert (verified.findings, verified.episodes, verified.still_open) == ((), 3 * 6, 0)


def test_kinds_that_leave_idle_or_wander_do_what_they_are_called(server, tmp_path):
    study = freeze(tmp_path / "studies", size=7, ranked=4)
    kinds = ("dropper", "dropper", "dropper", "idler", "random")
    log = Simulation(SimulationConfig(server.url, study.name, kinds, seed=4, speed=FAST)).result()
    assert [player.stage for player in log.players] == ["left"] * 3 + ["complete"] * 2
    stages = Counter(rows(tmp_path / "playground.db", "SELECT script, stage FROM participants"))
    assert all(stages["dropper", stage] for stage in ("withdrawn", "ranked")), stages
    check_database(tmp_path / "playground.db", study, log, kills=0)
    data = load(tmp_path / "playground.db", study.name)
    scripts = {person.id: person.script for person in data.people}
    assert any(
        trial.outcome is None for trial in data.trials if scripts[trial.participant] == "dropper"
    )
    assert log.faults == []


def test_stopped_players_come_back_as_themselves(server, tmp_path, capsys):
    study = freeze(tmp_path / "studies", size=9, ranked=6)
    state = tmp_path / "state.json"
    command = ["simulate", "--study", study.name, "--players", "2", "--kind", "noisy-frontier"]
    command += ["--url", server.url, "--state", str(state), "--seed", "5", "--speed"]

    def run(*more):
        """Run the command in this process; return its exit code and what it said."""
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([*command, *more])
        return (left.value.code, *capsys.readouterr())

    # Python heeds Ctrl-C only where it is not ignored, as it is in a shell's background
    heeding = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.default_int_handler)}
    piped = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    first = subprocess.Popen([sys.executable, "-m", "app.cli", *command, "60"], **piped, **heeding)
    eventually(
        lambda: rows(tmp_path / "playground.db", "SELECT count(*) FROM steps")[0][0] > 20, 60
    )
    first.send_signal(signal.SIGINT)
    out, said = first.communicate(timeout=60)
    assert first.returncode == 130, out + said
    assert "the same command goes on" in said
    assert len([line for line in said.splitlines() if "compiling the rules" not in line]) == 1
    assert state.stat().st_mode & 0o777 == 0o600
    half = rows(tmp_path / "playground.db", "SELECT count(*) FROM steps")[0][0]
    code, out, said = run("1e6")
    assert code == 0, said
    assert out.count("complete") == 2
    assert "moves/s; act to frame in ms: p50" in out
    assert rows(
        tmp_path / "playground.db", "SELECT count(*), min(stage), max(stage) FROM participants"
    ) == [(2, "complete", "complete")]
    assert rows(tmp_path / "playground.db", "SELECT count(*) FROM steps")[0][0] > half
    # and a third time there is nothing left to do
    code, out, said = run("1e6")
    assert code == 0, said
    assert "0 moves" in out
    # another simulation is not mistaken for this one
    code, _, said = run("1e6", "--population", "clumsy")
    assert code == 2
    assert "belongs to a simulation with population 'mixed', not 'clumsy'" in said


def test_a_state_file_of_the_first_version_is_read(tmp_path):
    player = {"cookie": "kept", "outside_ids": {"PROLIFIC_PID": "simulated-0"}, "has_left": True}
    head = {
        "format": "marsexplorer-simulate-1",
        "study": "dunes",
        "kinds": ["idler"],
        "population": "mixed",
        "seed": 5,
    }
    (tmp_path / "state.json").write_text(json.dumps({**head, "seats": [player]}))
    config = SimulationConfig(
        "http://127.0.0.1:1", "dunes", ("idler",), seed=5, state=tmp_path / "state.json"
    )
    saved = SavedPlayers.read(config)
    assert vars(saved.of(0)) == player
    (tmp_path / "state.json").unlink()
    saved.write()
    assert json.loads((tmp_path / "state.json").read_text()) == {**head, "seats": [player]}


def test_each_mistake_is_a_sentence(serve, tmp_path):
    study = freeze(tmp_path / "studies")
    server = serve()

    def refused(**rest):
        with pytest.raises(StudyNotReadyError) as error:
            asyncio.run(
                simulate(
                    SimulationConfig(
                        **{"url": server.url, "study": study.name, "kinds": ("random",), **rest}
                    ),
                    OutcomeLog(),
                )
            )
        return str(error.value)

    assert "there is no such study here" in refused(study="nobody")
    assert "start one with `marsexplorer serve`" in refused(url="http://127.0.0.1:9")
    assert "nothing answers GET /prefix/api/studies" in refused(url=f"{server.url}/prefix")
    assert all(
        "must be like http://127.0.0.1:8000" in refused(url=url)
        for url in ("http://[", "localhost:8000", "http://")
    )
    assert "cannot write" in refused(state=tmp_path / "nowhere" / "state.json")
    (tmp_path / "broken.json").write_text("{")
    assert "is no state of a simulation" in refused(state=tmp_path / "broken.json")
    Folder(tmp_path / "studies").close(study.name)
    assert "is closed" in refused()


def test_closing_the_study_ends_it_for_everybody_with_a_sentence(server, tmp_path):
    study = freeze(tmp_path / "studies", size=9, **ENDLESS)
    simulation = Simulation(
        SimulationConfig(server.url, study.name, ("noisy-frontier", "idler"), seed=6, speed=400)
    )
    simulation.reaches(30)
    Folder(tmp_path / "studies").close(study.name)
    with pytest.raises(StudyOverError, match="closed"):
        simulation.result()


def test_a_server_that_stays_away_ends_it_with_a_sentence(spawn, tmp_path):
    study = freeze(tmp_path / "studies", size=9, **ENDLESS)
    server = spawn()
    simulation = Simulation(
        SimulationConfig(
            server.url, study.name, ("noisy-frontier",), seed=6, speed=400, patience_s=0.5
        )
    )
    simulation.reaches(10)
    server.kill()
    with pytest.raises(StudyOverError, match="has been away"):
        simulation.result()


def test_a_server_that_leaks_or_grants_is_found_out(server, tmp_path, monkeypatch):
    """The checks can fail: scores that are not hidden, and a route left open."""
    from app.study.participation import StudyParticipation

    study = freeze(tmp_path / "studies", warm_up=1, ranked=2)
    monkeypatch.setattr(StudyParticipation, "hides_scores", lambda self, episode: False)
    monkeypatch.setattr("app.web.access.is_owner", lambda connection, session: True)
    log = Simulation(
        SimulationConfig(server.url, study.name, ("cheater", "random"), seed=7, speed=FAST)
    ).result()
    assert any(fault.startswith("a ranked frame tells its score") for fault in log.faults)
    assert any("somebody else" in fault for fault in log.faults), log.faults


@pytest.mark.long
@pytest.mark.parametrize("population", SIMULATED_POPULATIONS)
def test_a_whole_study_with_a_kill_in_the_middle_comes_to_the_known_truth(
    spawn, tmp_path, population
):
    """10 x (15 + 30) at 21x21, reloads and a kill -9, a leaver, a cheater; the report's interval covers the truth."""
    study = freeze(
        tmp_path / "studies",
        size=21,
        warm_up=15,
        ranked=30,
        players=10,
        break_every=10,
        labels_version="1",
    )
    server = spawn()
    kinds = (*["noisy-frontier"] * 10, "dropper", "cheater")
    simulation = Simulation(
        SimulationConfig(server.url, study.name, kinds, population, seed=11, speed=200)
    )
    simulation.reaches(15_000, 1800)
    server.kill()
    server = spawn(port=server.port)
    log = simulation.result(3000)
    path = tmp_path / "playground.db"
    assert log.faults == []
    assert Counter(player.stage for player in log.players) == {"complete": 11, "left": 1}
    check_database(path, study, log, kills=1)
    check_no_human_figure(path, study)
    verified = verify_database(path, secrets={study.name: study.secret})
    assert verified.findings == ()
    data = load(path, study.name)
    print(check_labels(data))
    group = next(
        group for group in build(data, synthetic=True).groups if group.name == "noisy-frontier"
    )
    truth = true_level(
        study.protocol.env_config,
        [study.seed("ranked", i) for i in range(30)],
        SIMULATED_POPULATIONS[population],
    )
    score, steps = group.figure.score, group.figure.steps
    for line in (
        population,
        truth,
        score,
        steps,
        log.seconds(),
        log.moves,
        log.latency_ms(),
        log.reloads,
        log.lost_connections,
    ):
        print(line)
    assert group.figure.players == 10
    assert group.figure.episodes == 300
    assert score.interval[0] <= truth.mean_score <= score.interval[1]
    assert steps.interval[0] <= truth.mean_steps <= steps.interval[1]
