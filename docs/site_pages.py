"""What mkdocs does before it builds the site: it adds pages that are files elsewhere, replays and the product's colours, and
mends the links to them; a link that has a file's name for its words gets the title of what it leads to."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from humanplay.tasks.mars.course import course_of, play_ghost
from humanplay.tasks.mars.drawn import PLAIN_POLICIES
from humanplay.web.replays.page import single_file
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode, Record
from marsexplorer.policies import begin, load

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
"""Page of the site -> the file at the root that it shows."""

WIDE_PAGES = {"paper.md", "paper-trainings.md"}
"""Pages whose tables need the room of the lists at their sides."""

FOLDED_PAGES = {
    "commands.md": 3,
    "environments.md": 2,
    "examples.md": 2,
    "results.md": 2,
    "study.md": 2,
}
"""Long pages, and the level of the headings whose sections are folded."""

REFERENCE = (
    "marsexplorer.config", "marsexplorer.episode", "marsexplorer.env", "marsexplorer.vector",
    "marsexplorer.terrain", "marsexplorer.maps", "marsexplorer.policies.base", "marsexplorer.policies.loading",
    "marsexplorer.policies.priced", "marsexplorer.evaluation.table", "marsexplorer.evaluation.cost", "marsexplorer.compat",
)  # fmt: skip
"""Modules whose docstrings make the reference."""

REPLAYS = (
    ("scattered", "Scattered rocks", EnvConfig("random"), 7, "ppo", "frontier-cost"),
    ("boulders", "Boulders", EnvConfig.of("3-2-1"), 12, "ppo", "frontier-utility"),
    ("cave", "A cave, in which Expert is the slower one", EnvConfig.of("cave", 42), 5, "ppo", "frontier-cost"),
    ("building", "A building, which every policy finds hard", EnvConfig.of("building", 42), 4, "frontier-priced", "ppo"),
)  # fmt: skip
"""Name of the file, caption, configuration, seed and the two policies of each replay in the gallery."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from files outside docs/, the replays, the icon and the colours."""
    for name, _, played, seed, driver, ghost in REPLAYS:
        record = play(driver, played, seed)
        text = single_file(
            name, course_of(PLAIN_POLICIES[driver], record), play_ghost(ghost, record)
        )
        files.append(File.generated(config, f"replays/{name}.html", content=text))
    icon = (ROOT / "static/common/icon.svg").read_text()
    files.append(File.generated(config, "icon.svg", content=icon))
    files.append(File.generated(config, "colours.css", content=colours()))
    made = {page: (ROOT / source).read_text() for page, source in PAGES.items()}
    made |= {"examples.md": examples(), "reference.md": reference()}
    for page, text in made.items():
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Mend the links of a page, give pages with wide tables the whole width, and put the replays into the gallery."""
    if page.file.src_uri in WIDE_PAGES:
        page.meta["hide"] = ["navigation", "toc"]
    frames = "\n".join(
        f'<figure class="replay"><figcaption>{caption}</figcaption>'
        f'<iframe src="replays/{name}.html" title="A replay: {caption}" loading="lazy"></iframe></figure>'
        for name, caption, *_ in REPLAYS
    )
    return mend(markdown, page.file.src_uri).replace("<!-- replays -->", frames)


def on_page_content(html: str, page: Any, **_: Any) -> str:
    """Fold the sections of a long page; the first one is open."""
    if page.file.src_uri == "reference.md":
        return folded_modules(html)
    level = FOLDED_PAGES.get(page.file.src_uri)
    return html if level is None else folded(html, level)


def folded(html: str, level: int) -> str:
    """Return a page whose sections of a level are folded, but for the first."""
    parts = re.split(rf"(?=<h[1-{level}][ >])", html)
    number = next(at for at, part in enumerate(parts) if part.startswith(f"<h{level}"))
    for at, part in enumerate(parts):
        if part.startswith(f"<h{level}"):
            heading, rest = part.split(f"</h{level}>", 1)
            parts[at] = fold(f"{heading}</h{level}>", rest, is_open=at == number)
    return "".join(parts)


def folded_modules(html: str) -> str:
    """Return the reference with each module folded."""
    start = '<div class="doc doc-object doc-module">'
    head, *modules = html.split(start)
    names = (f"<code>{module}</code>" for module in REFERENCE)
    folds = (fold(name, start + text) for name, text in zip(names, modules, strict=True))
    return head + "".join(folds)


def fold(summary: str, content: str, is_open: bool = False) -> str:
    """Return a section that is folded under its summary."""
    state = " open" if is_open else ""
    return f'<details class="fold"{state}><summary>{summary}</summary>{content}</details>'


def play(name: str, config: EnvConfig, seed: int) -> Record:
    """Return a policy's episode on the terrain of a seed."""
    episode, policy = Episode.begin(config, seed=seed), load(name, config.sensor_radius)
    begin(policy, config.level, seed)
    while not episode.ended:
        episode.step(policy.act(episode.codes))
    return episode.record()


def colours() -> str:
    """Return the names of colours and fonts that the playground's pages have, for the two schemes of the site."""
    text = (ROOT / "static/common/base.css").read_text()
    dark, common = re.findall(r"^:root {(.*?)^}", text, re.M | re.S)
    (light,) = re.findall(r"^:root\[data-theme=light\] {(.*?)^}", text, re.M | re.S)
    scheme = "[data-md-color-scheme]"
    return f"{scheme} {{{dark}{common}}}\n[data-md-color-scheme=default] {{{light}}}\n"


def title_of(page: str, anchor: str) -> str:
    """Return a page's title, or its heading with an anchor such as "#columns"."""
    text = (ROOT / PAGES.get(page, f"docs/{page}")).read_text()
    headings = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    named = {re.sub(r"[^\w -]", "", each).lower().replace(" ", "-"): each for each in headings}
    return named.get(anchor.removeprefix("#"), headings[0])


def mend(text: str, page: str) -> str:
    """Return Markdown with links to files of the repository as links to the pages that show them; others become plain words."""
    at_root = page in PAGES

    def target(match: re.Match[str]) -> str:
        words, address, anchor = match[1], match[2], match[3] or ""
        if re.match(r"[a-z]+:", address) or not address:
            return match[0]
        place = address.removeprefix("../") if not at_root else address
        shown = next((name for name, source in PAGES.items() if source == place), None)
        if at_root and place.startswith("docs/"):
            shown = place.removeprefix("docs/")
        elif not at_root and not address.startswith("../"):
            shown = address
        elif place.startswith("examples"):
            shown = "examples.md"
        if shown and re.fullmatch(r"[\w/]+\.md(: .*)?", words):
            words = title_of(shown, anchor)
        return f"[{words}]({shown}{anchor})" if shown else words

    return re.sub(r"\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)#\s]*)(#[^)\s]*)?\)", target, text)


def examples() -> str:
    """Return the page of examples: each script as it stands, and the notebook's cells."""
    parts = ["# Examples", "", "The files stand in `examples/` of the repository.", ""]
    for path in sorted((ROOT / "examples").glob("*.py")):
        parts += [f"## {path.name}", "", "```python", path.read_text().rstrip(), "```", ""]
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        parts += [f"## {path.name}", ""]
        for cell in json.loads(path.read_text())["cells"]:
            source = "".join(cell["source"])
            parts += (
                ["```python", source, "```", ""]
                if cell["cell_type"] == "code"
                else [re.sub(r"^#", "###", source, flags=re.M), ""]
            )
    return "\n".join(parts)


def reference() -> str:
    """Return the page that mkdocstrings fills with docstrings."""
    return "\n\n".join(
        [
            "# Reference",
            "Public names of the environment's core.",
            *(f"::: {module}" for module in REFERENCE),
        ]
    )
