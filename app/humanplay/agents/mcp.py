"""The Model Context Protocol under a card's address: its handshake and two tools.

It is spoken over HTTP without streams and sessions.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Literal

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse, Response
from pydantic import BaseModel, Field, ValidationError

from humanplay.agents import wire
from humanplay.agents.answers import RpcAnswer
from humanplay.agents.cards import AboutCard, CardError
from humanplay.agents.wire import Agent, AgentOf, NameOf, observation_of, read
from humanplay.board.messages import Message, describe_errors
from humanplay.task import counted

VERSIONS = ("2025-11-25", "2025-06-18", "2025-03-26", "2024-11-05")
"""Versions of the protocol that are spoken; a client that asks for another is offered the first."""
INVALID_REQUEST, NO_METHOD, INVALID_PARAMS = -32600, -32601, -32602
"""Codes of JSON-RPC 2.0."""

router = APIRouter(prefix=wire.router.prefix, tags=["agents"])


class Call(BaseModel):
    """A request of JSON-RPC 2.0; without an id it is a notification."""

    jsonrpc: Literal["2.0"]
    method: str
    params: dict[str, object] = {}
    id: str | int | None = None


class Begin(Message):
    """Begin the attempt at an instance, or see where it stands.

    There is one attempt at each."""

    index: int = Field(description="of the instance, from 0")


class Move(Begin):
    """Make a move on an instance that was begun, and see what comes of it."""

    action: str | int = Field(description="the name of an action, or its code")


TOOLS: dict[str, type[Begin]] = {"begin": Begin, "move": Move}


@router.post(
    "/mcp",
    responses={
        200: {"model": RpcAnswer},
        202: {"description": "a notification, which has no answer"},
    },
)
async def mcp(request: Request, agent: AgentOf, name: NameOf) -> Response:
    """Answer a request of MCP: initialize, ping, tools/list or tools/call.

    OpenEnv's openenv/session/create and openenv/session/close are answered too.
    """
    try:
        call = Call.model_validate_json(await request.body())
    except ValidationError as error:
        reason = describe_errors(error.errors(include_url=False))
        return _answer(None, error=(INVALID_REQUEST, reason))
    if call.id is None:
        return Response(status_code=202)
    match call.method:
        case "tools/call":
            return _answer(call.id, await _use(agent, call.params))
        case "tools/list":
            return _answer(call.id, {"tools": _tools(agent.cards.about(agent.card)["actions"])})
        case "initialize":
            asked = call.params.get("protocolVersion")
            return _answer(call.id, {
                "protocolVersion": asked if asked in VERSIONS else VERSIONS[0],
                "capabilities": {"tools": {}},
                "serverInfo": {"name": name, "version": "1"},
                "instructions": _instructions(agent.cards.about(agent.card)),
            })  # fmt: skip
        case "ping":
            return _answer(call.id, {})
        case "openenv/session/create":  # a card is one session: it holds nothing but the record
            return _answer(call.id, {"session_id": agent.card.row.id})
        case "openenv/session/close" if call.params.get("session_id") == agent.card.row.id:
            return _answer(call.id, {"session_id": agent.card.row.id, "closed": True})
        case "openenv/session/close":
            return _answer(
                call.id, error=(INVALID_PARAMS, "expected the session_id that was given")
            )
    return _answer(call.id, error=(NO_METHOD, f"no method {call.method[:40]!r} here"))


def _answer(
    ident: str | int | None, result: object = None, error: tuple[int, str] | None = None
) -> Response:
    answer: dict[str, object] = {"result": result}
    if error is not None:
        answer = {"error": {"code": error[0], "message": error[1]}}
    return JSONResponse({"jsonrpc": "2.0", "id": ident, **answer})


def _instructions(about: AboutCard) -> str:
    return (
        f"{about['instructions']} Instances are named by an index, 0 to {about['instances'] - 1}. One attempt at each, "
        f"of at most {counted(about['limit'], 'move')}: begin it, then move until it is finished."
    )


def _tools(actions: list[str]) -> list[dict[str, object]]:
    schemas = {name: kind.model_json_schema() for name, kind in TOOLS.items()}
    schemas["move"]["properties"]["action"] = {"enum": actions}
    return [
        {"name": name, "description": schema.pop("description"), "inputSchema": schema}
        for name, schema in schemas.items()
    ]


async def _use(agent: Agent, params: dict[str, object]) -> dict[str, object]:
    """What a tool shows, as text, picture and object.

    A refusal is the tool's own error.
    """
    try:
        if (kind := TOOLS.get(str(params.get("name")))) is None:
            raise CardError(404, f"expected a tool of {', '.join(TOOLS)}")
        wanted = read(kind, params.get("arguments"))
        if isinstance(wanted, Move):
            seen = await agent.move(wanted.index, wanted.action)
        else:
            seen = await agent.begin(wanted.index)
    except CardError as error:
        return {"content": [{"type": "text", "text": str(error)}], "isError": True}
    structured, picture = observation_of(replace(seen, picture=None)), seen.picture or ""
    stands = "finished" if seen.done else "running"
    text = f"instance {seen.index}, step {seen.step}, {stands}\n{seen.text or json.dumps(seen.observation)}"
    if seen.allowed is not None:
        text += f"\nallowed: {', '.join(seen.allowed)}"
    mime, _, encoded = picture.removeprefix("data:").partition(";base64,")
    images = [{"type": "image", "data": encoded, "mimeType": mime}] if picture else []
    content = [{"type": "text", "text": text}, *images]
    return {"content": content, "structuredContent": structured, "isError": False}
