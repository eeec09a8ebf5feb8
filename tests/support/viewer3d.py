"""A browser's 3-D view as a test client: its first messages, and the answers."""

import msgspec
import zstandard
from websockets.sync.client import connect

from humanplay.tasks.mars.viewer3d.viser_transport import PROTOCOL
from tests.support.servers import PATIENCE_S

CAMERA = msgspec.msgpack.encode(
    {
        "type": "ViewerCameraMessage",
        "wxyz": [1.0, 0.0, 0.0, 0.0],
        "position": [0.0, 0.0, 5.0],
        "fov": 0.8,
        "near": 0.01,
        "far": 1000.0,
        "image_height": 500,
        "image_width": 400,
        "look_at": [0.0, 0.0, 0.0],
        "up_direction": [0.0, 0.0, 1.0],
    }
)


class View:
    """A 3-D socket: its messages decompressed, with their arrays in place."""

    def __init__(self, server, session, stack, client=None):
        url = f"ws://127.0.0.1:{server.port}/viewer/{session}"
        cookies = (
            "; ".join(f"{cookie.name}={cookie.value}" for cookie in client.cookies.jar)
            if client
            else ""
        )
        plain = {
            "proxy": None,
            "compression": None,
            "max_size": None,
            "additional_headers": {"Cookie": cookies},
        }
        plain["open_timeout"] = PATIENCE_S
        self.socket = stack.enter_context(
            connect(url, subprotocols=[PROTOCOL], origin=server.url, **plain)
        )
        self.socket.send(CAMERA)

    def read(self, *awaited):
        """Every message, encoded, until all words have come, and what follows.

        A word has come if a message's name or type begins with it.
        """
        messages = []
        while not all(any(is_called(message, word) for message in messages) for word in awaited):
            messages += unpack(self.socket.recv(timeout=PATIENCE_S))
        try:
            while True:
                messages += unpack(self.socket.recv(timeout=0.1))
        except TimeoutError:
            return sorted(map(msgspec.msgpack.encode, messages))


def is_called(message, word):
    return message["type"].startswith(word) or str(message.get("name")).startswith(word)


def unpack(content):
    """The messages of one batch in viser's wire format.

    Sizes, packed messages, then the arrays on 8-byte bounds.
    """
    packed_length = int.from_bytes(content[8:16], "little")
    offset = 16 + packed_length
    batch = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(content[16:offset]))
    arrays = []
    for length in batch["binaryBufferLengths"]:
        offset += -offset % 8
        arrays.append(bytes(content[offset : offset + length]))
        offset += length
    return [whole(message, arrays) for message in batch["messages"]]


def whole(part, arrays):
    if isinstance(part, dict) and "__binary_index" in part:
        return [part["dtype"], arrays[part["__binary_index"]]]
    if isinstance(part, dict):
        return {key: whole(inner, arrays) for key, inner in part.items()}
    return [whole(inner, arrays) for inner in part] if isinstance(part, list | tuple) else part
