"""What other people's environments return: numbers checked, observations packed."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def finite(name: str, env_number: Any) -> float:
    """An environment's number as a float; ValueError if it is not finite.

    Neither the database nor JSON holds one that is not.
    """
    if not math.isfinite(number := float(env_number)):
        raise ValueError(f"its {name} is {number}, which is no finite number")
    return number


def two_of(returned: object) -> tuple[object, dict[str, object]]:
    """Observation and info, as `reset` returned them; ValueError for anything else."""
    if isinstance(returned, tuple) and len(returned) == 2 and isinstance(returned[1], dict):
        return returned
    raise ValueError(
        f"reset returned {type(returned).__name__}: expected (observation, info), as Gymnasium has it"
    )


def reward_of(env_id: str, env_reward: object) -> float:
    """An environment's reward as a float; ValueError if it is several numbers."""
    size = np.asarray(env_reward).size
    if size == 1:
        return float(np.asarray(env_reward).item())
    raise ValueError(
        f"{env_id} pays a reward of {size} numbers, and one is expected: name a wrapper such as "
        "mo_gymnasium.wrappers.LinearReward, with its weights, in a function that makes the environment, and what else "
        'counts by score = "info.NAME"'
    )


def bytes_of(observation: object) -> bytes:
    """An observation as bytes, with its types and shapes, to be hashed."""
    if isinstance(observation, Mapping):
        parts = ((str(key).encode(), bytes_of(observation[key])) for key in sorted(observation))
        return b"".join(part for pair in parts for part in pair)
    if isinstance(observation, tuple):
        return b"".join(map(bytes_of, observation))
    if isinstance(observation, str):
        return observation.encode()
    array = _numbers(observation)
    whole = np.ascontiguousarray(array)
    return b"".join((f"{array.dtype.str}{array.shape}".encode(), whole.view(np.uint8).data))


def _numbers(observation: object) -> NDArray[np.generic]:
    """A part of an observation as an array; ValueError if it holds Python objects."""
    array = np.asarray(observation)
    if array.dtype.hasobject:
        raise ValueError(
            f"its observation holds {type(observation).__name__} of objects: return numbers and texts, and dictionaries "
            "and tuples of them"
        )
    return array


def packed(observation: object) -> bytes:
    """Pack an observation with the types and shapes of its arrays."""
    arrays: list[bytes] = []
    shape = json.dumps(_shape_of(observation, arrays)).encode()
    content = b"".join(arrays)
    return struct.pack(">IQ", len(shape), len(content)) + shape + content


def _shape_of(observation: object, arrays: list[bytes]) -> list[object]:
    """The shape of an observation as JSON; adds the content of its arrays to `arrays`."""
    if isinstance(observation, Mapping):
        parts = [[str(key), _shape_of(part, arrays)] for key, part in observation.items()]
        return ["dict", parts]
    if isinstance(observation, tuple):
        return ["tuple", [_shape_of(part, arrays) for part in observation]]
    if isinstance(observation, str):
        return ["text", observation]
    array = _numbers(observation)
    arrays.append(array.tobytes())
    return ["array", array.dtype.str, list(array.shape)]


def unpacked(content: bytes) -> Iterator[object]:
    """Yield the observations that were packed one after the other."""
    start = 0
    while start < len(content):
        shape_bytes, array_bytes = struct.unpack_from(">IQ", content, start)
        start += 12
        shape = json.loads(content[start : start + shape_bytes])
        start += shape_bytes
        yield _rebuilt(shape, memoryview(content)[start : start + array_bytes], [0])
        start += array_bytes


def _rebuilt(shape: list[Any], content: memoryview, start: list[int]) -> object:
    """The observation of a shape; `start[0]` is where its next array begins."""
    kind, *rest = shape
    if kind == "dict":
        return {key: _rebuilt(part, content, start) for key, part in rest[0]}
    if kind == "tuple":
        return tuple(_rebuilt(part, content, start) for part in rest[0])
    if kind == "text":
        return str(rest[0])
    dtype, size = np.dtype(rest[0]), tuple(rest[1])
    array = np.frombuffer(content, dtype, math.prod(size), start[0]).reshape(size)
    start[0] += array.nbytes
    # environments return single numbers as NumPy's scalars
    return array.copy() if size else array[()]


def plain(observation: object) -> object:
    """An observation as JSON holds it.

    Arrays become nested lists; numbers that are not finite become null.
    """
    if isinstance(observation, Mapping):
        return {str(key): plain(part) for key, part in observation.items()}
    if isinstance(observation, (tuple, list)):
        return [plain(part) for part in observation]
    if isinstance(observation, str):
        return observation
    array = np.asarray(observation)
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        array = array.astype(object)
        array[~np.isfinite(array.astype(float))] = None
    return array.tolist()
