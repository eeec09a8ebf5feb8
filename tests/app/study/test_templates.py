"""A frozen text has the protocol's own numbers, and no number is written by hand."""

import json

import pytest

from humanplay.study.folder import Folder
from humanplay.study.protocol import StudyError, default_protocol, parse_protocol
from humanplay.study.templates import PLACEHOLDERS, fill, placeholder_values
from marsexplorer.config import EnvConfig
from tests.support.declared import DECLARATIONS
from tests.support.drafts import edit_draft

CONFIG = EnvConfig.of("random", (7, 9), beta=0.965, sensor_radius=4)


def draft(consent="We ask you to play.", **rest):
    return default_protocol(
        "small",
        CONFIG,
        **{
            "warm_up": 2,
            "ranked": 3,
            "consent": {"text": consent},
            "declarations": DECLARATIONS,
            **rest,
        },
    )


def test_every_placeholder_has_a_value_and_every_value_is_the_protocols():
    protocol = draft(break_every=7, pause_after_s=45, players=12, data_licence="CC0-1.0")
    values = placeholder_values(protocol)
    assert list(values) == list(PLACEHOLDERS)
    assert values == {
        "name": "small", "warm_up": "2", "ranked": "3", "episodes": "5", "practice": "",
        "break_every": "7", "pause_after": "45",
        "minutes": "10", "questions": "3", "players": "12", "asked": "",
        "licence": "CC0-1.0", "contact": DECLARATIONS["contact"], "retention": DECLARATIONS["retention"],
        "coverage": "96.5 %", "lidar_radius": "4", "rows": "7",
        "cols": "9", "max_steps": "63",
    }  # fmt: skip


def test_the_consent_says_what_the_practice_asks_for():
    protocol = default_protocol(
        "small", EnvConfig.of("random", (7, 9)), warm_up=2, practice={"episodes_to_pass": 1}
    )
    text = fill(protocol).consent.text
    assert (
        "breaks whenever you like. You pass the practice if at least 1 of its 2 terrains ends as"
        in text
    )


def test_texts_of_every_kind_are_filled_and_braces_can_be_written():
    question = {
        "question": "{ranked}?",
        "choices": ["{rows}", "{{x}}"],
        "answer": 0,
        "why": "{cols}",
    }
    filled = fill(
        draft(
            "{warm_up} practice rounds, {{not this}}",
            title="{name} of {episodes}",
            questions=[question],
        )
    )
    assert (filled.title, filled.consent.text) == ("small of 5", "2 practice rounds, {not this}")
    assert filled.questions[0].model_dump(mode="json") == {
        "question": "3?",
        "choices": ["7", "{x}"],
        "answer": 0,
        "why": "9",
    }


def test_the_default_questions_name_the_coverage_that_the_config_asks_for():
    assert "When 96.5 % of all cells have been mapped" in fill(draft()).questions[1].choices


def test_a_draft_edited_to_another_number_promises_the_study_that_runs(tmp_path):
    folder = Folder(tmp_path)
    fields = {"warm_up": 2, "ranked": 30, "declarations": DECLARATIONS}
    path = folder.create(default_protocol("small", CONFIG, data_licence="CC0-1.0", **fields))
    edit_draft(path, ranked=4, warm_up=1, data_licence="CC-BY-4.0")
    study = folder.freeze("small")
    text = study.protocol.consent.text
    assert (
        "3 questions, 1 practice terrain and 4 terrains that count" in text,
        "30" in text,
        "(licence CC-BY-4.0)" in text,
    ) == (
        True,
        False,
        True,
    )
    frozen = json.loads(path.with_name("protocol.json").read_bytes())
    assert frozen["consent"]["text"] == text
    assert Folder(tmp_path).study("small").protocol.consent.text == text


def test_a_frozen_text_is_never_filled_again(tmp_path):
    folder = Folder(tmp_path)
    folder.create(draft("Braces stand: {{ranked}}"))
    assert folder.freeze("small").protocol.consent.text == "Braces stand: {ranked}"
    assert Folder(tmp_path).study("small").protocol.consent.text == "Braces stand: {ranked}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "{rankd} rounds",
            "consent.text has the unknown placeholder {rankd}: did you mean {ranked}? there are {name}, {warm_up}",
        ),
        ("{ranked:d}", "unknown placeholder {ranked:d}"),
        ("{ranked.__class__}", "unknown placeholder {ranked.__class__}"),
        ("{}", "unknown placeholder {}"),
        ("a { alone", "consent.text has a brace without its pair"),
        ("a } alone", "consent.text has a brace without its pair"),
        ("You play 30 rounds.", "consent.text counts by hand: '30 rounds'"),
        ("You play thirty rounds.", "'thirty rounds'"),
        ("First 15 practice\nrounds", "'15 practice rounds'"),
        ("Twenty-five ranked terrains", "'Twenty-five ranked terrains'"),
        ("a 3-round study", "'3-round'"),
        ("10\u00a0episodes", "'10 episodes'"),
        ("20 to 30 trials", "'30 trials'"),
    ],
)
def test_what_a_text_may_not_hold_is_said_and_nothing_is_frozen(tmp_path, text, message):
    folder = Folder(tmp_path)
    folder.create(draft(text))
    with pytest.raises(StudyError) as error:
        folder.freeze("small")
    assert message in str(error.value)
    assert (folder.status("small"), folder.draft("small").consent.text) == ("draft", text)


@pytest.mark.parametrize(
    "text",
    [
        "Which of two complete rounds scores higher?",
        "One terrain is one round, and 1 round is short.",
        "A terrain of 21 x 21 cells; 99 % of its cells; 45 minutes; 2 breaks; we ask 3 questions.",
        "Like COVID-19 trials, version 2.30: rounds are numbered.",
        "The two of you share the rounds. Nine lives. Trials 5 and 6.",
    ],
)
def test_other_numbers_are_left_alone(text):
    assert fill(draft(text)).consent.text == text


def test_the_title_and_the_questions_are_held_to_the_same():
    for rest, place in (
        ({"title": "30 rounds on Mars"}, "title"),
        (
            {"questions": [{"question": "Why 30 rounds?", "choices": ["a", "b"], "answer": 0}]},
            r"questions\[0\].question",
        ),
        (
            {"questions": [{"question": "?", "choices": ["30 rounds", "b"], "answer": 0}]},
            r"questions\[0\].choices\[0\]",
        ),
        (
            {
                "questions": [
                    {"question": "?", "choices": ["a", "b"], "answer": 0, "why": "30 rounds"}
                ]
            },
            r"questions\[0\].why",
        ),
    ):
        with pytest.raises(StudyError, match=f"{place} counts by hand"):
            fill(draft(**rest))


def test_a_filled_text_that_is_too_long_is_no_protocol():
    with pytest.raises(StudyError, match="title"):
        fill(
            parse_protocol(
                {
                    **draft().model_dump(mode="json"),
                    "title": "{licence}" * 30,
                    "data_licence": "x" * 300,
                }
            )
        )


def test_blocks_are_named_in_the_consent_text_and_their_texts_are_filled():
    text = draft(consent="Answers.{asked}", blocks=["demographics", "exposure"])
    asked = "your age, your gender and your education; whether you had met this task before"
    assert f"Answers. We also ask about {asked}. You may" in fill(text).consent.text
    question = {
        "kind": "likert",
        "name": "q",
        "question": "{ranked}?",
        "rows": ["{rows}"],
        "points": ["a", "b"],
    }
    block = {"name": "b", "at": "after", "title": "{cols}", "about": "x", "questions": [question]}
    (filled,) = fill(draft(blocks=[block])).blocks
    assert (filled.title, filled.questions[0].question, filled.questions[0].rows) == (
        "9",
        "3?",
        ("7",),
    )
    block["intro"] = "After 3 terrains"
    with pytest.raises(StudyError, match="counts by hand"):
        fill(draft(blocks=[block]))
