"""A policy publishes thoughts about its own board alone, from its observation alone, and never about a person's."""

import json

import numpy as np
import pytest

from app.tasks.mars.messages import Expected, Thought
from app.tasks.mars.policies import PolicyCatalogue
from app.web.simulate import occupancy_codes
from marsexplorer import policies
from marsexplorer.config import FREE, ROVER, EnvConfig
from marsexplorer.policies.kernels.visibility import VisibilityMap
from tests.support.policy_files import write_network
from tests.support.servers import eventually

SIZE = [7, 9]


@pytest.fixture(scope="module")
def network_file(tmp_path_factory):
    """A file with an untrained network, which has thoughts all the same."""
    return write_network(tmp_path_factory.mktemp("policies") / "thinker.onnx")


@pytest.fixture
def client_and_server(serve, network_file):
    server = serve(policies=PolicyCatalogue([network_file]))
    return server.client(), server


def literally_expected(frame, visited):
    """(row, col) -> the unknown cells that a look from it should show, one cell after the other."""
    codes = occupancy_codes(frame)
    sight = VisibilityMap(codes.shape, EnvConfig.of("random", SIZE).sensor_radius)
    sight.fill(codes)
    free = [(int(row), int(col)) for row, col in np.argwhere((codes == FREE) | (codes == ROVER))]
    shown = {cell: sight.expected_discoveries(*cell) for cell in free if cell not in visited}
    return {cell: new for cell, new in shown.items() if new}


def test_each_frame_of_a_network_is_followed_by_its_thought_from_its_observation_alone(
    client_and_server, network_file
):
    client, server = client_and_server
    session = client.post(
        "/api/sessions", json={"size": SIZE, "player": "thinker", "seed": 3}
    ).json()["session"]
    client.post(f"/api/sessions/{session}/pace", json={"pause": True})
    client.post(f"/api/sessions/{session}/episodes", json={"seed": 3})  # paused from its beginning
    twin, frame, visited = policies.load(network_file), None, set()
    with server.socket(session, client) as socket:
        while frame is None or (frame["step"] < 12 and not frame["outcome"]):
            frame, thought = socket.receive("frame"), socket.receive("thought")
            Thought.model_validate(thought, strict=False)
            if frame["step"] == 0:
                twin.reset(0)
            while thought["step"] != frame["step"]:
                thought = socket.receive("thought")
            assert thought["episode"] == frame["episode"]
            twin.act(occupancy_codes(frame))
            shares, value = twin.thought()
            assert thought["probabilities"] == pytest.approx(shares, abs=1e-4)
            assert thought["value"] == pytest.approx(value, abs=2e-3)
            visited.add(tuple(frame["position"]))
            socket.send({"kind": "expected"})
            expected = Expected.model_validate(socket.receive("expected"), strict=False)
            assert (expected.episode, expected.step) == (frame["episode"], frame["step"])
            assert {(row, col): new for row, col, new in expected.cells} == literally_expected(
                frame, visited
            )
            client.post(f"/api/sessions/{session}/pace", json={"step": True})


def test_a_late_subscriber_receives_the_thought_about_the_newest_frame(client_and_server):
    client, server = client_and_server
    session = client.post("/api/sessions", json={"size": SIZE, "player": "thinker"}).json()[
        "session"
    ]
    client.post(f"/api/sessions/{session}/pace", json={"pause": True})
    client.post(f"/api/sessions/{session}/episodes", json={})  # paused from its beginning
    for _ in range(3):
        client.post(f"/api/sessions/{session}/pace", json={"step": True})
    eventually(lambda: client.get(f"/api/sessions/{session}").json()["step"] >= 3)
    with server.socket(session, client) as socket:
        step = socket.receive("frame")["step"]
        assert socket.receive("thought")["step"] == step


@pytest.mark.parametrize("name", ["frontier-cost", "random"])
def test_a_rule_says_where_it_heads_for_and_a_random_one_nothing(client_and_server, name):
    client, server = client_and_server
    session = client.post("/api/sessions", json={"size": SIZE, "player": name, "seed": 3}).json()[
        "session"
    ]
    client.post(f"/api/sessions/{session}/pace", json={"pause": True})
    client.post(f"/api/sessions/{session}/episodes", json={"seed": 3})  # paused from its beginning
    twin, frame, goals = policies.load(name), None, 0
    with server.socket(session, client) as socket:
        while frame is None or (frame["step"] < 8 and not frame["outcome"]):
            message = socket.receive()
            if message["kind"] == "frame":
                frame = message
                if frame["step"] == 0:
                    twin.reset(0)
                twin.act(occupancy_codes(frame))
                if name == "random" and not frame["outcome"]:
                    client.post(f"/api/sessions/{session}/pace", json={"step": True})
            elif message["kind"] == "thought":
                Thought.model_validate(message, strict=False)
                assert message["step"] == frame["step"]
                assert (message["probabilities"], message["value"]) == (None, None)
                row, col = message["goal"]
                assert (row, col) == policies.goal_of(twin)
                assert frame["grid"][row][col] == ".", "a known cell that is free"
                goals += 1
                client.post(f"/api/sessions/{session}/pace", json={"step": True})
    assert (goals > 5) is (name != "random")


@pytest.mark.parametrize("rival", [None, "thinker", "frontier-cost"])
def test_no_thought_is_published_about_a_persons_board(client_and_server, rival):
    _, server = client_and_server
    client = server.page()
    body = {"size": SIZE} | ({"rival": rival} if rival else {})
    about = client.post("/api/sessions", json=body).json()
    assert about["counts"] == (rival is None)
    seen = []
    with server.socket(about["session"], client) as socket:
        frame = socket.receive("frame")
        for step in range(6):
            action = (
                ("east", "west")[step % 2]
                if occupancy_codes(frame)[0, 1] != 3
                else ("south", "north")[step % 2]
            )
            socket.act(frame, action, input="key")
            while frame["step"] <= step:
                message = socket.receive()
                seen.append(message["kind"])
                frame = message if message["kind"] == "frame" else frame
        socket.send({"kind": "expected"})
        assert "policy's own board" in socket.receive("error")["detail"]
    assert "thought" not in seen
    assert "expected" not in seen
    session = server.services.lobby.sessions()[0]
    with pytest.raises(RuntimeError, match="person's board"):
        session.publish_thought("{}")
    answers = json.dumps(
        [client.get(f"/api/sessions/{about['session']}{end}").json() for end in ("", "/about")]
    )
    assert "probabilities" not in answers
    assert "goal" not in answers
