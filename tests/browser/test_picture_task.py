"""A task that is shown as its own picture, on the playground: the server's answers about it are given by the test."""

import base64
import io
import json

from PIL import Image

from tests.support.browser import AS_A_PERSON, NO_3D, violations

KEYS = {
    "left": ["ArrowLeft", "KeyA"],
    "down": ["ArrowDown", "KeyS"],
    "right": ["ArrowRight", "KeyD"],
    "up": ["ArrowUp", "KeyW"],
}
TASK = {
    "name": "gymnasium",
    "title": "FrozenLake-v1",
    "assets": "picture",
    "actions": list(KEYS),
    "keys": KEYS,
    "metrics": [
        {"name": "success", "unit": "", "lowest": 0.0, "highest": 1.0, "is_better": "higher"}
    ],
}
GOAL = 3


def picture(step):
    """A picture of 16x16 pixels whose colour tells the step."""
    data = io.BytesIO()
    Image.new("RGB", (16, 16), (40 * step, 60, 200)).save(data, "PNG")
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}"


def frame(step):
    ended = step == GOAL
    return {
        "kind": "frame",
        "episode": "e1",
        "step": step,
        "reward": float(ended),
        "return": float(ended),
        "score": None,
        "outcome": "success" if ended else None,
        "picture": picture(step),
        "text": f"tile {step} of {GOAL}",
        "headline": float(ended),
    }


ABOUT = {
    "session": "s1",
    "player": "human",
    "level": "FrozenLake-v1",
    "map": None,
    "size": 4,
    "counts": True,
    "not_attested": None,
    "watch": None,
    "frame": frame(0),
    "rival": None,
    "task": TASK,
}


def play(page, acts):
    """Answer for a server that has the task: each act is one step towards the goal."""

    def on_message(socket, text):
        message = json.loads(text)
        if message["kind"] == "act":
            acts.append(message)
            socket.send(json.dumps(frame(message["step"] + 1)))
        elif message["kind"] == "events":
            count = len(message["events"])
            socket.send(
                json.dumps({"kind": "kept", "episode": "e1", "count": count, "reason": None})
            )

    def on_socket(socket):
        socket.on_message(lambda text: on_message(socket, text))
        socket.send(json.dumps(frame(0)))

    page.route_web_socket("**/ws/sessions/s1", on_socket)
    page.route("**/api/sessions", lambda route: route.fulfill(json=ABOUT, status=201))
    page.route("**/api/sessions/s1/about", lambda route: route.fulfill(json=ABOUT))


def test_any_environment_is_played_by_its_keys_on_its_picture(server, player):
    me = player(server, [*NO_3D, *AS_A_PERSON])
    page, acts = me.page, []
    play(page, acts)
    page.goto(f"{server.url}/?task=FrozenLake-v1")
    me.wait("window.mars.state.player && window.mars.state.link === 'open'")
    shown = page.get_by_test_id("picture").first
    assert shown.get_attribute("alt") == "You: tile 0 of 3; running after 0 moves"
    assert page.get_by_test_id("goal").inner_text() == "FrozenLake-v1"
    assert not page.get_by_test_id("mode-practice").is_visible()
    assert not page.get_by_test_id("key").is_visible()
    me.hand.press(page.keyboard, "ArrowDown")
    me.wait("window.mars.state.player.frame.step === 1")
    page.evaluate("document.body.dataset.pad = 'true'")
    page.get_by_test_id("pad-right").click()
    me.wait("window.mars.state.player.frame.step === 2")
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(300)
        box = shown.bounding_box()
        assert box["width"] == box["height"] >= 160
        assert box["width"] % 16 == 0, "in whole multiples of its pixels"
        assert shown.evaluate("img => getComputedStyle(img).imageRendering") == "pixelated"
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert violations(page) == []
    me.hand.press(page.keyboard, "w")
    page.get_by_test_id("end-card").wait_for()
    assert [(act["step"], act["action"], act["input"]) for act in acts] == [
        (0, "down", "key"),
        (1, "right", "touch"),
        (2, "up", "key"),
    ]
    assert page.get_by_test_id("end-title-player").inner_text() == "Success after 3 moves"
    assert page.get_by_test_id("coverage-player").inner_text() == "1"
    assert "success" in page.get_by_test_id("board-player").inner_text()
    assert page.evaluate("() => window.mars.state.player.progress") == [0, 0, 0, 1]
    assert me.errors == []
