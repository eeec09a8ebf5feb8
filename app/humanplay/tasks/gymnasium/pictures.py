"""What `render` returns, as the picture that is shown."""

from __future__ import annotations

from importlib import import_module

import numpy as np
from numpy.typing import NDArray

EXPECTED = "a picture (uint8, rows x columns x 3)"


def pixels_of(rendered: object) -> NDArray[np.uint8]:
    """Convert what `render` returned to RGB.

    Args:
        rendered: An array of rows x columns, with 1, 3 or 4 channels or none, of whole numbers from 0 to 255 or of
            truth values; a list of such frames, of which the last is shown; a picture of Pillow; or a figure of
            matplotlib.

    Returns:
        uint8[rows, columns, 3]

    Raises:
        ValueError: It is none of these; the text says what came and the way out.
    """
    if isinstance(rendered, (list, tuple)) and rendered and isinstance(rendered[-1], np.ndarray):
        rendered = rendered[-1]
    if any(base.__module__ == "matplotlib.figure" for base in type(rendered).__mro__):
        rendered = _drawn(rendered)
    if rendered is None:
        raise ValueError(
            f"render returned nothing: expected {EXPECTED} where it is made with render_mode='rgb_array'"
        )
    array = np.asarray(rendered)
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3 or array.shape[2] not in (1, 3, 4) or 0 in array.shape:
        raise ValueError(f"render returned {_described(array)}: expected {EXPECTED}{_way(array)}")
    array = _bytes(array)
    if array.shape[2] == 1:
        return np.repeat(array, 3, axis=2)
    return np.ascontiguousarray(array[:, :, :3])


def _drawn(figure: object) -> object:
    """The pixels of a figure of matplotlib, one that was closed too."""
    # `pyplot.close` takes from a figure what could draw it
    canvas = import_module("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    canvas.draw()
    return canvas.buffer_rgba()


def _bytes(array: NDArray[np.generic]) -> NDArray[np.uint8]:
    """A picture's numbers as bytes; ValueError if they are not from 0 to 255."""
    if array.dtype == np.uint8:
        return array.astype(np.uint8, copy=False)
    if array.dtype == np.bool_:
        return 255 * array.astype(np.uint8)
    is_whole = array.dtype.kind in "iu"
    if is_whole and int(array.min()) >= 0 and int(array.max()) <= 255:
        return array.astype(np.uint8)
    raise ValueError(f"render returned {_described(array)}: expected {EXPECTED}{_way(array)}")


def _described(array: NDArray[np.generic]) -> str:
    """Return type, shape and range of an array in words."""
    shape = " x ".join(map(str, array.shape)) or "a single value"
    if array.dtype.kind not in "iuf" or array.size == 0:
        return f"{array.dtype} ({shape})"
    return f"{array.dtype} ({shape}) from {array.min():g} to {array.max():g}"


def _way(array: NDArray[np.generic]) -> str:
    """How to make a picture of an array that is nearly one; empty if unknown."""
    if array.ndim == 3 and array.shape[0] in (1, 3, 4) and array.shape[2] not in (1, 3, 4):
        return "; its channels come first: return np.moveaxis(picture, 0, -1)"
    if array.dtype.kind == "f":
        return "; return (255 * picture).astype(np.uint8) where it is from 0 to 1"
    return ""
