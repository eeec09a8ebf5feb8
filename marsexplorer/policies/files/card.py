"""The policy files that are shipped, and the cards in policy files: JSON that says what a policy is and how it was made."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from marsexplorer.files import replace_whole
from marsexplorer.policies.base import PolicyFileError, check_onnx

SUFFIX = ".onnx"
FORMAT = "marsexplorer-policy-1"
"""What every card of ours has under "format"."""


def shipped_folder() -> Path:
    """Return where the shipped policies lie: data/policies of a checkout, or of the installed package."""
    package = Path(__file__).resolve().parents[2]
    is_checkout = (package.parent / "pyproject.toml").is_file()
    return (package.parent if is_checkout else package) / "data" / "policies"


def shipped() -> dict[str, Path]:
    """Return the shipped policy files by name (their stem), `ppo` first."""
    found = {path.stem: path for path in sorted(shipped_folder().glob(f"*{SUFFIX}"))}
    return dict(sorted(found.items(), key=lambda item: (item[0] != "ppo", item[0])))


def of_paper() -> dict[str, Path]:
    """Return the files of the policies that the paper's four algorithms trained (docs/paper.md), by name: their stem.

    They load by name as the shipped ones do, but `names` does not list them: `serve --paper` offers them.
    """
    return {path.stem: path for path in sorted((shipped_folder() / "paper").glob(f"*{SUFFIX}"))}


ADVICE = "give an ONNX model with the inputs and outputs that docs/policies.md lists"


def refuse(path: Path, expected: str, came: str) -> PolicyFileError:
    """Return the error for a file that is no policy: what was expected, what came, and what to give instead."""
    return PolicyFileError(f"{path} is no policy: expected {expected}, got {came}; {ADVICE}")


def read_card(path: Path) -> dict[str, Any]:
    """Return the card in a policy file, empty where there is none; PolicyFileError when it is no ONNX model."""
    check_onnx()
    from marsexplorer.policies.files.onnx import card_in, read_model

    return card_in(read_model(path))


def write_card(path: Path, card: dict[str, Any]) -> None:
    """Put another card into a policy file, whole or not at all; PolicyFileError when it is no ONNX model."""
    check_onnx()
    import onnx

    from marsexplorer.policies.files.onnx import read_model

    model = read_model(path)
    kept = [(each.key, each.value) for each in model.metadata_props if each.key != "card"]
    del model.metadata_props[:]
    for key, value in (*kept, ("card", json.dumps(card, indent=1))):
        model.metadata_props.add(key=key, value=value)
    with replace_whole(path) as unfinished:
        onnx.save(model, str(unfinished))
