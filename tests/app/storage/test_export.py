"""Exports: whole tables of finished episodes, each replayed, no one's id in them."""

import re
from dataclasses import replace
from io import BytesIO

import pytest

from humanplay.board.sources import Sources
from humanplay.db.export import COLUMNS, export_table, export_to, new_key
from humanplay.db.store import Closing
from humanplay.study.invitations import new_id
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from tests.support import golden_study
from tests.support.exported import rows_of
from tests.support.recorded import (
    NOW,
    add_session,
    add_steps,
    alter,
    free_moves,
    open_episode,
    play,
)

IDENTIFIERS = ("episode_id", "player_id", "participant_id", "completion_code")


def table(source, name, **rest):
    return rows_of(b"".join(export_table(source, name, **rest)).decode())


@pytest.mark.parametrize(
    "sql",
    [
        "UPDATE episodes SET total = total + 1",
        "UPDATE episodes SET discovered = discovered - 1",
        "UPDATE episodes SET score = 0.99",
        "UPDATE episodes SET trajectory_hash = 'x'",
        "UPDATE episodes SET terrain = x'00'",
        "UPDATE episodes SET core_version = 'older'",
        "UPDATE episodes SET config_hash = 'x'",
        "UPDATE steps SET reward = reward + 1 WHERE step = 1",
        "UPDATE steps SET discovered = discovered + 1 WHERE step = 1",
        "UPDATE steps SET action = (action + 2) % 4 WHERE step = 1",
        "DELETE FROM steps WHERE step = 1",
    ],
)
def test_what_does_not_replay_as_recorded_is_marked_and_not_hidden(store, sql):
    play(store, seed=1)
    assert table(store, "episodes")[0]["verified"] is True
    alter(store.path, sql)
    (line,) = table(store, "episodes")
    assert line["verified"] is False
    assert [step["verified"] for step in table(store, "steps")] == [False] * (
        1 if sql.startswith("DELETE") else 2
    )


def test_unfinished_episodes_are_left_out(store):
    row, episode = open_episode(store, add_session(store), seed=1)
    add_steps(store, row, episode, free_moves(episode)[:2])
    assert table(store, "episodes") == table(store, "steps") == []
    assert b"".join(export_table(store, "steps")) == (",".join(COLUMNS["steps"]) + "\n").encode()


def test_human_exports_hold_the_counted_episodes_only(store):
    counted = play(store, seed=1)
    play(store, seed=1)  # met before
    for rest in (
        {"assisted": True},
        {"seed_chosen": True},
        {"driver": "script"},
        {"driver": "policy:random"},
    ):
        play(store, seed=2, player="bob", **rest)
    assert len(table(store, "episodes")) == 6
    assert [line["episode"] for line in table(store, "episodes", who="human")] == [counted.id]
    assert {line["episode"] for line in table(store, "steps", who="human")} == {counted.id}


def test_pseudonyms_agree_within_an_export_and_never_between_two(store):
    for seed, player in ((1, "ada-lovelace"), (2, "ada-lovelace"), (3, "bob")):
        play(store, seed=seed, player=player)
    key = new_key()
    lines = table(store, "episodes", key=key)
    assert lines[0]["player"] == lines[1]["player"] != lines[2]["player"]
    assert {line["player"] for line in lines} == {
        line["player"] for line in table(store, "steps", key=key)
    }
    assert not {line["player"] for line in lines} & {
        line["player"] for line in table(store, "episodes")
    }
    text = b"".join(export_table(store, "episodes")) + b"".join(export_table(store, "steps"))
    assert b"ada-lovelace" not in text
    assert b"session-" not in text


def test_a_reader_that_guesses_types_leaves_what_identifies_alone(store):
    pandas = pytest.importorskip("pandas")
    config = EnvConfig.of("1-1-1")
    terrains = ((seed, Episode.begin(config, seed=seed).record().terrain) for seed in range(1000))
    seed, terrain = next(pair for pair in terrains if pair[1].hex().isdigit())
    row = play(store, seed=seed, config=config)
    (line,) = pandas.read_csv(BytesIO(b"".join(export_table(store, "episodes")))).to_dict("records")
    assert line["terrain"] == f"x{terrain.hex()}"
    assert [line["episode"], line["seed"], line["verified"]] == [row.id, seed, True]


def test_what_a_server_draws_is_no_number_to_any_reader():
    sources = vars(Sources())
    for draw in (*(sources[name] for name in IDENTIFIERS), lambda: new_id(())):
        for _ in range(2000):
            drawn = draw()
            with pytest.raises(ValueError, match="could not convert"):
                float(drawn)


def test_an_export_shows_the_database_as_it_was_when_it_began(store):
    for seed in range(3):
        play(store, seed=seed)
    pieces = export_table(store, "episodes")
    first = [next(pieces), next(pieces)]
    play(store, seed=9, started_ms=NOW + 10**6)
    assert len(b"".join([*first, *pieces]).splitlines()) == 1 + 3
    assert len(table(store, "episodes")) == 4


def test_an_export_given_up_halfway_leaves_the_store_working(store):
    for seed in range(3):
        play(store, seed=seed)
    pieces = export_table(store, "steps")
    next(pieces), next(pieces)
    pieces.close()
    assert store.episode(play(store, seed=7).id)["counts"]


def test_both_files_are_written_whole_or_neither(store, tmp_path):
    play(store, seed=1)
    seen = []
    summary = export_to(
        store.path, tmp_path / "out", "all", lambda *progress: seen.append(progress)
    )
    assert (
        summary
        == f"1 episode in {tmp_path / 'out' / 'episodes.csv'}, 2 steps in {tmp_path / 'out' / 'steps.csv'}"
    )
    assert seen[-1] == (2, 2)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "datapackage.json",
        "episodes.csv",
        "steps.csv",
    ]

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_to(store.path, tmp_path / "other", "all", interrupt)
    assert list((tmp_path / "other").iterdir()) == []


def test_episodes_that_do_not_verify_are_counted_in_what_is_said(store, tmp_path):
    play(store, seed=1)
    alter(store.path, "UPDATE episodes SET total = 0.25")
    summary = export_to(store.path, tmp_path, "all", lambda *_: None)
    assert "1 of them did not replay as recorded" in summary


@pytest.mark.parametrize("wrong", [("players", "all"), ("steps", "me")])
def test_an_unknown_table_or_filter_is_refused_before_anything_is_read(store, wrong):
    with pytest.raises(ValueError, match="must be one of"):
        export_table(store, *wrong)


def test_a_given_terrain_without_a_seed_is_exported_and_verified(store):
    row = play(store, seed=1)
    store.next_episode((), [replace(row, id="given", session_id=add_session(store), seed=None)])
    record = replace(store.load_record(row.id), actions=b"", steps=0)
    from marsexplorer.episode import Episode

    episode = Episode.begin(row.config, terrain=record.terrain_map())
    episode.abandon()
    store.next_episode([Closing("given", episode.record(), NOW)], ())
    line = next(line for line in table(store, "episodes") if line["episode"] == "given")
    assert (line["seed"], line["actions"], line["verified"]) == (None, "", True)


def test_an_export_of_the_golden_study_is_what_it_always_was(tmp_path):
    golden_study.play(tmp_path / "golden.db")
    export_to(tmp_path / "golden.db", tmp_path / "out", "all", lambda done, total: None)
    for name in COLUMNS:
        was, now = (
            read_under_one_pseudonym(place / f"{name}.csv")
            for place in (golden_study.STUDIES / "export", tmp_path / "out")
        )
        assert now == was, golden_study.AGAIN


def read_under_one_pseudonym(path):
    """Return a table's text with the players' pseudonyms numbered by appearance.

    Each export draws them anew.
    """
    text = path.read_text()
    for number, pseudonym in enumerate(dict.fromkeys(re.findall(r"\bP[0-9a-f]{10}\b", text))):
        text = text.replace(pseudonym, f"player-{number}")
    return text
