"""The page at /docs: the API as one readable document.

It is made from the OpenAPI schema, from our own files alone.
"""

from __future__ import annotations

from typing import Any

from markupsafe import Markup, escape
from starlette.requests import Request

from humanplay.web.answers.openapi import answered_models
from humanplay.web.templates import addresses, environment

DESCRIPTION = """Play {}, watch policies do it, and read what was played. `POST /api/sessions` begins a board;
its `frame` holds what may be seen; `POST .../act` answers a frame with a move and brings the next.
Errors are `{{"detail": "..."}}` with what was expected and what came: 404 unknown, 409 not the current frame, 422 bad input."""
"""What the API is; the title of what is played goes into it."""

EXAMPLE = """import random

import httpx

with httpx.Client(base_url="http://127.0.0.1:8000") as api:       # one client keeps the player cookie
    session = api.post("/api/sessions", json={"seed": 7}).json()
    frame, actions = session["frame"], session["task"]["actions"]
    while frame["outcome"] is None:
        action = random.choice(frame.get("allowed") or actions)
        move = {"episode": frame["episode"], "step": frame["step"], "action": action}
        frame = api.post(f"/api/sessions/{session['session']}/act", json=move).json()
    print(frame["outcome"], frame["score"])"""

SOCKET = """ws(s)://.../ws/sessions/{session}       a board begun by a page needs the cookie of its player; a script's, its id
-> {"kind":"act","episode":"...","step":0,"action":"..."}      the same act as over HTTP; its answer is the next frame
-> {"kind":"history"}                                          asks for the path so far
-> {"kind":"events","episode":"...","events":[...]}            a study's input events, 200 at most; a repeat is kept once
<- {"kind":"frame", ...}       whole, the newest always; a slow client skips
<- {"kind":"history", ...}     on joining, at each new episode, and when asked
<- {"kind":"pace", ...}        for a session that a policy drives, on joining and on change
<- {"kind":"kept","episode":"...","count":2,"reason":null}      the answer to events; count 0 with a reason: they are not kept
<- {"kind":"refused","reason":"...","frame":{...}}             a stale or forbidden act: nothing changed
<- {"kind":"error","detail":"..."}                             a bad message: the socket stays open

ws(s)://.../ws/watch/{watch}            for spectators of a board: frames and histories alone, one episode after the other"""


def render_docs(request: Request) -> str:
    """Return the HTML document of the app's OpenAPI schema."""
    schema = request.app.openapi()
    models = schema["components"]["schemas"]
    shown = {name: models[name] for name in answered_models(schema)}
    page: str = _TEMPLATE.render(
        **addresses(request), info=schema["info"], example=EXAMPLE, socket=SOCKET, groups=_groups(schema["paths"], models),
        models=[(name, model.get("description", ""), _fields(model)) for name, model in shown.items()],
    )  # fmt: skip
    return page


def _groups(
    paths: dict[str, Any], models: dict[str, Any]
) -> list[tuple[str, list[dict[str, Any]]]]:
    """Return the calls in the schema's order, grouped under one heading for each tag."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for path, verbs in paths.items():
        for verb, call in verbs.items():
            texts = {name: call.get(name, "") for name in ("summary", "description")}
            tables, answers = inputs_of(call, models), answers_in_words(call)
            about = {"verb": verb.upper(), "path": path, "tables": tables, "answers": answers}
            groups.setdefault(call["tags"][0].capitalize(), []).append({**texts, **about})
    return list(groups.items())


def inputs_of(
    call: dict[str, Any], models: dict[str, Any]
) -> list[list[tuple[str, dict[str, Any]]]]:
    """The tables of a call's inputs: its query parameters, then its body's fields."""
    parameters = [
        parameter for parameter in call.get("parameters", []) if parameter["in"] == "query"
    ]
    content = call.get("requestBody", {}).get("content", {})
    body = content.get("application/json", {}).get("schema", {})
    named = [schema["$ref"] for schema in [body, *body.get("anyOf", [])] if "$ref" in schema]
    fields = _fields(models[named[0].rsplit("/", 1)[1]]) if named else []
    asked = [(parameter["name"], parameter["schema"]) for parameter in parameters]
    return [table for table in (asked, fields) if table]


def answers_in_words(call: dict[str, Any]) -> str:
    """What a call answers where it is granted.

    Models stand between backquotes, files by their media types.
    """
    answers = []
    for status, response in call["responses"].items():
        for media_type, media in response.get("content", {}).items():
            if status[0] == "2":
                is_file = media["schema"].get("format") == "binary"
                answers.append(media_type if is_file else type_in_words(media["schema"]))
    return " or ".join(dict.fromkeys(answers))


def _fields(model: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return list(model["properties"].items())


def _with_code(text: str) -> Markup:
    """Return text as HTML, with what stands between backquotes as code."""
    pieces = text.split("`")
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if number % 2 else escape(piece)
        for number, piece in enumerate(pieces)
    )


def type_in_words(field: dict[str, Any]) -> str:
    """The type of a field in words, models and values between backquotes."""
    if "$ref" in field:
        return f"`{field['$ref'].rpartition('/')[2]}`"
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(type_in_words(part) for part in field["anyOf"]))
    if "prefixItems" in field:
        return f"[{', '.join(type_in_words(part) for part in field['prefixItems'])}]"
    if "items" in field:
        return f"list of {type_in_words(field['items'])}"
    if "enum" in field:
        return " | ".join(f"`{choice}`" for choice in field["enum"])
    if "const" in field:
        return f"`{str(field['const']).lower() if isinstance(field['const'], bool) else field['const']}`"
    bounds = [
        f"from {field['minimum']}" if "minimum" in field else "",
        f"to {field['maximum']}" if "maximum" in field else "",
    ]
    return " ".join([str(field.get("type", "")), *filter(None, bounds)])


environment.filters.update(with_code=_with_code, type_of=type_in_words)
_TEMPLATE = environment.get_template("api_docs.html")
