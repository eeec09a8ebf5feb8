"""What chat programs and search engines see of an address."""

from contextlib import closing
from io import BytesIO

from PIL import Image

from humanplay.db.store import Store
from tests.support.previews import picture_of, tags
from tests.support.recorded import add_session, open_episode, play
from tests.support.study import freeze

SITE = "https://mars.example/lab/"
PAGES = ("", "daily", "leaderboard", "about", "study", "study/open")


def test_every_address_that_people_share_has_a_preview_with_a_picture(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", "open", recruitment="open")
    server = serve(public_url=SITE)
    stranger = server.client(headers={"User-Agent": "a chat program"})
    titles = set()
    for path in PAGES:
        page = stranger.get(f"/{path}?utm_source=chat")
        assert (page.status_code, page.headers.get("set-cookie")) == (200, None), path
        preview = tags(page)
        assert preview["og:url"] == SITE + path
        assert f'<link rel="canonical" href="{SITE}{path}">' in page.text
        assert preview["description"] == preview["og:description"] == preview["twitter:description"]
        assert preview["og:image"].startswith(SITE)
        assert preview["twitter:card"] == "summary_large_image"
        assert picture_of(stranger, preview, SITE[:-1]) == (1200, 630)
        titles.add(preview["og:title"])
    assert len(titles) == len(PAGES)
    assert len(server.services.lobby) == 0


def test_a_preview_without_a_picture_is_a_summary(serve):
    stranger = serve(task="gymnasium:FrozenLake-v1").client()
    for path in ("about", "study"):
        preview = tags(stranger.get(f"/{path}"))
        assert preview["twitter:card"] == "summary"
        assert not preview.keys() & {"og:image", "twitter:image"}


def test_a_challenge_shows_the_start_and_what_is_to_be_beaten(serve, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        ended = play(store, 3, explore=True)
        running, _ = open_episode(store, add_session(store), 5)
    stranger = serve(public_url=SITE).client(headers={"User-Agent": "a chat program"})
    preview = tags(stranger.get(f"/challenge/{ended.id}"))
    moves = len(stranger.get(f"/api/episodes/{ended.id}/replay").json()["run"]["actions"])
    assert preview["og:title"] == f"{moves} moves. Beat it."
    assert preview["og:image"] == f"{SITE}challenge/{ended.id}.png"
    assert picture_of(stranger, preview, SITE[:-1]) == (1200, 630)
    start, end = (
        stranger.get(f"/{page}/{ended.id}.png").content for page in ("challenge", "replay")
    )
    assert start != end
    assert stranger.get(f"/challenge/{running.id}.png").status_code == 404


def test_a_stranger_sees_nothing_of_an_episode_that_is_not_to_be_seen(serve):
    server = serve()
    player, stranger = server.page(), server.client()
    running = player.post("/api/sessions", json={"size": [7, 9]}).json()
    today = player.post("/api/daily").json()
    for board in (running, today):
        for form in ("", ".png", ".gif", ".html"):
            answer = stranger.get(
                f"/replay/{board['frame']['episode']}{form}",
                follow_redirects=False,
                headers={} if form else {"Accept": "text/html"},
            )
            assert answer.status_code in (303, 404)
            assert form or answer.status_code == 303 or "<html" in answer.text
            assert "og:image" not in answer.text
            assert "set-cookie" not in answer.headers
    assert "seed" not in str(tags(stranger.get("/daily")))


def test_what_browsers_and_search_engines_ask_for_is_there(server):
    client = server.client()
    icon = client.get("/favicon.ico")
    assert Image.open(BytesIO(icon.content)).format == "ICO"
    assert Image.open(BytesIO(client.get("/apple-touch-icon.png").content)).size == (180, 180)
    robots = client.get("/robots.txt")
    assert (robots.headers["content-type"].split(";")[0], "Disallow: /api/" in robots.text) == (
        "text/plain",
        True,
    )
    assert client.head("/favicon.ico").status_code == 200
