"""The tables of the second analysis, the mixed model: its mean and its slope, and how difficult each terrain was."""

from __future__ import annotations

from app.report.model import GroupReport
from app.report.page_table import PageTable
from app.report.tables import DIGITS, METRIC_NAMES
from app.statistics.formatting import NONE, interval, number
from app.statistics.mixed_model import MixedModel

QUANTITIES = (
    "mean, for other players and terrains",
    "its 95 % interval",
    "slope a trial",
    "its 95 % interval",
    "SD between players",
    "SD between terrains",
    "SD of the rest",
    "how the fit went",
)


def second_analysis_tables(group: GroupReport) -> tuple[PageTable, ...]:
    """Return the mixed model's figures and the terrains' difficulties."""
    models = [metric.mixed_model for metric in group.metrics]
    if not models:
        return ()
    heads = ("quantity", *(METRIC_NAMES[model.metric] for model in models))
    rows = list(zip(QUANTITIES, *map(_column, models), strict=True))
    figures = PageTable(
        "Second analysis: mixed model, players and terrains crossed, fitted by REML", heads, rows
    )
    return (figures, *(table for table in [_difficulties(models)] if table.rows))


def _column(model: MixedModel) -> tuple[str, ...]:
    digits = DIGITS[model.metric]
    slope = number(model.slope, digits + 1), interval(model.slope_interval, digits + 1)
    sds = [number(sd, digits) for sd in (model.player_sd, model.terrain_sd, model.rest_sd)]
    return (number(model.mean, digits), interval(model.interval, digits), *slope, *sds, model.note)


def _difficulties(models: list[MixedModel]) -> PageTable:
    """Return a row for each terrain that a model has a difficulty of."""
    cells: dict[int, dict[str, str]] = {}
    for model in models:
        digits = DIGITS[model.metric]
        for each in model.terrains:
            cell = f"{number(each.effect, digits)}\n{interval(each.interval, digits)}"
            cells.setdefault(each.terrain, {})[model.metric] = cell
    return PageTable(
        caption="What each ranked terrain adds to everybody's figure, with its 95 % interval",
        heads=("terrain", *(METRIC_NAMES[model.metric] for model in models)),
        rows=[
            (str(terrain), *(cells[terrain].get(model.metric, NONE) for model in models))
            for terrain in sorted(cells)
        ],
    )
