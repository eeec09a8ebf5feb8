"""The tables of the page, as text cells: result, sets, spread, policies, learning, moves and
methods."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from humanplay.db.rows import Attestation
from humanplay.report.costs import CostPart, CostSummary
from humanplay.report.measured_coverage import SCORE_POPULATIONS, nearest
from humanplay.report.model import GroupReport, Metric, Report
from humanplay.report.statistics.exclusion_sets import (
    LOWEST_IN_WORDS,
    METRICS,
    Lowest,
    MetricName,
)
from humanplay.report.statistics.formatting import NONE, counted, interval, number, p_value, percent
from humanplay.report.statistics.intervals import Estimate, Interval
from humanplay.report.statistics.study_figures import StudyFigure, why_no_interval
from humanplay.study.answer_counts import FEWEST as FEWEST_IN_CELL
from humanplay.study.answer_counts import AnswerCounts
from humanplay.study.flow import STATUS_IN_WORDS, Status
from humanplay.task.registration import environment_of


@dataclass(frozen=True)
class PageTable:
    """A table whose first column names the rows; a line break in a cell is kept.

    Attributes:
        is_text: Left-aligned text instead of numbers.
    """

    caption: str
    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    is_text: bool = False

    @property
    def id(self) -> str:
        """The caption's id in the page, the same for the same table."""
        return "t" + hashlib.sha256(f"{self.caption}{self.rows}".encode()).hexdigest()[:10]


@dataclass(frozen=True)
class LargeNumber:
    """An estimate as the page's first screen prints it.

    Attributes:
        unit: What the mean counts, in the primary metric.
        under: Its interval or why there is none, the people, and the other figures.
    """

    name: str
    mean: str
    unit: str
    under: Sequence[str]


LEVELS_IN_WORDS: dict[Attestation, str] = {
    "unattested": "the first move has no input event of its own that fits it",
    "spoilt": "the first move has one, a later one does not: it counts as abandoned",
    "attested": "every move fits a key or touch of its own that came before it",
    "supervised": "attested, and the operator had typed their code",
}
DIGITS = {"score": 4, "steps": 1}
SPREAD = (
    "SD between players",
    "SD between instances",
    "SD of the rest",
    "ICC, the players' share",
    "design effect",
    "independent episodes these are worth",
    "interquartile mean of all episodes",
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
COMPARISON = (
    "policy",
    "difference, per protocol",
    "everybody",
    "p",
    "p (Holm)",
    "ratio",
    "normalized",
)


def group_tables(report: Report, group: GroupReport) -> dict[str, PageTable | None]:
    """Return the tables of a group by name, those of its comparisons as `score` and `steps`; None
    where there is nothing."""
    costs = group.costs
    compared = {each.metric for each in group.comparisons}
    return {
        "result": _result(group),
        "statuses": _statuses(group),
        "against": _against(report, group) if compared else None,
        "exclusion_sets": _exclusion_sets(group),
        "attestation": _attestation(group),
        "answers": _answers(group.answers),
        "variance": _by_metric(
            "Variance components (players and instances crossed, ANOVA estimator) and interquartile mean",
            group,
            SPREAD,
            [_spread_column(metric) for metric in group.metrics],
        ),
        "players": _players(group),
        "policies": _policies(report),
        **{
            each: _comparison(report, group, each) if each in compared else None for each in METRICS
        },
        "learning": _by_metric(
            "Did players go on learning? Means over players",
            group,
            LEARNING,
            [_learning_column(metric) for metric in group.metrics],
        ),
        "costs": cost_table(costs) if costs else None,
        "by_tenth": _by_tenth(costs) if costs else None,
        "costs_by_player": costs_by_player(costs) if costs else None,
        "first_attempts": _first_attempts(group),
    }


def _answers(answers: Sequence[AnswerCounts]) -> PageTable | None:
    """Return how many people gave which answer; None where nobody was asked."""
    if not answers:
        return None
    rows = []
    for counts in answers:
        asked = f"{counts.asked} (after {counts.turn})" if counts.turn else counts.asked
        cells = "\n".join(f"{cell.answers}: {cell.people}" for cell in counts.cells)
        people = f"fewer than {FEWEST_IN_CELL}" if counts.people is None else str(counts.people)
        rows.append((asked, people, cells or "not shown"))
    return PageTable(
        "Who took part: their answers", ("question", "answered", "people"), rows, is_text=True
    )


def checklist_table(report: Report) -> PageTable | None:
    """Return the items of the reporting checklist that are answered; None for a synthetic report,
    which has none."""
    if not report.checklist:
        return None
    return PageTable(
        "The checklist's items",
        ("item", "name", "answer", "details", "from"),
        [tuple(vars(item).values()) for item in report.checklist if item.source != "missing"],
        is_text=True,
    )


def declarations_table(report: Report) -> PageTable:
    """Return what the authors declared in the protocol."""
    told = report.protocol["declarations"].items()
    rows = [(name.replace("_", " "), text) for name, text in told if text]
    return PageTable("Declared before anybody played", ("what", "answer"), rows, is_text=True)


def coverage_table(report: Report) -> PageTable | None:
    """Return the measured coverage for about as many players as the report has; None below two
    players."""
    players = max((group.figure.players for group in report.groups), default=0)
    if players < 2:
        return None
    cells = nearest(players)
    studies = counted(cells[0].studies, "simulated study", "simulated studies")
    size = f"{studies} each, {counted(cells[0].players, 'player')} x 30 instances"
    summary = {population.name: population.summary for population in SCORE_POPULATIONS}
    rows = []
    for cell in cells:
        shares = number(cell.score, 1), number(cell.steps, 1)
        rows.append((summary[cell.population], f"{cell.icc:g}", *shares))
    heads = ("population", "ICC", "score", "steps")
    return PageTable(f"Coverage (%) of 95 % intervals in {size}", heads, rows)


def _heading(group: GroupReport, metric: str) -> str:
    """Return what the task calls a metric, beginning a line."""
    name: str = getattr(group.words, metric)
    return name[0].upper() + name[1:]


def _with_interval(value: float | None, ends: Interval | None, digits: int) -> str:
    """Return a cell of two lines."""
    return f"{number(value, digits)}\n{interval(ends, digits)}"


def _share(found: Estimate | None) -> str:
    """Return a share over players in percent, with its interval."""
    if found is None:
        return NONE
    ends = None if found.interval is None else (100 * found.interval[0], 100 * found.interval[1])
    return f"{percent(found.mean, 1)}\n{interval(ends, 1)}"


def _by_metric(
    caption: str, group: GroupReport, names: Sequence[str], columns: Sequence[Sequence[str]]
) -> PageTable:
    """Return a table with a column for each metric of the group; no rows where the group has no
    metrics."""
    rows = list(zip(names, *columns, strict=True)) if columns else []
    heads = "quantity", *(_heading(group, metric.name) for metric in group.metrics)
    return PageTable(caption, heads, rows)


def _result(group: GroupReport) -> PageTable | None:
    """Return both estimates side by side; None where nobody began."""
    figures = group.figure, group.everybody
    if not group.everybody.players:
        return None
    rows = [_estimates(figure) for figure in figures]
    heads = "estimate", "players", "score", group.words.steps, group.words.reached
    return PageTable("Means over players, with 95 % intervals", heads, rows)


def _estimates(figure: StudyFigure) -> tuple[str, ...]:
    """Return a row of a figure: its name, players, and mean and interval in each metric."""
    return (
        figure.name,
        str(figure.players),
        _estimate(figure.score, DIGITS["score"]),
        _estimate(figure.steps, DIGITS["steps"]),
        _share(figure.completed),
    )


def large_numbers(report: Report, group: GroupReport) -> list[LargeNumber]:
    """Both estimates in the metric that the protocol calls primary; none where nobody began."""
    if not group.everybody.players:
        return []
    names = {"Per protocol": group.figure, "Everybody who began": group.everybody}
    primary = report.protocol["primary_metric"]
    return [_large_number(group, name, figure, primary) for name, figure in names.items()]


def _large_number(
    group: GroupReport, name: str, figure: StudyFigure, primary: MetricName
) -> LargeNumber:
    words = {"score": group.words.score, "steps": group.words.steps}
    estimates = {"score": figure.score, "steps": figure.steps}
    estimate, unit = estimates.pop(primary), words[primary]
    people = f"{counted(figure.players, 'player')}, {counted(figure.episodes, 'ranked episode')}"
    if estimate is None:
        reason = "No lowest score is declared." if figure.players else "There is no estimate."
        return LargeNumber(name, NONE, unit, (reason, people))
    digits = DIGITS[primary]
    ends = f"95 % interval {interval(estimate.interval, digits)}"
    ((other, beside),) = estimates.items()
    further = [f"{words[other]} {number(beside.mean, DIGITS[other])}"] if beside else []
    if figure.completed is not None:
        further.append(f"{group.words.reached}: {percent(figure.completed.mean)}")
    under = (why_no_interval(estimate) or ends, people, *further)
    return LargeNumber(name, number(estimate.mean, digits), unit, under)


def _estimate(estimate: Estimate | None, digits: int) -> str:
    if estimate is None:
        return NONE
    return _with_interval(estimate.mean, estimate.interval, digits)


def _statuses(group: GroupReport) -> PageTable | None:
    """Return where everybody is who came; None while nobody has."""
    rows = [
        (
            STATUS_IN_WORDS[Status(row.status)],
            str(row.people),
            "yes" if row.in_per_protocol else "no",
            "yes" if row.in_everybody else "no",
            str(row.as_played),
            ", ".join(f"{LOWEST_IN_WORDS[Lowest(why)]} {n}" for why, n in row.lowest.items())
            or "0",
        )
        for row in group.statuses
    ]
    heads = (
        "status",
        "people",
        "per protocol",
        "everybody",
        "instances as played",
        "instances at the lowest score",
    )
    caption = "Everybody who came: where they are, and how their ranked instances enter the estimate for everybody"
    return PageTable(caption, heads, rows) if rows else None


def _exclusion_sets(group: GroupReport) -> PageTable:
    """Return every estimate, those of the protocol's other exclusion sets too."""
    rules = "; ".join(f"{each.name}: {each.rule}" for each in group.figures)
    both = "score (95 % interval)", f"{group.words.steps} (95 % interval)"
    heads = ("estimate", "players", *both, f"{group.words.reached} (95 % interval)")
    return PageTable(
        f"The estimates; who enters: {rules}", heads, [_estimates(each) for each in group.figures]
    )


def _attestation(group: GroupReport) -> PageTable | None:
    """Return the levels of the ranked episodes; None for scripts and where nobody has finished one."""
    found = group.attestation
    if found is None or not any(found.episodes.values()):
        return None
    rows = []
    for level, text in LEVELS_IN_WORDS.items():
        name = f"{level} (required)" if level == found.required else level
        rows.append((name, str(found.episodes[level]), str(found.people[level]), text))
    caption = (
        "Ranked episodes by what the server could attest; those below the level required, but spoilt "
        "ones, are in no figure"
    )
    return PageTable(caption, ("level", "episodes", "people", "what it means"), rows)


def _spread_column(metric: Metric) -> tuple[str, ...]:
    digits, found = DIGITS[metric.name], metric.variance
    middle = _with_interval(metric.iqm, metric.iqm_interval, digits)
    if found is None:
        return (*[NONE] * 6, middle)
    low, high = found.design_effect_interval
    worth = found.episodes / high, found.episodes / low
    return (
        _with_interval(found.between_sd, found.between_interval, digits),
        _with_interval(found.terrain_sd, found.terrain_interval, digits),
        _with_interval(found.rest_sd, found.rest_interval, digits),
        _with_interval(found.icc, found.icc_interval, 2),
        _with_interval(found.design_effect, (low, high), 1),
        _with_interval(found.episodes / found.design_effect, worth, 0),
        middle,
    )


def _players(group: GroupReport) -> PageTable:
    rows = [
        (
            row.name,
            str(row.episodes),
            number(row.score, 4),
            number(row.steps, 1),
            str(row.failed),
            STATUS_IN_WORDS[Status(row.status)],
        )
        for row in group.players
    ]
    words = group.words.steps, group.words.short
    heads = ("player", "instances", "score", *words, "status")
    return PageTable("Pseudonyms of this report alone, in no order of joining", heads, rows)


def _policies(report: Report) -> PageTable:
    rows = []
    for policy in report.policies:
        counts = f"{policy.completed}/{policy.episodes}", str(policy.failed)
        means = number(policy.score, 4), number(policy.steps, 1)
        rows.append((report.title_of(policy.name), *means, *counts))
    words = environment_of(report.protocol["task"]).about.words
    heads = ("policy", "score", words.steps, words.reached, "failures")
    return PageTable("Policies on this study's ranked instances", heads, rows)


def _comparison(report: Report, group: GroupReport, metric: str) -> PageTable:
    digits = DIGITS[metric]
    rows = [
        (
            report.title_of(each.policy),
            _with_interval(each.difference, each.interval, digits),
            _with_interval(each.everybody, each.everybody_interval, digits),
            p_value(each.p_value),
            p_value(each.p_adjusted),
            _with_interval(each.ratio, each.ratio_interval, 3),
            _with_interval(each.normalized, each.normalized_interval, 3),
        )
        for each in group.comparisons
        if each.metric == metric
    ]
    return PageTable(f"{_heading(group, metric)}: policies minus {group.name}", COMPARISON, rows)


def _against(report: Report, group: GroupReport) -> PageTable:
    """Return policies minus people under both estimates in each metric, a row for each policy."""
    rows: dict[str, list[str]] = {}
    adjusted: dict[str, float] = {}
    for each in group.comparisons:
        digits = {"score": 3, "steps": 1}[each.metric]
        row = rows.setdefault(each.policy, [])
        row.append(_with_interval(each.difference, each.interval, digits))
        row.append(_with_interval(each.everybody, each.everybody_interval, digits))
        if each.p_adjusted is not None:
            adjusted[each.policy] = each.p_adjusted
    heads = ["policy"]
    for metric in group.metrics:
        heads += [f"{_heading(group, metric.name)}, per protocol", "everybody"]
    caption = f"Policies minus {group.name} on the same instances"
    cells = [
        (report.title_of(policy).replace(" (", "\n(", 1), *row, p_value(adjusted.get(policy)))
        for policy, row in rows.items()
    ]
    return PageTable(caption, (*heads, "p (Holm)"), cells)


def _learning_column(metric: Metric) -> tuple[str, ...]:
    found, digits = metric.learning, DIGITS[metric.name] + 1
    return (
        number(found.slope, digits),
        interval(found.slope_interval, digits),
        number(found.change, digits),
        interval(found.change_interval, digits),
        interval(found.equivalence, digits),
        NONE if found.margin is None else f"±{found.margin:g}",
        p_value(found.p_equivalence),
        found.verdict,
    )


def cost_table(costs: CostSummary) -> PageTable:
    """Return the players' moves beside Expert's, and what mistakes of each kind cost."""
    players = counted(len(costs.by_player), "player")
    caption = f"Moves an episode: {players}, {counted(costs.episodes, 'episode')}"
    rows = [
        ("counted", number(costs.counts, 1)),
        (f"{costs.policy} on the same instances", number(costs.expert_moves, 1)),
        _cost_row("cost: the difference", costs.total),
        *(_cost_row(f"mistakes: {kind}", part) for kind, part in costs.by_kind.items()),
        _cost_row("gained", costs.gained),
    ]
    return PageTable(caption, ("", "mean of players"), rows)


def _by_tenth(costs: CostSummary) -> PageTable:
    rows = [
        _cost_row(f"{10 * at} to {10 * at + 10} %", part) for at, part in enumerate(costs.by_tenth)
    ]
    rows.append(_cost_row("an end without a move", costs.without_move))
    caption = "Cost of the moves, by what was known before the move"
    return PageTable(caption, ("cells known", "mean of players"), rows)


def _cost_row(label: str, part: CostPart) -> tuple[str, str]:
    return label, _with_interval(part.mean, part.interval, 1)


def costs_by_player(costs: CostSummary) -> PageTable:
    """Return each player's cost in all and by kind of mistake, means per episode."""
    rows = []
    for player in costs.by_player:
        moves = (player.mean, *player.by_kind.values(), player.gained)
        rows.append((player.player, str(player.episodes), *(number(mean, 1) for mean in moves)))
    heads = ("player", "episodes", "cost", *costs.by_kind, "gained")
    return PageTable("Each player\u2019s mean cost per episode", heads, rows)


def _first_attempts(group: GroupReport) -> PageTable | None:
    """Return the mean over terrains and a row for each; None for scripts and where nobody has
    played."""
    found = group.first_attempts
    if found is None or not any(each.played for each in found.terrains):
        return None
    rows = [
        (
            str(each.terrain),
            f"{each.completed} of {each.played}",
            NONE
            if each.upper_median is None
            else _with_interval(each.upper_median, each.interval, 0),
            number(each.second_best, 0),
            number(each.score, DIGITS["score"]),
            number(each.best_score, DIGITS["score"]),
        )
        for each in found.terrains
    ]
    means = [
        NONE if each is None else _with_interval(each.mean, each.interval, 1)
        for each in (found.upper_median, found.second_best)
    ]
    total = [sum(getattr(t, name) for t in found.terrains) for name in ("completed", "played")]
    mean = f"mean of {found.counted}", f"{total[0]} of {total[1]}", *means, NONE, NONE
    caption = "Moves of those who completed an instance, and scores of all; first attempts only"
    of_score = f"{group.words.score}, upper median", f"{group.words.score}, best"
    heads = ("instance", group.words.reached, "upper median", "second best", *of_score)
    return PageTable(caption, heads, [mean, *rows])
