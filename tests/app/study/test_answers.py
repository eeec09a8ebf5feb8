"""Answers in the report's table, and in a release with and without them."""

import csv
import io
import json
import sqlite3
from contextlib import closing

import pytest

from humanplay.db.study_rows import AnswerRow
from humanplay.release.pseudonyms import Pseudonyms, RowPseudonymizer
from humanplay.study.answer_counts import Cell, count_answers
from humanplay.study.questions import Block
from tests.app.study.test_questions import block
from tests.support.command import command
from tests.support.study import Person, freeze

QUESTIONS = [
    {"kind": "choice", "name": "hand", "question": "Which hand?", "choices": ["left", "right", "both"],
     "tells": "demographics"},
    {"kind": "choice", "name": "before", "question": "Played before?", "choices": ["no", "yes"], "tells": "exposure"},
    {"kind": "number", "name": "age", "question": "How old?", "minimum": 18, "maximum": 99},
    {"kind": "text", "name": "how", "question": "How did you do it?", "long": True, "tells": "explanations"},
]  # fmt: skip
PEOPLE = [
    {"hand": 0, "before": 0, "age": 21, "how": "I am ann@example.org, ID pid0, call 030 1234567."},
    {"hand": 0, "before": 0, "age": 25, "how": "See https://example.org/me"},
    {"hand": 0, "before": 0, "age": 33},
    {"hand": 1, "before": 0, "age": 61},
]


def cells(answers, **question):
    """The cells of a question with these answers, as they are told."""
    return [(cell.answers, cell.people) for cell in counted(answers, **question).cells]


def counted(answers, **question):
    """The counts of a question with these answers."""
    asked = {"name": "q", "question": "What?", **question}
    about = Block.model_validate(block("about", questions=[asked]))
    rows = [
        AnswerRow(str(n), "about", 0, "q", 0, answer, None, 0) for n, answer in enumerate(answers)
    ]
    (counts,) = count_answers([about], rows, [])
    assert counts.people in (None, len(answers))
    return counts


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ([0] * 5 + [1] * 3, [("a", 5), ("b", 3), ("c", 0)]),
        ([0] * 5 + [1] * 2, [("a or b", 7), ("c", 0)]),
        ([0] * 5 + [2], [("a or b or c", 6)]),
        ([0] * 4 + [1] * 3 + [None], [("a", 4), ("b or c or prefer not to say", 4)]),
        ([0, 1, 2], [("a or b or c", 3)]),
        ([0, 1], []),
    ],
)
def test_nobody_stands_alone_in_a_cell(answers, expected):
    assert cells(answers, kind="choice", choices=["a", "b", "c"]) == expected


@pytest.mark.parametrize(
    ("question", "answers", "words"),
    [
        ({"kind": "number", "minimum": 0, "maximum": 90}, [20, 30] * 5, "mean 25.0, SD 5.3"),
        ({"kind": "number", "minimum": 0, "maximum": 90}, [20, 30] * 5 + [None] * 3, "mean 25.0, SD 5.3"),
        ({"kind": "number", "minimum": 0, "maximum": 90}, [20, 30] * 4 + [None] * 9, ""),
        ({"kind": "number", "minimum": 0, "maximum": 90}, [20, 30] * 5 + [None], ""),
        ({"kind": "likert", "rows": ["r"], "points": [*"abcde"]}, [0] + [2] * 4 + [3] * 5, ""),
        ({"kind": "scale", "steps": 21, "low": "l", "high": "h"}, [0] * 5 + [20] * 5, "mean 10.0, SD 10.5"),
        ({"kind": "likert", "rows": ["r"], "points": ["a", "b", "c"]}, [0, 2] * 5, "mean 2.0, SD 1.1"),
        ({"kind": "choice", "choices": ["a", "b"]}, [0, 1] * 5, ""),
    ],
)  # fmt: skip
def test_what_is_a_number_has_mean_and_sd_unless_they_gave_the_answers_away(
    question, answers, words
):
    assert counted(answers, **question).mean_and_sd() == words


def test_numbers_and_steps_are_told_in_ranges():
    number = {"kind": "number", "minimum": 18, "maximum": 99}
    assert cells([19, 21, 22, 23, 45, 46, 47], **number) == [("18 to 29", 4), ("40 to 49", 3)]
    large = {"kind": "number", "minimum": 0, "maximum": 20_000_000}
    assert cells([2_500_000] * 3, **large) == [("2000000 to 3999999", 3)]
    scale = {"kind": "scale", "steps": 21, "low": "low", "high": "high"}
    assert cells([0, 3, 4, 10, 10, 10, None], **scale) == [
        ("0 to 4", 3),
        ("10 to 20 or prefer not to say", 4),
    ]


@pytest.mark.parametrize("ident", ["pid0", "#ann#"])
def test_an_id_is_masked_where_it_is_no_part_of_a_word(ident):
    pseudonymizer = RowPseudonymizer(Pseudonyms(b"key"), {ident: "PROLIFIC_PID"})
    assert pseudonymizer.masked(f"{ident.upper()}. I am {ident}!") == "[masked]. I am [masked]!"
    assert pseudonymizer.masked("ID#ann#or pid01") == (
        "ID[masked]or pid01" if ident == "#ann#" else "ID#ann#or pid01"
    )


@pytest.fixture
def closed(serve, tmp_path, capsys):
    """A closed study whose people answered as PEOPLE, and a program; the database."""
    database = tmp_path / "playground.db"
    about = block("about", questions=QUESTIONS)
    study = freeze(f"{database}-studies", blocks=[about], warm_up=0, ranked=1)
    server = serve()
    for number, answers in enumerate(PEOPLE):
        person = Person(server, outside_ids={"PROLIFIC_PID": f"pid{number}"})
        person.call("consent", {"version": "1", "agree": True})
        person.call("block", {"block": "about", "turn": 0, "answers": answers})
        while person.me()["stage"] != "complete":
            person.take_step()
    person = Person(server, script="noisy-frontier")
    while person.me()["stage"] != "complete":
        person.take_step()
    server.stop()
    code, _, error = command(capsys, "study", "close", study.name, "--yes", "--database", database)
    assert code == 0, error
    return database


def csv_of(folder, name):
    return list(csv.DictReader(io.StringIO((folder / "csv" / f"{name}.csv").read_text())))


def bytes_of(folder):
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def test_a_release_has_counts_and_more_where_it_is_asked_for_and_is_derived_again(
    closed, tmp_path, capsys
):
    def release(name, *flags):
        out = tmp_path / name
        how = ("--study", "small", "--out", out, "--database", closed, *flags)
        code, printed, error = command(capsys, "release", *how)
        assert code == 0, error
        code, derived, error = command(capsys, "reproduce", out)
        assert code == 0, error
        assert derived.splitlines()[-1].endswith(" values compared, 0 differ")
        assert command(capsys, "verify", "--dataset", out)[0] == 0
        return out, printed

    plain, printed = release("plain")
    counts = {
        (row["question"], row["answers"]): row["people"] for row in csv_of(plain, "answer_counts")
    }
    assert counts == {
        ("hand", "left or right"): "4", ("hand", "both"): "0", ("before", "no"): "4", ("before", "yes"): "0",
        ("age", "20 to 69"): "4", ("how", ""): "",
    }  # fmt: skip
    assert csv_of(plain, "answers") == csv_of(plain, "free_texts") == []
    assert b"ann@example.org" not in bytes_of(plain)
    assert b"example.org/me" not in bytes_of(plain)

    full, printed = release("full", "--answers", "--free-text")
    assert "4 of 4 people who answered are unique by their answers" in printed
    assert "3 free texts in" in printed
    ages = [row["answer"] for row in csv_of(full, "answers") if row["question"] == "age"]
    kinds = {row["participant"]: row["kind"] for row in csv_of(full, "participants")}
    assert len(ages) == len(kinds) == 5
    people = [row for row in csv_of(full, "free_texts") if kinds[row["participant"]] == "human"]
    assert {row["words"] for row in people} == {
        "I am [masked], ID [masked], call [masked].",
        "See [masked]",
    }

    report = json.loads((plain / "report.json").read_text())
    assert (
        report["groups"][0]["answers"]
        == json.loads((full / "report.json").read_text())["groups"][0]["answers"]
    )
    items = {item["number"]: item for item in report["checklist"]}
    assert items["2.5"]["answer"] == "Asked"
    assert "“Played before?” no: 4; yes: 0." in items["2.5"]["detail"]
    assert items["5.1.1"]["detail"].startswith("none. “Which hand?” left or right: 4")
    assert items["3.6"]["answer"] == "Yes"
    assert items["3.5"]["answer"] == "Unknown/Unreported"
    assert "Which hand?" in (plain / "report.html").read_text()

    fresh = tmp_path / "fresh.db"
    assert command(capsys, "import", plain, "--database", fresh)[0] == 0
    assert command(capsys, "verify", "--database", fresh)[0] == 0
    with closing(sqlite3.connect(fresh)) as conn:
        assert conn.execute("SELECT count(*) FROM answers").fetchone() == (0,)


def test_no_count_is_shown_while_the_study_is_open(serve, tmp_path):
    from humanplay.report.build import build
    from humanplay.study.data import load

    database = tmp_path / "playground.db"
    freeze(f"{database}-studies", blocks=[block("about", questions=QUESTIONS)], warm_up=0, ranked=1)
    server = serve()
    for answers in PEOPLE:
        person = Person(server)
        person.call("consent", {"version": "1", "agree": True})
        person.call("block", {"block": "about", "turn": 0, "answers": answers})
    server.stop()
    data = load(database, "small")
    assert data.answers[0].cells == (Cell("left or right", 4), Cell("both", 0))
    assert build(data).groups[0].answers == ()
