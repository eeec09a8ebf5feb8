"""The end of a study: what is abandoned, and who is counted how."""

import csv
import io
import json
import sqlite3
import threading
from contextlib import closing

import numpy as np
import pytest

from humanplay.db.erasure import forget
from humanplay.db.reader import Reader, now_ms
from humanplay.db.series import StudyStore
from humanplay.db.store import Store
from humanplay.release.build import build_release, request_of
from humanplay.release.errors import ReleaseError
from humanplay.report.build import build
from humanplay.report.making import load_with_folder
from humanplay.study.closing import note_closed
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError
from humanplay.study.verification import verify_database
from humanplay.tasks.mars.environment import MarsEnvironment
from tests.support.command import command
from tests.support.servers import eventually
from tests.support.stored_studies import StudyRecorder, freeze


@pytest.fixture
def study(tmp_path):
    """An open study with people at different points.

    One has finished, one left an episode open long ago, one has just moved, one was idle before any
    move.
    """
    study = freeze(tmp_path / "play.db-studies", close=False)
    with closing(StudyRecorder(tmp_path / "play.db", study)) as recorder:
        done, left = recorder.join(0), recorder.join(1, stage="ranked")
        for trial in range(3):
            recorder.play(done, "ranked", trial)
        recorder.play(left, "ranked", 0)
        recorder.play(left, "ranked", 1, "open")
        recorder.clock = now_ms() - 60_000
        here = recorder.join(2, stage="ranked")
        recorder.play(here, "ranked", 0, "open")
    return {"done": done, "left": left, "here": here}


def run(capsys, tmp_path, *args):
    """Return the exit code of a command on these studies, and what it said."""
    return command(capsys, "study", *args, "--database", tmp_path / "play.db")


def outcomes(path):
    with closing(Store(path)) as store:
        counts = store.query("SELECT outcome, count(*) AS n FROM episodes GROUP BY 1 ORDER BY 1")
    return {row["outcome"]: row["n"] for row in counts}


def test_closing_waits_for_who_is_at_it_and_abandons_what_is_open(
    study, tmp_path, capsys, monkeypatch
):
    path = tmp_path / "play.db"
    monkeypatch.setattr("sys.stdin", io.StringIO())  # no terminal
    code, out, printed = run(capsys, tmp_path, "close", "dunes")
    assert (code, "1 person has moved" in printed) == (2, True), "refused before anything is asked"
    assert "for ever?" not in out + printed
    code, _, printed = run(capsys, tmp_path, "close", "dunes", "--now")
    assert (code, "--yes does without asking" in printed) == (1, True)
    code, _, printed = run(capsys, tmp_path, "close", "dunes", "--yes")
    assert (code, "1 person has moved" in printed, "--now" in printed) == (2, True, True)
    assert Folder(tmp_path / "play.db-studies").status("dunes") == "open"
    assert outcomes(path)[None] == 2
    assert run(capsys, tmp_path, "close", "dunes", "--yes", "--now")[0] == 0
    assert outcomes(path) == {"abandoned": 2, "explored": 4}
    assert verify_database(path).findings == ()

    data = load(path, "dunes")
    (group,) = build(data).groups
    assert group.flow.people == {"finished": 1, "interrupted": 1, "left": 1}
    treated = group.everybody
    assert (treated.players, treated.episodes) == (3, 9)
    limit = data.protocol.env_config.limit
    steps = [trial.steps for trial in data.trials if trial.participant == study["done"]]
    first = next(trial.steps for trial in data.trials if trial.participant == study["left"])
    means = [sum(steps) / 3, (first + 2 * limit) / 3, limit]
    assert treated.steps.mean == pytest.approx(sum(means) / 3)
    assert treated.steps.mean > group.figure.steps.mean


def test_whoever_withdraws_after_being_interrupted_is_counted_once(study, tmp_path, capsys):
    path = tmp_path / "play.db"
    with closing(
        StudyRecorder(path, Folder(tmp_path / "play.db-studies").study("dunes"))
    ) as recorder:
        recorder.clock = now_ms() - 60_000
        early = recorder.join(3, stage="warm_up")
        recorder.play(early, "warm_up", 0, "open")
    assert run(capsys, tmp_path, "close", "dunes", "--yes", "--now")[0] == 0
    with closing(Store(path)) as store:
        study_store = StudyStore(store)
        for person in (study["here"], early):
            study_store.withdraw(study_store.participant(person), now_ms())
    people = build(load(path, "dunes")).groups[0].flow.people
    assert people == {"finished": 1, "interrupted": 1, "left": 1, "interrupted_early": 1}


@pytest.mark.parametrize("ranked", [2, 3], ids=["another protocol", "the same, frozen again"])
def test_another_study_of_the_same_name_that_is_closed_ends_nothing(
    study, tmp_path, capsys, ranked
):
    path, other = tmp_path / "play.db", freeze(tmp_path / "elsewhere", ranked=ranked, close=False)
    (tmp_path / "play.db-studies").rename(tmp_path / "former")
    (tmp_path / "elsewhere").rename(tmp_path / "play.db-studies")
    assert command(capsys, "study", "close", "dunes", "--yes", "--now", "--database", path)[0] == 0
    closed = Folder(tmp_path / "play.db-studies").study("dunes")
    with closing(Store(path)) as store:
        assert note_closed(store, closed) == []
        StudyStore(store).note_closed(closed.row())
    assert outcomes(path)[None] == 2
    assert load(path, "dunes").closed_ms is None
    assert verify_database(path).findings == ()
    assert closed.commitment == other.commitment


def outcomes_of(server):
    return [row["outcome"] for row in server.services.store.query("SELECT outcome FROM episodes")]


def test_whoever_is_erased_after_closing_is_counted_where_their_figure_is_missing(
    study, tmp_path, capsys
):
    path = tmp_path / "play.db"
    forget(path, study["left"])
    assert load(path, "dunes").arrivals.erased_after_closing == 0
    assert run(capsys, tmp_path, "close", "dunes", "--yes", "--now")[0] == 0
    forget(path, study["done"])
    data = load(path, "dunes")
    arrivals = data.arrivals
    assert (arrivals.erased, arrivals.erased_after_closing, arrivals.erased_finishers) == (2, 1, 1)
    report = build(data)
    (group,) = report.groups
    assert group.flow.arrivals == arrivals
    missing = [item.detail for item in report.checklist if item.number in ("1.1", "3.2.2", "5.1.5")]
    assert all("2 more were erased, 1 of whom had ended all" in text for text in missing)


def test_a_study_with_a_spoiler_a_leaver_an_interrupted_and_an_erased_person_is_derived_again(
    tmp_path, capsys
):
    """Everybody is counted once; `verify` and `reproduce` find no difference."""
    study, path = freeze(tmp_path / "play.db-studies", close=False), tmp_path / "play.db"
    with closing(StudyRecorder(path, study)) as recorder:
        people = [recorder.join(number, stage=stage) for number, stage in enumerate(
            ("complete", "complete", "complete", "ranked", "ranked"))]  # fmt: skip
        done, erased, spoiler, left, here = people
        for person in (done, erased, spoiler):
            for trial in range(3):
                recorder.play(
                    person, "ranked", trial, spoil=2 if (person, trial) == (spoiler, 1) else None
                )
        recorder.play(left, "ranked", 0, "open")
        recorder.clock = now_ms() - 60_000
        recorder.play(here, "ranked", 0, "open")
    assert run(capsys, tmp_path, "close", "dunes", "--yes", "--now")[0] == 0
    forget(path, erased)
    assert verify_database(path).findings == ()
    out = tmp_path / "out"
    database = ["--database", path]
    assert (
        command(capsys, "release", "--study", "dunes", "--author", "Ada", "--out", out, *database)[
            0
        ]
        == 0
    )
    code, printed, _ = command(capsys, "reproduce", out)
    assert (code, "0 differ" in printed) == (0, True)
    report = json.loads((out / "report.json").read_text())
    (group,) = report["groups"]
    flow = group["flow"]
    assert flow["people"] == {"finished": 2, "interrupted": 1, "left": 1, "erased": 1}
    arrivals = flow["arrivals"]
    assert (arrivals["erased_after_closing"], arrivals["erased_finishers"]) == (1, 1)
    finished, everybody = group["figures"][:2]
    assert (finished["players"], everybody["players"]) == (2, 4)
    assert (finished["erased"], everybody["erased"]) == (1, 1)
    low, high = everybody["steps_range"]
    assert low < everybody["steps"]["mean"] < high
    steps, (score, everybodys_steps) = released_estimates(out)
    assert steps == pytest.approx(finished["steps"]["mean"])
    assert score == pytest.approx(everybody["score"]["mean"])
    assert everybodys_steps == pytest.approx(everybody["steps"]["mean"])
    assert group["attestation"]["episodes"]["spoilt"] == 1
    assert any("were erased" in caution or "was erased" in caution for caution in group["cautions"])


def table(out, name):
    with (out / f"csv/{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def released_estimates(out):
    """Three estimates, computed from the released tables by their dictionary.

    Mean steps per protocol, and mean score and steps of everybody.
    """
    report = json.loads((out / "report.json").read_text())
    worst, terrains = report["groups"][0]["worst"], report["protocol"]["ranked"]
    began = "finished gave_up excluded not_attested partly_bot stopped_by_rule failed withdrew interrupted left"
    people = [row for row in table(out, "participants") if row["status"] in began.split()]
    ranked = [row for row in table(out, "episodes") if row["phase"] == "ranked"]
    finished, everybody = [], []
    for person in people:
        episodes = [row for row in ranked if row["participant"] == person["participant"]]
        played = [
            (float(row["score"]), float(row["steps_to_99"]))
            for row in episodes
            if not row["lowest"]
        ]
        lowest = [(worst["score"], worst["steps"])] * (terrains - len(played))
        everybody.append(np.mean(played + lowest, axis=0))
        if person["status"] == "finished":
            spoilt = [row["attestation"] == "spoilt" for row in episodes]
            steps = np.where(
                spoilt, worst["steps"], [float(row["steps_to_99"]) for row in episodes]
            )
            finished.append(steps.mean())
    return np.mean(finished), np.mean(everybody, axis=0)


def raised(errors):
    """Raise the next error, if one is left."""
    if errors:
        raise errors.pop()


def test_a_study_that_a_command_closes_is_noted_by_the_server_that_has_its_database(
    server, tmp_path, capsys, monkeypatch
):
    """Whoever has closed the tab counts as soon as the command has ended.

    Nobody asks the server for the study.
    """
    from tests.support.study import Person
    from tests.support.study import freeze as freeze_small

    freeze_small(tmp_path / "playground.db-studies")
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    path, fails = server.services.store.path, [sqlite3.OperationalError("disk I/O error")]
    read = StudyStore.unclosed_studies
    monkeypatch.setattr(StudyStore, "unclosed_studies", lambda store: raised(fails) or read(store))
    eventually(lambda: not fails)
    words = ("study", "close", "small", "--yes", "--now", "--database", path)
    code, out, _ = command(capsys, *words)
    assert (code, "has not taken note" in out) == (0, False)
    assert None not in outcomes_of(server)
    assert load(path, "small").closed_ms is not None


@pytest.mark.parametrize("is_restarted", [False, True])
def test_an_open_episode_that_cannot_be_replayed_is_closed_by_its_stored_moves(
    serve, tmp_path, monkeypatch, is_restarted
):
    from tests.support.study import Person
    from tests.support.study import freeze as freeze_small

    replaying = []

    def fail(rules, *_):
        replaying.append((type(rules).__name__, threading.current_thread().name == "writes"))
        raise RuntimeError("the episode has ended")

    freeze_small(tmp_path / "playground.db-studies")
    server = serve()
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    person.play(moves=1)
    if is_restarted:
        server.stop()
    monkeypatch.setattr(MarsEnvironment, "replay", fail)
    Folder(tmp_path / "playground.db-studies").close("small")
    server = serve() if is_restarted else server
    eventually(lambda: None not in outcomes_of(server))
    (row,) = server.services.store.query("SELECT * FROM episodes WHERE steps = 1")
    (step,) = server.services.store.steps(row["id"])
    assert (row["outcome"], row["total"]) == ("abandoned", step["reward"])
    assert {*replaying} == {("Mars", False)}, "by the server's task, away from the writes"
    assert load(server.services.store.path, "small").closed_ms is not None


def test_no_report_and_no_release_is_made_while_the_end_is_not_noted(study, tmp_path):
    """The episodes that are open then would be in no figure."""
    path, folder = tmp_path / "play.db", Folder(tmp_path / "play.db-studies")
    folder.close("dunes")
    request = request_of("dunes", tmp_path / "out", path, folder)
    with pytest.raises(ReleaseError, match="has not taken note"):
        build_release(request)
    with closing(Reader.open(path)) as reader, pytest.raises(StudyError, match="not taken note"):
        load_with_folder(reader, folder, "dunes")
