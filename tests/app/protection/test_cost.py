"""What the limits cost: a move's round trip beside that of a server without them, move by move in one run."""

import time
from statistics import median

import pytest
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

pytestmark = pytest.mark.bench

MOVES = 400
MOST_MS = 0.2


class NoBudget:
    """A budget that counts nothing."""

    def spend(self, kind):
        pass

    def take_delay_s(self):
        return 0.0


def test_the_limits_cost_a_move_at_most_a_fifth_of_a_millisecond(serve, tmp_path, monkeypatch):
    limited = serve()
    with monkeypatch.context() as patch:
        patch.setattr(
            "app.web.listening.limited_protocols", lambda _: (H11Protocol, WebSocketsSansIOProtocol)
        )
        bare = serve(database=tmp_path / "bare.db")
    monkeypatch.setattr(bare.services.protection, "socket_budget", lambda _: NoBudget())
    spent = {limited: [], bare: []}
    boards = {
        server: server.client().post("/api/sessions", json={"size": 42, "seed": 3}).json()
        for server in spent
    }
    with (
        limited.socket(boards[limited]["session"]) as first,
        bare.socket(boards[bare]["session"]) as second,
    ):
        sockets = {limited: first, bare: second}
        frames = {server: socket.receive("frame") for server, socket in sockets.items()}
        for move in range(MOVES):
            for server in (limited, bare) if move % 2 else (bare, limited):
                began = time.perf_counter()
                sockets[server].act(frames[server], "south" if move % 2 == 0 else "north")
                frames[server] = sockets[server].frame_after(move)
                spent[server].append((time.perf_counter() - began) * 1000)
    cost_ms = median(one - other for one, other in zip(spent[limited], spent[bare], strict=True))
    print(
        f"\nround trip of a move, median: {median(spent[bare]):.2f} ms without limits; with them {cost_ms:+.3f} ms"
    )
    assert cost_ms <= MOST_MS
