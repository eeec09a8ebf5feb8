"""The page at /docs: the API as one readable document, made from the OpenAPI schema, from our own files alone."""

from __future__ import annotations

from html import escape
from typing import Any

STYLE = """body{max-width:56rem;margin:2rem auto;padding:0 1rem;font:16px/1.55 system-ui,sans-serif;
color:#e9ddd2;background:#191310}
h1,h2,h3{color:#f0a26b;line-height:1.25}h3{margin-bottom:.2rem}code,pre{font:14px/1.5 ui-monospace,monospace;color:#ffe3c8}
pre{background:#271d17;padding:.8rem 1rem;border-radius:8px;overflow-x:auto}a{color:#f0a26b}
table{border-collapse:collapse;width:100%}
td,th{text-align:left;vertical-align:top;padding:.25rem .8rem .25rem 0;border-top:1px solid #46352a}
.verb{display:inline-block;min-width:3.2rem;color:#8fd0c0}"""

EXAMPLE = """import httpx

with httpx.Client(base_url="http://127.0.0.1:8000") as mars:       # one client keeps the player cookie
    session = mars.post("/api/sessions", json={"level": "random", "size": 21, "seed": 7}).json()
    frame = session["frame"]
    while frame["outcome"] is None:
        move = {"episode": frame["episode"], "step": frame["step"], "action": "east"}
        frame = mars.post(f"/api/sessions/{session['session']}/act", json=move).json()
    print(frame["outcome"], frame["score"])"""

SOCKET = """ws(s)://.../ws/sessions/{session}
-> {"kind":"act","episode":"...","step":0,"action":"east"}     the same act as over HTTP; its answer is the next frame
-> {"kind":"history"}                                          asks for the path so far
-> {"kind":"events","episode":"...","events":[...]}            a study's input events, 200 at most; a repeat is kept once
<- {"kind":"frame", ...}       whole, the newest always; a slow client skips
<- {"kind":"history", ...}     on joining, at each new episode, and when asked
<- {"kind":"pace", ...}        for a session that a policy drives, on joining and on change
<- {"kind":"kept","episode":"...","count":2,"reason":null}      the answer to events; count 0 with a reason: they are not kept
<- {"kind":"refused","reason":"...","frame":{...}}             a stale act: nothing changed
<- {"kind":"error","detail":"..."}                             a bad message: the socket stays open"""


def render(schema: dict[str, Any]) -> str:
    """Return the HTML document of an OpenAPI schema."""
    parts = [
        f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{escape(schema['info']['title'])}</title><style>{STYLE}</style><main>",
        f"<h1>{escape(schema['info']['title'])}</h1><p>{_text(schema['info'].get('description', ''))}</p>",
        '<p>The schema for machines: <a href="openapi.json">openapi.json</a></p>',
        f"<h2>An episode in ten lines</h2>{_code(EXAMPLE)}<h2>The socket</h2>{_code(SOCKET)}",
    ]
    tag = ""
    for path, verbs in schema["paths"].items():
        for verb, call in verbs.items():
            if call.get("tags", [""])[0] != tag:
                tag = call["tags"][0]
                parts.append(f"<h2>{escape(tag.capitalize())}</h2>")
            parts.append(_call(path, verb, call, schema))
    parts.append("<h2>What the answers hold</h2>")
    shown = ("Frame", "History", "Pace")
    parts += [_model(name, schema["components"]["schemas"][name]) for name in shown]
    return "\n".join([*parts, "</main></html>"])


def _code(text: str) -> str:
    """Return text as it stands; it can be scrolled with the keyboard where it is wider than the screen."""
    return f'<pre tabindex="0">{escape(text)}</pre>'


def _text(text: str) -> str:
    """Return text as HTML, with `code` between backquotes."""
    pieces = escape(text, quote=False).split("`")
    return "".join(f"<code>{piece}</code>" if number % 2 else piece for number, piece in enumerate(pieces))


def _call(path: str, verb: str, call: dict[str, Any], schema: dict[str, Any]) -> str:
    html = f'<h3><code><span class="verb">{verb.upper()}</span>{escape(path)}</code></h3>'
    html += f"<p><b>{_text(call.get('summary', ''))}</b><br>{_text(call.get('description', ''))}</p>"
    queries = [each for each in call.get("parameters", []) if each["in"] == "query"]
    if queries:
        html += _table([(each["name"], each["schema"]) for each in queries])
    body = call.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
    reference = next((each["$ref"] for each in [body, *body.get("anyOf", [])] if "$ref" in each), None)
    if reference:
        html += _table(list(schema["components"]["schemas"][reference.rsplit("/", 1)[1]]["properties"].items()))
    return html


def _model(name: str, model: dict[str, Any]) -> str:
    return f"<h3>{name}</h3><p>{_text(model.get('description', ''))}</p>" + _table(list(model["properties"].items()))


def _table(fields: list[tuple[str, dict[str, Any]]]) -> str:
    rows = (
        f"<tr><td><code>{escape(name)}</code></td><td>{_text(_kind(field))}</td>"
        f"<td>{_text(field.get('description', ''))}</td></tr>"
        for name, field in fields
    )
    return f"<table>{''.join(rows)}</table>"


def _kind(field: dict[str, Any]) -> str:
    """Return the type of a field in words."""
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(_kind(each) for each in field["anyOf"]))
    if "enum" in field:
        return " | ".join(f"`{each}`" for each in field["enum"])
    if "const" in field:
        return f"`{str(field['const']).lower() if isinstance(field['const'], bool) else field['const']}`"
    bounds = [f"from {field['minimum']}" if "minimum" in field else "", f"to {field['maximum']}" if "maximum" in field else ""]
    return " ".join([str(field.get("type", "")), *filter(None, bounds)])
