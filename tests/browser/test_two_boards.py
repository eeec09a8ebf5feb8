"""Two boards side by side: which policy plays each, and both paths after the end.

Also what a phone calls them.
"""

from tests.support.browser import NO_3D, keep_picture
from tests.support.servers import eventually


def test_on_a_phone_each_of_two_watched_boards_goes_by_its_policy(serve, player):
    me = player(serve(), NO_3D, 390, 844, has_touch=True, reduced_motion="reduce")
    page = me.page
    me.begin(rival="frontier-cost", size=[9, 12], seed=5)
    tabs = [page.get_by_test_id(f"tab-{role}").inner_text() for role in ("player", "rival")]
    assert tabs == ["You", "Nearest: 0 moves"]
    # long enough that both still play at the end
    me.begin(player="frontier-priced", rival="frontier-cost", size=42, seed=5)
    me.wait("playground.state.mode === 'watch'")
    for role, name in (("player", "Tidy"), ("rival", "Nearest")):
        tab = page.get_by_test_id(f"tab-{role}")
        eventually(lambda tab=tab, name=name: tab.inner_text() == name)
        tab.click()
        assert name in page.get_by_test_id("key").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    keep_picture(page, "watched-390")
    assert me.errors == []


def test_a_board_that_counts_is_alone_and_paths_meet_only_after_the_end(serve, player):
    me = player(serve(), NO_3D)
    about = me.begin(size=[5, 7])
    assert about["counts"]
    me.page.wait_for_timeout(500)
    assert me.state("rival") is None
    before = me.still("canvas-player")
    with me.page.expect_request("**/api/sessions") as asked:
        me.press("north")
    assert me.state()["outcome"] == "out_of_bounds"
    # so that the 3-D views show the paths as well
    assert asked.value.post_data_json["replays"] == about["session"]
    me.wait("window.playground.state.rival && window.playground.state.rival.trail.length > 1")
    assert me.page.get_by_test_id("same-again").is_hidden(), "a terrain counts once"
    me.changes("canvas-player", before)  # the policy's path is drawn under the player's
    parts = ("end-card", "board-player")
    card, board = (me.page.get_by_test_id(part).bounding_box() for part in parts)
    assert card["y"] >= board["y"] + board["height"], "the end card leaves the board uncovered"
    me.page.keyboard.press("Enter")
    me.wait("window.playground.state.rival === null")
    assert me.errors == []


def test_any_policy_can_be_given_to_either_board(serve, player):
    me = player(serve(), NO_3D)
    me.begin(player="frontier-cost", rival="ppo", size=[9, 12])
    for role, other, name in (
        ("player", "rival", "random"),
        ("rival", "player", "frontier-utility"),
    ):
        session, other_name = me.state("player.session"), me.state(f"{other}.name")
        me.page.get_by_test_id(f"pick-{role}").select_option(name)
        me.wait(
            f"window.playground.state.player.session !== '{session}' && window.playground.state.rival"
        )
        assert me.state(f"{role}.name") == name
        assert me.state(f"{other}.name") == other_name
    assert me.errors == []
