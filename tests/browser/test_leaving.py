"""The address can be given away, and a ranked episode cannot be dropped.

Two browsers, real keys, and what the database says.
"""

import pytest

from tests.browser.test_attested import there_and_back
from tests.support.browser import AS_A_PERSON, NO_3D, fetched, judge

PERSON = [*NO_3D, *AS_A_PERSON]


def ranked(me, **wish):
    """Begin a ranked board; return the answer."""
    return me.begin(size=[9, 12], **wish)


def kept(me, episode):
    return fetched(me.page, f"{me.url}/api/episodes/{episode}").json()


def test_a_copied_address_can_only_watch_one_terrain_after_the_other(serve, player):
    server = serve()
    me, friend = (player(server, PERSON, reduced_motion="reduce") for _ in range(2))
    begun = ranked(me)
    away, back = there_and_back(me)
    me.press(away)
    address, episode = me.page.url, begun["frame"]["episode"]
    assert address.endswith(f"/?mode=ranked&level=random&size=9x12#watch={begun['watch']}")

    friend.page.goto(address)
    friend.page.wait_for_url(f"{me.url}/watch/{begun['watch']}")
    friend.shows("watching-text", "Live: somebody else is playing")
    friend.wait("window.playground?.state.player?.frame.step === 1")
    sent = []
    friend.page.on("request", lambda request: sent.append(request.url))
    for key in ("ArrowRight", "ArrowDown", "Enter", "KeyW"):
        friend.page.keyboard.press(key)
    me.press(back)
    friend.wait("window.playground.state.player.frame.step === 2")
    friend.shows("moves", "2")
    assert not [url for url in sent if "/api/sessions" in url]
    state = str(friend.page.evaluate("() => JSON.stringify(window.playground.state)"))
    assert begun["session"] not in friend.page.content() + state
    problems = []
    problems += judge(friend.page, "watching")

    me.press("north" if away == "south" else "west")
    assert me.state()["outcome"] == "out_of_bounds"
    stored = kept(me, episode)  # the friend's keys changed nothing
    assert (stored["driver"], stored["counts"], stored["steps"]) == ("human", True, 3)
    replay = f"{me.url}/replay/{episode}"
    assert me.page.get_by_test_id("watch-replay").evaluate("link => link.href") == replay

    friend.page.get_by_test_id("watch-replay").wait_for()
    me.page.keyboard.press("Enter")
    friend.shows("watching-text", "Live: somebody else is playing")
    friend.wait(f"window.playground.state.player.frame.episode !== '{episode}'")
    assert friend.page.get_by_test_id("watch-replay").is_hidden()
    friend.page.goto(f"{me.url}/watch/{episode}")
    friend.page.wait_for_url(replay)
    friend.page.wait_for_function("() => window.replay?.ghost")
    friend.page.keyboard.press("End")
    assert "drove off the map" in friend.page.get_by_test_id("headline").inner_text()
    problems += judge(friend.page, "replay")
    friend.page.get_by_test_id("play-link").click()
    friend.wait(
        "window.playground?.state.mode === 'practice' && window.playground.state.link === 'open'"
    )
    assert friend.state()["episode"] != episode
    friend.press(there_and_back(friend)[0])

    friend.page.goto("about:blank")
    friend.page.goto(f"{me.url}/#watch=0123456789abcdef")
    friend.page.get_by_text("leads to no episode that can be watched").wait_for()
    friend.wait("window.playground?.state.player?.frame.step === 1")  # their own board again
    friend.press(there_and_back(friend)[1])
    friend.shows("notices", "")  # a notice leaves with the next key
    assert problems == []
    assert (me.errors, friend.errors) == ([], [])


def test_leaving_a_ranked_episode_asks_by_keyboard_and_costs_what_abandoning_costs(serve, player):
    server = serve()
    me = player(server, PERSON, reduced_motion="reduce")
    ranked(me)
    problems = []
    problems += judge(me.page, "ranked")
    away, back = there_and_back(me)
    me.press(away)
    episode = me.state()["episode"]
    dialog = me.page.get_by_test_id("leave-dialog")

    me.page.get_by_test_id("mode-practice").focus()
    me.page.keyboard.press("Enter")
    dialog.wait_for(state="visible")
    problems += judge(me.page, "leaving")
    assert me.page.evaluate("() => document.activeElement.dataset.testid") == "keep-playing"
    me.page.keyboard.press("ArrowRight")  # moves nothing while the dialog is open
    me.page.keyboard.press("Enter")
    dialog.wait_for(state="hidden")
    me.press(back)
    assert (me.state()["episode"], me.state()["step"]) == (episode, 2)

    me.page.get_by_test_id("open-settings").click()
    me.page.get_by_test_id("more-levels").click()
    me.page.get_by_role("button", name="2-1-1").click()
    me.page.get_by_test_id("start").click()
    dialog.wait_for(state="visible")
    me.page.keyboard.press("Escape")
    dialog.wait_for(state="hidden")
    assert (me.state()["episode"], me.state()["outcome"]) == (episode, None)

    me.page.get_by_test_id("mode-watch").click()
    dialog.wait_for(state="visible")
    me.page.keyboard.press("Tab")
    me.page.keyboard.press("Enter")
    me.wait("window.playground.state.mode === 'watch'")
    fields = {"outcome": "abandoned", "steps": 2, "counts": True, "steps_to_target": 108}
    assert fields.items() <= kept(me, episode).items()
    me.page.get_by_test_id("mode-practice").click()
    me.wait("window.playground.state.mode === 'practice'")
    sentence = fetched(me.page, f"{me.url}/api/human-level").json()["sentence"]
    assert "1 of them abandoned" in sentence
    assert problems == []
    assert me.errors == []


@pytest.mark.long
def test_coming_back_resumes_in_a_reopened_tab_and_a_second_one(serve, player):
    server = serve()
    me = player(server, PERSON)
    ranked(me)
    away, back = there_and_back(me)
    me.press(away)
    episode = me.state()["episode"]
    context = me.page.context
    with me.page.expect_event("dialog") as asked:
        me.page.close(run_before_unload=True)
    assert asked.value.type == "beforeunload", "the browser asks before the tab is closed"
    with me.page.expect_event("close"):
        asked.value.accept()

    again = type(me)(context.new_page(), me.url).goto()
    assert (again.state()["episode"], again.state()["step"]) == (episode, 1)
    again.page.get_by_text("back in your ranked episode").wait_for()
    second = type(me)(context.new_page(), me.url).goto()
    again.press(back)
    second.wait("window.playground.state.player.frame.step === 2")
    second.page.get_by_test_id("mode-ranked").click()
    second.page.wait_for_timeout(300)
    assert second.state()["episode"] == episode, "Ranked goes on with the open one"
    second.press("north" if away == "south" else "west")
    assert kept(second, episode)["counts"] is True
    assert (again.errors, second.errors) == ([], [])
