"""A practice that must be passed, in a real browser."""

import pytest

from tests.browser.test_study_page import RIGHT, Participant, studies  # noqa: F401
from tests.support.browser import AS_A_PERSON, NO_3D, judge

pytestmark = pytest.mark.timeout(900)


@pytest.fixture
def practising(open_browser, serve, studies):  # noqa: F811
    """`practising()` begins two tries at two warm-up terrains, one of which must do."""
    studies(pause_after_s=900, warm_up=2, ranked=1, practice={"episodes_to_pass": 1, "tries": 2})
    server = serve()

    def start():
        profile = open_browser((*NO_3D, *AS_A_PERSON)).new_context(reduced_motion="reduce")
        person = Participant(profile.new_page(), server.url).goto()
        person.to_questions()
        person.answer(RIGHT)
        person.stands("ready")
        return person

    return start


def look(person, name):
    assert judge(person.page, f"study-practice-{name}") == []


def gives_up(person):
    """Give the running episode up."""
    person.driving()
    person.choose("open-give-up")
    person.choose("give-up-now")


def reads(person, screen):
    return person.page.locator(f"section[data-screen={screen}]").inner_text()


def test_whoever_does_not_pass_tries_again_and_reads_why_it_is_over(practising):
    person = practising()
    assert "You pass the practice if at least 1 of its 2 terrains ends as “reached 99 %”." in reads(
        person, "ready"
    )
    look(person, "first")
    person.choose("begin")
    for is_last in (False, True):
        gives_up(person)
        person.page.get_by_test_id("end-card").wait_for(state="visible")
        person.wait("window.study.painted.participant.about.frame.outcome")
        card = person.page.get_by_test_id("end-card").inner_text()
        assert ("another try follows" in card) == is_last
        if is_last:
            look(person, "end")
        person.page.keyboard.press("Enter")
    person.stands("ready")
    assert "Warm-up, try 2 of 2" in reads(person, "ready")
    assert "The practice is not passed yet." in reads(person, "ready")
    look(person, "second")
    person.choose("begin")
    gives_up(person)
    person.page.get_by_test_id("end-card").wait_for(state="visible")
    person.wait("window.study.painted.participant.about.frame.outcome")
    person.page.keyboard.press("Enter")
    gives_up(person)
    person.stands("withdrawn")
    assert "The practice is over" in reads(person, "withdrawn")
    assert "The practice was not passed in the tries that this study allows" in reads(
        person, "withdrawn"
    )
    look(person, "failed")
    assert person.errors == []


def test_whoever_passes_goes_on_to_what_counts(practising):
    person = practising()
    person.choose("begin")
    person.driving()
    person.explore()
    person.page.keyboard.press("Enter")
    gives_up(person)
    person.page.get_by_test_id("end-card").wait_for(state="visible")
    person.wait("window.study.painted.participant.about.frame.outcome")
    assert (
        "That was the last terrain of the warm-up."
        in person.page.get_by_test_id("end-card").inner_text()
    )
    person.page.keyboard.press("Enter")
    person.stands("ready")
    assert "Now it counts" in reads(person, "ready")
    assert person.errors == []
