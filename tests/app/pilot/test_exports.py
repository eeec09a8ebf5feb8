"""Plays as other tools read them, without a study."""

import pytest

from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.plays import Plays
from humanplay.release.errors import ReleaseError
from humanplay.task.registration import environment_of
from tests.app.pilot.test_score import LAKE, played
from tests.support.command import command
from tests.support.recorded import alter, ask

minari = pytest.importorskip("minari")
parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def plays(serve, tmp_path, monkeypatch):
    """Two people's episodes of FrozenLake."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    played(serve(task=LAKE), 2)
    return Plays(tmp_path / "playground.db", LAKE)


def test_plays_leave_as_parquet_minari_and_a_page(plays, tmp_path):
    moves = ask(plays.database, "SELECT count(*) FROM steps")[0][0]
    assert "2 episodes" in plays.to_parquet(tmp_path / "tables")
    assert parquet.read_table(tmp_path / "tables" / "steps.parquet").num_rows == moves
    episodes = parquet.read_table(tmp_path / "tables" / "episodes.parquet").to_pylist()
    assert [row["verified"] for row in episodes] == [True, True]
    assert plays.to_minari("lake/people-v0") == "2 episodes in the dataset lake/people-v0"
    dataset = minari.load_dataset("lake/people-v0")
    assert dataset.total_steps == moves
    steps = parquet.read_table(tmp_path / "tables" / "steps.parquet").to_pylist()
    loaded = [number for episode in dataset for number in episode.rewards.tolist()]
    assert loaded == [step["reward"] for step in steps]
    names = environment_of(plays.task).actions
    actions = [names[code] for episode in dataset for code in episode.actions.tolist()]
    assert actions == [step["action"] for step in steps]
    seeds = [about["seed"] for about in dataset.storage.get_episode_metadata([0, 1])]
    assert seeds == [row["seed"] for row in episodes]
    page = plays.replay(out=tmp_path / "replay.html")
    assert page.read_text().startswith("<!doctype html>")
    assert plays.verify() == []
    with pytest.raises(PilotError, match="expected a number below 2"):
        plays.replay(2)


def test_plays_of_two_configurations_are_no_dataset(plays):
    longer = "config = json_set(config, '$.max_steps', 50), config_hash = 'longer'"
    first = "SELECT min(id) FROM episodes WHERE ended_ms IS NOT NULL"
    assert alter(plays.database, f"UPDATE episodes SET {longer} WHERE id = ({first})") == 1
    with pytest.raises(ReleaseError, match=r'plays of 2: .*"max_steps": 100\}.*"max_steps": 50\}'):
        plays.to_minari("lake/people-v0")


def test_the_command_writes_the_same_and_leaves_out_what_does_not_replay(plays, tmp_path, capsys):
    first = "SELECT min(id) FROM episodes WHERE ended_ms IS NOT NULL"
    assert alter(plays.database, f"UPDATE episodes SET score = 7 WHERE id = ({first})") == 1
    out = tmp_path / "out"
    code, text, error = command(
        capsys,
        "export",
        "--database",
        plays.database,
        "--out",
        out,
        "--parquet",
        "--minari",
        "lake/some-v0",
    )
    assert code == 0, error
    assert "1 episode in the dataset lake/some-v0; 1 episode left out" in text
    assert sorted(path.name for path in out.iterdir()) == [
        "datapackage.json", "episodes.csv", "episodes.parquet", "steps.csv", "steps.parquet",
    ]  # fmt: skip
    assert minari.load_dataset("lake/some-v0").total_episodes == 1
