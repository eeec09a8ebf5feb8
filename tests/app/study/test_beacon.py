"""A study that names a round of a public beacon: its terrains follow from what nobody had when the secret was drawn."""

import hashlib
import hmac
import http.server
import json
import threading
import time
from contextlib import closing
from dataclasses import replace

import pytest

from humanplay.db.database import reading
from humanplay.db.store import Store
from humanplay.report.build import build
from humanplay.series.beacon import QUICKNET
from humanplay.series.data import load
from humanplay.series.files import now_ms
from humanplay.series.folder import Folder
from humanplay.series.protocol import StudyError, default_protocol
from humanplay.series.verification import verify_database
from humanplay.web.simulate import RefusedError
from tests.support.beacons import OwnBeacon
from tests.support.command import command, run
from tests.support.declared import DECLARATIONS
from tests.support.stored_studies import (
    BEGAN,
    CONFIG,
    StudyRecorder,
    freezing_at,
    play_study,
    write_chain_anew,
)
from tests.support.study import Person

ROUND_1000 = "b44679b9a59af2ec876b1a6b1ad52ea9b1615fc3982b19576350f93447cb1125e342b73a8dd2bacbe47e4b6b63ed5e39"
"""What drand quicknet signed in its round 1000, as its relays have told since 23 August 2023."""
REST = {
    "declarations": DECLARATIONS,
    "warm_up": 2,
    "ranked": 3,
    "players": 3,
    "policies": ("random",),
    "debrief_policy": "random",
}


@pytest.fixture
def beacon():
    return OwnBeacon()


def frozen(root, beacon, name="dunes", **rest):
    """Return the folder of a study that waits for a round of the tests' own beacon."""
    folder = Folder(root)
    folder.create(default_protocol(name, CONFIG, **REST, **rest))
    with freezing_at(BEGAN):
        folder.freeze(name, beacon=beacon.after(now_ms() + 1000))
    return folder


def test_the_signature_of_a_round_is_checked_with_the_public_beacons_key():
    named = replace(QUICKNET, round=1000)
    assert named.has_signed(ROUND_1000)
    assert not replace(named, round=1001).has_signed(ROUND_1000)
    assert not named.has_signed("00" + ROUND_1000[2:])
    assert not named.has_signed("no signature")
    assert named.round_ms == 1_692_806_364_000
    assert [QUICKNET.after(named.round_ms + ms).round for ms in (-1000, 0, 2999, 3000)] == [
        1000,
        1001,
        1001,
        1002,
    ]


def test_nobody_takes_part_before_the_round_is_entered_and_then_the_seeds_follow_from_it(
    serve, tmp_path, beacon
):
    folder = frozen(tmp_path / "playground.db-studies", beacon, recruitment="open")
    named = folder.study("dunes").beacon
    assert folder.status("dunes") == "frozen"
    server = serve()
    assert server.client().get("/api/studies").json()[0]["status"] == "frozen"
    with pytest.raises(RefusedError, match="is not open yet"):
        Person(server, study="dunes")
    with pytest.raises(StudyError, match="is not open yet"):
        folder.close("dunes")
    with pytest.raises(StudyError, match="which the beacon's key did not sign"):
        folder.open("dunes", beacon.sign(replace(named, round=named.round + 1)))
    study = folder.open("dunes", beacon.sign(named))
    assert folder.status("dunes") == "open"
    Person(server, study="dunes")
    told = server.client().get("/api/studies/dunes").json()
    assert (told["beacon"]["round"], told["beacon_signature"]) == (named.round, beacon.sign(named))
    key = hmac.digest(study.secret, bytes.fromhex(beacon.sign(named)), "sha256")
    line = f"{study.protocol_hash}|ranked|1".encode()
    assert (
        study.seed("ranked", 1) == int.from_bytes(hmac.digest(key, line, "sha256")[:8], "big") >> 11
    )
    without = hmac.digest(study.secret, line, "sha256")
    assert study.seed("ranked", 1) != int.from_bytes(without[:8], "big") >> 11


def test_a_round_that_is_out_already_is_not_named(tmp_path):
    folder = Folder(tmp_path)
    folder.create(default_protocol("dunes", CONFIG, **REST))
    with pytest.raises(StudyError, match="came out at 2023-08-23T15:59:24"):
        folder.freeze("dunes", beacon=replace(QUICKNET, round=1000))
    assert folder.status("dunes") == "draft"


@pytest.mark.parametrize(
    ("harm", "what"),
    [
        ("beacon_signature = NULL", "beacon_signature"),
        ("beacon = NULL", "beacon_signature"),
        ("beacon = json_set(beacon, '$.round', 5)", "beacon's round"),
    ],
)
def test_verify_holds_the_seeds_and_the_signature_to_the_round(tmp_path, beacon, harm, what):
    """Also after the chain was made anew, as whoever can write the file could do."""
    folder = frozen(tmp_path / "play.db-studies", beacon)
    study = folder.open("dunes", beacon.sign(folder.study("dunes").beacon))
    path = tmp_path / "play.db"
    play_study(path, folder.close("dunes"))
    assert verify_database(path).findings == ()
    with closing(Store(path)) as store:
        store.connection.execute(f"UPDATE series SET {harm}")
        write_chain_anew(store.connection)
    assert what in {each.what for each in verify_database(path).findings}
    assert study.beacon_signature


def cautions(data):
    (group,) = build(data).groups
    return " ".join(group.cautions)


def test_the_report_says_whether_secrets_may_have_been_tried_out(tmp_path, beacon):
    folder = frozen(tmp_path / "play.db-studies", beacon)
    folder.open("dunes", beacon.sign(folder.study("dunes").beacon))
    path = tmp_path / "play.db"
    play_study(path, folder.close("dunes"))
    data = load(path, "dunes")
    public = replace(data, beacon=replace(QUICKNET, round=1000), beacon_signature=ROUND_1000)
    assert "No public beacon was named" in cautions(replace(data, beacon=None))
    assert "not one that this software knows" in cautions(data)
    assert "beacon" not in cautions(public)
    report = build(replace(public, beacon_signature=data.beacon_signature))
    assert any("not of the round that was named" in each for each in report.deviations)


def test_a_study_that_was_frozen_again_is_told_by_the_chain(tmp_path, capsys):
    """The first freezing is in the chain although nobody joined that study."""
    studies, path = tmp_path / "play.db-studies", tmp_path / "play.db"
    Store(path).close()
    for _ in range(2):
        Folder(studies).create(default_protocol("dunes", CONFIG, **REST))
        given = ("--underpowered", "--database", path)
        with freezing_at(BEGAN):
            assert run("study", "freeze", "dunes", *given) == 0
        study = Folder(studies).study("dunes")
        (studies / "dunes").rename(tmp_path / f"kept-{study.commitment[:6]}")
    (tmp_path / f"kept-{study.commitment[:6]}").rename(studies / "dunes")
    play_study(path, Folder(studies).close("dunes"))
    assert verify_database(path).findings == ()
    assert "was frozen 2 times" in cautions(load(path, "dunes"))


def test_a_time_of_freezing_that_was_changed_before_anybody_joined_is_found(tmp_path, capsys):
    studies, path = tmp_path / "play.db-studies", tmp_path / "play.db"
    Store(path).close()
    Folder(studies).create(default_protocol("dunes", CONFIG, **REST))
    given = ("--underpowered", "--database", path)
    assert run("study", "freeze", "dunes", *given) == 0
    file = studies / "dunes" / "frozen.json"
    file.write_text(
        json.dumps({**json.loads(file.read_text()), "frozen_at": "2026-01-01T00:00:00.000Z"})
    )
    with closing(StudyRecorder(path, Folder(studies).study("dunes"))) as recorder:
        recorder.join(0)
    (found,) = verify_database(path).findings
    assert (found.where, found.what) == ("series dunes", "what the chain says was frozen")


@pytest.fixture
def relay():
    """A relay that knows one round, and the paths it was asked for."""
    asked, rounds = [], {}

    class Relay(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            known = rounds.get(self.path.rsplit("/", 1)[1])
            self.send_response(200 if known else 404)
            self.end_headers()
            self.wfile.write(json.dumps({"signature": known}).encode())

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Relay)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", asked, rounds
    server.shutdown()
    server.server_close()


def test_study_open_fetches_the_round_from_a_relay_and_notes_it_in_the_chain(
    tmp_path, capsys, beacon, relay
):
    url, asked, rounds = relay
    folder, path = frozen(tmp_path / "play.db-studies", beacon), tmp_path / "play.db"
    Store(path).close()
    named = folder.study("dunes").beacon
    given = "--relay", url, "--database", path

    with pytest.raises(StudyError, match="comes out at"):
        beacon.after(now_ms() + 600_000).fetch(url)
    assert asked == []
    time.sleep(max(0.0, (named.round_ms - now_ms()) / 1000))
    code, _, said = command(capsys, "study", "open", "dunes", *given)
    assert (code, folder.status("dunes")) == (1, "frozen")
    assert "cannot be fetched" in said
    assert "--signature" in said
    rounds[str(named.round)] = beacon.sign(named)
    assert run("study", "open", "dunes", *given) == 0
    assert folder.status("dunes") == "open"
    assert asked[0].endswith(f"/public/{named.round}")
    with reading(path) as conn:
        notes = dict(conn.execute("SELECT kind, note FROM chain").fetchall())
    assert json.loads(notes["opened"])["beacon_signature"] == beacon.sign(named)
    assert (
        hashlib.sha256(folder.study("dunes").secret).hexdigest()
        == json.loads(notes["frozen"])["commitment"]
    )
