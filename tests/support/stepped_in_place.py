"""An environment that nothing makes again, and programs that play it."""

import queue
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import gymnasium
import numpy as np

from humanplay.web.simulate import Clock
from tests.support import forked_server
from tests.support.servers import PATIENCE_S, RunningServer

SCRIPT = """
    import sys
    sys.path.insert(0, {root!r})
    from humanplay import play, score
    from tests.support.stepped_in_place import Walk
    env = Walk(**{arguments!r})
    plays = play(env, browser=False, **{options!r})
    print("the call has returned", flush=True)
    {then}
"""
ROOT = Path(__file__).resolve().parents[2]


class Walk(gymnasium.Env):
    """A marker that walks to a goal; each program has made its own."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    action_space = gymnasium.spaces.Discrete(2, start=3)
    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float32)

    def __init__(self, goal=2, step_s=0.0, wanders=False, fails_at=None):
        self.render_mode = "rgb_array"
        self.goal, self.step_s, self.wanders, self.fails_at = goal, step_s, wanders, fails_at

    def get_action_meanings(self):
        return ["left", "right"]

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.cell = 0
        return self._look(), {}

    def _look(self):
        drift = time.monotonic() if self.wanders else 0.0
        return np.array([self.cell, drift], np.float32)

    def step(self, action):
        assert threading.current_thread() is threading.main_thread()
        if self.step_s:
            print("stepping", flush=True)
            time.sleep(self.step_s)
            print("stepped", flush=True)
        self.cell += 1 if action == 4 else -1
        if self.cell == self.fails_at:
            raise KeyError("the cell burns")
        return self._look(), -0.25, self.cell == self.goal, False, {}

    def render(self):
        picture = np.zeros((10, 100, 3), np.uint8)
        picture[:, 10 * (self.cell % 10) : 10 * (self.cell % 10) + 10] = 255
        return picture


class WalkingProgram:
    """A program that plays a `Walk` in a folder, and what it prints.

    is_fresh  it is started, not forked, and so is its server
    """

    def __init__(self, folder, then="", options=None, is_fresh=False, **arguments):
        script = textwrap.dedent(SCRIPT).format(
            root=str(ROOT), arguments=arguments, options=options or {}, then=then
        )
        (folder / "walk.py").write_text(script)
        if is_fresh:
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
            self.process = subprocess.Popen([sys.executable, "walk.py"], cwd=folder, **pipes)
        else:
            self.process = forked_server.Program(folder, "walk.py")
        self.lines, self._came, self._servers = [], queue.Queue(), []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self.process.stdout:
            self._came.put(line)
        self._came.put(None)

    def until(self, text):
        """Wait for a line with a text, and return it."""
        while True:
            line = self._came.get(timeout=PATIENCE_S)
            assert line is not None, "".join(self.lines)
            self.lines.append(line)
            if text in line:
                return line

    def opened(self):
        """The page, at whose keys people take their time."""
        line = self.until("Play at")
        self.until("Ctrl-C closes")
        self._servers.append(RunningServer(int(re.search(r":(\d+)", line)[1]), Clock()))
        return self._servers[-1]

    def interrupt(self):
        self.process.send_signal(signal.SIGINT)

    def ended(self):
        """Wait for its end, and return all that it printed."""
        while (line := self._came.get(timeout=PATIENCE_S)) is not None:
            self.lines.append(line)
        assert self.process.wait(PATIENCE_S) == 0, "".join(self.lines)
        return "".join(self.lines)

    def close(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join()
        self.process.stdout.close()

    def forget_page(self):
        """Close what was opened of its page."""
        for server in self._servers:
            server.close()
