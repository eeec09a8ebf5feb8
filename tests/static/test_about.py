"""The boards on the page about the rules are real ones."""

import json

from humanplay import STATIC
from tests.support import about_boards


def test_the_boards_that_are_shown_are_what_is_played():
    stored = json.loads(about_boards.FILE.read_text())
    assert stored == about_boards.boards(), "run `python -m tests.support.about_boards`"
    boards = stored["boards"]
    assert [boards[name]["outcome"] for name in ("done", "crash")] == ["explored", "collided"]
    assert boards["done"]["coverage"] >= 0.99
    text = (STATIC / "task/mars/about.html").read_text()
    assert "Moves that uncover nothing can bring it below 0" in text, "0 is not the least"
