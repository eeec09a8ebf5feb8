"""The playground behind nginx: TLS and a path prefix, every socket included."""

from tests.support.browser import AS_A_PERSON, fetched, free_port
from tests.support.nginx import PREFIXED
from tests.support.servers import eventually


def test_playing_behind_tls_and_a_path_prefix(serve, player, nginx):
    server, port = serve(trusted_proxies=["127.0.0.1"]), free_port()
    nginx(PREFIXED.format(folder="{folder}", port=port, upstream=server.port))
    page = f"https://localhost:{port}/mars"
    me = player(page, AS_A_PERSON, 1010, 540, ignore_https_errors=True)
    sockets = []
    me.page.on("websocket", lambda socket: sockets.append(socket))
    about = me.begin(size=[9, 12], seed=3)
    me.page.frame_locator("[data-testid=viewer-player]").locator("canvas").first.wait_for()

    def is_open():
        me.page.evaluate("() => 1")  # Playwright tells of sockets only while it is asked something
        return [
            socket for socket in sockets if "/mars/viewer/" in socket.url and not socket.is_closed()
        ]

    eventually(is_open)
    view = me.still("stage-player")
    me.press("east")
    me.changes("stage-player", view)
    assert me.state()["position"] == [0, 1]
    assert all(socket.url.startswith("wss://localhost") for socket in sockets)
    cookies = me.page.context.cookies()
    assert cookies
    assert all(cookie["secure"] and cookie["httpOnly"] for cookie in cookies)
    frame = fetched(me.page, f"{me.url}/api/sessions/{about['session']}").json()
    assert frame["step"] == 1
    assert me.errors == []
