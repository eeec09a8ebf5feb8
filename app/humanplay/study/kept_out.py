"""People whom a study no longer lets in: erased people, and people of its pilots.

    NAME/kept_out.json   a key, and a hash under it of each ID; readable by its owner alone

Without the key nobody can try out whose hash it is, so key and hashes are deleted when the study is closed.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from pathlib import Path

from humanplay.study.files import locked, read_object, write_object
from humanplay.study.platforms import plain
from humanplay.study.protocol import StudyError

FILE = "kept_out.json"


def keep_out(folder: Path, idents: Iterable[str]) -> int:
    """Keep people out of the study of a folder; return how many are kept out now."""
    with locked(folder):
        key, hashes = _read(folder) or (secrets.token_bytes(32), set())
        hashes = hashes | {_hash(key, ident) for ident in idents if plain(ident)}
        content = {"key": key.hex(), "hashes": sorted(hashes)}
        write_object(folder / FILE, content, private=True)
    return len(hashes)


def is_kept_out(folder: Path, ident: str) -> bool:
    """Whether the study of a folder keeps out an ID, whatever its case and spaces."""
    content = _read(folder)
    if content is None:
        return False
    key, hashes = content
    return _hash(key, ident) in hashes


def let_in_again(folder: Path) -> None:
    """Delete the key and the hashes."""
    (folder / FILE).unlink(missing_ok=True)


def _hash(key: bytes, ident: str) -> str:
    return hmac.new(key, plain(ident).encode(), hashlib.sha256).hexdigest()


def _read(folder: Path) -> tuple[bytes, set[str]] | None:
    path = folder / FILE
    if not path.exists():
        return None
    content = read_object(path)
    try:
        key, hashes = bytes.fromhex(str(content["key"])), content["hashes"]
        if not isinstance(hashes, list):
            raise TypeError(f"hashes must be a list, got {type(hashes).__name__}")
        return key, set(map(str, hashes))
    except (KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{path} is damaged: {error!r}; restore a backup") from error
