"""A practice that must be passed: page, payments, report and verification agree."""

from contextlib import closing

import pytest

from humanplay.db.reader import Reader
from humanplay.report.build import build
from humanplay.study.data import load
from humanplay.study.exclusion_rules import EXCLUSION, PER_PROTOCOL
from humanplay.study.folder import Folder
from humanplay.study.payments import payments_of
from humanplay.study.protocol import StudyError
from humanplay.study.verification import verify_database
from humanplay.web.simulate import Plan, simulate
from tests.support.command import command
from tests.support.study import Person, freeze

TWICE = {"episodes_to_pass": 2, "tries": 2}
PASSED = {**EXCLUSION[PER_PROTOCOL], "passed_practice": True}
GO_ON = {
    "practice": {"episodes_to_pass": 1, "tries": 1, "if_failed": "go_on"},
    "exclusion": {"protocol": PASSED},
}


def practising(server):
    """Somebody at the beginning of the warm-up."""
    person = Person(server)
    person.to_warm_up()
    return person


def gives_up(person, episodes=2):
    """Somebody gives up their next episodes."""
    for _ in range(episodes):
        person.call("next")
        person.call("give-up", {"episode": person.frame["episode"], "step": 0})
    return person.me()


def closed(tmp_path, capsys):
    """The data of the study, once it is closed."""
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    data = load(tmp_path / "playground.db", "small")
    study = Folder(tmp_path / "playground.db-studies").study("small")
    assert (
        verify_database(tmp_path / "playground.db", secrets={"small": study.secret}).findings == ()
    )
    return data


def test_whoever_fails_every_try_at_the_practice_does_not_go_on_and_everybody_says_so(
    serve, tmp_path, capsys
):
    texts = {"failed_practice": "C5PRACTICE"}
    paid = {"currency": "GBP", "base": 3, "outcomes": {"failed_practice": 1.5}}
    screening = {"practice": TWICE, "question_tries": 3}
    freeze(tmp_path / "playground.db-studies", **screening, outcomes=texts, payment=paid)
    server = serve()
    failing, second, first = (practising(server) for _ in range(3))
    assert failing.where["practice"]["text"] == (
        "You pass the practice if all of its 2 terrains end as “reached 99 %”. You have 2 tries, each on other terrains; if "
        "you fail, the study ends for you."
    )
    for person in (failing, second):
        standing = gives_up(person)
        assert (standing["stage"], standing["warm_up"]) == ("warm_up", {"done": 0, "of": 2})
        assert (standing["practice"]["number"], standing["practice"]["tries"]) == (2, 2)
    standing = gives_up(failing)
    assert (standing["stage"], standing["ending"]["outcome"]) == ("withdrawn", "failed_practice")
    assert standing["ending"]["code"] == "C5PRACTICE"
    assert standing["note"].startswith(
        "The practice was not passed in the tries that this study allows"
    )
    assert "nothing has changed" in failing.refused("next")
    for person in (second, first):
        person.play_on()
    assert second.where["debrief"]["warm_up_terrains"] == 2
    data = closed(tmp_path, capsys)
    study = Folder(tmp_path / "playground.db-studies").study("small")
    with closing(Reader.open(tmp_path / "playground.db")) as reader:
        payees = {payee.label: payee for payee in payments_of(reader, study, texts).payees}
    failed = payees[failing.where["participant"]]
    assert (failed.outcome, failed.code, str(failed.amount)) == (
        "failed_practice",
        "C5PRACTICE",
        "1.5",
    )
    report = build(data)
    assert (
        ", of people who passed the practice (2 of 3). Per protocol: 2 players" in report.sentence
    )
    (group,) = report.groups
    assert {row.status: row.people for row in group.statuses} == {
        "finished": 2,
        "failed_practice": 1,
    }
    assert (
        "1 of 3 people who agreed is in neither estimate: 1 began no ranked episode (failed the practice: 1), 0 played as "
        "bots throughout." in group.cautions
    )
    items = {item.number: item for item in report.checklist}
    assert "before the warm-up, in at most 3 attempts; criteria" in items["2.3"].detail
    assert items["2.3"].detail.endswith(
        f" Participants read: “{failing.where['practice']['text']}”"
    )
    assert items["2.3.2"].answer == "1 of 3"
    assert "0 failed the questions on the instructions, 1 failed the practice." in (
        items["2.3.2"].detail
    )


def test_who_fails_may_go_on_and_is_then_left_out_per_protocol_alone(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies", **GO_ON)
    server = serve()
    failing, passing = practising(server), practising(server)
    assert gives_up(failing)["stage"] == "ranked"
    assert failing.where["practice"]["text"].endswith(
        "You have 1 try; if you fail, you go on all the same."
    )
    for person in (failing, passing):
        person.play_on()
    report = build(closed(tmp_path, capsys))
    assert "Per protocol, of people who passed the practice (1 of 2): 1 player, " in report.sentence
    assert "Everybody who began: 2 players, " in report.sentence
    assert {row.status: row.people for row in report.groups[0].statuses} == {
        "finished": 1,
        "excluded": 1,
    }


def test_an_episode_may_have_to_come_to_a_score(serve, tmp_path):
    practice = {"episodes_to_pass": 1, "tries": 1, "score": 2}
    freeze(tmp_path / "playground.db-studies", practice=practice)
    person = practising(serve())
    assert "at least 1 of its 2 terrains scores 2 or more" in person.where["practice"]["text"]
    person.play_on(until=("withdrawn",))
    assert person.where["ending"]["outcome"] == "failed_practice"


def test_a_study_in_which_nobody_passed_has_no_figure_and_says_so(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies", practice={"episodes_to_pass": 1, "tries": 1})
    gives_up(practising(serve()))
    sentence = build(closed(tmp_path, capsys)).sentence
    assert sentence == (
        "0 of 1 person passed the practice, and nobody began a ranked episode: there is no human score."
    )


def test_synthetic_participants_are_screened_out_as_people_are(server, tmp_path):
    study = freeze(
        tmp_path / "playground.db-studies", practice={"episodes_to_pass": 1, "score": 2, "tries": 2}
    )
    summaries = []
    simulate(Plan(server.url, study.name, 1, speed=1e6), summaries)
    assert [(summary.stage, summary.ranked) for summary in summaries] == [("withdrawn", 0)]


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        (
            {"practice": {"episodes_to_pass": 3}},
            "practice.episodes_to_pass must be at most warm_up, 2, got 3",
        ),
        (
            {"practice": {"episodes_to_pass": 1, "if_failed": "go_on"}},
            "neither flags nor an exclusion set has the rule",
        ),
        ({"exclusion": {"protocol": PASSED}}, "there is no practice to pass"),
    ],
)
def test_a_practice_that_means_nothing_is_refused(tmp_path, fields, sentence):
    with pytest.raises(StudyError, match=sentence):
        freeze(tmp_path, **fields)
