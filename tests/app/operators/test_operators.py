"""Operators by name: only a hash is stored, a code is used once, and what they do is logged before it is done."""

import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from urllib.parse import parse_qs, urlsplit

import pyotp
import pytest
from click.testing import CliRunner

from app.cli.main import cli
from app.operators.delays import FREE_ATTEMPTS
from app.operators.operators import OperatorError, Operators, add_operator, list_operators, remove_operator
from app.storage.store import Store
from tests.app.admin.test_admin import CHANGING
from tests.support.study import freeze

ADA, BOB = "a-long-password", "another-password"


@pytest.fixture
def database(tmp_path):
    """A database with the operator ada; the fixture `serve` serves this file."""
    path = tmp_path / "playground.db"
    add_operator(path, "ada", ADA)
    return path


def log_in(client, name, password, code=""):
    return client.post("/api/admin/login", json={"name": name, "password": password, "code": code})


def query(path, sql):
    with closing(sqlite3.connect(path)) as conn:
        return conn.execute(sql).fetchall()


def marsexplorer(*args, given=""):
    return CliRunner().invoke(cli, list(map(str, args)), input=given)


def test_a_named_operator_logs_in_as_well_as_the_one_password_and_is_out_when_removed(database, serve):
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
    assert ada.get("/api/admin/overview").status_code == 401, "the cookie was of somebody who was removed"


def test_no_answer_says_whether_a_name_exists(database, serve):
    server = serve()
    answers = [log_in(server.page(), *given) for given in (("ada", "wrong-wrong"), ("eve", ADA))]
    assert {answer.status_code for answer in answers} == {401}
    assert len({answer.json()["detail"] for answer in answers}) == 1
    assert log_in(server.page(), "", ADA).status_code == 401, "the name belongs to the password"
    assert log_in(server.page(), "", "").status_code == 401, "there is no password without a name here"


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
        statuses = list(pool.map(lambda client: log_in(client, "ada", "wrong-wrong").status_code, clients))
    assert (statuses.count(401), statuses.count(429)) == (FREE_ATTEMPTS, 2 * FREE_ATTEMPTS)
    assert log_in(server.page(), "ada", ADA).status_code == 429, "not even the right password is looked at"


def test_a_code_is_asked_for_and_used_once(database, serve):
    secret = parse_qs(urlsplit(add_operator(database, "bob", BOB, totp=True)).query)["secret"][0]
    server = serve()
    code = pyotp.TOTP(secret).now()
    assert log_in(server.page(), "bob", BOB).status_code == 401
    assert log_in(server.page(), "bob", BOB, "000000" if code != "000000" else "000001").status_code == 401
    assert log_in(server.page(), "bob", "wrong-wrong", code).status_code == 401
    assert log_in(server.page(), "bob", BOB, code).status_code == 200
    assert log_in(server.page(), "bob", BOB, code).status_code == 401, "somebody has looked over the shoulder"


def test_codes_stand_for_their_half_minute_and_its_neighbours(database):
    secret = parse_qs(urlsplit(add_operator(database, "bob", BOB, totp=True)).query)["secret"][0]
    now = [1_800_000_000.0]
    with closing(Store(database)) as store:
        operators = Operators(store, lambda: now[0])
        bob, code = operators.find("bob"), pyotp.TOTP(secret).at(1_800_000_000)
        now[0] += 60
        assert not operators.use_code(bob, code), "two half minutes later"
        now[0] -= 30
        assert operators.use_code(bob, code)
        assert not operators.use_code(bob, code)
        assert not operators.use_code(bob, pyotp.TOTP(secret).at(1_800_000_000 - 30)), "nor one from before"
        assert not operators.use_code(bob, "٣" * 6)


def test_every_action_is_logged_with_its_operator_and_how_it_ended(database, serve, tmp_path):
    freeze(tmp_path / "studies")
    server = serve()
    ada = server.page()
    log_in(server.page(), "ada", "wrong-wrong")
    log_in(ada, "ada", ADA)
    statuses = [ada.post(f"/api/admin/{path}", json=body).status_code for path, body in CHANGING.items()]
    server.page().post("/api/admin/studies/small/close", json={"name": "small"})  # of a stranger: no operator's action
    log_in(ada, "ada", ADA)
    missing = ada.get("/api/admin/studies/small/files/nothing.html").status_code
    shown = ada.get("/api/admin/overview").json()["actions"]
    kept = [(each["operator"], each["action"], each["study"], each["status"]) for each in shown[::-1]]
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
    server.services.store.connection.execute(
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
    added = marsexplorer("operator", "add", "bob", "--totp", "--database", database, given=f"{BOB}\n")
    assert added.exit_code == 0, added.output
    assert "otpauth://totp/MarsExplorer%20Playground:bob?secret=" in added.stdout
    assert BOB not in added.output
    assert (
        "there is an operator 'bob' already" in marsexplorer("operator", "add", "bob", "--database", database, given=BOB).output
    )
    assert "bob" in marsexplorer("operator", "list", "--database", database).stdout
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 0
    assert marsexplorer("operator", "remove", "bob", "--database", database).exit_code == 2
    assert "remove_operator bob" in marsexplorer("operator", "log", "--database", database).stdout
