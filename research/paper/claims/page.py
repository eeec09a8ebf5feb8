"""`python -m research.paper.claims.page`: draw `docs/paper.md` and its pictures again from the results that are shipped.

The document keeps its prose. What is drawn is the last two cells of every row that begins with the name of a claim in
backticks, and what stands between marks: the summary, the pictures and the tables of settings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from marsexplorer.files import write_whole
from research.paper.algorithms import ALGORITHMS
from research.paper.claims import training_claims
from research.paper.claims.claims import CLAIMS, cells
from research.paper.claims.results import FOLDER, VERDICTS, Results, read
from research.paper.claims.settings_table import as_table
from research.paper.figures import figure4, figure5, figure6, figure7
from research.paper.plan import LEVEL

PAGE = Path(__file__).resolve().parents[3] / "docs" / "paper.md"
PICTURES = PAGE.parent / "pictures" / "paper"
ROW = re.compile(
    r"^\| `(?P<name>[a-z0-9-]+)` \|(?P<says>[^|]*)\|(?P<does>[^|]*)\|[^|]*\|[^|]*\|$", re.M
)
BLOCK = re.compile(r"^<!-- drawn: (?P<name>[a-z0-9 -]+) -->\n.*?^<!-- end -->$", re.M | re.S)


SHOWN = {
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
        "figure6-ppo-earlier": "where ppo-earlier goes on the levels, and the obstacles that it finds",
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


def draw_pictures(target: Path, source: Path = FOLDER) -> list[Path]:
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
        names = (name for pictures in SHOWN.values() for name in pictures)
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


def pictures_as_markdown(figure: str, folder: Path) -> str:
    """Return the pictures of a figure that lie in the folder, as the document shows them, or that there are none yet."""
    lines = [
        f"![{text}](pictures/{folder.name}/{name}.png)"
        for name, text in SHOWN[figure].items()
        if (folder / f"{name}.png").exists()
    ]
    return (
        "\n\n".join(lines)
        or f"No results of figure {figure[-1]} are shipped yet, so there is no picture."
    )


def names_of(text: str) -> list[str]:
    """Return the claims that have a row in the document, in their order."""
    return [match["name"] for match in ROW.finditer(text)]


def redraw(text: str, results: Results) -> str:
    """Return the document with its drawn parts as the results have them; KeyError for a row or a block that nobody draws."""

    def row(match: re.Match[str]) -> str:
        measured, verdict = cells(match["name"], results)
        return f"| `{match['name']}` |{match['says']}|{match['does']}| {measured} | {verdict} |"

    def block(match: re.Match[str]) -> str:
        name = match["name"]
        drawn = summary(text, results) if name == "summary" else BLOCKS[name](results)
        tables = re.sub(r"^\|.*\|$", lambda row: re.sub(r" ?\| ?", "|", row[0]), drawn, flags=re.M)
        return f"<!-- drawn: {name} -->\n{tables}\n<!-- end -->"

    return BLOCK.sub(block, ROW.sub(row, text))


def summary(text: str, results: Results) -> str:
    """Return how many claims of each section of the document have which verdict, as a table in Markdown."""
    lines = ["| section | " + " | ".join(VERDICTS) + " |", "|---" * (len(VERDICTS) + 1) + "|"]
    totals: Counter[str] = Counter()
    for section in re.split(r"^## ", text, flags=re.M)[1:]:
        counts = Counter(CLAIMS[name].decide(results).verdict for name in names_of(section))
        if counts:
            totals += counts
            heading = section.split("\n", 1)[0]
            lines.append(summary_line(f"[{heading}](#{anchor(heading)})", counts))
    return "\n".join([*lines, summary_line("together", totals)])


def summary_line(name: str, counts: Counter[str]) -> str:
    """Return a line of the summary; an empty cell for none."""
    return f"| {name} | " + " | ".join(str(counts[verdict] or "") for verdict in VERDICTS) + " |"


def anchor(heading: str) -> str:
    """Return the anchor that the site gives a heading."""
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def unchanging(draw: Callable[[], str]) -> Callable[[Results], str]:
    """Return what draws a block that no result changes."""
    return lambda results: draw()


BLOCKS = training_claims.BLOCKS | {
    f"settings {name}": unchanging(partial(as_table, name)) for name in (*ALGORITHMS, "shared")
}
BLOCKS |= {
    f"pictures {name}": unchanging(partial(pictures_as_markdown, name, PICTURES)) for name in SHOWN
}
"""What stands between `<!-- drawn: NAME -->` and `<!-- end -->`, besides the summary."""


def main(page: Path = PAGE) -> None:
    """Draw the pictures and the document again where they lie."""
    drawn = draw_pictures(PICTURES)
    text = redraw(page.read_text(), read())
    with write_whole(page) as file:
        file.write(text.encode())
    print(f"{page.name}: {len(names_of(text))} claims, {len(drawn)} pictures")


if __name__ == "__main__":
    main()
