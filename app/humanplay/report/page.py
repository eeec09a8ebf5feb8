"""The report as HTML: a page, its methods and its checklist, with styles and charts inside, and no
script.

The templates in `templates/` escape everything but the style and the charts.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

from jinja2 import Environment

from humanplay.report.charts import charts
from humanplay.report.checklist import CITATION
from humanplay.report.model import SYNTHETIC, GroupReport, Report
from humanplay.report.statistics.formatting import templates
from humanplay.report.tables import (
    LEVELS_IN_WORDS,
    PageTable,
    checklist_table,
    coverage_table,
    declarations_table,
    group_tables,
    large_numbers,
)
from humanplay.task.registration import environment_of

FOLDER = Path(__file__).parent


def _where(protocol: Mapping[str, Any]) -> tuple[str, str]:
    """Return what was played, beginning a sentence, and what was seen of it."""
    environment = environment_of(protocol["task"])
    config = environment.configuration(protocol["config"])
    texts = environment.texts(config)
    return texts.setting[0].upper() + texts.setting[1:], texts.observations


def render(report: Report, page: str = "report.html") -> str:
    """The page that is read first; `pages` has the files that it links to."""
    return _page(report, "page", file_names(report, page))


def pages(report: Report, page: str = "report.html") -> dict[str, str]:
    """The report's page under this file name, its methods and its checklist, by file name."""
    names = file_names(report, page)
    return {name: _page(report, part, names) for part, name in names.items()}


def file_names(report: Report, page: str) -> dict[str, str]:
    """The files of a report by part; a report of scripts has no checklist."""
    path = Path(page)
    names = {"page": page, "methods": f"{path.stem}-methods{path.suffix}"}
    if report.checklist:
        names["checklist"] = f"{path.stem}-checklist{path.suffix}"
    return names


def _page(report: Report, part: str, names: Mapping[str, str]) -> str:
    where, sees = _where(report.protocol)
    about = environment_of(report.protocol["task"]).about
    return (
        _environment()
        .get_template(f"{part}.html.j2")
        .render(
            report=report,
            links=names,
            where=where,
            sees=sees,
            words=about.words,
            references=about.references,
            level=LEVELS_IN_WORDS[report.protocol["required_attestation"]],
            recruitment=report.protocol.get("recruitment", "open"),
            watermark=SYNTHETIC,
            large_numbers=partial(large_numbers, report),
            style=(FOLDER / "report.css").read_text(encoding="utf-8"),
            left_out=0 if report.synthetic else sum(report.scripts.values()),
            sections=list(_sections(report)) if part == "page" else [],
            checklist=checklist_table(report),
            missing=[item for item in report.checklist if item.source == "missing"],
            citation=CITATION,
            declarations=declarations_table(report),
            undeclared=[
                name.replace("_", " ")
                for name, text in report.protocol["declarations"].items()
                if not text
            ],
            coverage=coverage_table(report),
            protocol_json=json.dumps(report.protocol, indent=1, ensure_ascii=False),
        )
    )


def _sections(
    report: Report,
) -> Iterator[tuple[GroupReport, dict[str, PageTable | None], dict[str, dict[str, str]], bool]]:
    """Yield each script of a synthetic report, else the people if anybody has begun to play: the
    group, its tables, its charts, and whether the headline prints an interval."""
    for group in report.groups:
        if report.synthetic or group.everybody.players or group.started:
            figures = group.figure, group.everybody
            both = [each for figure in figures for each in (figure.score, figure.steps)]
            estimates = [each for each in both if each is not None]
            has_interval = any(each.interval is not None for each in estimates)
            yield group, group_tables(report, group), charts(report, group), has_interval


@cache
def _environment() -> Environment:
    environment = templates(FOLDER / "templates", is_html=True)
    environment.filters["counts"] = _counts
    return environment


def _counts(pairs: Iterable[tuple[str, int]]) -> str:
    """Return (name, count) pairs as a list in words, "none" for no pairs."""
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in pairs) or "none"
