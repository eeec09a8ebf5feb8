"""The 3-D view drawn by the processor: on an overlay over the client's canvas."""

import io

import numpy as np
import pytest
from PIL import Image

from tests.support.servers import eventually

CANVAS = "[data-testid=viewer-player]"
HIDDEN = """() => [...document.querySelectorAll('canvas')]
  .filter((each) => getComputedStyle(each).visibility === 'hidden').length"""

LOSE_CONTEXT = """() => {
  const canvases = [...document.querySelectorAll('canvas')];
  const hidden = canvases.find((each) => getComputedStyle(each).visibility === 'hidden');
  hidden.getContext('webgl2').getExtension('WEBGL_lose_context').loseContext();
}"""
BREAK_CLIENT = "() => document.getElementById('root').replaceChildren()"
"""What React does with a client that throws."""
COUNT_UNFINISHED = """() => {
  const { putImageData } = CanvasRenderingContext2D.prototype;
  window.unfinished = 0;
  CanvasRenderingContext2D.prototype.putImageData = function (...rest) {
    if (document.documentElement.dataset.scene === 'loading') window.unfinished += 1;
    return putImageData.apply(this, rest);
  };
}"""
"""Counts pictures of scenes that are still being built: there may be nothing in them yet, which leaves a hole in the page."""
COUNT_PICTURES = """() => {
  const { fenceSync, getBufferSubData } = WebGL2RenderingContext.prototype;
  let underWay = 0;
  window.mostUnderWay = 0;
  WebGL2RenderingContext.prototype.fenceSync = function (...rest) {
    underWay += 1;
    window.mostUnderWay = Math.max(window.mostUnderWay, underWay);
    return fenceSync.apply(this, rest);
  };
  WebGL2RenderingContext.prototype.getBufferSubData = function (...rest) {
    underWay -= 1;
    return getBufferSubData.apply(this, rest);
  };
}"""
"""Counts pictures that were asked for and not yet copied: a change of size while one is under way costs its context."""

NOTE_SOIL_WHEN_DRAWN = """() => new MutationObserver(([{ target }]) => {
  if (!target.dataset.drawn || window.soilWhenDrawn !== undefined) return;
  const overlay = target.contentDocument.querySelectorAll('canvas')[2];
  const { data } = overlay.getContext('2d').getImageData(0, 0, overlay.width, overlay.height);
  window.soilWhenDrawn = 0;
  for (let at = 0; at < data.length; at += 4) window.soilWhenDrawn += data[at] > 140 && data[at + 1] > 60 && data[at + 2] < 110;
}).observe(document, { subtree: true, attributes: true, attributeFilter: ['data-drawn'] })"""
"""Counts the soil-coloured pixels of the picture with which the view takes the stage."""


def view_of(me):
    """The frame of the player's 3-D view, once its canvas is there."""
    me.page.frame_locator(CANVAS).locator("canvas").first.wait_for(state="attached")
    return next(frame for frame in me.page.frames if "/viewer/" in frame.url)


def without_map(me):
    """Hide the small map over the stage: only the 3-D view's own colours are counted."""
    me.page.add_style_tag(content="[data-part=matrix] { visibility: hidden !important; }")


def pixels(picture):
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"), int)


def colours(picture):
    """How many soil-coloured and how many amber pixels a PNG has."""
    red, green, blue = np.moveaxis(pixels(picture), 2, 0)
    soil = (red > 140) & (green > 60) & (green < 130) & (blue < 110)
    return int(soil.sum()), int(((red > 220) & (green > 150) & (blue < 140)).sum())


DRAWN = "[data-testid=viewer-player][data-drawn]"


def test_the_overlay_shows_the_board_upright_and_follows_a_move_the_mouse_the_camera_and_another_size(
    serve, player
):
    me = player(serve(), (), 1010, 540)
    me.page.add_init_script(f"({COUNT_PICTURES})()")
    me.page.add_init_script(f"({NOTE_SOIL_WHEN_DRAWN})()")
    me.begin(size=[9, 12], seed=3)
    view = view_of(me)
    without_map(me)
    assert "&software-canvas" in view.url
    eventually(lambda: view.evaluate(HIDDEN) == 1)  # the client's canvas is unseen
    eventually(lambda: colours(me.picture("stage-player"))[0] > 500)
    assert me.page.evaluate("() => window.soilWhenDrawn") > 300, (
        "it takes the stage with its ground"
    )
    before = me.still("stage-player")
    picture = pixels(before)
    amber = np.argwhere((picture[..., 0] > 220) & (picture[..., 2] < 140))
    north_west = np.array(picture.shape[:2]) / 2  # there stands the rover
    assert (amber.mean(axis=0) < north_west).all()
    me.press("east")
    me.changes("stage-player", before)
    before = me.still("stage-player")
    box = me.page.get_by_test_id("viewer-player").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    me.page.mouse.move(x, y)
    me.page.mouse.down()
    me.page.mouse.move(x + 90, y, steps=4)
    me.page.mouse.up()
    me.changes("stage-player", before)
    assert view.evaluate("() => window.mostUnderWay") == 1

    view.evaluate(COUNT_UNFINISHED)
    before = me.still("stage-player")
    # another socket, and nothing else that would wake the client
    me.page.get_by_test_id("camera").click()
    me.changes("stage-player", before)
    eventually(lambda: colours(me.picture("stage-player"))[0] > 500)
    me.page.locator(DRAWN).wait_for()
    me.page.set_viewport_size({"width": 390, "height": 844})
    shape = "() => { const all = document.querySelectorAll('canvas'); return all[2].width / all[2].height; }"
    screen = "() => innerWidth / innerHeight"
    eventually(lambda: abs(view.evaluate(shape) / view.evaluate(screen) - 1) < 0.05)
    eventually(lambda: colours(me.picture("stage-player"))[0] > 300)
    assert view.evaluate("() => window.unfinished") == 0, "until then the picture before stays"
    assert me.errors == []


def test_a_view_that_lost_its_context_or_broke_gives_the_stage_to_the_matrix_and_is_loaded_again(
    serve, player
):
    me = player(serve(), (), 1010, 540)
    me.begin(size=[9, 12], seed=3)
    without_map(me)
    for harm in (LOSE_CONTEXT, BREAK_CLIENT):
        me.page.locator(DRAWN).wait_for()
        eventually(lambda: colours(me.picture("stage-player"))[0] > 500)
        view = view_of(me)
        view.evaluate("() => { window.isOld = true; }")
        view.evaluate(harm)
        me.page.locator(DRAWN).wait_for(state="detached")
        me.wait(f"!document.querySelector('{CANVAS}').contentWindow.isOld")
    me.page.locator(DRAWN).wait_for()
    eventually(lambda: colours(me.picture("stage-player"))[0] > 500)
    assert me.errors == []


@pytest.mark.long
def test_without_the_word_in_its_address_the_client_draws_on_its_own_canvas(serve, player):
    server = serve()
    me = player(server, (), 1010, 540)
    about = me.open_session(size=[9, 12], seed=3)
    me.page.goto(f"{server.url}/viewer/{about['session']}/")
    me.page.locator("canvas").first.wait_for()
    assert me.page.evaluate("() => requestAnimationFrame.toString().includes('native code')")
    assert me.page.locator("canvas").first.is_visible()
    ask = "() => document.querySelectorAll('canvas')[1].getContext('webgl2').getContextAttributes()"
    assert me.page.evaluate(ask)["antialias"]
    eventually(lambda: colours(me.page.screenshot())[0] > 500)
