"""Large boards in the matrix: the rover is followed, and everybody can zoom."""

import numpy as np
import pytest

from tests.support.browser import NO_3D, keep_picture
from tests.support.map_files import write_map

LEAST_PX = 10
MATRIX = "[data-role=player] .matrix"


def cell_px(me):
    me.wait(f"document.querySelector('{MATRIX}').dataset.cell")
    return float(me.page.locator(MATRIX).get_attribute("data-cell"))


def grows(me, before):
    me.wait(f"Number(document.querySelector('{MATRIX}').dataset.cell) > {before}")
    return cell_px(me)


def pinch(me, apart_px):
    """Spread two fingers over the board from 60 px apart."""
    box = me.page.locator(MATRIX).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    devtools = me.page.context.new_cdp_session(me.page)

    def touch(kind, half_px):
        fingers = [{"x": x + way * half_px, "y": y, "id": way + 1} for way in (-1, 1)]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})

    touch("touchStart", 30)
    for half_px in range(30, apart_px // 2, 5):
        touch("touchMove", half_px)
    devtools.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


@pytest.mark.parametrize("side", [42, 84])
def test_on_a_phone_cells_of_a_large_board_can_be_seen_and_two_fingers_zoom(serve, player, side):
    me = player(serve(), NO_3D, width=390, height=844, has_touch=True, is_mobile=True)
    me.begin(size=side)
    assert cell_px(me) >= LEAST_PX
    assert me.page.locator(f"{MATRIX} .whole-map").count() == 1
    room = me.page.locator(MATRIX).bounding_box()
    drawn = me.page.locator(f"{MATRIX} canvas").first.bounding_box()
    assert drawn["width"] <= room["width"]
    assert drawn["height"] <= room["height"]
    keep_picture(me.page, f"large-{side}-phone")
    before, step = cell_px(me), me.state()["step"]
    pinch(me, 160)
    grows(me, before + 4)
    assert me.state()["step"] == step, "two fingers drive nowhere"
    assert me.errors == []


@pytest.mark.parametrize("side", [42, 84])
def test_on_a_desk_wheel_and_keys_zoom_and_the_rover_stays_on_the_stage(serve, player, side):
    me = player(serve(), NO_3D)
    me.begin(size=side)
    first = cell_px(me)
    assert first >= LEAST_PX
    me.page.locator(MATRIX).hover()
    is_zoomed = side == 84
    if not is_zoomed:
        me.page.mouse.wheel(0, -400)
        me.page.wait_for_timeout(300)
        assert cell_px(me) <= first, "a wheel scrolls the page past a whole board"
        me.page.keyboard.down("Control")
    me.page.mouse.wheel(0, -400)
    wheeled = grows(me, first)
    me.page.keyboard.up("Control")
    me.page.keyboard.press("+")
    grows(me, wheeled)
    keep_picture(me.page, f"large-{side}-desk")
    for _ in range(12):
        me.page.keyboard.press("-")
    me.wait(f"Number(document.querySelector('{MATRIX}').dataset.cell) <= {max(first, LEAST_PX)}")
    assert cell_px(me) >= LEAST_PX
    assert me.page.locator(f"{MATRIX} .whole-map").count() == (side == 84)
    assert me.errors == []


def test_a_board_of_the_common_size_stands_whole(serve, player):
    me = player(serve(), NO_3D, width=390, height=844)
    me.begin(size=21)
    me.page.keyboard.press("+")
    assert me.page.locator(".whole-map").count() == 0


def test_a_map_of_256_cells_is_driven_and_no_frame_of_it_takes_more_than_20_kb(
    serve, player, tmp_path
):
    cells = np.zeros((256, 256), bool)
    cells[40::64, 4:] = True
    server = serve(maps=(write_map(tmp_path, "hall", cells),))
    me = player(server, NO_3D)
    frames = []
    me.page.on(
        "websocket", lambda socket: socket.on("framereceived", lambda text: frames.append(text))
    )
    me.begin(map="hall", rival="frontier-cost")
    assert cell_px(me) >= LEAST_PX
    for way in (*3 * ["north"], *4 * ["east"]):  # from its south-west
        me.press(way)
    assert me.state()["outcome"] is None
    assert me.state()["step"] == 7
    keep_picture(me.page, "large-256-desk")
    assert len(frames) > 10
    assert max(len(text) for text in frames) <= 20_000
    assert me.errors == []
