"""What one client can do, and how long the others wait meanwhile.

It has many connections, large boards and many stored events.
"""

import threading
import time
from contextlib import ExitStack, closing

import numpy as np
import pytest

from humanplay.db.input_events import MAX_EVENTS_PER_EPISODE, InputEventRow, add_input_events
from humanplay.db.store import Store
from humanplay.study.verification import verify_database
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from tests.support.others import measure, misbehaving
from tests.support.page_loads import STORED_LOAD
from tests.support.recorded import NOW, add_session, add_steps, ask, free_moves, open_episode
from tests.support.servers import eventually

pytestmark = pytest.mark.long

EVENTS = """
import json, os, sys
from websockets.sync.client import connect
os.nice(19)  # elsewhere it is another machine's processor that it takes
url, origin, cookie, episode = sys.argv[1:]
with connect(url, origin=origin, additional_headers={"Cookie": cookie}, proxy=None, compression=None, max_size=None) as socket:
    number = 0
    while True:
        events = [{"kind": "blur", "client_ms": 1.0 + number / 1e6 + each / 1e9} for each in range(200)]
        batch = {"batch": f"{number:032x}", "page_load": "a-page-load", "tab": "a-browsers-tab"}
        socket.send(json.dumps({"kind": "events", "episode": episode, "events": events, **batch}))
        number += 1
        while json.loads(socket.recv())["kind"] != "kept":
            pass
"""


def percentiles(trips):
    return [float(np.percentile(trips, p)) for p in (50, 99, 100)]


def tell(waits):
    for name, figures in waits.items():
        print(f"\n{name}: median, p99 and worst wait of the others, ms:", *map(round, figures))


def moves_of(server, session, client, seconds):
    """How many moves a board makes in some seconds."""
    url = f"/api/sessions/{session}"
    before = client.get(url).json()
    time.sleep(seconds)
    after = client.get(url).json()
    assert after["episode"] == before["episode"]
    assert after["outcome"] is None
    return after["step"] - before["step"]


def decision_ms():
    """The median time of `ppo`'s first decisions on 128x128 in this process."""
    policy, spent = policies.load("ppo"), []
    episode = Episode.begin(EnvConfig.of("random", 128), seed=7)
    policy.reset(0)
    for _ in range(20):
        began = time.perf_counter()
        action = policy.act(episode.codes)
        spent.append((time.perf_counter() - began) * 1000)
        episode.step(action)
    return float(np.median(spent))


def test_thirty_boards_of_ppo_on_128_keep_an_honest_board_waiting_for_one_decision(spawn):
    """The honest board asks for 20 moves a second on 64x64, thirty others for 60."""
    server = spawn()
    with ExitStack() as stack:
        client = stack.enter_context(server.client())
        wanted = {"size": 64, "player": "frontier-cost", "seed": 3}
        honest = client.post("/api/sessions", json=wanted).json()["session"]
        client.post(f"/api/sessions/{honest}/pace", json={"moves_per_second": 20})
        watched = [stack.enter_context(server.socket(honest, client))]
        moves_of(server, honest, client, 1)
        quiet_ms = 8000 / moves_of(server, honest, client, 8)
        for number in range(30):
            greedy = stack.enter_context(server.client())
            body = {"size": 128, "player": "ppo", "seed": number}
            session = greedy.post("/api/sessions", json=body).json()["session"]
            greedy.post(f"/api/sessions/{session}/pace", json={"moves_per_second": 60})
            watched.append(stack.enter_context(server.socket(session, greedy)))
        time.sleep(2)
        busy_ms = 10_000 / max(1, moves_of(server, honest, client, 10))
        one_ms = decision_ms()
    print(
        f"\nbeside 30 boards of ppo on 128x128: {quiet_ms:.0f} -> {busy_ms:.0f} ms a move; one decision {one_ms:.0f} ms"
    )
    assert busy_ms < quiet_ms + 3 * one_ms + 50


def count_events(path):
    return ask(path, "SELECT count(*) FROM input_events")[0][0]


def test_others_wait_no_longer_while_an_episode_comes_to_fifty_thousand_events(spawn, tmp_path):
    """They come 200 at a time, nearly equal, as fast as they are answered."""
    server = spawn(limits={"messages": "1000000+1000000/s"})
    with server.page() as client:
        begun = client.post("/api/sessions", json={"size": 64}).json()
        cookie = "; ".join(f"{morsel.name}={morsel.value}" for morsel in client.cookies.jar)
    measure(server, 2)
    quiet = percentiles(measure(server, 8))
    url = f"ws://127.0.0.1:{server.port}/ws/sessions/{begun['session']}"
    with misbehaving(EVENTS, url, server.url, cookie, begun["frame"]["episode"]):
        filling = percentiles(measure(server, 8))
        eventually(lambda: count_events(tmp_path / "playground.db") > 49_000)
        full = percentiles(measure(server, 8))
    after = percentiles(measure(server, 8))  # other programs may have begun meanwhile
    tell(
        {
            "quiet": quiet,
            "while the events come": filling,
            "with 50,000": full,
            "quiet again": after,
        }
    )
    assert max(filling[1], full[1]) <= 2 * max(quiet[1], after[1])


def boards_full_of_events(path, boards):
    """Store boards with the most input events, the last a move; return their sessions."""
    times_ms = [100.0 + number for number in range(MAX_EVENTS_PER_EPISODE - 1)]
    events = [InputEventRow("keydown", "KeyW", False, True, at_ms, 0, 2.5) for at_ms in times_ms]
    sessions = []
    with closing(Store(path)) as store:
        for seed in range(boards):
            sessions.append(add_session(store, f"player {seed}"))
            row, episode = open_episode(store, sessions[-1], seed, number=1, started_ms=NOW - 1000)
            for first in range(0, len(events), 5_000):
                batch = events[first : first + 5_000]
                add_input_events(store, row.id, batch, NOW, f"batch-{first}", STORED_LOAD)
            add_steps(store, row, episode, free_moves(episode)[:1])
    return sessions


def test_others_wait_no_longer_while_episodes_of_fifty_thousand_events_end(spawn, tmp_path):
    """Twelve episodes are abandoned in turn; in the quiet time, as many empty ones."""
    sessions = boards_full_of_events(tmp_path / "playground.db", 12)
    server = spawn()
    with server.client() as client:
        begun = [client.post("/api/sessions", json={"size": 21}).json() for _ in sessions]
        empty = [board["session"] for board in begun]

        def end(ending):
            for session in ending:
                client.post(f"/api/sessions/{session}/episodes", json={}).raise_for_status()
                time.sleep(0.1)

        def measure_while_ending(ending):
            thread = threading.Thread(target=end, args=[ending])
            thread.start()
            trips = measure(server, 10)
            thread.join()
            return percentiles(trips)

        measure(server, 2)
        quiet, busy = measure_while_ending(empty), measure_while_ending(sessions)
    tell({"quiet": quiet, "while episodes of 50,000 events end": busy})
    server.kill()
    assert verify_database(tmp_path / "playground.db").findings == ()
    # where the thread of the writes did it all, they waited for most of a second
    assert busy[1] <= 2 * quiet[1] + 50
