"""Errors of pydantic as one plain sentence: what was expected and what came."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

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
