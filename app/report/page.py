"""The report as one self-contained HTML page: styles and charts inside, nothing from a network, no script.

The templates in `templates/` escape everything but the style and the charts.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment

from app.report.charts import charts
from app.report.checklist import CITATION
from app.report.model import SYNTHETIC, Report
from app.report.statistics.formatting import templates
from app.report.statistics.study_figures import why_no_interval
from app.report.tables import (
    LEVELS_IN_WORDS,
    checklist_table,
    coverage_table,
    declarations_table,
    group_tables,
)
from app.task import rules_of

FOLDER = Path(__file__).parent


def _where(protocol: Mapping[str, Any]) -> tuple[str, str]:
    """Return what was played, beginning a sentence, and what was seen of it."""
    rules = rules_of(protocol["task"])
    config = rules.configuration(protocol["config"])
    text = rules.where(config)
    return text[0].upper() + text[1:], rules.sees(config)


def render(report: Report) -> str:
    """Return the page."""
    where, sees = _where(report.protocol)
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            report=report,
            where=where,
            sees=sees,
            words=rules_of(report.protocol["task"]).words,
            level=LEVELS_IN_WORDS[report.protocol["required_attestation"]],
            recruitment=report.protocol.get("recruitment", "open"),
            watermark=SYNTHETIC,
            style=(FOLDER / "report.css").read_text(encoding="utf-8"),
            left_out=0 if report.synthetic else sum(report.scripts.values()),
            sections=list(_sections(report)),
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


def _sections(report: Report) -> Iterator[tuple[Any, ...]]:
    """Yield each script of a synthetic report, else the people if anybody has begun to play: the group, its tables, its charts,
    and whether the headline prints an interval."""
    for group in report.groups:
        figure = group.figure
        if report.synthetic or group.figures[0].players or group.started:
            estimates = [each for each in (figure.score, figure.steps) if each is not None]
            has_interval = any(why_no_interval(each) is None for each in estimates)
            yield group, group_tables(report, group), charts(report, group), has_interval


@cache
def _environment() -> Environment:
    environment = templates(FOLDER / "templates", is_html=True)
    environment.filters["counts"] = _counts
    return environment


def _counts(pairs: Iterable[tuple[str, int]]) -> str:
    """Return (name, count) pairs as a list in words, "none" for no pairs."""
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in pairs) or "none"
