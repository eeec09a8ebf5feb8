"""A challenge: the terrain of a replay, against what was done there.

Both results are shown, and it enters no human score.
"""

from humanplay.db.store import Store
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from tests.support.browser import AS_A_PERSON, NO_3D, fetched, judge
from tests.support.recorded import play


def test_a_replay_is_challenged_and_both_results_stand_at_the_end(serve, player, tmp_path):
    store = Store(tmp_path / "playground.db")
    against = play(store, 4, explore=True, config=EnvConfig.of("random", (9, 12)), driver="script")
    store_actions = store.steps(against.id)
    store.close()
    server = serve()
    me = player(server, (*NO_3D, *AS_A_PERSON))
    page = me.page
    page.goto(f"{server.url}/replay/{against.id}")
    page.get_by_test_id("beat-this").click()
    page.get_by_text(f"{len(store_actions)} moves. Beat it.").wait_for()
    assert page.url.endswith(f"/challenge/{against.id}")
    assert judge(page, "challenge") == []
    assert page.get_by_test_id("people").locator("li").count() == 0
    page.get_by_test_id("take").click()
    me.wait("window.playground?.state.player && window.playground.state.link === 'open'")
    begun = me.state()
    assert page.url.endswith(f"#challenge={against.id}")
    assert (me.state("mode"), me.state("counts"), me.state("rival.frame.step")) == (
        "challenge",
        False,
        0,
    )
    policy = policies.load("frontier-utility")
    me.explore(policy, lambda frame: frame["step"] == 3)
    me.shows("steps-rival", "3")  # the opponent moves with me
    page.reload()
    me.wait(
        "window.playground?.state.player?.frame.step === 3 && window.playground.state.link === 'open'"
    )
    assert me.state()["episode"] == begun["episode"]
    page.goto(f"{server.url}/leaderboard")  # left, and come back to
    page.locator("nav.pages").get_by_role("link", name="Play").click()
    me.wait(
        "window.playground?.state.player?.frame.step === 3 && window.playground.state.link === 'open'"
    )
    assert (me.state("mode"), me.state()["episode"]) == ("challenge", begun["episode"])
    assert (me.state("rival.name"), me.state("rival.frame.step")) == ("A script", 3)
    assert page.url.endswith(f"#challenge={against.id}")
    assert page.get_by_test_id("terrain").inner_text() == "Challenge · Scattered · 9 × 12"
    mine = me.explore(policy, lambda frame: frame["outcome"])
    theirs = me.state("rival.frame")
    done = fetched(page, f"{server.url}/api/episodes/{against.id}").json()
    assert (theirs["outcome"], theirs["step"]) == ("explored", done["steps"])
    page.get_by_test_id("end-title").get_by_text("a script").wait_for()
    title = page.get_by_test_id("end-title").inner_text()
    gap = mine["step"] - theirs["step"]
    assert f"{abs(gap)} move" in title or "Level with" in title
    assert " a script" in title
    assert judge(page, "challenge-end") == []
    # a terrain that was chosen: in no human score, whoever played it
    stored = fetched(page, f"{server.url}/api/episodes/{mine['episode']}").json()
    assert (stored["driver"], stored["counts"]) == ("human", False)
    assert fetched(page, f"{server.url}/api/human-level").json()["figures"] == []
    assert fetched(page, f"{server.url}/api/episodes?who=human").json() == []
    assert page.get_by_test_id("beat-this").get_attribute("href") == (
        f"#challenge={mine['episode']}"
    )
    page.keyboard.press("Enter")  # practice, and no ranked terrain
    me.wait(f"window.playground.state.player.frame.episode !== '{mine['episode']}'")
    assert (me.state("mode"), me.state("counts")) == ("practice", False)
    assert "#watch=" in page.url

    page.goto("about:blank")
    page.goto(f"{server.url}/#challenge=0123456789abcdef")
    page.get_by_text("This challenge cannot be opened").wait_for()
    page.goto(f"{server.url}/challenge/{against.id}")
    page.get_by_test_id("people").get_by_text(f"{mine['step']} moves, by somebody").wait_for()
    page.goto(f"{server.url}/replay/{against.id}")
    page.get_by_test_id("challengers").get_by_text("by somebody").wait_for()
    assert fetched(page, f"{server.url}/challenge/0123456789abcdef").status == 404
    assert me.errors == []
