"""The cap of a study: nobody agrees beyond it, and whoever agreed goes on."""

from collections import Counter

import pytest

from humanplay.db.erasure import forget
from humanplay.release.pseudonyms import count_arrivals
from humanplay.report.preregistration import preregistration
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError
from tests.support.command import command
from tests.support.dying_server import dying
from tests.support.recorded import ask
from tests.support.study import Person, agree_at_once, freeze

YES, NO = ({"version": "1", "agree": agree} for agree in (True, False))
AGREED = "SELECT count(*) FROM participants WHERE kind = 'human' AND consent_ms IS NOT NULL"
AT_THE_PAGE = (
    "SELECT count(*) FROM stage_events WHERE json_extract(detail, '$.stage') = 'instructions'"
)
MINUTE_MS = 60_000


def test_of_a_crowd_that_agrees_at_once_nobody_is_over_the_cap(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", cap=5)
    server = serve()
    crowd = [Person(server) for _ in range(12)]
    answers = agree_at_once(crowd)
    assert sorted(answer["stage"] for answer in answers) == ["instructions"] * 5 + ["withdrawn"] * 7
    refused = [answer for answer in answers if answer["stage"] == "withdrawn"]
    assert {answer["ending"]["outcome"] for answer in refused} == {"over_quota"}
    assert all("Every place of this study is taken" in answer["note"] for answer in refused)
    assert Person(server).where["ending"]["outcome"] == "over_quota", "they are asked for nothing"
    assert ask(server.services.store.path, AGREED) == [(5,)]
    arrivals = load(server.services.store.path, study.name).arrivals
    assert (arrivals.over_quota, arrivals.declined, arrivals.undecided) == (8, 0, 0)


def test_a_crowd_at_a_server_that_dies_amid_a_consent_and_at_the_next_is_not_over_the_cap(
    spawn, tmp_path
):
    freeze(tmp_path / "playground.db-studies", cap=5)
    path = tmp_path / "playground.db"
    with dying(path, moves=4) as server:
        crowd = [Person(server) for _ in range(12)]
        cookies = [dict(person.client.cookies) for person in crowd]
        agree_at_once(crowd)
    assert ask(path, AGREED)[0][0] <= 3, "the fourth was not committed"
    assert ask(path, AGREED) == ask(path, AT_THE_PAGE)
    server = spawn()
    again = [Person(server, client=server.client(cookies=jar), joins=False) for jar in cookies]
    agree_at_once(again)
    ends = Counter((person.me()["ending"] or {}).get("outcome") for person in again)
    assert ends == {None: 5, "over_quota": 7}
    assert ask(path, AGREED) == [(5,)]
    server.close()


def test_a_place_is_free_again_after_its_minutes_and_whoever_had_it_goes_on(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", cap=2, place_minutes=90)
    server = serve()
    done, slow = Person(server), Person(server)
    done.to_warm_up()
    done.play_on()
    slow.to_tutorial()
    assert Person(server).where["ending"]["outcome"] == "over_quota"
    server.clock.wait(89 * MINUTE_MS)
    assert Person(server).where["ending"]["outcome"] == "over_quota"
    server.clock.wait(2 * MINUTE_MS)
    third = Person(server)
    third.to_warm_up()
    assert Person(server).where["ending"]["outcome"] == "over_quota", "the finisher keeps a place"
    slow.give_up_tutorial()
    slow.answer_questions()
    slow.play_on()
    assert slow.where["ending"]["outcome"] == "finished"
    assert slow.call("join")["stage"] == "debrief"


def test_only_people_who_agreed_take_a_place_and_a_finisher_who_is_erased_keeps_theirs(
    serve, tmp_path
):
    freeze(tmp_path / "playground.db-studies", cap=2)
    server = serve()
    Person(server, script="tester").to_tutorial()
    Person(server).call("consent", NO)
    done, gone = Person(server), Person(server)
    done.to_warm_up()
    done.play_on()
    gone.to_tutorial()
    assert Person(server).where["stage"] == "withdrawn"
    server.stop()
    for person in (done, gone):
        forget(tmp_path / "playground.db", person.where["participant"])
    again = serve()
    Person(again).to_tutorial()
    assert Person(again).where["ending"]["outcome"] == "over_quota"


def test_over_quota_has_its_code_and_leaves_no_id_and_is_counted_everywhere(
    serve, tmp_path, capsys
):
    freeze(
        tmp_path / "playground.db-studies", platform="prolific", recruitment="panel", cap=3,
        outcomes={"finished": "C1DONE", "over_quota": "C5FULL"},
    )  # fmt: skip
    server = serve()
    people = [
        Person(server, outside_ids={"PROLIFIC_PID": digit * 24, "STUDY_ID": "6" * 24, "SESSION_ID": "7" * 24})
        for digit in "1234"
    ]  # fmt: skip
    for person in people:
        person.call("consent", YES)
    assert people[3].where["ending"] == {
        "outcome": "over_quota", "code": "C5FULL", "sentence": None,
        "address": "https://app.prolific.com/submissions/complete?cc=C5FULL",
    }  # fmt: skip
    path = server.services.store.path
    assert ask(path, "SELECT count(*) FROM identities WHERE name = 'PROLIFIC_PID'") == [(3,)]
    assert count_arrivals(server.services.store.connection, "small", None).over_quota == 1
    code, out, _ = command(capsys, "study", "payments", "small", "--database", path)
    assert (code, "1 person has not agreed" in out, "C5FULL" in out) == (0, True, False)


@pytest.mark.parametrize(
    ("protocol", "sentence"),
    [
        (
            {"players": 10, "cap": 9},
            "cap must be at least 10, the number of players planned; got 9",
        ),
        (
            {"players": 25, "cap": 27, "platform": "prolific", "recruitment": "panel"},
            "cap must be at least 28, the 25 places on Prolific plus a tenth",
        ),
        ({"place_minutes": 60}, "there is no cap"),
    ],
)
def test_a_cap_that_is_too_low_is_refused(tmp_path, protocol, sentence):
    with pytest.raises(StudyError, match=sentence):
        freeze(tmp_path, **protocol)


def test_check_and_preregistration_say_the_cap_and_caution_against_short_places(tmp_path, capsys):
    study = freeze(
        tmp_path / "playground.db-studies", cap=4, place_minutes=2, warm_up=20, ranked=30
    )
    sentence = (
        "At most 4 people can agree to take part. The place of somebody who has not finished is free again 2 minutes "
        "after they agreed; they may still go on."
    )
    database = "--database", tmp_path / "playground.db"
    code, out, _ = command(capsys, "study", "check", "small", *database)
    assert code == 0
    assert sentence in out
    assert "so that more than 4 may finish: raise place_minutes" in out
    assert sentence in preregistration(study.protocol, study)
    freeze(tmp_path / "playground.db-studies", "free")
    code, out, _ = command(capsys, "study", "check", "free", *database)
    assert "At most" not in out
    assert Folder(tmp_path / "playground.db-studies").study("free").protocol.cap is None
