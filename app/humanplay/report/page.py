"""The report as HTML: a page, its methods and its checklist.

Each has its styles and charts inside, and no script. The templates in `templates/` escape everything
but the style and the charts.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

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
from humanplay.study.answer_counts import FEWEST, FEWEST_FOR_MEAN
from humanplay.task.registration import environment_of

FOLDER = Path(__file__).parent


class Section(NamedTuple):
    """A group of players as the page shows it.

    Attributes:
        tables, charts: By name, for the template.
        has_interval: Whether the headline prints an interval.
    """

    group: GroupReport
    tables: dict[str, PageTable | None]
    charts: dict[str, dict[str, str]]
    has_interval: bool


def render(report: Report, file_name: str = "report.html") -> str:
    """The page that is read first, which links to the files of `pages`."""
    return _render_part(report, "page", file_names(report, file_name))


def pages(report: Report, file_name: str = "report.html") -> dict[str, str]:
    """File name -> the text of the page, of its methods and of its checklist."""
    names = file_names(report, file_name)
    return {name: _render_part(report, part, names) for part, name in names.items()}


def file_names(report: Report, file_name: str) -> dict[str, str]:
    """Part of a report -> its file name. A report of scripts has no checklist.

    Args:
        file_name: The name of the page that is read first.
    """
    path = Path(file_name)
    names = {"page": file_name, "methods": f"{path.stem}-methods{path.suffix}"}
    if report.checklist:
        names["checklist"] = f"{path.stem}-checklist{path.suffix}"
    return names


def _render_part(report: Report, part: str, names: Mapping[str, str]) -> str:
    played = environment_of(report.protocol["task"])
    texts = played.texts(played.configuration(report.protocol["config"]))
    return (
        _jinja()
        .get_template(f"{part}.html.j2")
        .render(
            report=report,
            links=names,
            where=texts.setting[0].upper() + texts.setting[1:],
            sees=texts.observations,
            words=played.about.words,
            references=played.about.references,
            level=LEVELS_IN_WORDS[report.protocol["required_attestation"]],
            recruitment=report.protocol.get("recruitment", "open"),
            watermark=SYNTHETIC,
            fewest=FEWEST,
            fewest_for_mean=FEWEST_FOR_MEAN,
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


def _sections(report: Report) -> Iterator[Section]:
    """The sections of the page.

    A section for each script of a synthetic report; else one for the people, if anybody has begun
    to play.
    """
    for group in report.groups:
        if not (report.synthetic or group.everybody.players or group.started):
            continue
        estimates = [
            estimate
            for figure in (group.figure, group.everybody)
            for estimate in (figure.score, figure.steps)
            if estimate is not None
        ]
        has_interval = any(estimate.interval is not None for estimate in estimates)
        yield Section(group, group_tables(report, group), charts(report, group), has_interval)


@cache
def _jinja() -> Environment:
    jinja = templates(FOLDER / "templates", is_html=True)
    jinja.filters["counts"] = _counts
    jinja.filters["as_day"] = _day
    return jinja


def _day(time: str) -> str:
    """Return the day of an ISO 8601 time, "1 January 2026"."""
    date = datetime.fromisoformat(time)
    return f"{date.day} {date:%B %Y}"


def _counts(pairs: Iterable[tuple[str, int]]) -> str:
    """Pairs of a name and its count as a list in words; "none" if there are no pairs."""
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in pairs) or "none"
