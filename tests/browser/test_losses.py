"""After a practice episode the page says where moves were lost, and a loss can be tried again from its move."""

import numpy as np
import pytest

from marsexplorer.observation import valid_actions
from tests.support.browser import AS_A_PERSON, NO_3D, SCREENSHOTS

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


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (390, 844)])
def test_losses_are_listed_and_one_is_tried_again(serve, player, width, height):
    server = serve()
    me = player(server, FLAGS)
    me.page.set_viewport_size({"width": width, "height": height})
    me.goto()
    me.begin(size=[9, 11], seed=12, rival="frontier-cost")
    ask = me.page.get_by_role("button", name="Where did I lose moves?")
    assert not ask.is_visible()
    frame = me.explore(Wanderer(), lambda frame: frame["outcome"])
    ask.click()
    tries = me.page.get_by_role("button", name="Try from here")
    tries.first.wait_for()
    lines = me.page.locator("[data-part=losses] li").all_inner_texts()
    assert all("you lost" in line for line in lines)
    me.page.screenshot(path=str(SCREENSHOTS / f"losses-{width}x{height}.png"))
    answer = me.page.request.get(f"{server.url}/api/episodes/{frame['episode']}/regret").json()
    biggest = answer["losses"][0]
    assert lines[0].startswith(f"Move {biggest['step'] + 1}: you lost {biggest['regret']} move")

    tries.first.click()
    me.wait(f"window.mars.state.player.frame.step === {biggest['step']} && !window.mars.state.player.frame.outcome")
    again = me.state()
    assert again["episode"] != frame["episode"]
    assert not ask.is_visible()
    assert me.page.request.get(f"{server.url}/api/human-level").json()["figures"] == []
    assert me.errors == []
