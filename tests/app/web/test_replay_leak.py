"""No replay, file, preview, live view or command tells a terrain too early."""

import pytest

from humanplay.db.reader import now_ms, utc_day
from humanplay.db.store import Store
from humanplay.web.access import PLAYER_COOKIE
from marsexplorer.config import EnvConfig
from tests.support.command import command as run_command
from tests.support.recorded import add_session, add_steps, free_moves, open_episode, play, tour
from tests.support.recorded_daily import play_daily
from tests.support.stored_studies import StudyRecorder, freeze

CONFIG = EnvConfig("random", 9, 13, sensor_radius=3)
FORMS = ("html", "gif", "mp4", "png")
REPLAYS = (
    "/replay/{}", *(f"/replay/{{}}.{form}" for form in FORMS),
    "/api/episodes/{}/replay", "/api/episodes/{}/ghost?policy=frontier-cost",
)  # fmt: skip
WATCHING = ("/watch/{}", "/api/watch/{}")
UNKNOWN = "00000000"


def answers(client, episode, paths):
    """What each path answers about an episode, its id taken out."""
    by_path = {}
    for path in paths:
        answer = client.get(path.format(episode))
        headers = dict(answer.headers)
        for varying in ("date", "content-length", "x-request-id"):
            headers.pop(varying, None)
        by_path[path] = (
            answer.status_code,
            headers,
            answer.content.replace(episode.encode(), b"ID"),
        )
    return by_path


def board_of(server, episode):
    """The id for watching of the board on which an episode was played."""
    return server.services.lobby.watch_ids.of(
        server.services.store.find_episode(episode).session.id
    )


@pytest.fixture
def command(capsys, tmp_path):
    """`command(database, episode)` returns what `humanplay replay` says of one.

    Without its ID, and with the exit code.
    """

    def call(database, episode):
        options = f"--out={tmp_path / 'leak.png'}", "--ghost=none", f"--database={database}"
        code, _, err = run_command(capsys, "replay", episode, *options)
        return code, err.replace(episode, "ID")

    return call


@pytest.fixture
def secret(tmp_path):
    """The IDs of secret episodes by kind, and the study that two of them belong to."""
    path = tmp_path / "playground.db"
    study = freeze(tmp_path / "playground.db-studies", close=False)
    recorder = StudyRecorder(path, study)
    person = recorder.join(0)
    ids = {
        "warm-up": recorder.play(person, "warm_up", 0),
        "ranked in a study": recorder.play(person, "ranked", 0),
        "left in a study": recorder.play(person, "ranked", 1, "abandon"),
    }
    recorder.close()
    store = Store(path)
    store.connection.execute("UPDATE sessions SET control = 'cookie'")
    running, practice = add_session(store, "bob"), add_session(store, "eve")
    for name, session in (("ranked", running), ("practice", practice)):
        row, episode = open_episode(store, session, 6, CONFIG, assisted=name == "practice")
        add_steps(store, row, episode, free_moves(episode)[:2])
        ids[name] = row.id
    rival = add_session(store, None, "frontier-cost", practice)
    row, episode = open_episode(store, rival, 6, CONFIG, driver="policy:frontier-cost")
    add_steps(store, row, episode, tour(episode), "policy:frontier-cost")
    ids["rival"] = row.id
    ids["daily"] = play_daily(store, "ada", utc_day(now_ms()), explore=True).id
    ids["ended"] = play(store, 8, "zoe", config=CONFIG).id  # left after two moves: for everybody
    store.close()
    return ids


def test_what_is_secret_is_answered_as_an_id_that_does_not_exist(serve, tmp_path, secret, command):
    server = serve()
    client, database = server.client(), tmp_path / "playground.db"
    nothing = answers(client, UNKNOWN, (*REPLAYS, *WATCHING))
    assert {status for status, *_ in nothing.values()} == {404}
    no_file = command(database, UNKNOWN)
    assert no_file[0] == 2
    for name in ("warm-up", "ranked in a study", "left in a study", "daily"):
        assert answers(client, secret[name], (*REPLAYS, *WATCHING)) == nothing, name
        board = board_of(server, secret[name])
        assert answers(client, board, WATCHING) == {path: nothing[path] for path in WATCHING}, name
    for name in ("ranked", "practice", "rival"):
        files = {path: nothing[path] for path in REPLAYS[1:]}
        assert answers(client, secret[name], REPLAYS[1:]) == files, name
    for name in set(secret) - {"ended"}:
        assert command(database, secret[name]) == no_file, name
        assert not (tmp_path / "leak.png").exists()

    assert answers(client, secret["rival"], REPLAYS[:1])[REPLAYS[0]] == nothing[REPLAYS[0]]
    for name in ("ranked", "practice"):
        page = client.get(f"/replay/{secret[name]}")
        assert (page.status_code, page.content) == (303, b"")
        assert page.headers["location"] == f"../watch/{secret[name]}"
        live = client.get(f"/watch/{secret[name]}")  # the same page for every episode
        assert live.content == client.get(f"/watch/{secret['practice']}").content
        watched = client.get(f"/api/watch/{secret[name]}").json()
        stored = server.services.store.find_episode(secret[name]).episode
        assert watched["frames"] is None
        seen_cells = sum(cell != "?" for line in watched["frame"]["grid"] for cell in line)
        assert seen_cells == watched["frame"]["discovered"] < CONFIG.n
        assert stored.terrain.hex() not in str(watched)
        assert "seed" not in str(watched)
        board = board_of(server, secret[name])  # its link tells what the episode's tells
        assert client.get(f"/watch/{board}").content == live.content
        assert client.get(f"/api/watch/{board}").json() == watched
        assert answers(client, board, REPLAYS[1:]) == files, name


def test_what_is_public_is_shown_by_each_of_them_and_no_daily_episode_to_its_own_player(
    serve, tmp_path, secret, command
):
    server = serve()
    client = server.client()
    ended = secret["ended"]
    shown = answers(client, ended, REPLAYS)
    assert [status for status, *_ in shown.values()] == [200] * len(REPLAYS)
    assert client.get(f"/watch/{ended}").headers["location"] == f"../replay/{ended}"
    assert command(tmp_path / "playground.db", ended)[0] == 0
    row = server.services.store.find_episode(ended).episode
    for path, (_, headers, content) in shown.items():
        assert row.terrain.hex().encode() not in content, path
        assert b'"seed"' not in content, path
        assert "player" not in str(headers), path
    player = server.client(cookies={PLAYER_COOKIE: server.services.player_tokens.sign("ada")})
    for path in REPLAYS:
        assert player.get(path.format(secret["daily"])).status_code == 404, path
    assert player.get(f"/watch/{secret['daily']}").status_code == 200
