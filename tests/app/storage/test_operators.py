"""Operators by name: only a hash is stored, guessing is limited, and what they do is logged before it is done."""

import shutil
import sqlite3
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event, Timer

import pytest
from click.testing import CliRunner

from humanplay.cli.main import cli
from humanplay.db.operators import (
    OperatorError,
    add_operator,
    is_password_of,
    list_operators,
    remove_operator,
)
from humanplay.web.operator import login
from tests.app.admin.test_admin import CHANGING
from tests.support.recorded import ask
from tests.support.servers import PATIENCE_S, eventually
from tests.support.study import freeze

ADA, BOB = "a-long-password", "another-password"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A database with the operator ada: hashes take long."""
    path = tmp_path_factory.mktemp("operators") / "ada.db"
    add_operator(path, "ada", ADA)
    return path


@pytest.fixture
def database(made, tmp_path):
    """A database with the operator ada; the fixture `serve` serves this file."""
    return Path(shutil.copy(made, tmp_path / "playground.db"))


def log_in(client, name, password):
    return client.post("/api/admin/login", json={"name": name, "password": password})


def marsexplorer(*args, given=""):
    return CliRunner().invoke(cli, list(map(str, args)), input=given)


def test_a_named_operator_logs_in_as_well_as_the_one_password_and_is_out_when_removed(
    database, serve
):
    server = serve(admin_password="red-planet-4")
    ada, alone = server.page(), server.page()
    assert log_in(ada, "ada", ADA).status_code == 200
    assert log_in(alone, "", "red-planet-4").status_code == 200
    assert ada.get("/api/admin/overview").json()["operator"] == "ada"
    assert alone.get("/api/admin/overview").json()["operator"] == "operator"
    add_operator(database, "bob", BOB)  # beside the running server
    assert log_in(server.page(), "bob", BOB).status_code == 200
    remove_operator(database, "ada")
    assert ada.get("/api/admin/overview").status_code == 401
    add_operator(database, "ada", ADA)
    assert ada.get("/api/admin/overview").status_code == 401, (
        "the cookie was of somebody who was removed"
    )


def test_no_answer_says_whether_a_name_exists(database, serve):
    server = serve()
    answers = [log_in(server.page(), *given) for given in (("ada", "wrong-wrong"), ("eve", ADA))]
    assert {answer.status_code for answer in answers} == {401}
    assert len({answer.json()["detail"] for answer in answers}) == 1
    assert log_in(server.page(), "", ADA).status_code == 401, "the name belongs to the password"
    assert log_in(server.page(), "", "").status_code == 401, (
        "there is no password without a name here"
    )


def test_a_database_with_operators_has_the_page_without_a_flag(database, serve, tmp_path):
    assert serve().client().get("/admin").status_code == 200
    assert serve(database=tmp_path / "other.db").client().get("/admin").status_code == 404


def test_the_password_is_stored_as_a_hash_alone(database):
    ((stored,),) = ask(database, "SELECT password_hash FROM operators")
    assert stored.startswith("$argon2id$")
    for path in database.parent.glob("playground.db*"):
        assert ADA.encode() not in path.read_bytes()


def test_attempts_at_the_same_time_are_no_way_around_the_limit(database, serve):
    server = serve()
    clients = [server.page() for _ in range(3 * login.ATTEMPTS_PER_MINUTE)]
    with ThreadPoolExecutor(len(clients)) as pool:
        statuses = list(
            pool.map(lambda client: log_in(client, "ada", "wrong-wrong").status_code, clients)
        )
    assert (statuses.count(401), statuses.count(429)) == (
        login.ATTEMPTS_PER_MINUTE,
        2 * login.ATTEMPTS_PER_MINUTE,
    )
    assert log_in(server.page(), "ada", ADA).status_code == 429, (
        "not even the right password is looked at"
    )


def test_passwords_that_wait_for_their_check_are_few_and_beyond_them_the_answer_says_when_to_come_again(
    database, serve, monkeypatch
):
    server, checking = serve(trusted_proxies=("127.0.0.1",)), Event()

    def check_later(operator, password):
        checking.wait(PATIENCE_S)
        return is_password_of(operator, password)

    monkeypatch.setattr(login, "is_password_of", check_later)
    clients = [server.page() for _ in range(3 * login.MOST_CHECKED)]
    for number, client in enumerate(clients):
        client.headers["X-Forwarded-For"] = f"203.0.113.{number}"
    with ThreadPoolExecutor(len(clients)) as pool:
        answers = [pool.submit(log_in, client, "ada", "wrong-wrong") for client in clients]
        try:
            eventually(
                lambda: sum(answer.done() for answer in answers) == 2 * login.MOST_CHECKED,
                seconds=10,
            )
        finally:
            checking.set()
    statuses = Counter(answer.result().status_code for answer in answers)
    assert statuses == {401: login.MOST_CHECKED, 429: 2 * login.MOST_CHECKED}
    refused = next(answer.result() for answer in answers if answer.result().status_code == 429)
    assert refused.headers["retry-after"] == str(login.BUSY_S)
    assert (
        refused.json()["detail"]
        == f"too many people log in at this moment: wait {login.BUSY_S} seconds, then try again"
    )
    assert log_in(server.page(), "ada", ADA).status_code == 200, "all have been checked"


def lock(path, seconds):
    """Hold the lock of a database for some seconds, from another connection, once nobody else holds it."""
    conn = sqlite3.connect(path, timeout=30, isolation_level=None, check_same_thread=False)
    conn.execute("BEGIN IMMEDIATE")
    Timer(seconds, conn.close).start()


def test_a_login_while_the_database_is_locked_checks_the_password_and_counts_the_attempt_once(
    database, serve, monkeypatch
):
    server, checked = serve(), []

    def check_and_lock(*given):
        checked.append(given)
        if len(checked) == 1:
            lock(database, 2.0)
        return is_password_of(*given)

    monkeypatch.setattr(login, "is_password_of", check_and_lock)
    assert log_in(server.page(), "ada", ADA).status_code == 200
    assert len(checked) == 1


def test_every_action_is_logged_with_its_operator_and_how_it_ended(database, serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    ada = server.page()
    log_in(server.page(), "ada", "wrong-wrong")
    log_in(ada, "ada", ADA)
    statuses = [
        ada.post(f"/api/admin/{path}", json=body).status_code for path, body in CHANGING.items()
    ]
    server.page().post(
        "/api/admin/studies/small/close", json={"name": "small"}
    )  # of a stranger: no operator's action
    log_in(ada, "ada", ADA)
    missing = ada.get("/api/admin/studies/small/files/nothing.html").status_code
    shown = ada.get("/api/admin/overview").json()["actions"]
    kept = [
        (each["operator"], each["action"], each["study"], each["status"]) for each in shown[::-1]
    ]
    names = (
        "check_database",
        "close_study",
        "begin_export",
        "issue_invitations",
        "revoke_invitations",
        "hide_name",
        "logout",
    )
    assert kept == [
        ("command line", "add_operator ada", None, 200),
        ("ada", "log_in", None, 401),
        ("ada", "log_in", None, 200),
        *(
            ("ada", name, "small" if "studies" in path else None, status)
            for name, path, status in zip(names, CHANGING, statuses, strict=True)
        ),
        ("ada", "log_in", None, 200),
        ("ada", "download", "small", missing),
    ]


def test_an_action_that_cannot_be_logged_is_not_done(database, serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    ada = server.page()
    log_in(ada, "ada", ADA)
    server.execute(
        "CREATE TRIGGER full BEFORE INSERT ON operator_actions BEGIN SELECT raise(ABORT, 'disk full'); END"
    )
    assert ada.post("/api/admin/studies/small/close", json={"name": "small"}).status_code == 503
    assert ada.get("/api/studies/small").json()["status"] == "open"


def test_attempts_are_limited_by_the_minute_and_by_the_hour_for_one_address_until_one_is_right(
    monkeypatch,
):
    now = [1_800_000_000.0]
    monkeypatch.setattr("time.time", lambda: now[0])
    attempts = login.Attempts()

    def begin(address="1.2.3.4"):
        try:
            attempts.begin(address)
        except login.TooManyAttemptsError as error:
            return error.wait_s
        return 0

    for _ in range(6):
        assert [begin() for _ in range(login.ATTEMPTS_PER_MINUTE)] == [
            0
        ] * login.ATTEMPTS_PER_MINUTE
        assert (begin(), begin("5.6.7.8")) == (60, 0)
        now[0] += 61
    assert begin() == 3600 - 6 * 61, "thirty in an hour"
    attempts.forgive("1.2.3.4")
    assert begin() == 0


def test_guessing_does_not_fill_the_log(database, serve):
    server = serve()
    for _ in range(login.ATTEMPTS_PER_MINUTE):
        log_in(server.page(), "ada", "wrong-wrong")
    assert ask(database, "SELECT count(*) FROM operator_actions WHERE status = 401") == [(1,)]


@pytest.mark.parametrize(
    ("name", "password", "said"),
    [
        ("ada", ADA, "there is an operator 'ada' already"),
        ("Ada Lovelace", ADA, "an operator's name is a letter"),
        ("operator", ADA, "an operator's name is a letter"),
        ("bob", "short", "at least 8 characters, got 5"),
    ],
)
def test_what_cannot_be_added_is_said(database, name, password, said):
    with pytest.raises(OperatorError, match=said):
        add_operator(database, name, password)
    assert [each.name for each in list_operators(database)] == ["ada"]


def test_the_command_adds_lists_logs_and_removes(tmp_path):
    database = tmp_path / "lab.db"
    missing = marsexplorer("operator", "list", "--database", database)
    assert (missing.exit_code, f"no database at {database}" in missing.output) == (1, True)
    added = marsexplorer("operator", "add", "bob", "--database", database, given=f"{BOB}\n")
    assert added.exit_code == 0, added.output
    assert BOB not in added.output
    assert (
        "there is an operator 'bob' already"
        in marsexplorer("operator", "add", "bob", "--database", database, given=BOB).output
    )
    assert "bob" in marsexplorer("operator", "list", "--database", database).stdout
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 0
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 2
    assert "remove_operator bob" in marsexplorer("operator", "log", "--database", database).stdout
