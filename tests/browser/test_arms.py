"""People of two arms, in a real browser: each reads what stands in their own."""

import pytest

from humanplay.study.folder import Folder
from tests.browser.test_study_page import RIGHT, Participant, studies  # noqa: F401
from tests.support.browser import AS_A_PERSON, NO_3D, judge

pytestmark = pytest.mark.timeout(900)

WALLS, MIDDLE = "Follow the walls first.", "Begin in the middle."


def question(text, answer):
    return {"question": text, "choices": ["Yes", "No"], "answer": answer}


ARMS = [
    {
        "name": "arm_one",
        "instructions": WALLS,
        "hint": "Walls first",
        "keys": {
            "north": ["KeyI", "Numpad8"],
            "east": ["KeyL", "Numpad6"],
            "south": ["KeyK", "Numpad2"],
            "west": ["KeyJ", "Numpad4"],
        },
        "questions": [question("Are the walls first?", 0)],
    },
    {
        "name": "arm_two",
        "instructions": MIDDLE,
        "hint": "The middle first",
        "questions": [question("Are the walls last?", 1)],
    },
]


def test_each_arm_reads_its_instructions_its_hint_and_its_question_and_has_its_keys(
    open_browser,
    serve,
    studies,  # noqa: F811
    tmp_path,
):
    studies(pause_after_s=900, arms=ARMS)
    study = Folder(tmp_path / "playground.db-studies").study("tiny")
    drawn = [study.arm("human", number) for number in range(4)]
    firsts = {drawn.index("arm_one"): ARMS, drawn.index("arm_two"): ARMS[::-1]}
    server = serve()
    for number in range(max(firsts) + 1):
        profile = open_browser((*NO_3D, *AS_A_PERSON)).new_context(reduced_motion="reduce")
        person = Participant(profile.new_page(), server.url)
        if number == drawn.index("arm_one"):
            delay_settings(person.page)
        with person.page.expect_request("**/settings"):
            person.goto()
        person.stands("consent")
        person.choose("agree")
        person.stands("instructions")
        if number in firsts:
            walk(person, *firsts[number])
        profile.close()


def delay_settings(page):
    """Have the settings that a page sends at first arrive during the consent."""
    late = []

    def consent(route):
        assert route.fetch().ok
        settings = late.pop()
        settings.fulfill(response=settings.fetch())
        route.fulfill(response=page.request.get(route.request.url.replace("/consent", "/me")))

    page.route("**/settings", lambda route: late.append(route), times=1)
    page.route("**/consent", consent)


def walk(person, arm, other):
    """Go on to the warm-up, and read what stands in one arm and not in the other."""
    instructions = person.page.get_by_test_id("instructions").inner_text()
    assert arm["instructions"] in instructions
    assert other["instructions"] not in instructions
    assert judge(person.page, f"study-{arm['name']}-instructions") == []
    person.choose("to-tutorial")
    person.driving()
    hint = person.page.get_by_test_id("hint")
    assert (hint.inner_text(), hint.is_visible()) == (arm["hint"], True)
    assert judge(person.page, f"study-{arm['name']}-board") == []
    if "keys" in arm:
        person.page.keyboard.press("ArrowRight")
        person.keys = {action: codes[0][-1].lower() for action, codes in arm["keys"].items()}
    person.press(person.next_action())
    assert person.frame["step"] == 1, "the keys of the other arm do not drive"
    person.explore()
    person.page.keyboard.press("Enter")
    person.stands("questions")
    quiz = person.page.locator("section[data-screen=questions]").inner_text()
    asked, others = (side["questions"][0] for side in (arm, other))
    assert asked["question"] in quiz
    assert others["question"] not in quiz
    assert arm["name"] not in person.page.content(), "nobody reads an arm's name"
    person.answer([*RIGHT, asked["answer"]])
    person.stands("ready")
