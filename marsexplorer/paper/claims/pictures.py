"""The pictures of `docs/paper.md`: those of the figures that are shown there, drawn from shipped results and made small."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from marsexplorer.paper.claims.shipped import FOLDER, read
from marsexplorer.paper.figures import figure4, figure5, figure6, figure7
from marsexplorer.paper.plan import LEVEL

PICTURES = {
    "figure4": {
        "figure4-moves": "score, coverage and completion of the four algorithms against moves",
        "figure4-cpu": "the same against CPU seconds",
        "figure4-endings": "how the episodes of the four algorithms end",
    },
    "figure5": {
        "figure5-paper": "score, coverage and completion of PPO on the 12 levels against moves",
        "figure5-difficulty-paper": "what PPO reaches on the kinds of terrain, and the moves of rules and of a search there",
        "figure5-works": "score, coverage and completion on the 12 levels of PPO as it works",
        "figure5-difficulty-works": "what PPO reaches as it works, and the moves of rules and of a search there",
    },
    "figure6": {
        "figure6-quadrants": "how often policies, rules and untrained walks make a U and never go back",
        "figure6-ppo": "where ppo goes on the levels, and the obstacles that it finds",
        "figure6-ppo-works-21-s0": "the same for PPO as it works, trained on each level apart",
    },
    "figure7": {
        "figure7-coverage": "coverage against moves at three sizes",
        "figure7-steps": "moves to 99 % at three sizes, and the share of the last per cents",
        "figure7-shares": "moves to 50, 75, 90, 95 and 99 % of the cells, over those of the rule frontier-cost",
    },
}
"""Figure -> name of a picture that the page shows -> what it shows."""
COLOURS, LARGEST_WIDTH = 192, 1040
"""Of a picture as it is shipped: colours of its palette, and pixels."""


def draw(target: Path, source: Path = FOLDER) -> list[Path]:
    """Draw the pictures for which there are results into the folder `target`; return their paths."""
    records = read(source).records
    trained = [record for record in records if record.trial.level == LEVEL]
    by_level = [
        record
        for record in records
        if record.trial.level != LEVEL and record.trial.algorithm == "ppo"
    ]
    target.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        scratch = Path(folder)
        if trained:
            figure4.draw(trained, scratch)
        if by_level:
            figure5.draw(by_level, figure5.read_difficulty(source), scratch)
        for draw_figure in (figure6.draw, figure7.draw):
            _draw_if_shipped(draw_figure, source, scratch)
        names = (name for pictures in PICTURES.values() for name in pictures)
        return [
            shrink(scratch / f"{name}.png", target / f"{name}.png")
            for name in names
            if (scratch / f"{name}.png").exists()
        ]


def _draw_if_shipped(
    draw_figure: Callable[[Path, Path], list[Path]], source: Path, scratch: Path
) -> None:
    with suppress(FileNotFoundError):  # no results of the figure
        draw_figure(source, scratch)


def shrink(source: Path, target: Path) -> Path:
    """Write a picture with a palette, at most LARGEST_WIDTH pixels wide; return its path."""
    image = Image.open(source).convert("RGB")
    if image.width > LARGEST_WIDTH:
        image = image.resize(
            (LARGEST_WIDTH, round(image.height * LARGEST_WIDTH / image.width)),
            Image.Resampling.LANCZOS,
        )
    image.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        target, optimize=True
    )
    return target


def as_markdown(figure: str, folder: Path) -> str:
    """Return the pictures of a figure that lie in the folder, as the document shows them, or that there are none yet."""
    lines = [
        f"![{text}](pictures/{folder.name}/{name}.png)"
        for name, text in PICTURES[figure].items()
        if (folder / f"{name}.png").exists()
    ]
    return (
        "\n\n".join(lines)
        or f"No results of figure {figure[-1]} are shipped yet, so there is no picture."
    )
