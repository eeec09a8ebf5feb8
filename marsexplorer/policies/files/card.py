"""The cards of policies, read from a safetensors file's header without loading a weight or a library.

A safetensors file begins with 8 bytes, the little-endian length of a JSON header; the header's `__metadata__` maps
strings to strings; ours has the card, itself JSON, under "card".
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from marsexplorer.policies.base import PolicyFileError

SUFFIX = ".safetensors"
FORMAT = "marsexplorer-policy-1"
"""What every card of ours has under "format"."""
LARGEST_HEADER = 1 << 20
"""Bytes; a larger header is refused unread."""


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
    return {path.stem: path for path in sorted((shipped_folder() / "paper").glob("*.onnx"))}


POLICY_ADVICE = (
    "give the path of a .safetensors policy with its card inside, as `marsexplorer train` writes it"
)


def refuse(path: Path, expected: str, came: str, advice: str = POLICY_ADVICE) -> PolicyFileError:
    """Return the error for a file that is no policy: what was expected, what came, and what to give instead."""
    return PolicyFileError(f"{path} is no policy: expected {expected}, got {came}; {advice}")


def read_header(path: Path) -> dict[str, Any]:
    """Return the JSON header of a safetensors file; PolicyFileError when the file has none."""
    try:
        with path.open("rb") as file:
            length = int.from_bytes(file.read(8), "little")
            if not 2 <= length <= LARGEST_HEADER:
                raise refuse(
                    path,
                    f"a safetensors header of at most {LARGEST_HEADER} bytes",
                    f"a length of {length}",
                )
            header = json.loads(file.read(length))
    except OSError as error:
        raise refuse(
            path, "a file that can be read", f"{type(error).__name__}: {error.strerror}"
        ) from error
    except (ValueError, RecursionError) as error:
        if isinstance(error, PolicyFileError):
            raise
        raise refuse(path, "a JSON header", "bytes that are none") from error
    if not isinstance(header, dict):
        raise refuse(path, "a header that is a JSON object", type(header).__name__)
    return header


def read_card(path: Path) -> dict[str, Any]:
    """Return the card in a policy file; PolicyFileError when there is none."""
    metadata = read_header(path).get("__metadata__")
    text = metadata.get("card") if isinstance(metadata, dict) else None
    if not isinstance(text, str):
        raise refuse(path, 'a card under "card" in the metadata', "none")
    try:
        card = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise refuse(path, "a card that is JSON", repr(text[:40])) from error
    if not isinstance(card, dict):
        raise refuse(path, "a card that is a JSON object", type(card).__name__)
    return card
