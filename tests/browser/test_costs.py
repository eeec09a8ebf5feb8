"""After a practice episode the page shows where moves were lost.

A mistake can be tried again from its move.
"""

import numpy as np
import pytest

from marsexplorer import policies
from marsexplorer.observation import valid_actions
from tests.browser.test_attested import there_and_back
from tests.browser.test_play_page import whole
from tests.support.browser import AS_A_PERSON, KEY_OF, NO_3D, fetched, keep_picture
from tests.support.servers import eventually

FLAGS = tuple(dict.fromkeys((*AS_A_PERSON, *NO_3D)))


class Wanderer:
    """A policy that makes random valid moves."""

    def __init__(self):
        self.rng = np.random.default_rng(5)

    def reset(self, seed):
        pass

    def act(self, codes):
        (row, col) = np.argwhere(codes == 2)[0]
        return int(self.rng.choice(valid_actions(codes, int(row), int(col))))


ASK = "Where did I lose moves?"


@pytest.mark.long
def test_a_ranked_episode_says_where_moves_were_lost_and_one_is_tried_again_in_practice(
    serve, player
):
    server = serve()
    me = player(server, FLAGS)
    about = me.begin(size=[7, 9])
    assert about["counts"]
    ask = me.page.get_by_role("button", name=ASK)
    there, back = there_and_back(me)
    for action in (there, back, "north"):
        assert not ask.is_visible()
        me.press(action)
    frame = me.state()
    assert frame["outcome"] == "out_of_bounds"
    # nothing else changes the board from here on
    me.wait("window.playground.state.rival && window.playground.state.rival.frame.outcome")
    plain = me.still("canvas-player")
    answers = []
    me.page.route(
        "**/costs", lambda route: answers.append(route)
    )  # it comes when it is let through
    ask.click()
    me.page.locator("[data-part=costs] progress").wait_for()
    whole(me.page, "next", "watch-replay", "copy-replay")  # while the moves are judged
    answers[0].continue_()
    first = me.page.get_by_test_id("mistake-1")
    first.wait_for()
    assert "Move 3 ended the episode: " in first.inner_text()
    assert "you drove over the edge of the map" in first.inner_text()
    marked, chart = me.still("canvas-player"), me.still("chart")
    assert marked != plain
    first.click()
    assert first.get_attribute("aria-pressed") == "true"
    me.page.mouse.move(2, 2)
    me.changes("canvas-player", marked)  # the board as it was before the move
    me.changes("chart", chart)
    me.page.get_by_role("button", name="Try from here: move 3").click()
    me.wait("window.playground.state.player && !window.playground.state.player.frame.outcome")
    me.hand.press(me.page.keyboard, KEY_OF[there])  # at once, and it waits for the moves before it
    me.wait(
        "window.playground.state.player.frame.step === 3 && !window.playground.state.player.frame.outcome"
    )
    assert me.state("mode") == "practice"
    assert not me.state("counts")
    assert me.state("rival.name") == "ppo"
    assert me.page.get_by_test_id("badge").is_hidden()
    assert not ask.is_visible()
    me.press(back)
    me.shows("notices", "")
    me.page.wait_for_timeout(500)  # a press sooner than anybody sees the edge stops before it
    me.press("north")
    sentence = "Not finished before, not finished now, from move 3."
    assert sentence in me.page.get_by_test_id("end-compare").inner_text()
    assert me.errors == []


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844), (320, 640)])
def test_mistakes_are_listed_and_one_is_tried_again(serve, player, width, height):
    server = serve()
    me = player(server, FLAGS)
    me.page.set_viewport_size({"width": width, "height": height})
    me.begin(size=[9, 11], seed=12, rival="frontier-cost")
    frame = me.explore(Wanderer(), lambda frame: frame["outcome"])
    me.page.get_by_role("button", name=ASK).click()
    first = me.page.get_by_test_id("mistake-1")
    first.wait_for()
    lines = me.page.locator("[data-part=costs] li .mistake span").all_inner_texts()
    assert all(" cost " in line for line in lines)
    keep_picture(me.page, f"mistakes-{width}x{height}")
    if width < 480:
        item = me.page.locator("[data-part=costs] li").first.bounding_box()
        foot = me.page.locator(".site").bounding_box()["y"]
        assert item["y"] + item["height"] <= foot, "the greatest loss is in sight"
    answer = fetched(me.page, f"{server.url}/api/episodes/{frame['episode']}/costs").json()
    biggest = answer["mistakes"][0]
    first, last = biggest["first"] + 1, biggest["last"] + 1
    moves = f"Move {first}" if first == last else f"Moves {first} to {last}"
    assert lines[0].startswith(f"{moves} cost {biggest['cost']} move")
    summary = me.page.locator("[data-part=costs] p").first.inner_text()
    gap = answer["counts"] - answer["expert_moves"]
    assert (
        f"counts {answer['counts']} moves, Expert's {answer['expert_moves']}: {gap} more" in summary
    )
    assert answer["given_up"] + sum(move["cost"] for move in answer["expert"]) == gap
    # to be seen without choosing a mistake first
    me.page.get_by_role("button", name="Try from here").first.click()
    me.wait(f"window.playground.state.player.frame.step === {biggest['step']}")
    me.wait("!window.playground.state.player.frame.outcome")
    again = me.state()
    assert again["episode"] != frame["episode"]
    assert fetched(me.page, f"{server.url}/api/human-level").json()["figures"] == []
    assert me.errors == []


@pytest.mark.long
def test_a_large_board_says_that_its_moves_are_not_judged(serve, player):
    server = serve()
    me = player(server, FLAGS)
    frame = me.begin(size=84, seed=12, rival="frontier-cost")["frame"]
    me.press("north")
    ask = me.page.get_by_role("button", name=ASK)
    ask.click()
    panel = me.page.locator("[data-part=costs]")
    panel.get_by_text("Moves are judged on boards of up to 1764 cells").wait_for(timeout=60_000)
    costs = fetched(me.page, f"{server.url}/api/episodes/{frame['episode']}/costs").json()
    whole = f"Your episode counts 7056 moves, Expert's {costs['expert_moves']}: "
    assert panel.inner_text().startswith(whole)
    assert ask.is_hidden(), "asking again would say the same"
    assert me.errors == []


LIES_IN_THE_MIDDLE = """board => {
    const { x, y, width, height } = board.getBoundingClientRect();
    const top = document.elementFromPoint(x + width / 2, y + height / 2);
    return top?.dataset.testid ?? top?.outerHTML.slice(0, 80) ?? "nothing";
}"""


def test_the_board_is_on_top_while_any_loss_is_shown(serve, player):
    me = player(serve(), FLAGS)
    page, canvas = me.page, me.page.get_by_test_id("canvas-player")
    me.begin(size=[9, 11], seed=12, rival="frontier-cost")
    me.explore(Wanderer(), lambda frame: frame["outcome"] or frame["step"] == 30)
    me.explore(policies.load("frontier-utility"), lambda frame: frame["outcome"])
    page.get_by_role("button", name=ASK).click()
    page.get_by_test_id("mistake-2").wait_for()
    mistakes = page.locator("[data-part=costs] .mistake").all()
    episode = me.state("player.frame.episode")
    answer = fetched(page, f"{me.url}/api/episodes/{episode}/costs").json()
    steps = [mistake["step"] for mistake in answer["mistakes"]]
    covered = []
    for width, height in ((1440, 900), (1000, 800), (820, 1180), (701, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        if width < 480:
            page.evaluate("scrollTo(0, 0)")
            foot, first = page.locator(".site").bounding_box(), mistakes[0].bounding_box()
            assert first["y"] + first["height"] <= foot["y"], "the first is read without scrolling"
        for number, mistake in enumerate(mistakes, 1):
            mistake.click()
            head = page.locator(".board[data-role=player] [data-part=steps]")
            step = str(steps[number - 1])  # the head is of the board that is shown
            eventually(lambda h=head, s=step: h.inner_text() == s)
            top = canvas.evaluate(LIES_IN_THE_MIDDLE)
            keep_picture(page, f"mistake-{number}-{width}")
            covered += [] if top == "canvas-player" else [(width, number, top)]
    assert covered == []
    assert me.errors == []
