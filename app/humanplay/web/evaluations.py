"""Sealed evaluations of agents for everybody: what was frozen, and once one is closed what came of it, receipts and replays."""

from __future__ import annotations

import asyncio
import json
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Query, Request
from fastapi.responses import FileResponse, HTMLResponse, Response

from humanplay.db.reader import Reader
from humanplay.db.series import participants, study_trials
from humanplay.series.evaluation import COMPARISON, OPENING, POLICIES, RECEIPTS, CardList
from humanplay.series.folder import SEALED, Study
from humanplay.series.protocol import StudyError
from humanplay.web.access import services_of
from humanplay.web.protection import NO_CACHE
from humanplay.web.templates import environment, root_of

router = APIRouter(tags=["evaluations"])
Name = Annotated[str, Path(max_length=100, description="of the evaluation")]


@router.get("/api/evaluations", summary="The evaluations of agents of this server")
async def list_evaluations(request: Request) -> list[dict[str, Any]]:
    """List the sealed evaluations that were frozen; `status` is "open" or "closed"."""
    return [_about(each) for each in services_of(request).progress.folder.evaluations()]


@router.get("/api/evaluations/{name}", summary="What an evaluation has published")
async def get_evaluation(request: Request, name: Name) -> dict[str, Any]:
    """Return what fixes the instances before any agent plays; once it is closed, the comparison of agents, people and policies.

    `cards` is how many were issued; `secret` and `comparison` are null while it is open.
    """
    study = _found(request, name)
    comparison = _path(request, study, COMPARISON)
    return {
        **_about(study),
        "cards": len(CardList(services_of(request).progress.folder).of(name)),
        "protocol": json.loads(study.row().protocol),
        "secret": None if study.is_open else study.secret.hex(),
        "comparison": await asyncio.to_thread(_read, comparison) if comparison else None,
    }


@router.get("/api/evaluations/{name}/episodes", summary="Who has played an instance")
async def get_episodes(
    request: Request, name: Name, index: Annotated[int, Query(ge=0, le=10_000)]
) -> list[dict[str, str]]:
    """Return the finished episodes of agents and people on an instance; `GET /api/watch/{episode}` shows each."""
    services, study = services_of(request), _opened(request, name)
    return await services.store.read(partial(_episodes, services.store, study, index))


@router.get("/api/evaluations/{name}/files/{file:path}", summary="A receipt, or the opening")
async def get_file(request: Request, name: Name, file: str) -> FileResponse:
    """Send `opening.json`, `receipts/ID.json`, `policies.json` or `comparison.json`, as the server has signed them."""
    path = _path(request, _opened(request, name), file)
    if path is None:
        raise HTTPException(404, f"the evaluation {name!r} has published no file {file[:60]!r}")
    return FileResponse(path, filename=path.name, headers=NO_CACHE)


@router.get("/evaluations", include_in_schema=False)
@router.get("/evaluations/{name}", include_in_schema=False)
async def evaluations_page(request: Request, name: str | None = None) -> Response:
    """Serve the page of an evaluation, or of all."""
    found = None if name is None else await get_evaluation(request, name)
    listed = await list_evaluations(request) if name is None else []
    text = environment.get_template("evaluations/index.html").render(
        root=root_of(request), of=found, listed=listed, rows=_rows(found and found["comparison"])
    )
    return HTMLResponse(text, headers=NO_CACHE)


def _found(request: Request, name: str) -> Study:
    try:
        study = services_of(request).progress.folder.study(name)
        if study.protocol.agents is not None:
            return study
    except StudyError:  # unknown, a draft, or `evaluation show` says what is wrong with it
        pass
    raise HTTPException(404, "there is no such evaluation here: check the link")


def _opened(request: Request, name: str) -> Study:
    study = _found(request, name)
    if study.is_open:
        raise HTTPException(409, SEALED.format(name))
    return study


def _about(study: Study) -> dict[str, Any]:
    protocol, agents = study.protocol, study.protocol.agents
    assert agents is not None
    return {
        "name": study.name, "title": protocol.title, "status": study.status, "task": protocol.rules.title,
        "where": protocol.rules.where(protocol.env_config), "instances": protocol.ranked,
        "protocol_hash": study.protocol_hash, "commitment": study.commitment, **agents.model_dump(),
    }  # fmt: skip


def _path(request: Request, study: Study, file: str) -> FilePath | None:
    """Return a published file of a closed evaluation, None for anything else."""
    folder = services_of(request).progress.folder.path(study.name)
    receipts = (folder / RECEIPTS).glob("*.json")
    published = (*(folder / name for name in (OPENING, COMPARISON, POLICIES)), *receipts)
    found = (path for path in published if str(path.relative_to(folder)) == file)
    return None if study.is_open else next(filter(FilePath.is_file, found), None)


def _read(path: FilePath) -> Any:
    return json.loads(path.read_bytes())


def _episodes(reader: Reader, study: Study, index: int) -> list[dict[str, str]]:
    """Return the episodes on an instance; people are numbered anew for each, by ids that say nothing."""
    found = []
    for kind, of in (("script", study), ("human", study.paired)):
        if of is None:
            continue
        names = {
            each.id: json.loads(each.settings).get("agent") or str(each.script)
            for each in participants(reader, of.name)
        }
        own = {
            each.id: names[each.participant]
            for each in study_trials(reader, of.name)
            if (each.kind, each.phase, each.terrain_index) == (kind, "ranked", index)
            and each.ended_ms is not None
        }
        for number, episode in enumerate(sorted(own), 1):
            who, name = ("agent", own[episode]) if of is study else ("person", f"person {number}")
            found.append({"episode": episode, "who": who, "name": name})
    return found


def _rows(comparison: dict[str, Any] | None) -> list[dict[str, Any]]:
    """Return the rows of the table, the best first, with where each stands on the common scale, in percent of its width."""
    if comparison is None:
        return []
    rows = [{**row, "low": None, "high": None} for row in comparison["rows"]]
    people = comparison["people"]
    if people is not None and people["score"] is not None:
        told = {"kind": "people", "name": "people", "rank": None, "sees": people["sees"]}
        ends = {name: people["score"][name] for name in ("low", "high")}
        figures = {name: {**people[name], "difference": None} for name in ("score", "steps")}
        rows.append({**told, **ends, **figures})
    spots = [(row["score"]["mean"], row["low"], row["high"]) for row in rows]
    known = [value for each in spots for value in each if value is not None] or [0.0]
    low, width = min(known), max(max(known) - min(known), 1e-9)
    for row, own in zip(rows, spots, strict=True):
        row["at"], row["from"], row["to"] = (
            None if value is None else round(2 + 96 * (value - low) / width, 2) for value in own
        )
    sign = -1 if comparison["better"] == "higher" else 1
    return sorted(rows, key=lambda row: sign * row["score"]["mean"])
