"""Quality rules fixed beforehand: who is left out, who is flagged, what is seen."""

import pytest

from humanplay.report.build import build
from humanplay.report.page import render
from humanplay.study.data import load
from humanplay.study.exclusion_rules import EXCLUSION, PER_PROTOCOL
from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError, default_protocol
from humanplay.study.screening import screening_cautions
from marsexplorer.config import EnvConfig
from tests.support.command import command
from tests.support.recorded import alter
from tests.support.servers import eventually
from tests.support.study import Person, freeze

LEAST = {**EXCLUSION[PER_PROTOCOL], "min_minutes": 20}
FLAGS = {"max_minutes": 90, "max_given_up_share": 0.4}
PASSWORD = "a password of the operator"


def finishes(server, minutes, gives_up=0):
    """Somebody who takes so many minutes from consent to the last ranked episode."""
    person = Person(server)
    person.to_warm_up()
    person.play_on(until=("ranked",))
    for _ in range(gives_up):
        person.call("next")
        person.call("give-up", {"episode": person.frame["episode"], "step": 0})
    person.play_on()
    newest = "SELECT max(completed_ms) FROM participants"
    earlier = f"UPDATE participants SET consent_ms = completed_ms - {60_000 * minutes}"
    assert alter(server.services.store.path, f"{earlier} WHERE completed_ms = ({newest})") == 1
    return person.where["participant"]


@pytest.fixture
def played(serve, tmp_path):
    """A server and three people: too fast, as asked, and too slow."""
    freeze(tmp_path / "playground.db-studies", exclusion={PER_PROTOCOL: LEAST}, flags=FLAGS)
    server = serve(admin_password=PASSWORD)
    labels = finishes(server, 10), finishes(server, 30), finishes(server, 100, gives_up=1)
    return server, labels


def test_minutes_take_out_of_the_estimate_and_flags_leave_nobody_out(played, tmp_path, capsys):
    server, _ = played
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    server.stop()
    report = build(load(tmp_path / "playground.db", "small"))
    (group,) = report.groups
    assert (group.figure.players, group.everybody.players) == (2, 3)
    assert "took at least 20 minutes in all" in group.figure.rule
    assert {row.status: row.people for row in group.statuses} == {"finished": 2, "excluded": 1}
    assert group.flags == {
        "took at most 90 minutes in all": 1,
        "gave up at most 40 % of the ranked episodes": 0,
    }
    flags = "gave up at most 40 % of the ranked episodes 0, took at most 90 minutes in all 1."
    assert (
        f"so many do not keep to a data-quality rule that was fixed beforehand: {flags}"
        in render(report)
    )


def test_the_operator_of_an_open_study_sees_flags_of_people_and_nothing_of_an_episode(played):
    server, (fast, _, slow) = played
    report = build(load(server.services.store.path, "small"))
    assert report.groups[0].flags == {}
    assert "data-quality rule" not in render(report)
    client = server.client(headers={"Origin": server.url})
    assert client.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    url = "/api/admin/studies/small"
    study = eventually(lambda: (now := client.get(url).json())["figure"] and now)
    labels = {label["label"]: label["participants"] for label in study["labels"]}
    assert labels["not so: took at least 20 minutes in all"] == [fast]
    assert labels["not so: took at most 90 minutes in all"] == [slow]
    assert not any("gave up" in label for label in labels)
    episodes = {label["label"]: label["episodes"] for label in study["labels"]}
    assert episodes["no attempt"] == 3, "the tutorials, and not the ranked episode"
    people = {person["label"]: person for person in study["participants"]}
    assert people[fast]["connections"] >= 1
    hidden = {"ranked": None, "mean_score": None, "mean_steps": None, "outcomes": {}}
    assert {name: people[slow][name] for name in hidden} == hidden


@pytest.mark.parametrize("rules", ["flags", "exclusion"])
def test_a_rule_reads_by_what_people_made_their_moves(serve, tmp_path, capsys, rules):
    by_key = {**EXCLUSION[PER_PROTOCOL], "max_touch_share": 0.25}
    fixed = {"flags": {"max_touch_share": 0.25}, "exclusion": {PER_PROTOCOL: by_key}}
    freeze(tmp_path / "playground.db-studies", **{rules: fixed[rules]})
    server = serve()
    for ways in (("key", "key"), ("touch", "key"), ("touch", "touch")):
        person = Person(server)
        person.to_warm_up()
        person.play_on(until=("ranked",), input="touch")
        for way in ways:
            person.call("next")
            person.play(input=way)
        person.play_on(input="key")
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    server.stop()
    (group,) = build(load(tmp_path / "playground.db", "small")).groups
    words = "in no ranked episode more than 25 % of the moves were made by touch"
    if rules == "flags":
        assert (group.figure.players, group.flags) == (3, {words: 2})
    else:
        assert (group.figure.players, group.everybody.players) == (1, 3)
        assert words in group.figure.rule


@pytest.mark.parametrize(
    ("flags", "sentence"),
    [
        ({"min_minutes": 9, "max_minutes": 9}, "min_minutes must be at least 0 and below"),
        ({"max_minutes": True}, "the rule max_minutes takes a number, got True"),
        ({"max_given_up_share": False}, "the rule max_given_up_share takes a number, got False"),
        ({"no_labels": 1}, "the rule no_labels takes true or false, got 1"),
        ({"max_pause_share": 1.5}, "the rule max_pause_share takes a share, 0 to 1, got 1.5"),
        ({"max_touch_share": 2}, "the rule max_touch_share takes a share, 0 to 1, got 2"),
    ],
)
def test_a_rule_without_a_bound_of_its_kind_is_refused(tmp_path, flags, sentence):
    for rules in ({"flags": flags}, {"exclusion": {"some": flags}}):
        with pytest.raises(StudyError, match=sentence):
            freeze(tmp_path, **rules)


@pytest.mark.parametrize(
    ("outcome", "amount", "sentences"),
    [
        ("unfit_device", 0.1, []),
        ("unfit_device", 0.05, ["gets 0.05 GBP, and Prolific asks for at least 0.10"]),
        ("failed_questions", 0.5, []),
        ("failed_practice", 0.5, ["can come after 28 of about 39 minutes"]),
        ("withdrew", 0.05, ["can come after 39 of about 39 minutes", "gets 0.05 GBP"]),
    ],
)
def test_a_screen_out_that_comes_late_or_is_paid_too_little_is_warned_of(
    tmp_path, capsys, outcome, amount, sentences
):
    paid = {"currency": "GBP", "outcomes": {outcome: amount}, "screen_out": outcome}
    folder = Folder(tmp_path / "playground.db-studies")
    folder.create(
        default_protocol(
            "pilot",
            EnvConfig.of("random", 21),
            platform="prolific",
            recruitment="panel",
            practice={"episodes_to_pass": 10},
            device="computer",
            question_tries=2,
            payment=paid,
        )
    )
    database = "--database", tmp_path / "playground.db"
    code, text, _ = command(capsys, "study", "check", "pilot", *database)
    cautions = [line for line in text.splitlines() if line.startswith("Caution: ")]
    assert (code, len(cautions)) == (0, len(sentences)), text
    for caution, sentence in zip(cautions, sentences, strict=True):
        assert sentence in caution
    assert "To write below [declarations]" in text


@pytest.mark.parametrize(
    ("outcome", "fields"),
    [
        ("unfit_device", {}),
        ("failed_questions", {}),
        ("failed_practice", {}),
        ("failed_practice", {"practice": {"episodes_to_pass": 1, "if_failed": "go_on"}, "flags": {"passed_practice": True}}),
    ],
)  # fmt: skip
def test_a_screen_out_that_nobody_comes_to_is_warned_of(tmp_path, outcome, fields):
    paid = {"currency": "GBP", "outcomes": {outcome: 0.01}, "screen_out": outcome}
    protocol = default_protocol("pilot", EnvConfig.of("random", 21), payment=paid, **fields)
    (caution,) = screening_cautions(protocol)
    assert f"lets nobody come to the paid screen-out {outcome} " in caution
