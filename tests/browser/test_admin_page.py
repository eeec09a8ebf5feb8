"""The operator's page and the leaderboard in a real browser, while somebody plays."""

import threading
import zipfile
from contextlib import closing
from pathlib import Path

import pytest

from humanplay.db.store import Store
from humanplay.tasks.mars.boards import FIRST_SEED, MarsBoards
from humanplay.tasks.mars.policies import PolicyCatalogue
from marsexplorer.config import EnvConfig
from tests.support.browser import NO_3D, fetched, judge
from tests.support.recorded import play
from tests.support.servers import eventually
from tests.support.study import Person, freeze

PASSWORD = "red-planet-4"
IDLE_WORK_MS = 600_000
"""Reports and evaluations have the lowest priority: while other jobs run they take their time."""
pytestmark = pytest.mark.timeout(1500)
DEPLOY = Path(__file__).parents[2] / "docs/deploy.md"
COUNT = "[data-testid=stage-{}] td:nth-child(3)"
RED = """async (health) => {
  const { paintHealth } = await import("./static/000000000000/admin/tables.js");
  const list = document.createElement("dl");
  paintHealth(list, health, Date.now());
  return [...list.querySelectorAll("dd[data-tone=warn]")].map((fact) => fact.previousElementSibling.textContent);
}"""
"""Returns the names of what is painted red."""


class QuickPolicies(PolicyCatalogue):
    """The policies on offer without the slow ones.

    An evaluation gets only the time that all else leaves.
    """

    def offers(self):
        return [offer for offer in super().offers() if offer.name not in ("ppo", "lookahead")]


@pytest.fixture
def quick(monkeypatch):
    """Boards of three terrains: the server evaluates in seconds."""
    few = tuple(range(FIRST_SEED, FIRST_SEED + 3))
    monkeypatch.setattr(MarsBoards, "seeds", lambda self, config: few)


def look(page, name):
    """Check a screen at both sizes: no finding of axe, nothing wider than the screen."""
    assert judge(page, name, full_page=True) == []


def until(page, claim):
    page.wait_for_function(f"() => Boolean({claim})", timeout=IDLE_WORK_MS)


def test_the_operator_sees_a_study_from_the_first_participant_to_its_end(
    serve, player, tmp_path, monkeypatch
):
    monkeypatch.setattr("humanplay.web.operator.participants.FRESH_S", 0.5)
    study = freeze(tmp_path / "playground.db-studies", size=(7, 9), title="Dunes of the south")
    server = serve(admin_password=PASSWORD)
    me = player(server, NO_3D)
    page = me.page
    page.goto(f"{server.url}/admin")
    page.get_by_test_id("password").wait_for(state="visible")
    look(page, "admin-login")
    page.get_by_test_id("password").fill("blue-planet-4")
    page.keyboard.press("Enter")
    until(page, "document.getElementById('wrong').textContent.includes('not the operator')")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    until(page, "document.body.dataset.in === 'yes'")
    assert page.get_by_test_id("title").inner_text() == "Dunes of the south"
    assert "nobody of 2 planned" in page.get_by_test_id("summary").inner_text()
    assert "no figure" in page.get_by_test_id("figure").inner_text()
    assert "Recruitment\n0 of 2" in page.get_by_test_id("glance").inner_text()
    assert not page.get_by_test_id("check").is_visible(), "folded"
    page.get_by_test_id("show-health").click()
    assert page.get_by_test_id("check").is_visible()
    page.get_by_test_id("show-outcomes").click()
    page.get_by_test_id("outcomes").get_by_label("Whoever ended the last ranked episode").fill("C1")
    page.get_by_test_id("save-outcomes").click()
    page.get_by_text("9 outcomes have no text yet").wait_for()
    health = page.evaluate("playground.state.overview.health")
    assert page.evaluate(RED, health) == []
    health["disk"]["is_low"] = True
    health["owners"] = [{"kind": "address", "name": "", "bytes": 81, "budget": 100}]
    health["watched"] = {
        "move_p99_seconds": 0.2, "waiting_jobs": 21, "waiting_writes": 0, "backup_age_seconds": 90_000, "backup_failures": 0,
    }  # fmt: skip
    red = page.evaluate(RED, health)
    assert red == [
        "Disk",
        "Stored today, or charged to open boards",
        "Newest backup",
        "Moves",
        "Waiting",
    ]
    assert [name for name in red if f"| {name}: " not in DEPLOY.read_text()] == []

    person = Person(server)
    until(page, f"document.querySelector('{COUNT.format('consent')}').textContent === '1'")
    person.to_warm_up()
    until(page, f"document.querySelector('{COUNT.format('warm_up')}').textContent === '1'")
    assert page.locator(COUNT.format("consent")).inner_text() == "0"
    for width in (390, 820):
        page.set_viewport_size({"width": width, "height": 900})
        fits = "(part) => part.scrollWidth <= part.clientWidth"
        assert page.locator(".people .scroll").evaluate(fits), f"nothing is cut at {width}"
    page.set_viewport_size({"width": 1440, "height": 900})

    person.call("next")
    board = page.get_by_test_id(f"live-{person.where['participant']}")
    go_on = threading.Event()

    def drive():
        with person.socket() as socket:
            frame = socket.receive("frame")
            for action in ("east", "south", "west", "north"):
                socket.act(frame, action, input="key")
                frame = socket.frame_after(frame["step"])
                if frame["outcome"]:
                    break
            go_on.wait(300)

    driving = threading.Thread(target=drive)
    driving.start()
    try:
        board.wait_for(state="visible", timeout=IDLE_WORK_MS)
        shown = f"document.querySelector('[data-testid=live-{person.where['participant']}]')"
        until(page, f"/[1-4] moves/.test({shown}.innerText)")
        assert "Warm-up 1" in board.inner_text()
        assert page.evaluate("() => document.querySelector('.boards canvas').width") > 60
        look(page, "admin-live")
    finally:
        go_on.set()
        driving.join()
    person.me()
    if person.where["about"]["frame"]["outcome"] is None:
        person.play()
    person.play_on()
    until(page, f"document.querySelector('{COUNT.format('debrief')}').textContent === '1'")
    row = page.get_by_test_id(f"person-{person.where['participant']}")
    assert "of 3" not in row.inner_text(), "an open study shows no count of ranked episodes"
    sentence = "No figure is shown until the study is closed: 1 of 2"
    until(page, f"document.getElementById('figure').textContent.startsWith('{sentence}')")
    assert page.locator("#figure .measure").count() == 0
    look(page, "admin-debrief")

    assert page.get_by_test_id("make-report").is_disabled()
    assert page.get_by_test_id("make-release").is_disabled()
    page.get_by_test_id("close").click()
    page.get_by_test_id("typed").fill("smal")
    assert page.get_by_test_id("close-now").is_disabled()
    page.get_by_test_id("typed").fill("small")
    look(page, "admin-confirm")
    page.get_by_test_id("close-now").click()
    until(page, "document.getElementById('status').textContent === 'closed'")
    public = fetched(page, f"{server.url}/api/studies/small").json()
    assert (public["status"], public["secret"]) == ("closed", study.secret.hex())
    assert page.get_by_test_id("make-release").is_enabled()
    page.get_by_test_id("make-report").click()
    link = page.locator("#report a").first
    link.wait_for(state="visible", timeout=IDLE_WORK_MS)
    with page.expect_download() as download:
        link.click()
    assert download.value.suggested_filename == "small-report.html"
    assert "Dunes of the south" in download.value.path().read_text()

    page.get_by_test_id("logout").click()
    page.get_by_test_id("password").wait_for(state="visible")
    assert fetched(page, f"{server.url}/api/admin/overview").status == 401
    assert me.errors == []


def test_a_part_opens_once_for_what_is_wrong_in_it_and_stays_folded_after(serve, player, tmp_path):
    freeze(tmp_path / "playground.db-studies", "dunes")
    (tmp_path / "playground.db-studies/dunes/outcomes.json").write_text("no JSON")
    me = player(serve(admin_password=PASSWORD), NO_3D)
    page = me.page
    page.goto(f"{me.url}/admin#dunes")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    until(page, "document.getElementById('outcomes-part').open")
    page.get_by_test_id("show-outcomes").click()
    for _ in range(2):
        page.wait_for_event("response", lambda answer: "admin/overview" in answer.url)
    page.wait_for_timeout(300)
    assert not page.evaluate("document.getElementById('outcomes-part').open")


def test_a_console_whose_server_is_gone_says_so(serve, player):
    server = serve(admin_password=PASSWORD)
    page = player(server, NO_3D).page
    page.goto(f"{server.url}/admin")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    until(page, "document.body.dataset.in === 'yes'")
    assert "No study yet" in page.get_by_test_id("title").inner_text()
    server.stop()
    until(page, "document.getElementById('link').dataset.link === 'lost'")


def test_payments_are_shown_of_the_study_that_is_looked_at_and_of_none_after_logging_out(
    serve, player, tmp_path
):
    for name in ("dunes", "rocks"):
        freeze(tmp_path / "playground.db-studies", name, title=f"The {name}")
    server = serve(admin_password=PASSWORD)
    Person(server, "dunes").to_tutorial()
    me = player(server, NO_3D)
    page, rows = me.page, me.page.locator("#payments tbody tr")
    page.goto(f"{me.url}/admin#dunes")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    until(page, "document.body.dataset.in === 'yes'")
    page.get_by_test_id("list-payments").click()
    rows.wait_for()
    page.get_by_test_id("study").select_option("rocks")
    page.get_by_role("heading", name="The rocks").wait_for()
    assert rows.count() == 0
    late = []
    page.route("**/api/admin/studies/rocks/payments", lambda route: late.append(route))
    page.get_by_test_id("list-payments").click()
    eventually(lambda: page.wait_for_timeout(50) or late)
    page.get_by_test_id("study").select_option("dunes")
    page.get_by_role("heading", name="The dunes").wait_for()
    with page.expect_response("**/api/admin/studies/rocks/payments"):
        late[0].continue_()
    page.wait_for_timeout(300)
    assert page.locator("#payments-part").is_hidden()
    page.get_by_test_id("list-payments").click()
    rows.wait_for()
    page.locator("#logout").click()
    until(page, "document.body.dataset.in !== 'yes'")
    assert rows.count() == 0


def test_a_late_answer_about_a_study_is_not_shown_in_place_of_the_one_chosen_since(
    serve, player, tmp_path
):
    for name in ("dunes", "rocks"):
        freeze(tmp_path / "playground.db-studies", name, title=f"The {name}")
    me = player(serve(admin_password=PASSWORD), NO_3D)
    page, late = me.page, []
    page.goto(f"{me.url}/admin#dunes")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    until(page, "document.body.dataset.in === 'yes'")
    page.route("**/api/admin/studies/dunes", lambda route: late.append(route))
    eventually(lambda: page.wait_for_timeout(50) or late)
    page.get_by_test_id("study").select_option("rocks")
    page.get_by_role("heading", name="The rocks").wait_for()
    with page.expect_response("**/api/admin/studies/dunes"):
        late[0].continue_()
    page.wait_for_timeout(300)
    assert page.get_by_test_id("title").inner_text() == "The rocks"
    assert page.evaluate("playground.state.chosen") == "rocks"
    assert me.errors == []


def test_a_link_to_a_board_of_the_leaderboard_opens_it_at_every_load(serve, player):
    me = player(serve(policies=QuickPolicies()), NO_3D)
    page = me.page
    page.goto(f"{me.url}/leaderboard#random-84x84&score")
    for _ in range(2):
        until(page, "window.playground?.state.detail")
        assert page.evaluate("playground.state.detail.board.id") == "random-84x84"
        assert page.get_by_test_id("by-score").get_attribute("aria-pressed") == "true"
        assert page.url.endswith("/leaderboard#random-84x84&score")
        page.reload()
    page.goto("about:blank")
    page.goto(f"{me.url}/leaderboard#gone")
    until(page, "window.playground?.state.detail")
    assert page.url.endswith(f"#{page.evaluate('playground.state.boards[0].id')}")
    assert me.errors == []


def test_the_leaderboard_is_honest_when_empty_and_fills_as_people_play(serve, player, quick):
    server = serve(policies=QuickPolicies())
    me = player(server, NO_3D)
    page = me.page
    page.goto(server.url)
    page.get_by_test_id("leaderboard-link").click()
    page.get_by_text("Nobody has 5 ranked terrains in the last seven days").wait_for()
    look(page, "leaderboard-people-empty")
    page.get_by_test_id("view-policies").click()
    until(page, "window.playground && window.playground.state.detail")
    assert page.url.split("#")[0] == f"{server.url}/leaderboard"
    sentence = "Volunteers on this playground, Scattered 21 × 21: nobody has played this ranked yet"
    assert page.get_by_test_id("sentence").inner_text().startswith(sentence)
    assert page.get_by_test_id("rank-people").count() == 0
    page.get_by_test_id("evaluate").click()
    until(page, "window.playground.state.detail.policies.every((policy) => policy.figure)")
    assert page.get_by_test_id("evaluate").is_hidden()
    assert page.get_by_test_id("working").is_hidden()
    look(page, "leaderboard-empty")

    client = server.page()
    server.explore(client, client.post("/api/sessions").json()["session"])
    eventually(lambda: client.get("/api/human-level").json()["figures"])
    page.reload()
    until(page, "window.playground && window.playground.state.detail")
    lacks = (
        "1 player and 1 ranked episode so far, and no mean yet. "
        "It needs 5 players with 5 ranked episodes each: 5 are missing."
    )
    assert lacks in page.get_by_test_id("sentence").inner_text()
    row = page.get_by_test_id("rank-nobody").inner_text()
    assert row.startswith("Volunteers")
    assert lacks in row
    assert page.get_by_test_id("rank-people").count() == 0
    assert me.errors == []


def test_the_leaderboard_shows_people_once_they_are_enough(serve, player, quick, tmp_path):
    with closing(Store(tmp_path / "playground.db")) as store:
        for seed in range(27):
            play(
                store, seed, f"player-{seed // 5}", explore=True, config=EnvConfig.of("random", 21)
            )
    me = player(serve(policies=QuickPolicies()), NO_3D)
    page = me.page
    page.goto(f"{me.url}/leaderboard#random-21x21")
    until(
        page,
        "window.playground && window.playground.state.detail && window.playground.state.detail.people",
    )
    page.get_by_test_id("evaluate").click()
    until(page, "window.playground.state.detail.policies.every((policy) => policy.figure)")
    whole = "from 5 players and 25 episodes; 1 player with fewer episodes is not in it"
    assert whole in page.get_by_test_id("sentence").inner_text()
    people = page.get_by_test_id("rank-people")
    assert people.locator("td").last.inner_text() == "5 players, 25 episodes"
    assert people.locator(".human").count() == 1, "the human level is a line"
    steps = [float(text) for text in page.locator("#ranks tbody td:nth-child(3)").all_inner_texts()]
    assert steps == sorted(steps)
    assert page.locator("#visits canvas").count() == len(steps)
    assert "percent after" in page.get_by_test_id("coverage").get_attribute("aria-label")
    with page.expect_download() as downloading:
        page.get_by_test_id("human-scores").click()
    with zipfile.ZipFile(downloading.value.path()) as bundle:
        files = ["episodes.csv", "steps.csv", "DATASHEET.md", "datapackage.json"]
        assert bundle.namelist() == files
        moves = bundle.read("steps.csv").count(b"\n") - 1
        assert f"27 episodes, {moves:,} moves" in bundle.read("DATASHEET.md").decode()
    page.get_by_test_id("by-score").click()
    texts = page.locator("#ranks tbody td:nth-child(3)").all_inner_texts()
    scores = [float(text.replace("−", "-")) for text in texts]
    assert scores == sorted(scores, reverse=True)
    assert page.url.endswith("&score")
    page.set_viewport_size({"width": 820, "height": 1180})
    assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    look(page, "leaderboard")
    assert me.errors == []
