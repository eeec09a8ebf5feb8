"""The shipped policy files, and the cards in policy files: JSON about a policy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from marsexplorer.files import replace_whole
from marsexplorer.policies.files.model import Model

SUFFIX = ".onnx"
FORMAT = "marsexplorer-policy-1"
"""The "format" of every card of ours."""


def shipped_folder() -> Path:
    """The folder data/policies of a checkout, or of the installed package."""
    package = Path(__file__).resolve().parents[2]
    is_checkout = (package.parent / "pyproject.toml").is_file()
    return (package.parent if is_checkout else package) / "data" / "policies"


def shipped() -> dict[str, Path]:
    """The shipped policy files by name (their stem), `ppo` first."""
    paths = sorted(
        shipped_folder().glob(f"*{SUFFIX}"), key=lambda path: (path.stem != "ppo", path.stem)
    )
    return {path.stem: path for path in paths}


def of_paper() -> dict[str, Path]:
    """The policies that the paper's four algorithms trained (docs/paper.md), by name.

    They load by name as the shipped ones do, but `names` does not list them: `serve --paper` offers
    them. The wheel has none.
    """
    return {path.stem: path for path in sorted((shipped_folder() / "paper").glob(f"*{SUFFIX}"))}


def read_card(path: Path) -> dict[str, Any]:
    """The card in a policy file, empty without one; PolicyFileError if it is not ONNX."""
    return card_in(Model(path))


def card_in(model: Model) -> dict[str, Any]:
    """The card in a model's metadata, empty if there is none."""
    try:
        card = json.loads(model.metadata.get("card", "{}"))
    except (ValueError, RecursionError):
        return {}
    return card if isinstance(card, dict) else {}


def write_card(path: Path, card: dict[str, Any]) -> None:
    """Put another card into a policy file, whole or not at all.

    PolicyFileError if it is not an ONNX model.
    """
    model = Model(path).with_metadata("card", json.dumps(card, indent=1))
    with replace_whole(path) as unfinished:
        unfinished.write_bytes(model)
