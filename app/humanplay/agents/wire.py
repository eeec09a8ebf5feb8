"""What stands under a card's address, `/agents/TOKEN`, in OpenEnv 0.10's words.

An agent resets an instance of the card's evaluation and moves on it. The server remembers nothing
of a connection but which instance it reset last, so an agent that comes back goes on where the
record stands. No reward and no score is told, and no request names a seed. What agents ask for
takes turns, so that people's moves do not wait for it. `mcp` has the rest of the protocol.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Literal, TypedDict, TypeVar

from fastapi import APIRouter, Depends, WebSocket, WebSocketDisconnect
from fastapi.openapi.utils import get_openapi
from pydantic import Field, ValidationError, model_validator
from starlette.requests import HTTPConnection

from humanplay.agents.answers import Card as CardAnswer
from humanplay.agents.answers import (
    CardClosure,
    CardHealth,
    InstanceCount,
    Instances,
    Metadata,
    OneInstance,
    Schemas,
    Split,
    StoredDescription,
)
from humanplay.agents.cards import SPLIT, Card, CardError, Cards, InstanceView
from humanplay.board.messages import Message, describe_errors
from humanplay.db.store import StoreError
from humanplay.web.access import close
from humanplay.web.protection import Protection, RefusedRequestError
from humanplay.web.sockets import UNKNOWN_SESSION

M = TypeVar("M", bound=Message)
NO_SEED = "a reset names an instance, by index or as task by its id, and no seed: what a seed draws stays secret"

router = APIRouter(prefix="/agents/{token}", tags=["agents"])


class Reset(Message):
    """Which instance is wanted: by its index in a split, or by its id."""

    split: str = Field(default=SPLIT, max_length=64)
    index: int | None = None
    task: str | None = Field(default=None, max_length=64)

    @model_validator(mode="before")
    @classmethod
    def _names_no_seed(cls, payload: object) -> object:
        if isinstance(payload, dict) and (
            "seed" in payload or not {"index", "task"} & payload.keys()
        ):
            raise ValueError(NO_SEED)
        return payload


class Step(Message):
    """A move."""

    action: str | int = Field(description="the name of an action, or its code")
    step: int | None = Field(default=None, description="moves made before it, lest it be repeated")
    metadata: dict[str, object] | None = Field(
        default=None, description="OpenEnv's; it is not read"
    )


class SplitRequest(Message):
    """The instances of a split.

    All of them, the one with `index`, or those from `start` to before `stop`.
    """

    split: str = Field(max_length=64)
    index: int = 0
    start: int | None = None
    stop: int | None = None


class EpisodeState(TypedDict):
    """The instance that was reset last, and its moves."""

    episode_id: str | None
    step_count: int


@dataclass(frozen=True)
class Agent:
    """A client with an open card."""

    connection: HTTPConnection
    cards: Cards
    card: Card

    async def begin(self, index: int) -> InstanceView:
        """Begin an attempt or go on with it; what is seen of it.

        One that begins is checked against the budgets of the client.
        """
        if index not in self.cards.begun(self.card):
            protection: Protection = self.connection.app.state.protection
            protection.check_episode(self.connection.scope)
        return await self.cards.turns.take(self.cards.begin(self.card, index))

    async def move(self, index: int, action: str | int, step: int | None = None) -> InstanceView:
        """Make a move; what is seen after it."""
        return await self.cards.turns.take(self.cards.act(self.card, index, action, step))


async def agent_of(connection: HTTPConnection, token: str) -> Agent:
    """The client of a token; CardError 404 without an open card."""
    cards: Cards = connection.app.state.agents
    return Agent(connection, cards, await cards.find(token))


AgentOf = Annotated[Agent, Depends(agent_of)]


async def name_of(agent: AgentOf) -> str:
    """The name of what is played."""
    return agent.cards.task_name(agent.card)


NameOf = Annotated[str, Depends(name_of)]


async def name_in_path(name: NameOf, env: str) -> str:
    """The name of what is played; CardError 404 if the path has another one."""
    if env != name:
        raise CardError(404, f"expected the environment {name!r}, got {env[:40]!r}")
    return name


NameInPath = Annotated[str, Depends(name_in_path)]


def check_split(split: str) -> None:
    """Check that a split is the only one; CardError 404 if not."""
    if split != SPLIT:
        raise CardError(404, f"expected the split {SPLIT!r}, got {split[:40]!r}")


@router.get("/health", response_model=CardHealth)
async def card_health(agent: AgentOf) -> dict[str, str]:
    """Say that the card can be played."""
    return {"status": "healthy"}


@router.get("/metadata", response_model=Metadata)
async def metadata(agent: AgentOf, name: NameOf) -> dict[str, str]:
    """Say what is played."""
    return {"name": name, "description": agent.cards.about(agent.card)["instructions"]}


@router.get("/schema", response_model=Schemas)
async def schema(agent: AgentOf) -> dict[str, object]:
    """Return the JSON schemas of moves, of what is seen, and of the state."""
    action, whole, text = Step.model_json_schema(), {"type": "integer"}, {"type": "string"}
    action["properties"]["action"] = {"enum": agent.cards.about(agent.card)["actions"]}
    seen = {"index": whole, "step": whole, "observation": {}, "text": text, "picture": text}
    names: dict[str, object] = {"type": "array", "items": text}
    state = {"episode_id": text, "step_count": whole}
    parts = {"observation": ("Seen", {**seen, "allowed": names}), "state": ("State", state)}
    objects = {
        name: {"title": title, "type": "object", "properties": properties}
        for name, (title, properties) in parts.items()
    }
    return {"action": action, **objects}


@router.get("/openapi.json")
async def openapi(agent: AgentOf) -> dict[str, object]:
    """Return these calls, by their paths under the card's address."""
    routes, title = agent.connection.app.routes, "An evaluation of agents"
    below = [route for route in routes if getattr(route, "path", "").startswith(router.prefix)]
    schema = get_openapi(title=title, version="1", routes=below)
    paths = {path.removeprefix(router.prefix): calls for path, calls in schema["paths"].items()}
    return {**schema, "paths": paths}


@router.get("/list_environments")
async def list_environments(name: NameOf) -> list[str]:
    """Return the name of what is played."""
    return [name]


@router.get("/{env}/splits", response_model=list[Split])
async def splits(name: NameInPath) -> list[dict[str, str]]:
    """Return the split that there is."""
    return [{"name": SPLIT, "type": "test"}]


@router.post("/{env}/{call}", response_model=Instances | InstanceCount | OneInstance)
async def instances(
    agent: AgentOf,
    name: NameInPath,
    call: Literal["tasks", "num_tasks", "task", "task_range"],
    wanted: SplitRequest,
) -> dict[str, object]:
    """Return the instances of a split, their number, or some of them.

    `task` is the one with `index`, `task_range` those from `start` to before `stop`.
    """
    check_split(wanted.split)
    all_instances = agent.cards.instances(agent.card)
    if call == "num_tasks":
        return {"num_tasks": len(all_instances)}
    if call == "task":
        if not 0 <= wanted.index < len(all_instances):
            raise CardError(
                400, f"expected an index 0 to {len(all_instances) - 1}, got {wanted.index}"
            )
        return {"task": all_instances[wanted.index]}
    return {"tasks": all_instances[wanted.start : wanted.stop], "env_name": name}


@router.get("", response_model=CardAnswer, response_model_exclude_unset=True)
async def get_card(agent: AgentOf) -> dict[str, object]:
    """Return what the author says of the agent, what is played, and the attempts.

    It says which attempts were begun and finished, and no score.
    """
    card, state = agent.card, await agent.cards.state(agent.card)
    author = {"author": card.row.author, "number": card.row.number, "agent": card.description}
    return {**author, **agent.cards.about(card), "state": state}


@router.post("", response_model=StoredDescription, response_model_exclude_unset=True)
async def describe(agent: AgentOf, texts: dict[str, object]) -> dict[str, object]:
    """Store `agent`, `version`, `model`, `prompts_sha256` and `cost`.

    After the first attempt only the cost can be changed.
    """
    return {"agent": await agent.cards.describe(agent.card, texts)}


@router.post("/close", response_model=CardClosure)
async def close_card(agent: AgentOf) -> dict[str, bool]:
    """Close the card for good: what runs is abandoned, and it counts."""
    await agent.cards.close(agent.card)
    return {"closed": True}


@router.websocket("/ws")
async def play(websocket: WebSocket, token: str) -> None:
    """Serve OpenEnv's messages reset, step, state and close."""
    await websocket.accept()
    with suppress(WebSocketDisconnect):
        try:
            await agent_of(websocket, token)
        except (CardError, StoreError) as error:
            await websocket.send_json(error_answer(error, "SESSION_ERROR"))
            await close(websocket, UNKNOWN_SESSION, "no open card")
            return
        at: EpisodeState = {"episode_id": None, "step_count": 0}
        while (message := await websocket.receive())["type"] != "websocket.disconnect":
            try:
                kind, payload = _read(message.get("text"))
                if kind == "close":
                    await websocket.close()
                    return
                answer = await _answer(await agent_of(websocket, token), kind, payload, at)
            except (CardError, RefusedRequestError, StoreError) as error:
                answer = error_answer(error)
            await websocket.send_json(answer)


def _read(text: str | None) -> tuple[str, object]:
    try:
        asked = json.loads(text or "")
        return asked["type"], asked.get("data", {})
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise CardError(400, 'expected a JSON object with a "type" in a text frame') from None


async def _answer(agent: Agent, kind: str, payload: object, at: EpisodeState) -> dict[str, object]:
    """The answer to a message.

    Args:
        at: The instance that was reset last, and its moves; changed here.
    """
    if kind == "state":
        return {"type": "state", "data": {**at, **await agent.cards.state(agent.card)}}
    if kind == "reset":
        wanted = read(Reset, payload)
        check_split(wanted.split)
        index = wanted.index
        if index is None:
            index = agent.cards.index_of(agent.card, wanted.task or "")
        seen = await agent.begin(index)
    elif kind == "step":
        if at["episode_id"] is None:
            raise CardError(409, "reset an instance before a step")
        move = read(Step, payload)
        seen = await agent.move(int(at["episode_id"]), move.action, move.step)
    else:
        raise CardError(404, f"expected reset, step, state or close, got {str(kind)[:40]!r}")
    at["episode_id"], at["step_count"] = str(seen.index), seen.step
    return {"type": "observation", "data": observation_of(seen)}


def observation_of(seen: InstanceView) -> dict[str, object]:
    """What was seen, as OpenEnv's clients read it."""
    shown = {"observation": seen.observation, "text": seen.text, "picture": seen.picture}
    shown |= {"allowed": seen.allowed}
    seen_fields = {name: part for name, part in shown.items() if part is not None}
    shown = {"index": seen.index, "step": seen.step, **seen_fields}
    return {"observation": shown, "reward": None, "done": seen.done}


def read(kind: type[M], payload: object) -> M:
    """A message of a kind.

    Raises:
        CardError: 422 that says what is wrong with it.
    """
    try:
        return kind.model_validate(payload)
    except ValidationError as error:
        raise CardError(422, describe_errors(error.errors(include_url=False))) from None


def error_answer(error: Exception, code: str = "EXECUTION_ERROR") -> dict[str, object]:
    code = "VALIDATION_ERROR" if getattr(error, "status", 0) in (400, 422) else code
    return {"type": "error", "data": {"message": str(error), "code": code}}
