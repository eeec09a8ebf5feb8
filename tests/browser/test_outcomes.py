"""People from a recruitment platform, one for each outcome.

What they read in a real browser, and what is paid.
"""

import csv
import io

import pytest

from tests.browser.test_study_page import RIGHT, Participant
from tests.support.browser import AS_A_PERSON, NO_3D, judge
from tests.support.command import command
from tests.support.study import freeze

pytestmark = pytest.mark.timeout(900)
BACK = "https://app.prolific.com/submissions/complete?cc="
TEXTS = {
    "finished": "C1DONE",
    "unfit_device": "C2DEVICE",
    "no_consent": "C3NO",
    "over_quota": "C5FULL",
    "stopped_by_us": "C4STOPPED",
}
PAY = {
    "currency": "GBP",
    "base": 2,
    "bonus_per_unit": 0.5,
    "hourly_rate": 9,
    "outcomes": {"failed_questions": 0.5},
}
RETURN = "Please return your submission on Prolific."
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.fixture
def from_prolific(open_browser, serve, tmp_path):
    """`from_prolific(digit)` comes from Prolific with an ID of that digit.

    Each has a browser of their own.
    """
    freeze(
        tmp_path / "playground.db-studies", "tiny", platform="prolific", recruitment="panel",
        device="computer", question_tries=2, cap=4, warm_up=0, ranked=1, outcomes=TEXTS, payment=PAY,
    )  # fmt: skip
    server = serve()

    def start(digit, **context):
        wide = {"viewport": {"width": 1440, "height": 900}}
        browser = open_browser((*NO_3D, *AS_A_PERSON))
        profile = browser.new_context(reduced_motion="reduce", **(context or wide))
        ids = {"PROLIFIC_PID": digit, "STUDY_ID": "a", "SESSION_ID": "b"}
        query = "?" + "&".join(f"{name}={part * 24}" for name, part in ids.items())
        return Participant(profile.new_page(), server.url, query).goto()

    return start


def reads(person):
    """The code, the address and the sentence that somebody reads."""
    page = person.page
    code, back, sentence = map(page.get_by_test_id, ("code", "return", "ending-sentence"))
    return (
        code.inner_text() if code.is_visible() else None,
        back.get_attribute("href") if back.is_visible() else None,
        sentence.inner_text() if sentence.is_visible() else None,
    )


def look(person, name):
    assert judge(person.page, f"study-end-{name}") == []


def test_each_outcome_is_read_by_whoever_comes_to_it_and_is_paid_as_the_protocol_says(
    from_prolific, tmp_path, capsys
):
    phone = from_prolific("1", **PHONE)
    phone.stands("withdrawn")
    assert phone.page.locator("#withdrawn-title").inner_text() == "This device does not fit"
    assert reads(phone) == ("C2DEVICE", f"{BACK}C2DEVICE", None)
    look(phone, "device")

    shy = from_prolific("2")
    assert "?" not in shy.page.url
    shy.stands("consent")
    shy.choose("disagree")
    shy.choose("leave-now")
    shy.stands("withdrawn")
    assert reads(shy) == ("C3NO", f"{BACK}C3NO", None)
    look(shy, "declined")

    wrong = from_prolific("3")
    wrong.to_questions()
    wrong.answer([1, 0, 0])
    wrong.page.get_by_text("You can answer once more").wait_for()
    wrong.answer([1, 0, 0])
    wrong.stands("withdrawn")
    assert wrong.page.locator("#withdrawn-title").inner_text() == "The questions are over"
    assert reads(wrong) == (None, None, f"{RETURN} You get 0.50 GBP as a bonus.")
    look(wrong, "questions")

    leaver = from_prolific("4")
    leaver.stands("consent")
    leaver.choose("agree")
    leaver.stands("instructions")
    leaver.choose("open-leave")
    leaver.choose("leave-now")
    leaver.stands("withdrawn")
    assert reads(leaver) == (None, None, RETURN)
    look(leaver, "withdrew")

    finisher = from_prolific("5")
    finisher.to_questions()
    finisher.answer(RIGHT)
    finisher.stands("ready")
    finisher.choose("begin")
    finisher.driving()
    finisher.explore()
    finisher.page.keyboard.press("Enter")
    finisher.stands("debrief")
    finisher.choose("finish")
    finisher.stands("complete")
    assert reads(finisher) == ("C1DONE", f"{BACK}C1DONE", None)
    look(finisher, "finished")

    busy = from_prolific("6")
    busy.to_questions()
    busy.answer(RIGHT)
    busy.stands("ready")
    busy.choose("begin")
    busy.driving()
    busy.press(busy.next_action())

    late = from_prolific("7")
    late.stands("withdrawn")
    assert late.page.locator("#withdrawn-title").inner_text() == "This study is full"
    assert reads(late) == ("C5FULL", f"{BACK}C5FULL", None)
    look(late, "full")

    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "tiny", "--yes", "--now", *database)[0] == 0
    busy.page.reload()
    busy.stands("problem")
    assert reads(busy) == ("C4STOPPED", f"{BACK}C4STOPPED", None)
    look(busy, "stopped")

    out = tmp_path / "list.csv"
    code, output, _ = command(capsys, "study", "payments", "tiny", "--csv", out, *database)
    assert (code, "3 people have not agreed" in output) == (0, True)
    rows = {row["identifier"][0]: row for row in csv.DictReader(io.StringIO(out.read_text()))}
    assert {key: (row["outcome"], row["code"]) for key, row in rows.items()} == {
        "3": ("failed_questions", ""),
        "4": ("withdrew", ""),
        "5": ("finished", "C1DONE"),
        "6": ("stopped_by_us", "C4STOPPED"),
    }
    assert [rows[key]["amount"] for key in "345"] == ["0.50", "0.00", "2.50"]
    for person in (phone, shy, wrong, leaver, finisher, busy, late):
        assert person.errors == []
