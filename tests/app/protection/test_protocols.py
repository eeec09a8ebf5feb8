"""How answers are written: head and body at once, since each write wakes the client."""

import asyncio
import socket

from app.protection.protocols import HeadWithBody

HEAD = b"HTTP/1.1 200 OK\r\ncontent-length: 4\r\n\r\n"


class Recording(asyncio.Transport):
    """A transport that keeps what is written."""

    def __init__(self):
        super().__init__()
        self.written = []

    def write(self, data):
        if data:
            self.written.append(data)

    def close(self):
        self.written.append("closed")

    def is_closing(self):
        return "closed" in self.written


def written(*steps):
    """What a transport is given: by each write in one turn of the event loop, None ends a turn, "close" closes."""
    recording = Recording()

    async def write():
        joined = HeadWithBody(recording, asyncio.get_running_loop())
        for step in steps:
            if step is None:
                await asyncio.sleep(0)
            elif step == "close":
                joined.close()
            else:
                joined.write(step)

    asyncio.run(write())
    return recording.written


def test_head_and_body_are_one_write():
    assert written(HEAD, b"body", b"", None) == [HEAD + b"body"]


def test_a_head_whose_body_comes_later_goes_ahead():
    assert written(HEAD, None, b"bo", b"dy", b"") == [HEAD, b"bo", b"dy"]


def test_a_head_without_a_body_is_written():
    assert written(HEAD, b"", b"", None) == [HEAD]
    assert written(HEAD, "close", None) == [HEAD, "closed"]


def test_a_note_to_go_on_is_written_at_once():
    note = b"HTTP/1.1 100 Continue\r\n\r\n"
    assert written(note, HEAD, b"body") == [note, HEAD + b"body"]


def test_a_server_sends_an_answer_in_one_piece(serve):
    server = serve()
    with socket.create_connection(("127.0.0.1", server.port)) as asking:
        asking.sendall(f"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        assert asking.recv(65536).endswith(b'{"status":"ok"}')
