"""A check that ends in any way leaves a row of the page."""

import pytest

from research.compatibility import __main__ as compatibility

CHECKS = ("checker", "copies")
ENDS = {
    "passed": ("echo checker; echo copies", "passed"),
    "an error": ("echo checker; echo KeyError: 1 >&2; exit 1", "copies failed: KeyError: 1"),
    "a kill": ("kill -9 $$", "checker failed: Python ended with code -9"),
    "an error at the end": ("echo checker; echo copies; exit 3", "the end failed: "),
    "words of a library": ("echo a b; echo checker; exit 3", "copies failed: "),
    "no end": ("echo checker; exec sleep 60", "copies not done after 1 s"),
}


@pytest.mark.parametrize("end", ENDS)
def test_every_end_of_a_check_is_a_row(end, tmp_path, monkeypatch):
    script, row = ENDS[end]
    monkeypatch.setattr(compatibility, "PROBE_S", 1)
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o755)
    assert compatibility.probe(python, tmp_path, CHECKS).startswith(row)
