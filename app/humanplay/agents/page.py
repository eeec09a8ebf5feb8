"""Evaluations of agents for everybody: what was fixed, and later the results.

Results and receipts are there once an evaluation is closed.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path as FilePath
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Request
from fastapi.responses import FileResponse, HTMLResponse, Response

from humanplay.agents.answers import Evaluation as EvaluationAnswer
from humanplay.agents.answers import ListedEvaluation
from humanplay.agents.evaluation import (
    COMPARISON,
    OPENING,
    POLICIES,
    RECEIPTS,
    Evaluation,
    EvaluationError,
    cards_of,
    evaluations,
    find_evaluation,
    published_folder,
)
from humanplay.study.protocol import StudyError
from humanplay.web.access import services_of
from humanplay.web.answers.base import file_of
from humanplay.web.protection import NO_CACHE
from humanplay.web.templates import addresses, environment

router = APIRouter(tags=["agents"])
Name = Annotated[str, Path(max_length=100, description="of the evaluation")]
NONE_HERE = "there is no such evaluation here: check the link"


@router.get(
    "/api/evaluations",
    response_model=list[ListedEvaluation],
    summary="The evaluations of agents of this server",
)
async def list_evaluations(request: Request) -> list[dict[str, object]]:
    """List the evaluations of agents; `status` is "open" or "closed"."""
    services = services_of(request)
    store, folder = services.store, services.progress.folder
    try:
        rows = await store.read(lambda: evaluations(store.connection, folder))
    except StudyError as error:  # `humanplay agents show` says what is wrong
        raise HTTPException(503, "the evaluations cannot be shown now") from error
    return [_about(evaluation) for evaluation in rows]


@router.get(
    "/api/evaluations/{name}",
    response_model=EvaluationAnswer,
    response_model_exclude_unset=True,
    summary="What an evaluation has published",
)
async def get_evaluation(request: Request, name: Name) -> dict[str, object]:
    """What was fixed before any agent played, and later the comparison.

    `cards` is how many were issued; `secret` and `comparison` are null until it is closed.
    """
    evaluation, cards = await _find(request, name)
    comparison = _path(request, evaluation, COMPARISON)
    return {
        **_about(evaluation),
        "cards": cards,
        "protocol": evaluation.protocol.model_dump(mode="json"),
        "secret": evaluation.secret.hex() if evaluation.closed_ms is not None else None,
        "comparison": await asyncio.to_thread(_read, comparison) if comparison else None,
    }


@router.get(
    "/api/evaluations/{name}/files/{file:path}",
    response_class=Response,
    responses=file_of("application/json"),
    summary="A receipt, or the opening",
)
async def get_file(request: Request, name: Name, file: str) -> FileResponse:
    """A published file.

    It is `opening.json`, `receipts/ID.json`, `policies.json` or `comparison.json`.
    """
    evaluation, _ = await _find(request, name)
    path = _path(request, evaluation, file)
    if path is None:
        raise HTTPException(404, f"the evaluation {name!r} has published no file {file[:60]!r}")
    return FileResponse(path, filename=path.name, headers=NO_CACHE)


@router.get("/evaluations", include_in_schema=False)
@router.get("/evaluations/{name}", include_in_schema=False)
async def evaluations_page(request: Request, name: str | None = None) -> Response:
    """Serve the page of an evaluation, or of all."""
    evaluation = None if name is None else await get_evaluation(request, name)
    listed = await list_evaluations(request) if name is None else []
    rows = _rows(evaluation and evaluation["comparison"])
    text = environment.get_template("agents/index.html").render(
        **addresses(request), evaluation=evaluation, listed=listed, rows=rows
    )
    return HTMLResponse(text, headers=NO_CACHE)


async def _find(request: Request, name: str) -> tuple[Evaluation, int]:
    """The evaluation of a name, and how many cards it has."""
    services = services_of(request)
    store, folder = services.store, services.progress.folder

    def read() -> tuple[Evaluation, int]:
        evaluation = find_evaluation(store.connection, folder, name)
        return evaluation, len(cards_of(store.connection, name))

    try:
        return await store.read(read)
    except EvaluationError as error:
        raise HTTPException(404, NONE_HERE) from error
    except StudyError as error:
        raise HTTPException(503, "the evaluation cannot be shown now") from error


def _about(evaluation: Evaluation) -> dict[str, object]:
    protocol = evaluation.protocol
    return {
        "name": evaluation.name,
        "status": "open" if evaluation.closed_ms is None else "closed",
        "task": protocol.environment.about.title,
        "where": protocol.environment.texts(protocol.env_config).setting,
        "instances": protocol.instances,
        "protocol_hash": protocol.hash,
        "commitment": evaluation.commitment,
        "sees": protocol.sees,
        "hours": protocol.hours,
        "minutes": protocol.minutes,
        "calls": protocol.calls,
        "study": protocol.study and protocol.study.model_dump(),
    }


def _path(request: Request, evaluation: Evaluation, file: str) -> FilePath | None:
    """A published file of a closed evaluation, None for anything else."""
    folder = published_folder(services_of(request).store.path, evaluation.name)
    receipts = (folder / RECEIPTS).glob("*.json")
    published = (*(folder / name for name in (OPENING, COMPARISON, POLICIES)), *receipts)
    if evaluation.closed_ms is None:
        return None
    named = (path for path in published if str(path.relative_to(folder)) == file)
    return next(filter(FilePath.is_file, named), None)


def _read(path: FilePath) -> Any:
    return json.loads(path.read_bytes())


def _rows(comparison: Any) -> list[dict[str, object]]:
    """The rows of the table, the best first.

    Each says where it stands on the common scale, in percent of its width.
    """
    if comparison is None:
        return []
    rows = [{**row, "low": None, "high": None} for row in comparison["rows"]]
    people = comparison["people"]
    if people is not None and people["score"] is not None:
        row = {"kind": "people", "name": "people", "rank": None, "sees": people["sees"]}
        ends = {name: people["score"][name] for name in ("low", "high")}
        figures = {name: {**people[name], "difference": None} for name in ("score", "steps")}
        rows.append({**row, **ends, **figures})
    spots = [(row["score"]["mean"], row["low"], row["high"]) for row in rows]
    means = [mean for spot in spots for mean in spot if mean is not None] or [0.0]
    low, width = min(means), max(max(means) - min(means), 1e-9)
    for row, spot in zip(rows, spots, strict=True):
        row["at"], row["from"], row["to"] = (
            None if mean is None else round(2 + 96 * (mean - low) / width, 2) for mean in spot
        )
    sign = -1 if comparison["better"] == "higher" else 1
    return sorted(rows, key=lambda row: sign * row["score"]["mean"])
