"""FrozenLake in a real browser.

It is played by keys and buttons on its picture and watched again, also in a study.
"""

import sqlite3
from contextlib import closing

import pytest

from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import Description
from tests.support.browser import AS_A_PERSON, NO_3D, SIZES, fetched, keep_picture, violations
from tests.support.declared import DECLARATIONS
from tests.support.words_of_mars import MARS, words_of_mars

LAKE = "gymnasium:FrozenLake-v1"
STEPS = "[window.playground.state.player.frame.step, window.playground.state.rival?.frame.step]"
PRESS_WHAT_GOES_ON = """() => {
  const seen = [...document.querySelectorAll("button.go")].find((each) => each.checkVisibility());
  const { screen } = window.study ?? {};
  const shown = [...document.querySelectorAll("main [data-screen]")].find((part) => part.checkVisibility());
  const lead = shown?.querySelector(".lead")?.innerText ?? "";
  if (screen !== "debrief") seen?.click();
  return [screen, lead, Boolean(seen)];
}"""


ALL_WORDS = """() => {
  const names = ["aria-label", "title", "alt", "placeholder", "content"];
  const labels = [...document.querySelectorAll("*")].flatMap((part) => names.map((name) => part.getAttribute(name) ?? ""));
  const page = document.documentElement.cloneNode(true);
  for (const part of page.querySelectorAll("script, style")) part.remove();
  return [...page.textContent.split("\\n"), ...labels];
}"""
"""What a page says, hidden parts, dialogs and labels among it."""


@pytest.fixture
def lake(serve):
    return serve(task=LAKE)


def test_an_environment_is_played_by_its_keys_on_its_picture_and_watched_again(lake, player):
    me = player(lake, [*NO_3D, *AS_A_PERSON]).goto()
    page = me.page
    shown = page.get_by_test_id("picture").first
    assert shown.get_attribute("alt") == "You: running after 0 moves"
    assert page.get_by_test_id("goal").inner_text().startswith("Walk to the flag")
    me.hand.press(page.keyboard, "ArrowDown")
    me.wait("window.playground.state.player.frame.step === 1")
    page.evaluate("document.body.dataset.pad = 'true'")
    page.get_by_test_id("pad-left").click()
    me.wait("window.playground.state.player.frame.step === 2")
    for width, height in ((1440, 900), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(300)
        box = shown.bounding_box()
        assert box["width"] == box["height"] >= 160
        assert page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    assert violations(page) == []
    assert words_of_mars(page.locator("body").inner_text()) == []
    while not (frame := me.state())["outcome"]:
        me.hand.press(page.keyboard, ("ArrowRight", "ArrowDown")[frame["step"] % 2])
        me.wait(f"window.playground.state.player.frame.step > {frame['step']}")
    page.get_by_test_id("end-card").wait_for()
    title = page.get_by_test_id("end-title").inner_text()
    assert page.get_by_test_id("next").inner_text().startswith("Next round")
    assert title == f"{frame['outcome'].capitalize()} after {frame['step']} moves"
    assert page.get_by_test_id("coverage-player").inner_text() == f"{frame['headline']:g}"
    stored = fetched(page, f"{lake.url}/api/episodes/{frame['episode']}").json()
    assert (stored["attestation"], stored["task"]) == ("attested", LAKE)
    assert {move["input"] for move in stored["moves"]} == {"key", "touch"}
    page.goto(f"{lake.url}/replay/{frame['episode']}")
    page.get_by_test_id("picture").first.wait_for()
    page.get_by_test_id("to-end").click()
    page.wait_for_function("window.replay.step === window.replay.playback.last")
    assert page.get_by_text(title.partition(" ")[0].lower()).count()
    assert me.errors == []


def test_no_page_speaks_of_another_environment(lake, player):
    me = player(lake, [*NO_3D, *AS_A_PERSON]).goto()
    page = me.page
    me.hand.press(page.keyboard, "ArrowDown")
    me.wait("window.playground.state.player.frame.step === 1")
    watched = f"watch/{me.state('player.frame.episode')}"
    spoken = {}
    for path in ("", "me", "study", "about", "play", "admin", watched):
        page.goto(f"{lake.url}/{path}")
        page.wait_for_load_state("networkidle")
        spoken[path] = [line for line in page.evaluate(ALL_WORDS) if MARS.search(line)]
    assert {path: lines for path, lines in spoken.items() if lines} == {}
    for path in ("daily", "leaderboard"):
        assert fetched(page, f"{lake.url}/{path}").status == 404


def test_policies_play_beside_a_person_after_a_ranked_episode_and_by_themselves(lake, player):
    me = player(lake, [*NO_3D, *AS_A_PERSON]).goto()
    page = me.page
    assert page.evaluate("window.playground.state.mode") == "ranked"
    while not (frame := me.state())["outcome"]:
        me.hand.press(page.keyboard, ("ArrowRight", "ArrowDown")[frame["step"] % 2])
        me.wait(f"window.playground.state.player.frame.step > {frame['step']}")
    me.wait(
        "window.playground.state.rival?.isReplay && window.playground.state.rival.frame.step > 0"
    )
    page.get_by_test_id("mode-practice").click()
    me.wait(
        "window.playground.state.mode === 'practice' && window.playground.state.rival?.frame.step === 0"
    )
    me.hand.press(page.keyboard, "ArrowLeft")
    me.wait(f"String({STEPS}) === '1,1'")
    page.get_by_test_id("mode-watch").click()
    page.get_by_test_id("leave-episode").click()
    me.wait(f"window.playground.state.mode === 'watch' && {STEPS}.every((step) => step > 0)")


def test_a_study_of_it_is_played_from_consent_to_code(spawn, tmp_path, player, briefly_examined):
    server = spawn(task="gymnasium:CliffWalking-v1", more=(LAKE,))
    folder = Folder(tmp_path / "playground-frozenlake-v1.db-studies")
    rest = {"warm_up": 1, "ranked": 2, "players": 2, "break_every": 1, "declarations": DECLARATIONS}
    folder.create(default_protocol("lake", environment_of(LAKE).configuration({}), LAKE, **rest))
    folder.freeze("lake")
    me = player(server, [*NO_3D, *AS_A_PERSON])
    page = me.page
    page.goto(f"{server.url}/study/lake")  # an invitation need not know where the environment is
    assert page.url == f"{server.url}/play/frozenlake-v1/study/lake"
    leads, spoken, pressed = {}, set(), 0
    while "debrief" not in leads and pressed < 400:
        if page.evaluate("document.body.dataset.screen !== 'loading'"):
            spoken |= {line for line in page.evaluate(ALL_WORDS) if words_of_mars(line)}
        screen, lead, goes_on = page.evaluate(PRESS_WHAT_GOES_ON)
        leads[screen] = lead
        if not goes_on:
            me.hand.press(page.keyboard, ("ArrowDown", "ArrowRight")[pressed % 2])
        pressed += 1
        page.wait_for_timeout(50)
    assert {"consent", "instructions", "play", "ready"} <= leads.keys()
    assert leads["instructions"].startswith("Walk to the flag")
    assert spoken == set()
    page.get_by_test_id("finish").click()
    me.wait("document.getElementById('code').textContent")
    page.goto(f"{server.url}/")  # the page that has finished sends nothing any more
    server.kill()
    assert me.errors == []
    with closing(sqlite3.connect(tmp_path / "playground-frozenlake-v1.db")) as conn:
        sql = "SELECT phase, attestation, task FROM episodes e JOIN series_episodes s ON s.episode_id = e.id"
        episodes = conn.execute(sql).fetchall()
    ranked = [episode_row for episode_row in episodes if episode_row[0] == "ranked"]
    assert ranked == [("ranked", "attested", LAKE)] * 2
    assert verify_database(tmp_path / "playground-frozenlake-v1.db").findings == ()


def test_one_shown_as_text_is_played_by_the_keys_of_its_file(serve, tmp_path, player):
    fields = {
        "id": "tests.support.environments:Path-v0",
        "title": "Home",
        "instructions": "Walk home.",
    }
    fields |= {
        "keys": {"ArrowUp": "forward", "ArrowDown": "back"},
        "success": "info.home",
        "score": "info.coins",
    }
    me = player(
        serve(task=f"gymnasium:{Description(**fields).told}"), [*NO_3D, *AS_A_PERSON]
    ).goto()
    page = me.page
    shown = page.locator("pre.picture").first
    assert (page.get_by_test_id("goal").inner_text(), "@" in shown.inner_text()) == (
        "Walk home.",
        True,
    )
    assert [button.inner_text() for button in page.locator(".pad button").all()] == [
        "",
        "",
    ]  # arrows: waving has no key
    before = shown.inner_text()
    me.hand.press(page.keyboard, "ArrowUp")
    me.wait(f"document.querySelector('pre.picture').innerText !== {before!r}")
    assert page.get_by_test_id("coverage-player").inner_text() == "2"
    assert (violations(page), me.errors) == ([], [])


def test_what_is_not_allowed_is_grey_and_a_key_for_it_says_so_and_sends_nothing(serve, player):
    text = Description(id="tests.support.masked_environments:Doors-v0", title="Doors").told
    me = player(serve(task=f"gymnasium:{text}"), [*NO_3D, *AS_A_PERSON]).goto()
    page, pad = me.page, {name: f"pad-{name}" for name in ("left", "right", "open")}
    page.evaluate("document.body.dataset.pad = 'true'")
    me.wait("window.playground.state.link === 'open'")

    def grey():
        buttons = {name: page.get_by_test_id(test_id) for name, test_id in pad.items()}
        return {name for name in pad if buttons[name].get_attribute("aria-disabled") == "true"}

    assert grey() == {"left", "open"}
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        keep_picture(page, f"doors-{size}")
    assert violations(page) == []
    me.hand.press(page.keyboard, "ArrowLeft")
    assert page.get_by_test_id("dropped").inner_text() == "Left cannot be chosen now."
    page.get_by_test_id(pad["open"]).click(force=True)
    assert page.get_by_test_id("dropped").inner_text() == "Open cannot be chosen now."
    keep_picture(page, "doors-refused")
    assert me.state()["step"] == 0
    while not (frame := me.state())["outcome"]:
        wanted = next(name for name in ("open", "right") if name in frame["allowed"])
        assert grey() == {*pad} - {*frame["allowed"]}
        me.hand.press(page.keyboard, me.state("task.keys")[wanted][0])
        me.wait(f"window.playground.state.player.frame.step > {frame['step']}")
    assert frame["step"] == 6
    episode = fetched(page, f"{me.url}/api/episodes/{frame['episode']}").json()
    assert (episode["attestation"], len(episode["moves"])) == ("attested", 6)
    assert me.errors == []
