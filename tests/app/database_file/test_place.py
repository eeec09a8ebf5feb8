"""A database file that goes while a server runs takes no write till it is back."""

import shutil

import pytest

from humanplay.db.file import LostDatabaseError
from humanplay.db.store import Store
from tests.support.recorded import SMALL, add_session, add_steps, free_moves, open_episode, play


def delete(path):
    path.unlink()


def move(path):
    path.rename(path.with_name("moved.db"))


def replace(path):
    shutil.copy(path, path.with_name("copy.db"))
    path.with_name("copy.db").replace(path)


def delete_log(path):
    path.with_name(path.name + "-wal").unlink()


@pytest.mark.parametrize("lose", [delete, move, replace, delete_log])
def test_no_move_is_acknowledged_into_a_file_that_is_gone(serve, tmp_path, lose):
    server = serve()
    client = server.client()
    begun = client.post("/api/sessions", json={"size": [9, 13], "seed": 5}).json()
    with server.socket(begun["session"], client) as socket:
        frame = socket.receive("frame")
        assert client.get("/api/health").json()["status"] == "ok"
        lose(tmp_path / "playground.db")
        for _ in range(20):
            socket.act(frame, "south")
            answer = socket.receive()
            while answer["kind"] == "history":
                answer = socket.receive()
            assert answer["kind"] == "error"
            assert "no move is made and nothing is recorded" in answer["detail"]
        assert str(tmp_path) not in answer["detail"]
        assert (tmp_path / "playground.db").exists() is (lose in (replace, delete_log))
        assert client.get("/api/health").json()["status"] == "failing"
        assert client.get("/readyz").status_code == 503
        assert client.get("/healthz").status_code == 200, (
            "alive, so that nobody restarts it into an empty database"
        )
        assert client.post("/api/sessions", json={}).status_code == 503
        assert client.get(f"/api/sessions/{begun['session']}").json() == frame, (
            "the board stands where it was"
        )


def test_play_goes_on_when_the_file_is_put_back(tmp_path):
    path = tmp_path / "play.db"
    store = Store(path)
    row, episode = open_episode(store, add_session(store), seed=4, config=SMALL)
    first, second = free_moves(episode)[:2]
    add_steps(store, row, episode, [first])
    move(path)
    with pytest.raises(LostDatabaseError, match="until it is put back"):
        store.set_pace(row.session_id, "timed", 2.0)
    path.with_name("moved.db").rename(path)
    assert store.fault is None
    add_steps(store, row, episode, [second])
    assert len(store.steps(row.id)) == 2
    store.close()


def test_a_file_that_goes_between_the_look_and_the_commit_takes_no_further_write(tmp_path):
    store = Store(tmp_path / "play.db")
    play(store, seed=1)
    looks, check = [], store._place.check

    def check_then_lose():
        check()
        looks.append(delete(tmp_path / "play.db"))

    store._place.check = check_then_lose
    session = "s"
    with pytest.raises(LostDatabaseError):
        store.add_player(session, 1)
    assert looks
    assert store.fault
    with pytest.raises(LostDatabaseError):
        store.add_player(session, 1)
    store.close()
