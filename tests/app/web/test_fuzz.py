"""Whatever a client sends, the server answers as described and never fails.

Tested are every call of the API's description, and every message of every socket.

What is sent is drawn from the seed alone, so a finding is found again.
"""

import json
import logging
import math
import random
import secrets
import sys
from collections import Counter
from contextlib import suppress

import msgspec
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from humanplay.tasks.mars.viewer3d.viser_transport import PROTOCOL
from humanplay.web.settings import Limits
from tests.support.page_loads import LOAD
from tests.support.servers import PATIENCE_S
from tests.support.study import Person, freeze
from tests.support.viewer3d import CAMERA

CASES, MESSAGES, ON_ONE_SOCKET = 40, 1500, 50
"""Cases of each call; messages to each socket, and those of them that one connection sends at most."""

MEANT = (503,)
"""Server statuses that are answers: too many ask at once."""

WORDS = [
    None, True, -1, 0, 2**63, -0.0, "", "\x00", "\ud800", "e" * 5000, [], {}, [[]], {"kind": "act"}, "NaN",
]  # fmt: skip
EXTREMES = [
    sys.float_info.max, -sys.float_info.max, 1e308, 1e155, sys.float_info.min, 5e-324, sys.float_info.epsilon, 2.0**53,
    math.inf, -math.inf, math.nan,
]  # fmt: skip
"""Floating-point numbers at which arithmetic overflows, vanishes or loses its order."""


@pytest.fixture
def faults(caplog):
    """Return what the server has logged as an error of its own."""
    caplog.set_level(logging.ERROR)
    return lambda: [record.getMessage() + str(record.exc_info) for record in caplog.records]


NO_LIMIT = {"messages": "1000000+1000000/s"}
"""Or a flood of messages would close each socket before the others on it are read."""


@pytest.fixture(params=[{}, NO_LIMIT], ids=["limited", "unlimited"])
def site(serve, tmp_path, request):
    freeze(tmp_path / "playground.db-studies", "small", warm_up=0)
    return serve(admin_password="correct-horse", limits=Limits(**request.param))


def real_ids(server):
    """Parameters that lead somewhere: a board, an ended episode, a joined study."""
    me = Person(server, client=server.page())
    begun = me.client.post("/api/sessions", json={"size": 5, "seed": 3, "player": "random"}).json()
    me.client.post(f"/api/sessions/{begun['session']}/pace", json={"moves_per_second": 8})
    return me.client, {
        "session_id": begun["session"], "watch_id": begun["watch"], "episode_id": begun["frame"]["episode"],
        "name": "small", "day": me.client.get("/api/daily").json()["day"],
        "board": "random-21x21",
    }  # fmt: skip


def without_tuples(schema):
    """An API description with lists of the same length in place of tuples.

    Schemathesis makes of tuples what it then refuses.
    """
    if isinstance(schema, list):
        return [without_tuples(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    parts = {name: without_tuples(part) for name, part in schema.items()}
    if "prefixItems" in parts:
        parts["items"] = {"anyOf": parts.pop("prefixItems")}
    return parts


@pytest.mark.long
@pytest.mark.parametrize("site", [{}], indirect=True)
@pytest.mark.filterwarnings("ignore")  # of schemathesis and of what it stands on, not of ours
def test_no_call_of_the_api_makes_a_server_error_or_an_answer_of_another_form(site, faults):
    import schemathesis
    from schemathesis.core.failures import FailureGroup
    from schemathesis.specs.openapi import checks as forms

    as_described = [
        forms.status_code_conformance,
        forms.content_type_conformance,
        forms.response_headers_conformance,
        forms.response_schema_conformance,
    ]

    client, ids = real_ids(site)
    client.event_hooks = {}  # all that is found is told at the end
    schema = schemathesis.openapi.from_dict(without_tuples(client.get("/openapi.json").json()))
    operations = [operation.ok() for operation in schema.get_all_operations()]
    assert len(operations) > 30
    asked, errors = [], []
    for operation in operations:
        checks = settings(
            max_examples=CASES, deadline=None, derandomize=True, database=None, phases=[Phase.generate],
            suppress_health_check=list(HealthCheck),
        )  # fmt: skip

        @checks
        @given(case=operation.as_strategy())
        def call(case):
            draw = random.Random(len(asked))
            for name in set(case.path_parameters or {}) & set(ids):
                if draw.random() < 0.7:
                    case.path_parameters[name] = ids[name]
            sent = case.as_transport_kwargs(base_url=site.url)
            sent.pop("cookies", None)
            # what no client can write into a header or an address
            with suppress(UnicodeError, ValueError):
                request = client.build_request(
                    sent["method"], sent["url"], params=sent.get("params"), headers=dict(sent.get("headers") or {}),
                    json=sent.get("json"), content=sent.get("data"),
                )  # fmt: skip
                answer = client.send(request)
                asked.append(answer.status_code)
                if answer.status_code >= 500 and answer.status_code not in MEANT:
                    asked_for = (str(request.url)[:200], request.content[:200])
                    errors.append((answer.status_code, request.method, *asked_for))
                try:
                    case.validate_response(answer, checks=as_described)
                except FailureGroup as group:
                    failures = [str(failure)[:400] for failure in group.exceptions]
                    errors.append((request.method, str(request.url)[:200], failures))

        call()
    print(len(operations), "calls", sorted(Counter(asked).items()))
    assert errors == []
    assert faults() == []
    assert {200, 201, 404, 422} <= set(asked)
    assert len(asked) > 500


def mutated(message, draw):
    """Return a message, JSON or not, that differs from a good one in a few places."""
    if draw.random() < 0.15:
        return draw.randbytes(draw.randrange(200))
    if draw.random() < 0.2:
        text = list(json.dumps(message))
        for _ in range(draw.randrange(1, 6)):
            text[draw.randrange(len(text))] = draw.choice('{}[]",:\\\x00-.9eE\U0001f916')
        return "".join(text)
    message = json.loads(json.dumps(message))
    for _ in range(draw.randrange(1, 4)):
        place, key = draw.choice(list(places(message)))
        chance = draw.random()
        if chance < 0.2:
            place.pop(key)
        elif chance < 0.3 and isinstance(place, dict):
            place[draw.choice(["kind", "x", "episode", "step"])] = draw.choice(WORDS)
        else:
            place[key] = draw.choice(draw.choice([WORDS, EXTREMES]))
        if not message:
            return "{}"
    if draw.random() < (0.9 if "type" in message else 0.1):
        with suppress(UnicodeError, OverflowError):
            return msgspec.msgpack.encode(message)
    return json.dumps(message)


def places(value):
    """Yield (container, key) of everything inside a message."""
    for key, part in list(value.items() if isinstance(value, dict) else enumerate(value)):
        yield value, key
        if isinstance(part, dict | list):
            yield from places(part)


def sockets(server):
    """Yield each socket's name, address and options, and good messages to begin from."""
    page = server.page()
    begun = page.post("/api/sessions", json={"size": 5, "seed": 3}).json()
    policy = page.post("/api/sessions", json={"size": 5, "player": "random"}).json()
    page.post("/api/admin/login", json={"password": "correct-horse"})
    cookie = {"Cookie": "; ".join(f"{cookie.name}={cookie.value}" for cookie in page.cookies.jar)}
    frame = begun["frame"]
    event = {
        "kind": "keydown",
        "code": "ArrowUp",
        "repeat": False,
        "trusted": True,
        "client_ms": 5.0,
        "step": 0,
    }
    batch = {"batch": secrets.token_hex(8), **LOAD}
    events = {**batch, "events": [event, {**event, "kind": "keyup"}]}
    pressed = {"step": 0, "action": "east", "input": "key", "key_down_ms": 4.0}
    good = [
        {"kind": "act", "episode": frame["episode"], **pressed},
        {"kind": "events", "episode": frame["episode"], **events},
        {"kind": "history"},
    ]
    for session in (begun["session"], policy["session"]):
        yield f"/ws/sessions/{session}", {}, cookie, good
    yield f"/ws/watch/{begun['watch']}", {}, cookie, good
    yield f"/ws/admin/sessions/{begun['session']}", {}, cookie, good
    viewer = {"subprotocols": [PROTOCOL]}
    yield f"/viewer/{begun['session']}", viewer, cookie, [msgspec.msgpack.decode(CAMERA), *good]


def talk(url, options, messages):
    """Send messages over one connection while it is open.

    Returns how many went, and the code that it closed with.
    """
    plain = dict.fromkeys(("proxy", "compression", "max_size", "max_queue")) | {
        "open_timeout": PATIENCE_S
    }
    sent = 0
    with connect(url, **plain, **options) as connection:
        try:
            for message in messages:
                if isinstance(message, str):
                    message = message.encode("utf-8", "replace").decode()
                connection.send(message)
                sent += 1
                with suppress(TimeoutError):
                    while True:
                        connection.recv(timeout=0)
        except ConnectionClosed:
            pass
        connection.close()
        return sent, connection.close_code


@pytest.mark.long
def test_no_message_to_any_socket_makes_a_server_error(site, faults):
    draw = random.Random(15)
    for path, rest, headers, good in sockets(site):
        url = f"ws://127.0.0.1:{site.port}{path}"
        options = {"origin": site.url, "additional_headers": headers, **rest}
        results = [
            talk(url, options, [mutated(draw.choice(good), draw) for _ in range(ON_ONE_SOCKET)])
            for _ in range(MESSAGES // ON_ONE_SOCKET)
        ]
        codes = Counter(code for _, code in results)
        print(path, sum(sent for sent, _ in results), codes)
        assert faults() == [], path
        assert not {1006, 1011} & set(codes), "lost, or a server error"
    assert site.client().post("/api/sessions").status_code == 201
