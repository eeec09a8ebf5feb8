"""What a release says in words: datasheet, citation, licence, protocol, schema and column dictionary."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.release.columns import dictionary, json_schema
from app.release.datasheet import datasheet
from app.release.header import Header
from app.study.protocol import canonical

PAPER = "MarsExplorer: Exploration of Unknown Terrains via Deep Reinforcement Learning and Procedurally Generated Environments"
LICENCES = {
    "CC-BY-4.0": ("Creative Commons Attribution 4.0 International", "https://creativecommons.org/licenses/by/4.0/"),
    "CC-BY-SA-4.0": (
        "Creative Commons Attribution-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-sa/4.0/",
    ),
    "CC-BY-NC-4.0": (
        "Creative Commons Attribution-NonCommercial 4.0 International",
        "https://creativecommons.org/licenses/by-nc/4.0/",
    ),
    "CC0-1.0": ("Creative Commons Zero 1.0 Universal", "https://creativecommons.org/publicdomain/zero/1.0/"),
    "ODbL-1.0": ("Open Database License 1.0", "https://opendatacommons.org/licenses/odbl/1-0/"),
}


def licence_url(licence: str) -> str:
    """Return where a licence can be read; its SPDX page for one that is not in the list."""
    return LICENCES[licence][1] if licence in LICENCES else f"https://spdx.org/licenses/{licence}.html"


def citation(header: Header) -> str:
    """Return a line to cite the release by."""
    year = header.released[:4]
    where = f" {header.url}" if header.url else ""
    return f"{'; '.join(header.authors)} ({year}). {header.title}. Version {header.version}.{where}"


def write_documents(folder: Path, header: Header, minari: Mapping[str, int], without_moves: int) -> None:
    """Return with every document written into the release.

    minari         episodes by Minari dataset id
    without_moves  episodes that Minari cannot hold
    """
    (folder / "schema").mkdir()
    _json(folder / "schema/columns.json", dictionary())
    _json(folder / "schema/episode.schema.json", json_schema())
    _json(folder / "protocol.json", json.loads(canonical(header.protocol)))
    (folder / "CITATION.cff").write_text(_citation_file(header), encoding="utf-8")
    (folder / "LICENSE").write_text(_licence_text(header), encoding="utf-8")
    (folder / "DATASHEET.md").write_text(
        datasheet(header, minari, without_moves, citation(header), licence_url(header.protocol.data_licence)), encoding="utf-8"
    )


def _json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _citation_file(header: Header) -> str:
    lines = [
        "cff-version: 1.2.0",
        "type: dataset",
        'message: "If you use these data, please cite them."',
        f"title: {json.dumps(header.title, ensure_ascii=False)}",
        f'version: "{header.version}"',
        f"date-released: {header.released[:10]}",
        f"license: {header.protocol.data_licence}",
        *([f"url: {json.dumps(header.url)}"] if header.url else []),
        "authors:",
        *(f"  - name: {json.dumps(author, ensure_ascii=False)}" for author in header.authors),
        f"abstract: {json.dumps(header.summary(), ensure_ascii=False)}",
        "references:",
        "  - type: article",
        f'    title: "{PAPER}"',
        "    authors:",
        '      - {family-names: "Koutras", given-names: "Dimitrios I."}',
        '      - {family-names: "Kapoutsis", given-names: "Athanasios Ch."}',
        '      - {family-names: "Amanatiadis", given-names: "Angelos A."}',
        '      - {family-names: "Kosmatopoulos", given-names: "Elias B."}',
        "    year: 2021",
        '    url: "https://arxiv.org/abs/2107.09996"',
    ]
    return "\n".join(lines) + "\n"


def _licence_text(header: Header) -> str:
    licence = header.protocol.data_licence
    title = LICENCES[licence][0] if licence in LICENCES else licence
    return (
        f"SPDX-License-Identifier: {licence}\n\nThe data in this folder are licensed under {title}.\n"
        f"The licence: {licence_url(licence)}\n\nTo be named as the source:\n{citation(header)}\n"
    )
