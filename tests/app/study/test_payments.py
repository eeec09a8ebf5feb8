"""Whom to pay, and how much.

The list, Prolific's lines, what its export says against ours, and what each of them waits for.
"""

import csv
import io
import json
from decimal import Decimal

import pytest

from humanplay.db.store import Store
from humanplay.study.folder import Folder
from humanplay.study.outcome import Outcome
from humanplay.study.payments import amounts
from humanplay.study.protocol_parts import Payment
from tests.support.command import command
from tests.support.recorded import ask
from tests.support.recruitment_site import prolific_export
from tests.support.study import Person, freeze

PAY = {
    "currency": "GBP",
    "base": 2,
    "bonus_per_unit": 0.5,
    "bonus_limit": 1,
    "hourly_rate": 9,
    "outcomes": {"withdrew": 0.25},
}
LINK = {"STUDY_ID": "6" * 24, "SESSION_ID": "7" * 24}


def ident(digit):
    return digit * 24


@pytest.fixture
def study(tmp_path):
    """`study(**payment)` freezes a study of people from Prolific who are paid so."""

    def make(**payment):
        return freeze(
            tmp_path / "playground.db-studies", platform="prolific", recruitment="panel",
            payment={**PAY, **payment}, outcomes={"finished": "C1DONE", "no_consent": "C2NO"},
        )  # fmt: skip

    return make


def comes(server, digit):
    return Person(server, outside_ids={**LINK, "PROLIFIC_PID": ident(digit)})


def of_every_kind(server):
    """A finisher, one who withdraws, one who is playing, one who declines."""
    finisher, leaver, busy, shy = (comes(server, digit) for digit in "1234")
    finisher.to_warm_up()
    finisher.play_on()
    leaver.to_tutorial()
    leaver.call("withdraw")
    busy.to_warm_up()
    busy.call("next")
    busy.play(2)
    shy.call("consent", {"version": "1", "agree": False})


def close(capsys, tmp_path):
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0


def payments(capsys, tmp_path, *options):
    """The code, what is printed and what is complained about, of the command."""
    return command(capsys, "study", "payments", "small", *options, "--database", tmp_path / "playground.db")  # fmt: skip


def listed(path):
    """The rows of a list by identifier."""
    return {row["identifier"]: row for row in csv.DictReader(io.StringIO(path.read_text()))}


def test_a_study_to_which_nobody_has_agreed_says_so_instead_of_an_empty_table(
    serve, study, tmp_path, capsys
):
    study()
    comes(serve(), "1").call("consent", {"version": "1", "agree": False})
    code, output, _ = payments(capsys, tmp_path)
    assert (code, output.splitlines()) == (
        0,
        ["No person has agreed; synthetic participants are not listed", "1 person has not agreed"],
    )


def test_everybody_who_agreed_is_listed_and_what_follows_from_play_waits(
    serve, study, tmp_path, capsys
):
    study()
    server = serve()
    of_every_kind(server)
    out = tmp_path / "list.csv"
    code, output, _ = payments(capsys, tmp_path, "--csv", out)
    assert code == 0
    assert "1 person has not agreed" in output
    assert out.stat().st_mode & 0o777 == 0o600
    rows = listed(out)
    assert {key: (row["outcome"], row["code"], row["amount"]) for key, row in rows.items()} == {
        ident("1"): ("finished", "C1DONE", "after the study is closed"),
        ident("2"): ("withdrew", "", "after the study is closed"),
        ident("3"): ("can go on", "", ""),
    }
    assert {row["share_ended"] for row in rows.values()} == {""}
    assert "Effective pay" not in output
    code, _, output = payments(capsys, tmp_path, "--bulk", tmp_path / "bulk.csv")
    assert (code, "follow from how people played" in output) == (2, True)
    close(capsys, tmp_path)
    code, output, _ = payments(capsys, tmp_path, "--csv", out, "--bulk", tmp_path / "bulk.csv")
    rows = listed(out)
    assert {key: (row["outcome"], row["share_ended"]) for key, row in rows.items()} == {
        ident("1"): ("finished", "1.000"),
        ident("2"): ("withdrew", "0.000"),
        ident("3"): ("stopped_by_us", "0.000"),
    }
    assert (rows[ident("1")]["amount"], rows[ident("2")]["amount"]) == ("3.00", "0.25")
    minutes = float(rows[ident("3")]["minutes"])
    assert float(rows[ident("3")]["amount"]) == pytest.approx(9 * minutes / 60, abs=0.02)
    assert "GBP an hour" in output
    bulk = (tmp_path / "bulk.csv").read_text()
    assert bulk.splitlines()[:2] == [f"{ident('1')},1.00", f"{ident('2')},0.25"]


def test_an_episode_that_the_closing_cut_off_was_not_ended(serve, study, tmp_path, capsys):
    study()
    server = serve()
    busy = comes(server, "1")
    busy.to_warm_up()
    busy.play_on(until=("ranked",))
    busy.call("next")
    busy.play()
    busy.call("next")
    busy.play(2)
    database = "--database", tmp_path / "playground.db"
    closes = "study", "close", "small", "--yes", "--now", *database
    assert command(capsys, *closes, "--keep-secret")[0] == 0
    assert command(capsys, *closes)[0] == 0
    payments(capsys, tmp_path, "--csv", tmp_path / "list.csv")
    assert listed(tmp_path / "list.csv")[ident("1")]["share_ended"] == "0.333"


def test_nothing_is_listed_before_the_database_knows_the_end(study, serve, tmp_path, capsys):
    frozen = study(bonus_per_unit=0)
    server = serve()
    comes(server, "1").to_tutorial()
    server.stop()
    Folder(tmp_path / "playground.db-studies").close(frozen.name, keeps_secret=True)
    code, _, refusal = payments(capsys, tmp_path)
    assert (code, "has not taken note" in refusal) == (2, True)


def test_the_code_of_a_sentence_is_listed(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies", outcomes={"withdrew": "Write to us, with {code}."})
    person = Person(serve())
    person.to_tutorial()
    person.call("withdraw")
    ((drawn,),) = ask(tmp_path / "playground.db", "SELECT completion_code FROM participants")
    assert drawn in person.where["ending"]["sentence"]
    payments(capsys, tmp_path, "--csv", tmp_path / "list.csv")
    (row,) = listed(tmp_path / "list.csv").values()
    assert row["code"] == drawn


def test_an_amount_that_follows_from_no_play_waits_for_nothing(serve, study, tmp_path, capsys):
    study(bonus_per_unit=0)
    of_every_kind(serve())
    payments(capsys, tmp_path, "--csv", tmp_path / "list.csv")
    rows = listed(tmp_path / "list.csv")
    assert [rows[ident(digit)]["amount"] for digit in "123"] == ["2.00", "0.25", ""]
    assert ask(tmp_path / "playground.db", "SELECT count(*) FROM chain WHERE kind = 'acted'") == [(0,)]  # fmt: skip


def test_amounts_that_are_seen_early_are_noted_each_time_and_the_report_says_so(
    serve, study, tmp_path, capsys
):
    study(bonus_at_once=True)
    server = serve()
    of_every_kind(server)
    for _ in range(2):
        payments(capsys, tmp_path, "--csv", tmp_path / "list.csv")
    assert listed(tmp_path / "list.csv")[ident("1")]["amount"] == "3.00"
    notes = ask(tmp_path / "playground.db", "SELECT note FROM chain WHERE kind = 'acted'")
    assert [json.loads(note)["people"] for (note,) in notes] == [1, 1]
    assert "1.00" not in str(notes)
    server.stop()
    close(capsys, tmp_path)
    report = tmp_path / "report.json"
    options = "--database", tmp_path / "playground.db", "--json", report, "--no-moves"
    assert command(capsys, "report", "--study", "small", *options)[0] == 0
    assert "amounts that follow from scores 2 times while it was open, after 1 person" in report.read_text()  # fmt: skip


def test_a_platforms_export_is_compared_with_who_finished(serve, study, tmp_path, capsys):
    study()
    of_every_kind(serve())
    export = tmp_path / "export.csv"
    submissions = prolific_export(
        (ident("1"), "AWAITING REVIEW", "NOCODE"),
        (ident("2"), "AWAITING REVIEW", "C1DONE"),
        (ident("3"), "TIMED-OUT", ""),
        (ident("4"), "RETURNED", ""),
        (ident("5"), "APPROVED", "C1DONE"),
        (ident("6"), "AWAITING REVIEW", "C2NO"),
    )
    export.write_text(submissions, encoding="utf-8-sig")
    code, output, _ = payments(capsys, tmp_path, "--against", export)
    assert code == 0
    assert f"claim to have finished and have not: {ident('2')}, {ident('5')}\n" in output
    assert f"finished without a code: {ident('1')}" in output
    assert f"timed out: {ident('3')}" in output
    export.write_text("a,b\n1,2\n")
    code, _, output = payments(capsys, tmp_path, "--against", export)
    assert (code, "'participant id' is missing" in output) == (2, True)
    export.write_bytes(b"\xff\xfe")
    code, _, output = payments(capsys, tmp_path, "--against", export)
    assert (code, f"cannot read {export}: it is no text in UTF-8" in output) == (2, True)
    export.unlink()
    code, _, output = payments(capsys, tmp_path, "--against", export)
    assert (code, str(export) in output, "playground.db" in output) == (1, True, False)


def test_connects_export_is_compared_by_its_statuses(serve, tmp_path, capsys):
    project = "https://connect.cloudresearch.com/participant/project/41B26CAA44"
    outcomes = {
        "finished": f"{project}/complete", "failed_questions": f"{project}/partial",
        "over_quota": f"{project}/full", "no_consent": "Thank you", "withdrew": "Thank you",
    }  # fmt: skip
    freeze(
        tmp_path / "playground.db-studies", platform="connect", recruitment="panel",
        outside_ids=("participantId", "assignmentId", "projectId"), question_tries=2,
        outcomes=outcomes,
    )  # fmt: skip
    server = serve()
    link = {"assignmentId": "A" * 32, "projectId": "41B26CAA44"}
    people = [
        Person(server, outside_ids={**link, "participantId": digit * 32}) for digit in "123456"
    ]
    for finisher in people[:2]:
        finisher.to_warm_up()
        finisher.play_on()
    people[2].to_tutorial()
    failing = people[3]
    failing.to_questions()
    for _ in range(2):
        failing.call("answers", {"answers": [0, 0, 1]})
    people[4].to_tutorial()
    people[5].to_tutorial()
    people[5].call("withdraw")
    statuses = (
        "Approved", "Returned", "Pending", "Pending", "Timed Out", "Approved", "Approved", "Returned",
    )  # fmt: skip
    rows = [
        f"{number * 32},{status},2 min" for number, status in zip("12345678", statuses, strict=True)
    ]
    export = tmp_path / "connect.csv"
    export.write_text("\n".join(["ParticipantId,Status,Duration", *rows]))
    code, printed, _ = payments(capsys, tmp_path, "--against", export)
    assert code == 0
    assert printed.splitlines()[:4] == [
        f"claim to have finished and have not: {'3' * 32}, {'6' * 32}",
        f"finished and did not come back: {'2' * 32}",
        f"unknown here (never agreed, erased or unlinked): {'7' * 32}, {'8' * 32}",
        f"timed out: {'5' * 32}",
    ]


def test_a_platform_without_an_export_of_submissions_is_not_compared(tmp_path, capsys):
    credit = "https://school.sona-systems.com/credit?id=7&survey_code={survey_code}"
    freeze(
        tmp_path / "playground.db-studies", platform="sona", recruitment="panel",
        outside_ids=("survey_code",), outcomes={"finished": credit},
    )  # fmt: skip
    Store(tmp_path / "playground.db").close()
    export = tmp_path / "sona.csv"
    export.write_text("Participant ID,Status\n12345,Approved\n")
    code, _, complaint = payments(capsys, tmp_path, "--against", export)
    assert (code, "people of this study come from SONA" in complaint) == (2, True), complaint


def test_an_identifier_that_a_spreadsheet_would_run_is_a_text(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies", outside_ids=("ID",))
    Person(serve(), outside_ids={"ID": "=1+1"}).to_tutorial()
    payments(capsys, tmp_path, "--csv", tmp_path / "list.csv")
    assert list(listed(tmp_path / "list.csv")) == ["'=1+1"]


class Played:
    """A ranked episode that has ended."""

    phase, ended_ms = "ranked", 1

    def __init__(self, succeeded, steps, score=0.0):
        self.succeeded, self.steps_to_target, self.score = succeeded, steps, score


@pytest.mark.parametrize(
    ("payment", "bonus"),
    [
        ({"bonus_per_unit": 0.5}, "1.00"),
        ({"bonus_per_unit": 0.5, "bonus_limit": 0.75}, "0.75"),
        (
            {
                "bonus_per_unit": 0.01,
                "bonus_unit": "steps",
                "bonus_threshold": 30,
                "bonus_direction": "fewer",
            },
            "0.15",
        ),
        (
            {
                "bonus_per_unit": 0.01,
                "bonus_unit": "steps",
                "bonus_threshold": 20,
                "bonus_direction": "fewer",
            },
            "0.00",
        ),
        ({"bonus_per_unit": 1, "bonus_unit": "score", "bonus_threshold": 0.5}, "0.35"),
        (
            {"bonus_per_unit": 1, "bonus_unit": "score", "bonus_threshold": 0.5, "rounding": 0.25},
            "0.25",
        ),
        (
            {"bonus_per_unit": 1, "bonus_unit": "score", "bonus_threshold": 0.5, "rounding": 0.1},
            "0.40",
        ),
        ({"bonus_per_unit": 0.5, "bonus_limit": 0.9, "rounding": 0.25}, "0.75"),
        ({"bonus_per_unit": 0.5, "base": 2.1, "rounding": 0.25}, "1.00"),
    ],
)
def test_a_bonus_is_never_below_nothing_or_above_its_cap(payment, bonus):
    played = [Played(True, 20, 0.9), Played(True, 25, 0.8), Played(False, 30, 0.15)]
    paid = Payment(currency="USD", **{"base": 3, **payment})
    whole, part = amounts(paid, Outcome.FINISHED, played, 10.0)
    assert (f"{part:.2f}", whole) == (bonus, Decimal(str(paid.base)) + Decimal(bonus))
    assert amounts(paid, Outcome.LEFT, played, 10.0) == (0, 0)


def test_amounts_are_rounded_to_what_can_be_paid():
    with pytest.raises(ValueError, match="rounding must be a multiple"):
        Payment(currency="USD", rounding=0.015)


def test_what_the_platform_pays_as_a_screen_out_is_no_bonus():
    outcomes = {"failed_questions": 0.4, "withdrew": 0.3}
    paid = Payment(currency="USD", outcomes=outcomes, screen_out="failed_questions")
    pairs = [amounts(paid, Outcome(outcome), [], 10.0) for outcome in outcomes]
    assert [tuple(map(str, pair)) for pair in pairs] == [("0.4", "0"), ("0.3", "0.3")]
    with pytest.raises(ValueError, match="got withdrew"):
        Payment(currency="USD", screen_out="withdrew")
