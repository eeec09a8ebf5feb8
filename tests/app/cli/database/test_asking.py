"""Commands that cannot be undone ask once they know that they can do it."""

from contextlib import closing

import pytest

from humanplay.db.backup import back_up
from humanplay.db.store import Store
from tests.support.command import command
from tests.support.stored_studies import freeze, play_study


@pytest.fixture
def asked(monkeypatch):
    """The questions that were asked; each is answered with yes."""
    questions = []
    monkeypatch.setattr("click.confirm", lambda text, **rest: questions.append(text))
    return questions


def test_what_cannot_be_done_is_refused_before_anything_is_asked(tmp_path, capsys, asked):
    path = tmp_path / "play.db"
    study = freeze(tmp_path / "play.db-studies", close=False)
    person, *_ = play_study(path, study, ("human",))
    back_up(path, tmp_path / "backup.db")
    in_use = f"{path} is in use by another server"
    with closing(Store(path)):
        for words, refused in (
            (("restore", tmp_path / "backup.db"), in_use),
            (("restore", tmp_path / "none.db"), "no backup at"),
        ):
            code, _, error = command(capsys, *words, "--database", path)
            assert code in (1, 2)
            assert (refused in error, asked) == (True, []), words
    assert command(capsys, "forget", person, "--database", path)[0] == 0
    assert command(capsys, "restore", tmp_path / "backup.db", "--database", path)[0] == 0
    assert [question.split()[0] for question in asked] == ["Erase", "Put"]
