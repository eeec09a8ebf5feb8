"""What mkdocs does before it builds the site: it adds pages that are files elsewhere, and mends the links to them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "readme.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
"""Page of the site -> the file at the root that it shows."""

WIDE_PAGES = {"paper.md"}
"""Pages whose tables need the room of the lists at their sides."""

REFERENCE = (
    "marsexplorer.config", "marsexplorer.episode", "marsexplorer.env", "marsexplorer.vector",
    "marsexplorer.terrain", "marsexplorer.policies.base", "marsexplorer.policies.loading", "marsexplorer.evaluation.table",
)  # fmt: skip
"""Modules whose docstrings make the reference."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from files outside docs/."""
    made = {page: (ROOT / source).read_text() for page, source in PAGES.items()}
    made |= {"examples.md": examples(), "reference.md": reference()}
    for page, text in made.items():
        files.append(File.generated(config, page, content=mend(text, page)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Mend the links of a page that lead out of docs/, and give pages with wide tables the whole width."""
    if page.file.src_uri in WIDE_PAGES:
        page.meta["hide"] = ["navigation", "toc"]
    return mend(markdown, page.file.src_uri)


def mend(text: str, page: str) -> str:
    """Return Markdown with links to files of the repository as links to the pages that show them; others become plain words."""
    at_root = page in PAGES

    def target(match: re.Match[str]) -> str:
        words, address, anchor = match[1], match[2], match[3] or ""
        if re.match(r"[a-z]+:", address) or not address:
            return match[0]
        place = address.removeprefix("../") if not at_root else address
        if at_root and place.startswith("docs/"):
            return f"[{words}]({place.removeprefix('docs/')}{anchor})"
        if not at_root and not address.startswith("../"):
            return match[0]
        shown = next((name for name, source in PAGES.items() if source == place), None)
        if place.startswith("examples"):
            shown = "examples.md"
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
