"""What people read at their end: codes, addresses and sentences that no protocol and no export holds."""

import json

import pytest

from humanplay.study.folder import Folder
from humanplay.study.outcome import Outcome
from humanplay.study.outcomes import ending
from humanplay.study.protocol import StudyError
from tests.support.command import command
from tests.support.recorded import ask
from tests.support.study import Person, freeze

PROLIFIC_ID = "5f3e0c9a1b2d4e6f8a7b9c0d"
FROM_PROLIFIC = {"PROLIFIC_PID": PROLIFIC_ID, "STUDY_ID": "6" * 24, "SESSION_ID": "7" * 24}
YES, NO = ({"version": "1", "agree": agree} for agree in (True, False))


def for_prolific(tmp_path, **texts):
    return freeze(
        tmp_path / "playground.db-studies", platform="prolific", recruitment="panel",
        outcomes={"finished": "C1DONE", **texts},
    )  # fmt: skip


def test_each_outcome_has_its_own_code_address_or_sentence(serve, tmp_path):
    for_prolific(tmp_path, no_consent="C2NO", withdrew="Please return your submission.")
    server = serve()
    people = [Person(server, outside_ids={**FROM_PROLIFIC, "PROLIFIC_PID": digit * 24}) for digit in "123"]  # fmt: skip
    finisher, decliner, leaver = people
    assert {person.where["ending"] for person in people} == {None}
    finisher.to_warm_up()
    finisher.play_on()
    back = "https://app.prolific.com/submissions/complete?cc="
    done = {"outcome": "finished", "code": "C1DONE", "address": f"{back}C1DONE", "sentence": None}
    assert finisher.where["ending"] == done
    decliner.call("consent", NO)
    declined = {"outcome": "no_consent", "code": "C2NO", "address": f"{back}C2NO", "sentence": None}
    assert decliner.where["ending"] == declined
    leaver.to_tutorial()
    leaver.call("withdraw")
    withdrew = {"outcome": "withdrew", "code": None, "address": None}
    assert leaver.where["ending"] == {**withdrew, "sentence": "Please return your submission."}


def test_a_study_that_is_closed_tells_those_on_their_way_that_it_stopped_them(serve, tmp_path):
    study = freeze(
        tmp_path / "playground.db-studies", outcomes={"left": "Write to us, with {code}."}
    )
    server = serve()
    busy, gone = Person(server), Person(server)
    gone.to_tutorial()
    busy.to_warm_up()
    busy.call("next")
    busy.play(2)
    Folder(tmp_path / "playground.db-studies").close(study.name)
    assert busy.me()["ending"]["outcome"] == "stopped_by_us"
    code = busy.where["ending"]["code"]
    assert len(code) == 8
    ((drawn,),) = ask(
        server.services.store.path,
        "SELECT completion_code FROM participants WHERE stage = 'tutorial'",
    )
    assert gone.me()["ending"] == {
        "outcome": "left", "code": None, "address": None, "sentence": f"Write to us, with {drawn}.",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("protocol", "texts", "said"),
    [
        ({"platform": "prolific"}, {}, "people come from Prolific, and nothing leads them back"),
        ({"platform": "prolific"}, {"finished": "Thank you."}, "nothing leads them back"),
        ({"platform": "prolific"}, {"finished": "{code}"}, "takes fixed codes and none is drawn"),
        ({"platform": "prolific"}, {"finished": "C1", "left": "C1"}, "two outcomes have the code C1"),
        ({"platform": "sona"}, {"finished": "https://x.example/?s={surveycode}"}, "{surveycode}, which nothing fills in"),
        ({"platform": "sona"}, {"finished": "https://x.example/?s={survey_code"}, "a brace without its pair"),
        ({"platform": "connect"}, {}, "with the address that gives credit"),
        ({}, {"fnished": "C1"}, "expected one of finished, no_consent"),
    ],
)  # fmt: skip
def test_no_study_is_frozen_whose_people_would_not_come_back(tmp_path, protocol, texts, said):
    ids = (
        {} if protocol.get("platform") in (None, "prolific") else {"outside_ids": ids_of(protocol)}
    )
    recruitment = "panel" if protocol else "open"
    with pytest.raises(StudyError) as refusal:
        freeze(tmp_path, recruitment=recruitment, outcomes=texts, **protocol, **ids)
    assert said in str(refusal.value)


def ids_of(protocol):
    """The parameters that a platform's links hold."""
    return {
        "sona": ("survey_code",), "connect": ("participantId", "assignmentId", "projectId"),
    }[protocol["platform"]]  # fmt: skip


def test_a_persons_own_id_goes_back_in_the_address_and_nothing_of_it_acts_there(tmp_path):
    address = (
        "https://s.sona-systems.com/webstudy_credit.aspx?credit_token=a&survey_code={survey_code}"
    )
    study = freeze(
        tmp_path, platform="sona", recruitment="panel", outside_ids=("survey_code",),
        outcomes={"finished": address},
    )  # fmt: skip
    texts = {Outcome.FINISHED: address}
    found = ending(study.protocol, texts, Outcome.FINISHED, {"survey_code": "1&a=2"}, None)
    assert found.address == address.replace("{survey_code}", "1%26a%3D2")


def test_texts_change_while_people_come_and_only_that_they_changed_is_noted(
    serve, tmp_path, capsys
):
    study = for_prolific(tmp_path)
    server = serve()
    person = Person(server, outside_ids=FROM_PROLIFIC)
    person.to_warm_up()
    database = "--database", tmp_path / "playground.db"
    code, out, _ = command(capsys, "study", "outcomes", study.name, "finished=C9NEW", *database)
    assert (code, "C9NEW" in out) == (0, True)
    person.play_on()
    assert person.where["ending"]["code"] == "C9NEW"
    for wrong in ("finished=", "finished=Thank you", "left={code}", "C7"):
        assert command(capsys, "study", "outcomes", study.name, wrong, *database)[0] == 2, wrong
    path = tmp_path / "playground.db-studies" / study.name / "outcomes.json"
    assert json.loads(path.read_text()) == {"finished": "C9NEW"}
    assert path.stat().st_mode & 0o777 == 0o600
    ((note,),) = ask(tmp_path / "playground.db", "SELECT note FROM chain WHERE kind = 'acted'")
    assert json.loads(note).keys() == {"study", "commitment", "act", "at_ms"}
    server.stop()
    assert b"C9NEW" not in (tmp_path / "playground.db").read_bytes()
