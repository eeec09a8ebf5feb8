"""Blocks of questions: where they are asked, what is refused and stored."""

import sqlite3
from contextlib import closing

import pytest

from humanplay.db.erasure import forget
from humanplay.study.protocol import StudyError, default_protocol
from humanplay.study.shipped_questions import BLOCKS
from marsexplorer.config import EnvConfig
from tests.support.command import command
from tests.support.study import SIZE, Person, freeze

ALL_KINDS = [
    {"kind": "choice", "name": "hand", "question": "Which hand?", "needed": True, "choices": ["left", "right"]},
    {"kind": "choice", "name": "colour", "question": "Which colour?", "ordered": False, "choices": list("abcdefgh")},
    {"kind": "several", "name": "devices", "question": "Which devices?", "choices": ["phone", "pad", "watch"]},
    {"kind": "likert", "name": "mood", "question": "How much?", "needed": True, "rows": ["calm", "awake"],
      "points": ["no", "so so", "yes"]},
    {"kind": "scale", "name": "load", "question": "How hard?", "steps": 21, "low": "not", "high": "very"},
    {"kind": "number", "name": "hours", "question": "How long?", "minimum": 1, "maximum": 24, "unit": "hours"},
    {"kind": "text", "name": "town", "question": "Where?", "max_length": 20},
    {"kind": "text", "name": "story", "question": "Why?", "needed": True, "long": True},
    {"kind": "statement", "name": "honest", "question": "I answered honestly.", "needed": True},
    {"kind": "attention", "name": "look", "question": "Choose the second.", "choices": ["one", "two"], "answer": 1},
]  # fmt: skip
FULL = {
    "hand": 0, "colour": 3, "devices": [2, 0], "mood": [2, 0], "load": 10, "hours": 3, "town": " Bath ", "story": None,
    "honest": True, "look": 0,
}  # fmt: skip


def block(name="about", at="before", questions=ALL_KINDS, **rest):
    return {"name": name, "at": at, "title": name, "about": name, "questions": questions, **rest}


def ask(name, **rest):
    """A choice in a block of its own."""
    question = {"kind": "choice", "name": f"{name}_q", "question": "Yes?", "choices": ["no", "yes"]}
    return block(name, questions=[question], **rest)


def only(question, answer):
    """The condition that a question was answered so."""
    return {"question": question, "answers": [answer]}


def rows(database, sql):
    with closing(sqlite3.connect(database)) as conn:
        return conn.execute(sql).fetchall()


@pytest.fixture
def database(tmp_path):
    return tmp_path / "playground.db"


@pytest.fixture
def asking(serve, database):
    """`asking(*blocks)` serves a study with blocks, and returns a new participant."""

    def make(*blocks, **rest):
        freeze(f"{database}-studies", blocks=blocks, **rest)
        return Person(serve())

    return make


def agree(person):
    person.call("consent", {"version": "1", "agree": True})


def test_a_synthetic_player_answers_a_fraction_and_a_short_text(asking):
    share = {"kind": "number", "name": "share", "question": "Which share?", "maximum": 0.5}
    initials = {"kind": "text", "name": "initials", "question": "Initials?", "max_length": 2}
    questions = [{**share, "minimum": 0.25, "whole": False}, initials]
    person = asking(block("first", questions=questions))
    agree(person)
    person.answer_block()
    assert person.where["block"] is None


def test_a_block_stands_at_each_place_and_nothing_goes_on_before_it_is_answered(asking):
    person = asking(
        ask("last", at="after"),
        ask("sets", at="between_sets"),
        ask("first", at="before"),
        ask("warm", at="after_warm_up"),
    )
    assert person.where["block"] is None
    agree(person)
    seen = []

    def answer(stage):
        seen.append(
            (person.where["stage"], person.where["block"]["name"], person.where["block"]["turn"])
        )
        assert person.where["stage"] == stage
        assert "come first" in person.refused(*stage_step[stage])
        person.answer_block()

    stage_step = {
        "instructions": ("advance", {"from": "instructions"}),
        "ranked": ("next",),
        "debrief": ("advance", {"from": "debrief"}),
    }
    while person.where["stage"] != "complete":
        if person.me()["block"]:
            answer(person.where["stage"])
        else:
            person.take_step()
    assert seen == [
        ("instructions", "first", 0),
        ("ranked", "warm", 0),
        ("ranked", "sets", 2),
        ("debrief", "last", 0),
    ]


def test_scores_wait_for_the_last_questions_and_skipping_leads_to_the_code(asking, database):
    person = asking(ask("one", at="after"), ask("two", at="after"))
    person.to_warm_up()
    person.play_on()
    state = person.me()
    assert (state["stage"], state["block"]["name"], state["debrief"]) == ("debrief", "one", None)
    assert state["about"]["frame"]["score"] is None
    assert person.client.get(f"{person.url}/debrief/0").status_code == 409
    # finished already, whatever becomes of the questions
    assert rows(database, "SELECT completed_ms IS NOT NULL FROM participants") == [(1,)]
    assert state["ending"]["outcome"] == "finished"
    person.call("skip", {"block": "one", "turn": 0})
    assert (person.where["block"], len(person.where["debrief"]["episodes"])) == (None, 3)
    person.call("advance", {"from": "debrief"})
    assert len(person.where["ending"]["code"]) == 8
    assert rows(database, "SELECT count(*) FROM answers") == [(0,)]


def test_other_blocks_cannot_be_skipped(asking):
    person = asking(ask("first", at="before"))
    agree(person)
    assert "cannot be skipped" in person.refused("skip", {"block": "first", "turn": 0})
    assert "are asked now" in person.refused("block", {"block": "other", "turn": 0, "answers": {}})
    assert person.where["block"]["can_be_skipped"] is False


def test_every_kind_is_stored_as_numbers_or_as_text(asking, database):
    person = asking(block())
    agree(person)
    shown = {question["name"]: question for question in person.where["block"]["questions"]}
    person.call("block", {"block": "about", "turn": 0, "answers": FULL})
    stored = rows(database, "SELECT question, part, answer, place FROM answers ORDER BY 1, 2")
    place = [question["value"] for question in shown["colour"]["choices"]].index(3)
    assert stored == [
        ("colour", 0, 3.0, place),
        ("devices", 0, 1.0, 0),
        ("devices", 1, 0.0, 1),
        ("devices", 2, 1.0, 2),
        ("hand", 0, 0.0, 0),
        ("honest", 0, 1.0, None),
        ("hours", 0, 3.0, None),
        ("load", 0, 10.0, None),
        ("look", 0, 0.0, 0),
        ("mood", 0, 2.0, None),
        ("mood", 1, 0.0, None),
    ]
    assert rows(database, "SELECT question, words FROM free_texts ORDER BY 1") == [
        ("story", None),
        ("town", "Bath"),
    ]
    detail = rows(database, "SELECT detail FROM stage_events WHERE kind = 'block'")
    assert detail == [('{"block": "about", "missed": 1, "skipped": false, "turn": 0}',)]


def test_the_browser_sees_no_right_answer_and_no_rule(asking):
    hidden = only("hand", 1)
    person = asking(block(), ask("more", at="before", shown_if=hidden))
    agree(person)
    text = str(person.where)
    assert "attention" not in text
    assert "shown_if" not in text
    assert "'answer'" not in text
    kinds = {question["name"]: question["kind"] for question in person.where["block"]["questions"]}
    assert kinds["look"] == kinds["hand"] == "choice"


def test_orders_are_drawn_for_unordered_choices_alone(asking):
    first = asking(block())
    orders = set()
    for person in [first, *(Person(first.server) for _ in range(4))]:
        agree(person)
        shown = {question["name"]: question for question in person.where["block"]["questions"]}
        values = {
            name: tuple(question["value"] for question in one["choices"] or ())
            for name, one in shown.items()
        }
        orders.add(values["colour"])
        assert (values["hand"], values["devices"]) == ((0, 1), (0, 1, 2))
        again = {question["name"]: question for question in person.me()["block"]["questions"]}
        assert again["colour"] == shown["colour"]
    assert len(orders) > 1


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"hand": 2}, "hand must be 0 to 1, the index of a choice, got 2"),
        ({"hand": True}, "hand must be 0 to 1"),
        ({"hand": ...}, "hand needs an answer, or prefer not to say"),
        ({"devices": [1, 1]}, "devices must be a list of different indices"),
        ({"devices": None}, "devices can be left out, and not be declined"),
        ({"mood": [1]}, "mood must be a point from 0 to 2, or null, for each of 2 rows"),
        ({"mood": [1, None]}, "mood needs a point in every row"),
        ({"load": 21}, "load must be a step, 0 to 20, got 21"),
        ({"hours": 2.5}, "hours must be a whole number from 1 to 24, got 2.5"),
        ({"hours": 10**400}, "hours must be a whole number"),
        ({"town": "x" * 21}, "town must be a text of at most 20 characters"),
        ({"town": "  "}, "town must be a text"),
        ({"honest": False}, "honest must be true"),
        ({"strange": 1}, "no question 'strange'"),
    ],
)  # fmt: skip
def test_an_answer_that_is_none_is_refused_with_a_sentence(asking, database, change, sentence):
    person = asking(block())
    agree(person)
    answers = {name: sent for name, sent in {**FULL, **change}.items() if sent is not ...}
    body = {"block": "about", "turn": 0, "answers": answers}
    assert sentence in person.refused("block", body, 422)
    assert rows(database, "SELECT count(*) FROM answers") == [(0,)]


def test_whoever_prefers_not_to_say_has_answered(asking, database):
    person = asking(block())
    agree(person)
    declined = dict.fromkeys(("hand", "mood", "load", "story", "honest"))
    person.call("block", {"block": "about", "turn": 0, "answers": declined})
    assert person.where["block"] is None
    stored = rows(database, "SELECT question, part, answer FROM answers ORDER BY 1, 2")
    assert stored == [
        ("hand", 0, None),
        ("honest", 0, None),
        ("load", 0, None),
        ("mood", 0, None),
        ("mood", 1, None),
    ]


def test_a_block_is_shown_by_one_earlier_answer(asking):
    condition = only("first_q", 1)
    first = asking(ask("first", at="before"), ask("more", at="before", shown_if=condition))
    for answer, then in ((1, "more"), (0, None), (None, None)):
        person = first if answer == 1 else Person(first.server)
        agree(person)
        person.call("block", {"block": "first", "turn": 0, "answers": {"first_q": answer}})
        following = person.where["block"]
        assert (following and following["name"]) == then


@pytest.mark.parametrize(
    ("blocks", "sentence"),
    [
        ([ask("a", at="before"), ask("a", at="after")], "no two blocks can be called 'a'"),
        ([block("a"), block("b")], "no two questions can be called"),
        ([ask("a", at="before", shown_if=only("b_q", 1)), ask("b", at="after")], "no choice of a block before"),
        ([ask("a", at="before"), ask("b", at="after", shown_if=only("a_q", 2))], "answers 0 to 1 of 'a_q', got 2"),
        ([ask("a", at="sometimes")], "at"),
        (["nasa"], "no block is shipped as 'nasa'"),
    ],
)  # fmt: skip
def test_a_protocol_with_blocks_that_do_not_fit_is_refused(blocks, sentence):
    with pytest.raises(StudyError, match=sentence):
        default_protocol("x", EnvConfig.of("random", SIZE), blocks=blocks)


def test_shipped_blocks_are_taken_by_name_and_a_program_answers_them(asking, database):
    person = asking(*BLOCKS)
    while person.me()["stage"] != "complete":
        person.take_step()
    done = rows(
        database,
        "SELECT json_extract(detail, '$.block') FROM stage_events WHERE kind = 'block' ORDER BY number",
    )
    assert [name for (name,) in done] == [
        "demographics",
        "experience",
        "exposure",
        "tools",
        "nasa_tlx",
        "remark",
    ]
    loads = rows(
        database, "SELECT count(*), max(answer) <= 20 FROM answers WHERE block = 'nasa_tlx'"
    )
    assert loads == [(6, 1)]


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE answers SET answer = 1 WHERE question = 'hand'",
        "UPDATE free_texts SET words = 'York'",
        "DELETE FROM answers WHERE question = 'hand'",
        "DELETE FROM free_texts",
    ],
)  # fmt: skip
def test_an_answer_that_is_changed_in_the_database_no_longer_fits_the_chain(
    asking, database, capsys, change
):
    person = asking(block())
    agree(person)
    person.call("block", {"block": "about", "turn": 0, "answers": FULL})
    person.server.stop()
    assert command(capsys, "verify", "--database", database)[0] == 0
    with closing(sqlite3.connect(database)) as conn, conn:
        conn.execute(change)
    code, out, err = command(capsys, "verify", "--database", database)
    assert code == 1
    assert "participant" in out + err


@pytest.mark.parametrize("keeps", [False, True])
def test_answers_go_when_somebody_is_erased_also_where_episodes_are_kept(
    asking, database, keeps, capsys
):
    person = asking(block(), keep_episodes_when_forgotten=keeps)
    agree(person)
    person.call("block", {"block": "about", "turn": 0, "answers": {**FULL, "story": "Xylophone"}})
    label = person.where["participant"]
    person.server.stop()
    forget(database, label)
    for table in ("answers", "free_texts"):
        assert rows(database, f"SELECT count(*) FROM {table}") == [(0,)]
    assert b"Xylophone" not in database.read_bytes()
    assert command(capsys, "verify", "--database", database)[0] == 0
