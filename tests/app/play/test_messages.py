"""Every message in both directions, and the sentence that each bad one gets."""

import json

import pytest
from pydantic import ValidationError

from humanplay.board.messages import (
    Act,
    BadMessageError,
    ChangePace,
    HistoryRequest,
    describe_errors,
    parse_message,
)
from humanplay.tasks.mars.run import View
from humanplay.tasks.mars.task import Mars
from humanplay.web.sockets import as_move
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode

ACT = {"kind": "act", "episode": "e", "step": 0, "action": "east"}


def test_an_act_and_a_request_for_history_are_understood():
    act = parse_message(
        json.dumps({**ACT, "input": "key", "key_down_ms": 12.5, "key_up_ms": None, "client_ms": 14})
    )
    assert isinstance(act, Act)
    assert (as_move(act, Mars, "script").action, act.input, act.key_down_ms, act.client_ms) == (
        1,
        "key",
        12.5,
        14,
    )
    assert isinstance(parse_message('{"kind":"history"}'), HistoryRequest)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", "a message must be JSON, and this is not"),
        ("", "a message must be JSON"),
        ("[1]", "JSON object"),
        ("null", "JSON object"),
        ("{}", "kind is missing"),
        ('{"kind":"jump"}', 'kind must be "act", "history" or "events", got \'jump\''),
        ('{"kind":"act","episode":"e","step":0}', "action is missing"),
        (
            json.dumps({**ACT, "action": "up"}),
            "action must be 'north', 'east', 'south' or 'west', got \"up\"",
        ),
        (json.dumps({**ACT, "step": "0"}), 'step must be a whole number, got "0"'),
        (json.dumps({**ACT, "step": True}), "step must be a whole number, got true"),
        (json.dumps({**ACT, "step": -1}), "step must be at least 0, got -1"),
        (json.dumps({**ACT, "episode": 5}), "episode must be text, got 5"),
        (json.dumps({**ACT, "input": "mouse"}), "input must be 'key' or 'touch', got \"mouse\""),
        (json.dumps({**ACT, "client_ms": "now"}), 'client_ms must be a number, got "now"'),
        (json.dumps({**ACT, "client_ms": float("nan")}), "client_ms"),
        (
            json.dumps({**ACT, "stp": 0}),
            "unknown field 'stp'; the fields are: kind, episode, step, action",
        ),
        (json.dumps({**ACT, "episode": "x" * 65}), "episode must be at most 64 characters long"),
        ("x" * 70_000, "a message must be at most 65536 bytes, got 70000"),
        ('"\\ud800"', "JSON"),
    ],
)
def test_a_bad_message_is_answered_with_what_was_expected_and_what_came(text, sentence):
    with pytest.raises(BadMessageError) as caught:
        as_move(parse_message(text), Mars, "script")
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ({}, "a pace is exactly one of moves_per_second, pause, step, follow; got none"),
        ({"pause": True, "step": True}, "got pause, step"),
        ({"pause": False}, "pause must be true, got false"),
        ({"moves_per_second": 0}, "moves_per_second must be more than 0, got 0"),
        ({"moves_per_second": 61}, "moves_per_second must be at most 60, got 61"),
    ],
)
def test_a_pace_is_exactly_one_of_four(body, sentence):
    with pytest.raises(ValidationError) as caught:
        ChangePace.model_validate(body)
    assert sentence in describe_errors(caught.value.errors())


def test_a_frame_shows_what_the_rover_has_discovered_row_by_row():
    import numpy as np

    terrain = np.zeros((5, 7), bool)
    terrain[0, 1] = terrain[1, 1] = True
    episode = Episode.begin(EnvConfig("random", 5, 7, sensor_radius=2), terrain=terrain)
    frame = json.loads(View(episode).frame("e1"))
    assert frame["grid"] == ["@#?????", ".#?????", ".??????", "???????", "???????"]
    assert (frame["episode"], frame["step"], frame["rows"], frame["cols"], frame["position"]) == (
        "e1",
        0,
        5,
        7,
        [0, 0],
    )
    assert (frame["discovered"], frame["outcome"], frame["heading"]) == (5, None, "east")
    episode.step(2)
    assert json.loads(View(episode).frame("e1"))["grid"][:2] == [".#?????", "@#?????"]
    assert json.loads(View(episode).history("e1"))["positions"] == [[0, 0], [1, 0]]
    episode.step(1)
    frame = json.loads(View(episode).frame("e1"))
    assert (frame["outcome"], frame["reward"], frame["return"]) == (
        "collided",
        -35.0,
        episode.total,
    )
