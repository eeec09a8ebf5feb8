"""`python -m research.paper.claims.page`: draw the paper's pages and pictures.

They are drawn from the shipped results; the pages keep their prose. What is drawn is the last cells
of every row that begins with the name of a claim in backticks, and the blocks between marks: the
summary, the pictures and the tables of trainings and settings.
"""

from __future__ import annotations

import re
import shutil
from collections import Counter
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from research.difference import picture
from research.paper.claims.claims import CLAIMS, FINDINGS, cells
from research.paper.claims.code_claims import by_code
from research.paper.claims.hours import to_decide
from research.paper.claims.results import FOLDER, PEOPLE, SLIP, VERDICTS, Results, read
from research.paper.claims.settings_table import as_table
from research.paper.claims.training_claims import BLOCKS
from research.paper.figures import figure4, figure5, figure6, figure7
from research.paper.jobs import write_text
from research.paper.plan import records_of_figure

DOCS = Path(__file__).resolve().parents[3] / "docs"
PAGES = (DOCS / "paper.md", DOCS / "paper-trainings.md")
PICTURES = DOCS / "pictures" / "paper"
ROW = re.compile(r"^\|`(?P<name>[a-z0-9-]+)`\|(?P<says>[^|]*)\|[^|]*\|[^|]*\|$", re.M)
FINDING = re.compile(
    r"^\|`(?P<name>[a-z0-9-]+)`\|(?P<says>[^|]*)\|[^|]*\|[^|]*\|[^|]*\|[^|]*\|$", re.M
)
LENGTHS = re.compile(r"Moves and gradient steps of our trainings: .*?(?=<br>|$)")
BLOCK = re.compile(r"^<!-- drawn: (?P<name>[a-z0-9 -]+) -->\n.*?^<!-- end -->$", re.M | re.S)


SHOWN = {
    "difference": {
        "paths": "the paths of the authors' videos, of PPO in their world, and of PPO in the text's",
    },
    "cleanrl": {
        "cleanrl": "coverage of CleanRL's loop on the level of the authors' videos, against moves",
    },
    "figure4": {
        "figure4-moves": "score, coverage and completion of the four algorithms against moves",
        "figure4-cpu": "the same against CPU minutes",
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
"""Figure -> name of a picture on the page -> its description."""


def draw_pictures(target: Path, source: Path = FOLDER) -> list[Path]:
    """Draw the pictures that have results into the folder `target`.

    Return their paths.
    """
    records = read(source).records
    target.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        scratch = Path(folder)
        if trained := records_of_figure("4", records):
            figure4.draw(trained, scratch)
        if by_level := records_of_figure("5", records):
            figure5.draw(by_level, source, scratch)
        for figure in (figure6, figure7):
            with suppress(FileNotFoundError):  # no results of the figure
                figure.draw(source, scratch)
        picture.draw(scratch)
        picture.draw_curve(scratch)
        names = (name for pictures in SHOWN.values() for name in pictures)
        return [
            shutil.copyfile(scratch / f"{name}.svg", target / f"{name}.svg")
            for name in names
            if (scratch / f"{name}.svg").exists()
        ]


def pictures_as_markdown(figure: str, folder: Path) -> str:
    """The pictures of a figure in the folder as Markdown, or that there are none yet."""
    lines = [
        f"![{text}](pictures/{folder.name}/{name}.svg)"
        for name, text in SHOWN[figure].items()
        if (folder / f"{name}.svg").exists()
    ]
    none = f"No results of figure {figure[-1]} are shipped yet, so there is no picture."
    return "\n\n".join(lines) or none


def names_of(text: str) -> list[str]:
    """The claims that have a row in the document: findings, then definitions."""
    return [match["name"] for kind in (FINDING, ROW) for match in kind.finditer(text)]


def redraw(text: str, results: Results) -> str:
    """A page with its drawn parts as the results have them.

    KeyError for a row or a block that is unknown.
    """
    printed = set[str]()

    def row(match: re.Match[str]) -> str:
        measured, verdict = cells(match["name"], results)
        return f"|`{match['name']}`|{match['says']}|{measured}|{verdict}|"

    def finding(match: re.Match[str]) -> str:
        name = match["name"]
        measured, verdict = cells(name, results)
        if lengths := LENGTHS.search(measured):
            if lengths[0] in printed:
                measured = measured.replace(lengths[0], "Trainings as long as above")
            printed.add(lengths[0])
        in_the_codes = "" if verdict in (PEOPLE, SLIP) else by_code(name, results)
        hours = to_decide(name, verdict, results)
        return f"|`{name}`|{match['says']}|{measured}|{verdict}|{in_the_codes}|{hours}|"

    def block(match: re.Match[str]) -> str:
        drawn = draw_block(match["name"], text, results)
        tables = re.sub(r"^\|.*\|$", lambda row: re.sub(r" ?\| ?", "|", row[0]), drawn, flags=re.M)
        return f"<!-- drawn: {match['name']} -->\n{tables}\n<!-- end -->"

    return BLOCK.sub(block, ROW.sub(row, FINDING.sub(finding, text)))


def draw_block(name: str, text: str, results: Results) -> str:
    """The content of a block `<!-- drawn: NAME -->` ... `<!-- end -->`.

    KeyError for an unknown name.
    """
    kind, _, figure = name.partition(" ")
    if kind == "summary":
        return summary(text, results)
    if kind == "settings":
        return as_table(results)
    return pictures_as_markdown(figure, PICTURES) if kind == "pictures" else BLOCKS[name](results)


def summary(text: str, results: Results) -> str:
    """The findings by verdict, and how many definitions have which, as Markdown."""
    findings: dict[str, list[str]] = {verdict: [] for verdict in VERDICTS}
    for match in FINDING.finditer(text):
        name = match["name"]
        code, _, _ = by_code(name, results).partition(":")
        there = f"; in the code's world {code}" if code else ""
        judgement = CLAIMS[name].decide(results)
        brief = f": {judgement.brief}" if judgement.brief else ""
        findings[judgement.verdict].append(f"- {match['says']} (`{name}`{there}){brief}")
    definitions = Counter(
        claim.decide(results).verdict for name, claim in CLAIMS.items() if name not in FINDINGS
    )
    counts = ", ".join(f"{count} {verdict}" for verdict, count in definitions.most_common())
    lists = [
        "\n".join([f"**{verdict.capitalize()}**", "", *says])
        for verdict, says in findings.items()
        if says
    ]
    return "\n\n".join([*lists, f"Of {definitions.total()} definitions: {counts}."])


def main() -> None:
    """Draw the pictures and the pages again where they lie."""
    drawn, results = draw_pictures(PICTURES), read()
    for page in PAGES:
        text = redraw(page.read_text(), results)
        write_text(page, text)
        print(f"{page.name}: {len(names_of(text))} claims")
    print(f"{len(drawn)} pictures")


if __name__ == "__main__":
    main()
