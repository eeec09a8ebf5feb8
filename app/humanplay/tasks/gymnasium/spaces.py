"""Gymnasium's spaces as JSON, for datasets of an environment that is gone."""

from __future__ import annotations

import base64
from typing import TypedDict

import numpy as np
from gymnasium import Space, spaces
from numpy.typing import NDArray

from humanplay.tasks.gymnasium.values import packed, unpacked


class SpaceText(TypedDict, total=False):
    """A space, by what its kind has."""

    kind: str
    n: int
    start: int
    counts: list[int]
    starts: list[int]
    bounds: list[str]
    shape: list[int]
    lengths: list[int]
    characters: str
    names: list[str]
    parts: list[SpaceText]


def to_json(space: object) -> SpaceText:
    """Describe a space; ValueError for a kind of a package's own."""
    match space:
        case spaces.Discrete():
            return {"kind": "Discrete", "n": int(space.n), "start": int(space.start)}
        case spaces.MultiDiscrete():
            counts, start = space.nvec.tolist(), space.start.tolist()
            return {"kind": "MultiDiscrete", "counts": counts, "starts": start}
        case spaces.MultiBinary():
            return {"kind": "MultiBinary", "shape": list(space.shape)}
        case spaces.Box():
            return {"kind": "Box", "bounds": _texts(space.low, space.high)}
        case spaces.Text():
            characters = "".join(space.character_list)
            lengths = [space.min_length, space.max_length]
            return {"kind": "Text", "lengths": lengths, "characters": characters}
        case spaces.Dict():
            parts = [to_json(part) for part in space.spaces.values()]
            return {"kind": "Dict", "names": list(space.spaces), "parts": parts}
        case spaces.Tuple():
            return {"kind": "Tuple", "parts": [to_json(part) for part in space.spaces]}
        case _:
            raise ValueError(f"a space of {type(space).__name__} cannot be described")


def from_json(described: SpaceText) -> Space[object]:
    """The space that `to_json` described."""
    match described["kind"]:
        case "Discrete":
            return spaces.Discrete(described["n"], start=described["start"])
        case "MultiDiscrete":
            return spaces.MultiDiscrete(described["counts"], start=described["starts"])
        case "MultiBinary":
            shape = described["shape"]
            return spaces.MultiBinary(shape[0] if len(shape) == 1 else shape)
        case "Box":
            low, high = _bounds(described["bounds"])
            return spaces.Box(low, high, dtype=low.dtype.type)
        case "Text":
            shortest, longest = described["lengths"]
            return spaces.Text(longest, min_length=shortest, charset=described["characters"])
        case "Dict":
            parts = zip(described["names"], described["parts"], strict=True)
            return spaces.Dict({name: from_json(part) for name, part in parts})
        case _:
            return spaces.Tuple([from_json(part) for part in described["parts"]])


def _texts(*arrays: object) -> list[str]:
    """Arrays with their types and shapes; a bound may be infinite, which JSON is not."""
    return [base64.b64encode(packed(np.asarray(array))).decode() for array in arrays]


def _bounds(texts: list[str]) -> list[NDArray[np.float32]]:
    """Two arrays of the numbers that the space has, which need not be of this type."""
    return [np.asarray(next(unpacked(base64.b64decode(text)))) for text in texts]
