"""A caller's own memory as the output: NumPy arrays, torch tensors, DLPack."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from marsexplorer.compiled import kernel


def shared_array(out: Any, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """A NumPy array on the very memory of `out`, to be written to.

    Args:
        out: Memory of that shape and dtype: the processor's, C-contiguous and writable.
        shape: The shape that `out` must have.
        dtype: The dtype that `out` must have.

    Raises:
        TypeError: If `out` shares no memory or has another dtype.
        ValueError: If `out` has another shape or order, or is read-only.
    """
    wanted = f"out must be {np.dtype(dtype)}{list(shape)} in the processor's memory, writable and C-contiguous"
    array = _array_on(out, wanted)
    if array.dtype != np.dtype(dtype):
        raise TypeError(f"{wanted}; got {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{wanted}; got the shape {list(array.shape)}")
    if not array.flags.c_contiguous:
        raise ValueError(
            f"{wanted}; this one is not contiguous: make it with empty() or contiguous()"
        )
    if not array.flags.writeable:
        raise ValueError(
            f"{wanted}; this one is read-only, as the arrays of JAX are: give a NumPy array or a torch tensor"
        )
    return array


def _array_on(out: Any, wanted: str) -> NDArray[Any]:
    if isinstance(out, np.ndarray):
        return out
    try:
        # NumPy before 2.1 makes DLPack's read-only
        if hasattr(out, "__array__") or hasattr(out, "__array_interface__"):
            return np.asarray(out)
        return np.from_dlpack(out)
    except (TypeError, RuntimeError, BufferError, AttributeError) as error:
        raise TypeError(f"{wanted}; got {type(out).__name__}, which shares none: {error}") from None


@kernel
def write_values(
    codes: NDArray[np.uint8], values: NDArray[np.float32], out: NDArray[np.float32]
) -> None:
    """Write values[code] for every code to out.

    codes uint8[num], values float32[4], out float32[num]
    """
    for i in range(codes.shape[0]):
        out[i] = values[codes[i]]
