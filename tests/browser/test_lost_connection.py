"""Keys pressed while the server dies are stored exactly once, with their releases."""

import os
import signal
import sqlite3
from contextlib import closing

from tests.support.browser import AS_A_PERSON, NO_3D
from tests.support.study import freeze

NOTE = """{
  window.pressed = JSON.parse(sessionStorage.getItem("test.pressed") ?? "[]");
  for (const kind of ["keydown", "keyup"]) window.addEventListener(kind, (event) => {
    window.pressed.push([kind, event.code, Math.round(event.timeStamp * 10) / 10]);
    sessionStorage.setItem("test.pressed", JSON.stringify(window.pressed));
  }, true);
}"""


OPEN = "game.player.frame.outcome === null && window.study.state.game.link === 'open'"


def test_keys_pressed_while_the_server_dies_are_all_kept_once(spawn, open_browser, tmp_path):
    freeze(tmp_path / "playground.db-studies", size=(6, 8), pause_after_s=900)
    server = spawn()
    page = open_browser([*NO_3D, *AS_A_PERSON]).new_page()
    page.add_init_script(NOTE)
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))

    def wait(claim):
        page.wait_for_function(f"() => Boolean({claim})", timeout=60_000)

    def driving():
        wait(f"window.study?.screen === 'play' && window.study.state.{OPEN}")

    page.goto(f"{server.url}/study/small")
    page.get_by_test_id("agree").click()
    page.get_by_test_id("to-tutorial").click()
    driving()

    def drive(times):
        for _ in range(times):
            page.keyboard.press("ArrowRight")
            page.keyboard.press("ArrowLeft")

    def noted():
        return sorted(map(tuple, page.evaluate("() => window.pressed")))

    def kept():
        sql = "SELECT kind, code, client_ms FROM input_events WHERE kind LIKE 'key%'"
        with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
            return sorted(db.execute(sql))

    for _ in range(2):
        drive(2)
        os.kill(server.process.pid, signal.SIGSTOP)  # what leaves now arrives nowhere
        drive(2)
        server.kill()
        drive(2)
        assert page.evaluate("() => window.study.waiting") >= 8
        server = spawn(port=server.port)
        driving()
        wait("window.study.waiting === 0")
        assert kept() == noted()

    os.kill(server.process.pid, signal.SIGSTOP)
    drive(2)
    os.kill(server.process.pid, signal.SIGCONT)
    page.reload()
    driving()
    drive(1)
    wait("window.study.waiting === 0")
    assert len(noted()) == 2 * 2 * (2 * 6 + 2 + 1)
    assert kept() == noted()
    assert errors == []
