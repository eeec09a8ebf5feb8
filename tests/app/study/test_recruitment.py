"""Who gets into a study: invitations, panels' ids, the operator's code."""

import json
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import parse_qsl, urlsplit

import pytest

from humanplay.board.attestation import SUPERVISED_FOR_MS
from humanplay.db.erasure import forget
from humanplay.db.merging import merge
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.invitations import ALPHABET, MAX_INVITATIONS, Invitations, link_of, token_of
from humanplay.study.outcomes import change_texts
from humanplay.study.protocol import StudyError, default_protocol
from humanplay.study.recruitment import (
    DAY_MS,
    EMPTY,
    MAX_WRONG_CODES,
    MISSHAPEN,
    NO_ID,
    NO_INVITATION,
    REPEATED,
    REVOKED,
    TOO_LONG,
    UNFILLED,
    USED,
    WRONG_INVITATION,
    WRONG_PANEL_LINK,
    code_of,
)
from humanplay.study.verification import verify_database
from marsexplorer.config import EnvConfig
from tests.support.command import command, run
from tests.support.declared import DECLARATIONS
from tests.support.page_loads import LOAD
from tests.support.recorded import ask
from tests.support.study import Person, freeze

YES = {"version": "1", "agree": True}
PID = "PROLIFIC_PID"


@pytest.fixture
def invited(serve, tmp_path):
    """`invited(n)` is a server with a study by invitation, the study and n tokens."""

    def make(count=3):
        study = freeze(tmp_path / "playground.db-studies", recruitment="invitation")
        issued = Invitations(Folder(tmp_path / "playground.db-studies")).issue("small", count)
        return serve(), study, [token_of(study, invitation.id) for invitation in issued]

    return make


def comes(server, **join):
    """Return a person who has not joined yet, and what joining says."""
    person = Person(server, joins=False)
    answer = person.client.post(f"{person.url}/join", json=join)
    person.where = answer.json()
    return person, answer.status_code, person.where.get("detail") or person.where.get("note")


def rows(server, sql, *values):
    return ask(server.services.store.path, sql, *values)


def noted(server):
    """The reasons of the further joins on record, oldest first."""
    details = rows(
        server,
        "SELECT detail FROM stage_events WHERE kind = 'repeated_join' ORDER BY at_ms, number",
    )
    return [json.loads(detail)["reason"] for (detail,) in details]


def test_an_invitation_lets_one_person_in_and_opening_its_link_uses_nothing_up(invited):
    server, _, (token, *_) = invited()
    for _ in range(3):  # what a messenger does to show a preview, and a scanner of mail
        client = server.client()
        assert client.get(f"/study/small?invitation={token}").status_code == 200
        assert client.head(f"/study/small?invitation={token}").status_code in (200, 405)
    first, status, _ = comes(server, invitation=token.lower().replace("-", " "))
    assert (status, first.where["stage"], first.where["invited"]) == (201, "consent", True)
    second, status, _ = comes(server, invitation=token)
    assert status == 201, "joining uses nothing up either"
    second.call("consent", YES)
    assert first.refused("consent", YES) == USED
    assert first.me()["note"] == USED, "the page can say so instead of the consent"
    _, status, reason = comes(server, invitation=token)
    assert (status, reason) == (409, USED)
    assert noted(server) == ["invitation", "invitation"]
    assert second.call("join")["stage"] == "instructions", (
        "the same cookie goes on without the token"
    )
    assert second.call("join", {"invitation": token})["stage"] == "instructions"
    (used,) = rows(server, "SELECT invitation FROM participants WHERE consent_ms IS NOT NULL")
    assert token.startswith(used[0])


def test_declining_uses_nothing_up(invited):
    server, _, (token, *_) = invited()
    shy, _, _ = comes(server, invitation=token)
    shy.call("consent", {**YES, "agree": False})
    other, status, _ = comes(server, invitation=token)
    assert status == 201
    other.call("consent", YES)
    assert comes(server, invitation=token)[1:] == (409, USED)


def test_no_token_a_forged_one_and_one_of_another_study_let_nobody_in(invited, tmp_path):
    server, study, (token, *_) = invited()
    other = freeze(tmp_path / "playground.db-studies", "other", recruitment="invitation")
    (foreign,) = Invitations(Folder(tmp_path / "playground.db-studies")).issue("other", 1)
    assert comes(server)[1:] == (409, NO_INVITATION)
    ident = token.split("-")[0]
    unknown = next(free for free in (f"{a}ZZZ" for a in ALPHABET) if free != ident)
    forgeries = [
        token[:-1] + ALPHABET[(ALPHABET.index(token[-1]) + 1) % 32], ident, f"{ident}-0000-0000-0000", "", "x" * 100, "é" * 19,
        token_of(other, foreign.id), token_of(other, ident), token_of(study, unknown), token + token,
    ]  # fmt: skip
    for forged in forgeries:
        assert comes(server, invitation=forged)[1:] == (409, WRONG_INVITATION), forged
    assert (
        server.client().post("/api/studies/small/join", json={"invitation": "x" * 101}).status_code
        == 422
    )
    assert rows(server, "SELECT count(*) FROM participants") == [(0,)]
    person, status, _ = comes(server, outside_ids={"invitation": token})
    assert (status, person.where["detail"]) == (409, NO_INVITATION)
    refused = person.client.post(f"{person.url}/consent", json=YES)
    assert refused.status_code == 404, "nobody agrees who has not joined"


def test_a_revoked_invitation_lets_nobody_agree_and_sends_nobody_away(invited, tmp_path):
    server, _, (token, used, _) = invited()
    waiting, begun = comes(server, invitation=token)[0], comes(server, invitation=used)[0]
    begun.call("consent", YES)
    Invitations(Folder(tmp_path / "playground.db-studies")).revoke(
        "small", [token.split("-")[0].lower(), used]
    )
    assert waiting.refused("consent", YES) == REVOKED
    assert comes(server, invitation=token)[1:] == (409, REVOKED)
    assert comes(server, invitation=used)[1:] == (409, USED)
    assert begun.call("advance", {"from": "instructions"})["stage"] == "tutorial"


def test_a_closed_study_takes_nobody_whatever_they_bring(invited, tmp_path):
    server, _, (token, waits, _) = invited()
    waiting, _, _ = comes(server, invitation=waits)
    Folder(tmp_path / "playground.db-studies").close("small")
    assert "is closed" in comes(server, invitation=token)[2]
    assert "is closed" in waiting.refused("consent", YES)
    with pytest.raises(StudyError, match="is closed"):
        Invitations(Folder(tmp_path / "playground.db-studies")).issue("small", 1)


def test_of_many_who_agree_with_one_invitation_at_once_one_takes_part(invited):
    server, _, (token, *_) = invited()
    crowd = [comes(server, invitation=token)[0] for _ in range(6)]
    ready = threading.Barrier(len(crowd))

    def agree(person):
        ready.wait()
        return person.client.post(f"{person.url}/consent", json=YES).status_code

    with ThreadPoolExecutor(len(crowd)) as pool:
        assert sorted(pool.map(agree, crowd)) == [200, *[409] * 5]
    assert rows(server, "SELECT count(*) FROM participants WHERE consent_ms IS NOT NULL") == [(1,)]
    assert noted(server) == ["invitation"] * 5


def test_a_browser_that_takes_part_is_not_used_for_another_invitation(invited):
    server, _, (token, other, _) = invited()
    person, _, _ = comes(server, invitation=token)
    assert person.call("join", {"invitation": other})["stage"] == "consent", (
        "before the consent any link will do"
    )
    person.call("consent", YES)
    assert "takes part with another invitation" in person.refused("join", {"invitation": token})
    assert comes(server, invitation=other)[1:] == (409, USED)
    assert comes(server, invitation=token)[1] == 201
    assert noted(server) == ["another invitation", "invitation"]


def test_an_invitation_of_somebody_forgotten_stays_used_up_and_one_only_opened_does_not(
    invited, serve, tmp_path
):
    server, _, (token, unused, _) = invited()
    person, _, _ = comes(server, invitation=token)
    person.call("consent", YES)
    shy, _, _ = comes(server, invitation=unused)
    server.stop()
    for somebody in (person, shy):
        forget(tmp_path / "playground.db", somebody.where["participant"])
    assert token.split("-")[0].encode() not in (tmp_path / "playground.db").read_bytes()
    again = serve()
    assert comes(again, invitation=token)[1:] == (409, USED)
    assert comes(again, invitation=unused)[1] == 201


def test_an_invitation_used_on_two_servers_is_seen_once_their_databases_are_merged(
    invited, serve, tmp_path
):
    server, study, (token, *_) = invited()
    shutil.copytree(tmp_path / "playground.db-studies", tmp_path / "second.db-studies")
    people = [server, serve(database=tmp_path / "second.db")]
    for one_server in people:
        comes(one_server, invitation=token)[0].call("consent", YES)
        one_server.stop()
    _, twice = merge([tmp_path / "playground.db", tmp_path / "second.db"], tmp_path / "both.db")
    assert twice == 1
    assert [person.repeated for person in load(tmp_path / "both.db", study.name).people] == [
        ("somebody else agreed with their invitation on another server",)
    ] * 2


@pytest.mark.parametrize("recruitment", ["invitation", "panel", "open"])
def test_a_script_joins_without_an_invitation_and_stays_a_script(serve, tmp_path, recruitment):
    freeze(tmp_path / "playground.db-studies", recruitment=recruitment)
    server = serve()
    script = Person(server, script="noisy-frontier")
    script.call("consent", YES)
    assert (
        script.refused("supervise", {"code": "7K3M-XWT5"})
        == "only a person's session can be supervised"
    )
    assert rows(server, "SELECT kind, invitation FROM participants") == [("script", None)]


def test_a_panel_needs_its_id_and_takes_each_once_whatever_its_case(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", recruitment="panel")
    server = serve()
    for nothing in ({}, {"STUDY_ID": "s"}):
        assert comes(server, outside_ids=nothing)[1:] == (409, NO_ID)
    first, second = (comes(server, outside_ids={PID: value})[0] for value in ("abc 5F1", "ABC5f1"))
    second.call("consent", YES)
    taken = f"someone has joined with this {PID} in another browser: go on there, or write to whoever invited you"
    assert first.refused("consent", YES) == taken
    for value in ("abc5f1", " ABC 5F1 "):
        assert comes(server, outside_ids={PID: value})[1:] == (409, taken)
    assert noted(server) == ["outside id"] * 4, (
        "one of them at the join: the same id had come before the consent"
    )
    assert second.call("join")["stage"] == "instructions"
    assert second.call("join", {"outside_ids": {PID: "abc5f1"}})["stage"] == "instructions"
    assert "takes part for another" in second.refused("join", {"outside_ids": {PID: "abd"}})


@pytest.mark.parametrize("recruitment", ["open", "panel"])
def test_a_placeholder_that_the_platform_left_unfilled_names_nobody(serve, tmp_path, recruitment):
    freeze(tmp_path / "playground.db-studies", recruitment=recruitment)
    server = serve()
    unfilled = ("{{%PROLIFIC_PID%}}", " %SURVEY_CODE% ", "{survey_code}")
    for value in unfilled:
        _, status, detail = comes(server, outside_ids={PID: value})
        assert (status, detail) == (409, UNFILLED.format(value=value.strip(), name=PID))
    assert rows(server, "SELECT count(*) FROM participants") == [(0,)]
    _, status, detail = comes(server, outside_ids={PID: "5f1", "SESSION_ID": "{{%SESSION_ID%}}"})
    assert (status, "as SESSION_ID" in detail) == (409, True)


PROLIFIC_ID = "5f3e0c9a1b2d4e6f8a7b9c0d"
STUDY_LINK = {"STUDY_ID": "6" * 24, "SESSION_ID": "7" * 24}


@pytest.mark.parametrize(
    ("ids", "refusal"),
    [
        ({PID: ""}, EMPTY.format(name=PID)),
        ({PID: " "}, EMPTY.format(name=PID)),
        ({PID: [PROLIFIC_ID, PROLIFIC_ID]}, REPEATED.format(name=PID)),
        ({PID: "somebody"}, MISSHAPEN.format(name=PID, platform="Prolific")),
        ({PID: PROLIFIC_ID + "0"}, MISSHAPEN.format(name=PID, platform="Prolific")),
        ({PID: PROLIFIC_ID, "SESSION_ID": "x"}, MISSHAPEN.format(name="SESSION_ID", platform="Prolific")),
        ({PID: PROLIFIC_ID, "STUDY_ID": "{{%STUDY_ID%}}"}, "this link has {{%STUDY_ID%}} as STUDY_ID"),
        ({PID: "ASSIGNMENT_ID_NOT_AVAILABLE"}, "you see a preview of"),
    ],
)  # fmt: skip
def test_an_id_that_is_none_of_the_platforms_is_refused_in_a_sentence_and_nothing_is_stored(
    serve, tmp_path, ids, refusal
):
    freeze_for_prolific(tmp_path)
    server = serve()
    _, status, detail = comes(server, outside_ids={**STUDY_LINK, **ids})
    assert (status, detail.startswith(refusal)) == (409, True), detail
    assert rows(server, "SELECT count(*) FROM participants") == [(0,)]
    assert comes(server, outside_ids={**STUDY_LINK, PID: PROLIFIC_ID, "utm": ["a", "b"]})[1] == 201


@pytest.mark.parametrize(
    ("platform", "good", "bad"),
    [
        ("sona", {"survey_code": "12345"}, {"survey_code": "12a"}),
        ("connect", dict.fromkeys(("participantId", "assignmentId", "projectId"), "F51E3A0B99"),
         {"participantId": "../x", "assignmentId": "F51E3A0B99", "projectId": "F51E3A0B99"}),
    ],
)  # fmt: skip
def test_other_platforms_send_ids_of_their_own_and_take_people_back_by_an_address(
    serve, tmp_path, platform, good, bad
):
    studies, name = tmp_path / "playground.db-studies", next(iter(good))
    back = f"https://platform.example/credit?who={{{name}}}"
    freeze(studies, platform=platform, recruitment="panel", outside_ids=tuple(good), outcomes={"finished": back})  # fmt: skip
    server = serve()
    _, status, detail = comes(server, outside_ids=bad)
    assert (status, f"this link has a {name} that is none of" in detail) == (409, True)
    assert rows(server, "SELECT count(*) FROM participants") == [(0,)]
    person, status, _ = comes(server, outside_ids=good)
    person.to_warm_up()
    person.play_on()
    assert person.where["ending"]["address"] == back.replace(f"{{{name}}}", good[name])


def test_a_preview_says_what_the_study_is(serve, tmp_path):
    study = freeze_for_prolific(tmp_path)
    _, _, detail = comes(serve(), outside_ids={PID: "ASSIGNMENT_ID_NOT_AVAILABLE"})
    assert study.protocol.title in detail
    assert study.protocol.consent.text.split("\n\n")[0] in detail


def test_a_preview_is_known_whatever_parameter_says_so(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", outside_ids=("workerId",))
    server = serve()
    _, status, detail = comes(server, outside_ids={"assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"})
    assert (status, study.protocol.title in detail) == (409, True)
    assert rows(server, "SELECT count(*) FROM participants") == [(0,)]


def test_an_id_that_is_too_long_is_refused_and_not_cut(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", outside_ids=("ID",))
    server = serve()
    _, status, detail = comes(server, outside_ids={"ID": "x" * 201})
    assert (status, detail) == (409, TOO_LONG.format(name="ID", most=200))
    assert comes(server, outside_ids={"ID": "x" * 200, "utm": "y" * 201})[1] == 201
    assert rows(server, "SELECT length(value) FROM identities") == [(200,)]


def test_the_newest_session_of_a_platform_is_kept(serve, tmp_path):
    freeze_for_prolific(tmp_path)
    server = serve()
    person, _, _ = comes(server, outside_ids={**STUDY_LINK, PID: PROLIFIC_ID})
    person.call("consent", YES)
    person.call("join", {"outside_ids": {PID: PROLIFIC_ID, "SESSION_ID": "8" * 24}})
    identities = dict(rows(server, "SELECT name, value FROM identities"))
    assert identities == {PID: PROLIFIC_ID, "STUDY_ID": "6" * 24, "SESSION_ID": "8" * 24}
    assert verified(server)


def freeze_for_prolific(tmp_path, **rest):
    """Return a study of people from Prolific, who are given the code C1DONE."""
    texts = {"finished": "C1DONE", **rest.pop("outcomes", {})}
    studies = tmp_path / "playground.db-studies"
    return freeze(studies, platform="prolific", recruitment="panel", outcomes=texts, **rest)


def verified(server):
    """Whether every row of a server's database fits the chain."""
    return verify_database(server.services.store.path).findings == ()


def test_an_id_with_characters_that_nobody_sees_is_refused(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server, refusal = serve(), "an id must be without control characters, got "
    person = Person(server)
    person.to_tutorial()
    person.call("next")
    with person.socket() as socket:
        for hidden in ("\0", "\n", "\x1b[2J", "\x7f", "\u202e", "\u200b"):
            for join in ({"outside_ids": {PID: f"5f1{hidden}"}}, {"script": f"me{hidden}"}):
                _, status, detail = comes(server, **join)
                assert (status, detail.startswith(refusal), hidden in detail) == (422, True, False)
            keys = {"north": ["KeyW"], "west": [f"KeyA{hidden}"]}
            assert person.refused("settings", {"keys": keys}, status=422).startswith(refusal)
            batch = {**LOAD, "batch": f"batch-1{hidden}", "events": []}
            socket.send({"kind": "events", "episode": person.frame["episode"], **batch})
            assert socket.receive("error")["detail"].startswith(refusal)


def test_a_signed_panel_takes_each_signed_id_once_and_no_invented_one(serve, tmp_path, capsys):
    study = freeze(tmp_path / "playground.db-studies", recruitment="panel", panel_links="signed")
    ids = tmp_path / "ids.txt"
    ids.write_text("abc 5F1\n\nbcd\n", encoding="utf-8")
    invite = "study", "invite", study.name, "--ids", ids, "--url", "https://lab.example.org"
    code, out, _ = command(capsys, *invite, "--database", tmp_path / "playground.db")
    assert code == 0
    links = [dict(parse_qsl(urlsplit(line).query)) for line in out.splitlines()]
    assert [link[PID] for link in links] == ["abc 5F1", "bcd"]
    token, other = (link["invitation"] for link in links)
    server = serve()
    spoilt = token[:-1] + ("0" if token[-1] != "0" else "1")
    for value, signed in (
        ("abd", token),
        ("abd", None),
        ("abc 5F1", spoilt),
        ("abc 5F1", other),
        ("abc 5F1", None),
    ):
        refused = comes(server, outside_ids={PID: value}, invitation=signed)
        assert refused[1:] == (409, WRONG_PANEL_LINK), (value, signed)
    first = comes(server, outside_ids={PID: "ABC5f1"}, invitation=token)[0]
    first.call("consent", YES)
    assert first.call("join", {"outside_ids": {PID: "abc 5F1"}})["stage"] == "instructions"
    assert comes(server, outside_ids={PID: "abc 5F1"}, invitation=token)[1] == 409
    leaver = comes(server, outside_ids={PID: "bcd"}, invitation=other)[0]
    leaver.call("consent", {"version": "1", "agree": False})
    assert leaver.refused("join", {"outside_ids": {PID: "invented"}}) == WRONG_PANEL_LINK


def test_links_that_were_made_are_printed_although_their_table_cannot_be_written(tmp_path, capsys):
    study = freeze(tmp_path / "playground.db-studies", recruitment="invitation")
    path = tmp_path / "playground.db"
    invite = "study", "invite", study.name, "--database", path
    path.mkdir()
    assert command(capsys, *invite, 2)[0] == 1, "a folder"
    path.rmdir()
    invitations = Invitations(Folder(tmp_path / "playground.db-studies"))
    assert invitations.of(study.name) == {}
    code, out, error = command(capsys, *invite, 2, "--csv", tmp_path)
    links = [link_of(study, ident, "http://127.0.0.1:8000") for ident in invitations.of(study.name)]
    assert (out.split(), len(links)) == (links, 2)
    assert (code, "choose another --csv" in error) == (1, True)


def test_a_line_that_is_no_id_of_the_platform_keeps_nobody_out_in_silence(tmp_path, capsys):
    folder = Folder(tmp_path / "playground.db-studies")
    protocol = default_protocol(
        "small", EnvConfig.of("random", 7), platform="prolific", recruitment="panel",
        policies=("random",), debrief_policy="random", declarations=DECLARATIONS,
    )  # fmt: skip
    folder.create(protocol)
    change_texts(folder.path("small"), protocol, {"finished": "C1DONE"}, is_frozen=False)
    listed = tmp_path / "pilot.csv"
    freezes = "study", "freeze", "small", "--underpowered", "--exclude-ids", listed
    for strange in ("Participant id", f"{'5f' * 12},APPROVED"):
        listed.write_text(f"{'6e' * 12}\n{strange}\n")
        code, _, refusal = command(capsys, *freezes, "--database", tmp_path / "playground.db")
        assert (code, f"on each line of {listed}, got '{strange}'" in refusal) == (2, True)
    assert folder.status("small") == "draft"


def test_a_list_of_ids_that_is_no_text_is_one_sentence(tmp_path, capsys):
    study = freeze(tmp_path / "playground.db-studies", recruitment="panel", panel_links="signed")
    (tmp_path / "ids").write_bytes(b"\xff\xfe5f1")
    invite = "study", "invite", study.name, "--ids", tmp_path / "ids"
    database = "--database", tmp_path / "playground.db"
    code, _, error = command(capsys, *invite, *database)
    assert (code, "is no text in UTF-8" in error, error.count("\n")) == (2, True, 1)


def test_a_panel_without_an_outside_id_is_no_protocol(tmp_path):
    with pytest.raises(StudyError, match="needs outside_ids"):
        freeze(tmp_path / "playground.db-studies", recruitment="panel", outside_ids=())
    with pytest.raises(StudyError, match="signed is for recruitment panel, got recruitment open"):
        freeze(tmp_path / "other", recruitment="open", panel_links="signed")


def test_an_open_study_lets_everybody_in_and_flags_who_may_be_there_twice(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", recruitment="open")
    server = serve()
    people = [
        comes(server, outside_ids=ids)[0]
        for ids in ({}, {PID: "ada-1"}, {PID: " ADA-1"}, {PID: "bob-2"})
    ]
    assert comes(server, outside_ids={PID: "bob-2"})[1] == 409
    people[0].call("consent", {**YES, "agree": False})
    Person(server, client=people[0].client)
    server.stop()
    data = load(tmp_path / "playground.db", study.name)
    assert [person.repeated for person in data.people] == [
        ("the study was opened again after leaving it", "no outside id"),
        ("their outside id came again elsewhere",),
        ("an outside id that somebody had before",),
        ("their outside id came again elsewhere",),
    ]
    assert {(person.invitation, person.supervised) for person in data.people} == {(False, False)}


def test_the_operators_code_supervises_a_session_for_two_days_of_utc(invited, monkeypatch):
    server, study, (token, *_) = invited()
    person, _, _ = comes(server, invitation=token)
    assert "you are at the consent" in person.refused("supervise", {"code": "x"})
    person.call("consent", YES)
    now = server.services.lobby.sources.clock_ms()
    other = freeze(Folder(server.services.progress.folder.root).root, "other")
    wrong = [
        code_of(study, now - 2 * DAY_MS),
        code_of(study, now + DAY_MS),
        code_of(other, now),
        "",
        "é" * 9,
        "x" * 100,
    ]
    for code in wrong:
        assert person.refused("supervise", {"code": code}).startswith(
            "this is not the operator's code of today"
        )
    assert person.me()["supervised_until_ms"] is None
    code = code_of(study, now - DAY_MS)
    until = person.call("supervise", {"code": code.lower().replace("-", " ")})[
        "supervised_until_ms"
    ]
    assert 0 <= until - now - SUPERVISED_FOR_MS < 60_000
    kinds = rows(
        server,
        "SELECT kind, count(*) FROM stage_events WHERE kind IN ('wrong_code', 'supervised') GROUP BY kind",
    )
    assert kinds == [("supervised", 1), ("wrong_code", len(wrong))]
    for _ in range(MAX_WRONG_CODES - len(wrong)):
        person.refused("supervise", {"code": "no"})
    assert "no code is looked at any more" in person.refused(
        "supervise", {"code": code_of(study, now)}
    )
    other_person, _, _ = comes(server, invitation=token)
    assert other_person.where["detail"] == USED


def test_invitations_are_listed_by_id_alone_and_survive_a_damaged_command(tmp_path):
    study = freeze(tmp_path / "playground.db-studies", recruitment="invitation")
    invitations = Invitations(Folder(tmp_path / "playground.db-studies"))
    issued = invitations.issue("small", 4)
    text = (tmp_path / "playground.db-studies" / "small" / "invitations.json").read_text()
    for invitation in issued:
        assert invitation.id in text
        assert token_of(study, invitation.id)[5:] not in text
        assert (
            link_of(study, invitation.id, "http://h/p/")
            == f"http://h/p/study/small?invitation={token_of(study, invitation.id)}"
        )
    for count in (0, -1, MAX_INVITATIONS):
        with pytest.raises(StudyError, match="expected 1 to"):
            invitations.issue("small", count)
    with pytest.raises(StudyError, match="has no invitation 'ZZZZ!'"):
        invitations.revoke("small", [issued[0].id, "ZZZZ!"])
    assert all(invitation.revoked_ms is None for invitation in invitations.of("small").values())
    freeze(tmp_path / "playground.db-studies", "free", recruitment="open")
    with pytest.raises(StudyError, match="recruitment 'open'"):
        invitations.issue("free", 1)
    (tmp_path / "playground.db-studies" / "small" / "invitations.json").write_text("{}")
    with pytest.raises(StudyError, match="damaged"):
        invitations.of("small")


def test_two_who_issue_at_once_lose_nothing(tmp_path):
    freeze(tmp_path / "playground.db-studies", recruitment="invitation")
    with ThreadPoolExecutor(4) as pool:
        done = [
            pool.submit(
                lambda: Invitations(Folder(tmp_path / "playground.db-studies")).issue("small", 5)
            )
            for _ in range(8)
        ]
        issued = {invitation.id for work in done for invitation in work.result()}
    assert set(Invitations(Folder(tmp_path / "playground.db-studies")).of("small")) == issued
    assert len(issued) == 40


def test_a_links_address_is_the_one_given_or_said_to_be_a_guess(tmp_path, capsys, monkeypatch):
    freeze(tmp_path / "playground.db-studies", recruitment="invitation")
    words = ["study", "invite", "small", "1", "--database", str(tmp_path / "playground.db")]
    for more, public, address, guesses in (
        ([], "", "http://127.0.0.1:8000/", True),
        ([], "https://mars.example/lab", "https://mars.example/lab/", False),
        (["--url", "https://lab.example"], "https://mars.example", "https://lab.example/", False),
    ):
        if public:
            monkeypatch.setenv("HUMANPLAY_PUBLIC_URL", public)
        assert run(*words, *more) == 0
        printed = capsys.readouterr()
        assert printed.out.startswith(f"{address}study/small?invitation=")
        assert ("is a guess: give --url" in printed.err) is guesses


def test_the_commands_make_list_and_revoke_links_and_print_the_code(tmp_path, capsys):
    folder = ["--database", str(tmp_path / "playground.db")]
    assert run("study", "new", "lab", "--size", "7x9", "--policy", "random", *folder) == 0
    assert Folder(tmp_path / "playground.db-studies").draft("lab").recruitment == "invitation"
    study = freeze(tmp_path / "playground.db-studies", recruitment="invitation")
    capsys.readouterr()
    assert run("study", "invite", "small", "2", "--url", "https://lab.example", *folder) == 0
    links = capsys.readouterr().out.split()
    invitations = Invitations(Folder(tmp_path / "playground.db-studies"))
    assert links == [
        link_of(study, ident, "https://lab.example") for ident in invitations.of("small")
    ]
    ident = next(iter(invitations.of("small")))
    assert run("study", "revoke", "small", ident, *folder) == 0
    table, base = tmp_path / "links.csv", ["--database", str(tmp_path / "none.db"), *folder]
    capsys.readouterr()
    assert (
        run(
            "study",
            "invite",
            "small",
            "--list",
            "--url",
            "https://lab.example",
            "--csv",
            str(table),
            *base,
        )
        == 0
    )
    assert {"issued", "revoked"} <= set(capsys.readouterr().out.split())
    lines = table.read_text().splitlines()
    assert (lines[0], lines[1]) == (
        "id,state,participant,arm,link",
        f"{ident},revoked,,,{links[0]}",
    )
    assert table.stat().st_mode & 0o077 == 0, "for its owner alone"
    assert run("study", "supervise", "small", *folder) == 0
    code, until = capsys.readouterr().out.splitlines()
    assert (len(code), until[:11], until[-4:]) == (9, "valid until", " UTC")
    for args, error in (
        (["invite", "small"], "number of links"),
        (["revoke", "small", "nope"], "no invitation"),
    ):
        assert run("study", *args, *folder) == 2
        assert error in capsys.readouterr().err
