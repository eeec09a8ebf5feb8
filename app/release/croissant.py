"""Croissant 1.1 metadata (JSON-LD): what files there are and what their columns mean, for machines that look for data sets."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

from app.release.columns import SUMMARIES, TABLES, Column
from app.release.errors import ReleaseError, library
from app.release.header import BUNDLE_DATABASE, Header
from app.release.manifest import sha256

FILES = {
    "parquet/episodes.parquet": "application/x-parquet",
    "parquet/steps.parquet": "application/x-parquet",
    "parquet/input_events.parquet": "application/x-parquet",
    "episodes.jsonl": "application/jsonlines",
    "scores.csv": "text/csv",
    BUNDLE_DATABASE: "application/vnd.sqlite3",
}
_KINDS = {"text": "sc:Text", "integer": "sc:Integer", "real": "sc:Float", "boolean": "sc:Boolean"}
_TERMS = (
    "arrayShape citeAs column containedIn equivalentProperty extract field fileProperty fileObject fileSet format includes "
    "isArray isLiveDataset jsonPath key md5 parentField path recordSet references regex repeated replace samplingRate "
    "separator source subField transform"
)
_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{term: f"cr:{term}" for term in _TERMS.split()},
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "sc": "https://schema.org/",
}


def croissant(folder: Path, header: Header, citation: str, licence_url: str) -> dict[str, Any]:
    """Return the metadata of a release whose tables lie in `folder`."""
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": f"marsexplorer-{header.study}",
        "description": header.summary(),
        "citeAs": citation,
        "license": licence_url,
        **({"url": header.url} if header.url else {}),
        "version": f"{header.version}.0.0",
        "datePublished": header.released,
        "creator": [{"@type": "sc:Organization", "name": author} for author in header.authors],
        "keywords": ["reinforcement learning", "human baseline", "exploration", "MarsExplorer"],
        "isLiveDataset": False,
        "distribution": [_file(folder, name, kind) for name, kind in FILES.items()],
        "recordSet": [
            *(_records(name, f"parquet/{name}.parquet") for name in ("episodes", "steps", "input_events")),
            _records("scores", "scores.csv"),
        ],
    }


def write_croissant(folder: Path, header: Header, citation: str, licence_url: str) -> None:
    """Return with croissant.json written and found valid by mlcroissant; ReleaseError otherwise."""
    path = folder / "croissant.json"
    path.write_text(json.dumps(croissant(folder, header, citation, licence_url), indent=2, ensure_ascii=False) + "\n")
    mlcroissant = library("mlcroissant")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # rdflib's, about how mlcroissant calls it
            mlcroissant.Dataset(path)
    except mlcroissant.ValidationError as error:
        raise ReleaseError(f"the Croissant metadata is not valid: {error}") from error


def _file(folder: Path, name: str, kind: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": name,
        "encodingFormat": kind,
        "contentSize": f"{(folder / name).stat().st_size} B",
        "sha256": sha256(folder / name),
    }


def _records(table: str, file: str) -> dict[str, Any]:
    fields = [_field(table, file, column) for column in TABLES[table]]
    return {"@type": "cr:RecordSet", "@id": table, "name": table, "description": SUMMARIES[table], "field": fields}


def _field(table: str, file: str, column: Column) -> dict[str, Any]:
    return {
        "@type": "cr:Field",
        "@id": f"{table}/{column.name}",
        "name": column.name,
        "description": column.meaning,
        "dataType": _KINDS[column.kind],
        "source": {"fileObject": {"@id": file}, "extract": {"column": column.name}},
    }
