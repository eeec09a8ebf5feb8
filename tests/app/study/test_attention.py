"""Attention checks: who is screened out, left out or flagged."""

import json

import pytest

from humanplay.report.build import build
from humanplay.report.preregistration import preregistration
from humanplay.study.data import load
from humanplay.study.exclusion_rules import EXCLUSION, PER_PROTOCOL
from humanplay.study.protocol import StudyError
from humanplay.study.verification import verify_database
from tests.app.study.test_questions import block
from tests.support.command import command
from tests.support.recorded import alter
from tests.support.study import Person, freeze

WHY = "The sentence asked for the second one."
RIGHT, WRONG = 1, 0


def check(name, at, needed=True):
    """A block with an attention check, and a question that has no right answer."""
    asked = {"question": "Choose the second one.", "choices": ["first", "second", "third"]}
    attention = {
        "kind": "attention",
        "name": name,
        "answer": RIGHT,
        "why": WHY,
        "needed": needed,
        **asked,
    }
    number = {"kind": "number", "name": f"{name}_age", "question": "Age?", "maximum": 99}
    return block(f"{name}_block", at=at, questions=[attention, number])


BLOCKS = [check("early", "before"), check("later", "after_warm_up"), check("last", "after")]
LIMIT = {"blocks": BLOCKS, "attention_limit": 1}
LEFT_OUT = {PER_PROTOCOL: {**EXCLUSION[PER_PROTOCOL], "max_missed_checks": 1}}


def answer(person, name, chosen):
    person.call("block", {"block": f"{name}_block", "turn": 0, "answers": {name: chosen}})


def plays(server, early, later=RIGHT, last=RIGHT):
    """Somebody who answers the checks so, and goes as far as they may."""
    person = Person(server)
    person.call("consent", {"version": "1", "agree": True})
    answer(person, "early", early)
    person.call("advance", {"from": "instructions"})
    person.call("next")
    person.call("give-up", {"episode": person.frame["episode"], "step": 0})
    person.call("advance", {"from": "tutorial"})
    person.answer_questions()
    person.play_on(until=("ranked",))
    answer(person, "later", later)
    if person.me()["stage"] == "ranked":
        person.play_on()
        answer(person, "last", last)
    return person


def close(server, tmp_path, capsys):
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    server.stop()
    return load(tmp_path / "playground.db", "small")


def test_who_misses_too_many_checks_before_the_ranked_episodes_is_screened_out(
    serve, tmp_path, capsys
):
    texts = {"failed_attention": "C6ATTENTION"}
    freeze(tmp_path / "playground.db-studies", outcomes=texts, **LIMIT)
    server = serve()
    first, second, once = (
        plays(server, early, later) for early, later in ((0, 2), (0, None), (0, 1))
    )
    for person in (first, second):
        assert person.where["stage"] == "withdrawn"
        assert person.where["ending"]["outcome"] == "failed_attention"
        assert person.where["ending"]["code"] == "C6ATTENTION"
        assert person.where["note"].startswith("Some questions were there to see whether they are")
    assert once.where["stage"] == "debrief"
    report = build(close(server, tmp_path, capsys))
    (group,) = report.groups
    who = "of people who missed at most 1 attention check before the ranked episodes (1 began, 2 screened out)."
    assert who in report.sentence
    statuses = {row.status: row.people for row in group.statuses}
    assert statuses == {"finished": 1, "failed_attention": 2}
    items = {item.number: item for item in report.checklist}
    assert items["2.3.2"].answer == "2 of 3"
    assert "2 missed too many attention checks" in items["2.3.2"].detail
    assert "missed too many attention checks: 2" in " ".join(group.cautions)


def test_later_misses_take_out_of_the_estimate_or_flag_and_a_release_without_answers_knows(
    serve, tmp_path, capsys
):
    rules = {"exclusion": LEFT_OUT, "flags": {"max_missed_checks": 0}}
    freeze(tmp_path / "playground.db-studies", blocks=BLOCKS, **rules)
    server = serve()
    people = [plays(server, *chosen) for chosen in ((1, 1, 1), (1, 1, 0), (0, 1, None))]
    assert {person.where["stage"] for person in people} == {"debrief"}
    (group,) = build(close(server, tmp_path, capsys)).groups
    assert {row.status: row.people for row in group.statuses} == {"finished": 2, "excluded": 1}
    assert "missed at most 1 attention check" in group.figure.rule
    assert group.flags == {"missed no attention check": 2}
    bundle, database = tmp_path / "bundle", tmp_path / "playground.db"
    how = "--study", "small", "--out", bundle, "--database", database
    assert command(capsys, "release", *how)[0] == 0
    assert (bundle / "csv" / "answers.csv").read_text().count("\n") == 1
    code, text, error = command(capsys, "reproduce", bundle)
    assert (code, text.splitlines()[-1].endswith(" compared, 0 differ")) == (0, True), text + error
    (released,) = build(load(bundle / "study.sqlite", "small")).groups
    assert released.flags == group.flags


def test_a_check_that_is_left_out_or_skipped_is_missed(serve, tmp_path, capsys):
    flags = {"max_missed_checks": 0}
    blocks = [check("early", "before", needed=False), check("last", "after", needed=False)]
    freeze(tmp_path / "playground.db-studies", blocks=blocks, flags=flags, warm_up=0)
    server = serve()
    for leaves_out in ("early", "last", None):
        person = Person(server)
        person.call("consent", {"version": "1", "agree": True})
        early = {} if leaves_out == "early" else {"early": RIGHT}
        person.call("block", {"block": "early_block", "turn": 0, "answers": early})
        person.call("advance", {"from": "instructions"})
        person.call("next")
        person.call("give-up", {"episode": person.frame["episode"], "step": 0})
        person.call("advance", {"from": "tutorial"})
        person.answer_questions()
        person.play_on()
        if leaves_out == "last":
            person.call("skip", {"block": "last_block", "turn": 0})
        else:
            answer(person, "last", RIGHT)
    (group,) = build(close(server, tmp_path, capsys)).groups
    assert group.flags == {"missed no attention check": 2}


def test_check_cautions_against_an_attention_check_that_no_rule_reads(tmp_path, capsys):
    def cautions(**fields):
        name = f"study-{len(list(tmp_path.glob('playground.db-studies/*')))}"
        freeze(tmp_path / "playground.db-studies", name, blocks=BLOCKS, **fields)
        database = "--database", tmp_path / "playground.db"
        code, text, error = command(capsys, "study", "check", name, *database)
        assert code == 0, error
        return text

    assert "3 attention checks are read by no rule" in cautions()
    assert "1 attention check is read by no rule" in cautions(attention_limit=1)
    assert "read by no rule" not in cautions(attention_limit=1, exclusion=LEFT_OUT)


def test_verify_counts_missed_checks_again_from_the_answers(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", **LIMIT)
    server = serve()
    for early, later in ((0, 1), (1, 1)):
        plays(server, early, later)
    server.stop()
    path, secrets = tmp_path / "playground.db", {study.name: study.secret}
    assert verify_database(path, secrets=secrets).findings == ()
    alter(path, "UPDATE answers SET answer = 2 WHERE question = 'early' AND answer = 1")
    whats = [finding.what for finding in verify_database(path, secrets=secrets).findings]
    assert whats.count("missed attention checks in early_block") == 1


def test_verify_counts_the_checks_of_a_skipped_block_without_any_answer(serve, tmp_path):
    blocks = [check("last", "after", needed=False)]
    study = freeze(tmp_path / "playground.db-studies", blocks=blocks, warm_up=0)
    server = serve()
    person = Person(server)
    person.call("consent", {"version": "1", "agree": True})
    person.call("advance", {"from": "instructions"})
    person.call("next")
    person.call("give-up", {"episode": person.frame["episode"], "step": 0})
    person.call("advance", {"from": "tutorial"})
    person.answer_questions()
    person.play_on()
    person.call("skip", {"block": "last_block", "turn": 0})
    server.stop()
    path, secrets = tmp_path / "playground.db", {study.name: study.secret}
    assert verify_database(path, secrets=secrets).findings == ()
    skipped = "json_extract(detail, '$.skipped')"
    alter(path, f"UPDATE stage_events SET detail = json_set(detail, '$.missed', 0) WHERE {skipped}")
    whats = [finding.what for finding in verify_database(path, secrets=secrets).findings]
    assert whats.count("missed attention checks in last_block") == 1


def test_a_page_gets_neither_the_right_answer_nor_that_it_is_a_check(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", **LIMIT)
    person = Person(serve())
    person.call("consent", {"version": "1", "agree": True})
    (shown,) = [asked for asked in person.me()["block"]["questions"] if asked["name"] == "early"]
    assert shown["kind"] == "choice"
    assert not {"answer", "why", "missed"} & shown.keys()
    text = json.dumps(person.me())
    assert WHY not in text
    assert "attention" not in text


def test_the_preregistration_says_what_checks_do(tmp_path):
    study = freeze(tmp_path, exclusion=LEFT_OUT, **LIMIT)
    text = preregistration(study.protocol, study)
    assert "misses more than 1 attention check before the first ranked episode is screened" in text
    assert "missed at most 1 attention check" in text


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"attention_limit": 0}, "attention_limit is 0, but only 0 attention checks can be missed"),
        ({"blocks": BLOCKS, "attention_limit": 2}, "limit is 2, but only 2 attention checks can be missed"),
        ({"flags": {"max_missed_checks": 0}}, "no block has an attention check"),
        ({"blocks": BLOCKS, "flags": {"max_missed_checks": 0.5}}, "a whole number from 0, got 0.5"),
        ({"blocks": BLOCKS, "flags": {"max_missed_checks": -1}}, "a whole number from 0, got -1"),
    ],
)  # fmt: skip
def test_a_rule_on_checks_that_nobody_can_miss_is_refused(tmp_path, fields, sentence):
    with pytest.raises(StudyError, match=sentence):
        freeze(tmp_path, **fields)
