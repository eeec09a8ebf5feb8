"""Names: chosen by oneself, and no part of a study or a human score."""

import io
import json
import zipfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import pytest

from humanplay.db import names
from humanplay.db.columns import TABLES
from humanplay.db.database import StoreError, reading
from humanplay.db.erasure import forget_player
from humanplay.db.reader import utc_day
from humanplay.db.store import Store
from humanplay.db.volunteers import RankedRun
from humanplay.jobs import Jobs
from humanplay.results.people import ExpertRuns, PeopleBoard, expert_moves, standings
from humanplay.study.days import day_before
from humanplay.study.verification import verify_database
from humanplay.web.access import PARTICIPANT_COOKIE, PLAYER_COOKIE
from humanplay.web.people import cleaned, likeness
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from tests.support.command import command
from tests.support.recorded import NOW, play
from tests.support.recorded_daily import play_daily
from tests.support.servers import eventually
from tests.support.study import freeze

PEOPLE = ("ada", "bob", "cid")
RANDOM_21 = EnvConfig.of("random", 21)


@pytest.fixture
def played(tmp_path):
    """A database with players of the leaderboard.

    Ada explored five ranked terrains, Bob left five, Cid explored four; all played yesterday's.
    """
    yesterday = day_before(utc_day(NOW))
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(5):
            play(store, seed, "ada", explore=True, config=RANDOM_21)
            play(store, 10 + seed, "bob", config=RANDOM_21)
            if seed:
                play(store, 20 + seed, "cid", explore=True, config=RANDOM_21)
        for player in PEOPLE:
            play_daily(store, player, yesterday, explore=player != "bob")
    return tmp_path / "playground.db"


def page_of(server, player):
    return server.page(cookies={PLAYER_COOKIE: server.services.player_tokens.sign(player)})


def named(server, player, name):
    return page_of(server, player).put("/api/me/name", json={"name": name})


def people(server, player=None, period="all"):
    """The people's board once Expert has driven on all of its terrains."""
    asker = server.client() if player is None else page_of(server, player)

    def compared():
        board = asker.get(f"/api/people?period={period}").json()
        return board if board["comparing"] == 0 else None

    return eventually(compared, 120)


def moves_behind(server, player, seeds):
    """Their moves beyond Expert's own on each terrain, worked out by playing it here."""
    expert = policies.load("ppo")
    behind = []
    for seed in seeds:
        run = play_episode(expert, RANDOM_21, seed)
        sql = "SELECT e.steps FROM episodes e JOIN sessions s ON s.id = e.session_id WHERE s.owner_id = ? AND e.seed = ?"
        (episode,) = server.services.store.query(sql, [player, seed])
        behind.append(min(100, episode["steps"] - len(run.actions)))
    return behind


def test_people_stand_by_the_worse_end_of_their_moves_behind_expert(serve, played):
    server = serve()
    for player in PEOPLE:
        assert named(server, player, f"{player.title()} 7").status_code == 200
    board = people(server, "ada")
    behind = moves_behind(server, "ada", range(5))
    ada, bob = board["people"]
    assert [person["name"] for person in (ada, bob)] == ["Ada 7", "Bob 7"], "Cid has played four"
    assert ada["behind"] == pytest.approx(sum(behind) / 5)
    assert ada["behind"] < ada["worse"] <= 100
    assert (ada["place"], ada["terrains"], ada["you"], bob["you"]) == (1, 5, True, False)
    assert (bob["behind"], bob["worse"]) == (100, 100), "what was left counts a hundred"
    assert board["ranked"] == 2
    figures = {key: ada[key] for key in ("place", "behind", "worse", "terrains")}
    assert board["you"] == {
        "name": "Ada 7",
        "hidden": False,
        "missing": 0,
        "comparing": 0,
        **figures,
    }
    cid = people(server, "cid")["you"]
    assert (cid["place"], cid["terrains"], cid["missing"], cid["worse"]) == (None, 4, 1, None)
    assert people(server)["you"] is None


@pytest.mark.parametrize(("player", "waiting"), [("ada", 3), ("bob", 0)])
def test_a_standing_counts_only_the_players_own_waiting_terrains(tmp_path, player, waiting):
    database = tmp_path / "playground.db"
    with closing(Store(database)) as store:
        for seed in range(3):
            play(store, seed, "ada", config=RANDOM_21)
        play(store, 9, "bob")  # of another size
    with Jobs(1) as jobs:
        board = PeopleBoard(database, jobs).table(player, 0)
    assert board["comparing"] == 3
    assert board["you"]["comparing"] == waiting


def test_a_week_holds_what_ended_in_it(serve, played):
    with closing(Store(played)) as store:
        for seed in range(30, 35):
            play(store, seed, "ada", explore=True, config=RANDOM_21)
        store.connection.execute(
            "UPDATE episodes SET ended_ms = ended_ms - 8 * 86400000 WHERE seed < 30"
        )
        store.connection.commit()
    server = serve()
    assert [person["terrains"] for person in people(server, "ada")["people"]] == [10, 5]
    week = people(server, "ada", "week")
    assert [person["terrains"] for person in week["people"]] == [5], "all of Bob's are older"
    assert people(server, "cid", "week")["you"]["missing"] == 5


def test_whoever_plays_on_as_well_stands_better_than_whoever_stops():
    behind = [0, 12, 30, 4, 9, 100]
    often = [RankedRun("often", seed, 60 + behind[seed % 6], 0) for seed in range(24)]
    stopped = [RankedRun("stopped", seed, 60 + behind[seed], 0) for seed in range(6)]
    lucky = [RankedRun("lucky", seed, 60 + behind[seed] - 9 * (seed == 5), 0) for seed in range(6)]
    left = [RankedRun("left", seed, None, 0) for seed in range(4)]
    table = standings(
        [*left, *stopped, *often, *lucky], dict[int, int | None].fromkeys(range(24), 60)
    )
    assert [person.player_id for person in table] == ["often", "lucky", "stopped", "left"]
    assert table[0].behind == pytest.approx(table[2].behind)
    assert table[3] == ("left", 4, 100.0, None)


def test_experts_runs_are_kept_beside_the_database(serve, played):
    server = serve()
    people(server)
    path = played.with_name(f"{played.name}-expert.jsonl")
    seeds = [json.loads(line)[1] for line in path.read_text().splitlines()]
    assert sorted(seeds) == [*range(5), *range(10, 15), *range(21, 25)]
    path.write_text(path.read_text() + '["half a li')
    restarted = PeopleBoard(played, server.services.jobs)
    assert restarted.table(None, 0)["comparing"] == 0


def test_a_terrain_that_expert_does_not_finish_counts_for_nobody(serve, played):
    server = serve()
    people(server)
    path = played.with_name(f"{played.name}-expert.jsonl")
    runs = [json.loads(line) for line in path.read_text().splitlines()]
    unfinished = [[key, seed, moves if seed not in (3, 12) else None] for key, seed, moves in runs]
    path.write_text("".join(f"{json.dumps(run)}\n" for run in unfinished))
    board = PeopleBoard(played, server.services.jobs).table("ada", 0)
    assert (board["comparing"], board["ranked"]) == (0, 0), "Ada and Bob have four each"
    assert board["you"]["terrains"] == 4
    assert expert_moves("mars", EnvConfig.of("random", 21, max_steps=5), [3]) == [None]


def test_a_terrain_that_expert_fails_on_stops_no_other(tmp_path, caplog):
    with Jobs(1) as jobs:
        runs = ExpertRuns(tmp_path / "expert.jsonl", jobs, RANDOM_21, "mars")

        def played():
            moves = runs.moves()
            runs.play([1, -1, 2])
            return moves if len(moves) == 3 else None

        moves = eventually(played)
    assert moves[-1] is None
    assert moves[1]
    assert moves[2]
    assert len(caplog.records) == 2, "of the batch, and of the terrain"


def test_all_who_ask_at_the_start_see_all_of_experts_runs(serve, played):
    server = serve()
    people(server)
    path = played.with_name(f"{played.name}-expert.jsonl")
    lines = path.read_text()
    key = json.loads(lines.splitlines()[0])[0]
    path.write_text(
        "".join(f"{json.dumps([key, seed, 9])}\n" for seed in range(100, 40_000)) + lines
    )
    restarted = PeopleBoard(played, server.services.jobs)
    with ThreadPoolExecutor(4) as threads:
        tables = [threads.submit(restarted.table, None, 0) for _ in range(4)]
    assert [table.result()["comparing"] for table in tables] == [0] * 4


def test_a_name_is_changed_hidden_and_removed_and_no_two_look_alike(serve, played):
    server = serve(admin=True, admin_password="correct horse battery")

    def shown():
        names = [person["name"] for person in people(server)["people"]]
        return [name for name in names if name]

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
    assert {person["name"]: person["hidden"] for person in listed} == {
        "Ada L": False,
        "Bobby": True,
    }
    assert page_of(server, "ada").delete("/api/me/name").json()["name"] is None
    assert shown() == []


def test_forget_erases_a_player_by_name(played, capsys):
    with closing(Store(played)) as store, store.transaction():
        names.set_name(store.connection, "ada", "Lovelace", "lovelace", NOW)
    assert command(capsys, "forget", "Lovelace", "--player", "--database", str(played), "--yes")[
        ::2
    ] == (0, "")
    assert b"Lovelace" not in played.read_bytes()
    with reading(played) as conn:
        sql = "SELECT count(*) FROM sessions WHERE owner_id = 'ada'"
        assert conn.execute(sql).fetchone() == (0,)
    assert verify_database(played).findings == ()
    with pytest.raises(StoreError, match="chose the name"):
        forget_player(played, "Lovelace")


def test_no_name_reaches_a_study_or_a_human_score(serve, played, tmp_path):
    for place in ("chain", "export", "bundle", "bundle database", "scores"):
        assert TABLES["names"].columns(place) == (), place
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    assert named(server, "ada", "Lovelace").status_code == 200
    page = page_of(server, "ada")
    page.post("/api/studies/small/join", json={}).raise_for_status()
    contents = [
        page.get(f"/api/{route}").content
        for route in ("export/episodes.csv", "export/steps.csv", "human-level", "leaderboard",
                     "studies/small/me", "episodes?limit=50", "me/history")
    ]  # fmt: skip
    archive = zipfile.ZipFile(io.BytesIO(page.get("/api/export/human-scores.zip").content))
    contents += [archive.read(name) for name in archive.namelist()]
    assert all(contents)
    assert not [content for content in contents if b"Lovelace" in content]


def test_who_plays_and_who_takes_part_are_two_people_to_the_server(serve, played, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    page = page_of(server, "ada")
    page.post("/api/studies/small/join", json={}).raise_for_status()
    page.post("/api/sessions", json={"size": 5}).raise_for_status()
    cookies = {sent.name: sent.value for sent in page.cookies.jar}
    assert cookies[PARTICIPANT_COOKIE] != cookies[PLAYER_COOKIE]
    (taking_part,) = server.services.store.query("SELECT * FROM participants")
    for table in TABLES.values():
        held = [name for name, to in table.references().items() if to == ("players", "id")]
        for name in held if table.name != "participants" else ():
            sql = f"SELECT count(*) AS n FROM {table.name} WHERE {name} = ?"
            counted = server.services.store.query(sql, [taking_part["player_id"]])
            assert counted == [{"n": 0}], (table.name, name)
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
