"""What takes long to read is refused before it is read: thousands of header lines, or a body in thousands of pieces."""

import json
import socket as sockets
import time

import h11
import pytest

from app.protection.parser import HEAD_BYTES, MOST_LINES, MOST_PIECES, LimitedParser
from tests.support.servers import eventually

START = b"POST /api/sessions HTTP/1.1\r\nHost: 127.0.0.1\r\n"
CHUNKED = START + b"Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
JSON = b"Content-Type: application/json\r\n"
BODY = b'{"size": 9}'


def chunks(data, size=1):
    """A body in pieces of so many bytes, each with its length before it."""
    pieces = [data[start : start + size] for start in range(0, len(data), size)]
    return b"".join(b"%x\r\n%s\r\n" % (len(each), each) for each in pieces)


def answer_to(server, *parts):
    """What the server answers to some bytes, until it has answered or closed the connection."""
    with sockets.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        try:
            for each in parts:
                connection.sendall(each)
        except OSError:
            pass  # it is closed already
        head, _, body = connection.recv(65536).partition(b"\r\n\r\n")
        return head.decode(), body


def events(parser, *parts):
    """What a parser reads in some bytes, and whether the server answers and goes on."""
    found = []
    for each in parts:
        parser.receive_data(each)
        while (event := parser.next_event()) not in (h11.NEED_DATA, h11.PAUSED):
            found.append(type(event))
    return found


def spent_ms(data):
    """Processor time that reading takes, until it is refused."""
    parser, began = LimitedParser(), time.process_time()
    with pytest.raises(h11.RemoteProtocolError):
        events(parser, data)
    return 1000 * (time.process_time() - began)


def test_headers_of_many_lines_are_refused_in_words(server):
    head, body = answer_to(server, START + b"a:\r\n" * 3000 + b"\r\n")
    assert head.startswith("HTTP/1.1 431 ")
    assert (
        json.loads(body)["detail"] == f"the headers of a request must be {MOST_LINES} lines at most"
    )
    assert server.services.protection.refusals == {"long_request": 1}
    eventually(lambda: server.services.protection.connections.slots.open == 0)


def test_long_headers_are_refused_in_words(server):
    head, body = answer_to(server, START + b"a: " + b"a" * 100_000 + b"\r\n\r\n")
    assert head.startswith("HTTP/1.1 431 ")
    assert (
        json.loads(body)["detail"] == f"the headers of a request must be {HEAD_BYTES} bytes at most"
    )
    eventually(lambda: server.services.protection.connections.slots.open == 0)


def test_headers_of_as_many_lines_as_may_be_are_read_whatever_follows(server):
    lines = START + JSON + b"Content-Length: 500\r\n"
    head, _ = answer_to(
        server,
        lines + b"a:\r\n" * (MOST_LINES - lines.count(b"\n")) + b"\r\n" + BODY.ljust(500, b"\n"),
    )
    assert head.startswith("HTTP/1.1 201 ")
    assert not server.services.protection.refusals


def test_headers_of_a_request_behind_another_are_counted_too():
    parser = LimitedParser()
    assert events(
        parser, b"GET / HTTP/1.1\r\nHost: a\r\n\r\n" + START + b"a:\r\n" * 200 + b"\r\n"
    ) == [
        h11.Request,
        h11.EndOfMessage,
    ]
    parser.send(h11.Response(status_code=204, headers=[]))
    parser.send(h11.EndOfMessage())
    parser.start_next_cycle()
    with pytest.raises(h11.RemoteProtocolError, match="lines at most"):
        parser.next_event()


def test_a_body_in_a_few_pieces_is_read_and_one_in_many_is_refused(server):
    head, _ = answer_to(server, CHUNKED, chunks(BODY), b"0\r\n\r\n")
    assert head.startswith("HTTP/1.1 201 ")
    head, body = answer_to(server, CHUNKED, chunks(BODY.ljust(2 * MOST_PIECES)), b"0\r\n\r\n")
    assert head.startswith("HTTP/1.1 431 ")
    assert json.loads(body)["detail"] == f"a body must come in {MOST_PIECES} pieces at most"
    head, _ = answer_to(server, CHUNKED, b"0\r\n" + b"a:\r\n" * 400 + b"\r\n")
    assert head.startswith("HTTP/1.1 431 "), "what follows a body is headers once more"


def test_the_longest_body_passes_in_packets_of_a_network():
    parser, packet = LimitedParser(), b" " * 1200
    head = START + b"Content-Length: 65536\r\n\r\n"
    found = events(parser, head, *[packet] * (65536 // 1200), b" " * (65536 % 1200))
    assert found == [h11.Request, *[h11.Data] * 55, h11.EndOfMessage]


def test_reading_what_is_refused_takes_few_milliseconds():
    """h11 alone takes 10 ms for the first, and 25 for the second."""
    assert spent_ms(START + b"a:\r\n" * (HEAD_BYTES // 4)) < 2
    assert spent_ms(CHUNKED + chunks(b" " * 2000)) < 2
    assert spent_ms(START + b"a: " + b"a" * HEAD_BYTES) < 2
