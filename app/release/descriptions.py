"""Two more descriptions of a release for machines: a Data Package, and a Psych-DS dataset description.

The Data Package (https://datapackage.org, version 2) says of every CSV file which columns it has, which of them name a row, and
which are found in another table. Psych-DS (https://psych-ds.github.io) wants tables below `data`, named in its way, and every
column named in one file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from app.release.columns import BUNDLE_COLUMNS, FOREIGN_KEYS, JSON_TYPES, PRIMARY_KEYS, SUMMARIES
from app.release.header import ReleaseHeader
from app.release.manifest import sha256
from app.release.tables import PARQUET, data_file

KEYWORDS = ("reinforcement learning", "human baseline", "exploration", "MarsExplorer")


def write_descriptions(
    folder: Path, header: ReleaseHeader, citation: str, licence: tuple[str, str]
) -> None:
    """Write datapackage.json and dataset_description.json into a release whose tables lie in `folder`.

    licence  its title, and where it can be read
    """
    made = {
        "datapackage.json": data_package(folder, header, licence),
        "dataset_description.json": psych_ds(header, citation, licence[1]),
    }
    for name, content in made.items():
        (folder / name).write_text(
            json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
        )


def data_package(folder: Path, header: ReleaseHeader, licence: tuple[str, str]) -> dict[str, Any]:
    """Return the Data Package of a release: a resource for each CSV file."""
    files = {**{table: data_file(header.study, table) for table in PARQUET}, "scores": "scores.csv"}
    return {
        "$schema": "https://datapackage.org/profiles/2.0/datapackage.json",
        "name": f"marsexplorer-{header.study}",
        "title": header.title,
        "description": header.summary(),
        "version": f"{header.version}.0.0",
        "created": header.released,
        "keywords": list(KEYWORDS),
        "contributors": [{"title": author, "roles": ["author"]} for author in header.authors],
        "licenses": [
            {"name": header.protocol.data_licence, "title": licence[0], "path": licence[1]}
        ],
        **({"homepage": header.url} if header.url else {}),
        "resources": [_resource(folder, table, path) for table, path in files.items()],
    }


def _resource(folder: Path, table: str, path: str) -> dict[str, Any]:
    return {
        "name": table.replace("_", "-"),
        "type": "table",
        "title": table.replace("_", " "),
        "description": SUMMARIES[table],
        "path": path,
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8",
        "bytes": (folder / path).stat().st_size,
        "hash": f"sha256:{sha256(folder / path)}",
        "schema": {
            "fields": [
                {
                    "name": column.name,
                    "type": JSON_TYPES[column.type],
                    "description": column.meaning,
                    "constraints": {"required": not column.optional},
                }
                for column in BUNDLE_COLUMNS[table]
            ],
            "missingValues": [""],
            "primaryKey": list(PRIMARY_KEYS[table]),
            "foreignKeys": [
                {
                    "fields": [column],
                    "reference": {"resource": other.replace("_", "-"), "fields": [column]},
                }
                for column, other in FOREIGN_KEYS.get(table, {}).items()
            ],
        },
    }


def psych_ds(header: ReleaseHeader, citation: str, licence_url: str) -> dict[str, Any]:
    """Return the Psych-DS description: every column of the tables below `data` is a measured variable."""
    return {
        "@context": "https://schema.org",
        "@type": "Dataset",
        "name": header.title,
        "description": header.summary(),
        "version": f"{header.version}.0.0",
        "datePublished": header.released,
        "license": licence_url,
        "citation": citation,
        "keywords": list(KEYWORDS),
        "author": [{"@type": "Organization", "name": author} for author in header.authors],
        **({"url": header.url} if header.url else {}),
        "variableMeasured": [
            {"@type": "PropertyValue", "name": name, "description": meaning}
            for name, meaning in _variables().items()
        ],
    }


def _variables() -> dict[str, str]:
    """Return each column's meaning by its name; by table, where tables use a name in several ways."""
    found: dict[str, dict[str, str]] = {}
    for table in PARQUET:
        for column in BUNDLE_COLUMNS[table]:
            found.setdefault(column.name, {})[table] = column.meaning
    return {
        name: next(iter(meanings.values()))
        if len(set(meanings.values())) == 1
        else "; ".join(f"in {table}: {meaning}" for table, meaning in meanings.items())
        for name, meanings in found.items()
    }
