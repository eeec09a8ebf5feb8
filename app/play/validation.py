"""The size of a board over the API, and errors of pydantic as one plain sentence: what was expected and what came."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Annotated, Any

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


NO_BODY = "expected a JSON object, sent with Content-Type: application/json"
CLIENT_KINDS = '"act", "history" or "events"'
"""The kinds of message that a socket takes."""

_TYPES = {
    "int": "a whole number", "float": "a number", "string": "text", "bool": "true or false",
    "list": "a list", "dict": "a JSON object", "model": "a JSON object", "model_attributes": "a JSON object",
}  # fmt: skip
_TAGS = ("body", "query", "path", "act", "history", "events")


def describe_errors(errors: Sequence[Any]) -> str:
    """Return pydantic's errors as one sentence, the first three at most."""
    return "; ".join(dict.fromkeys(_clause(error) for error in errors[:3]))


def _clause(error: dict[str, Any]) -> str:
    kind, context = str(error["type"]), error.get("ctx", {})
    loc = error["loc"][1:] if error["loc"] and error["loc"][0] in _TAGS else error["loc"]
    names = [str(part) for part in loc]
    name, came = (names[-1] if names else "the message"), _shown(error.get("input"))
    bounds = {
        "ge": "at least",
        "gt": "more than",
        "le": "at most",
        "lt": "less than",
        "max_length": "at most",
    }
    bound = next(
        (f"{words} {_plain(context[key])}" for key, words in bounds.items() if key in context), None
    )
    if kind == "value_error":
        return str(context["error"])
    if kind == "json_invalid":
        return f"a message must be JSON, and this is not: {context['error']}"
    if kind == "too_long":
        return f"{name} must hold at most {context['max_length']}, got {context['actual_length']}"
    if kind == "missing":
        return f"{name} is missing" if names else NO_BODY
    if kind == "model_attributes_type" and not names:
        return f"{NO_BODY}, got {came}"
    if kind == "union_tag_not_found":
        return f"kind is missing: expected {CLIENT_KINDS}"
    if kind == "union_tag_invalid":
        return f"kind must be {CLIENT_KINDS}, got {context['tag']!r}"
    if kind == "literal_error":
        return f"{name} must be {'true' if context['expected'] == 'True' else context['expected']}, got {came}"
    if bound is not None:
        return f"{name} must be {bound}{' characters long' if 'max_length' in context else ''}, got {came}"
    expected = _TYPES.get(
        kind.removesuffix("_type").removesuffix("_parsing").removesuffix("_from_float")
    )
    return (
        f"{name} must be {expected}, got {came}"
        if expected
        else f"{name}: {error['msg']}, got {came}"
    )


def _plain(bound: float) -> str:
    return str(int(bound)) if bound == int(bound) else str(bound)


def _shown(value: object) -> str:
    text = repr(value) if isinstance(value, bytes) else json.dumps(value, default=repr)
    return text if len(text) <= 60 else f"{text[:57]}..."
