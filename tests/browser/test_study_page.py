"""A participant in a study in a real browser.

By keyboard alone, with reloads, a second tab and a killed server.
"""

import json
import sqlite3

import pytest

from humanplay.study.folder import Folder
from humanplay.study.outcomes import change_texts
from humanplay.study.protocol import default_protocol
from humanplay.tasks.mars.run import occupancy_codes
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D, SIZES, Player, judge, violations
from tests.support.declared import DECLARATIONS
from tests.support.servers import eventually

ACTIONS = ("north", "east", "south", "west")
RIGHT = [0, 1, 1]
LISTEN = """const ask = window.fetch;
window.fetch = async (...how) => {
  const answer = await ask(...how);
  answer.clone().text().then(window.marsReceives, () => {});
  return answer;
};"""
COLOURFUL = ("consent", "settings", "tutorial", "questions-wrong", "ranked-end", "debrief")
"""Screens that between them wear every colour."""


@pytest.fixture
def studies(tmp_path):
    """`studies(...)` freezes the study "tiny" with some fields.

    It returns the folder.
    """

    def make(size=(6, 8), **rest):
        folder = Folder(tmp_path / "playground.db-studies")
        config, back = EnvConfig.of("random", size), "https://example.org/done?cc={code}"
        rest = {
            "warm_up": 1,
            "ranked": 2,
            "break_every": 1,
            "outside_ids": ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID"),
            "declarations": DECLARATIONS,
            **rest,
        }
        protocol = default_protocol("tiny", config, title="A tiny study", **rest)
        folder.create(protocol)
        change_texts(folder.path("tiny"), protocol, {"finished": back}, is_frozen=False)
        folder.freeze("tiny")
        return str(folder.root)

    return make


class Participant(Player):
    """A person on the study's page who uses the keyboard.

    `received` is everything that came over the network.
    """

    def __init__(self, page, url, query=""):
        super().__init__(page, url)
        self.query, self.keys, self.received = query, KEY_OF, []
        self.policy = policies.load("frontier-cost")
        page.on("websocket", lambda socket: socket.on("framereceived", self._receive))
        page.expose_function("marsReceives", self._receive)
        page.add_init_script(LISTEN)

    def _receive(self, text):
        self.received.append(json.loads(text))

    def goto(self):
        self.page.goto(f"{self.url}/study/tiny{self.query}")
        self.wait("window.study && !['loading'].includes(window.study.screen)")
        return self

    def stands(self, screen):
        """Wait for a screen, painted."""
        self.wait(f"window.study.screen === '{screen}'")
        self.wait(f"document.body.dataset.screen === '{screen}'")

    def state(self, path):
        return self.page.evaluate(f"() => window.study.state.{path}")

    @property
    def frame(self):
        return self.state("game.player.frame")

    def tab_to(self, test_id):
        """Move the focus with Tab alone."""
        for _ in range(60):
            if self.page.evaluate("() => document.activeElement?.dataset.testid") == test_id:
                return
            self.page.keyboard.press("Tab")
        raise AssertionError(f"Tab never reaches {test_id}")

    def choose(self, test_id):
        self.tab_to(test_id)
        self.page.keyboard.press("Enter")

    def press(self, action):
        self.wait("window.study.state.game.link === 'open'")
        step = self.frame["step"]
        self.hand.press(self.page.keyboard, self.keys[action])
        # the next key tells the step on the screen
        self.wait(f"window.study.painted?.game.player.frame.step > {step}")

    def wake(self):
        """Go on, if stillness has paused the board meanwhile."""
        self.page.keyboard.press("Shift")
        if self.state("isPaused"):
            self.page.keyboard.press("ArrowRight")
            self.wait("!window.study.state.isPaused")

    def next_action(self):
        return ACTIONS[self.policy.act(occupancy_codes(self.frame))]

    def explore(self):
        """Drive until the episode ends."""
        self.policy.reset(0)
        self.wake()
        while self.frame["outcome"] is None:
            self.press(self.next_action())
        self.page.get_by_test_id("end-card").wait_for(state="visible")
        self.wait("window.study.painted.participant.about.frame.outcome")
        return self.frame

    def driving(self):
        """Wait until a board takes keys."""
        self.stands("play")
        self.wait("window.study.state.game.player.frame.outcome === null")
        self.wait("window.study.state.game.link === 'open'")

    def to_questions(self):
        """Walk from the consent to the questions."""
        self.stands("consent")
        self.choose("agree")
        self.stands("instructions")
        self.choose("to-tutorial")
        self.driving()
        self.explore()
        self.page.keyboard.press("Enter")
        self.stands("questions")

    def answer(self, answers):
        """Choose with Tab, the arrows and space, then check."""
        for number, answer in enumerate(answers):
            self.page.locator(f"[name=q{number}]").first.focus()
            self.page.keyboard.press("Space")
            for _ in range(answer):
                self.page.keyboard.press("ArrowDown")
            assert self.page.locator(f"[name=q{number}]").nth(answer).is_checked()
        self.choose("answer")

    def to_ranked(self):
        """Walk from the consent to the first ranked terrain."""
        self.to_questions()
        self.answer(RIGHT)
        self.stands("ready")
        self.page.keyboard.press("Enter")
        self.driving()
        self.explore()
        self.page.keyboard.press("Enter")
        self.stands("ready")
        self.page.keyboard.press("Enter")
        self.driving()


def frames_in(message):
    """Every frame anywhere in a message."""
    if isinstance(message, dict):
        if message.get("kind") == "frame":
            yield message
        for value in message.values():
            yield from frames_in(value)
    elif isinstance(message, list):
        for value in message:
            yield from frames_in(value)


class Screens:
    """Checks the screens of a participant's page with axe.

    Collects the problems of each, and pictures.
    """

    def __init__(self, me):
        self.page = me.page
        self.found, self.seen = [], []

    def look(self, name):
        """Judge a screen at both sizes, and its colours in the other palettes."""
        self.seen.append(name)
        self.found += judge(self.page, f"study-{name}")
        for palette in ("colour-blind", "high-contrast", "standard") if name in COLOURFUL else ():
            self.page.evaluate(f"document.documentElement.dataset.palette = '{palette}'")
            if palette != "standard":
                problems = violations(self.page, runOnly=["color-contrast"])
                self.found += [f"{name}, {palette}: {problem}" for problem in problems]

    def dialog(self, name):
        """Open a dialog, judge it and close it."""
        self.page.get_by_test_id(f"open-{name}").click()
        self.look(name)
        self.page.keyboard.press("Escape")

    def have_nothing_that_axe_finds(self, count):
        """Check what was found on so many screens."""
        assert self.found == []
        assert len(self.seen) == count


@pytest.fixture
def participant(open_browser):
    """`participant(server, ...)` opens the study's page in a fresh browser profile."""

    def start(server, flags=(*NO_3D, *AS_A_PERSON), size="desktop", query="", **context):
        width, height = SIZES[size]
        browser = open_browser(list(flags))
        context = browser.new_context(viewport={"width": width, "height": height}, **context)
        return Participant(context.new_page(), server.url, query).goto()

    return start


def rows(tmp_path, query, *values):
    with sqlite3.connect(tmp_path / "playground.db") as connection:
        return connection.execute(query, values).fetchall()


def test_from_consent_to_code_by_keyboard_alone_through_reload_second_tab_and_restart(
    spawn, studies, participant, tmp_path
):
    """The whole of a study, every screen of it judged by axe on the way."""
    studies(pause_after_s=900)  # a slow machine may restart for longer than a minute
    server = spawn()
    me = participant(server, query="?PROLIFIC_PID=p-77&unknown=1", reduced_motion="reduce")
    screens = Screens(me)
    learn_and_answer(me, screens)
    me.stands("ready")
    screens.look("warm-up-ready")
    me.page.keyboard.press("Enter")
    me.driving()
    screens.look("warm-up")
    warm_up = me.explore()
    screens.look("warm-up-end")
    assert warm_up["score"] is not None
    assert f"{warm_up['score']:.3f}" in me.page.get_by_test_id("end-figures").inner_text()
    me.page.keyboard.press("Enter")
    me.stands("ready")
    screens.look("ranked-ready")
    me.page.keyboard.press("Enter")
    me.driving()

    first = me.frame["episode"]
    me.policy.reset(0)
    me.press(me.next_action())
    screens.look("ranked")
    screens.dialog("give-up")
    frame = me.frame
    me.page.reload()
    me.driving()
    assert me.frame == frame, "a reload goes on in the same episode at the same step"

    tab = Participant(me.page.context.new_page(), me.url)
    tab.goto().driving()
    assert tab.frame == frame
    tab.press(tab.next_action())
    me.wait(f"window.study.state.game.player.frame.step === {frame['step'] + 1}")
    tab.page.close()
    assert me.explore()["episode"] == first
    assert "Score" not in me.page.get_by_test_id("end-figures").inner_text()
    screens.look("ranked-end")

    me.page.keyboard.press("Enter")
    me.stands("break")
    screens.look("break")
    me.page.keyboard.press("Enter")
    me.driving()
    second = me.frame["episode"]
    me.policy.reset(0)
    me.press(me.next_action())
    frame = me.frame
    server.kill()
    me.wait("window.study.state.game.link === 'lost'", 3_000)
    eventually(lambda: "lost" in me.page.get_by_test_id("link").inner_text())
    server = spawn(port=server.port)
    me.driving()
    assert me.frame == frame, "a restarted server goes on in the same episode at the same step"
    hidden_until = len(me.received)
    me.explore()
    me.page.keyboard.press("Enter")

    me.stands("debrief")
    assert me.page.get_by_test_id("own-score").inner_text().startswith("0.")
    me.page.get_by_test_id("replay").wait_for(state="visible")
    screens.look("debrief")
    me.choose("replay-step")
    me.wait("window.study.state.replay.playback.at === 1")
    me.choose("replay-play")
    me.wait("window.study.state.replay.playback.at > 3")
    me.page.reload()
    me.stands("debrief")
    me.choose("finish")
    me.stands("complete")
    code = me.page.get_by_test_id("code").inner_text()
    assert [code] == [row[0] for row in rows(tmp_path, "select completion_code from participants")]
    back = me.page.get_by_test_id("return").get_attribute("href")
    assert back == f"https://example.org/done?cc={code}"
    screens.look("complete")
    me.page.reload()
    me.stands("complete")
    assert me.page.get_by_test_id("code").inner_text() == code

    frames = list(frames_in([*me.received[:hidden_until], *tab.received]))
    ranked = [frame for frame in frames if frame["episode"] in (first, second)]
    assert len(ranked) > 10
    assert {(f["reward"], f["return"], f["score"]) for f in ranked} == {(None, None, None)}
    check_database(tmp_path, first, second)
    screens.have_nothing_that_axe_finds(19)
    assert me.errors == []
    assert tab.errors == []


def learn_and_answer(me, screens):
    """Go from the consent to the right answers, through dialogs and a wrong answer."""
    me.stands("consent")
    screens.look("consent")
    me.choose("agree")
    me.stands("instructions")
    screens.look("instructions")
    screens.dialog("settings")
    screens.dialog("leave")
    me.choose("to-tutorial")
    me.driving()
    screens.look("tutorial")
    screens.dialog("map")
    me.explore()
    screens.look("tutorial-end")
    me.page.keyboard.press("Enter")
    me.stands("questions")
    screens.look("questions")
    asked = me.page.get_by_test_id("question-2").inner_text()
    assert "complete the same terrain, and know equally many cells" in asked, "else it is not so"
    me.page.locator("#rules summary").click()
    rules = me.page.locator("#rules").inner_text()
    assert "on the same terrain, fewer moves for the same cells score higher" in rules
    me.answer([0, 0, 1])
    me.page.get_by_text("1 answer is not right yet.").wait_for()
    verdict = me.page.locator("[data-testid=question-1] .verdict").inner_text()
    assert "the rover need not drive everywhere" in verdict
    screens.look("questions-wrong")
    me.answer(RIGHT)


def check_database(tmp_path, first, second):
    """The report's data are stored: one human, no terrain twice, each driving key."""
    assert rows(tmp_path, "select kind, stage from participants") == [("human", "complete")]
    assert rows(tmp_path, "select name, value from identities") == [("PROLIFIC_PID", "p-77")]
    sql = "select phase, trial from series_episodes join episodes on id = episode_id where driver = 'human' order by number"
    assert rows(tmp_path, sql) == [("tutorial", 0), ("warm_up", 0), ("ranked", 0), ("ranked", 1)]
    by_key = "select step from steps where episode_id = ? and input = 'key'"
    shown = "kind, code, repeat, trusted, client_ms, step, round_trip_ms"
    query = f"select {shown} from input_events where episode_id = ? order by number"
    for episode in (first, second):
        moves, events = rows(tmp_path, by_key, episode), rows(tmp_path, query, episode)
        down = [event for event in events if event[0] == "keydown"]
        assert len(down) >= len(moves)
        assert {event[3] for event in down} == {1}
        assert {event[1] for event in down} <= set(KEY_OF.values())
        assert any(event[6] is not None and 0 < event[6] < 5_000 for event in down)
        assert {event[5] for event in down} >= set(range(len(moves)))
        # the key that ended it comes up after the end
        assert sum(event[0] == "keyup" for event in events) >= len(moves) - 1
    (settings,) = rows(tmp_path, "select settings from participants")
    assert json.loads(settings[0])["modality"] == "keyboard"


def test_remapped_keys_drive_and_colours_change_and_both_are_kept(
    serve, studies, participant, tmp_path
):
    studies()
    server = serve()
    me = participant(server)
    me.choose("agree")
    me.stands("instructions")
    me.choose("open-settings")
    me.choose("key-east-0")
    me.page.keyboard.press("Tab")
    me.tab_to("key-east-0")
    me.page.keyboard.press("Enter")
    me.page.keyboard.press("F5")
    assert "cannot be chosen" in me.page.get_by_test_id("key-status").inner_text()
    me.page.keyboard.press("l")
    assert me.page.get_by_test_id("key-east-0").inner_text() == "L"
    ground = me.page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    me.tab_to("palette-standard")
    me.page.keyboard.press("ArrowUp")
    assert me.page.evaluate("() => document.documentElement.dataset.palette") == "high-contrast"
    me.page.keyboard.press("Escape")
    black = me.page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    assert black == "rgb(0, 0, 0)" != ground
    me.choose("to-tutorial")
    me.driving()
    me.page.keyboard.press("ArrowRight")
    me.keys = {**KEY_OF, "east": "l"}
    me.press("east")  # the old key drives no more, the new one does
    assert (me.frame["step"], me.frame["position"]) == (1, [0, 1])
    eventually(lambda: chosen(tmp_path) == ("high-contrast", ["KeyL", "KeyD"]))
    pixel = "() => [...document.querySelector('#board').getContext('2d').getImageData(3, 3, 1, 1).data].slice(0, 3)"
    assert me.page.evaluate(pixel) == [0x6E, 0x6E, 0x6E], "the board wears the palette"
    assert me.errors == []


def test_a_study_without_questions_goes_on_to_its_warm_up(serve, studies, participant):
    studies(questions=())
    me = participant(serve())
    me.choose("agree")
    me.stands("instructions")
    me.choose("to-tutorial")
    me.driving()
    me.press("north")  # over the edge
    me.page.get_by_test_id("next").get_by_text("Go on", exact=True).wait_for()
    me.wait("window.study.painted.participant.about.frame.outcome")
    me.page.keyboard.press("Enter")
    me.stands("ready")
    assert me.state("participant.stage") == "warm_up"
    assert me.errors == []


def chosen(tmp_path):
    """The palette and the keys to the east that the server keeps."""
    (settings,) = rows(tmp_path, "select settings from participants")[0]
    stored = json.loads(settings)
    return stored.get("palette"), (stored.get("keys") or {}).get("east")


def test_the_last_choice_is_kept_though_calls_are_slow_and_the_page_goes_at_once(
    serve, studies, participant, tmp_path
):
    studies()
    server = serve()
    me = participant(server)
    held = []
    me.page.route("**/settings", lambda route: route.continue_() if held else held.append(route))
    me.choose("open-settings")
    me.tab_to("palette-standard")
    me.page.keyboard.press("ArrowDown")
    eventually(lambda: me.page.evaluate("() => 1") and held)
    me.page.keyboard.press("ArrowDown")
    me.page.wait_for_timeout(600)
    assert chosen(tmp_path)[0] != "high-contrast", "one call at a time"
    held[0].continue_()
    eventually(lambda: me.page.evaluate("() => 1") and chosen(tmp_path)[0] == "high-contrast")
    me.page.unroute("**/settings")
    me.page.keyboard.press("ArrowDown")
    me.page.goto("about:blank")
    eventually(lambda: chosen(tmp_path)[0] == "standard")
    assert me.errors == []


def test_stillness_pauses_and_the_key_that_goes_on_does_not_move(
    serve, studies, participant, tmp_path
):
    studies(pause_after_s=3)
    server = serve()
    me = participant(server, reduced_motion="reduce")
    me.choose("agree")
    me.stands("instructions")
    me.choose("to-tutorial")
    me.driving()
    me.page.get_by_test_id("pause").wait_for(state="visible")
    screens = Screens(me)
    screens.look("paused")
    screens.have_nothing_that_axe_finds(1)
    me.page.reload()
    me.stands("play")
    assert me.page.get_by_test_id("pause").is_visible(), "a reload finds it paused"
    me.page.keyboard.press("ArrowRight")
    me.page.get_by_test_id("pause").wait_for(state="hidden")
    assert me.frame["step"] == 0
    me.wake()
    me.press("east")
    assert me.frame["position"] == [0, 1]
    kinds = (
        "select kind, page_load from input_events where kind in ('pause', 'resume') order by number"
    )
    events = [("pause", 0), ("pause", 1), ("resume", 1)]
    eventually(lambda: rows(tmp_path, kinds)[:3] == events)
    assert me.errors == []


def test_giving_up_asks_first_and_leaving_ends_it(serve, studies, participant, tmp_path):
    studies(ranked=3, break_every=10)
    server = serve()
    me = participant(server, reduced_motion="reduce")
    me.to_ranked()
    me.choose("open-give-up")
    assert "never cheaper" in me.page.get_by_test_id("give-up").inner_text()
    me.page.keyboard.press("ArrowRight")
    me.page.keyboard.press("Escape")
    assert (me.frame["outcome"], me.frame["step"]) == (None, 0), "behind a question keys do nothing"
    me.choose("open-give-up")
    me.choose("give-up-now")
    me.wait("window.study.state.game.player.frame.outcome === 'abandoned'")
    last = "select outcome from episodes order by number desc limit 1"
    assert rows(tmp_path, last) == [("abandoned",)]
    me.page.get_by_test_id("end-card").wait_for(state="visible")
    me.wait("window.study.painted.participant.about.frame.outcome")
    me.page.keyboard.press("Enter")
    me.driving()
    assert me.frame["step"] == 0
    me.choose("open-leave")
    me.choose("leave-now")
    me.stands("withdrawn")
    assert rows(tmp_path, "select stage from participants") == [("withdrawn",)]
    screens = Screens(me)
    screens.look("withdrawn")
    screens.have_nothing_that_axe_finds(1)
    assert me.errors == []


HOLD_NEXT = """() => {
  const own = window.fetch
  window.held = []
  window.fetch = async (path, options) => {
    const answer = await own(path, options)
    if (String(path).endsWith("/next")) await new Promise((go) => window.held.push(go))
    return answer
  }
}"""


def test_leaving_waits_for_the_answer_that_is_due(serve, studies, participant, tmp_path):
    """The socket may show the next board before the request that began it is answered."""
    studies(ranked=3, break_every=10)
    server = serve()
    me = participant(server, reduced_motion="reduce")
    me.to_ranked()
    me.choose("open-give-up")
    me.choose("give-up-now")
    me.page.get_by_test_id("end-card").wait_for(state="visible")
    me.wait("window.study.painted.participant.about.frame.outcome")
    me.page.evaluate(HOLD_NEXT)
    me.page.keyboard.press("Enter")
    me.driving()
    me.choose("open-leave")
    me.choose("leave-now")
    me.wait("window.held.length === 1")
    assert rows(tmp_path, "select stage from participants") == [("ranked",)]
    me.page.evaluate("window.held[0]()")
    me.stands("withdrawn")
    assert rows(tmp_path, "select stage from participants") == [("withdrawn",)]
    assert me.errors == []


def test_fingers_drive_on_a_phone(serve, studies, participant, tmp_path):
    studies()
    server = serve()
    me = participant(server, size="phone", has_touch=True, is_mobile=True)
    me.page.get_by_test_id("agree").tap()
    me.page.get_by_test_id("to-tutorial").tap()
    me.driving()
    me.page.get_by_test_id("pad-east").tap()
    me.wait("window.study.state.game.player.frame.step === 1")
    query = "select kind, code from input_events where kind like 'touch%' order by number"
    eventually(lambda: rows(tmp_path, query) == [("touchdown", "east"), ("touchup", "east")])
    query = "select json_extract(settings, '$.modality') from participants"
    eventually(lambda: rows(tmp_path, query) == [("touch",)])
    assert me.errors == []


def test_a_closed_and_an_unknown_study_say_so(serve, studies, participant):
    folder = studies()
    server = serve()
    me = participant(server)
    me.choose("agree")
    me.stands("instructions")
    Folder(folder).close("tiny")
    me.choose("to-tutorial")
    me.stands("problem")
    assert "closed" in me.page.get_by_test_id("problem").inner_text()
    me.page.reload()
    me.stands("problem")
    assert "closed" in me.page.get_by_test_id("problem").inner_text()
    me.page.goto(f"{server.url}/study/nowhere")
    me.page.get_by_test_id("problem").wait_for(state="visible")
    assert "no such study" in me.page.get_by_test_id("problem").inner_text()


def test_axe_finds_nothing_on_the_playground(serve, player):
    server = serve()
    me = player(server, NO_3D, reduced_motion="reduce")
    me.goto()
    problems = []
    for mode in ("watch", "ranked", "practice"):
        me.page.get_by_test_id(f"mode-{mode}").click()
        me.wait(f"window.playground.state.mode === '{mode}'")
        me.wait("window.playground.state.player.frame.outcome === null")
        problems += judge(me.page, mode)
    eventually(lambda: me.page.keyboard.press("ArrowUp") or me.state()["outcome"])
    problems += judge(me.page, "end")
    me.page.get_by_test_id("open-settings").click()
    problems += judge(me.page, "terrain-dialog")
    me.page.close()
    other = player(server, (), 1100, 700, reduced_motion="reduce")
    # small boards on a small screen: the processor draws both
    other.begin(size=[9, 12], rival="frontier-cost")
    other.page.frame_locator("[data-testid=viewer-player]").locator("canvas").first.wait_for()
    assert problems + violations(other.page) == []
