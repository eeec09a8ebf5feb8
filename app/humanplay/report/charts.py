"""The report's charts: SVG text by matplotlib that needs nothing outside the page."""

from __future__ import annotations

import io
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape
from itertools import zip_longest
from textwrap import wrap
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure as Canvas
from matplotlib.layout_engine import ConstrainedLayoutEngine

from humanplay.report.model import GroupReport, Report
from humanplay.report.statistics.arms import ArmRow
from humanplay.report.statistics.intervals import Interval
from humanplay.report.statistics.summaries import Curve
from humanplay.study.flow import BEGAN, EARLY, ENDED, STATUS_IN_WORDS, ParticipantFlow, Status

PEOPLE_COLOUR = "#1b2733"
POLICY_COLOURS = ("#c1440e", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Okabe and Ito's colours, which colour-blind readers can distinguish, after the colour of Mars.
People are drawn in ink."""
TICKS, AXIS, GREY, RULE, SHADE = "#3a4651", "#5a6672", "#7b8794", "#c5ccd3", "#eceff2"
BOX, PAPER = "#f4ede6", "#ffffff"
STYLED = {
    PEOPLE_COLOUR: "ink",
    TICKS: "ticks",
    AXIS: "axis",
    GREY: "grey",
    RULE: "rule",
    SHADE: "shade",
    BOX: "box",
    PAPER: "paper",
    **{colour: f"policy-{number}" for number, colour in enumerate(POLICY_COLOURS)},
}
"""Colours that the page's style sheet may replace: `--chart-NAME`, for its dark scheme."""
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (1, 1)))
MATPLOTLIB_STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": AXIS,
    "axes.linewidth": 0.7,
    "axes.labelcolor": PEOPLE_COLOUR,
    "axes.titlecolor": PEOPLE_COLOUR,
    "text.color": PEOPLE_COLOUR,
    "xtick.color": TICKS,
    "ytick.color": TICKS,
    "legend.frameon": False,
    "legend.fontsize": 9,
}
_STYLE_LOCK = threading.Lock()
"""matplotlib's style belongs to the process, so only one chart is drawn at a time."""

ZERO_OF_THE_SCALE = "random"
"""The policy that is so far from people that they could not be told apart beside it."""
SHARES = LinearSegmentedColormap.from_list("shares", ["#c1440e00", "#c1440eff"])
"""From nothing to the colour of Mars, so that it stands on both schemes' ground."""
MAX_NAME = 18
"""Characters of a policy's name in a chart; tables have it whole."""


@dataclass(frozen=True)
class Format:
    """A shape that each chart is drawn in.

    Attributes:
        width: In inches, at which letters have their sizes.
        is_narrow: Parts stand below one another.
    """

    name: str
    width: float
    is_narrow: bool = False


FORMATS = (Format("wide", 5.6), Format("narrow", 2.7, is_narrow=True))
"""For screens and paper; for phones, on which letters stay at least 11 px high."""


@dataclass(frozen=True)
class Drawing:
    """How one chart is drawn.

    Attributes:
        heights: In inches, of the wide and of the narrow format.
        draw: Draws on a canvas; the second argument says whether the format is narrow.
        alt: What the chart shows, for those who do not see it.
    """

    heights: tuple[float, float]
    draw: Callable[[Canvas, bool], None]
    alt: str


def draw_svg(name: str, drawing: Drawing, form: Format, is_synthetic: bool) -> str:
    """A chart as an SVG element with its description.

    Args:
        name: Its ids begin with it, so that no two charts of a page share one.
    """
    with _STYLE_LOCK, matplotlib.rc_context({**MATPLOTLIB_STYLE, "svg.hashsalt": name}):
        canvas = Canvas(figsize=(form.width, drawing.heights[form.is_narrow]))
        drawing.draw(canvas, form.is_narrow)
        if is_synthetic:
            canvas.text(
                0.5,
                0.5,
                "SYNTHETIC",
                ha="center",
                va="center",
                fontsize=8 * form.width,
                color="#b00020",
                alpha=0.16,
                rotation=24,
            )
        # once: as the canvas's own engine it would do so in each of two passes of `savefig`, which then draws twice
        ConstrainedLayoutEngine().execute(canvas)
        written = io.StringIO()
        nothing = {"Date": None, "Creator": None}
        canvas.savefig(written, format="svg", transparent=True, metadata=nothing)
    svg = written.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.S)
    size = r' width="[\d.]+pt" height="[\d.]+pt"'
    svg = re.sub(size, "", svg, count=1)
    for element in set(re.findall(r'id="([^"]+)"', svg)):  # ids are one name space in a page
        svg = re.sub(rf'(id="|#){re.escape(element)}(?=["\)])', rf"\g<1>{name}-{element}", svg)
    for colour, role in STYLED.items():
        svg = svg.replace(f": {colour}", f": var(--chart-{role}, {colour})")
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(drawing.alt)}"', 1)


def charts(report: Report, group: GroupReport) -> dict[str, dict[str, str]]:
    """The group's charts as SVG, by name and format; empty ones are left out."""
    drawings = _drawings(report, group)
    return {
        name: {
            form.name: draw_svg(
                f"{group.name}-{name}-{form.name}".replace(" ", "-"),
                drawing,
                form,
                report.synthetic,
            )
            for form in FORMATS
        }
        for name, drawing in drawings.items()
    }


def _drawings(report: Report, group: GroupReport) -> dict[str, Drawing]:
    drawings: dict[str, Drawing] = {}
    if group.flow is not None and group.joined:
        steps = flow_steps(group.flow, group.arms)
        alt = "; ".join(
            " ".join(
                [
                    f"{step.label}: {step.count}",
                    *([f"({step.detail})"] if step.detail else []),
                    *(f"({reason}: {n})" for reason, n in step.lost),
                ]
            )
            for step in steps
        )
        heights = 0.56 * flow_height(steps), 0.56 * flow_height(steps, is_narrow=True)
        drawings["flow"] = Drawing(heights, partial(draw_flow, steps=steps), alt)
    if group.players:
        means = [
            (report.called(policy.name), {"score": policy.score, "steps": policy.steps})
            for policy in report.policies
            if policy.name != ZERO_OF_THE_SCALE
        ]
        alt = "Each player's mean score and mean steps, both estimates with their intervals, and each policy's means"
        drawn = partial(_people_and_policies, group=group, policies=means)
        height = 3.0 + 0.26 * len(means)
        drawings["players"] = Drawing((height, 1.8 * height), drawn, alt)
    if group.metrics:
        alt = "Mean score and steps of first attempts by ranked trial, with intervals"
        drawings["learning"] = Drawing((3.6, 3.6), partial(_learning, group=group), alt)
    if group.comparisons:
        rows = len({comparison.policy for comparison in group.comparisons})
        alt = "Policies over people: ratio of scores, human-normalized score, difference in steps"
        forest = partial(_forest, group=group, called=report.called)
        height = 1.6 + 0.32 * rows
        drawings["forest"] = Drawing((height, 3 * height), forest, alt)
    policies = [(report.called(policy.name), policy.pictures) for policy in report.policies]
    shown = [(group.name, group.pictures), *policies]
    if group.pictures.get("curve") or any(pictures for _, pictures in policies):
        curves = partial(
            _curves, curves=[(name, pictures.get("curve")) for name, pictures in shown]
        )
        heights = 3.0, 3.0 + 0.2 * len(shown)
        drawings["curves"] = Drawing(heights, curves, "Mean coverage against steps")
        maps = [(name, pictures["visits"]) for name, pictures in shown if pictures.get("visits")]
        alt = "Share of an episode's moves on each cell of the grid"
        heights = 2.05 * -(-len(maps) // 3) + 0.3, 1.8 * -(-len(maps) // 2) + 0.8
        drawings["visits"] = Drawing(heights, partial(_visits, maps=maps), alt)
    return drawings


def _people_and_policies(
    canvas: Canvas,
    is_narrow: bool,
    group: GroupReport,
    policies: Sequence[tuple[str, Mapping[str, float]]],
) -> None:
    """Draw each player's mean, and policies' means on the same terrains.

    Both estimates stand below the players.
    """
    titles = {"score": "Score", "steps": group.words.steps.capitalize()}
    finished = Status.FINISHED.value
    lists = {
        name: sorted(
            (getattr(player, name), player.status == finished)
            for player in group.players
            if np.isfinite(getattr(player, name))
        )
        for name in titles
    }
    tallest = max(max(_stacked([mean for mean, _ in players])) for players in lists.values())
    parts = canvas.subplots(2, 1) if is_narrow else canvas.subplots(1, 2)
    gap = "\n" if is_narrow else " "
    for axes, (name, title) in zip(parts, titles.items(), strict=True):
        players = lists[name]
        heights = _stacked([mean for mean, _ in players])
        for (mean, is_finished), height in zip(players, heights, strict=False):
            fill = PEOPLE_COLOUR if is_finished else "none"
            axes.plot(
                [mean],
                [height],
                "o",
                color=PEOPLE_COLOUR,
                markersize=5,
                alpha=0.75,
                markerfacecolor=fill,
            )
        estimates = [
            ("per protocol", getattr(group.figure, name), POLICY_COLOURS[0]),
            ("everybody", getattr(group.everybody, name), POLICY_COLOURS[1]),
        ]
        labels = []
        for row, (label, estimate, colour) in enumerate(estimates):
            labels.append(label if estimate is not None else f"{label} (none)")
            y = -1.2 - row
            if estimate is not None:
                axes.plot([estimate.mean], [y], "D", color=colour, markersize=4)
            if estimate is not None and estimate.interval is not None:
                axes.plot(estimate.interval, [y, y], color=colour, linewidth=2.6)
        for policy, means in policies:
            y = -1.4 - len(labels)
            axes.plot([means[name]], [y], "s", color=POLICY_COLOURS[2], markersize=5)
            labels.append(_short(policy))
        places = [-1.2 - row - 0.2 * (row > 1) for row in range(len(labels))]
        axes.set_yticks(places, labels if is_narrow or name == "score" else [])
        axes.set_ylim(-1.4 - len(labels) + 0.3, tallest + 1)
        axes.axhline(-0.6, color=RULE, linewidth=0.6)
        axes.set_title(title)
        axes.set_xlabel("mean of a player" + (f",{gap}or of a policy" if policies else ""))
        axes.spines["left"].set_visible(False)
        axes.tick_params(left=False)


def _stacked(values: Sequence[float]) -> list[float]:
    """Heights that keep dots of sorted values apart."""
    if not values:
        return [0.0]
    near = (values[-1] - values[0]) / 24 or 1.0
    last: list[float] = []
    heights = []
    for mean in values:
        row = next((row for row, at in enumerate(last) if mean - at > near), len(last))
        last[row : row + 1] = [mean]
        heights.append(0.6 * row)
    return heights


def _learning(canvas: Canvas, is_narrow: bool, group: GroupReport) -> None:
    titles = {"score": "Score", "steps": group.words.steps.capitalize()}
    line = {"marker": "o", "markersize": 3}
    for axes, metric in zip(canvas.subplots(2, 1, sharex=True), group.metrics, strict=True):
        trials = len(metric.learning.by_trial)
        third = trials // 3
        for low in (0.5, trials - third + 0.5):
            axes.axvspan(low, low + third, color=SHADE, zorder=0)
        numbered = enumerate(metric.learning.by_trial, 1)
        rows = [(number, *means) for number, (players, *means) in numbered if players]
        banded = np.array([row for row in rows if row[2] is not None], np.float64).T
        if banded.size:
            bounds = (-np.inf, 1.0) if metric.name == "score" else (0.0, np.inf)
            band = np.clip(banded[2:], *bounds)
            axes.fill_between(banded[0], *band, color=POLICY_COLOURS[0], alpha=0.18, linewidth=0)
        means = [row[0] for row in rows], [row[1] for row in rows]
        axes.plot(*means, color=POLICY_COLOURS[0], linewidth=1.2, **line)
        first = 1 - len(metric.warm_up)
        practice = [(number, row[1]) for number, row in enumerate(metric.warm_up, first) if row[0]]
        if practice:
            hollow = {"color": GREY, "linewidth": 0.8, "markerfacecolor": "none"}
            axes.plot(*zip(*practice, strict=True), **hollow, **line)
        axes.set_title(titles[metric.name])
    bands = "(grey bands: first and last third; hollow: warm-up)"
    axes.set_xlabel("ranked trial, in the order played" + ("\n" if is_narrow else " ") + bands)


def _curves(canvas: Canvas, is_narrow: bool, curves: Sequence[tuple[str, Curve | None]]) -> None:
    """Draw the coverage of people, who come first, and of policies."""
    axes = canvas.subplots()
    styles = (*zip(POLICY_COLOURS, DASHES, strict=True),)
    for number, (name, curve) in enumerate(curves, -1):
        colour, dash = styles[number % len(styles)] if number >= 0 else (PEOPLE_COLOUR, "-")
        if curve:
            width = 1.4 if number >= 0 else 2.2
            axes.plot(
                curve["steps"],
                curve["mean"],
                label=_short(name),
                color=colour,
                linestyle=dash,
                linewidth=width,
            )
            if curve["low"]:
                low, high = np.clip(curve["low"], 0, 1), np.clip(curve["high"], 0, 1)
                axes.fill_between(curve["steps"], low, high, color=colour, alpha=0.13, linewidth=0)
    axes.axhline(0.99, color=GREY, linewidth=0.7, linestyle=":")
    axes.set_ylim(0, 1.02)
    axes.set_xlim(0)
    axes.set_xlabel("moves")
    axes.set_ylabel("coverage (dotted: 99 %)")
    if is_narrow:
        canvas.legend(loc="outside lower left")
    else:
        axes.legend(loc="lower right")


def _visits(canvas: Canvas, is_narrow: bool, maps: Sequence[tuple[str, list[list[float]]]]) -> None:
    shares = [(name, 100 * np.array(visits) / (np.sum(visits) or 1)) for name, visits in maps]
    most = max(float(np.quantile(share, 0.98)) for _, share in shares)
    columns = min(2 if is_narrow else 3, len(maps))
    grid = canvas.subplots(-(-len(maps) // columns), columns, squeeze=False).flat
    image = None
    for (name, share), axes in zip(shares, grid, strict=False):
        image = axes.imshow(share, cmap=SHARES, vmin=0, vmax=most or 1, interpolation="nearest")
        axes.set_title(_short(name))
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_visible(True)
    for axes in list(grid):
        axes.set_visible(False)
    if image is not None:
        side = "bottom" if is_narrow else "right"
        canvas.colorbar(
            image, ax=canvas.axes, location=side, shrink=0.7, label="% of moves", fraction=0.04
        )


def _forest(
    canvas: Canvas, is_narrow: bool, group: GroupReport, called: Callable[[str], str]
) -> None:
    score = [row for row in group.comparisons if row.metric == "score"]
    steps = [row for row in group.comparisons if row.metric == "steps"]
    who = group.name if group.kind == "human" else "players"
    ratios = [(row.ratio, row.ratio_interval) for row in score]
    normalized = [(row.normalized, row.normalized_interval) for row in score]
    differences = [(row.difference, row.interval) for row in steps]
    shape = (3, 1) if is_narrow else (1, 3)
    left, middle, right = canvas.subplots(*shape, sharey=True)
    _rows(left, ratios, f"policy / {who}", 1.0, "Score, ratio")
    _rows(middle, normalized, f"0 random, 1 {who}", 1.0, "Score, normalized")
    _rows(right, differences, f"policy − {who}", 0.0, "Steps, difference")
    left.set_yticks(range(len(score)), [_short(called(row.policy)) for row in score])


def _short(name: str) -> str:
    """A policy's name as a chart has room for it.

    Words are put on lines; of a long word, such as a file's path, the end stays.
    """
    if " " in name:
        return "\n".join(wrap(name, MAX_NAME))
    return name if len(name) <= MAX_NAME else f"…{name[1 - MAX_NAME :]}"


def _rows(
    axes: Axes,
    rows: Sequence[tuple[float | None, Interval | None]],
    label: str,
    none: float,
    title: str,
) -> None:
    for y, (at, ends) in enumerate(rows):
        if at is None:
            continue
        if ends is not None:
            axes.plot(ends, [y, y], color=PEOPLE_COLOUR, linewidth=1.5)
        axes.plot([at], [y], "s", color=POLICY_COLOURS[0], markersize=5)
    axes.axvline(none, color=GREY, linewidth=0.8, linestyle=":")
    axes.set_title(title)
    axes.set_xlabel(label)
    axes.tick_params(left=False)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(len(rows) - 0.5, -0.5)


MAIN_X, MAIN_WIDTH, ASIDE_X, ASIDE_WIDTH = 0.0, 4.6, 5.4, 4.6
NARROW_WIDTH = 10.0
"""The width of the only column on a phone."""
WIDEST, NARROW_WIDEST = 48, 40
"""Characters of a line in a box of the main column, and of the only one."""
LINE, PADDING, GAP = 0.34, 0.26, 0.5
"""Heights in the chart's units, of which ten are its width."""


@dataclass(frozen=True)
class FlowStep:
    """A stage of the flow: how many reached it, and who went no further, by reason.

    Attributes:
        detail: A second line, "" for none.
    """

    label: str
    count: int
    detail: str = ""
    lost: tuple[tuple[str, int], ...] = ()


def flow_steps(flow: ParticipantFlow, arms: Sequence[ArmRow] = ()) -> list[FlowStep]:
    """The stages of a study's flow, by arm from the assignment on."""
    began = {row.arm: row.began + row.statuses.get(Status.BOT, 0) for row in arms}
    arrivals = flow.arrivals
    steps = []
    if arrivals.issued is not None:
        unused = [("revoked", arrivals.revoked or 0), ("never opened", arrivals.unopened or 0)]
        steps.append(_step("Invitations issued", arrivals.issued, unused))
    without = _lost(
        flow,
        Status.DECLINED,
        Status.UNFIT_DEVICE,
        Status.OVER_QUOTA,
        Status.UNDECIDED,
        Status.ERASED,
    )
    steps.append(_step("Opened the study", flow.joined, without))
    if arms:
        left_arms = {status: sum(row.statuses.get(status, 0) for row in arms) for status in EARLY}
        unassigned = [
            (STATUS_IN_WORDS[status], flow.count(status) - people)
            for status, people in left_arms.items()
        ]
        steps.append(_step("Agreed to take part", flow.agreed, unassigned))
        assigned = {row.arm: row.assigned - row.statuses.get(Status.ERASED, 0) for row in arms}
        left = [(STATUS_IN_WORDS[status], people) for status, people in left_arms.items()]
        steps.append(_by_arm("Assigned to an arm", sum(assigned.values()), assigned, left))
    else:
        steps.append(_step("Agreed to take part", flow.agreed, _lost(flow, *EARLY)))
    not_ended = (status for status in (Status.BOT, *BEGAN) if status not in ENDED)
    steps.append(_by_arm("Began the ranked episodes", flow.began, began, _lost(flow, *not_ended)))
    ended = {row.arm: row.ended for row in arms}
    not_counted = _lost(flow, *ENDED[1:])
    steps.append(_by_arm("Ended all ranked episodes", flow.count(*ENDED), ended, not_counted))
    finished = {row.arm: row.statuses.get(Status.FINISHED, 0) for row in arms}
    return [*steps, _by_arm("Per protocol", flow.count(Status.FINISHED), finished)]


def _by_arm(
    label: str, count: int, arms: Mapping[str, int], lost: Sequence[tuple[str, int]] = ()
) -> FlowStep:
    detail = ", ".join(f"{arm} {people}" for arm, people in arms.items())
    # what is longer than a box stands in the table below
    return replace(_step(label, count, lost), detail=detail if len(detail) <= WIDEST else "")


def _lost(flow: ParticipantFlow, *statuses: Status) -> list[tuple[str, int]]:
    return [(STATUS_IN_WORDS[status], flow.count(status)) for status in statuses]


def _step(label: str, count: int, lost: Sequence[tuple[str, int]]) -> FlowStep:
    return FlowStep(label, count, lost=tuple((reason, number) for reason, number in lost if number))


def flow_height(steps: Sequence[FlowStep], is_narrow: bool = False) -> float:
    """The height of the drawing in its own units."""
    heights = [_box_height(len(_lines(step))) if is_narrow else _height(step) for step in steps]
    return sum(heights) + GAP * (len(steps) - 1)


def draw_flow(canvas: Canvas, is_narrow: bool, steps: Sequence[FlowStep]) -> None:
    """Draw the stages below one another, with those who were lost at each.

    They stand in a box beside the stage's, or in the same box on a phone.
    """
    axes = canvas.subplots()
    axes.set_axis_off()
    axes.set_xlim(-0.05, 10.05)
    axes.set_ylim(-flow_height(steps, is_narrow) - 0.05, 0.05)
    if is_narrow:
        _draw_column(axes, steps)
    else:
        _draw_two_columns(axes, steps)


def _draw_column(axes: Axes, steps: Sequence[FlowStep]) -> None:
    top, centre = 0.0, MAIN_X + NARROW_WIDTH / 2
    for step, below in zip_longest(steps, steps[1:]):
        height = _box_height(len(_lines(step)))
        _box(axes, MAIN_X, NARROW_WIDTH, top - height / 2, _lines(step), is_bold=True)
        top -= height
        if below is not None:
            _arrow(axes, (centre, top), (centre, top - GAP))
        top -= GAP


def _lines(step: FlowStep) -> list[str]:
    lost = [f"– {reason}: {count}" for reason, count in step.lost]
    wrapped = [part for line in lost for part in wrap(line, NARROW_WIDEST)]
    details = wrap(step.detail, NARROW_WIDEST) if step.detail else []
    return [f"{step.label}: {step.count}", *details, *wrapped]


def _draw_two_columns(axes: Axes, steps: Sequence[FlowStep]) -> None:
    top, centre = 0.0, MAIN_X + MAIN_WIDTH / 2
    for step, below in zip_longest(steps, steps[1:]):
        lines = [f"{step.label}: {step.count}", *([step.detail] if step.detail else [])]
        middle = top - _height(step) / 2
        _box(axes, MAIN_X, MAIN_WIDTH, middle, lines, is_bold=True)
        if step.lost:
            _arrow(axes, (MAIN_X + MAIN_WIDTH, middle), (ASIDE_X, middle))
            lost = [f"{reason}: {count}" for reason, count in step.lost]
            _box(axes, ASIDE_X, ASIDE_WIDTH, middle, lost)
        top -= _height(step) + GAP
        if below is not None:
            next_top = top - (_height(below) - _box_height(1 + bool(below.detail))) / 2
            _arrow(axes, (centre, middle - _box_height(len(lines)) / 2), (centre, next_top))


def _height(step: FlowStep) -> float:
    return max(_box_height(1 + bool(step.detail)), _box_height(len(step.lost)))


def _box_height(lines: int) -> float:
    return lines * LINE + 2 * PADDING if lines else 0.0


def _box(
    axes: Axes,
    left: float,
    width: float,
    middle: float,
    lines: Sequence[str],
    is_bold: bool = False,
) -> None:
    from matplotlib.patches import Rectangle

    height = _box_height(len(lines))
    box = Rectangle(
        (left, middle - height / 2),
        width,
        height,
        facecolor=BOX if is_bold else PAPER,
        edgecolor=AXIS,
        linewidth=0.8,
    )
    axes.add_patch(box)
    for number, line in enumerate(lines):
        y = middle + height / 2 - PADDING - (number + 0.5) * LINE
        weight = "bold" if is_bold and number == 0 else "normal"
        axes.text(
            left + 0.2,
            y,
            line,
            va="center",
            ha="left",
            fontsize=8,
            color=PEOPLE_COLOUR,
            fontweight=weight,
        )


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    look = {"arrowstyle": "-|>", "color": AXIS, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=look)
