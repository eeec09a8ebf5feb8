"""Five environments in a real browser.

They are played by keys, their server is killed in the middle of play, and they go on.
"""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.study.verification import verify_database
from humanplay.tasks.gymnasium.description import description_of
from tests.support.browser import AS_A_PERSON, NO_3D, SIZES, free_port, keep_picture, violations
from tests.support.servers import eventually

ROOT = Path(__file__).parents[2]
FIVE = {
    "rooms": ("minigrid:MiniGrid-FourRooms-v0", ("ArrowUp", "ArrowRight")),
    "breakout": ("ale_py:ALE/Breakout-v5", ("Space", "ArrowLeft")),
    "lake": ("FrozenLake-v1", ("ArrowUp", "ArrowUp")),
    "lander": (str(ROOT / "examples/environments/lander.toml"), ("ArrowUp", "ArrowLeft")),
    "crafter": ("humanplay.tasks.gymnasium.adapters:Crafter-v0", ("ArrowRight", "Space")),
}
"""What `humanplay play` is given, and two keys to press."""
QUICK = ("rooms", "breakout")


@pytest.mark.filterwarnings(
    "ignore::DeprecationWarning"
)  # Box2D's, of SWIG, ends Python where it is an error
@pytest.mark.parametrize(
    "name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in FIVE]
)
def test_it_is_played_and_goes_on_with_all_that_was_shown_after_its_server_was_killed(
    spawn, player, tmp_path, name
):
    env, keys = FIVE[name]
    settings = {"task": f"gymnasium:{description_of(env)}", "port": free_port()}
    server = spawn(**settings)
    me = player(server, [*NO_3D, *AS_A_PERSON]).goto()
    page, clock = me.page, me.state("task.clock")
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function("() => document.querySelector('img.picture').naturalWidth > 0")
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
        keep_picture(page, f"{name}-{size}")
    assert violations(page) == []

    def play(more):
        """Play on for so many moves."""
        until = me.state()["step"] + more
        if clock:  # a press goes on only where the page knows that time stands still
            me.wait("window.playground.state.player.clock?.state === 'standing'")
            page.keyboard.press(keys[1])
            me.wait("window.playground.state.player.clock?.state === 'running'")
        while (at := me.state()["step"]) < until:
            if clock:
                page.keyboard.down(keys[at % 2])
                page.wait_for_timeout(100)
                page.keyboard.up(keys[at % 2])
            else:
                # a page that is starved of time may call its server lost
                me.wait("window.playground.state.link === 'open'")
                me.hand.press(page.keyboard, keys[at % 2])
                me.wait(f"window.playground.state.player.frame.step > {at}")

    play(20 if clock else 4)
    keep_picture(page, f"{name}-played")
    episode = me.state()["episode"]
    server.kill()
    me.wait("window.playground.state.link === 'lost'")
    shown = me.state()["step"]
    server = spawn(**settings)
    me.wait("window.playground.state.link === 'open'")
    eventually(lambda: me.state()["step"] >= shown)
    play(10 if clock else 2)
    assert me.state()["episode"] == episode
    page.goto("about:blank")
    server.kill()
    with closing(sqlite3.connect(tmp_path / "playground.db")) as conn:
        (stored,) = conn.execute(
            "SELECT count(*) FROM steps WHERE episode_id = ?", [episode]
        ).fetchone()
    assert stored >= shown + 2
    assert verify_database(tmp_path / "playground.db").findings == ()
    assert me.errors == []


BATCHES = """() => {
  window.batches = [];
  const watch = new MutationObserver((changes) => window.batches.push(changes.map(({ attributeName }) => attributeName)));
  watch.observe(document.querySelector("img.picture"), { attributeFilter: ["src"] });
  watch.observe(document.querySelector("[data-testid=chart]"), { attributeFilter: ["aria-label"] });
}"""
"""Notes what changes in one task of the browser: a new picture, a new curve."""


def test_the_picture_of_a_move_does_not_wait_for_the_curve(spawn, player):
    server = spawn(task="gymnasium:minigrid:MiniGrid-FourRooms-v0", port=free_port())
    me = player(server, [*NO_3D, *AS_A_PERSON]).goto()
    me.wait("document.querySelector('img.picture')?.complete")
    me.wait("document.querySelector('[data-testid=chart]').ariaLabel?.includes('after 0 moves')")
    me.page.evaluate(BATCHES)
    me.hand.press(me.page.keyboard, "ArrowRight")
    me.wait("window.batches.flat().includes('aria-label')")
    picture, curve = me.page.evaluate("() => window.batches")
    assert (picture, curve) == (["src"], ["aria-label"])
