"""The operator's login and requests: who gets in, and what is shown."""

import re
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest
from itsdangerous import TimestampSigner
from websockets.exceptions import ConnectionClosed, InvalidStatus

from humanplay.web.access import ADMIN_COOKIE
from humanplay.web.operator.login import (
    MOST_ATTEMPTS,
    TOKEN_S,
    AdminLogin,
    AdminPassword,
    TooManyAttemptsError,
    WrongPasswordError,
)
from humanplay.web.protection import limits
from humanplay.web.settings import Settings
from tests.support.command import command
from tests.support.recorded import alter, ask
from tests.support.servers import eventually, forged
from tests.support.study import Person, freeze

PASSWORD = "red-planet-4"
READING = ("overview", "studies/small", "studies/small/files/small-report.html")
CHANGING = {
    "check": {},
    "studies/small/close": {"name": "small"},
    "studies/small/exports/report": {},
    "studies/small/invitations": {"count": 1},
    "studies/small/outcomes": {"texts": {}},
    "studies/small/payments": {},
    "studies/small/invitations/revoke": {"ids": ["7K3M"]},
    "names": {"name": "Ada", "hidden": True},
    "logout": {},
}


@pytest.fixture
def admin(serve, tmp_path):
    """A server with an operator and one open study.

    `admin.operator()` is a client that has logged in.
    """
    freeze(tmp_path / "playground.db-studies")
    server = serve(admin_password=PASSWORD)

    def operator():
        client = server.client(headers={"Origin": server.url})
        assert client.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
        return client

    server.operator = operator
    return server


def test_without_a_password_there_is_no_such_page(server):
    client = server.client(headers={"Origin": server.url})
    assert client.get("/admin").status_code == 404
    for path in READING:
        assert client.get(f"/api/admin/{path}").status_code == 404
    for path, body in {**CHANGING, "login": {"password": PASSWORD}}.items():
        assert client.post(f"/api/admin/{path}", json=body).status_code == 404
    watching = server.socket("any", client, path="/ws/admin/sessions/")
    with pytest.raises(InvalidStatus) as refusal, watching:
        pass
    assert refusal.value.response.status_code in (403, 404)


def test_the_page_stands_in_no_frame(admin):
    answer = admin.client().get("/admin")
    assert answer.status_code == 200
    assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
    assert "script-src 'self'" in answer.headers["content-security-policy"]


def test_every_call_refuses_strangers(admin):
    person = Person(admin)
    person.to_tutorial()
    session = person.call("next")["session"]
    for client in (admin.client(headers={"Origin": admin.url}), person.client):
        client.headers["Origin"] = admin.url
        for path in READING:
            answer = client.get(f"/api/admin/{path}")
            assert (answer.status_code, answer.json()["detail"][:6]) == (401, "log in")
        for path, body in CHANGING.items():
            if path != "logout":
                assert client.post(f"/api/admin/{path}", json=body).status_code == 401, path
        watching = admin.socket(session, client, path="/ws/admin/sessions/")
        with pytest.raises(InvalidStatus), watching:
            pass
    assert admin.client().get("/api/studies/small").json()["status"] == "open"


def test_the_calls_are_those_that_exist():
    from humanplay.web.admin import router

    paths = {route.path for route in router.routes}
    tried = {
        *(f"/api/admin/{path}" for path in (*READING, *CHANGING, "login")),
        "/ws/admin/sessions/any",
    }
    shapes = {re.sub(r"\{[^}]+\}", "[^/]+", path) for path in paths}
    assert [path for path in tried if not any(re.fullmatch(shape, path) for shape in shapes)] == []
    assert len(shapes) == len(tried), "a call that these tests do not try"


def test_a_wrong_password_and_too_many_of_them(admin):
    client = admin.client(headers={"Origin": admin.url})
    for _ in range(MOST_ATTEMPTS):
        answer = client.post("/api/admin/login", json={"password": "blue-planet-4"})
        assert answer.status_code == 401
        assert answer.json()["detail"] == "this is not the operator's password"
    assert ADMIN_COOKIE not in client.cookies
    answer = client.post("/api/admin/login", json={"password": PASSWORD})
    assert answer.status_code == 429, "not even the right one is looked at"
    wait = int(answer.headers["retry-after"])
    assert 0 < wait <= 167
    detail = f"too many wrong attempts from this address: wait {wait} seconds, then try again"
    assert answer.json()["detail"] == detail


def test_attempts_at_the_same_time_are_no_way_around_the_limit(admin):
    clients = [admin.page() for _ in range(3 * MOST_ATTEMPTS)]

    def status(client):
        return client.post("/api/admin/login", json={"password": "wrong-wrong"}).status_code

    with ThreadPoolExecutor(len(clients)) as pool:
        statuses = list(pool.map(status, clients))
    assert (statuses.count(401), statuses.count(429)) == (
        MOST_ATTEMPTS,
        2 * MOST_ATTEMPTS,
    )


def test_attempts_of_one_address_come_back_slowly_until_one_is_right(monkeypatch):
    now_s = [1_000.0]
    timed = partial(limits.TokenBucket, clock_s=lambda: now_s[0])
    monkeypatch.setattr(limits, "TokenBucket", timed)
    login = AdminLogin(AdminPassword(PASSWORD))

    def wait_s(password="wrong-wrong", address="1.2.3.4"):
        try:
            login.issue(address, password)
        except WrongPasswordError:
            return 0
        except TooManyAttemptsError as error:
            return error.wait_s
        return None

    assert [wait_s() for _ in range(MOST_ATTEMPTS)] == [0] * MOST_ATTEMPTS
    assert (wait_s(), wait_s(address="5.6.7.8")) == (167, 0)
    attempts = MOST_ATTEMPTS
    for _ in range(3600):
        now_s[0] += 1
        attempts += wait_s() == 0
    assert attempts == 26, "in an hour"
    now_s[0] += 167
    assert wait_s(PASSWORD) is None
    assert [wait_s() for _ in range(MOST_ATTEMPTS)] == [0] * MOST_ATTEMPTS


def test_the_cookie_is_strict_and_cannot_be_forged_outlived_or_used_after_logout(
    admin, monkeypatch
):
    client = admin.client(headers={"Origin": admin.url})
    set_cookie = client.post("/api/admin/login", json={"password": PASSWORD}).headers["set-cookie"]
    for attribute in ("HttpOnly", "SameSite=strict", f"Max-Age={TOKEN_S}", "Path=/"):
        assert attribute in set_cookie
    assert "Secure" not in set_cookie
    value = set_cookie.split(";")[0].split("=", 1)[1]

    def status(cookie):
        client = admin.client(headers={"Cookie": f"{ADMIN_COOKIE}={cookie}"})
        return client.get("/api/admin/overview").status_code

    assert status(value) == 200
    foreign = TimestampSigner("another key", salt="humanplay-admin").sign("a" * 32).decode()
    for wrong in (forged(value), "x" + value, foreign, "", "a.b.c"):
        assert status(wrong) == 401, wrong

    began_s = int(time.time()) - TOKEN_S - 60
    with monkeypatch.context() as patch:
        patch.setattr(TimestampSigner, "get_timestamp", lambda self: began_s)
        old = client.post("/api/admin/login", json={"password": PASSWORD}).headers["set-cookie"]
    assert status(old.split(";")[0].split("=", 1)[1]) == 401

    page = admin.client(headers={"Origin": admin.url, "Cookie": f"{ADMIN_COOKIE}={value}"})
    assert page.post("/api/admin/logout", json={}).status_code == 200
    assert status(value) == 401, "a revoked cookie is not valid any more"


def test_another_sites_page_cannot_use_the_operators_cookie(admin):
    client = admin.operator()
    for origin in ("https://evil.example", "null", None):
        client.headers.pop("Origin")
        if origin is not None:
            client.headers["Origin"] = origin
        for path, body in {**CHANGING, "login": {"password": PASSWORD}}.items():
            answer = client.post(f"/api/admin/{path}", json=body)
            assert answer.status_code == 403, (origin, path)
            assert "must come from" in answer.json()["detail"]
        assert client.get("/api/admin/overview").status_code == (200 if origin is None else 403)
        watching = admin.socket("any", client, origin or False, path="/ws/admin/sessions/")
        with pytest.raises(InvalidStatus), watching:
            pass
        client.headers["Origin"] = admin.url
    assert client.get("/api/studies/small").json()["status"] == "open"


def test_a_study_is_shown_as_it_is_played_and_without_identities(admin, monkeypatch):
    monkeypatch.setattr("humanplay.web.operator.participants.FRESH_S", 0.5)
    operator = admin.operator()
    empty = operator.get("/api/admin/studies/small").json()
    assert (empty["participants"], empty["figure"], empty["status"]) == ([], None, "open")

    done, under_way = Person(admin, outside_ids={"PROLIFIC_PID": "ada-5f1"}), Person(admin)
    done.to_warm_up()
    frames = done.play_on()["ranked"]
    under_way.to_warm_up()
    under_way.call("next")
    under_way.play(moves=2)
    gone = Person(admin)
    gone.call("consent", {"version": "1", "agree": True})
    gone.call("withdraw")
    Person(admin, script="noisy-frontier").call("consent", {"version": "1", "agree": True})

    answer = operator.get("/api/admin/studies/small")
    assert "ada-5f1" not in answer.text
    shown = answer.json()
    assert done.client.cookies["humanplay_participant"].split(".")[0] not in answer.text
    counts = {row["stage"]: (row["human"], row["script"]) for row in shown["stages"]}
    there = {stage: count for stage, count in counts.items() if any(count)}
    people = dict.fromkeys(("warm_up", "debrief", "withdrawn"), (1, 0))
    assert there == {**people, "instructions": (0, 1)}
    by_stage = {row["stage"]: row for row in shown["participants"]}
    assert by_stage["withdrawn"]["left_at"] == "instructions"
    assert (by_stage["warm_up"]["ranked"], by_stage["warm_up"]["mean_score"]) == (None, None)
    assert by_stage["instructions"]["script"] == "noisy-frontier"
    first = by_stage["debrief"]
    assert first["label"] == done.where["participant"], "what the participant can quote"
    steps = [played[-1]["step"] if played[-1]["outcome"] == "explored" else 63 for played in frames]
    assert (first["warm_up"], first["ranked"], first["mean_steps"]) == (2, None, None)
    close = partial(operator.post, "/api/admin/studies/small/close")
    refused = close(json={"name": "small"})
    assert (refused.status_code, "within the last ten minutes" in refused.text) == (409, True)
    assert close(json={"name": "small", "now": True}).is_success
    closed = operator.get("/api/admin/studies/small").json()
    (first,) = (row for row in closed["participants"] if row["stage"] == "debrief")
    assert first["mean_steps"] == pytest.approx(sum(steps) / 3)
    assert sum(first["outcomes"].values()) == 3
    fresh = closed["figure"]
    assert (fresh["players"], fresh["episodes"]) == (1, 3)
    assert fresh["steps"]["mean"] == pytest.approx(sum(steps) / 3)


def test_invitations_are_issued_watched_and_revoked(admin, tmp_path):
    freeze(tmp_path / "playground.db-studies", "lab", recruitment="invitation")
    operator = admin.operator()

    def shown():
        return operator.get("/api/admin/studies/lab").json()

    first = shown()
    assert (first["recruitment"], first["invitations"], len(first["code"])) == ("invitation", [], 9)
    issued = operator.post("/api/admin/studies/lab/invitations", json={"count": 3})
    assert issued.status_code == 201
    tokens = issued.json()["tokens"]
    assert [invitation["token"] for invitation in shown()["invitations"]] == tokens
    used, opened = (Person(admin, "lab", invitation=token) for token in tokens[:2])
    used.call("consent", {"version": "1", "agree": True})
    last = tokens[2].split("-")[0]
    revoked = operator.post("/api/admin/studies/lab/invitations/revoke", json={"ids": [last]})
    assert revoked.json() == {"revoked": [last]}
    listed = shown()["invitations"]
    assert [(invitation["state"], invitation["label"], invitation["token"]) for invitation in listed] == [
        ("used", used.where["participant"], None), ("opened", opened.where["participant"], tokens[1]), ("revoked", None, None)
    ]  # fmt: skip
    late = Person(admin, "lab", joins=False)
    assert late.refused("join", {"invitation": tokens[2]}).startswith("this invitation has been")
    (first, _) = shown()["participants"]
    fields = {"invitation": tokens[0].split("-")[0], "repeated": [], "supervised_ms": None}
    assert fields.items() <= first.items()
    used.call("supervise", {"code": shown()["code"]})
    assert shown()["participants"][0]["supervised_ms"] is not None

    def fails(path, body):
        answer = operator.post(f"/api/admin/studies/{path}", json=body)
        return answer.status_code, answer.json()["detail"]

    assert fails("lab/invitations", {"count": 0})[0] == 422
    assert "5000" in fails("lab/invitations", {"count": 4998})[1]
    assert "has no invitation 'nope'" in fails("lab/invitations/revoke", {"ids": ["nope"]})[1]
    assert "recruitment 'open'" in fails("small/invitations", {"count": 1})[1]
    operator.post("/api/admin/studies/lab/close", json={"name": "lab"})
    assert shown()["code"] is None
    assert {invitation["token"] for invitation in shown()["invitations"]} == {None}
    assert "is closed" in fails("lab/invitations", {"count": 1})[1]


def test_an_open_study_shows_how_many_have_finished_and_nothing_of_their_episodes(admin, tmp_path):
    freeze(tmp_path / "playground.db-studies", "hidden", warm_up=0, ranked=1)
    operator, person = admin.operator(), Person(admin, "hidden")
    person.to_warm_up()
    person.call("next")
    person.play()
    url = "/api/admin/studies/hidden"
    answer = eventually(lambda: (now := operator.get(url).json())["figure"] and now)
    sentence = "No figure is shown until the study is closed: 1 of 2 have finished."
    assert {"sentence": sentence, "players": 0, "score": None}.items() <= answer["figure"].items()
    (row,) = answer["participants"]
    hidden = {"ranked": None, "mean_score": None, "mean_steps": None, "outcomes": {}}
    assert {name: row[name] for name in hidden} == hidden


def test_what_an_environment_raised_in_an_open_study_tells_no_seed_time_or_step(admin, tmp_path):
    freeze(tmp_path / "playground.db-studies", "hidden", warm_up=0, ranked=1)
    operator, person = admin.operator(), Person(admin, "hidden")
    person.to_warm_up()
    person.call("next")
    episode = person.play()[-1]["episode"]
    report = "step 17, action 1 (east): KeyError: no such room\nTraceback, line 4"
    statement = f"UPDATE episodes SET failure = '{report}' WHERE id = '{episode}'"
    assert alter(tmp_path / "playground.db", statement) == 1

    def failure():
        (shown,) = operator.get("/api/admin/overview").json()["failures"]
        return shown["report"], shown["ended_ms"], shown["seed"]

    assert failure() == (report.partition(", ")[2], None, None)
    closing = {"name": "hidden", "now": True}
    operator.post("/api/admin/studies/hidden/close", json=closing).raise_for_status()
    assert failure()[0] == report
    assert None not in failure()


def test_boards_are_watched_live_by_the_operator_on_their_own_page_alone(admin):
    operator, person = admin.operator(), Person(admin)
    person.to_warm_up()
    person.call("next")
    answer = operator.get("/api/admin/overview")
    assert answer.json()["boards"] == [], "nobody sits there"
    assert answer.headers["cache-control"] == "no-store"
    for client in (operator, admin.client()):
        assert client.get(f"/api/sessions/{person.where['session']}").status_code == 404
    seen_by = admin.socket(person.where["session"], operator, path="/ws/admin/sessions/")
    with person.socket() as playing, seen_by as watching:
        frame, seen = playing.receive("frame"), watching.receive("frame")
        assert seen == frame
        assert watching.receive("history")["positions"] == [[0, 0]]
        (board,) = operator.get("/api/admin/overview").json()["boards"]
        assert (board["study"], board["label"], board["phase"], board["trial"]) == (
            "small", person.where["participant"], "warm_up", 0,
        )  # fmt: skip
        for action in ("east", "south"):
            playing.act(frame, action, input="key")
            moved = playing.frame_after(frame["step"])
            assert watching.frame_after(frame["step"])["position"] == moved["position"]
            frame = moved
            if frame["outcome"]:
                break
        assert operator.post("/api/admin/logout", json={}).status_code == 200
        if frame["outcome"] is None:
            playing.act(frame, "west", input="key")
            with pytest.raises(ConnectionClosed):
                watching.frame_after(frame["step"])


def test_a_board_whose_player_has_left_is_not_live_however_long_it_is_watched(admin):
    operator, person = admin.operator(), Person(admin)
    person.to_warm_up()
    session = person.call("next")["session"]
    with admin.socket(session, operator, path="/ws/admin/sessions/") as watching:
        watching.receive("frame")
        with person.socket() as playing:
            playing.receive("frame")
            assert len(operator.get("/api/admin/overview").json()["boards"]) == 1
        eventually(lambda: operator.get("/api/admin/overview").json()["boards"] == [])


def test_closing_takes_the_name_and_is_for_good(admin):
    operator, person = admin.operator(), Person(admin)
    person.to_tutorial()
    person.call("next")
    wrong = operator.post("/api/admin/studies/small/close", json={"name": "smal"})
    assert wrong.status_code == 422
    assert wrong.json()["detail"].startswith("type the study's name, 'small', t")
    early = operator.post("/api/admin/studies/small/exports/release", json={})
    assert early.status_code == 409
    assert early.json()["detail"] == "the study 'small' is open: close it first, then release it"
    operator.post("/api/admin/studies/small/close", json={"name": "small"}).raise_for_status()
    public = operator.get("/api/studies/small").json()
    assert public["status"] == "closed"
    assert public["secret"]
    person.refused("next")
    again = operator.post("/api/admin/studies/small/close", json={"name": "small"})
    assert again.status_code == 409
    assert again.json()["detail"].startswith("the study 'small' is closed alre")
    shown = operator.get("/api/admin/studies/small").json()
    assert (shown["status"], shown["closed_ms"] is not None) == ("closed", True)
    assert operator.get("/api/admin/studies/nosuch").status_code == 404


def test_an_export_that_fails_says_why_in_the_commands_own_words(admin):
    operator = admin.operator()
    operator.post("/api/admin/studies/small/close", json={"name": "small"}).raise_for_status()
    exports = "/api/admin/studies/small/exports"
    begun = operator.post(f"{exports}/release", json={"authors": ["Ada Lovelace"]})
    assert (begun.status_code, begun.json()["release"]["state"]) == (202, "making")
    busy = operator.post(f"{exports}/release", json={})
    assert busy.status_code == 409
    assert busy.json()["detail"] == "this release is being made already: wait until it is done"

    def done():
        release = operator.get("/api/admin/studies/small").json()["exports"]["release"]
        return release if release["state"] != "making" else None

    release = eventually(done, 120)
    assert (release["state"], release["files"]) == ("failed", [])
    assert "'small'" in release["error"], "nobody has joined it"
    assert operator.get("/api/admin/studies/small/files/small-release.zip").status_code == 404
    assert operator.post(f"{exports}/anything", json={}).status_code == 422


def test_drafts_and_thawed_studies_are_listed_with_what_is_wrong(admin, tmp_path):
    freeze(tmp_path / "playground.db-studies", "thawed")
    path = tmp_path / "playground.db-studies" / "thawed" / "protocol.json"
    path.write_text(path.read_text().replace('"ranked":3', '"ranked":2'))
    operator = admin.operator()
    listed = {
        study["name"]: study for study in operator.get("/api/admin/overview").json()["studies"]
    }
    assert listed["small"]["status"] == "open"
    assert listed["thawed"]["status"] == "broken"
    assert "thawed protocol" in listed["thawed"]["error"]
    assert operator.get("/api/admin/studies/thawed").status_code == 409


def test_health_is_of_this_disk_and_this_database(admin):
    health = admin.operator().get("/api/admin/overview").json()["health"]
    assert 0 < health["disk"]["free"] <= health["disk"]["total"]
    assert health["database"]["size"] > 0
    assert health["check"]["is_whole"] is True
    assert health["chain"]["entries"] == 1  # the study's freezing
    assert abs(health["last_write_ms"] - time.time() * 1000) < 600_000
    assert admin.operator().post("/api/admin/check", json={}).json()["check"]["result"] == "ok"


def test_who_stores_most_and_how_long_moves_take_is_shown_without_an_address(admin):
    person = Person(admin)
    person.to_tutorial()
    person.call("next")
    with person.socket() as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        socket.frame_after(0)
    for size in (9, 128):
        assert admin.client().post("/api/sessions", json={"size": size}).status_code == 201
    health = admin.operator().get("/api/admin/overview").json()["health"]
    owners, disk = health["owners"], health["disk"]
    percents = {"address": 0.5, "player": 0.1, "study": 5.0}
    assert [(owner["kind"], owner["name"]) for owner in owners] == [
        ("address", ""), ("study", "small"), ("player", ""),
    ]  # fmt: skip
    assert [owner["budget"] for owner in owners] == [
        round(disk["total"] * percents[owner["kind"]] / 100) for owner in owners
    ]
    value = admin.services.store.metrics.registry.get_sample_value
    for owner in owners:
        assert owner["bytes"] == value(f"humanplay_stored_bytes_{owner['kind']}") > 500
    watched = health["watched"]
    assert 0 < watched["move_p99_seconds"] == value("humanplay_move_p99_seconds") < 5
    assert (watched["waiting_jobs"], watched["backup_age_seconds"]) == (0, -1)


def test_the_password_is_drawn_and_printed_when_none_is_given(spawn, monkeypatch):
    for name in ("HUMANPLAY_ADMIN_PASSWORD", "HUMANPLAY_ADMIN"):
        monkeypatch.delenv(name, raising=False)
    server = spawn(admin=True)
    sentence, _, password = server.printed[-2].rstrip().rpartition(" ")
    assert sentence == "the operator's page is /admin, its password until the server stops:"
    client = server.client(headers={"Origin": server.url})
    assert client.post("/api/admin/login", json={"password": password}).status_code == 200
    server.kill()


def test_a_password_that_is_too_short_is_refused_without_being_repeated(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setenv("HUMANPLAY_ADMIN_PASSWORD", "mars4")
    code, out, error = command(capsys, "serve", "--port", 0, "--database", tmp_path / "a.db")
    assert (code, out) == (1, "")
    assert "must have at least 8 characters, got 5; set another HUMANPLAY_ADMIN_PASSWORD" in error
    assert "mars4" not in error


def test_settings_do_not_print_the_password(monkeypatch, tmp_path):
    def settings(**rest):
        return Settings(database=tmp_path / "none.db", **rest)

    monkeypatch.setenv("HUMANPLAY_ADMIN_PASSWORD", PASSWORD)
    assert PASSWORD not in repr(Settings())
    monkeypatch.setenv("HUMANPLAY_ADMIN_PASSWORD", "")
    assert AdminPassword.of(settings()) is None
    assert AdminPassword.of(settings(admin=True)).drawn


def test_which_move_did_not_fit_is_told_to_the_operator_and_not_to_the_participant(admin):
    operator, person = admin.operator(), Person(admin)
    person.to_warm_up()
    person.call("next")
    with person.socket() as socket:
        frame = socket.receive("frame")
        way, back = ("south", "north") if frame["grid"][1][0] == "." else ("east", "west")
        socket.act(frame, way, input="key")
        frame = socket.frame_after(0)
        act = {"kind": "act", "episode": frame["episode"], "step": 1, "action": back}
        socket.send({**act, "input": "key", "key_down_ms": 7.0, "client_ms": 7.0})
        frame = socket.frame_after(1)
    person.call("give-up", {"episode": frame["episode"], "step": frame["step"]})
    about = person.client.get(f"/api/sessions/{person.where['session']}/about").json()
    assert (about["attestation"], about["not_attested"]) == (None, None)
    assert "fit" not in person.client.get("/api/studies/small/me").text
    (row,) = operator.get("/api/admin/studies/small").json()["participants"]
    (reason,) = row["not_attested"]
    assert reason.startswith("spoilt warm-up 1: step 1: no press of its own")


def test_the_operator_lists_whom_to_pay_and_changes_what_people_read_at_their_end(admin):
    person, operator = Person(admin), admin.operator()
    person.to_tutorial()
    person.call("withdraw")
    listed = operator.post("/api/admin/studies/small/payments", json={}).json()
    (row,) = listed["rows"]
    assert dict(zip(listed["columns"], row, strict=True))["outcome"] == "withdrew"
    assert row[1] in listed["csv"]
    assert (listed["bulk"], listed["without_consent"]) == (None, 0)
    change = {"texts": {"withdrew": "Thank you, {code}."}}
    assert operator.post("/api/admin/studies/small/outcomes", json=change).status_code == 200
    assert person.me()["ending"]["sentence"] == f"Thank you, {person_code(admin)}."
    wrong = operator.post("/api/admin/studies/small/outcomes", json={"texts": {"left": "{pid}"}})
    assert (wrong.status_code, "nothing fills in" in wrong.json()["detail"]) == (409, True)
    shown = operator.get("/api/admin/studies/small").json()["outcomes"]
    assert {outcome["outcome"]: outcome["text"] for outcome in shown}[
        "withdrew"
    ] == "Thank you, {code}."
    admin.services.progress.folder.path("small").joinpath("outcomes.json").write_text("{")
    answer = operator.get("/api/admin/studies/small").json()
    assert "outcomes.json" in answer["outcomes_problem"]
    assert (answer["outcomes"], len(answer["participants"])) == ([], 1)


def person_code(server):
    """The code that was drawn for the one participant."""
    ((code,),) = ask(server.services.store.path, "SELECT completion_code FROM participants")
    return code
