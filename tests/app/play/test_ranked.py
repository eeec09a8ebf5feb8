"""A ranked episode is neither dropped by leaving nor its terrain exchanged."""

import asyncio
import itertools
import threading
import time
from contextlib import closing, suppress
from dataclasses import replace

import httpx
import pytest

from humanplay.board.lobby import Lobby
from humanplay.board.ranked import PageBoards
from humanplay.board.session import Move
from humanplay.board.sources import Sources, now_ms
from humanplay.db.playground import open_ranked
from humanplay.db.store import Store
from humanplay.tasks.mars.messages import NewEpisode, NewSession
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.tasks.mars.task import Mars
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import unpack_terrain
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.policies import load
from tests.support.servers import eventually

SMALL = {"size": [9, 12]}
LIMIT = EnvConfig.of("random", (9, 12)).limit
MINUTE_MS = 60_000


@pytest.fixture
def in_lobby(tmp_path):
    """`in_lobby(scenario)` runs `scenario(lobby)` on a lobby of its own."""

    def run(scenario, **sources):
        async def whole():
            with closing(Store(tmp_path / "play.db")) as store:
                lobby = Lobby(store, Mars(PolicyCatalogue()), Sources(**sources), 600.0)
                try:
                    await scenario(lobby)
                finally:
                    lobby.close()

        asyncio.run(whole())

    return run


def begin(client, **body):
    answer = client.post("/api/sessions", json=body)
    assert answer.status_code in (200, 201), answer.text
    return answer.json()


def drive(server, client, about, moves, away=True):
    """Go to and fro between two cells, or off the grid; return the last frame."""
    with server.socket(about["session"], client) as socket:
        frame = socket.receive("frame")
        ways = ("south", "north") if frame["grid"][1][0] != "#" else ("east", "west")
        for number in range(moves):
            socket.act(frame, ways[number % 2] if away else "north", input="key")
            frame = socket.frame_after(frame["step"])
    return frame


def outcome(client, about):
    """A finished episode's outcome, its steps, and whether it counts; None while open."""
    answer = client.get(f"/api/episodes/{about['frame']['episode']}")
    episode = answer.json()
    return (
        None
        if answer.status_code == 404
        else (episode["outcome"], episode["steps"], episode["counts"])
    )


def counted_steps(client):
    """Return what each counted episode is worth in moves, the oldest first."""
    rows = client.get("/api/episodes?who=human").json()
    return [row["steps_to_target"] for row in rows][::-1]


def seed_of(server, about):
    return server.services.store.find_episode(about["frame"]["episode"]).episode.seed


OTHER_BOARDS = [
    SMALL | {"rival": "frontier-cost"},
    {"player": "random", "rival": "frontier-cost"},
    SMALL | {"seed": 7},
    {"size": [9, 13]},
]


@pytest.mark.parametrize("body", OTHER_BOARDS)
def test_a_ranked_episode_that_is_left_for_another_board_counts_as_abandoned(server, body):
    client = server.page()
    ranked = begin(client, **SMALL)
    assert ranked["counts"] is True
    drive(server, client, ranked, 3)
    assert outcome(client, ranked) is None
    with server.socket(ranked["session"], client) as other_tab:
        other_tab.receive("frame")
        begin(client, **body)
        assert other_tab.frame_after(-1)["outcome"] == "abandoned", (
            "the tab that still shows it is told"
        )
    assert outcome(client, ranked) == ("abandoned", 3, True)
    (figure,) = client.get("/api/human-level").json()["figures"]
    assert (figure["episodes"], figure["abandoned"]) == (1, 1)
    assert counted_steps(client) == [LIMIT]


PATIENCE = 17
"""Moves after which the player of the next test leaves a board that is not explored."""


def test_leaving_what_goes_badly_costs_what_an_abandoned_episode_costs(serve):
    """A board that is left counts as LIMIT moves, more than playing it on takes."""
    seeds = itertools.count(1)
    server, policy = serve(), load("frontier-cost")
    lobby = server.services.lobby
    lobby.sources = replace(lobby.sources, seed=lambda: next(seeds))
    client, honest = server.page(), []
    for _ in range(8):
        ranked = begin(client, **SMALL)
        whole = play_episode(policy, EnvConfig.of("random", (9, 12)), seed_of(server, ranked))
        honest.append(whole.steps)
        with server.socket(ranked["session"], client) as socket:
            frame = socket.receive("frame")
            for action in list(whole.actions)[:PATIENCE]:
                socket.act(frame, ACTIONS[action], input="key")
                frame = socket.frame_after(frame["step"])
        if frame["outcome"] is None:
            begin(client, **SMALL, rival="frontier-cost")
    left = [steps for steps in honest if steps > PATIENCE]
    assert 0 < len(left) < len(honest)
    (figure,) = client.get("/api/human-level").json()["figures"]
    assert (figure["episodes"], figure["abandoned"]) == (len(honest), len(left))
    counted = [steps if steps <= PATIENCE else LIMIT for steps in honest]
    assert counted_steps(client) == counted
    assert sum(counted) > sum(honest), "leaving does not pay"


def test_coming_back_goes_on_where_the_episode_stood(serve):
    server = serve()
    client = server.page()
    ranked = begin(client, **SMALL)
    frame = drive(server, client, ranked, 4)
    for answer in (client.get("/api/me/session"), client.post("/api/sessions", json=SMALL)):
        assert (answer.status_code, answer.json()["session"], answer.json()["frame"]) == (
            200,
            ranked["session"],
            frame,
        )
    server.stop()
    again = serve()
    again.clock.skipped_ms = server.clock.skipped_ms
    back = again.page(cookies=dict(client.cookies))
    assert back.get("/api/me/session").json()["frame"] == frame
    assert begin(back, **SMALL)["session"] == ranked["session"]
    drive(again, back, ranked, 1, away=False)
    assert outcome(back, ranked)[2] is True


def test_the_next_terrain_leaves_the_running_episode_as_abandoned_and_stays_ranked(server):
    client = server.page()
    ranked = begin(client, **SMALL)
    drive(server, client, ranked, 2)
    following = client.post(f"/api/sessions/{ranked['session']}/episodes", json={}).json()
    assert (following["session"], following["counts"]) == (ranked["session"], True)
    assert outcome(client, ranked) == ("abandoned", 2, True)


def test_a_terrain_that_was_shown_is_not_exchanged_by_leaving_it(server):
    client = server.page()
    ranked = begin(client, **SMALL)
    url = f"/api/sessions/{ranked['session']}/episodes"
    assert client.post(url, json={}).json()["frame"] == ranked["frame"], (
        "it waits for its first move"
    )
    elsewhere = client.post(url, json={"seed": 7}).json()
    assert (elsewhere["session"] != ranked["session"], elsewhere["counts"]) == (True, False)
    for body in OTHER_BOARDS:
        begin(client, **body)
    assert begin(client, **SMALL)["frame"] == ranked["frame"]
    other_size = client.post(url, json={"size": [9, 14]}).json()
    assert other_size["session"] != ranked["session"]
    assert begin(client, **SMALL)["frame"] == ranked["frame"]
    assert (
        client.post(f"/api/sessions/{other_size['session']}/episodes", json=SMALL).json()["frame"]
        == ranked["frame"]
    )
    assert client.get("/api/human-level").json()["figures"] == [], (
        "without a move it does not count"
    )
    drive(server, client, ranked, 1, away=False)
    assert outcome(client, ranked) == ("out_of_bounds", 1, True), "the terrain was not met before"
    following = client.post(url, json={}).json()
    assert seed_of(server, following) != seed_of(server, ranked)


def test_two_tabs_that_ask_for_a_ranked_board_at_once_get_one(in_lobby):
    async def scenario(lobby):
        boards = PageBoards(lobby, abandon_after_s=1800)
        await boards.begin(NewSession(size=[9, 13], rival="frontier-cost"), "me")
        answers = await asyncio.gather(
            *(boards.begin(NewSession(size=[9, 12]), "me") for _ in range(8))
        )
        assert len({session.current.id for session, _ in answers}) == 1
        assert sorted(was_open for _, was_open in answers) == [False] + 7 * [True]
        session = answers[0][0]
        await session.act(Move(session.current.id, 0, _away(session), "human"))
        wanted = [NewEpisode(size=[9, 14]), NewEpisode(size=[9, 14])]
        following = await asyncio.gather(
            *(boards.begin_next(session, episode) for episode in wanted)
        )
        assert len({board.current.id for board, _ in following}) == 1
        assert len(open_ranked(lobby.store, "me")) == 1

    in_lobby(scenario)


def _away(session):
    row = session.current
    return 2 if not unpack_terrain(row.terrain, row.config)[1, 0] else 1


def test_a_ranked_episode_that_nobody_moves_is_abandoned_after_a_while_in_memory_or_not(serve):
    server = serve(abandon_after_s=0.8, idle_s=0.2)
    client, other = server.page(), server.page()
    ranked, unmoved = begin(client, **SMALL), begin(other, **SMALL)
    practice = begin(server.page(), **SMALL, rival="frontier-cost")
    drive(server, client, ranked, 2)
    eventually(lambda: outcome(client, ranked) is not None)
    assert outcome(client, ranked) == ("abandoned", 2, True)
    assert outcome(other, unmoved) is None, "a terrain without a move waits"
    assert outcome(other, practice) is None
    assert begin(other, **SMALL)["frame"] == unmoved["frame"]
    assert begin(client, **SMALL)["frame"]["episode"] != ranked["frame"]["episode"]


def test_a_server_that_starts_abandons_what_was_left_meanwhile(serve):
    server = serve()
    client = server.page()
    ranked = begin(client, **SMALL)
    drive(server, client, ranked, 3)
    server.stop()
    late = serve(abandon_after_s=0.001)
    back = late.page(cookies=dict(client.cookies))
    eventually(lambda: outcome(back, ranked) == ("abandoned", 3, True))


def test_what_was_left_is_abandoned_also_after_a_time_in_which_the_database_could_not_be_read(
    serve,
):
    server = serve(abandon_after_s=0.4)
    server.execute("ALTER TABLE steps RENAME TO away")
    time.sleep(0.5)  # it is looked for every 0.1 s
    server.execute("ALTER TABLE away RENAME TO steps")
    client = server.page()
    ranked = begin(client, **SMALL)
    drive(server, client, ranked, 2)
    eventually(lambda: outcome(client, ranked) == ("abandoned", 2, True), 20)


@pytest.mark.long
@pytest.mark.parametrize("kill", range(5))
def test_a_kill_leaves_one_ranked_episode_open_and_nothing_lost(spawn, kill):
    server = spawn()
    client = server.page()
    first = begin(client, **SMALL)
    drive(server, client, first, 3)
    asking = threading.Thread(target=lambda: suppressed(begin, client, size=[9, 13]))
    asking.start()
    time.sleep(0.002 * kill)
    server.kill()
    asking.join()
    again = spawn()
    back = again.page(cookies=dict(client.cookies))
    board = back.get("/api/me/session").json()
    if outcome(back, first) is None:
        assert (board["session"], board["frame"]["step"]) == (first["session"], 3)
    else:
        assert outcome(back, first) == ("abandoned", 3, True)
        assert board["size"] == [9, 13]
    drive(again, back, board, 1)
    again.kill()


def suppressed(work, *given, **more):
    """Do what a server that is killed may not answer."""
    with suppress(httpx.HTTPError):
        work(*given, **more)


def test_each_move_puts_the_time_off(in_lobby):
    now = [now_ms()]

    async def scenario(lobby):
        boards = PageBoards(lobby, abandon_after_s=1800)
        session, _ = await boards.begin(NewSession(size=[9, 12]), "me")
        away = _away(session)
        for action in (away, (away + 2) % 4, away):
            await session.act(Move(session.current.id, session.shown.steps, action, "human"))
            now[0] += 29 * MINUTE_MS
            await boards.abandon_left()
            assert not session.shown.ended
        now[0] += 2 * MINUTE_MS
        await boards.abandon_left()
        assert (session.shown.outcome, session.shown.steps) == ("abandoned", 3)

    in_lobby(scenario, clock_ms=lambda: now[0])
