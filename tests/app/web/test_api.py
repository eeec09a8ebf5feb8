"""Whole episodes over HTTP, each frame against the core; and bad input."""

import html
import json
import re

import pytest

from humanplay.tasks.mars.messages import DRAWN_LEVELS
from humanplay.tasks.mars.run import View
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.policies import load
from marsexplorer.terrain import generate
from tests.support.exported import rows_of
from tests.support.servers import eventually


def play(client, session, frame, episode, policy):
    """Play to the end and check every frame against an episode of our own."""
    policy.reset(1)
    while frame["outcome"] is None:
        action = policy.act(episode.codes.copy())
        body = {"episode": frame["episode"], "step": frame["step"], "action": ACTIONS[action]}
        answer = client.post(f"/api/sessions/{session}/act", json=body)
        assert answer.status_code == 200
        episode.step(action)
        assert answer.text == View(episode).frame(frame["episode"])
        frame = answer.json()
    return frame


LEVELS = [
    ("random", 21),
    ("2-1-1", [12, 17]),
    ("building", [9, 14]),
    ("cave", [9, 14]),
]


@pytest.mark.parametrize(("level", "size"), LEVELS)
def test_a_script_plays_a_whole_episode_and_every_frame_is_the_cores(server, level, size):
    client = server.client()
    answer = client.post("/api/sessions", json={"level": level, "size": size, "seed": 11})
    assert answer.status_code == 201
    begun = answer.json()
    expected = {"player": "human", "level": level, "size": size, "counts": False, "rival": None}
    assert expected.items() <= begun.items()
    shape = size if isinstance(size, int) else tuple(size)
    episode = Episode.begin(EnvConfig.of(level, shape), seed=11)
    assert json.loads(View(episode).frame(begun["frame"]["episode"])) == begun["frame"]
    last = play(client, begun["session"], begun["frame"], episode, load("frontier-cost"))
    assert last["outcome"] == episode.outcome == "explored"
    stored = client.get(f"/api/episodes/{last['episode']}").json()
    assert [ACTIONS.index(action) for action in stored["actions"]] == list(episode.actions)
    expected = {"seed": 11, "outcome": "explored", "driver": "script", "counts": False}
    expected |= {name: last[name] for name in ("coverage", "score")}
    assert expected.items() <= stored.items()
    assert stored["trajectory_hash"] == episode.record().trajectory_hash
    assert last["cells"] == episode.cells, "what nobody can see counts for nothing"
    assert last["coverage"] == last["discovered"] / last["cells"]
    assert client.get("/api/me/history").json()["episodes"][0]["coverage"] == last["coverage"]
    run = client.get(f"/api/episodes/{last['episode']}/replay").json()["run"]
    assert (run["cells"], run["discovered"][-1]) == (last["cells"], last["discovered"])
    rows = rows_of(client.get("/api/export/episodes.csv").text)
    assert [(row["coverage"], row["verified"]) for row in rows] == [(last["coverage"], True)]
    history = client.get(f"/api/sessions/{begun['session']}/history").json()
    assert [tuple(at) for at in history["positions"]] == episode.path
    assert history["discovered"] == list(episode.discoveries)
    act = {"episode": last["episode"], "step": 0, "action": "east"}
    again = client.post(f"/api/sessions/{begun['session']}/act", json=act)
    assert again.status_code == 409
    assert "ended" in again.json()["detail"]


def test_a_repeat_is_harmless(server):
    client = server.client()
    begun = client.post("/api/sessions").json()
    url, frame = f"/api/sessions/{begun['session']}", begun["frame"]
    body = {"episode": frame["episode"], "step": 0, "action": "south"}
    first = client.post(f"{url}/act", json=body)
    for stale in (body, {**body, "step": 2}, {**body, "episode": "another", "step": 1}):
        repeat = client.post(f"{url}/act", json=stale)
        assert repeat.status_code == 409
        assert repeat.json()["frame"] == first.json()
    assert client.get(url).text == first.text


def test_the_seed_of_an_unfinished_episode_is_given_to_nobody(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"rival": "random"}).json()
    url, episode = f"/api/sessions/{begun['session']}", begun["frame"]["episode"]
    paths = (url, f"{url}/about", f"{url}/history", "/api/episodes", "/api/export/episodes.csv")
    answers = [json.dumps(begun), *(client.get(path).text for path in paths)]
    row = server.services.store.resume_session(begun["session"]).episode
    assert not any(str(row.seed) in text or row.terrain.hex() in text for text in answers)
    assert client.get(f"/api/episodes/{episode}").status_code == 404


def test_the_next_episode_abandons_the_running_one_and_keeps_what_is_left_out(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"level": "3-1-1", "size": [9, 14], "seed": 5}).json()
    url, first = f"/api/sessions/{begun['session']}", begun["frame"]["episode"]
    client.post(f"{url}/act", json={"episode": first, "step": 0, "action": "south"})
    answer = client.post(f"{url}/episodes")
    assert answer.status_code == 201
    following = answer.json()
    assert [following[name] for name in ("session", "level", "size")] == [
        begun["session"],
        "3-1-1",
        [9, 14],
    ]
    assert (following["frame"]["step"], following["frame"]["episode"] != first) == (0, True)
    stored = client.get(f"/api/episodes/{first}").json()
    assert (stored["outcome"], stored["steps"]) == ("abandoned", 1)
    changed = client.post(f"{url}/episodes", json={"size": 6, "level": "random", "seed": 3}).json()
    assert (changed["size"], changed["level"], changed["counts"]) == (6, "random", False)
    assert client.get(f"{url}/about").json() == changed


def test_lists_go_on_after_the_last_episode_of_the_page_before(server):
    client = server.client()
    url = f"/api/sessions/{client.post('/api/sessions').json()['session']}"
    for _ in range(3):
        client.post(f"{url}/episodes")
    mine = [row["episode"] for row in client.get("/api/me/history").json()["episodes"]]
    assert len(mine) == 3
    for path, page_of in (
        ("/api/episodes", lambda answer: answer),
        ("/api/me/history", lambda answer: answer["episodes"]),
    ):
        for at, last in enumerate(mine, 1):
            page = page_of(client.get(f"{path}?limit=2&after={last}").json())
            assert [row["episode"] for row in page] == mine[at : at + 2]
        lost = client.get(f"{path}?after=lost")
        assert lost.status_code == 404
        assert "'lost'" in lost.json()["detail"]


AS_JSON = {"Content-Type": "application/json"}
BAD = [
    ({"level": "8-8-8"}, "no level '8-8-8'; choose one of: " + ", ".join(DRAWN_LEVELS)),
    ({"size": 3}, "rows must be at least 5, got 3"),
    ({"size": [7, 3]}, "cols must be at least 5, got 3"),
    ({"size": 500}, "rows must be at most 128 over the API, got 500"),
    ({"size": [5, 6, 7]}, "size must be a whole number or [rows, cols], got 3 values"),
    ({"size": True}, "size must be a whole number or [rows, cols], got True"),
    ({"size": [5.0, 6]}, "rows must be a whole number, got 5.0"),
    ({"seed": 2**53}, "seed must be at most 9007199254740991, got 9007199254740992"),
    ({"seed": "7"}, 'seed must be a whole number, got "7"'),
    ({"seed": -1}, "seed must be at least 0, got -1"),
    ({"player": "ppo9"}, "no policy 'ppo9'; choose one of: human, "),
    ({"rival": "../../etc/passwd"}, "no policy '../../etc/passwd'; choose one of: "),
    ({"rival": "human"}, "no policy 'human'; choose one of: "),
    (
        {"seeed": 1},
        "unknown field 'seeed'; the fields are: seed, player, rival, replays, challenges, level, size, map",
    ),
    ({"level": "\ud800"}, "no level '\\ud800'"),
    ([], "expected a JSON object"),
]


def test_a_bad_request_gets_422_and_nothing_begins(server):
    client = server.client()
    for body, reason in BAD:
        answer = client.post("/api/sessions", content=json.dumps(body), headers=AS_JSON)
        assert answer.status_code == 422, body
        assert reason in answer.json()["detail"]
    assert client.get("/api/health").json()["sessions"] == 0


def test_bad_bodies_get_one_sentence_and_change_nothing(server):
    client = server.client()
    begun = client.post("/api/sessions").json()
    url, frame = f"/api/sessions/{begun['session']}", begun["frame"]
    up = b'{"episode": "e", "step": 0, "action": "up"}'
    for content, headers, status, reason in (
        (b"{", AS_JSON, 422, "must be JSON"),
        (b"\xff\xfe\x00", AS_JSON, 422, ""),
        (b"", AS_JSON, 422, "expected a JSON object"),
        (b'{"step": 0}', {}, 422, "Content-Type: application/json"),
        (up, AS_JSON, 422, "action must be 'north', 'east', 'south' or 'west'"),
        (b'{"a": "' + b"x" * 70_000 + b'"}', AS_JSON, 413, "at most 65536 bytes"),
    ):
        answer = client.post(f"{url}/act", content=content, headers=headers)
        assert answer.status_code == status, content[:40]
        assert reason in answer.json()["detail"]
    endless = client.post(f"{url}/act", content=iter([b"x" * 40_000] * 3), headers=AS_JSON)
    assert endless.status_code == 413
    assert client.get(url).json() == frame


def test_unknown_things_get_404_in_words(server):
    client = server.client()
    for path in ("", "/about", "/history"):
        answer = client.get(f"/api/sessions/nobody{path}")
        assert answer.status_code == 404
        assert "no session 'nobody'" in answer.json()["detail"]
    assert client.post("/api/sessions/nobody/episodes").status_code == 404
    assert client.get("/viewer/nobody/").status_code == 404
    assert "no finished episode 'x'" in client.get("/api/episodes/x").json()["detail"]
    asked = (
        ("GET", "/api/session", 404),
        ("GET", "/static/none.js", 404),
        ("PUT", "/api/health", 405),
    )
    for method, path, status in asked:
        answer = client.request(method, path)
        assert answer.status_code == status
        assert f"nothing answers {method} {path}; /docs" in answer.json()["detail"]
    assert client.get("/api/export/steps.xml").status_code == 404
    assert client.get("/api/export/steps.csv?who=me").status_code == 422
    assert "limit must be at least 1" in client.get("/api/episodes?limit=0").json()["detail"]


def test_what_can_be_chosen_is_listed(server):
    client = server.client()
    levels = client.get("/api/levels").json()
    assert [level["name"] for level in levels] == list(DRAWN_LEVELS)
    for level in levels:
        rocks = [[bits >> col & 1 for col in range(21)] for bits in level["example"]]
        assert rocks == generate(EnvConfig.of(level["name"], 21), 0).astype(int).tolist()
    policies = {policy["name"]: policy["summary"] for policy in client.get("/api/policies").json()}
    assert {"random", "frontier-cost", "frontier-utility", "frontier-priced"} <= policies.keys()
    assert all(policies.values())
    health = {"status": "ok", "core_version": "1", "database": "playground.db"}
    assert health.items() <= client.get("/api/health").json().items()
    assert client.get("/api/human-level").json()["figures"] == []


def test_the_documentation_needs_nothing_from_elsewhere(server):
    client = server.client()
    page = client.get("/docs")
    assert page.status_code == 200
    addresses = re.findall(r'(?:src|href)="([^"#]+)', page.text)
    assert addresses
    assert not [address for address in addresses if re.match(r"[a-z]+:|//", address)], (
        "of somebody else"
    )
    assert "https://" not in page.text
    for path, verbs in client.get("/openapi.json").json()["paths"].items():
        assert path in page.text
        for call in verbs.values():
            assert call["summary"]
            assert call["description"]


@pytest.mark.parametrize(
    ("task", "title"), [("mars", "MarsExplorer"), ("gymnasium:FrozenLake-v1", "FrozenLake-v1")]
)
def test_the_example_in_the_documentation_plays_whatever_is_played_here(serve, capsys, task, title):
    server = serve(task=task)
    page = server.client().get("/docs").text
    assert f"Play {title}, watch policies" in page
    example = html.unescape(re.search(r"<pre[^>]*>(import random.*?)</pre>", page, re.S)[1])
    exec(compile(example.replace("http://127.0.0.1:8000", server.url), "docs", "exec"), {})
    (episode,) = server.client().get("/api/episodes").json()
    assert capsys.readouterr().out.split()[0] == episode["outcome"]


def test_a_policys_session_is_driven_by_the_policy_alone(server):
    client = server.client()
    wanted = {"player": "frontier-cost", "size": 12, "seed": 5}
    begun = client.post("/api/sessions", json=wanted).json()
    url, frame = f"/api/sessions/{begun['session']}", begun["frame"]
    assert client.post(f"{url}/pace", json={"moves_per_second": 60}).json()["mode"] == "timed"
    act = {"episode": frame["episode"], "step": client.get(url).json()["step"], "action": "east"}
    assert client.post(f"{url}/act", json=act).status_code == 409
    last = eventually(lambda: (now := client.get(url).json())["outcome"] and now)
    stored = client.get(f"/api/episodes/{last['episode']}").json()
    assert (last["outcome"], stored["driver"]) == ("explored", "policy:frontier-cost")
    refused = client.post(f"{url}/pace", json={"follow": True})
    assert "only a rival can follow" in refused.json()["detail"]


def test_export_streams_what_was_played(server):
    client = server.client()
    begun = client.post("/api/sessions", json={"size": 6}).json()
    body = {"episode": begun["frame"]["episode"], "step": 0, "action": "north"}
    moved = client.post(f"/api/sessions/{begun['session']}/act", json=body)
    assert moved.json()["outcome"] == "out_of_bounds"
    (row,) = rows_of(client.get("/api/export/steps.csv").text)
    assert [row[name] for name in ("episode", "action", "verified")] == [
        body["episode"],
        "north",
        True,
    ]
    assert client.get("/api/export/episodes.csv").text.count("\n") == 2
    assert client.get("/api/export/episodes.csv?who=human").text.count("\n") == 1
