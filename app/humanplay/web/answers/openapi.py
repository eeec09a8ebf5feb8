"""The app's own description of itself.

It has the answers, with the models of the environment that it serves.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from fastapi import FastAPI
from fastapi.routing import APIRoute
from pydantic import BaseModel
from pydantic.json_schema import JsonSchemaMode, models_json_schema

from humanplay.task import Messages
from humanplay.web.answers.base import OWN, Problem
from humanplay.web.answers.replays import FrameCourse, PlainMistake

REFERENCE = "#/components/schemas/{model}"
UNREADABLE = "HTTPValidationError"
FRAMEWORKS_OWN = (UNREADABLE, "ValidationError")
"""How the framework answers bad input where nobody answers it otherwise (`humanplay.web.errors`)."""


class PlaygroundApp(FastAPI):
    """An app whose description has one environment's models.

    They stand where answers leave them to it.
    """

    def __init__(self, messages: Messages, **rest: Any) -> None:
        super().__init__(**rest)
        self._messages = messages

    def openapi(self) -> dict[str, Any]:
        """The OpenAPI description; it is made once."""
        if self.openapi_schema is None:
            schema, models = super().openapi(), models_of(self._messages)
            schemas = schema["components"]["schemas"]
            schemas |= definitions([Problem, *models.values()])
            for name in FRAMEWORKS_OWN:
                schemas.pop(name, None)
            for route in self.routes:
                if isinstance(route, APIRoute) and route.include_in_schema:
                    for method in route.methods or ():
                        operation = schema["paths"][route.path_format][method.lower()]
                        operation["operationId"] = route.name
                        declare_problems(operation["responses"])
            self.openapi_schema = with_models(schema, models)
        return self.openapi_schema


def declare_problems(responses: dict[str, Any]) -> None:
    """Declare what any call may answer instead: a sentence under `detail`."""
    if UNREADABLE in str(responses.get("422")):
        del responses["422"]
    content = {"application/json": {"schema": {"$ref": REFERENCE.format(model="Problem")}}}
    responses["default"] = {"description": "refused, or failed", "content": content}
    for status, response in responses.items():
        if status[0] in "45":
            response.setdefault("content", content)


def models_of(messages: Messages) -> dict[str, type[BaseModel]]:
    """An environment's models for its parts of answers, by `EnvironmentModel.name`."""
    return {
        "frame": messages.frame,
        "history": messages.history,
        "course": messages.course or FrameCourse,
        "mistake": messages.mistake or PlainMistake,
    }


def definitions(models: list[type[BaseModel]]) -> dict[str, Any]:
    """The schemas of models and of all that they are made of, by name."""
    mode: JsonSchemaMode = "serialization"
    _, schema = models_json_schema([(model, mode) for model in models], ref_template=REFERENCE)
    schemas: dict[str, Any] = schema["$defs"]
    return schemas


def with_models(schema: Any, models: dict[str, type[BaseModel]]) -> Any:
    """A schema that refers to an environment's models where it had marks."""
    if isinstance(schema, list):
        return [with_models(part, models) for part in schema]
    if not isinstance(schema, dict):
        return schema
    parts = {name: with_models(part, models) for name, part in schema.items() if name != OWN}
    if OWN in schema:
        parts["$ref"] = REFERENCE.format(model=models[schema[OWN]].__name__)
    return parts


def references(schema: Any) -> Iterator[str]:
    """Yield the names of the models that a schema refers to."""
    if isinstance(schema, dict):
        if "$ref" in schema:
            yield schema["$ref"].rpartition("/")[2]
        for part in schema.values():
            yield from references(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from references(part)


def answered_models(description: dict[str, Any]) -> list[str]:
    """The names of the models of all answers, and of what they are made of.

    Those of agents are left out.
    """
    waiting = [
        name
        for operations in description["paths"].values()
        for operation in operations.values()
        if operation["tags"] != ["agents"]
        for name in references(operation["responses"])
    ]
    names: set[str] = set()
    while waiting:
        if (name := waiting.pop()) not in names:
            names.add(name)
            waiting.extend(references(description["components"]["schemas"][name]))
    return sorted(names)
