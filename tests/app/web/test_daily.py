"""The daily terrain over HTTP: one attempt, and nothing of it before its time."""

import asyncio
import re
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.board.lobby import Lobby
from humanplay.board.ranked import PageBoards
from humanplay.board.session import Move
from humanplay.board.sources import Sources
from humanplay.db.reader import utc_day
from humanplay.db.series import attempts_of
from humanplay.db.store import DAY_MS, Store
from humanplay.results.daily import DailyBoards, DailyPlayedError
from humanplay.study.days import day_start_ms, terrain_on
from humanplay.study.verification import verify_database
from humanplay.tasks.mars.boards import MarsBoards
from humanplay.tasks.mars.messages import NewSession
from humanplay.tasks.mars.policies import PolicyCatalogue
from humanplay.tasks.mars.task import Mars
from marsexplorer.config import EnvConfig
from marsexplorer.episode import unpack_terrain
from tests.support.previews import picture_of, tags
from tests.support.servers import eventually

DOCUMENT = Path(__file__).parents[3] / "docs" / "daily.md"
HALF_AN_HOUR_MS = 31 * 60_000
SMALL = EnvConfig.of("random", (7, 9))


@pytest.fixture
def small(monkeypatch):
    """Daily terrains of 7x9 cells, so that an attempt takes ten moves."""
    monkeypatch.setattr(MarsBoards, "daily", SMALL)


def at_noon(server):
    """Set a server's clock to noon (UTC) tomorrow, so that no test runs into midnight."""
    tomorrow = day_start_ms(utc_day(server.clock.now_ms())) + DAY_MS
    server.clock.skipped_ms += tomorrow + DAY_MS // 2 - server.clock.now_ms()
    return server


def begin(page, status=(200, 201)):
    answer = page.post("/api/daily")
    assert answer.status_code in status, answer.text
    return answer.json()


def told(client, about, terrain, is_own=False):
    """Ask every route about an episode, and return what reveals it or its terrain.

    Its own player may learn of the episode.
    """
    episode, seed = about["frame"]["episode"], terrain.seed
    tables = ["episodes.csv", "steps.csv"]
    exports = [f"/api/{whose}export/{table}" for whose in ("", "me/") for table in tables]
    of_episode = ("", "/costs", "/replay", "/ghost?policy=frontier-cost")
    routes = [
        "/", "/docs", "/daily", f"/daily/{terrain.day}", "/api/daily", f"/api/daily/{terrain.day}",
        f"/api/daily/{terrain.day}/results", "/api/episodes",
        "/api/me/history", "/api/me/session", "/api/human-level", "/api/leaderboard", "/api/health",
        *(f"/api/episodes/{episode}{more}" for more in of_episode), f"/api/watch/{episode}", f"/watch/{episode}",
        *(f"/replay/{episode}{form}" for form in ("", ".html", ".gif", ".png")),
        f"/api/me/session?episode={episode}",
        *(f"/api/sessions/{about['session']}{more}" for more in ("", "/about", "/history")), f"/viewer/{about['session']}/",
        *exports,
    ]  # fmt: skip
    secrets = {
        "seed": str(seed), "key": terrain.series.secret, "terrain": about["terrain"],
        "day": "" if is_own else f'"daily":"{terrain.day}"',
    }  # fmt: skip
    ids, leaks = rf'"(?:episode|session)": ?"({episode}|{about["session"]})', []
    for route in routes:
        text = client.get(route).text
        for asked in (route, episode + "' ", repr(about["session"])):
            text = text.replace(asked, "")
        leaks += [(route, name) for name, secret in secrets.items() if secret and secret in text]
        leaks += [] if is_own else [(route, ident) for ident in re.findall(ids, text)]
    return leaks


def test_a_daily_episode_is_its_players_alone_until_the_day_is_over(server, small):
    page, other = at_noon(server).page(), server.page()
    about = begin(page)
    day, services = about["daily"], server.services
    terrain = terrain_on(services.store, day)
    about["terrain"] = services.store.find_episode(about["frame"]["episode"]).episode.terrain.hex()
    assert (about["counts"], about["size"], day) == (False, [7, 9], utc_day(server.clock.now_ms()))
    assert page.get("/api/daily").json()["attempt"]["state"] == "open"
    assert page.get(f"/api/daily/{day}/results").status_code == 403
    watcher = f"/ws/watch/{about['frame']['episode']}"
    with server.socket("", other, path=watcher) as socket:
        assert "no episode" in socket.receive("error")["detail"]
    frame = server.explore(page, about["session"])
    assert "played once" in begin(page, (409,))["detail"]
    begin(other)
    with server.socket("", other, path=watcher) as socket:
        assert "no episode" in socket.receive("error")["detail"]
    for client in (server.client(), other):
        assert told(client, about, terrain) == []
        refused = client.get(f"/api/daily/{day}/results")
        assert (refused.status_code, "your own attempt" in refused.text) == (403, True)
    assert told(page, about, terrain, is_own=True) == []
    beside = {"player": "frontier-cost", "replays": about["session"]}
    assert page.post("/api/sessions", json=beside).status_code == 422
    watched = page.get(f"/api/watch/{frame['episode']}")
    assert (watched.status_code, watched.json()["frame"]["step"]) == (200, frame["step"])
    assert page.get(f"/watch/{frame['episode']}", follow_redirects=False).status_code == 200
    assert "terrain" not in page.get("/api/me/session").text
    shown = page.get(f"/api/daily/{day}/results").json()
    moves = frame["step"]
    mine = {"outcome": "explored", "moves": moves, "coverage": frame["coverage"]}
    assert shown["people"]["you"] == {**mine, "you": True, "rank": 1}
    assert (shown["people"]["moves"], shown["people"]["unfinished"]) == ([[moves, 1]], 0)

    def done():
        policies = page.get(f"/api/daily/{day}/results").json()["policies"]
        return [policy for policy in policies if policy["moves"]]

    assert eventually(done)[0]["coverage"] > 0.98
    (own_row,) = page.get("/api/me/history").json()["episodes"]
    assert (own_row["kind"], own_row["day"], own_row["moves"]) == ("daily", day, moves)
    theirs = server.client().get("/api/me/history").json()
    assert theirs == {"total": 0, "episodes": [], "bests": [], "comparing": 0}
    assert page.get("/api/me/export/episodes.csv").text.count(frame["episode"]) == 0
    assert server.client().get("/api/me/export/episodes.csv").status_code == 404

    server.clock.skipped_ms += DAY_MS
    stranger, tomorrow = server.client(), utc_day(server.clock.now_ms())
    episode = stranger.get(f"/api/episodes/{frame['episode']}").json()
    assert (episode["daily"], episode["counts"], episode["attestation"]) == (day, False, "attested")
    assert page.get("/api/me/export/episodes.csv").text.count(frame["episode"]) == 1
    assert frame["episode"] in stranger.get("/api/export/episodes.csv").text
    assert frame["episode"] not in stranger.get("/api/export/episodes.csv?who=human").text
    assert stranger.get("/api/human-level").json()["figures"] == []
    revealed = stranger.get(f"/api/daily/{day}").json()
    series = terrain.series
    opened = {"key": series.secret, "seed": episode["seed"], "commitment": series.commitment}
    assert opened.items() <= revealed.items()
    assert stranger.get("/api/daily").json()["yesterday"] == revealed
    table = stranger.get(f"/api/daily/{day}/results").json()["people"]["table"]
    assert table[0]["episode"] == frame["episode"]
    past = stranger.get(f"/daily/{day}")
    preview = tags(past)
    assert f"<title>{preview['og:title']} · " in past.text
    assert preview["og:image"] == f"{server.url}/replay/{frame['episode']}.png"
    assert preview["og:description"] == f"1 person, the best with {moves} moves."
    assert preview["og:image:alt"] == "The best route"
    assert picture_of(stranger, preview, server.url) == (1200, 630)
    assert "task/mars/preview.png" in tags(stranger.get(f"/daily/{tomorrow}"))["og:image"]
    for other_day in ("2020-01-01", utc_day(server.clock.now_ms() + DAY_MS), "today"):
        assert stranger.get(f"/daily/{other_day}").status_code in (404, 422)
    assert begin(page)["daily"] == tomorrow
    assert page.get("/api/daily").json()["streak"] == 1
    assert stranger.get("/api/daily/2020-01-01").status_code == 404
    assert verify_database(services.store.path).findings == ()


def test_the_link_of_a_day_that_nobody_finished_shows_no_best_route(server, small):
    page = at_noon(server).page()
    about = begin(page)
    with server.socket(about["session"], page) as socket:
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            socket.act(frame, "north", input="key")
            frame = socket.frame_after(frame["step"])
    server.clock.skipped_ms += DAY_MS
    preview = tags(server.client().get(f"/daily/{about['daily']}"))
    assert preview["og:image"] == f"{server.url}/replay/{frame['episode']}.png"
    assert preview["og:description"] == "1 person, and nobody finished."
    assert preview["og:image:alt"] == "The route of who came furthest"


def test_a_day_names_the_nearest_days_that_have_a_terrain(server):
    client, opened = at_noon(server).client(), []
    for later in (0, 3, 1):
        server.clock.skipped_ms += later * DAY_MS
        opened.append(client.get("/api/daily").json()["day"])
    beside = [client.get(f"/api/daily/{day}").json() for day in opened]
    assert [day["older"] for day in beside] == [None, *opened[:2]]
    assert [day["newer"] for day in beside] == [*opened[1:], None]
    today = client.get("/api/daily").json()
    assert (today["older"], today["newer"], today["yesterday"]) == (opened[1], None, beside[1])


def test_nobody_can_practise_todays_terrain_by_its_seed(server, small):
    page, script = at_noon(server).page(), server.client()
    seed = server.on_loop(server.services.daily_boards.today()).seed
    about = begin(page)
    for client in (page, script, server.page()):
        for body in ({}, {"player": "frontier-cost"}, {"rival": "frontier-cost"}):
            refused = client.post("/api/sessions", json=body | {"seed": seed, "size": [7, 9]})
            assert (refused.status_code, "today's daily terrain" in refused.text) == (422, True)
        board = client.post("/api/sessions", json={"size": [7, 9]}).json()["session"]
        again = client.post(f"/api/sessions/{board}/episodes", json={"seed": seed})
        assert again.status_code == 422
        assert client.post("/api/sessions", json={"seed": seed, "size": [9, 7]}).status_code == 201
    assert page.post(f"/api/sessions/{about['session']}/episodes", json={}).status_code == 409
    assert script.post("/api/daily").status_code == 403


def test_a_reload_a_second_tab_and_a_restart_go_on_with_the_attempt(serve, small):
    first = at_noon(serve())
    page = first.page()
    about = begin(page, (201,))
    with first.socket(about["session"], page) as socket:
        frame = socket.receive("frame")
        socket.act(frame, "south" if frame["grid"][1][0] == "." else "east", input="key")
        step = socket.frame_after(0)["step"]
    assert begin(page, (200,))["frame"]["step"] == step
    first.stop()
    second = at_noon(serve())
    page = second.client(headers={"Origin": second.url}, cookies=dict(page.cookies))
    again = begin(page, (200,))
    assert (again["frame"]["episode"], again["frame"]["step"]) == (about["frame"]["episode"], step)


def test_other_boards_leave_an_attempt_alone_and_half_an_hour_without_a_move_abandons_it(
    tmp_path, small
):
    now = [day_start_ms("2026-11-22") + DAY_MS // 2]

    async def scenario(store):
        lobby = Lobby(store, Mars(PolicyCatalogue()), Sources(clock_ms=lambda: now[0]), 600.0)
        daily, boards = DailyBoards(lobby), PageBoards(lobby, abandon_after_s=1800)
        mine, still = await daily.begin("me"), (await daily.begin("still"))[0]
        ranked, was_open = await boards.begin(NewSession(size=(7, 9)), "me")
        assert (was_open, ranked is mine[0]) == (False, False)
        assert await boards.newest("me") is ranked
        assert await boards.with_id("me", mine[0].id) is None
        away = next(a for a in range(4) if _stays(mine[0].current, a))
        await mine[0].act(Move(mine[0].current.id, 0, away, "human"))
        await boards.begin(NewSession(size=(7, 9), seed=7), "me")
        assert not mine[0].shown.ended
        now[0] += HALF_AN_HOUR_MS
        await boards.abandon_left()
        assert (mine[0].shown.outcome, still.shown.ended) == ("abandoned", False)
        with pytest.raises(DailyPlayedError, match="played once"):
            await daily.begin("me")
        lobby.close()

    with closing(Store(tmp_path / "play.db")) as store:
        asyncio.run(scenario(store))
        assert [attempt.outcome for attempt in attempts_of(store, "me")] == ["abandoned"]


def _stays(played, action):
    """Whether a first move leads neither off the grid nor into a rock."""
    row = played.start[0] + (action == 2) - (action == 0)
    col = played.start[1] + (action == 1) - (action == 3)
    terrain = unpack_terrain(played.terrain, played.config)
    return 0 <= row < 7 and 0 <= col < 9 and not terrain[row, col]


def test_the_recipe_in_the_documents_draws_the_terrain_that_was_played(server):
    about = begin(at_noon(server).page())
    terrain = terrain_on(server.services.store, about["daily"])
    (recipe,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S)
    names = {
        "key": terrain.series.secret,
        "commitment": terrain.series.commitment,
        "protocol": terrain.series.protocol,
    }
    exec(recipe, names)
    played = server.services.store.find_episode(about["frame"]["episode"]).episode
    assert (names["seed"], played.config) == (played.seed, EnvConfig.of("random", 21))
    assert (names["terrain"] == unpack_terrain(played.terrain, played.config)).all()


def test_a_complete_episode_in_a_cave_is_all_of_what_can_be_discovered(serve, monkeypatch):
    monkeypatch.setattr(MarsBoards, "daily", EnvConfig.of("cave", (9, 12)))
    server = at_noon(serve())
    page = server.page()
    frame = server.explore(page, begin(page)["session"])
    assert frame["outcome"] == "explored"
    assert frame["cells"] < 9 * 12
    answer = page.get(f"/api/daily/{utc_day(server.clock.now_ms())}/results").json()
    assert answer["attempt"]["coverage"] == frame["coverage"] >= 0.99
    assert [row["coverage"] for row in answer["people"]["table"]] == [frame["coverage"]]
