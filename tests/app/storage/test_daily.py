"""Daily attempts in the database: one a day and player, in no human score."""

from contextlib import closing

import pytest

from humanplay.db.erasure import forget
from humanplay.db.export import export_table
from humanplay.db.merging import MergeError, merge
from humanplay.db.reader import Reader
from humanplay.db.series import add_series, attempts_of, daily_secret
from humanplay.db.store import Store, StoreError
from humanplay.report.statistics.human_level import human_level
from humanplay.study.days import terrain_on
from humanplay.study.seeds import commitment
from humanplay.study.verification import verify_database
from tests.support.recorded import alter, play
from tests.support.recorded_daily import AFTER_MS, DAY, DURING_MS, play_daily, small_terrain
from tests.support.stored_studies import CONFIG, StudyRecorder, freeze, play_study


def test_the_secret_and_the_terrain_of_a_day_stay_as_they_were_made(store):
    assert daily_secret(store) == daily_secret(store)
    terrain = small_terrain(store)
    assert add_series(store, terrain.series) == terrain.series
    assert terrain_on(store, DAY) == terrain
    assert terrain_on(store, "2026-11-23") is None
    assert terrain.series.commitment == commitment(bytes.fromhex(terrain.series.secret))
    assert terrain.series.secret not in repr(terrain)


def test_a_player_has_one_attempt_a_day_and_everybody_the_same_terrain(store):
    row = play_daily(store)
    (attempt,) = attempts_of(store, "ada")
    assert (attempt.id, attempt.outcome, attempt.moves) == (row.id, "abandoned", 2)
    assert store.find_episode(row.id).episode.series == row.series
    with pytest.raises(StoreError, match="did not take the write"):
        play_daily(store)
    assert play_daily(store, "bob").terrain == row.terrain
    assert play_daily(store, day="2026-11-23").terrain != row.terrain
    assert [attempt.day for attempt in attempts_of(store, "ada")] == ["2026-11-23", DAY]
    assert verify_database(store.path).findings == ()


def test_a_daily_episode_is_public_once_its_day_is_over_and_nobodys_before_that(store):
    daily, ranked = play_daily(store).id, play(store, seed=7).id
    for at_ms, shown in (
        (DURING_MS, {ranked}),
        (AFTER_MS - 1, {ranked}),
        (AFTER_MS, {daily, ranked}),
    ):
        with closing(Reader.open(store.path, public=True, at_ms=at_ms)) as reader:
            assert {row["episode"] for row in reader.episodes()} == shown
            assert {row["id"] for row in reader.finished()} == shown
            assert reader.count() == len(shown)
            assert (reader.episode(daily) is None) == (daily not in shown)
            assert reader.episode(ranked)["daily"] is None
            assert [row.id for row in reader.played_by("ada")] == [ranked, daily]
            assert {row["id"] for row in reader.finished(player="ada")} == shown
        text = b"".join(export_table(store, "episodes", public=True, at_ms=at_ms)).decode()
        assert (daily in text, ranked in text) == (daily in shown, True)
        assert (f",{DAY},true\n" in text) == (daily in shown)


def test_a_daily_episode_enters_no_human_score(store):
    play_daily(store)
    ranked = play(store, seed=7).id
    with closing(Reader.open(store.path, public=True, at_ms=AFTER_MS)) as reader:
        assert [row["episode"] for row in reader.episodes(who="human")] == [ranked]
        assert [figure["episodes"] for figure in human_level(reader)["figures"]] == [1]
    assert b"".join(export_table(store, "episodes", "human", at_ms=AFTER_MS)).count(b"\n") == 2


OTHER_KEY = "00" * 32
HARMS = [
    (f"UPDATE series SET secret = '{OTHER_KEY}'", {"commitment", "seed", "digest"}),
    (
        "UPDATE series SET protocol = replace(protocol, '13', '14')",
        {"protocol_hash", "config_hash", "digest"},
    ),
    ("UPDATE series SET protocol = 'null'", {"protocol or secret", "digest"}),
    ("UPDATE series SET closed_ms = 1", {"start of a daily attempt", "digest"}),
    ("UPDATE series_episodes SET player_id = 'bob'", {"player of a daily attempt", "digest"}),
    ("DELETE FROM series_episodes", {"digest", "a player's sums", "its configuration"}),
    ("UPDATE episodes SET seed_chosen = 1", {"seed_chosen, assisted", "digest"}),
    ("DELETE FROM series", {"keys", "digest"}),
]


@pytest.mark.parametrize(("harm", "expected"), HARMS)
def test_an_attempt_that_is_not_of_its_days_terrain_is_found(store, harm, expected):
    play_daily(store)
    store.add_player("bob", 1)
    alter(store.path, "PRAGMA foreign_keys = OFF", harm)
    findings = verify_database(store.path).findings
    named = {
        next((name for name in ("digest", "seed of") if name in finding.what), finding.what)
        for finding in findings
    }
    assert {name.removesuffix(" of") for name in named} == expected


def test_attempts_of_two_servers_are_merged_with_their_keys(tmp_path):
    for name, player in (("a.db", "ada"), ("b.db", "bob")):
        with closing(Store(tmp_path / name)) as store:
            play_daily(store, player)
    counts, _ = merge([tmp_path / "a.db", tmp_path / "b.db", tmp_path / "a.db"], tmp_path / "c.db")
    assert (counts.added["series_episodes"], counts.equal["series_episodes"]) == (2, 1)
    with closing(Store(tmp_path / "c.db")) as store:
        assert len(store.query("SELECT name FROM series")) == 2
    assert verify_database(tmp_path / "c.db").findings == ()
    alter(tmp_path / "b.db", "DELETE FROM series_episodes")
    with pytest.raises(MergeError, match="has other rows"):
        merge([tmp_path / "c.db", tmp_path / "b.db"], tmp_path / "d.db")


def test_whoever_is_forgotten_leaves_no_attempt(tmp_path):
    study = freeze(tmp_path / "studies")
    people = play_study(tmp_path / "play.db", study, ("human", "human"))
    with closing(StudyRecorder(tmp_path / "play.db", study)) as recorder:
        (player,) = recorder.conn.execute(
            "SELECT player_id FROM participants WHERE id = ?", [people[0]]
        ).fetchone()
        mine, theirs = play_daily(recorder.store, player), play_daily(recorder.store, "bob")
        assert mine.config != CONFIG
    assert forget(tmp_path / "play.db", people[0]).episodes == 7
    with closing(Store(tmp_path / "play.db")) as store:
        left = store.query("SELECT episode_id FROM series_episodes WHERE player_id IS NOT NULL")
        assert left == [{"episode_id": theirs.id}]
        assert terrain_on(store, DAY) is not None
    assert verify_database(tmp_path / "play.db").findings == ()
