"""People and policies on one scale, from the database and from evaluation."""

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import numpy as np
import pytest

from humanplay.db.series import add_series
from humanplay.db.store import Store
from humanplay.db.study_rows import SeriesRow
from humanplay.report.statistics import human_level
from humanplay.report.statistics.human_level import VolunteerFigures
from humanplay.results import entries
from humanplay.results.entries import ClosedStudies
from humanplay.study.folder import Folder
from humanplay.study.protocol import canonical, default_protocol, protocol_hash
from humanplay.task.registration import environment_of
from humanplay.tasks.mars.boards import FIRST_SEED, MarsBoards
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation import evaluate
from marsexplorer.training.envs import EVALUATION_SEEDS
from tests.support.declared import DECLARATIONS
from tests.support.recorded import SMALL, add_session, open_episode, play
from tests.support.servers import eventually
from tests.support.study import Person, freeze

IDLE_WORK_S = 600
"""Evaluations for a board have the lowest priority: they take long while other jobs run."""
pytestmark = pytest.mark.timeout(900)
READING_S = 0.5
TERRAINS = 3
"""Terrains of a board where `quick` is asked for."""


def test_policies_terrains_are_those_that_training_refuses():
    assert EVALUATION_SEEDS.start == FIRST_SEED
    for size, count in ((21, 100), (42, 40), (84, 10)):
        seeds = MarsBoards().seeds(EnvConfig.of("random", size))
        assert (len(seeds), set(seeds) - set(EVALUATION_SEEDS)) == (count, set())


def test_boards_that_people_have_played_stand_first_and_others_wait(tmp_path):
    store = Store(tmp_path / "play.db")
    try:
        studies = ClosedStudies(tmp_path / "playground.db-studies")
        unplayed = entries.list_entries(store, studies, VolunteerFigures())
        assert [entry.to_dict()["players"] for entry in unplayed] == [0] * len(MarsBoards.offered)
        play(store, seed=1, explore=True)
        first, *rest = entries.list_entries(store, studies, VolunteerFigures())
    finally:
        store.close()
    assert first.config == SMALL
    assert first.id == f"random-5x7-{SMALL.hash[:8]}", "another sensor than the level's own"
    assert first.to_dict()["players"] == 1
    assert [board.id for board in rest][:2] == ["random-21x21", "1-1-1-21x21"]


def test_a_board_that_was_only_left_does_not_stand_first_and_nothing_is_evaluated_unasked(
    serve, quick, tmp_path
):
    store = Store(tmp_path / "playground.db")
    for seed in range(3):
        play(store, seed, config=EnvConfig.of("random", 90))
    play(store, seed=1, explore=True)
    store.close()
    server = serve()
    client = server.client()
    first, *rest = client.get("/api/leaderboard").json()
    assert first["id"] == f"random-5x7-{SMALL.hash[:8]}"
    assert rest[0]["id"] == "random-21x21"
    assert (rest[-1]["id"], rest[-1]["episodes"]) == ("random-90x90", 3)
    states = {
        policy["state"]
        for policy in client.get(f"/api/leaderboard/{first['id']}").json()["policies"]
    }
    assert states == {"missing"}
    jobs = server.services.jobs
    assert {*jobs._waiting, *jobs._running} == set(), "no evaluation has begun"


def test_many_who_ask_at_once_share_a_reading_and_keep_nobody_else_waiting(serve, monkeypatch):
    server, readings, list_entries = serve(), [], entries.list_entries

    def read_slowly(*given):
        readings.append(time.monotonic())
        time.sleep(READING_S)
        return list_entries(*given)

    monkeypatch.setattr("humanplay.results.leaderboard.list_entries", read_slowly)

    def ask(_):
        with server.page() as client:
            return client.get("/api/leaderboard").json()

    server.page().post("/api/sessions", json={"size": 9})
    player = server.page()
    with ThreadPoolExecutor(16) as people:
        asking = people.map(ask, range(32))
        eventually(lambda: readings)
        began = time.monotonic()
        assert player.post("/api/sessions", json={"size": 9}).status_code == 201
        waited_s = time.monotonic() - began
        answers = list(asking)
    assert answers == 32 * answers[:1]
    assert waited_s < 3 * READING_S, "behind those who had asked it would be some ten times"
    assert len(readings) < 10, "32 without sharing"


def test_the_leaderboard_and_the_pages_figure_are_made_once(serve, monkeypatch, tmp_path):
    store, calls, make = Store(tmp_path / "playground.db"), [], human_level._figure
    for player in ("ada", "bob"):
        play(store, 1, player, explore=True)
    store.close()
    monkeypatch.setattr(human_level, "_figure", lambda *given: calls.append(given) or make(*given))
    client = serve().client()
    for _ in range(2):
        assert client.get("/api/human-level").json()["figures"][0]["players"] == 2
        assert client.get("/api/leaderboard").json()[0]["players"] == 2
    assert len(calls) == 1


@pytest.fixture
def quick(monkeypatch):
    """Boards of few terrains, played in one process: the server evaluates in seconds."""
    monkeypatch.setattr("humanplay.web.server.WORKERS", 1)
    few = tuple(range(FIRST_SEED, FIRST_SEED + TERRAINS))
    monkeypatch.setattr(MarsBoards, "seeds", lambda self, config: few)


def settled(client, board):
    """The board once every policy has its figure; every answer until then is honest."""

    def ask():
        leaderboard = client.get(f"/api/leaderboard/{board}?evaluate=true").json()
        for policy in leaderboard["policies"]:
            assert policy["state"] in ("ready", "computing", "waiting"), policy["error"]
            assert (policy["figure"] is None) == (policy["state"] != "ready")
            assert policy["done"] <= policy["of"] == TERRAINS
        return leaderboard if all(policy["figure"] for policy in leaderboard["policies"]) else None

    return eventually(ask, IDLE_WORK_S)


def test_a_board_shows_people_and_policies_and_what_is_made_is_kept(serve, quick, tmp_path):
    config = EnvConfig("random", 5, 7)
    store = Store(tmp_path / "playground.db")
    for seed in range(900, 926):  # no two of these terrains are alike
        play(store, seed, f"player-{min(4, seed // 5 - 180)}", explore=seed > 903, config=config)
    play(store, 4, "bob", config=config)
    play(store, 5, "rob", config=config, driver="script")
    play(store, 6, "eve", explore=True, config=config, assisted=True)
    open_episode(store, add_session(store, "bob"), 7, config)
    store.close()
    server = serve()
    client = server.client()
    first = client.get("/api/leaderboard").json()[0]
    assert (first["id"], first["players"], first["episodes"]) == ("random-5x7", 6, 27)
    assert first["missing"] is None

    shown = settled(client, "random-5x7")
    level = client.get("/api/human-level").json()["figures"][0]
    assert shown["people"]["score"] == level["score"], "the page's one human level"
    assert [trial["players"] for trial in shown["people"]["trials"]] == [5, 5, 5, 5, 5, 1]
    assert np.shape(shown["people"]["visits"]) == (5, 7)
    assert shown["people"]["curve"]["mean"][0] < shown["people"]["curve"]["mean"][-1] <= 1

    names = [policy["name"] for policy in shown["policies"]]
    table = evaluate(names, config, TERRAINS, FIRST_SEED)
    for policy, row in zip(shown["policies"], table.rows, strict=True):
        figure = policy["figure"]
        assert policy["name"] == row.policy
        assert (figure["episodes"], figure["completed"]) == (TERRAINS, row.completion)
        for metric in ("steps", "score"):
            ends = {end: getattr(row, f"{metric}_{end}") for end in ("mean", "low", "high")}
            assert figure[metric] == pytest.approx(ends)
    server.stop()

    again = serve().client().get("/api/leaderboard/random-5x7").json()["policies"]
    assert [row["figure"] for row in again] == [row["figure"] for row in shown["policies"]]


def test_too_few_people_have_no_mean_no_curve_and_no_map(serve, quick, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(8):
            play(store, seed, f"player-{seed // 5}", explore=True, config=EnvConfig("random", 5, 7))
    shown = serve().client().get("/api/leaderboard/random-5x7").json()
    assert (shown["people"], shown["board"]["players"], shown["board"]["episodes"]) == (None, 2, 8)
    assert shown["board"]["missing"] == {"players": 4, "of": 5, "episodes": 5}


def test_nobody_has_played(serve, quick):
    client = serve().client()
    shown = client.get("/api/leaderboard/random-21x21").json()
    assert (shown["people"], shown["board"]["players"], shown["board"]["missing"]) == (
        None,
        0,
        None,
    )
    assert not any(policy["figure"] for policy in shown["policies"]), "none before it is asked for"
    missing = client.get("/api/leaderboard/random-9x9")
    assert (missing.status_code, missing.json()["detail"][:24]) == (404, "no board 'random-9x9' on")


def test_a_study_appears_when_it_is_closed_with_policies_on_its_own_terrains(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies")
    server = serve()
    person = Person(server)
    person.to_warm_up()
    frames = person.play_on()["ranked"]
    script = Person(server, script="noisy-frontier")
    script.to_warm_up()
    client = server.client()
    assert not [board for board in client.get("/api/leaderboard").json() if board["study"]], (
        "open: scores are hidden"
    )
    assert client.get("/api/leaderboard/study-small").status_code == 404
    # a study's episodes make no figure of the playground
    assert client.get("/api/leaderboard/random-7x9").status_code == 404
    Folder(tmp_path / "playground.db-studies").close("small")
    first = client.get("/api/leaderboard").json()[0]
    expected = {"id": "study-small", "study": "small", "players": 1, "terrains": 3}
    assert expected.items() <= first.items()

    def made():
        shown = client.get("/api/leaderboard/study-small?evaluate=true").json()
        return shown if shown["policies"][0]["figure"] else None

    shown = eventually(made, IDLE_WORK_S)
    steps = [played[-1]["step"] if played[-1]["outcome"] == "explored" else 63 for played in frames]
    assert shown["people"]["players"] == 1
    assert shown["people"]["steps"]["mean"] == pytest.approx(np.mean(steps))
    assert [trial["steps"]["mean"] for trial in shown["people"]["trials"]] == steps
    assert np.shape(shown["people"]["visits"]) == (7, 9)
    assert [policy["name"] for policy in shown["policies"]] == ["frontier-cost"]
    config, seeds = study.protocol.env_config, [study.seed("ranked", i) for i in range(3)]
    tables = [evaluate(["frontier-cost"], config, 2, seed) for seed in seeds]
    mean = np.mean([table.results[0].steps_to_99 for table in tables])
    assert shown["policies"][0]["figure"]["steps"]["mean"] == pytest.approx(mean)


def test_a_closed_study_of_another_environment_has_no_board_and_hides_no_others(serve, tmp_path):
    lake = environment_of("gymnasium:FrozenLake-v1")
    played = default_protocol("lake", lake.default, lake.name, declarations=DECLARATIONS)
    hashes = protocol_hash(played), "c" * 64
    row = SeriesRow("lake", canonical(played).decode(), *hashes, 1, closed_ms=2, secret="5" * 64)
    with closing(Store(tmp_path / "playground.db")) as store:
        add_series(store, row)
    client = serve().client()
    boards = client.get("/api/leaderboard").json()
    assert len(boards) == len(MarsBoards.offered)
    assert client.get("/api/leaderboard/study-lake").status_code == 404
    assert client.get(f"/api/leaderboard/{boards[0]['id']}").status_code == 200
