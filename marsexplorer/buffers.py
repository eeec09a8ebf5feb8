"""Memory that a caller gives to be written to: NumPy arrays, torch tensors, anything with DLPack or the array interface."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from marsexplorer.compiled import kernel


def shared_array(out: Any, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return a NumPy array on the very memory of `out`, to be written to.

    out  of that shape and dtype, in the processor's memory, C-contiguous and writable

    TypeError for what shares no memory or has another dtype, ValueError for another shape or order and for what is read-only.
    """
    wanted = f"out must be {np.dtype(dtype)}{list(shape)} in the processor's memory, writable and C-contiguous"
    array = _array_on(out, wanted)
    if array.dtype != np.dtype(dtype):
        raise TypeError(f"{wanted}; got {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{wanted}; got the shape {list(array.shape)}")
    if not array.flags.c_contiguous:
        why = "this one is not contiguous"
        raise ValueError(f"{wanted}; {why}: make it with empty() or contiguous()")
    if not array.flags.writeable:
        why = "as the arrays of JAX are: give a NumPy array or a torch tensor"
        raise ValueError(f"{wanted}; this one is read-only, {why}")
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
    """Write values[code] of each code to out; codes uint8[num], values float32[4], out float32[num]."""
    for i in range(codes.shape[0]):
        out[i] = values[codes[i]]
