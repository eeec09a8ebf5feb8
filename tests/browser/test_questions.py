"""Blocks of questions in a real browser.

By keyboard, on a phone, with "prefer not to say", a reload and a skipped rest.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from tests.app.study.test_questions import block
from tests.browser.test_study_page import RIGHT, Participant
from tests.support.browser import AS_A_PERSON, NO_3D, SIZES, judge, keep_picture
from tests.support.study import freeze

pytestmark = pytest.mark.timeout(600)


@pytest.fixture
def joined(open_browser, serve, tmp_path):
    """`joined(*blocks)` is a person who has agreed to a study with these blocks.

    Each has a browser of their own.
    """

    def start(*blocks, **context):
        plan = {"blocks": blocks, "warm_up": 0, "ranked": 1, **context.pop("plan", {})}
        freeze(tmp_path / "playground.db-studies", "tiny", **plan)
        size = dict(zip(("width", "height"), SIZES["desktop"], strict=True))
        browser = open_browser((*NO_3D, *AS_A_PERSON))
        profile = browser.new_context(**{"viewport": size, "reduced_motion": "reduce", **context})
        person = Participant(profile.new_page(), serve().url).goto()
        person.stands("consent")
        with person.page.expect_download() as download:
            person.page.get_by_test_id("save-consent").click()
        saved = Path(download.value.path()).read_text()
        assert saved.split("version 1\n\n")[1].strip() == person.state("participant.consent.text")
        person.choose("agree")
        return person

    return start


def rows(tmp_path, sql):
    with closing(sqlite3.connect(tmp_path / "playground.db")) as conn:
        return conn.execute(sql).fetchall()


def look(person, name):
    """What axe finds at both sizes, and whether the screen fits 320 pixels.

    A picture of each is kept.
    """
    problems = judge(person.page, name, full_page=True)
    person.page.set_viewport_size({"width": 320, "height": 700})
    assert person.page.evaluate("document.documentElement.scrollWidth") <= 320
    keep_picture(person.page, f"{name}-320", full_page=True)
    return problems


def at(person, name):
    """The question of a name."""
    return person.page.get_by_test_id(f"question-{name}")


def test_every_kind_is_answered_by_keyboard_alone_and_a_reload_keeps_what_was_typed(
    joined, tmp_path
):
    person = joined(block(intro="Answer as you like."))
    person.stands("block")
    assert look(person, "questions-kinds") == []
    person.choose("send-block")
    assert at(person, "hand").locator(".verdict").inner_text().startswith("Please answer this")
    assert person.page.evaluate("document.activeElement.name") == "hand"
    assert "4 questions need" in person.page.get_by_test_id("block-status").inner_text()
    assert look(person, "questions-missing") == []

    def press(*keys):
        for key in keys:
            person.page.keyboard.press(key)

    press("Space", "Tab")  # hand: left
    assert at(person, "hand").locator(".verdict").is_hidden()
    at(person, "colour").get_by_label("c", exact=True).focus()
    press("Space", "Tab")
    press("Space", "Tab", "Tab", "Space", "Tab")  # devices: phone and watch
    press("Space", "ArrowRight", "ArrowRight", "Tab", "Space", "Tab", "Tab")  # mood: yes, no
    assert at(person, "load").locator("output").inner_text() == "Not answered yet"
    press("ArrowRight", "ArrowLeft", "Tab", "Tab")  # load: the middle
    assert at(person, "load").locator("output").inner_text() == "11 of 21"
    person.page.keyboard.type("30")
    press("Tab")
    person.page.keyboard.type("Bath")
    person.page.reload()
    person.stands("block")
    assert at(person, "town").locator("input").input_value() == "Bath"
    assert at(person, "load").locator("output").inner_text() == "11 of 21"
    assert at(person, "hours").locator("input").input_value() == ""  # 30 hours are no answer
    at(person, "hours").locator("input").focus()
    person.page.keyboard.type("25")
    person.choose("send-block")
    assert "from 1 to 24" in at(person, "hours").locator(".verdict").inner_text()
    at(person, "hours").locator("input").fill("1,000")
    person.choose("send-block")
    assert "without a mark" in at(person, "hours").locator(".verdict").inner_text()
    at(person, "hours").locator("input").fill("25")
    press("Backspace", "Backspace", "3", "Tab", "Tab", "Tab", "Space", "Tab")  # and no story
    press("Space", "Tab", "Tab", "Space")  # honest; look: the first
    person.choose("send-block")
    person.stands("instructions")
    assert person.errors == []
    stored = rows(tmp_path, "SELECT question, part, answer FROM answers ORDER BY 1, 2")
    assert stored == [
        ("colour", 0, 2.0),
        ("devices", 0, 1.0),
        ("devices", 1, 0.0),
        ("devices", 2, 1.0),
        ("hand", 0, 0.0),
        ("honest", 0, 1.0),
        ("hours", 0, 3.0),
        ("load", 0, 10.0),
        ("look", 0, 0.0),
        ("mood", 0, 2.0),
        ("mood", 1, 0.0),
    ]
    texts = rows(tmp_path, "SELECT question, words FROM free_texts ORDER BY 1")
    assert texts == [("story", None), ("town", "Bath")]


def test_what_was_typed_is_gone_from_the_tab_once_somebody_has_left(joined):
    person = joined(block(questions=[{"kind": "text", "name": "block", "question": "Where?"}]))
    person.stands("block")
    ids = person.page.evaluate("[...document.querySelectorAll('[id]')].map(({ id }) => id)")
    assert len(set(ids)) == len(ids), "a question may have the name of a part of the page"
    draft = "sessionStorage.getItem('humanplay.study.tiny.block')"
    at(person, "block").locator("input").fill("Bath")
    assert "Bath" in person.page.evaluate(draft)
    person.choose("open-leave")
    person.choose("leave-now")
    person.stands("withdrawn")
    assert person.page.evaluate(draft) is None


def test_on_a_phone_the_shipped_blocks_lead_through_the_study_and_skipping_leads_to_the_code(
    joined, tmp_path
):
    width, height = SIZES["phone"]
    phone = {"viewport": {"width": width, "height": height}, "has_touch": True, "is_mobile": True}
    names = ("demographics", "experience", "exposure", "tools", "nasa-tlx", "remark")
    person = joined(*names, **phone)
    for name in ("demographics", "experience", "exposure"):
        person.stands("block")
        title = {"demographics": "About you", "experience": "Games and you"}.get(
            name, "Before today"
        )
        person.wait(f"document.getElementById('block-title').textContent === '{title}'")
        assert look(person, f"questions-{name}") == []
        person.page.set_viewport_size({"width": width, "height": height})
        for decline in person.page.get_by_label("Prefer not to say").all():
            decline.tap()
        person.page.get_by_test_id("send-block").tap()
    person.stands("instructions")
    person.page.set_viewport_size(dict(zip(("width", "height"), SIZES["desktop"], strict=True)))
    person.choose("to-tutorial")
    person.driving()
    person.explore()
    person.page.keyboard.press("Enter")
    person.stands("questions")
    person.answer(RIGHT)
    person.stands("ready")
    person.page.keyboard.press("Enter")
    person.driving()
    person.explore()
    assert "Some questions follow" in person.page.get_by_test_id("end-card").inner_text()
    person.page.keyboard.press("Enter")
    person.stands("block")
    assert rows(tmp_path, "SELECT completed_ms > 0 FROM participants") == [(1,)]
    at(person, "used_tool").get_by_label("no", exact=True).check()
    person.choose("send-block")
    person.wait("document.getElementById('block-title').textContent === 'How demanding it was'")
    assert person.page.evaluate("document.activeElement.id") == "block-title"
    assert look(person, "questions-tlx") == []
    person.choose("skip-blocks")
    person.stands("debrief")
    person.choose("finish")
    person.stands("complete")
    assert len(person.page.get_by_test_id("code").inner_text()) == 8
    assert person.errors == []
    done = rows(
        tmp_path, "SELECT json_extract(detail, '$.skipped') FROM stage_events WHERE kind = 'block'"
    )
    assert done == [(0,)] * 4 + [(1,)] * 2


def test_whoever_misses_too_many_attention_checks_reads_why_it_is_over(joined):
    asked = {"question": "Choose the second one.", "choices": ["first", "second"], "answer": 1}
    check = {"kind": "attention", "name": "check", "needed": True, **asked}
    person = joined(block(questions=[check]), plan={"attention_limit": 0})
    person.stands("block")
    assert "answer" not in person.state("participant.block.questions")[0]
    at(person, "check").get_by_text("first").click()
    person.choose("send-block")
    person.stands("withdrawn")
    text = person.page.locator("section[data-screen=withdrawn]").inner_text()
    assert "The study is over for you" in text
    assert "Some questions were there to see whether they are read" in text
    assert look(person, "questions-attention") == []
