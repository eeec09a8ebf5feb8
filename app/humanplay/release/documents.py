"""The documents of a release: datasheet, citation, licence, dictionary, protocol.

The first three come from the templates in `templates/`. They are Markdown, YAML and plain text, so
nothing is escaped as HTML; strings in the YAML are quoted as JSON. The datasheet follows Gebru et
al. (2021), "Datasheets for Datasets".
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path

from jinja2 import Environment

from humanplay.db.columns import BUNDLE_TABLES, bundle_table, dictionary, markdown, summary
from humanplay.release.manifest import BUNDLE_DATABASE, ReleaseHeader
from humanplay.report.statistics.formatting import templates
from humanplay.study.protocol import canonical

LICENCES = {
    "CC-BY-4.0": (
        "Creative Commons Attribution 4.0 International",
        "https://creativecommons.org/licenses/by/4.0/",
    ),
    "CC-BY-SA-4.0": (
        "Creative Commons Attribution-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-sa/4.0/",
    ),
    "CC-BY-NC-4.0": (
        "Creative Commons Attribution-NonCommercial 4.0 International",
        "https://creativecommons.org/licenses/by-nc/4.0/",
    ),
    "CC0-1.0": (
        "Creative Commons Zero 1.0 Universal",
        "https://creativecommons.org/publicdomain/zero/1.0/",
    ),
    "ODbL-1.0": ("Open Database License 1.0", "https://opendatacommons.org/licenses/odbl/1-0/"),
}
"""SPDX identifier -> the licence's title, and where it can be read."""


def licence_url(licence: str) -> str:
    """The page of a licence; its SPDX page if it is not in the list."""
    return LICENCES.get(licence, ("", f"https://spdx.org/licenses/{licence}.html"))[1]


def licence_title(licence: str) -> str:
    """A licence's title; its identifier if it is not in the list."""
    return LICENCES.get(licence, (licence, ""))[0]


def citation(header: ReleaseHeader) -> str:
    """A line to cite the release by."""
    year = header.released[:4]
    address = f" {header.url}" if header.url else ""
    return (
        f"{'; '.join(header.authors)} ({year}). {header.title}. Version {header.version}.{address}"
    )


def write_documents(
    folder: Path, header: ReleaseHeader, minari: Mapping[str, int], without_moves: int
) -> None:
    """Write every document into the release.

    Args:
        minari: Episodes by Minari dataset id.
        without_moves: Episodes that Minari cannot hold.
    """
    _write_json(folder / "columns.json", dictionary(header.protocol.environment.about.columns))
    (folder / "protocol.json").write_bytes(canonical(header.protocol))
    has_report = (folder / "report.json").exists()
    for name, text in documents(header, minari, without_moves, has_report).items():
        (folder / name).write_text(text, encoding="utf-8")


def documents(
    header: ReleaseHeader, minari: Mapping[str, int], without_moves: int, has_report: bool = False
) -> dict[str, str]:
    """File name -> text of the documents that come from templates.

    The arguments are those of `write_documents`.
    """
    licence, words = header.protocol.data_licence, header.protocol.environment.about.columns
    values = {
        "header": header,
        "minari": minari,
        "without_moves": without_moves,
        "citation": citation(header),
        "licence_title": licence_title(licence),
        "licence_url": licence_url(licence),
        "database": BUNDLE_DATABASE,
        "has_report": has_report,
        "tables": {
            table: (summary(table), markdown(bundle_table(table, words)[1]))
            for table in BUNDLE_TABLES
        },
    }
    names = ("DATASHEET.md", "CITATION.cff", "LICENSE")
    return {name: _environment().get_template(f"{name}.j2").render(values) for name in names}


@cache
def _environment() -> Environment:
    environment = templates(Path(__file__).parent / "templates", is_html=False)
    environment.filters["json"] = partial(json.dumps, ensure_ascii=False)
    environment.filters["ascii_json"] = json.dumps
    return environment


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
