"""The log is cut and rated; as JSON it names requests and failures, and nobody."""

import json
import logging
import re
import secrets
import subprocess
import sys

import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.web.logs import _SafeFormatter, mask
from tests.support.study import Person, freeze

PASSWORD = "red-planet-4"


def test_who_plays_joins_and_logs_in_is_nowhere_in_the_log(spawn, tmp_path):
    freeze(tmp_path / "playground.db-studies", recruitment="open")
    server = spawn(log_format="json", admin_password=PASSWORD)
    secrets_of_theirs = {PASSWORD, "ada-5f1-outside", "not-a-token-of-ours"}
    client = server.page()
    begun = client.post("/api/sessions", json={"size": [7, 9], "rival": "frontier-cost"}).json()
    with server.socket(begun["session"], client) as board:
        frame = board.receive("frame")
        board.act(frame, "east", input="key")
        board.frame_after(0)
        board.send("nonsense")
        board.receive("error")
    assert client.get(f"/api/sessions/{begun['session']}").status_code == 200
    assert client.get(f"/watch/{begun['watch']}").status_code == 200
    stranger = f"/api/sessions/{secrets.token_urlsafe(16)}?who=not-a-token-of-ours"
    assert client.get(stranger).status_code == 404
    with server.socket("not-a-token-of-ours", client) as stranger:
        stranger.receive("error")
        with pytest.raises(ConnectionClosed):
            stranger.receive()
    person = Person(server, client=server.page(), outside_ids={"PROLIFIC_PID": "ada-5f1-outside"})
    person.to_tutorial()
    session = person.call("next")["session"]
    operator = server.page()
    assert operator.post("/api/admin/login", json={"password": "wrong-wrong"}).status_code == 401
    assert operator.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    answer = operator.get("/api/admin/studies/small?token=not-a-token-of-ours")
    assert answer.status_code == 200
    for visitor in (client, person.client, operator):
        for cookie in visitor.cookies.jar:
            secrets_of_theirs |= {cookie.value, *cookie.value.split(".")}
    secrets_of_theirs |= {session, begun["session"], begun["rival"]["session"], begun["watch"]}
    secrets_of_theirs |= {begun["frame"]["episode"], person.where["participant"]}
    server.process.terminate()
    server.process.wait()
    log = server.process.stdout.read()
    server.close()
    assert [secret for secret in secrets_of_theirs if len(secret) > 5 and secret in log] == []

    lines = [json.loads(line) for line in log.splitlines() if line.startswith("{")]
    asked = [line for line in lines if line["message"] == "request"]
    requests = {(line["method"], line["route"], line["status"]) for line in asked}
    assert {
        ("POST", "/api/sessions", 201),
        ("GET", "/api/sessions/{session_id}", 404),
        ("WEBSOCKET", "/ws/sessions/{session_id}", 1000),
        ("WEBSOCKET", "/ws/sessions/{session_id}", 4404),
        ("POST", "/api/admin/login", 401),
    } <= requests
    assert answer.headers["x-request-id"] in {line["request_id"] for line in lines}
    assert all(line["ms"] > 0 and line["time"] for line in asked)


def test_every_answer_has_an_id_of_its_own_and_nobody_chooses_it(server):
    client = server.client()
    client.headers["X-Request-ID"] = "mine"
    ids = [client.get(path).headers["x-request-id"] for path in ("/", "/healthz", "/nowhere")]
    assert len(set(ids)) == 3
    assert all(re.fullmatch("[0-9a-f]{16}", ident) for ident in ids)


def test_a_failure_is_logged_by_its_class_and_place_and_not_by_what_somebody_sent():
    formatter = _SafeFormatter(["message"])
    try:
        raise ValueError("the participant ada-5f1 was here")
    except ValueError as error:
        failed = (type(error), error, error.__traceback__)
        record = logging.LogRecord("app", logging.ERROR, "", 0, "failed", (), failed)
    line = json.loads(formatter.format(record))
    assert line["exc_info"].startswith("ValueError in test_a_failure_is_logged_by_its_class")
    assert "ada" not in json.dumps(line)


def test_long_ids_are_masked_and_words_are_not():
    token = secrets.token_urlsafe(16)
    assert mask(f"no session {token!r}; begin one") == "no session '***'; begin one"
    assert mask(secrets.token_hex(16)) == "***"
    words = "timeout_graceful_shutdown in UnknownSessionError"
    assert mask(words) == words


FLOOD = """
import logging.config, sys, time
from humanplay.web import logs
logs.LINES = 20, 10.0
logging.config.dictConfig(logs.log_config(sys.argv[1]))
for number in range(1000):
    if number == 999:
        time.sleep(0.2)
    logging.error("it came: %s", chr(27) + chr(10) + "ERROR: forged " + 50_000 * "a ")
def fail(deep):  # by two lines in turn: what repeats itself is cut by Python
    if deep % 2:
        fail(deep - 1)
    elif deep:
        fail(deep - 1)
    raise ValueError(50_000 * (chr(27) + " "))
for deep in (0, 500):
    try:
        fail(deep)
    except ValueError:
        logging.exception("it failed")
"""


@pytest.mark.parametrize("log_format", ["text", "json"])
def test_what_strangers_cause_in_the_log_is_cut_rated_and_on_lines_of_its_own(log_format):
    command = [sys.executable, "-c", FLOOD, log_format]
    log = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert chr(27) not in log
    came = [line for line in log.splitlines() if "it came" in line]
    assert 21 <= len(came) < 60, "20 at once, and ten a second"
    left_out = re.findall(r"\(after (\d+) more from here, which are left out\)", "".join(came))
    assert len(came) + sum(map(int, left_out)) == 1000, (
        "each is written, or counted in the next one that is"
    )
    assert all(line.startswith(("ERROR: it came: \\x1b\\nERROR: forged", "{")) for line in came)
    assert log.count("ValueError") == log.count("it failed") == 2
    assert max(map(len, log.splitlines())) < 3000
    assert len(log.splitlines()) < len(came) + 100
