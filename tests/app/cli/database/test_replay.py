"""The command `humanplay replay`: its episodes, its formats and its refusals."""

from functools import partial

import pytest

from humanplay.db.store import Store
from tests.support.command import command
from tests.support.recorded import add_session, open_episode, play


@pytest.fixture
def run(capsys):
    """`run("replay", ...)` -> (exit code, stdout, stderr)."""

    return partial(command, capsys)


def test_an_episode_is_found_by_the_beginning_of_its_id_and_written_as_its_ending_says(
    run, tmp_path
):
    store = Store(tmp_path / "play.db")
    ended, other = play(store, seed=1, explore=True), play(store, seed=2, player="bob")
    running, _ = open_episode(store, add_session(store), 5)
    store.close()
    pairs = enumerate(zip(ended.id, other.id, strict=False))
    shared = ended.id[: next(k for k, (a, b) in pairs if a != b)]

    def replay(episode, name, *rest):
        return run("replay", episode, "--out", tmp_path / name, "--database", store.path, *rest)

    code, out, _ = replay(ended.id, "a.gif", "--ghost", "frontier-cost")
    assert (code, (tmp_path / "a.gif").read_bytes()[:6]) == (0, b"GIF89a")
    assert ended.id in out
    assert "with frontier-cost" in out
    code, out, _ = replay(other.id, "b.HTML", "--ghost", "none")
    assert (code, "with" in out) == (0, False)
    assert (tmp_path / "b.HTML").read_text().startswith("<!doctype html>")
    for episode, name, rest, status, words in [
        (shared, "c.gif", (), 2, f"several episodes begin with '{shared}'"),
        (running.id, "c.gif", (), 2, "no finished episode"),
        (ended.id, "c.txt", (), 2, "expected --out to end with one of .html, .gif, .mp4, .png"),
        (ended.id, "c.gif", ("--ghost", "nobody"), 2, 'no policy "nobody"'),
        (ended.id, "none/c.png", ("--ghost", "none"), 1, "choose another --out"),
        (ended.id, "c.png", ("--ghost", "random"), 2, "a picture shows no policy"),
    ]:
        code, _, err = replay(episode, name, *rest)
        assert (code, words in err, err.count("\n")) == (status, True, 1), err
    assert sorted(
        path.name for path in tmp_path.iterdir() if path.suffix in (".gif", ".HTML", ".part")
    ) == ["a.gif", "b.HTML"]
