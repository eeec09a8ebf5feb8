"""A study in other languages: German on a phone, and very long words."""

import re

import pytest

from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.translation import collect
from marsexplorer.config import EnvConfig
from tests.browser.test_study_page import RIGHT, Participant
from tests.support.browser import AS_A_PERSON, NO_3D, keep_picture, violations
from tests.support.declared import DECLARATIONS
from tests.support.study import freeze, write_own
from tests.support.translated import OFFERED, pseudo
from tests.support.write_lock import locked_elsewhere

pytestmark = pytest.mark.timeout(900)
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
NARROW = {**PHONE, "viewport": {"width": 320, "height": 640}}
BLOCKS = ("demographics", "nasa-tlx")
SHORT = {
    "size": (6, 8), "warm_up": 1, "ranked": 2, "break_every": 1, "pause_after_s": 900, "outside_ids": (),
}  # fmt: skip
ENGLISH = re.compile(
    r"\b(the|and|your|you|with|terrains?|moves?|round|questions?|study|go on|keys)\b", re.IGNORECASE
)
CUT = """() => [...document.querySelectorAll("button, a, summary, legend, th")].filter((part) => {
  const box = part.getBoundingClientRect();
  if (!box.width || getComputedStyle(part).visibility === "hidden" || part.closest(".unseen, [data-keys]")) return false;
  return part.scrollWidth > part.clientWidth + 1 && part.clientWidth > 0 || box.right > innerWidth + 1 || box.left < -1;
}).map((part) => `${part.textContent.trim()} ${part.scrollWidth} > ${part.clientWidth}`)"""


@pytest.fixture
def arrive(open_browser, serve):
    """`arrive(language, context)` comes to the study "tiny" in a browser."""

    def start(language, context):
        browser = open_browser((*NO_3D, *AS_A_PERSON))
        profile = browser.new_context(reduced_motion="reduce", locale=language, **context)
        return Participant(profile.new_page(), serve().url).goto()

    return start


def walk(me, look):
    """Take part from the consent to the code, by keys, and look at each screen."""
    page = me.page
    me.stands("consent")
    look("consent")
    page.get_by_test_id("agree").click()
    answer_block(me, look, "demographics")
    me.stands("instructions")
    look("instructions")
    for dialog in ("settings", "leave", "elsewhere"):
        page.get_by_test_id(f"open-{dialog}").click()
        look(dialog)
        page.keyboard.press("Escape")
    page.get_by_test_id("to-tutorial").click()
    me.driving()
    look("tutorial")
    me.explore()
    look("tutorial-end")
    page.keyboard.press("Enter")
    me.stands("questions")
    look("questions")
    me.answer([1, 0, 0])
    page.get_by_test_id("quiz-status").wait_for()
    look("questions-wrong")
    me.answer(RIGHT)
    me.stands("ready")
    look("warm-up-ready")
    page.keyboard.press("Enter")
    me.driving()
    me.explore()
    look("warm-up-end")
    page.keyboard.press("Enter")
    me.stands("ready")
    look("ranked-ready")
    page.keyboard.press("Enter")
    me.driving()
    look("ranked")
    page.get_by_test_id("open-give-up").click()
    look("give-up")
    page.get_by_test_id("give-up-now").click()
    page.get_by_test_id("end-card").wait_for(state="visible")
    me.wait("window.study.painted.participant.about.frame.outcome")
    look("ranked-end")
    page.keyboard.press("Enter")
    me.stands("break")
    look("break")
    page.keyboard.press("Enter")
    me.driving()
    me.explore()
    page.keyboard.press("Enter")
    answer_block(me, look, "nasa_tlx")
    me.stands("debrief")
    page.get_by_test_id("replay").wait_for()
    look("debrief")
    page.get_by_test_id("finish").click()
    me.stands("complete")
    look("complete")


def answer_block(me, look, name):
    """Answer a block of questions: whoever is asked of says nothing of themselves."""
    me.stands("block")
    me.wait(f"window.study.state.participant.block.name === '{name}'")
    look(name)
    if name == "nasa_tlx":
        me.page.get_by_test_id("skip-blocks").click()
        return
    me.page.get_by_test_id("send-block").click()  # nothing is answered yet
    look(f"{name}-faults")
    for decline in me.page.locator("[data-decline], input[value=declined]").all():
        decline.check()
    me.page.get_by_test_id("send-block").click()


def test_german_is_played_on_a_phone_from_consent_to_code(arrive, tmp_path):
    freeze(tmp_path / "playground.db-studies", "tiny", blocks=BLOCKS, **{**SHORT, **OFFERED})
    me = arrive("en-GB", PHONE)
    me.stands("consent")
    assert me.page.locator("html").get_attribute("lang") == "en"
    me.page.get_by_test_id("language-de").click()
    me.page.locator("html[lang=de]").wait_for(state="attached")
    me.wait("window.study && !['loading'].includes(window.study.screen)")
    seen, faults, english = [], [], []

    def look(name):
        seen.append(name)
        text = me.page.locator("body").inner_text()
        english.extend((name, word) for word in ENGLISH.findall(text))
        faults.extend((name, violation) for violation in violations(me.page))
        if (width := me.page.evaluate("() => document.documentElement.scrollWidth")) > 390:
            faults.append((name, "scrolls sideways", width))
        keep_picture(me.page, f"study-german-{name}-390", full_page=True)

    walk(me, look)
    assert english == [], "what is left in English"
    assert faults == [], "what axe finds"
    assert len(seen) == 21
    assert me.page.get_by_text("Das ist Ihr Abschlusscode:").is_visible()
    assert re.fullmatch(r"[A-Z0-9-]{6,}", me.page.get_by_test_id("code").inner_text())
    score = me.page.evaluate("() => new Intl.NumberFormat('de').format(1.5)")
    assert score == "1,5"


def test_the_language_of_the_browser_is_preselected_and_refusals_are_in_it(arrive, tmp_path):
    freeze(
        tmp_path / "playground.db-studies", "tiny", **{**SHORT, **OFFERED}, recruitment="invitation"
    )
    me = arrive("es-ES", PHONE)
    me.stands("problem")
    text = me.page.get_by_test_id("problem").inner_text()
    assert "Aquí no puede continuar" in text
    assert "Este estudio es por invitación: abra el enlace que recibió." in text


def test_what_comes_over_the_socket_is_in_the_language_of_the_page(arrive, tmp_path):
    freeze(tmp_path / "playground.db-studies", "tiny", **{**SHORT, **OFFERED})
    me = arrive("de-DE", PHONE)
    me.stands("consent")
    me.page.get_by_test_id("agree").click()
    me.page.get_by_test_id("to-tutorial").click()
    me.driving()
    with locked_elsewhere(tmp_path / "playground.db"):
        me.page.keyboard.press("ArrowRight")
        notice = me.page.get_by_test_id("notices").get_by_text("Ihr Zug wartet")
        notice.wait_for()
        keep_picture(me.page, "study-german-waits-390")
    stalled = cards(me.page, {"reason": "x", "ident": "clock.stalled", "values": {}})
    assert stalled.startswith("Der Server kam einen Moment lang nicht nach")


def cards(page, clock):
    """What the card of a board on a clock says."""
    return page.evaluate(
        """async (clock) => {
          const loaded = performance.getEntriesByType("resource").map(({ name }) => name);
          const { cardOf } = await import(loaded.find((name) => name.includes("common/clock.js")));
          return cardOf({ state: "standing", ...clock }, { outcome: null, step: 1 }, 30, false, 0).line;
        }""",
        clock,
    )


def test_words_as_long_as_no_language_has_them_fit_at_320_pixels(arrive, tmp_path):
    folder = Folder(tmp_path / "playground.db-studies")
    freeze_pseudo(folder)
    me = arrive("qps", NARROW)
    assert me.page.locator("html").get_attribute("lang") == "qps"
    faults = []

    def look(name):
        width = me.page.evaluate("() => document.documentElement.scrollWidth")
        if width > 320:
            faults.append((name, "scrolls sideways", width))
        faults.extend((name, cut) for cut in me.page.evaluate(CUT))
        keep_picture(me.page, f"study-pseudo-{name}-320", full_page=True)

    walk(me, look)
    assert faults == [], "\n".join(map(str, faults))


def freeze_pseudo(folder):
    """Freeze the study "tiny" in a language that nobody speaks."""
    declared = {"translated_by": "the test", "checked_by": "nobody", "declarations": DECLARATIONS}
    rest = {name: part for name, part in SHORT.items() if name != "size"}
    protocol = default_protocol(
        "tiny", EnvConfig.of("random", SHORT["size"]), blocks=BLOCKS, languages=("en", "qps"), **declared, **rest
    )  # fmt: skip
    folder.create(protocol)
    missing = collect(folder.draft("tiny"), folder.path("tiny"), "qps").missing
    words = {ident: pseudo(text) for ident, text in missing.items()}
    write_own(folder.path("tiny"), "qps", words)
    folder.freeze("tiny")
