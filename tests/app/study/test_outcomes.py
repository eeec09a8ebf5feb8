"""What people read when they finish or leave: codes, addresses and sentences."""

import json
from contextlib import closing

import pytest

from humanplay.db.reader import Reader
from humanplay.db.study_rows import participant_label
from humanplay.report.statistics.exclusion_sets import people_of, statuses
from humanplay.study.data import load
from humanplay.study.flow import Status
from humanplay.study.folder import Folder
from humanplay.study.outcome import Outcome
from humanplay.study.outcomes import change_texts, ending, read_texts
from humanplay.study.payments import payments_of
from humanplay.study.protocol import StudyError
from humanplay.study.protocol_parts import Payment
from tests.support.command import command
from tests.support.recorded import alter, ask
from tests.support.study import Person, freeze

BACK = "https://app.prolific.com/submissions/complete?cc="
PROLIFIC_ID = "5f3e0c9a1b2d4e6f8a7b9c0d"
FROM_PROLIFIC = {"PROLIFIC_PID": PROLIFIC_ID, "STUDY_ID": "6" * 24, "SESSION_ID": "7" * 24}
OUTCOME_OF = {
    Status.FINISHED: Outcome.FINISHED,
    Status.GAVE_UP: Outcome.FINISHED,
    Status.EXCLUDED: Outcome.FINISHED,
    Status.NOT_ATTESTED: Outcome.FINISHED,
    Status.PARTLY_BOT: Outcome.FINISHED,
    Status.FAILED: Outcome.STOPPED_BY_US,
    Status.INTERRUPTED: Outcome.STOPPED_BY_US,
    Status.INTERRUPTED_EARLY: Outcome.STOPPED_BY_US,
    Status.WITHDREW: Outcome.WITHDREW,
    Status.WITHDREW_EARLY: Outcome.WITHDREW,
    Status.STOPPED: Outcome.LEFT,
    Status.LEFT: Outcome.LEFT,
    Status.NEVER_BEGAN: Outcome.LEFT,
    Status.FAILED_QUESTIONS: Outcome.FAILED_QUESTIONS,
    Status.FAILED_PRACTICE: Outcome.FAILED_PRACTICE,
    Status.DECLINED: Outcome.NO_CONSENT,
    Status.UNFIT_DEVICE: Outcome.UNFIT_DEVICE,
}
"""Each status of the report that is an outcome; whoever plays, or was erased, has none."""
YES, NO = ({"version": "1", "agree": agree} for agree in (True, False))


def for_prolific(tmp_path, payment=None, **texts):
    return freeze(
        tmp_path / "playground.db-studies", platform="prolific", recruitment="panel",
        payment=payment, outcomes={"finished": "C1DONE", **texts},
    )  # fmt: skip


def test_each_outcome_has_its_own_code_address_or_sentence(serve, tmp_path):
    for_prolific(tmp_path, no_consent="C2NO", withdrew="Please return your submission.")
    server = serve()
    people = [Person(server, outside_ids={**FROM_PROLIFIC, "PROLIFIC_PID": digit * 24}) for digit in "123"]  # fmt: skip
    finisher, decliner, leaver = people
    assert {person.where["ending"] for person in people} == {None}
    finisher.to_warm_up()
    finisher.play_on()
    done = {"outcome": "finished", "code": "C1DONE", "address": f"{BACK}C1DONE", "sentence": None}
    assert finisher.where["ending"] == done
    decliner.call("consent", NO)
    declined = {"outcome": "no_consent", "code": "C2NO", "address": f"{BACK}C2NO", "sentence": None}
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
    ("protocol", "texts", "reason"),
    [
        ({"platform": "prolific"}, {}, "people come from Prolific, and nothing leads them back"),
        ({"platform": "prolific"}, {"finished": "Thank you."}, "nothing leads them back"),
        ({"platform": "prolific"}, {"finished": "{code}"}, "takes fixed codes and none is drawn"),
        ({"platform": "prolific"}, {"finished": "C1", "left": "C1"}, "two outcomes have the code C1"),
        ({"platform": "sona"}, {"finished": "https://x.example/?s={surveycode}"}, "{surveycode}, which nothing fills in"),
        ({"platform": "sona"}, {"finished": "https://x.example/?s={survey_code"}, "a brace without its pair"),
        ({"platform": "sona"}, {"finished": "https://x.example/?e=1&survey_code=XXXX"}, "has the same survey_code for"),
        ({"platform": "connect"}, {}, "with the address that gives credit"),
        ({}, {"fnished": "C1"}, "expected one of finished, unfit_device"),
        ({}, {"no_consent": "Write to us, with {code}."}, "no_consent has {code}, but nothing is stored of"),
        ({"platform": "sona"}, {"unfit_device": "https://x.example/?s={survey_code}"}, "unfit_device has {survey_code}"),
        ({}, {"finished": "{code:d}"}, "finished has more than a name within braces"),
        ({}, {"left": "Thanks, {code!r}."}, "left has more than a name within braces"),
    ],
)  # fmt: skip
def test_no_study_is_frozen_whose_people_would_not_come_back(tmp_path, protocol, texts, reason):
    ids = (
        {} if protocol.get("platform") in (None, "prolific") else {"outside_ids": ids_of(protocol)}
    )
    recruitment = "panel" if protocol else "open"
    with pytest.raises(StudyError) as refusal:
        freeze(tmp_path, recruitment=recruitment, outcomes=texts, **protocol, **ids)
    assert reason in str(refusal.value)


def test_the_address_that_prolific_shows_beside_a_code_stands_for_the_code(tmp_path):
    texts = {"finished": f"{BACK}C1DONE", "withdrew": "C2LEFT"}
    study = for_prolific(tmp_path, **texts)
    folder = tmp_path / "playground.db-studies" / study.name
    assert read_texts(folder) == {Outcome.FINISHED: "C1DONE", Outcome.WITHDREW: "C2LEFT"}
    with pytest.raises(StudyError, match="two outcomes have the code C1DONE"):
        change_texts(folder, study.protocol, {"withdrew": f"{BACK}C1DONE"}, is_frozen=True)


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
    shown = ending(study.protocol, texts, Outcome.FINISHED, {"survey_code": "1&a=2"}, None)
    assert shown.address == address.replace("{survey_code}", "1%26a%3D2")


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


def test_a_device_that_does_not_fit_ends_it_before_the_consent_and_is_counted(serve, tmp_path):
    texts = {"unfit_device": "Open it on a computer."}
    freeze(tmp_path / "playground.db-studies", device="computer", outcomes=texts)
    server = serve()
    tablet, computer = Person(server, outside_ids={"PROLIFIC_PID": "t"}), Person(server)
    assert tablet.where["device"] == "computer"
    tablet.call("consent", {**NO, "unfit": True})
    assert "again on a computer" not in tablet.where["note"], (
        "what the operator wrote is said alone"
    )
    assert (tablet.where["stage"], tablet.where["ending"]["sentence"]) == (
        "withdrawn",
        "Open it on a computer.",
    )
    assert ask(server.services.store.path, "SELECT count(*) FROM identities") == [(0,)]
    computer.call("consent", NO)
    arrivals = load(server.services.store.path, "small").arrivals
    assert (arrivals.unfit, arrivals.declined, arrivals.undecided) == (1, 1, 0)


def test_whoever_uses_up_their_tries_at_the_questions_does_not_go_on(serve, tmp_path):
    texts = {"failed_questions": "C3FAILED"}
    freeze(tmp_path / "playground.db-studies", question_tries=2, outcomes=texts)
    person = Person(serve())
    person.to_questions()
    wrong = {"answers": [1, 0, 0]}
    assert person.where["tries_left"] == 2
    person.call("answers", wrong)
    assert (person.where["stage"], person.where["tries_left"]) == ("questions", 1)
    person.call("answers", wrong)
    assert (person.where["stage"], person.where["ending"]["code"]) == ("withdrawn", "C3FAILED")
    assert "in the tries that this study allows" in person.where["note"]
    assert "this belongs to the questions" in person.refused("answers", {"answers": [0, 1, 1]})


def test_the_outcomes_of_a_list_are_those_of_the_report(serve, tmp_path, capsys):
    """The outcome in the list of payments follows from the status in the report."""
    practice = {"episodes_to_pass": 1, "tries": 1}
    freeze(tmp_path / "playground.db-studies", question_tries=2, practice=practice)
    server = serve()
    finisher, quitter, early, gone, busy, wrong, untrained, broken, stopped = people = [
        Person(server) for _ in range(9)
    ]
    finisher.to_warm_up()
    finisher.play_on()
    quitter.to_warm_up()
    quitter.play_on(until=("ranked",))
    quitter.call("next")
    quitter.call("withdraw")
    early.to_tutorial()
    early.call("withdraw")
    gone.to_tutorial()
    wrong.to_questions()
    for _ in range(2):
        wrong.call("answers", {"answers": [1, 0, 0]})
    untrained.to_warm_up()
    for _ in range(2):
        untrained.call("next")
        untrained.call("give-up", {"episode": untrained.frame["episode"], "step": 0})
    for person in (busy, stopped):
        person.to_warm_up()
        person.call("next")
        person.play(2)
    broken.to_warm_up()
    broken.play_on(until=("ranked",))
    broken.call("next")
    broken.play()
    failed = """WITH failed AS (SELECT x.participant_id, e.id FROM episodes e JOIN series_episodes x
        ON x.episode_id = e.id WHERE x.phase = 'ranked' ORDER BY e.started_ms DESC LIMIT 1)"""
    long_ago = """UPDATE steps SET server_ms = server_ms - 900000 WHERE episode_id IN (SELECT episode_id
        FROM series_episodes x JOIN failed ON failed.participant_id = x.participant_id)"""
    fails = "UPDATE episodes SET outcome = 'environment_failed' WHERE id IN (SELECT id FROM failed)"
    alter(tmp_path / "playground.db", f"{failed} {long_ago}", f"{failed} {fails}")
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    stopped.call("withdraw")
    on_pages = {person.me()["participant"]: person.where["ending"]["outcome"] for person in people}
    server.stop()
    data = load(tmp_path / "playground.db", "small")
    cohort = people_of(data)
    reported = {participant_label(ident): OUTCOME_OF[status] for ident, status in statuses(data, cohort).items()}  # fmt: skip
    study = Folder(tmp_path / "playground.db-studies").study("small")
    with closing(Reader.open(tmp_path / "playground.db")) as reader:
        listed = {payee.label: payee.outcome for payee in payments_of(reader, study, {}).payees}
    assert listed == reported == on_pages
    for person in (broken, stopped):
        assert listed[person.where["participant"]] == "stopped_by_us"
    assert sorted(listed.values()) == [
        "failed_practice", "failed_questions", "finished", "left", "stopped_by_us", "stopped_by_us", "stopped_by_us",
        "withdrew", "withdrew",
    ]  # fmt: skip


def test_an_amount_is_named_only_where_the_list_pays_exactly_it(tmp_path):
    """Time counts for whoever we stop, and the platform pays a screen-out by itself."""
    amounts = {"withdrew": 1, "stopped_by_us": 2, "failed_questions": 3, "no_consent": 0.2}
    paid = {"currency": "GBP", "hourly_rate": 9, "outcomes": amounts, "screen_out": "no_consent"}
    study = for_prolific(tmp_path, payment=paid)
    texts = {Outcome.FINISHED: "C1DONE"}
    shown = {
        outcome: ending(study.protocol, texts, Outcome(outcome), {}, None) for outcome in amounts
    }
    back = "Please return your submission on Prolific."
    assert {outcome: end.sentence for outcome, end in shown.items()} == {
        "withdrew": f"{back} You get 1.00 GBP as a bonus.", "stopped_by_us": back,
        "failed_questions": f"{back} You get 3.00 GBP as a bonus.", "no_consent": back,
    }  # fmt: skip


@pytest.mark.parametrize("outcome", ["no_consent", "unfit_device"])
def test_nobody_is_promised_an_amount_who_leaves_no_id(outcome):
    with pytest.raises(ValueError, match=f"outcomes pays for {outcome}, but nothing is stored"):
        Payment(currency="GBP", outcomes={outcome: 0.2})
    assert Payment(currency="GBP", outcomes={outcome: 0.2}, screen_out=outcome)


def test_whoever_has_finished_is_never_asked_to_return_their_submission(serve, tmp_path, capsys):
    for_prolific(tmp_path)
    server = serve()
    person = Person(server, outside_ids=FROM_PROLIFIC)
    person.to_warm_up()
    person.play_on()
    database = "--yes", "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--now", *database)[0] == 0
    assert command(capsys, "study", "unlink", "small", *database)[0] == 0
    nothing = {"code": None, "address": None, "sentence": None}
    assert person.me()["ending"] == {"outcome": "finished", **nothing}
