"""The tables of the page, as text cells.

There are tables of the result, sets, spread, policies, learning, moves and methods.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from humanplay.db.rows import Attestation
from humanplay.report.costs import CostPart, CostSummary
from humanplay.report.measured_coverage import SCORE_POPULATIONS, nearest
from humanplay.report.model import GroupReport, Metric, Report
from humanplay.report.statistics.exclusion_sets import (
    LOWEST_IN_WORDS,
    METRICS,
    LowestReason,
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
    """The tables of a group by name; None if there is nothing in one.

    Those of its comparisons are called `score` and `steps`.
    """
    costs = group.costs
    compared = {comparison.metric for comparison in group.comparisons}
    return {
        "result": _result(group),
        "statuses": _statuses(group),
        "attrition": _attrition(group),
        "by_arm": _by_arm(group),
        "arms_compared": _arms_compared(group),
        "against": _against(report, group) if compared else None,
        "exclusion_sets": _exclusion_sets(group),
        "attestation": _attestation(group),
        "languages": _languages(group.languages),
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
            metric: _comparison(report, group, metric) if metric in compared else None
            for metric in METRICS
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


def _languages(languages: Mapping[str, int]) -> PageTable | None:
    """How many people read each language; None if there is one."""
    if len(languages) < 2:
        return None
    rows = [(language, str(people)) for language, people in languages.items()]
    return PageTable("Who took part: the language that they read", ("language", "people"), rows)


def _answers(answers: Sequence[AnswerCounts]) -> PageTable | None:
    """Return how many people gave which answer; None where nobody was asked."""
    if not answers:
        return None
    rows = []
    for counts in answers:
        asked = f"{counts.asked} (after {counts.turn})" if counts.turn else counts.asked
        cells = "\n".join(f"{cell.answers}: {cell.people}" for cell in counts.cells)
        people = f"fewer than {FEWEST_IN_CELL}" if counts.people is None else str(counts.people)
        rows.append((asked, people, cells or "not shown", counts.mean_and_sd()))
    return PageTable(
        "Who took part: their answers",
        ("question", "answered", "people", "mean and SD"),
        rows,
        is_text=True,
    )


def checklist_table(report: Report) -> PageTable | None:
    """The items of the reporting checklist that are answered.

    None for a synthetic report, which has no checklist.
    """
    if not report.checklist:
        return None
    return PageTable(
        "The checklist's items",
        ("item", "name", "answer", "details", "from"),
        [tuple(vars(item).values()) for item in report.checklist if item.source != "missing"],
        is_text=True,
    )


def declarations_table(report: Report) -> PageTable:
    """What the authors declared in the protocol."""
    declarations = report.protocol["declarations"].items()
    rows = [(name.replace("_", " "), text) for name, text in declarations if text]
    return PageTable("Declared before anybody played", ("what", "answer"), rows, is_text=True)


def coverage_table(report: Report) -> PageTable | None:
    """The measured coverage for about as many players as the report has.

    None below two players.
    """
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
    """What the task calls a metric, beginning a line."""
    name: str = getattr(group.words, metric)
    return name[0].upper() + name[1:]


def _with_interval(mean: float | None, ends: Interval | None, digits: int) -> str:
    """A cell of two lines: a number and its interval."""
    return f"{number(mean, digits)}\n{interval(ends, digits)}"


def _share(estimate: Estimate | None) -> str:
    """A share over players in percent, with its interval."""
    if estimate is None:
        return NONE
    ends = (
        None
        if estimate.interval is None
        else (100 * estimate.interval[0], 100 * estimate.interval[1])
    )
    return f"{percent(estimate.mean, 1)}\n{interval(ends, 1)}"


def _by_metric(
    caption: str, group: GroupReport, names: Sequence[str], columns: Sequence[Sequence[str]]
) -> PageTable:
    """A table with a column for each metric of the group; no rows without metrics."""
    rows = list(zip(names, *columns, strict=True)) if columns else []
    heads = "quantity", *(_heading(group, metric.name) for metric in group.metrics)
    return PageTable(caption, heads, rows)


def _result(group: GroupReport) -> PageTable | None:
    """Both estimates side by side; None if nobody began."""
    figures = group.figure, group.everybody
    if not group.everybody.players:
        return None
    rows = [_estimates(figure) for figure in figures]
    heads = "estimate", "players", "score", group.words.steps, group.words.reached
    return PageTable("Means over players, with 95 % intervals", heads, rows)


def _estimates(figure: StudyFigure) -> tuple[str, ...]:
    """A row of an estimate: its name, players, and mean and interval in each metric."""
    return (
        figure.name,
        str(figure.players),
        _estimate(figure.score, DIGITS["score"]),
        _estimate(figure.steps, DIGITS["steps"]),
        _share(figure.completed),
    )


def large_numbers(report: Report, group: GroupReport) -> list[LargeNumber]:
    """Both estimates in the protocol's primary metric; none where nobody began."""
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
    """Where everybody is who came; None while nobody has."""
    rows = [
        (
            STATUS_IN_WORDS[Status(row.status)],
            str(row.people),
            "yes" if row.in_per_protocol else "no",
            "yes" if row.in_everybody else "no",
            str(row.as_played),
            ", ".join(
                f"{LOWEST_IN_WORDS[LowestReason(name)]} {n}" for name, n in row.lowest.items()
            )
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


def _attrition(group: GroupReport) -> PageTable | None:
    """Where the people of each arm are; None without arms."""
    rows = [
        (
            row.arm,
            str(row.assigned),
            str(row.began),
            str(row.ended),
            str(row.per_protocol.players),
            ", ".join(
                f"{STATUS_IN_WORDS[Status(name)]} {n}"
                for name, n in row.statuses.items()
                if name != Status.FINISHED
            )
            or "0",
        )
        for row in group.arms
    ]
    heads = "arm", "assigned", "began", "ended all", "per protocol", "the others"
    caption = "Attrition by arm: nobody is assigned anew, and nobody is replaced"
    return PageTable(caption, heads, rows) if rows else None


def _by_arm(group: GroupReport) -> PageTable | None:
    """Both estimates of each arm; None without arms, and where nobody began."""
    if not any(row.everybody.players for row in group.arms):
        return None
    rows = [
        (row.arm, *_estimates(figure))
        for row in group.arms
        for figure in (row.per_protocol, row.everybody)
    ]
    heads = "arm", "estimate", "players", "score", group.words.steps, group.words.reached
    return PageTable("Means over the players of each arm, with 95 % intervals", heads, rows)


def _arms_compared(group: GroupReport) -> PageTable | None:
    """Arms minus each other under both estimates; None where nobody began."""
    if not any(row.everybody.players for row in group.arms):
        return None
    names = {"score": group.words.score, "steps": group.words.steps}
    rows = [
        (
            f"{row.arm} − {row.other}",
            names[row.metric],
            _with_interval(row.difference, row.interval, DIGITS[row.metric]),
            _with_interval(row.everybody, row.everybody_interval, DIGITS[row.metric]),
            p_value(row.p_value),
            p_value(row.p_adjusted),
        )
        for row in group.arm_comparisons
    ]
    heads = "arms", "in", "difference, per protocol", "everybody", "p", "p (Holm)"
    return PageTable("Arms minus each other on the same instances", heads, rows)


def _exclusion_sets(group: GroupReport) -> PageTable:
    """Every estimate, those of the protocol's other exclusion sets too."""
    rules = "; ".join(f"{figure.name}: {figure.rule}" for figure in group.figures)
    both = "score (95 % interval)", f"{group.words.steps} (95 % interval)"
    heads = ("estimate", "players", *both, f"{group.words.reached} (95 % interval)")
    rows = [_estimates(figure) for figure in group.figures]
    return PageTable(f"The estimates; who enters: {rules}", heads, rows)


def _attestation(group: GroupReport) -> PageTable | None:
    """The levels of the ranked episodes; None for scripts, or if nobody finished one."""
    summary = group.attestation
    if summary is None or not any(summary.episodes.values()):
        return None
    rows = []
    for level, text in LEVELS_IN_WORDS.items():
        name = f"{level} (required)" if level == summary.required else level
        rows.append((name, str(summary.episodes[level]), str(summary.people[level]), text))
    caption = (
        "Ranked episodes by what the server could attest; those below the level required, but spoilt "
        "ones, are in no figure"
    )
    return PageTable(caption, ("level", "episodes", "people", "what it means"), rows)


def _spread_column(metric: Metric) -> tuple[str, ...]:
    digits, variance = DIGITS[metric.name], metric.variance
    middle = _with_interval(metric.iqm, metric.iqm_interval, digits)
    if variance is None:
        return (*[NONE] * 6, middle)
    low, high = variance.design_effect_interval
    worth = variance.episodes / high, variance.episodes / low
    return (
        _with_interval(variance.between_sd, variance.between_interval, digits),
        _with_interval(variance.terrain_sd, variance.terrain_interval, digits),
        _with_interval(variance.rest_sd, variance.rest_interval, digits),
        _with_interval(variance.icc, variance.icc_interval, 2),
        _with_interval(variance.design_effect, (low, high), 1),
        _with_interval(variance.episodes / variance.design_effect, worth, 0),
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
            report.title_of(row.policy),
            _with_interval(row.difference, row.interval, digits),
            _with_interval(row.everybody, row.everybody_interval, digits),
            p_value(row.p_value),
            p_value(row.p_adjusted),
            _with_interval(row.ratio, row.ratio_interval, 3),
            _with_interval(row.normalized, row.normalized_interval, 3),
        )
        for row in group.comparisons
        if row.metric == metric
    ]
    return PageTable(f"{_heading(group, metric)}: policies minus {group.name}", COMPARISON, rows)


def _against(report: Report, group: GroupReport) -> PageTable:
    """Policies minus people under both estimates in each metric, one row a policy."""
    rows: dict[str, list[str]] = {}
    adjusted: dict[str, float] = {}
    for comparison in group.comparisons:
        digits = {"score": 3, "steps": 1}[comparison.metric]
        row = rows.setdefault(comparison.policy, [])
        row.append(_with_interval(comparison.difference, comparison.interval, digits))
        row.append(_with_interval(comparison.everybody, comparison.everybody_interval, digits))
        if comparison.p_adjusted is not None:
            adjusted[comparison.policy] = comparison.p_adjusted
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
    learning, digits = metric.learning, DIGITS[metric.name] + 1
    return (
        number(learning.slope, digits),
        interval(learning.slope_interval, digits),
        number(learning.change, digits),
        interval(learning.change_interval, digits),
        interval(learning.equivalence, digits),
        NONE if learning.margin is None else f"±{learning.margin:g}",
        p_value(learning.p_equivalence),
        learning.verdict,
    )


def cost_table(costs: CostSummary) -> PageTable:
    """The players' moves beside the expert's, and what mistakes of each kind cost."""
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
    """Each player's cost in all and by kind of mistake, means per episode."""
    rows = []
    for player in costs.by_player:
        moves = (player.mean, *player.by_kind.values(), player.gained)
        rows.append((player.player, str(player.episodes), *(number(mean, 1) for mean in moves)))
    heads = ("player", "episodes", "cost", *costs.by_kind, "gained")
    return PageTable("Each player\u2019s mean cost per episode", heads, rows)


def _first_attempts(group: GroupReport) -> PageTable | None:
    """The mean over terrains and a row for each; None without people's episodes."""
    attempts = group.first_attempts
    if attempts is None or not any(terrain.played for terrain in attempts.terrains):
        return None
    rows = [
        (
            str(row.terrain),
            f"{row.completed} of {row.played}",
            NONE if row.upper_median is None else _with_interval(row.upper_median, row.interval, 0),
            number(row.second_best, 0),
            number(row.score, DIGITS["score"]),
            number(row.best_score, DIGITS["score"]),
        )
        for row in attempts.terrains
    ]
    means = [
        NONE if mean is None else _with_interval(mean.mean, mean.interval, 1)
        for mean in (attempts.upper_median, attempts.second_best)
    ]
    total = [sum(getattr(t, name) for t in attempts.terrains) for name in ("completed", "played")]
    first = f"mean of {attempts.counted}", f"{total[0]} of {total[1]}", *means, NONE, NONE
    caption = "Moves of those who completed an instance, and scores of all; first attempts only"
    of_score = f"{group.words.score}, upper median", f"{group.words.score}, best"
    heads = ("instance", group.words.reached, "upper median", "second best", *of_score)
    return PageTable(caption, heads, [first, *rows])
