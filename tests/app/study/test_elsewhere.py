"""Going on on another device: by a link or a recovery code, and nothing else."""

import asyncio
from contextlib import suppress

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.study.data import load
from humanplay.study.elsewhere import LINK_MS
from humanplay.study.flow import devices_used
from humanplay.study.verification import verify_database
from humanplay.tasks.mars.run import occupancy_codes
from humanplay.web import sockets
from tests.support.command import command
from tests.support.recorded import ask
from tests.support.study import Person, freeze

FREE, ROVER = 1, 2
"""Codes of cells, as of `occupancy_codes`."""
PLACE = "SELECT player_id, session_id, stage FROM participants WHERE consent_ms IS NOT NULL"
BOARD = "SELECT player_id, owner_id FROM sessions"
USED = "this link leads nowhere any more"
WRONG = "this is not a recovery code of this study"


@pytest.fixture
def playing(serve, tmp_path):
    """Somebody at the second move of a ranked episode, and their study."""
    arms = [{"name": "told", "instructions": "Walls first."}, {"name": "control"}]
    study = freeze(
        tmp_path / "playground.db-studies", arms=arms, warm_up=0, flags={"max_devices": 1}
    )
    person = Person(serve())
    person.to_warm_up()
    person.call("next")
    move(person)
    return person, study


def move(person):
    """Go to a free cell beside the rover, and return the frame."""
    with person.socket() as socket:
        frame = socket.receive("frame")
        socket.act(frame, free_way(frame), input="key")
        return socket.frame_after(frame["step"])


def free_way(frame):
    """The first action that leads to a free cell."""
    codes = np.pad(occupancy_codes(frame), 1)
    row, col = np.argwhere(codes == ROVER)[0]
    beside = {"south": (1, 0), "east": (0, 1), "north": (-1, 0), "west": (0, -1)}
    return next(
        way for way, (down, right) in beside.items() if codes[row + down, col + right] == FREE
    )


def newcomer(person, client=None):
    return Person(person.server, client=client, joins=False)


def ticket(person):
    answer = person.client.post(f"{person.url}/elsewhere", json={"page": "https://example.org/lab"})
    return answer.json()["link"].removeprefix("https://example.org/lab#go=")


@pytest.mark.parametrize("way", ["link", "code"])
def test_another_device_goes_on_with_the_same_episode_and_the_one_before_stops_at_once(
    playing, way
):
    old, study = playing
    path = old.server.services.store.path
    state = old.me()
    brings = {"token": ticket(old)} if way == "link" else {"code": state["recovery_code"].lower()}
    new = newcomer(old)
    with old.socket() as socket:
        frame = socket.receive("frame")
        new.call("go-on", brings)
        with suppress(ConnectionClosed):
            socket.act(frame, free_way(frame), input="key")
        with pytest.raises(ConnectionClosed) as closed:
            socket.frame_after(frame["step"])
        assert closed.value.rcvd.code == 4404
    assert "gone on with this study on another device" in old.refused("next", status=404)
    assert "gone on with this study on another device" in old.refused("join")
    for same in ("participant", "session", "stage", "instructions", "ranked"):
        assert new.where[same] == state[same]
    assert new.frame == old.frame
    assert move(new)["step"] == old.frame["step"] + 1
    assert len(ask(path, PLACE)) == len(ask(path, BOARD)) == 1
    ((player, *_),) = ask(path, PLACE)
    assert ask(path, BOARD) == [(player, player)]
    assert len(ask(path, "SELECT id FROM players")) == 1, "the cookie of before stands for nobody"
    new.play()
    new.play_on()
    assert verify_database(path, secrets={study.name: study.secret}).findings == ()
    (person,) = load(path, study.name).people
    assert devices_used(person.events) == 2
    levels = ask(path, "SELECT attestation FROM episodes WHERE ended_ms IS NOT NULL")
    assert set(levels[1:]) == {("attested",)}


async def never_close(*_):
    await asyncio.Event().wait()


def test_a_device_that_was_left_makes_no_move_while_its_socket_is_still_open(playing, monkeypatch):
    old, _ = playing
    path = old.server.services.store.path
    monkeypatch.setattr(sockets, "close", never_close)
    with old.socket() as socket:
        frame = socket.receive("frame")
        newcomer(old).call("go-on", {"token": ticket(old)})
        with suppress(ConnectionClosed):
            socket.act(frame, free_way(frame), input="key")
            socket.frame_after(frame["step"])
    assert ask(path, "SELECT count(*) FROM steps") == [(1,)], "that of before"


def test_a_link_holds_for_a_quarter_of_an_hour_and_for_one_device(playing):
    old, _ = playing
    first, second = ticket(old), ticket(old)
    new = newcomer(old)
    new.call("go-on", {"token": first})
    for token in (first, second):
        assert USED in newcomer(old).refused("go-on", {"token": token})
    late = ticket(new)
    label, until, signed = late.split(".")
    for forged in (f"{label}.{int(until) + 60_000}.{signed}", f"{label}.{until}.{'0' * 24}", "x"):
        assert USED in newcomer(old).refused("go-on", {"token": forged})
    old.server.clock.skipped_ms += LINK_MS
    assert USED in newcomer(old).refused("go-on", {"token": late})


def test_after_ten_wrong_codes_none_is_looked_at_and_a_link_still_leads_on(playing):
    old, _ = playing
    code = old.me()["recovery_code"]
    label = old.where["participant"]
    assert code.replace("-", "")[:8] == label
    assert WRONG in newcomer(old).refused("go-on", {"code": label}), "the label alone is no code"
    for number in range(9):
        wrong = f"{label}-0000-0000-000{number}"
        assert WRONG in newcomer(old).refused("go-on", {"code": wrong})
    assert "none is looked at any more" in newcomer(old).refused("go-on", {"code": code})
    new = newcomer(old)
    new.call("go-on", {"token": ticket(old)})
    assert new.where["participant"] == label


def test_whoever_has_not_agreed_has_left_or_takes_part_already_moves_nobody(playing):
    old, study = playing
    guest = Person(old.server)
    assert guest.where["recovery_code"] is None
    assert "who has agreed" in guest.refused("elsewhere", {"page": "https://example.org/lab"})
    other = Person(old.server)
    other.to_tutorial()
    assert "as somebody else" in other.refused("go-on", {"token": ticket(old)})
    assert other.me()["stage"] == "tutorial"
    token = ticket(old)
    guest.call("go-on", {"token": token})
    assert guest.where["participant"] == old.where["participant"]
    assert load(old.server.services.store.path, study.name).arrivals.undecided == 1
    other_code = other.me()["recovery_code"]
    other.call("withdraw")
    assert other.where["recovery_code"] is None
    assert "has not left" in newcomer(old).refused("go-on", {"code": other_code})
    old.call("go-on", {"code": guest.me()["recovery_code"]})
    assert old.me()["participant"] == guest.where["participant"]
    guest.refused("next", status=404)


def test_a_release_says_on_how_many_devices_somebody_took_part(playing, tmp_path, capsys):
    old, study = playing
    path = old.server.services.store.path
    new = newcomer(old)
    new.call("go-on", {"code": old.me()["recovery_code"]})
    code = new.where["recovery_code"]
    new.play()
    new.play_on()
    old.server.stop()
    closing = "--yes", "--now", "--database", path
    assert command(capsys, "study", "close", study.name, *closing)[0] == 0
    out = tmp_path / "bundle"
    code_of_release, printed, error = command(
        capsys, "release", "--study", study.name, "--out", out, "--author", "A", "--database", path
    )
    assert code_of_release == 0, printed + error
    head, *rows = next(out.rglob("participants.csv")).read_text().splitlines()
    column = head.split(",").index("devices")
    assert [row.split(",")[column] for row in rows] == ["2"]
    for file in out.rglob("*"):
        if file.is_file():
            assert code.encode() not in file.read_bytes(), file
    status, printed, error = command(capsys, "reproduce", out)
    assert status == 0, printed + error
