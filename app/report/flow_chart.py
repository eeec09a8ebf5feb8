"""The flow of participants from invitation to analysis, drawn as in CONSORT (Schulz et al. 2010, BMJ 340:c332, figure 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from app.study.flow import ParticipantFlow

BOX, INK, ARROW = "#f4ede6", "#1b2733", "#5a6672"
MAIN_X, MAIN_WIDTH, ASIDE_X, ASIDE_WIDTH = 0.0, 4.6, 5.4, 4.6
LINE, PADDING, GAP = 0.34, 0.26, 0.5
"""Heights in the chart's units, of which ten are its width."""


@dataclass(frozen=True)
class FlowStep:
    """A stage of the flow: how many reached it, and those who went no further, by reason.

    detail  a second line, "" for none
    """

    label: str
    count: int
    detail: str = ""
    lost: tuple[tuple[str, int], ...] = ()


STAGES = {
    "instructions": "at the instructions",
    "tutorial": "at the tutorial",
    "questions": "at the questions",
    "warm_up": "in the warm-up",
    "ranked": "before the first ranked episode",
}


def flow_steps(
    flow: ParticipantFlow, players: int, episodes: int, excluded: Sequence[tuple[str, int]]
) -> list[FlowStep]:
    """Return the stages of a study's flow.

    players, episodes  in the primary figure
    excluded           those who completed the study and are not in it, by reason
    """
    arrivals = flow.arrivals
    steps = []
    if arrivals.issued is not None:
        lost = [("revoked", arrivals.revoked or 0), ("never opened", arrivals.unopened or 0)]
        steps.append(_step("Invitations issued", arrivals.issued, lost))
    before = [
        ("declined", arrivals.declined),
        ("did not answer", arrivals.undecided),
        ("erased at their request", arrivals.erased),
    ]
    steps.append(_step("Opened the study", flow.joined, before))
    early = [
        ("withdrew", flow.withdrew_early),
        *((f"left {STAGES[at]}", count) for at, count in flow.stayed_early.items()),
    ]
    steps.append(_step("Agreed to take part", flow.agreed, early))
    late = [("withdrew", flow.withdrew), ("did not finish", flow.unfinished)]
    steps.append(_step("Began the ranked episodes", flow.ranked, late))
    steps.append(_step("Ended all ranked episodes", flow.completed, list(excluded)))
    return [*steps, FlowStep("In the primary figure", players, f"{episodes} ranked episodes")]


def _step(label: str, count: int, lost: Sequence[tuple[str, int]]) -> FlowStep:
    return FlowStep(label, count, lost=tuple((reason, number) for reason, number in lost if number))


def flow_height(steps: Sequence[FlowStep]) -> float:
    """Return the height of the drawing in its own units."""
    return sum(map(_height, steps)) + GAP * (len(steps) - 1)


def draw_flow(canvas: Canvas, steps: Sequence[FlowStep]) -> None:
    """Draw the stages one below the other, with those who were lost beside the arrow that leads on."""
    axes = canvas.subplots()
    axes.set_axis_off()
    axes.set_xlim(-0.05, 10.05)
    axes.set_ylim(-flow_height(steps) - 0.05, 0.05)
    top = 0.0
    for number, step in enumerate(steps):
        height = _height(step)
        lines = [f"{step.label}: {step.count}", *([step.detail] if step.detail else [])]
        middle = top - height / 2
        _box(axes, MAIN_X, MAIN_WIDTH, middle, lines, is_bold=True)
        if step.lost:
            _arrow(axes, (MAIN_X + MAIN_WIDTH, middle), (ASIDE_X, middle))
            _box(
                axes,
                ASIDE_X,
                ASIDE_WIDTH,
                middle,
                [f"{reason}: {count}" for reason, count in step.lost],
            )
        if number < len(steps) - 1:
            bottom = middle - _box_height(len(lines)) / 2
            below = steps[number + 1]
            next_top = (
                top - height - GAP - (_height(below) - _box_height(1 + bool(below.detail))) / 2
            )
            _arrow(axes, (MAIN_X + MAIN_WIDTH / 2, bottom), (MAIN_X + MAIN_WIDTH / 2, next_top))
        top -= height + GAP


def _height(step: FlowStep) -> float:
    return max(_box_height(1 + bool(step.detail)), _box_height(len(step.lost)))


def _box_height(lines: int) -> float:
    return lines * LINE + 2 * PADDING if lines else 0.0


def _box(
    axes: Axes, x: float, width: float, middle: float, lines: Sequence[str], is_bold: bool = False
) -> None:
    from matplotlib.patches import Rectangle

    height = _box_height(len(lines))
    face = BOX if is_bold else "white"
    axes.add_patch(
        Rectangle(
            (x, middle - height / 2), width, height, facecolor=face, edgecolor=ARROW, linewidth=0.8
        )
    )
    for number, line in enumerate(lines):
        y = middle + height / 2 - PADDING - (number + 0.5) * LINE
        weight = "bold" if is_bold and number == 0 else "normal"
        axes.text(
            x + 0.2, y, line, va="center", ha="left", fontsize=8, color=INK, fontweight=weight
        )


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate(
        "",
        end,
        start,
        arrowprops={
            "arrowstyle": "-|>",
            "color": ARROW,
            "linewidth": 0.9,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )
