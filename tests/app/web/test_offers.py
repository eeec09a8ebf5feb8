"""Several environments on one server, each with a database of its own."""

from humanplay.study.verification import verify_database
from tests.support.study import freeze

LAKE, CLIFF = "gymnasium:FrozenLake-v1", "gymnasium:CliffWalking-v1"
CLIFFS, PASSWORD = "/play/cliffwalking-v1", "correct horse battery"


def check_that_limits_are_shared(server):
    """In all environments together, two boards may begin and five passwords be tried."""
    page = server.page()
    begun = [page.post(f"{at}/api/sessions", json={}) for at in ("", CLIFFS, "", CLIFFS)]
    assert [answer.status_code for answer in begun] == [201, 201, 429, 429]
    login = {"password": "none of theirs"}
    tried = [page.post(f"{at}/api/admin/login", json=login) for at in (*5 * (CLIFFS,), "")]
    assert [answer.status_code for answer in tried] == [*5 * (401,), 429]


def test_each_environment_is_played_recorded_and_gone_on_with_by_itself(spawn, tmp_path):
    server = spawn(task=LAKE, more=(CLIFF, "mars"))
    person = server.page()
    listed = person.get("/play").text
    assert all(
        f'href="{address}"' in listed
        for address in ("./", "play/cliffwalking-v1/", "play/marsexplorer/")
    )
    begun = {}
    for at, title in (
        ("", "FrozenLake-v1"),
        ("/play/cliffwalking-v1", "CliffWalking-v1"),
        ("/play/marsexplorer", "MarsExplorer"),
    ):
        page = person.get(f"{at}/")
        assert page.status_code == 200
        assert person.get(f"{at}/static/000000000000/play/main.js").status_code == 200
        answer = person.post(f"{at}/api/sessions", json={})
        assert answer.status_code == 201, answer.text
        begun[at] = answer.json()
        assert begun[at]["task"]["title"] == title
    for at, board in begun.items():
        present = person.get(f"{at}/api/me/session").json()
        assert present["session"] == board["session"], "no board takes another's cookie"
        assert server.client().get(f"{at}/api/sessions/{board['session']}").status_code == 404
    action = begun["/play/cliffwalking-v1"]["task"]["actions"][0]
    with server.socket(
        begun["/play/cliffwalking-v1"]["session"], person, path="/play/cliffwalking-v1/ws/sessions/"
    ) as socket:
        socket.act(socket.receive("frame"), action)
        frame = socket.frame_after(0)
    for name, leads in (("frozenlake-v1", "../"), ("marsexplorer", "marsexplorer/")):
        assert person.get(f"/play/{name}").headers["location"] == leads
    assert "/play lists them" in person.get("/play/nowhere").text
    assert "../../" in person.get("/play/marsexplorer/play").text
    server.kill()
    few = {"sessions_per_address": "2+0.001/s"}
    again = spawn(task=LAKE, more=(CLIFF,), limits=few, admin_password=PASSWORD)
    person = again.page(cookies=person.cookies)
    assert person.get(f"{CLIFFS}/api/me/session").json()["frame"] == frame
    check_that_limits_are_shared(again)
    again.kill()
    for name in ("playground.db", "playground-cliffwalking-v1.db", "playground-marsexplorer.db"):
        assert verify_database(tmp_path / name).findings == (), name


def test_a_link_to_a_study_leads_to_the_environment_whose_database_has_it(spawn, tmp_path):
    freeze(tmp_path / "playground-marsexplorer.db-studies", "dunes")
    server = spawn(task=LAKE, more=("mars",))
    person = server.page()
    leads = person.get("/study/dunes?PROLIFIC_PID=a").headers["location"]
    assert leads == "../play/marsexplorer/study/dunes?PROLIFIC_PID=a"
    assert person.get("/play/marsexplorer/study/dunes").status_code == 200
    assert person.get("/play/marsexplorer/api/studies/dunes").json()["status"] == "open"
    assert person.get("/api/studies/dunes").status_code == 404
