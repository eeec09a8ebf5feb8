"""Pictures as JPEG, or as PNG: the difference of each row to the one above it, which changes little in a game's picture."""

from __future__ import annotations

import base64
import io
import struct
import zlib

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

SIGNATURE = b"\x89PNG\r\n\x1a\n"
UP = 2
"""PNG's filter that stores a row as its difference to the row above (section 9.2)."""


def png(pixels: NDArray[np.uint8], quick: bool = False) -> str:
    """Return uint8[height, width, 3] as the data URL of a PNG.

    quick  for pictures that somebody waits for: a tenth of the time, and up to three times the bytes
    """
    height, width, _ = pixels.shape
    rows = np.ascontiguousarray(pixels, np.uint8).reshape(height, 3 * width)
    filtered = np.empty((height, 1 + 3 * width), np.uint8)
    filtered[:, 0], filtered[0, 1:] = UP, rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    size = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    packed = isal_zlib.compress(filtered.data, 1) if quick else zlib.compress(filtered.data, 4)
    chunks = _chunk(b"IHDR", size) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")
    return f"data:image/png;base64,{base64.b64encode(SIGNATURE + chunks).decode()}"


def jpeg(pixels: NDArray[np.uint8]) -> str:
    """Return uint8[height, width, 3] as the data URL of a JPEG, a fraction of a PNG's bytes where it is like a photograph."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "JPEG", quality=90)
    return f"data:image/jpeg;base64,{base64.b64encode(out.getvalue()).decode()}"


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
