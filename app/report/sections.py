"""The sections of the page about one group: its figure, who played, policies beside, learning, where the rover went."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from app.report.figures import figures
from app.report.markup import bullets, figure, paragraph, table
from app.report.model import Group, Metric, Report
from app.statistics.formatting import NONE, interval, number, p_value, percent

NAMES = {"score": "Normalized score", "steps": "Steps to 99 %"}
DIGITS = {"score": 4, "steps": 1}
CURVE = (
    "Mean over players at each trial; bands are 95 % t intervals over players. Hollow: the warm-up, whose terrains come in the "
    "same order for everybody."
)
INTERVALS = ("95 % interval (printed)", "t interval", "studentised bootstrap", "new terrains too", "guaranteed")


def sections(report: Report, group: Group) -> str:
    """Return everything about a group, as HTML."""
    pictures = figures(report, group)
    parts = [_result(report, group), _who(group)]
    if "players" in pictures:
        told = "Each dot is one player's mean. Below, the mean with the printed 95 % interval, the t interval, the studentised "
        parts.append(
            figure(pictures["players"], told + "bootstrap over players, and the interval that covers new terrains too.")
        )
    parts += [_spread(group), _policies(report, group, pictures), _learning(group, pictures)]
    if "visits" in pictures:
        maps = "Share of an episode's moves spent on each cell, in the mean (every player weighs the same); one colour scale."
        parts.append(f"<h2>Where they went</h2>{figure(pictures['visits'], maps)}")
    parts.append(f"<h2>Deviations from the protocol</h2>{_deviations(report, group)}")
    return "".join(parts)


def _result(report: Report, group: Group) -> str:
    found = group.figure
    if found.score is None or found.steps is None:
        return "<h2>Result</h2>" + paragraph("Nobody is in the primary set yet: there is no figure.")
    columns = []
    for metric, estimate in zip(group.metrics, (found.score, found.steps), strict=True):
        ends = (estimate.interval, estimate.t, estimate.bootstrap, metric.new_terrains, estimate.guaranteed)
        digits = DIGITS[metric.name]
        columns.append((number(estimate.mean, digits), *(interval(each, digits) for each in ends)))
    who = f"{found.players} players, {found.episodes} ranked episodes; set “{found.name}”: {found.rule}."
    return (
        "<h2>Result</h2>"
        + _beside(f"Means over players. {who}", group, ("mean", *INTERVALS), columns)
        + paragraph(f"What is estimated: {report.estimand}", "note")
        + paragraph(f"The printed interval (rule {report.rule_version}, fixed before any data): {report.rule}.", "note")
        + ("<h3>Read before use</h3>" + bullets(group.cautions) if group.cautions else "")
    )


def _who(group: Group) -> str:
    way = f"{group.joined} joined, {group.started} began a ranked episode, {group.finished} ended all of them"
    left = f"; {group.left} dropped out or withdrew." if group.left else "; nobody dropped out."
    rows = []
    for found in group.figures:
        score, steps = found.score, found.steps
        rows.append(
            (
                found.name + (" (primary)" if found.name == group.primary else ""),
                str(found.players),
                str(found.episodes),
                f"{number(score.mean, 4)}\n{interval(score.interval, 4)}" if score else NONE,
                f"{number(steps.mean, 1)}\n{interval(steps.interval, 1)}" if steps else NONE,
                NONE if found.completed is None else percent(found.completed, 1),
            )
        )
    sets = table(
        "The figure under each exclusion set; who enters: " + "; ".join(f"{each.name}: {each.rule}" for each in group.figures),
        ("set", "players", "episodes", "score (95 % interval)", "steps to 99 % (95 % interval)", "reached 99 %"),
        rows,
    )
    outcomes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in sorted(group.outcomes.items())) or "none"
    labels = ", ".join(f"{name} {count}" for name, count in sorted(group.labels.items())) or "none"
    stages = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in group.stages.items()) or "none"
    return (
        "<h2>Who played</h2>"
        + paragraph(way + left)
        + sets
        + paragraph(f"Participants by stage: {stages}. Ranked episodes by outcome: {outcomes}. By label: {labels}.", "note")
    )


def _spread(group: Group) -> str:
    if not group.metrics:
        return ""
    columns = [_spread_column(metric) for metric in group.metrics]
    players = [
        (
            row.name,
            str(row.episodes),
            number(row.score, 4),
            number(row.steps, 1),
            str(row.failed),
            "yes" if row.in_primary else "no",
        )
        for row in group.players
    ]
    names: tuple[str, ...] = (
        "ICC",
        "95 % interval of the ICC",
        "between-player SD",
        "within-player SD",
        "episodes a player (n0)",
    )
    names += ("players", "episodes", "design effect", "independent episodes these are worth")
    names += ("interquartile mean of all episodes", "its 95 % interval over players")
    return (
        "<h2>Spread</h2>"
        + _beside("Variance components (one-way random effects, ANOVA estimator) and interquartile mean", group, names, columns)
        + paragraph(
            "ICC is the share of the variance that lies between players. The design effect says how many times too small the "
            "variance of the mean comes out when episodes are pooled as if independent.",
            "note",
        )
        + "<details><summary>Every player's mean</summary>"
        + table(
            "Pseudonyms of this report alone, in no order of joining",
            ("player", "episodes", "score", "steps to 99 %", "short of 99 %", "in the primary set"),
            players,
        )
        + "</details>"
    )


def _spread_column(metric: Metric) -> tuple[str, ...]:
    digits, found = DIGITS[metric.name], metric.variance
    middle = number(metric.iqm, digits), interval(metric.iqm_interval, digits)
    if found is None:
        return (*[NONE] * 9, *middle)
    sds = number(found.between_sd, digits), number(found.within_sd, digits)
    counts = f"{found.n0:.1f}", str(found.players), str(found.episodes), f"{found.design_effect:.1f}", f"{found.effective:.0f}"
    return (number(found.icc, 3), interval(found.icc_interval, 2), *sds, *counts, *middle)


def _beside(caption: str, group: Group, names: Sequence[str], columns: Sequence[Sequence[str]]) -> str:
    """Return a table with a column for each metric of the group."""
    rows = list(zip(names, *columns, strict=True))
    return table(caption, ("quantity", *(NAMES[metric.name] for metric in group.metrics)), rows)


def _policies(report: Report, group: Group, pictures: dict[str, str]) -> str:
    if not report.policies:
        return ""
    rows = []
    for policy in report.policies:
        counts = f"{policy.completed}/{policy.episodes}", str(policy.failed)
        rows.append((policy.name, number(policy.score, 4), number(policy.steps, 1), *counts))
    heads = ("policy", "score", "steps to 99 %", "reached 99 %", "collisions")
    parts = ["<h2>Policies on the same terrains</h2>", table("Policies on this study's ranked terrains", heads, rows)]
    for metric in ("score", "steps"):
        parts.append(_compared(group, metric))
    if group.comparisons:
        parts.append(
            paragraph(
                f"Differences are policy minus {group.name}, paired by terrain; below them the interval that covers other "
                "players on these terrains, beside it the one for other players and other terrains. p: sign-flip permutation "
                "test of the paired differences over terrains, for these players, adjusted for the number of policies (Holm). "
                f"Ratio: policy over {group.name}. Normalized: 0 is the policy random, 1 {group.name}. Intervals of both: "
                "crossed bootstrap over players and terrains.",
                "note",
            )
        )
    if "forest" in pictures:
        told = "With 95 % intervals over players and terrains; the dotted line is “no different”."
        parts.append(figure(pictures["forest"], told))
    if "curves" in pictures:
        told = "Mean coverage against moves; an ended episode keeps what it had. Bands: 95 % intervals; for people over "
        parts.append(figure(pictures["curves"], told + "players, for policies over terrains."))
    return "".join(parts)


def _compared(group: Group, metric: str) -> str:
    found = [each for each in group.comparisons if each.metric == metric]
    if not found:
        return ""
    digits = DIGITS[metric]
    rows = [
        (
            each.policy,
            f"{number(each.difference, digits)}\n{interval(each.these, digits)}",
            interval(each.new, digits),
            p_value(each.p_adjusted),
            f"{each.better}/{each.terrains}",
            f"{number(each.ratio, 3)}\n{interval(each.ratio_interval, 3)}",
            f"{number(each.normalized, 3)}\n{interval(each.normalized_interval, 3)}",
        )
        for each in found
    ]
    heads = ("policy", "difference", "new terrains", "p (Holm)", "better on", "ratio", "normalized")
    return table(f"{NAMES[metric]}: policies minus {group.name}", heads, rows)


def _learning(group: Group, pictures: dict[str, str]) -> str:
    if not group.metrics:
        return ""
    names: tuple[str, ...] = ("slope a trial", "its 95 % interval", "last third minus first third")
    names += ("its 95 % interval", "its 90 % interval", "margin for “flat”", "p of the two one-sided tests", "verdict")
    columns = [_learned(metric) for metric in group.metrics]
    parts = ["<h2>Learning over the ranked trials</h2>"]
    if "learning" in pictures:
        parts.append(figure(pictures["learning"], CURVE))
    parts.append(_beside("Did players go on learning? Means over players", group, names, columns))
    margin = (
        "Flat means: the 90 % interval of the change lies within the margin that the protocol fixed (two one-sided "
        "tests at 5 %). "
        "Every participant meets the terrains in an order of their own, so a trend is not one of terrains."
    )
    return "".join(parts) + paragraph(margin, "note")


def _learned(metric: Metric) -> tuple[str, ...]:
    found, digits = metric.learning, DIGITS[metric.name] + 1
    change = number(found.change, digits), interval(found.change_interval, digits), interval(found.equivalence, digits)
    tested = NONE if found.margin is None else f"±{found.margin:g}", p_value(found.p_equivalence)
    slope = number(found.slope, digits), interval(found.slope_interval, digits)
    verdict = found.verdict if found.margin is not None else f"{found.verdict} (no margin)"
    return (*slope, *change, *tested, verdict)


def _deviations(report: Report, group: Group) -> str:
    lines = (*report.deviations, *group.deviations)
    return bullets(lines) if lines else f"<p>{escape('None were found.')}</p>"
