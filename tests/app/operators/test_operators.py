"""Operators by name: only a hash is stored, a code is used once, and what they do is logged before it is done."""

import asyncio
import shutil
import sqlite3
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from pathlib import Path
from threading import Event, Timer
from urllib.parse import parse_qs, urlsplit

import pyotp
import pytest
from click.testing import CliRunner

from app.admin import login
from app.cli.main import cli
from app.operators.delays import FREE_ATTEMPTS
from app.operators.operators import (
    OperatorError,
    Operators,
    add_operator,
    is_password_of,
    list_operators,
    remove_operator,
)
from app.storage.store import Store
from tests.app.admin.test_admin import CHANGING
from tests.support.servers import PATIENCE_S, eventually
from tests.support.study import freeze

ADA, BOB = "a-long-password", "another-password"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Databases with the operator ada, and with bob as well, and the secret of bob's codes: hashes take long."""
    folder = tmp_path_factory.mktemp("operators")
    add_operator(folder / "ada.db", "ada", ADA)
    shutil.copy(folder / "ada.db", folder / "both.db")
    address = add_operator(folder / "both.db", "bob", BOB, totp=True)
    return folder, parse_qs(urlsplit(address).query)["secret"][0]


@pytest.fixture
def database(made, tmp_path):
    """A database with the operator ada; the fixture `serve` serves this file."""
    return Path(shutil.copy(made[0] / "ada.db", tmp_path / "playground.db"))


@pytest.fixture
def secret(made, tmp_path):
    """The secret of bob's codes; the fixture `serve` serves a database with ada and bob."""
    shutil.copy(made[0] / "both.db", tmp_path / "playground.db")
    return made[1]


def log_in(client, name, password, code=""):
    return client.post("/api/admin/login", json={"name": name, "password": password, "code": code})


def query(path, sql):
    with closing(sqlite3.connect(path)) as conn:
        return conn.execute(sql).fetchall()


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
    ((stored,),) = query(database, "SELECT password_hash FROM operators")
    assert stored.startswith("$argon2id$")
    for path in database.parent.glob("playground.db*"):
        assert ADA.encode() not in path.read_bytes()


def test_attempts_at_the_same_time_are_no_way_around_the_wait(database, serve):
    server = serve()
    clients = [server.page() for _ in range(3 * FREE_ATTEMPTS)]
    with ThreadPoolExecutor(len(clients)) as pool:
        statuses = list(
            pool.map(lambda client: log_in(client, "ada", "wrong-wrong").status_code, clients)
        )
    assert (statuses.count(401), statuses.count(429)) == (FREE_ATTEMPTS, 2 * FREE_ATTEMPTS)
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
    """Hold the lock of a database for some seconds, from another connection; OperationalError when somebody holds it."""
    conn = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
    try:
        conn.execute("BEGIN IMMEDIATE")
    except sqlite3.OperationalError:
        conn.close()
        raise
    Timer(seconds, conn.close).start()


def test_a_login_while_the_database_is_locked_checks_the_password_and_counts_the_attempt_once(
    database, secret, serve, monkeypatch
):
    server, checked = serve(), []

    def check_and_lock(*given):
        checked.append(given)
        if len(checked) == 1:
            lock(database, 2.0)
        return is_password_of(*given)

    monkeypatch.setattr(login, "is_password_of", check_and_lock)
    assert log_in(server.page(), "bob", BOB, pyotp.TOTP(secret).now()).status_code == 200
    assert len(checked) == 1


def test_a_code_is_not_lost_to_a_lock_that_keeps_the_login_from_being_logged(
    database, secret, serve, monkeypatch
):
    server, use_code = serve(), Operators.use_code
    monkeypatch.setattr("app.database_file.write_queue.PATIENCE_S", 0.2)

    def use_and_lock(self, operator, code):
        is_right = use_code(self, operator, code)
        with suppress(sqlite3.OperationalError):  # while the login is being written nobody else can
            lock(database, 1.0)
        return is_right

    monkeypatch.setattr(Operators, "use_code", use_and_lock)
    assert log_in(server.page(), "bob", BOB, pyotp.TOTP(secret).now()).status_code == 200


def test_a_code_is_asked_for_and_used_once(secret, serve):
    server = serve()
    code = pyotp.TOTP(secret).now()
    assert log_in(server.page(), "bob", BOB).status_code == 401
    assert (
        log_in(server.page(), "bob", BOB, "000000" if code != "000000" else "000001").status_code
        == 401
    )
    assert log_in(server.page(), "bob", "wrong-wrong", code).status_code == 401
    assert log_in(server.page(), "bob", BOB, code).status_code == 200
    assert log_in(server.page(), "bob", BOB, code).status_code == 401, (
        "somebody has looked over the shoulder"
    )


def test_codes_stand_for_their_half_minute_and_its_neighbours(database, secret):
    now = [1_800_000_000.0]
    with closing(Store(database)) as store:
        operators = Operators(store, lambda: now[0])
        bob, code = asyncio.run(operators.find("bob")), pyotp.TOTP(secret).at(1_800_000_000)
        now[0] += 60
        assert not operators.use_code(bob, code), "two half minutes later"
        now[0] -= 30
        assert operators.use_code(bob, code)
        assert not operators.use_code(bob, code)
        assert not operators.use_code(bob, pyotp.TOTP(secret).at(1_800_000_000 - 30)), (
            "nor one from before"
        )
        assert not operators.use_code(bob, "٣" * 6)


def test_every_action_is_logged_with_its_operator_and_how_it_ended(database, serve, tmp_path):
    freeze(tmp_path / "studies")
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
        "emergency_look",
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
    freeze(tmp_path / "studies")
    server = serve()
    ada = server.page()
    log_in(ada, "ada", ADA)
    server.execute(
        "CREATE TRIGGER full BEFORE INSERT ON operator_actions BEGIN SELECT raise(ABORT, 'disk full'); END"
    )
    assert ada.post("/api/admin/studies/small/close", json={"name": "small"}).status_code == 503
    assert ada.get("/api/studies/small").json()["status"] == "open"


def test_guessing_does_not_fill_the_log(database, serve):
    server = serve()
    for _ in range(FREE_ATTEMPTS):
        log_in(server.page(), "ada", "wrong-wrong")
    assert query(database, "SELECT count(*) FROM operator_actions WHERE status = 401") == [(1,)]


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
    added = marsexplorer(
        "operator", "add", "bob", "--totp", "--database", database, given=f"{BOB}\n"
    )
    assert added.exit_code == 0, added.output
    assert "otpauth://totp/MarsExplorer%20Playground:bob?secret=" in added.stdout
    assert BOB not in added.output
    assert (
        "there is an operator 'bob' already"
        in marsexplorer("operator", "add", "bob", "--database", database, given=BOB).output
    )
    assert "bob" in marsexplorer("operator", "list", "--database", database).stdout
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 0
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 2
    assert "remove_operator bob" in marsexplorer("operator", "log", "--database", database).stdout
