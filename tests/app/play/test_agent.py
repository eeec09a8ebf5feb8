"""A policy at the controls: following, timed, paused, single steps, failing."""

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from humanplay.board.agent import DecisionQueue
from humanplay.tasks.mars.policies import PolicyCatalogue
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from marsexplorer.policies.files.card import of_paper
from marsexplorer.policies.network import batch
from marsexplorer.policies.network.batch import batch_network
from tests.support import policy_files
from tests.support.servers import eventually


def steps(client, session):
    return client.get(f"/api/sessions/{session}").json()["step"]


def step_once(client, url):
    """Ask for one move and return the frame after it; None when the episode has ended."""
    before = client.get(url).json()
    if before["outcome"]:
        return None
    client.post(f"{url}/pace", json={"step": True})
    return eventually(lambda: (now := client.get(url).json())["step"] > before["step"] and now)


def test_a_rival_makes_one_move_for_each_of_the_players(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"rival": "frontier-cost", "seed": 5}).json()
    rival = begun["rival"]
    assert rival["frame"]["grid"] == begun["frame"]["grid"]
    with (
        server.socket(begun["session"], client) as player,
        server.socket(rival["session"], client) as watcher,
    ):
        assert (
            watcher.receive("pace")
            == rival["pace"]
            == {"kind": "pace", "mode": "follow", "moves_per_second": 8.0}
        )
        frame = player.receive("frame")
        for number in range(10):
            player.act(frame, ("south", "north")[number % 2])
            frame = player.frame_after(frame["step"])
        seen = watcher.frame_after(9)
        assert (frame["step"], seen["step"]) == (10, 10)
    time.sleep(0.3)
    assert steps(client, rival["session"]) == 10


def test_a_rival_goes_on_alone_when_its_player_has_ended(server):
    client = server.client()
    begun = client.post(
        "/api/sessions", json={"rival": "frontier-cost", "size": 9, "seed": 1}
    ).json()
    body = {"episode": begun["frame"]["episode"], "step": 0, "action": "north"}
    assert (
        client.post(f"/api/sessions/{begun['session']}/act", json=body).json()["outcome"]
        == "out_of_bounds"
    )
    last = eventually(
        lambda: (
            (now := client.get(f"/api/sessions/{begun['rival']['session']}").json())["outcome"]
            and now
        )
    )
    assert last["outcome"] == "explored"


def test_timed_paused_and_single_steps(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"rival": "frontier-utility"}).json()
    rival = begun["rival"]["session"]
    with server.socket(rival, client) as watcher:
        watcher.receive("pace")
        client.post(f"/api/sessions/{rival}/pace", json={"pause": True})
        assert watcher.receive("pace")["mode"] == "paused"
        assert (
            client.post(f"/api/sessions/{rival}/pace", json={"step": True}).json()["mode"]
            == "paused"
        )
        assert watcher.frame_after(0)["step"] == 1
        client.post(f"/api/sessions/{rival}/pace", json={"step": True})
        assert watcher.frame_after(1)["step"] == 2
        began = time.monotonic()
        client.post(f"/api/sessions/{rival}/pace", json={"moves_per_second": 20})
        assert watcher.receive("pace") == {
            "kind": "pace",
            "mode": "timed",
            "moves_per_second": 20.0,
        }
        frame = watcher.frame_after(11)
        assert time.monotonic() - began > 0.4, "no faster than asked for"
        client.post(f"/api/sessions/{rival}/pace", json={"pause": True})
    eventually(lambda: steps(client, rival) >= frame["step"])
    time.sleep(0.1)
    stood = steps(client, rival)
    time.sleep(0.3)
    assert (steps(client, rival), steps(client, begun["session"])) == (stood, 0)
    assert (
        "driven by a person"
        in client.post(f"/api/sessions/{begun['session']}/pace", json={"pause": True}).json()[
            "detail"
        ]
    )


def test_a_new_episode_restarts_both_on_one_terrain(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"rival": "frontier-cost", "seed": 5}).json()
    rival = begun["rival"]["session"]
    client.post(
        f"/api/sessions/{begun['session']}/act",
        json={"episode": begun["frame"]["episode"], "step": 0, "action": "south"},
    )
    following = client.post(
        f"/api/sessions/{begun['session']}/episodes", json={"size": [8, 15], "seed": 5}
    ).json()
    assert following["rival"]["frame"]["grid"] == following["frame"]["grid"]
    assert (following["rival"]["session"], following["rival"]["frame"]["step"]) == (rival, 0)
    client.post(
        f"/api/sessions/{begun['session']}/act",
        json={"episode": following["frame"]["episode"], "step": 0, "action": "south"},
    )
    eventually(lambda: steps(client, rival) == 1)
    refused = client.post(f"/api/sessions/{rival}/episodes")
    assert refused.status_code == 422
    assert "rival" in refused.json()["detail"]
    store = server.services.store
    player, other = (store.resume_session(session).episode for session in (begun["session"], rival))
    assert (player.terrain, player.seed, player.number) == (other.terrain, other.seed, 2)


def test_a_policy_that_remembers_goes_on_where_it_stood_after_a_restart(serve):
    server = serve()
    client = server.client()
    begun = client.post("/api/sessions", json={"player": "random", "size": 8, "seed": 3}).json()
    url = f"/api/sessions/{begun['session']}"
    client.post(f"{url}/pace", json={"pause": True})
    while step_once(client, url) and steps(client, begun["session"]) < 12:
        server.stop()
        server = serve()
        client = server.client()
    row = server.services.store.resume_session(begun["session"])
    policy, episode = load("random"), Episode.begin(EnvConfig.of("random", 8), seed=3)
    policy.reset(row.episode.policy_seed)
    for action in row.actions:
        assert ACTIONS[policy.act(episode.codes)] == ACTIONS[action]
        episode.step(action)


class Broken:
    """A policy that fails on its third move."""

    name = "broken"

    def reset(self, seed):
        self.moves = 0

    def act(self, observation):
        self.moves += 1
        if self.moves == 3:
            raise RuntimeError("the third move fails")
        return 2 if self.moves % 2 else 0


class CatalogueWithBroken(PolicyCatalogue):
    def load(self, name):
        return Broken() if name == "random" else super().load(name)


@pytest.mark.filterwarnings("ignore")
def test_a_policy_that_fails_stops_and_is_reported(serve):
    server = serve(policies=CatalogueWithBroken())
    client = server.client()
    begun = client.post("/api/sessions", json={"player": "random", "seed": 5}).json()
    with server.socket(begun["session"], client) as watcher:
        client.post(f"/api/sessions/{begun['session']}/pace", json={"moves_per_second": 30})
        assert "the third move fails" in watcher.receive("error")["detail"]
    assert steps(client, begun["session"]) == 2
    following = client.post(f"/api/sessions/{begun['session']}/episodes", json={"seed": 6}).json()
    eventually(lambda: steps(client, following["session"]) == 2)


def test_a_rival_made_for_one_size_plays_that_size_and_is_refused_on_others(serve, tmp_path):
    path = policy_files.write_onnx(tmp_path / "mine.onnx")
    client = serve(policies=PolicyCatalogue([path])).client()
    refused = client.post("/api/sessions", json={"size": 21, "rival": "mine"})
    assert refused.status_code == 422
    assert "made for 6x7 and cannot play 21x21" in refused.json()["detail"]
    session = client.post("/api/sessions", json={"size": [6, 7], "player": "mine"}).json()[
        "session"
    ]
    client.post(f"/api/sessions/{session}/pace", json={"step": True})
    eventually(lambda: client.get(f"/api/sessions/{session}").json()["step"] >= 1)
    refused = client.post(f"/api/sessions/{session}/episodes", json={"size": 9})
    assert refused.status_code == 422
    assert "made for 6x7 and cannot play 9x9" in refused.json()["detail"]


def test_policies_of_the_papers_algorithms_play_as_rivals_the_moves_that_they_make_alone(serve):
    server = serve(policies=PolicyCatalogue(of_paper().values()))
    client = server.client()
    for name in of_paper():
        is_drawn = name not in ("ppo-works", "rainbow-works")
        moves = 1 if is_drawn else 3  # one that draws its moves may crash
        begun = client.post("/api/sessions", json={"size": 21, "rival": name, "seed": 7}).json()
        for number in range(moves):
            body = {
                "episode": begun["frame"]["episode"],
                "step": number,
                "action": ("south", "north")[number % 2],
            }
            moved = client.post(f"/api/sessions/{begun['session']}/act", json=body)
            assert moved.json()["outcome"] is None
        rival = begun["rival"]["session"]
        eventually(lambda rival=rival, moves=moves: steps(client, rival) == moves)
        if not is_drawn:
            twin, episode = load(name), Episode.begin(EnvConfig(), seed=7)
            for _ in range(moves):
                episode.step(twin.act(episode.codes))
            actions = server.services.store.resume_session(rival).actions
            assert bytes(episode.actions) == actions


def test_boards_that_ask_at_once_are_decided_in_one_call_with_the_moves_they_would_make_alone():
    async def ask(names):
        decisions, calls = DecisionQueue(thread, batch), []
        boards = [
            (load(name), Episode.begin(EnvConfig(), seed=seed)) for seed, name in enumerate(names)
        ]
        net = batch_network(boards[0][0])
        infer = net.infer
        net.infer = lambda *arrays: calls.append(len(arrays[0])) or infer(*arrays)
        for _ in range(5):
            asked = (decisions.act(policy, episode.codes.copy()) for policy, episode in boards)
            for (_, episode), action in zip(boards, await asyncio.gather(*asked), strict=True):
                episode.step(action)
        del net.infer
        return calls, [bytes(episode.actions) for _, episode in boards]

    def alone(name, seed):
        policy, episode = load(name), Episode.begin(EnvConfig(), seed=seed)
        for _ in range(5):
            episode.step(policy.act(episode.codes))
        return bytes(episode.actions)

    with ThreadPoolExecutor(1) as thread:
        names = ["ppo", "frontier-cost", "ppo", "ppo", "frontier-utility", "ppo"]
        calls, moves = asyncio.run(ask(names))
    assert calls == [4] * 5
    assert moves == [alone(name, seed) for seed, name in enumerate(names)]


def test_a_policy_that_fails_fails_its_own_board_alone():
    async def ask():
        decisions = DecisionQueue(thread, batch)
        codes = Episode.begin(EnvConfig(), seed=1).codes.copy()
        boards = [("ppo", codes), ("ppo", codes[:0]), ("frontier-cost", codes), ("ppo", codes)]
        asked = (decisions.act(load(name), grid) for name, grid in boards)
        return await asyncio.gather(*asked, return_exceptions=True)

    with ThreadPoolExecutor(1) as thread:
        first, error, rule, last = asyncio.run(ask())
    assert first == last in range(4)
    assert rule in range(4)
    assert isinstance(error, ValueError)
