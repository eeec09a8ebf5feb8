"""The size of a board over the API: one side, or rows and columns."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema

from marsexplorer.config import MIN_SIDE

MAX_API_SIDE = 128
"""Longest side of a board over the API (cells)."""


def _check_side(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"{name} must be a whole number, got {value!r}")
    if value < MIN_SIDE:
        raise ValueError(f"{name} must be at least {MIN_SIDE}, got {value}")
    if value > MAX_API_SIDE:
        raise ValueError(f"{name} must be at most {MAX_API_SIDE} over the API, got {value}")
    return value


def parse_size(value: object) -> tuple[int, int]:
    """Return (rows, cols) of a whole number or a pair; ValueError otherwise."""
    if isinstance(value, (list, tuple)):
        if len(value) != 2:
            raise ValueError(
                f"size must be a whole number or [rows, cols], got {len(value)} values"
            )
        return _check_side("rows", value[0]), _check_side("cols", value[1])
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError(f"size must be a whole number or [rows, cols], got {value!r}")
    side = _check_side("rows", value)
    return side, side


_SIDE_SCHEMA = {"type": "integer", "minimum": MIN_SIDE, "maximum": MAX_API_SIDE}
_SIZE_SCHEMA = {
    "title": "Size",
    "description": "One side for a square board, or [rows, cols]; cells.",
    "anyOf": [_SIDE_SCHEMA, {"type": "array", "items": _SIDE_SCHEMA, "minItems": 2, "maxItems": 2}],
}
Size = Annotated[tuple[int, int], BeforeValidator(parse_size), WithJsonSchema(_SIZE_SCHEMA)]
