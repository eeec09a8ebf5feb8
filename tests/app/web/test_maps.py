"""Maps over the API: played as practice, stored, and played without their file."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanplay.board.charges import event_room
from humanplay.db.input_events import EVENT_BYTES
from humanplay.db.resimulation import simulate
from humanplay.tasks.mars.run import View, occupancy_codes
from marsexplorer.config import MAP, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from tests.app.web.test_api import play
from tests.support.command import command
from tests.support.map_files import INSIDES, WAREHOUSE, write_map

CELLS = WAREHOUSE.size - INSIDES


@pytest.fixture
def warehouse(tmp_path):
    return write_map(tmp_path)


def explore(client, begun):
    """Play the rule to the end, comparing each frame; return the last frame."""
    config, start = EnvConfig.of(MAP, WAREHOUSE.shape), tuple(begun["frame"]["position"])
    episode = Episode.begin(config, terrain=WAREHOUSE, start=start)
    assert json.loads(View(episode).frame(begun["frame"]["episode"])) == begun["frame"]
    return play(client, begun["session"], begun["frame"], episode, load("frontier-cost"))


def test_a_map_is_played_to_its_end_and_again_after_a_restart_without_its_file(serve, warehouse):
    server = serve(maps=(warehouse,), cell_m=1.0)
    client = server.client()
    (offered,) = client.get("/api/maps").json()
    assert (offered["name"], offered["size"]) == ("warehouse", [9, 14])
    begun = client.post("/api/sessions", json={"map": "warehouse"}).json()
    expected = {"level": MAP, "map": "warehouse", "size": [9, 14], "counts": False}
    assert expected.items() <= begun.items()
    assert begun["frame"]["cells"] == CELLS < WAREHOUSE.size
    frame = explore(client, begun)
    assert frame["outcome"] == "explored"
    assert frame["coverage"] == frame["discovered"] / CELLS >= 0.99
    stored = client.get(f"/api/episodes/{frame['episode']}").json()
    expected = {name: frame[name] for name in ("coverage", "score")} | {
        "seed": None,
        "seed_chosen": True,
    }
    assert expected.items() <= stored.items()
    run = client.get(f"/api/episodes/{frame['episode']}/replay").json()["run"]
    assert (run["cells"], run["discovered"][-1]) == (CELLS, frame["discovered"])
    ghost = client.get(f"/api/episodes/{frame['episode']}/ghost?policy=frontier-utility").json()
    assert (ghost["outcome"], ghost["cells"]) == ("explored", CELLS)
    (episode,) = client.get("/api/me/history").json()["episodes"]
    assert (episode["kind"], episode["coverage"]) == ("practice", frame["coverage"])
    server.stop()

    server = serve()
    client = server.client()
    assert client.get("/api/maps").json() == []
    url = f"/api/sessions/{begun['session']}"
    about = client.get(f"{url}/about").json()
    assert (about["frame"], about["map"]) == (frame, None)
    store = server.services.store
    (row,) = list(store.finished())
    assert simulate(row, store.steps(row["id"]))[1] == []
    again = client.post(f"{url}/episodes", json={}).json()
    assert (again["level"], again["frame"]["cells"], again["frame"]["step"]) == (MAP, CELLS, 0)
    assert explore(client, again)["discovered"] == frame["discovered"]
    other = client.post(f"{url}/episodes", json={"size": 8}).json()
    assert (other["level"], other["size"], other["frame"]["cells"]) == ("random", 8, 64)
    wanted = {"player": "frontier-cost", "replays": begun["session"]}
    refused = client.post("/api/sessions", json=wanted)
    assert refused.status_code == 422, "the replayed session has a running episode now"


def test_a_policy_replays_the_map_of_its_player_where_no_terrain_is_named(serve, warehouse):
    client = serve(maps=(warehouse,), cell_m=1.0).client()
    begun = client.post("/api/sessions", json={"map": "warehouse", "rival": "frontier-cost"}).json()
    theirs = begun["rival"]["frame"]
    assert theirs == {**begun["frame"], "episode": theirs["episode"]}
    explore(client, begun)
    wanted = {"player": "frontier-utility", "replays": begun["session"]}
    replay = client.post("/api/sessions", json=wanted).json()
    assert (replay["map"], replay["size"], replay["frame"]["cells"]) == (
        "warehouse",
        [9, 14],
        CELLS,
    )


def test_a_map_has_a_terrain_of_its_own_and_must_be_on_offer(serve, warehouse):
    client = serve(maps=(warehouse,), cell_m=1.0).client()
    for wanted in ({"level": "random"}, {"size": 9}, {"seed": 3}):
        answer = client.post("/api/sessions", json={"map": "warehouse", **wanted})
        assert answer.status_code == 422
        assert "leave out level, size and seed" in answer.json()["detail"]
    answer = client.post("/api/sessions", json={"map": "garage"})
    assert answer.status_code == 422
    assert answer.json()["detail"] == "no map 'garage'; choose one of: warehouse"
    assert "choose one of" in client.post("/api/sessions", json={"level": MAP}).json()["detail"]


@given(st.integers(129, 256), st.integers(5, 256), st.integers(0, 2**32 - 1))
def test_a_frame_of_a_large_map_holds_every_cell_in_20_kb(rows, cols, seed):
    rng = np.random.default_rng(seed)
    terrain = rng.random((rows, cols)) < 0.3
    terrain[0, 0] = False
    episode = Episode.begin(EnvConfig.of(MAP, (rows, cols)), terrain=terrain, start=(0, 0))
    for action in rng.integers(0, 4, 20):
        if not episode.ended:
            episode.step(int(action))
    view = View(episode)
    is_known = rng.random((rows, cols)) < 0.9  # as at the end of an episode
    view.codes[is_known] = np.where(terrain, 3, 1)[is_known]
    view.codes[view.position] = 2
    text = view.frame("e" * 32)
    assert len(text.encode()) <= 20_000
    frame = json.loads(text)
    assert frame["packed"] is True
    assert (occupancy_codes(frame) == view.codes).all()


def test_a_map_of_256_cells_is_played_and_its_moves_leave_room_for_their_keys(serve, tmp_path):
    cells = np.zeros((256, 256), bool)
    cells[64::64, 4:] = True
    server = serve(maps=(write_map(tmp_path, "hall", cells),))
    client = server.client()
    begun = client.post("/api/sessions", json={"map": "hall"}).json()
    assert begun["size"] == 256
    off = {"episode": begun["frame"]["episode"], "step": 0, "action": "west"}
    ended = client.post(f"/api/sessions/{begun['session']}/act", json=off).json()
    assert (ended["outcome"], ended["packed"]) == ("out_of_bounds", True)
    trial = server.services.store.trial(ended["episode"])
    assert event_room(trial) // EVENT_BYTES >= 2.5 * trial.config.limit == 50_000
    url = f"/api/sessions/{begun['session']}/episodes"
    assert client.post(url, json={"level": "random"}).json()["size"] == 21
    refused = client.post(url, json={"size": 129})
    assert "at most 128 over the API" in refused.json()["detail"]


REFUSED = [
    (["missing.yaml"], "missing.yaml"), (["a/hall.yaml", "b/hall.yaml"], "two maps are called 'hall'"), (["wide.yaml"], "257"),
]  # fmt: skip


@pytest.mark.parametrize(("files", "message"), REFUSED)
def test_a_map_that_cannot_be_offered_is_named_before_the_server_starts(
    tmp_path, capsys, files, message
):
    for folder in (tmp_path / "a", tmp_path / "b"):
        folder.mkdir()
        write_map(folder, "hall")
    write_map(tmp_path, "wide", np.zeros((9, 257), bool))
    arguments = [f"--map={tmp_path / name}" for name in files]
    options = "--port=0", "--cell=1", f"--database={tmp_path / 'x.db'}"
    code, _, err = command(capsys, "serve", *options, *arguments)
    assert (code, message in err) == (1, True)
    assert not (tmp_path / "x.db").exists()


@pytest.mark.parametrize("cell", [[], ["--cell=0.1"]])
def test_a_map_whose_corridors_need_more_cells_than_a_board_has_is_to_be_cut(
    tmp_path, capsys, cell
):
    cells = np.zeros((400, 400), bool)
    cells[1::2] = True
    cells[1::4, 0] = cells[3::4, -1] = False
    path = write_map(tmp_path, "maze", cells, metres=0.1)
    code, _, err = command(
        capsys, "serve", "--port=0", f"--database={tmp_path / 'x.db'}", f"--map={path}", *cell
    )
    assert (code, "cut " in err, "leave --cell out" in err) == (1, True, False), err
