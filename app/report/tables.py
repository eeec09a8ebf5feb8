"""The tables of the page, as text cells: result, sets, spread, policies, learning, moves and methods."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from app.db.trial import Attestation
from app.report.measured_coverage import SCORE_POPULATIONS, Cell, nearest
from app.report.model import GroupReport, Metric, Report
from app.report.moves.analysis import MoveAnalysis
from app.report.moves.likeness import Likeness
from app.report.moves.regret import RegretSummary
from app.report.statistics.exclusion_sets import METRICS
from app.report.statistics.formatting import NONE, interval, number, p_value, percent
from app.report.statistics.mixed_model import MixedModel
from app.report.statistics.study_figures import StudyFigure, why_no_interval
from app.task import rules_of


@dataclass(frozen=True)
class PageTable:
    """A table whose first column names the rows; a line break in a cell is kept.

    is_text      left-aligned text instead of numbers
    row_classes  a CSS class for each row, "" for none; empty when no row has one
    """

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    is_text: bool = False
    row_classes: Sequence[str] = ()

    @property
    def id(self) -> str:
        """The caption's id in the page, the same for the same table."""
        return "t" + hashlib.sha256(f"{self.caption}{self.rows}".encode()).hexdigest()[:10]


LEVELS_IN_WORDS: dict[Attestation, str] = {
    "unattested": "a move has no input event of its own that fits it",
    "attested": "every move fits a key or touch of its own that came before it",
    "supervised": "attested, and the operator had typed their code",
}
DIGITS = {"score": 4, "steps": 1}
SPREAD = (
    "ICC",
    "95 % interval of the ICC",
    "between-player SD",
    "within-player SD",
    "of that between terrains",
    "of that the rest",
    "episodes a player (n0)",
    "players",
    "episodes",
    "design effect",
    "independent episodes these are worth",
    "interquartile mean of all episodes",
    "its 95 % interval over players",
)
LEARNING = (
    "slope a trial",
    "its 95 % interval",
    "last third minus first third",
    "its 95 % interval",
    "its 90 % interval",
    "margin for “flat”",
    "p of the two one-sided tests",
    "verdict",
)


@dataclass(frozen=True)
class MoveTables:
    """None where there is nothing to show."""

    regret: PageTable | None
    by_tenth: PageTable | None
    players: PageTable | None
    likeness: PageTable | None


def move_tables(moves: MoveAnalysis) -> MoveTables:
    """Return the tables of a group's moves."""
    found = moves.regret
    return MoveTables(
        regret=_regret(found) if found else None,
        by_tenth=_by_tenth(found) if found else None,
        players=_regret_by_player(found) if found else None,
        likeness=_likeness(moves.likeness) if moves.likeness else None,
    )


def _regret(found: RegretSummary) -> PageTable:
    """Return the mean regret per episode and the share of each kind of loss."""
    rows = [
        ("mean regret per episode, moves", number(found.mean, 1)),
        ("its 95 % interval over players", interval(found.interval, 1)),
        (f"{found.policy}\u2019s own on the same terrains", number(found.policy_mean, 1)),
        *((f"share: {kind}", percent(share)) for kind, share in found.by_kind.items()),
    ]
    return PageTable(
        f"Regret over {len(found.by_player)} players, {found.episodes} episodes",
        ("quantity", "value"),
        rows,
    )


def _by_tenth(found: RegretSummary) -> PageTable:
    rows = [
        (f"{10 * tenth} to {10 * tenth + 10} %", number(moves, 1))
        for tenth, moves in enumerate(found.by_tenth)
    ]
    return PageTable(
        "Mean regret of an episode, by what was known before the move",
        ("cells known", "moves lost"),
        rows,
    )


def _regret_by_player(found: RegretSummary) -> PageTable:
    rows = [
        (
            each.player,
            str(each.episodes),
            number(each.mean, 1),
            *(number(moves, 1) for moves in each.by_kind.values()),
        )
        for each in found.by_player
    ]
    return PageTable(
        "Each player\u2019s mean regret per episode",
        ("player", "episodes", "regret", *found.by_kind),
        rows,
    )


def _likeness(rows: tuple[Likeness, ...]) -> PageTable:
    """Return a row for each player, a column for each policy."""
    policies = sorted({each.policy for each in rows})
    found = {(each.participant, each.policy): each for each in rows}
    players = sorted({each.participant for each in rows})
    cells = [
        (player, *(_share(found.get((player, policy))) for policy in policies))
        for player in players
    ]
    return PageTable(
        caption="Share of each player\u2019s ranked moves that a policy would have made too",
        heads=("player", *policies),
        rows=cells,
    )


def _share(likeness: Likeness | None) -> str:
    return NONE if likeness is None else percent(likeness.share, 1)


@dataclass(frozen=True)
class GroupTables:
    """The tables of a group; None where it has nothing to show."""

    result: PageTable | None
    exclusion_sets: PageTable
    attestation: PageTable | None
    variance: PageTable
    players: PageTable
    policies: PageTable
    comparisons: tuple[PageTable, ...]
    learning: PageTable
    moves: MoveTables


def group_tables(report: Report, group: GroupReport) -> GroupTables:
    """Return the tables of a group."""
    return GroupTables(
        result=_result(group),
        exclusion_sets=_exclusion_sets(group),
        attestation=_attestation(group),
        variance=_by_metric(
            "Variance components (players and terrains crossed, ANOVA estimator) and interquartile mean",
            group,
            SPREAD,
            [_spread_column(metric) for metric in group.metrics],
        ),
        players=_players(group),
        policies=_policies(report),
        comparisons=tuple(_comparison(group, metric) for metric in METRICS if group.comparisons),
        learning=_by_metric(
            "Did players go on learning? Means over players",
            group,
            LEARNING,
            [_learning_column(metric) for metric in group.metrics],
        ),
        moves=move_tables(group.moves),
    )


def checklist_table(report: Report) -> PageTable | None:
    """Return the reporting checklist; None for a synthetic report, which has none."""
    if not report.checklist:
        return None
    return PageTable(
        caption="The checklist's items",
        heads=("item", "name", "answer", "details", "from"),
        rows=[
            (item.number, item.name, item.answer, item.detail, item.source)
            for item in report.checklist
        ],
        is_text=True,
        row_classes=["missing" if item.source == "missing" else "" for item in report.checklist],
    )


def coverage_table(report: Report) -> PageTable | None:
    """Return the measured coverage for about as many players as the report has; None below two players."""
    players = max((group.figure.players for group in report.groups), default=0)
    if players < 2:
        return None
    cells = nearest(players)
    size = f"{cells[0].studies} simulated studies each, {cells[0].players} players x 30 terrains"
    return PageTable(
        caption=f"Coverage (%) of 95 % intervals in {size}",
        heads=("population", "ICC", "headline", "new terrains"),
        rows=[_coverage_row(cell) for cell in cells],
    )


def _coverage_row(cell: Cell) -> tuple[str, ...]:
    summary = {population.name: population.summary for population in SCORE_POPULATIONS}[
        cell.population
    ]
    shares = cell.headline, cell.new_terrains
    return (
        f"{cell.population}: {summary}",
        f"{cell.icc:g}",
        *(number(share, 1) for share in shares),
    )


def _heading(group: GroupReport, metric: str) -> str:
    """Return what the task calls a metric, beginning a line."""
    name: str = getattr(group.words, metric)
    return name[0].upper() + name[1:]


def _by_metric(
    caption: str, group: GroupReport, names: Sequence[str], columns: Sequence[Sequence[str]]
) -> PageTable:
    """Return a table with a column for each metric of the group; no rows where the group has no metrics."""
    rows = list(zip(names, *columns, strict=True)) if columns else []
    return PageTable(
        caption, ("quantity", *(_heading(group, metric.name) for metric in group.metrics)), rows
    )


def _result(group: GroupReport) -> PageTable | None:
    found = group.figure
    if found.score is None or found.steps is None:
        return None
    columns = []
    for metric, estimate in zip(group.metrics, (found.score, found.steps), strict=True):
        headline = None if why_no_interval(estimate) else estimate.interval
        ends = headline, metric.new_terrains
        digits = DIGITS[metric.name]
        columns.append((number(estimate.mean, digits), *(interval(each, digits) for each in ends)))
    players = f"{found.players} player{'s' * (found.players != 1)}"
    who = f"{players}, {found.episodes} ranked episodes; set “{found.name}”: {found.rule}."
    kind = "guaranteed " if found.score.headline == "guaranteed" else ""
    names = "mean", f"{kind}95 % interval (headline)", "95 % interval, new terrains too"
    table = _by_metric(f"Means over players. {who}", group, names, columns)
    return replace(table, rows=[row for row in table.rows if set(row[1:]) != {NONE}])


def _exclusion_sets(group: GroupReport) -> PageTable:
    rules = "; ".join(f"{each.name}: {each.rule}" for each in group.figures)
    return PageTable(
        caption=f"The figure under each exclusion set; who enters: {rules}",
        heads=(
            "set",
            "players",
            "episodes",
            "score (95 % interval)",
            f"{group.words.steps} (95 % interval)",
            group.words.reached,
        ),
        rows=[_exclusion_set_row(group, figure) for figure in group.figures],
    )


def _exclusion_set_row(group: GroupReport, figure: StudyFigure) -> tuple[str, ...]:
    score, steps = figure.score, figure.steps
    return (
        figure.name + (" (primary)" if figure.name == group.primary else ""),
        str(figure.players),
        str(figure.episodes),
        f"{number(score.mean, 4)}\n{interval(score.interval, 4)}" if score else NONE,
        f"{number(steps.mean, 1)}\n{interval(steps.interval, 1)}" if steps else NONE,
        NONE if figure.completed is None else percent(figure.completed, 1),
    )


def _attestation(group: GroupReport) -> PageTable | None:
    """Return the levels of the ranked episodes; None for scripts and where nobody has finished one."""
    found = group.attestation
    if found is None or not any(found.episodes.values()):
        return None
    rows = [
        (
            f"{level} (required)" if level == found.required else level,
            str(found.episodes[level]),
            str(found.people[level]),
            text,
        )
        for level, text in LEVELS_IN_WORDS.items()
    ]
    caption = "Ranked episodes by what the server could attest; those below the level required are in no figure"
    return PageTable(caption, ("level", "episodes", "people", "what it means"), rows)


def _spread_column(metric: Metric) -> tuple[str, ...]:
    digits, found = DIGITS[metric.name], metric.variance
    middle = number(metric.iqm, digits), interval(metric.iqm_interval, digits)
    if found is None:
        return (*[NONE] * 11, *middle)
    sds = [
        number(sd, digits)
        for sd in (found.between_sd, found.within_sd, found.terrain_sd, found.rest_sd)
    ]
    counts = (
        f"{found.n0:.1f}",
        str(found.players),
        str(found.episodes),
        f"{found.design_effect:.1f}",
        f"{found.effective:.0f}",
    )
    return (number(found.icc, 3), interval(found.icc_interval, 2), *sds, *counts, *middle)


def _players(group: GroupReport) -> PageTable:
    return PageTable(
        caption="Pseudonyms of this report alone, in no order of joining",
        heads=(
            "player",
            "episodes",
            "score",
            group.words.steps,
            group.words.short,
            "in the primary set",
        ),
        rows=[
            (
                row.name,
                str(row.episodes),
                number(row.score, 4),
                number(row.steps, 1),
                str(row.failed),
                "yes" if row.in_primary else "no",
            )
            for row in group.players
        ],
    )


def _policies(report: Report) -> PageTable:
    rows = []
    for policy in report.policies:
        counts = f"{policy.completed}/{policy.episodes}", str(policy.failed)
        rows.append((policy.name, number(policy.score, 4), number(policy.steps, 1), *counts))
    words = rules_of(report.protocol["task"]).words
    heads = ("policy", "score", words.steps, words.reached, "collisions")
    return PageTable("Policies on this study's ranked terrains", heads, rows)


def _comparison(group: GroupReport, metric: str) -> PageTable:
    digits = DIGITS[metric]
    rows = [
        (
            each.policy,
            f"{number(each.difference, digits)}\n{interval(each.new, digits)}",
            p_value(each.p_value),
            interval(each.these, digits),
            interval(each.simultaneous, digits),
            p_value(each.p_adjusted),
            f"{each.better}/{each.terrains}",
            f"{number(each.ratio, 3)}\n{interval(each.ratio_interval, 3)}",
            f"{number(each.normalized, 3)}\n{interval(each.normalized_interval, 3)}",
        )
        for each in group.comparisons
        if each.metric == metric
    ]
    heads = (
        "policy",
        "difference",
        "p",
        "these terrains alone",
        "simultaneous",
        "p (Holm)",
        "better on",
        "ratio",
        "normalized",
    )
    return PageTable(f"{_heading(group, metric)}: policies minus {group.name}", heads, rows)


def _learning_column(metric: Metric) -> tuple[str, ...]:
    found, digits = metric.learning, DIGITS[metric.name] + 1
    change = (
        number(found.change, digits),
        interval(found.change_interval, digits),
        interval(found.equivalence, digits),
    )
    tested = NONE if found.margin is None else f"±{found.margin:g}", p_value(found.p_equivalence)
    slope = number(found.slope, digits), interval(found.slope_interval, digits)
    verdict = found.verdict if found.margin is not None else f"{found.verdict} (no margin)"
    return (*slope, *change, *tested, verdict)


MIXED_MODEL = (
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
    headings = {model.metric: _heading(group, model.metric) for model in models}
    heads = ("quantity", *headings.values())
    rows = list(zip(MIXED_MODEL, *map(_model_column, models), strict=True))
    figures = PageTable(
        "Second analysis: mixed model, players and terrains crossed, fitted by REML", heads, rows
    )
    return (figures, *(table for table in [_difficulties(models, headings)] if table.rows))


def _model_column(model: MixedModel) -> tuple[str, ...]:
    digits = DIGITS[model.metric]
    slope = number(model.slope, digits + 1), interval(model.slope_interval, digits + 1)
    sds = [number(sd, digits) for sd in (model.player_sd, model.terrain_sd, model.rest_sd)]
    return (number(model.mean, digits), interval(model.interval, digits), *slope, *sds, model.note)


def _difficulties(models: list[MixedModel], headings: dict[str, str]) -> PageTable:
    """Return a row for each terrain that a model has a difficulty of."""
    cells: dict[int, dict[str, str]] = {}
    for model in models:
        digits = DIGITS[model.metric]
        for each in model.terrains:
            cell = f"{number(each.effect, digits)}\n{interval(each.interval, digits)}"
            cells.setdefault(each.terrain, {})[model.metric] = cell
    return PageTable(
        caption="What each ranked terrain adds to everybody's figure, with its 95 % interval",
        heads=("terrain", *headings.values()),
        rows=[
            (str(terrain), *(cells[terrain].get(model.metric, NONE) for model in models))
            for terrain in sorted(cells)
        ],
    )
