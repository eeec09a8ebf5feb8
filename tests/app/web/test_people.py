"""Names and ratings: chosen by oneself, following from what was played, and no part of a study or a human figure."""

import asyncio
import io
import sqlite3
import zipfile
from contextlib import closing

import pytest

from humanplay.db import ratings
from humanplay.db.columns import TABLES
from humanplay.db.database import StoreError, reading
from humanplay.db.erasure import forget_player
from humanplay.db.reader import utc_day
from humanplay.db.store import Store
from humanplay.series.daily import day_before
from humanplay.series.verification import verify_database
from humanplay.web.access import PARTICIPANT_COOKIE, PLAYER_COOKIE
from humanplay.web.people import cleaned, likeness
from tests.support.command import command
from tests.support.recorded import NOW, play
from tests.support.recorded_daily import play_daily
from tests.support.servers import eventually
from tests.support.study import freeze

PEOPLE = ("ada", "bob", "cid")


@pytest.fixture
def played(tmp_path):
    """A database in which Ada explored three ranked terrains, Bob left two, and all three played yesterday's terrain."""
    yesterday = day_before(utc_day(NOW))
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(3):
            play(store, seed, "ada", explore=True)
        for seed in range(2):
            play(store, 10 + seed, "bob")
        for player in PEOPLE:
            play_daily(store, player, yesterday, explore=player != "bob")
    return tmp_path / "playground.db"


def page_of(server, player):
    return server.page(cookies={PLAYER_COOKIE: server.services.player_tokens.sign(player)})


def named(server, player, name):
    return page_of(server, player).put("/api/me/name", json={"name": name})


def all_rated(server, games=6):
    """Wait until the games are rated: five episodes and a day."""
    count = "SELECT count(*) AS n FROM rated_games"
    eventually(lambda: server.services.store.query(count) == [{"n": games}])


def test_people_are_rated_by_what_policies_and_others_need_on_the_same_terrains(serve, played):
    server = serve()
    for player in PEOPLE:
        assert named(server, player, f"{player.title()} 7").status_code == 200
    all_rated(server)
    found = page_of(server, "ada").get("/api/people").json()
    ada, bob, cid = (
        next(each for each in found["people"] if each["name"] == f"{name} 7")
        for name in ("Ada", "Bob", "Cid")
    )
    # the recorded tours are those of frontier-cost: no better than it, and no worse
    assert (ada["games"], ada["days"], ada["beaten"]["frontier-cost"]) == (3, 1, 0)
    assert (bob["games"], bob["beaten"]) == (2, {"frontier-cost": 0, "ppo": 0})
    assert (cid["games"], cid["days"], cid["beaten"]) == (0, 1, {})
    assert ada["rating"] > 1000 > bob["rating"], "to leave is to lose"
    assert [each["rating"] for each in found["people"]] == sorted(
        (each["rating"] for each in found["people"]), reverse=True
    )
    assert (ada["you"], bob["you"]) == (True, False)
    assert found["you"]["rating"] == ada["rating"]
    (kept,) = server.services.store.query("SELECT * FROM ratings WHERE player_id = 'ada'")
    games = "SELECT g.episode_id AS id FROM rated_games g JOIN episodes e ON e.id = g.episode_id ORDER BY g.number"
    first = server.services.store.query(games)[0]["id"]
    page, asked = page_of(server, "ada"), "/api/me/rating?episode="
    told = page.get(asked + first).json()
    assert (told["before"], told["rating"]) == (round(kept["before"]), ada["rating"])
    assert told["before"] != told["rating"]
    assert (told["rated"], page.get(asked + "another").json()["rated"]) == (True, False)
    assert server.client().get(asked + first).json()["rating"] is None, "nobody else's"
    server.close()
    assert verify_database(played).findings == ()
    with closing(sqlite3.connect(played, isolation_level=None)) as conn:
        conn.row_factory = None
        ratings.renew(conn)
        assert list(ratings.differences(conn)) == []
        conn.execute("UPDATE ratings SET mu = mu + 1 WHERE player_id = 'bob'")
        conn.execute("UPDATE ratings SET before = before + 1 WHERE player_id = 'ada'")
    assert [each.where for each in verify_database(played).findings] == ["ratings"] * 2


def test_rating_goes_on_after_errors_and_one_that_nobody_foresaw_is_logged(
    serve, played, monkeypatch, caplog
):
    fails, next_game = [RuntimeError("unforeseen")], ratings.next_game

    def read_or_fail(*given):
        if fails:
            raise fails.pop()
        return next_game(*given)

    def unknown(task):
        raise ValueError(f"no task {task}")

    async def begin_again():
        return asyncio.create_task(server.services.ratings.keep())

    monkeypatch.setattr(ratings, "next_game", read_or_fail)
    server = serve()
    eventually(lambda: "a task beside play has failed" in caplog.text, 5)
    monkeypatch.setattr("humanplay.web.ratings.LOOK_S", 0.01)
    monkeypatch.setattr("humanplay.web.ratings.rules_of", unknown)
    fails.append(sqlite3.OperationalError("disk I/O error"))
    task = server.on_loop(begin_again())
    all_rated(server)
    assert not task.done()
    assert "no game was rated: disk I/O error" in caplog.text
    assert "no task mars" in caplog.text


def test_a_name_is_changed_hidden_and_removed_and_no_two_look_alike(serve, played):
    server = serve(admin=True, admin_password="correct horse battery")
    all_rated(server)

    def shown():
        return [each["name"] for each in server.client().get("/api/people").json()["people"]]

    assert named(server, "ada", "Ada").status_code == 200
    assert named(server, "bob", "АDА").status_code == 422, "of two scripts"
    assert named(server, "bob", "A.d-a").status_code == 409
    assert named(server, "bob", "Bob").json()["name"] == "Bob"
    assert named(server, "ada", "Ada L").status_code == 200
    assert set(shown()) == {"Ada L", "Bob"}
    assert named(server, "dan", "Dan").status_code == 409, "who has played nothing"
    assert server.client().put("/api/me/name", json={"name": "Eve"}).status_code == 403
    operator = server.page()
    hide = {"name": "Bob", "hidden": True}
    assert operator.post("/api/admin/names", json=hide).status_code == 401
    operator.post("/api/admin/login", json={"password": "correct horse battery"})
    assert operator.post("/api/admin/names", json=hide).status_code == 200
    assert shown() == ["Ada L"]
    assert named(server, "bob", "Bobby").json()["hidden"]
    assert shown() == ["Ada L"], "a new name does not bring a hidden one back"
    listed = operator.get("/api/admin/overview").json()["names"]
    assert {each["name"]: each["hidden"] for each in listed} == {"Ada L": False, "Bobby": True}
    assert page_of(server, "ada").delete("/api/me/name").json()["name"] is None
    assert shown() == []


def test_forget_erases_a_player_by_name(played, capsys):
    with closing(Store(played)) as store, store.transaction():
        ratings.set_name(store.connection, "ada", "Lovelace", "lovelace", NOW)
        while (game := ratings.next_game(store, NOW + 1_000_000)) is not None:
            ratings.rate(store.connection, game, {"ppo": 9} if game.episode_id else None)
    assert command(capsys, "forget", "Lovelace", "--player", "--database", str(played), "--yes")[
        ::2
    ] == (0, "")
    assert b"Lovelace" not in played.read_bytes()
    with reading(played) as conn:
        for table, whose in (("sessions", "owner_id"), ("ratings", "player_id")):
            sql = f"SELECT count(*) FROM {table} WHERE {whose} = 'ada'"
            assert conn.execute(sql).fetchone() == (0,), table
    assert verify_database(played).findings == ()
    with pytest.raises(StoreError, match="chose the name"):
        forget_player(played, "Lovelace")


def test_no_name_and_no_rating_reaches_a_study_or_a_human_figure(serve, played, tmp_path):
    for table in ("names", "rated_games", "ratings"):
        for place in ("chain", "export", "bundle", "bundle database", "scores"):
            assert TABLES[table].columns(place) == (), (table, place)
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    assert named(server, "ada", "Lovelace").status_code == 200
    all_rated(server)
    own = page_of(server, "ada")
    own.post("/api/studies/small/join", json={}).raise_for_status()
    told = [
        own.get(f"/api/{each}").content
        for each in ("export/episodes.csv", "export/steps.csv", "human-level", "leaderboard",
                     "studies/small/me", "episodes?limit=50", "me/history")
    ]  # fmt: skip
    archive = zipfile.ZipFile(io.BytesIO(own.get("/api/export/human-scores.zip").content))
    told += [archive.read(each) for each in archive.namelist()]
    assert all(told)
    assert not [each for each in told if b"Lovelace" in each]


def test_who_plays_and_who_takes_part_are_two_people_to_the_server(serve, played, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    own = page_of(server, "ada")
    own.post("/api/studies/small/join", json={}).raise_for_status()
    own.post("/api/sessions", json={"size": 5}).raise_for_status()
    cookies = {each.name: each.value for each in own.cookies.jar}
    assert cookies[PARTICIPANT_COOKIE] != cookies[PLAYER_COOKIE]
    (taking_part,) = server.services.store.query("SELECT * FROM participants")
    for table in TABLES.values():
        held = [name for name, to in table.references().items() if to == ("players", "id")]
        for name in held if table.name != "participants" else ():
            sql = f"SELECT count(*) AS n FROM {table.name} WHERE {name} = ?"
            found = server.services.store.query(sql, [taking_part["player_id"]])
            assert found == [{"n": 0}], (table.name, name)
    # a participant's cookie shows nothing that was played, and a player's no study
    for cookie, path in ((PARTICIPANT_COOKIE, "me/history"), (PLAYER_COOKIE, "studies/small/me")):
        alone = server.page(cookies={cookie: cookies[cookie]})
        answer = alone.get(f"/api/{path}")
        assert answer.status_code == 404 or answer.json()["total"] == 0


@pytest.mark.parametrize(
    "name",
    ["A", "A" * 21, "A\u202eda", "A\nda", "A\x00da", "Zalg\u0353\u0353o\u0353", "7777", "<b>Ada", "f u c k e r", "FUCK3R",
     "5h1tty", "Expert", "0perator", "\u0410da", "dick", "N1GGER", "\U0001f600\U0001f600"],
)  # fmt: skip
def test_a_name_that_offends_or_pretends_is_refused(name):
    with pytest.raises(ValueError, match="name"):
        cleaned(name)


@pytest.mark.parametrize(
    "name", ["Ada", "Zoë O'Neil", "Dickens", "Жанна", "李小龍", "rover_7", "  Ada  L. "]
)
def test_a_name_of_any_script_is_kept_as_it_is_written(name):
    assert cleaned(name) == " ".join(name.split())


@pytest.mark.parametrize("twin", ["ada", "A d a", "Adа", "АDА", "Adä", "4da"])
def test_names_that_a_reader_takes_for_each_other_look_the_same(twin):
    assert likeness(twin) == likeness("Ada")
