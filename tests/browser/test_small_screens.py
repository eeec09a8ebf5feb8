"""Screens of 320 x 640 are whole, and the live view draws its curve."""

import pytest

from humanplay.db.store import Store
from marsexplorer.config import EnvConfig
from tests.browser.test_study_page import Participant
from tests.support.browser import ANIMATED, AS_A_PERSON, NO_3D
from tests.support.fresh_machine import fresh_server
from tests.support.recorded import play
from tests.support.servers import RunningServer, eventually
from tests.support.study import freeze

SMALL = (320, 640)
PASSWORD = "red-planet-4"
CARD_IS_BESIDE = """() => {
    const board = document.querySelector(".field canvas").getBoundingClientRect();
    const { top, left } = document.getElementById("end").getBoundingClientRect();
    return top >= board.bottom || left >= board.right;
}"""
"""Whether the card at the end of an episode covers no part of its board."""
ROWS_OF_TEXT = """(row) => [...row.cells].map((cell) => {
    const range = new Range();
    range.selectNodeContents(cell);
    const rows = new Set([...range.getClientRects()].map(({ bottom }) => Math.round(bottom)));
    return rows.size;
})"""
"""How many lines of text a table's row has in its cells, none where a cell is not shown."""
ROWS_ARE_FULL = """() => {
    const right = (part) => Math.round(document.querySelector(part).getBoundingClientRect().right);
    const ends = new Map();
    for (const part of document.querySelectorAll(".pictures li, .play-on:not([hidden])")) {
        const { top, right: end } = part.getBoundingClientRect();
        ends.set(Math.round(top), Math.round(end));
    }
    const panels = [...document.querySelectorAll("main > section:not([hidden], #streaks-part)")];
    const edges = new Set(panels.map((part) => Math.round(part.getBoundingClientRect().right)));
    return edges.size === 1 && [...ends.values()].every((end) => Math.abs(end - right(".gallery")) <= 1);
}"""
"""Whether every row of pictures ends where the others do, and so does every panel."""
COVERED = """(covers) => {
    const shown = (part) => part.checkVisibility() && part.getBoundingClientRect().width > 0;
    const over = covers.flatMap((name) => [...document.querySelectorAll(name)]).filter(shown);
    const parts = document.querySelectorAll("a, button, input, select, .goal, .standing");
    return [...parts].filter(shown).filter((part) => !over.some((cover) => cover.contains(part))).filter((part) => {
        const [here, rest] = [part.getBoundingClientRect(), over.map((cover) => cover.getBoundingClientRect())];
        return rest.some(({ left, right, top, bottom }) =>
            here.left < right && here.right > left && here.top < bottom && here.bottom > top);
    }).map((part) => part.closest(".pad, .modes, .goal")?.className.split(" ")[0] ?? part.textContent.trim());
}"""
"""The names of what can be pressed or says what to do, where something stands over it."""
CUT = "(part) => part.scrollWidth > part.clientWidth || part.scrollHeight > part.clientHeight"


@pytest.fixture
def small(serve, player, tmp_path):
    """Somebody with a small phone, at a server with a study and an episode."""
    freeze(tmp_path / "playground.db-studies", "tiny", recruitment="open")
    store = Store(tmp_path / "playground.db")
    ended = play(store, 4, config=EnvConfig.of("random", 21), explore=True)
    store.close()
    me = player(
        serve(admin_password=PASSWORD), [*NO_3D, *AS_A_PERSON], *SMALL, is_new=True, has_touch=True
    )
    me.ended = ended.id
    return me


def bottom(part):
    box = part.bounding_box()
    return box["y"] + box["height"]


def test_on_a_small_phone_a_puzzle_is_answered_and_its_answer_read_without_scrolling(small):
    page = small.page
    page.goto(f"{small.url}/puzzles")
    small.wait("window.puzzles?.today && document.body.dataset.state === 'ready'")
    top = page.locator(".site").bounding_box()["y"]
    for part in ("#question", ".pad"):
        assert bottom(page.locator(part)) <= top, part
    board = page.get_by_test_id("board")
    eventually(lambda: board.bounding_box()["width"] >= 250)  # the arrows are one row
    page.locator(".pad button:enabled").first.click()
    page.get_by_test_id("verdict").wait_for()
    for width, height in ((820, 1180), (390, 844), SMALL):
        page.set_viewport_size({"width": width, "height": height})
        foot = page.locator(".site").bounding_box()["y"] if width < 480 else height
        # once the board is drawn anew
        eventually(lambda foot=foot: bottom(page.get_by_test_id("next")) <= foot)
    for _ in range(2):
        page.get_by_test_id("next").click()
        page.locator(".pad button:enabled").first.click()
        page.get_by_test_id("verdict").wait_for()
    page.get_by_test_id("done").wait_for()
    eventually(lambda: bottom(page.locator(".done .buttons")) <= top)
    ways = [way.bounding_box()["y"] for way in page.locator(".done .buttons > *").all()]
    assert len(ways) == 3, "to today's terrain, to share it, and to play"
    assert len(set(ways)) == 1, "one row"


@pytest.mark.alone  # other tests leave no processor to what compiles at the lowest priority
def test_on_a_fresh_machine_the_board_says_why_it_waits_and_nothing_to_press_is_covered(
    player, tmp_path
):
    with fresh_server(tmp_path / "cache", tmp_path / "moves.db") as (_, port):
        me = player(RunningServer(port), [*NO_3D, *AS_A_PERSON], *SMALL, is_new=True)
        page = me.page
        page.goto(f"{me.url}/")
        waits = page.get_by_test_id("waits-player")
        waits.get_by_text("Getting ready: this is compiled for this machine once").wait_for()
        for width, height in ((1440, 900), (820, 1180), (390, 844), SMALL):
            page.set_viewport_size({"width": width, "height": height})
            assert page.evaluate(COVERED, ["[data-testid^=waits]", ".notices p"]) == [], width
        me.wait("window.playground.state.player && window.playground.state.link === 'open'")
        me.shows("waits-player", "")


def test_on_a_phone_a_notice_leaves_the_goal_and_the_arrows_in_sight(small):
    page = small.page
    page.goto(f"{small.url}/?level=nowhere")
    small.wait("window.playground.state.player && window.playground.state.link === 'open'")
    page.get_by_test_id("notices").get_by_text("What this address asks for").wait_for()
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        covered = page.evaluate(COVERED, [".notices"])
        assert not {"goal", "pad"} & set(covered), width


def test_on_a_phone_the_prompt_covers_no_cell_of_the_board(small):
    page = small.page
    small.goto()
    for path in ("/", "/daily"):
        if path != "/":
            page.goto(f"{small.url}{path}")
        small.wait("window.playground.state.player && window.playground.state.link === 'open'")
        prompt = page.locator(".prompt:not([hidden])").first
        prompt.wait_for()
        for width, height in (SMALL, (390, 844)):
            page.set_viewport_size({"width": width, "height": height})
            canvas = page.locator(".board[data-role=player] .matrix canvas").first
            eventually(lambda c=canvas, p=prompt: bottom(c) <= p.bounding_box()["y"])
            pad, foot = page.locator(".pad").bounding_box(), page.locator(".site").bounding_box()
            assert bottom(prompt) <= pad["y"], (path, width)
            assert pad["y"] + pad["height"] <= foot["y"], (path, width)
            assert canvas.bounding_box()["width"] >= 210, (path, width)
    assert page.get_by_test_id("standing").is_visible()
    assert page.get_by_test_id("standing").inner_text() == "One attempt: your first move starts it."


def test_beside_a_policy_every_screen_says_what_to_do_until_the_first_move(small):
    page = small.page
    small.goto()
    page.evaluate("() => localStorage.setItem('humanplay.visited', 'yes')")
    page.reload()
    small.wait("document.body.dataset.boards === '2' && window.playground.state.rival")
    goal, pad = page.get_by_test_id("goal"), page.locator(".pad")
    for width, height in ((1440, 900), (1024, 768), (820, 1180), (390, 844), SMALL):
        page.set_viewport_size({"width": width, "height": height})
        foot = page.locator(".site").bounding_box()["y"] if width < 480 else height
        eventually(lambda foot=foot: 0 < bottom(goal) <= foot)
        if width <= 480:
            assert bottom(pad) <= goal.bounding_box()["y"], "no arrow moves when it goes"
            assert page.get_by_test_id("tab-rival").inner_text() == "Expert: 0 moves"
    before = pad.bounding_box()
    small.press("east")
    goal.wait_for(state="hidden")
    assert pad.bounding_box() == before


def test_before_a_ranked_episode_every_screen_says_that_it_counts(small):
    page = small.page
    page.goto(f"{small.url}/?mode=ranked")
    small.wait("window.playground?.state.counts && window.playground.state.link === 'open'")
    line = page.get_by_test_id("standing")
    for width, height in (SMALL, (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        text = "This ranked episode counts from your first move on, however it ends."
        eventually(lambda text=text: line.inner_text() == text)
        assert line.is_visible()
        pad, foot = page.locator(".pad"), page.locator(".site")
        eventually(lambda p=pad, f=foot: bottom(p) <= f.bounding_box()["y"])
        mode = page.get_by_test_id("mode-ranked").locator(".short")
        assert "counts" in mode.evaluate("(part) => getComputedStyle(part, '::after').content")
        assert page.evaluate("document.documentElement.scrollWidth") == width
    page.set_viewport_size({"width": 1024, "height": 768})
    badge = page.get_by_test_id("badge")
    eventually(lambda: badge.bounding_box()["width"] > 40)
    assert page.locator(".bar").bounding_box()["height"] < 60, "one row"
    assert page.evaluate("document.documentElement.scrollWidth") == 1024


def test_on_a_small_phone_the_question_stands_over_one_row_of_buttons(small):
    page = small.page
    small.goto()
    small.press("east")
    page.wait_for_timeout(500)  # a press sooner than anybody sees the edge stops before it
    small.hand.press(page.keyboard, "ArrowUp")  # over the edge
    page.get_by_test_id("ask").wait_for()
    page.evaluate(ANIMATED)
    row = [
        page.get_by_test_id(name).bounding_box() for name in ("same-again", "next", "copy-replay")
    ]
    assert len({box["y"] for box in row}) == 1
    assert bottom(page.get_by_test_id("ask")) <= row[0]["y"]
    foot = page.locator(".site").bounding_box()["y"]
    eventually(lambda: bottom(page.get_by_test_id("next")) <= foot)
    late = []
    page.route("**/costs", lambda route: late.append(route))
    page.get_by_test_id("ask").click()
    eventually(lambda: bottom(page.locator("[data-part=costs] progress")) <= foot)


def test_a_bar_with_modes_is_one_row_from_1024_pixels_on(small):
    page = small.page
    small.goto()
    for width in (1024, 1160, 1180, 1440):
        page.set_viewport_size({"width": width, "height": 768})
        assert page.locator(".bar").bounding_box()["height"] < 60, width
        assert page.evaluate("document.documentElement.scrollWidth") == width


def test_on_a_small_phone_the_choice_of_a_terrain_is_whole(small):
    small.goto()
    page = small.page
    page.get_by_test_id("open-settings").click()
    levels = page.locator("#terrain-dialog .levels").first.get_by_role("button")
    assert levels.count() == 5
    assert [level.inner_text() for level in levels.all() if level.evaluate(CUT)] == []
    assert bottom(page.get_by_test_id("start")) <= SMALL[1]


def test_on_a_small_phone_a_watched_board_is_as_wide_as_the_screen(small):
    page = small.page
    small.goto()
    page.get_by_test_id("mode-watch").click()
    small.wait("window.playground.state.mode === 'watch' && window.playground.state.rival")
    assert page.get_by_test_id("matrix-player").bounding_box()["height"] >= 280
    board, pick = (
        page.get_by_test_id(name).bounding_box() for name in ("board-player", "pick-player")
    )
    assert pick["x"] - board["x"] >= 3


def test_on_a_phone_a_replay_has_a_bar_of_one_row_and_its_buttons_in_sight(small):
    page = small.page
    page.goto(f"{small.url}/replay/{small.ended}")
    page.get_by_test_id("play").wait_for()
    one_row = """() => {
        const tops = [...document.querySelectorAll(".playback button")].map((button) => button.getBoundingClientRect().top);
        return Math.max(...tops) - Math.min(...tops) < 10;
    }"""
    page.wait_for_function(one_row)  # once its words have come
    # what the policy came to takes room
    page.get_by_test_id("compared").get_by_text("on the same terrain").wait_for()
    for width, height in (SMALL, (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.locator(".bar .brand").bounding_box()["y"] == 0
        assert page.locator(".actions").bounding_box()["height"] <= 40
        foot = page.locator(".site").bounding_box()["y"]
        eventually(lambda foot=foot: bottom(page.get_by_test_id("play")) <= foot)
        others = page.locator(".actions").get_by_text("Play")
        assert page.get_by_role("link", name="Beat this").count() == 1
        assert others.count() == 0, "a second button of that name does something else"
    page.set_viewport_size({"width": 1440, "height": 900})
    eventually(lambda: page.locator("#scrubber").bounding_box()["height"] >= 140)
    for width in (820, 1024, 1180, 1300):
        page.set_viewport_size({"width": width, "height": 768})
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert page.locator(".actions").bounding_box()["height"] <= 44, "one row"


def test_the_page_of_ones_own_episodes_is_whole_on_a_small_phone_and_fills_a_wide_screen(small):
    page = small.page
    small.goto()
    small.hand.press(page.keyboard, "ArrowUp")  # over the edge
    small.wait("window.playground.state.player.frame.outcome")
    page.goto(f"{small.url}/me")
    page.locator("#rows tr").first.wait_for()
    for width, height in ((390, 844), SMALL):
        page.set_viewport_size({"width": width, "height": height})
        assert page.locator("#history").evaluate("(part) => part.scrollWidth <= part.clientWidth")
        for row in page.locator("#rows tr").all():
            assert row.evaluate(ROWS_OF_TEXT) == [1] * 7, width
            assert row.bounding_box()["height"] < 60, "two lines"
    page.get_by_test_id("play-on").wait_for()
    name = page.get_by_test_id("name")
    name.fill("Wilhelmina of Mammut")
    assert not name.evaluate(CUT), "a name of twenty characters is whole"
    for width in (1440, 1024, 820, 390, 320):
        page.set_viewport_size({"width": width, "height": 900})
        eventually(lambda: page.evaluate(ROWS_ARE_FULL))
    page.set_viewport_size({"width": 1440, "height": 900})
    page.locator("#streaks li").first.wait_for()
    picture = """() => document.querySelector("#pictures canvas").toDataURL()"""
    page.locator("#pictures canvas").first.wait_for()
    page.wait_for_load_state("networkidle")
    light = page.evaluate(picture)
    page.emulate_media(color_scheme="dark")
    eventually(lambda: page.evaluate(picture) != light)  # in the colours of the page
    dark = page.evaluate(picture)
    page.emulate_media(color_scheme="light")
    eventually(lambda: page.evaluate(picture) != dark)
    name, streaks, history = (
        page.locator(part).bounding_box() for part in ("#name-part", "#streaks-part", "#history")
    )
    assert name["y"] == streaks["y"]
    assert streaks["x"] == history["x"]
    assert abs(name["x"] + name["width"] - history["x"] - history["width"]) < 1


def test_beside_two_boards_on_a_low_screen_the_end_card_is_read_without_scrolling(small):
    page = small.page
    page.set_viewport_size({"width": 1024, "height": 768})
    small.goto()
    small.hand.press(page.keyboard, "ArrowUp")  # over the edge
    card = page.get_by_test_id("end-card")
    card.get_by_text("which ends the episode.").wait_for()
    card.get_by_text("is still exploring").wait_for()
    assert not card.evaluate(CUT)


def test_on_a_tablet_a_study_has_a_bar_of_one_row_and_a_board_as_wide_as_the_screen(small):
    page = small.page
    page.set_viewport_size({"width": 820, "height": 1180})
    person = Participant(page, small.url).goto()
    for screen, button in (("consent", "agree"), ("instructions", "to-tutorial")):
        person.stands(screen)
        person.choose(button)
    person.stands("play")
    matrix = page.locator(".field .matrix canvas")
    eventually(lambda: matrix.bounding_box()["width"] > 700)
    assert page.locator(".study .bar").bounding_box()["height"] < 60
    person.explore()
    for size in ((820, 1180), (390, 844), SMALL, (1024, 768), (1440, 900)):
        page.set_viewport_size(dict(zip(("width", "height"), size, strict=True)))
        eventually(lambda: page.evaluate(CARD_IS_BESIDE))  # once the board is drawn anew


def test_on_a_small_phone_the_coach_of_a_study_is_read_whole(small):
    person = Participant(small.page, small.url).goto()
    for screen, button in (("consent", "agree"), ("instructions", "to-tutorial")):
        person.stands(screen)
        person.page.get_by_test_id(button).click()
    person.stands("play")
    person.page.get_by_text("You are the bright cell").wait_for()
    assert not person.page.get_by_test_id("coach").evaluate(CUT)
    heading, dot = (person.page.locator(part).bounding_box() for part in (".heading", "#link"))
    assert heading["x"] + heading["width"] <= dot["x"]
    pad = person.page.locator(".pad")
    assert bottom(pad) <= SMALL[1]
    over = bottom(person.page.locator(".tools"))
    assert pad.bounding_box()["y"] - over >= 24, (
        "giving up is off the arrows, which are hit blindly"
    )


def test_help_on_a_phone_is_of_touches_and_elsewhere_of_keys(small):
    page = small.page
    small.goto()
    page.get_by_test_id("open-help").click()
    text = page.get_by_test_id("help-dialog").inner_text()
    assert "By touch" in text
    assert "Two fingers enlarge a board" in text
    assert not any(key in text for key in ("Enter", "Esc", "Ctrl", "key press"))


def test_on_a_small_phone_the_way_to_another_device_and_its_code_are_read_whole(small):
    person = Participant(small.page, small.url).goto()
    person.stands("consent")
    person.page.get_by_test_id("agree").click()
    person.stands("instructions")
    text = person.page.get_by_test_id("instructions").inner_text()
    assert "Play with the buttons on the screen." in text
    assert "Your keys" not in text
    code = person.page.get_by_test_id("recovery-code")
    assert code.evaluate("(part) => part.getClientRects().length") == 1, "a code is one line"
    person.page.get_by_test_id("open-elsewhere").click()
    person.page.get_by_test_id("elsewhere-address").wait_for(state="visible")
    for height in (640, 568):
        person.page.set_viewport_size({"width": 320, "height": height})
        dialog, button, qr = (
            person.page.get_by_test_id(name).bounding_box()
            for name in ("elsewhere", "close-elsewhere", "elsewhere-qr")
        )
        assert not person.page.get_by_test_id("elsewhere").evaluate(CUT), height
        assert dialog["y"] + dialog["height"] <= height
        assert button["y"] + button["height"] <= dialog["y"] + dialog["height"]
        assert qr["y"] + qr["height"] <= button["y"]


def test_on_a_small_phone_the_leaderboard_begins_with_sentences(small):
    page = small.page
    page.goto(f"{small.url}/leaderboard")
    line = page.get_by_test_id("own")
    line.get_by_role("link").wait_for()
    assert line.inner_text().startswith("Choose a name to stand here by it.")
    head, text = page.locator(".named-head").bounding_box(), line.bounding_box()
    assert page.locator(".slots i").count() == 5, "as many terrains as a place takes"
    play = page.get_by_role("link", name="Play ranked")
    assert bottom(play) <= page.locator(".site").bounding_box()["y"]
    assert head["height"] < 50
    assert text["y"] - head["y"] - head["height"] >= 6


def test_on_a_small_phone_the_operators_bar_is_whole(small):
    page = small.page
    page.goto(f"{small.url}/admin")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    small.wait("document.body.dataset.in === 'yes'")
    bar = page.locator(".bar")
    assert not bar.evaluate(CUT)
    assert bar.bounding_box()["height"] < 110, "two rows"
    for name in ("logout", "theme"):
        button = page.get_by_test_id(name).bounding_box()
        assert button["height"] < 45, name
        assert button["x"] + button["width"] <= SMALL[0], name
        assert button["y"] >= 4, name


def test_the_live_view_draws_its_curve_below_its_name(small):
    page = small.page
    small.goto()
    episode = small.state("player.frame.episode")
    page.goto(f"{small.url}/watch/{episode}")
    chart, name = page.get_by_test_id("chart"), page.get_by_role("heading", name="Mapped")
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        name.wait_for()
        assert chart.bounding_box()["height"] > 80
        assert bottom(name) <= chart.bounding_box()["y"]
