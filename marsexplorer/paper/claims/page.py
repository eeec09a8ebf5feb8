"""`python -m marsexplorer.paper.claims.page`: draw `docs/paper.md` and its pictures again from the results that are shipped.

The document keeps its prose. What is drawn is the last two cells of every row that begins with the name of a claim in
backticks, and what stands between marks: the summary, the pictures and the tables of settings.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

from marsexplorer.files import write_whole
from marsexplorer.paper.algorithms import ALGORITHMS
from marsexplorer.paper.claims import pictures, trained_blocks
from marsexplorer.paper.claims.claims import CLAIMS, cells
from marsexplorer.paper.claims.settings import as_table
from marsexplorer.paper.claims.shipped import Results, read
from marsexplorer.paper.claims.verdicts import VERDICTS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "paper.md"
PICTURES = PAGE.parent / "pictures" / "paper"
ROW = re.compile(
    r"^\| `(?P<name>[a-z0-9-]+)` \|(?P<says>[^|]*)\|(?P<does>[^|]*)\|[^|]*\|[^|]*\|$", re.M
)
BLOCK = re.compile(r"^<!-- drawn: (?P<name>[a-z0-9 -]+) -->\n.*?^<!-- end -->$", re.M | re.S)


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
        return f"<!-- drawn: {name} -->\n{drawn}\n<!-- end -->"

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


BLOCKS = trained_blocks.BLOCKS | {
    f"settings {name}": unchanging(partial(as_table, name)) for name in ALGORITHMS
}
BLOCKS |= {
    f"pictures {name}": unchanging(partial(pictures.as_markdown, name, PICTURES))
    for name in pictures.PICTURES
}
"""What stands between `<!-- drawn: NAME -->` and `<!-- end -->`, besides the summary."""


def main(page: Path = PAGE) -> None:
    """Draw the pictures and the document again where they lie."""
    drawn = pictures.draw(PICTURES)
    text = redraw(page.read_text(), read())
    with write_whole(page) as file:
        file.write(text.encode())
    print(f"{page.name}: {len(names_of(text))} claims, {len(drawn)} pictures")


if __name__ == "__main__":
    main()
