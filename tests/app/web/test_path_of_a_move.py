"""How many modules one move over the socket enters, and how often."""

import sys
from pathlib import Path

MOST_MODULES, MOST_SWITCHES = 10, 30
ROOT = Path(__file__).parents[3]
OURS = tuple(f"{ROOT / name}/" for name in ("app/humanplay", "marsexplorer"))

NOT_OF_THE_MOVE = ("on_loop", "measure_lag")
"""What this test asks of the loop, and what the server does by itself every so often."""


class Trace:
    """The modules of ours that a thread enters, in order; staying in one counts once."""

    def __init__(self):
        self.went = []

    def start(self):
        sys.setprofile(self._note)

    def stop(self):
        sys.setprofile(None)

    def _note(self, frame, event, _):
        name = frame.f_code.co_filename
        if event != "call" or not name.startswith(OURS) or frame.f_code.co_name in NOT_OF_THE_MOVE:
            return
        module = name.removeprefix(f"{ROOT}/")
        if self.went[-1:] != [module]:
            self.went.append(module)


def test_a_move_enters_few_modules(server):
    client, store = server.client(), server.services.store
    about = client.post("/api/sessions", json={"seed": 5}).json()
    loop, writes = Trace(), Trace()

    async def on_loop(change):
        change()

    with server.socket(about["session"], client) as socket:
        frame = socket.receive("frame")
        socket.receive("history")
        for action in ("south", "north"):
            socket.act(frame, action)
            frame = socket.frame_after(frame["step"])
        server.on_loop(store.write(writes.start))
        server.on_loop(on_loop(loop.start))
        socket.act(frame, "south")
        socket.frame_after(frame["step"])
        server.on_loop(on_loop(loop.stop))
        server.on_loop(store.write(writes.stop))
    modules = {*loop.went, *writes.went}
    switches = sum(len(trace.went) - 1 for trace in (loop, writes))
    print(f"\n{len(modules)} modules, {switches} switches")
    assert len(modules) <= MOST_MODULES
    assert switches <= MOST_SWITCHES
