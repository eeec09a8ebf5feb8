"""The report as one self-contained HTML page: styles and charts inside, nothing from a network, no script.

The templates in `templates/` escape everything but the style and the charts.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment

from app.report.charts import charts
from app.report.checklist import CITATION
from app.report.model import SYNTHETIC, GroupReport, Report
from app.report.statistics.formatting import templates
from app.report.statistics.study_figures import why_no_interval
from app.report.tables import (
    GroupTables,
    PageTable,
    checklist_table,
    coverage_table,
    group_tables,
    second_analysis_tables,
)
from app.task import rules_of

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Section:
    """What the page shows of one group; `charts` are SVG by name, without those that have nothing to show."""

    group: GroupReport
    tables: GroupTables
    second_analysis: tuple[PageTable, ...]
    charts: dict[str, str]

    @property
    def has_interval(self) -> bool:
        """Whether the headline prints an interval."""
        found = (self.group.figure.score, self.group.figure.steps)
        return any(estimate is not None and why_no_interval(estimate) is None for estimate in found)


def _where(protocol: Mapping[str, Any]) -> str:
    """Return what was played, beginning a sentence."""
    rules = rules_of(protocol["task"])
    text = rules.where(rules.configuration(protocol["config"]))
    return text[0].upper() + text[1:]


def render(report: Report) -> str:
    """Return the page."""
    return (
        _environment()
        .get_template("page.html.j2")
        .render(
            report=report,
            where=_where(report.protocol),
            words=rules_of(report.protocol["task"]).words,
            recruitment=report.protocol.get("recruitment", "open"),
            watermark=SYNTHETIC,
            style=(FOLDER / "report.css").read_text(encoding="utf-8"),
            left_out=0 if report.synthetic else sum(report.scripts.values()),
            sections=_sections(report),
            checklist=checklist_table(report),
            missing=sum(item.source == "missing" for item in report.checklist),
            citation=CITATION,
            coverage=coverage_table(report),
            protocol_json=json.dumps(report.protocol, indent=1, ensure_ascii=False),
        )
    )


def _sections(report: Report) -> list[Section]:
    """Return a section for each script of a synthetic report, else one for the people if anybody has begun to play."""
    groups = (
        report.groups
        if report.synthetic
        else [group for group in report.groups[:1] if group.figures[0].players or group.started]
    )
    return [
        Section(
            group, group_tables(report, group), second_analysis_tables(group), charts(report, group)
        )
        for group in groups
    ]


@cache
def _environment() -> Environment:
    environment = templates(FOLDER / "templates", is_html=True)
    environment.filters["counts"] = _counts
    return environment


def _counts(pairs: Iterable[tuple[str, int]]) -> str:
    """Return (name, count) pairs as a list in words, "none" for no pairs."""
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in pairs) or "none"
