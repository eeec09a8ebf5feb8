"""`python -m marsexplorer.paper.page`: draw `docs/paper.md` again from the results that are shipped.

The document keeps its prose. What is drawn is the last two cells of every row that begins with the name of a claim in
backticks, the summary between its marks, and the tables of settings between theirs.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from marsexplorer.files import write_whole
from marsexplorer.paper.algorithms import ALGORITHMS
from marsexplorer.paper.claims import CLAIMS, cells
from marsexplorer.paper.results import FOLDER, Results, read
from marsexplorer.paper.settings import as_table
from marsexplorer.paper.verdicts import VERDICTS

PAGE = FOLDER.parents[1] / "docs" / "paper.md"
ROW = re.compile(r"^\| `(?P<name>[a-z0-9-]+)` \|(?P<says>[^|]*)\|(?P<does>[^|]*)\|[^|]*\|[^|]*\|$", re.M)
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
        return f"<!-- drawn: {match['name']} -->\n{BLOCKS[match['name']](results)}\n<!-- end -->"

    return BLOCK.sub(block, ROW.sub(row, text))


def summary(results: Results) -> str:
    """Return how many claims have which verdict."""
    counts = Counter(claim.decide(results).verdict for claim in CLAIMS.values())
    lines = ["| verdict | claims |", "|---|---|", *(f"| {verdict} | {counts[verdict]} |" for verdict in VERDICTS)]
    return "\n".join(lines)


def settings(algorithm: str) -> Callable[[Results], str]:
    """Return what draws the table of settings of an algorithm."""
    return lambda results: as_table(algorithm)


BLOCKS = {"summary": summary} | {f"settings {name}": settings(name) for name in ALGORITHMS}
"""What stands between `<!-- drawn: NAME -->` and `<!-- end -->`."""


def main(page: Path = PAGE) -> None:
    """Draw the document again where it lies."""
    text = redraw(page.read_text(), read())
    with write_whole(page) as file:
        file.write(text.encode())
    print(f"{page.name}: {len(names_of(text))} claims")


if __name__ == "__main__":
    main()
