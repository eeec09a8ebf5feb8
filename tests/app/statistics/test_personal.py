"""A player's own list, bests and place among the volunteers."""

from contextlib import closing

import pytest

from humanplay.db.export import export_table
from humanplay.db.reader import Reader
from humanplay.db.trial import Trial
from humanplay.web.results import describe_own, personal_bests
from marsexplorer.config import EnvConfig
from tests.support.recorded import play
from tests.support.recorded_daily import DAY, play_daily

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)


def test_a_ranked_episode_that_does_not_count_is_ranked_all_the_same(store):
    attested = play(store, 1, "ada", explore=True, config=CONFIG)
    again = play(store, 1, "ada", explore=True, config=CONFIG, terrain_met_before=True)
    chosen = play(store, 2, "ada", explore=True, config=CONFIG, seed_chosen=True)
    with closing(Reader.open(store.path, public=True)) as reader:
        shown = {row.id: describe_own(row) for row in reader.played_by("ada")}
    episodes = [shown[row.id] for row in (attested, again, chosen)]
    assert [(episode["kind"], episode["counts"]) for episode in episodes] == [
        ("ranked", True), ("ranked", False), ("practice", False)
    ]  # fmt: skip
    assert [episode["met_before"] for episode in episodes] == [False, True, False]


def read(store, player, limit, after):
    """A page of a player's episodes, and how many rows were read for it and the bests."""
    trials, of = [], Trial.of
    with (
        closing(Reader.open(store.path, public=True)) as reader,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(Trial, "of", lambda row: trials.append(row) or of(row))
        page = reader.played_by(player, limit, after)
        personal_bests(reader, player)
    return page, len(trials)


def test_bests_are_of_terrains_that_were_new_and_driven_by_hand_and_the_place_is_among_peoples_means(
    store,
):
    for player in ("ada", "bob", "cy"):
        for seed in range(5 if player != "bob" else 4):
            play(store, seed + 10 * ord(player[0]), player, explore=player != "cy", config=CONFIG)
    mine = [play(store, seed, "ada", explore=True, config=CONFIG, **rest) for seed, rest in (
        (7, {"seed_chosen": True}), (8, {"assisted": True}), (9, {"driver": "script"})
    )]  # fmt: skip
    daily = play_daily(store, "ada")
    with closing(Reader.open(store.path, public=True)) as reader:
        rows, others = reader.played_by("ada"), reader.played_by("bob")
        (best,) = personal_bests(reader, "ada")
        (bobs,) = personal_bests(reader, "bob")
        counted = {row["id"]: row["steps"] for row in reader.finished("human")}
    assert {row.id for row in rows} > {row.id for row in mine}
    assert [describe_own(row)["kind"] for row in rows if row.id == daily.id] == ["daily"]
    assert describe_own(next(row for row in rows if row.id == daily.id))["day"] == DAY
    assert not {"seed", "terrain", "owner_id"} & describe_own(rows[0]).keys()
    fresh = [
        row.steps
        for row in rows
        if row.driver == "human" and not row.seed_chosen and row.outcome == "explored"
    ]
    assert (best["episodes"], best["successes"], best["best"]["moves"]) == (9, 8, min(fresh))
    steps = [row.steps for row in rows if row.id in counted]
    assert (best["people"]["ranked"], best["people"]["you"]) == (5, round(sum(steps) / 5, 1))
    # bob has four, which make no mean
    assert (bobs["people"]["you"], bobs["people"]["ranked"], bobs["people"]["missing"]) == (
        None,
        4,
        1,
    )
    assert best["people"]["means"] == sorted([best["people"]["you"], float(CONFIG.limit)])
    pages = [read(store, "ada", 4, after) for after in (None, rows[3].id, rows[7].id)]
    assert [episode.id for page, _ in pages for episode in page] == [episode.id for episode in rows]
    assert [count for _, count in pages] == [4 + 1, 4 + 1, 1 + 1], "a page, and the best"
    text = b"".join(export_table(store, "episodes", public=True, player="ada")).decode()
    assert all(row.id in text for row in rows)
    assert not any(row.id in text for row in others)
