"""Watching policies think: wedges, tinted ground, value, goal, the switch that hides them; both paths after the end."""

import pytest

from tests.support.browser import NO_3D, keep_picture
from tests.support.servers import eventually

FIRST = "window.mars.state.rival.thought && window.mars.state.rival.thought.step === window.mars.state.rival.frame.step"


def drawn(me):
    """What is drawn on the policy's matrix, to the pixel."""
    return me.page.get_by_test_id("canvas-rival").evaluate("canvas => canvas.toDataURL()")


def test_the_probabilities_of_ppo_are_drawn_and_can_be_hidden(serve, player):
    me = player(serve(), NO_3D)
    me.begin(rival="ppo", size=[9, 12], seed=5)
    me.wait(FIRST)
    shares = me.state("rival.thought.probabilities")
    assert abs(sum(shares) - 1) < 1e-3
    assert shares[0] == shares[3] == 0, "north and west of the corner lies nothing"
    me.wait("window.mars.state.rival.values.length === 1")
    switch = me.page.get_by_test_id("show-thoughts")
    assert not switch.is_checked(), "a stranger sees the ground first"
    me.still("canvas-rival")
    plain = drawn(me)
    switch.check()
    me.wait("window.mars.state.rival.expected && window.mars.state.rival.expected.step === 0")
    assert me.state("player.expected") is None, "nothing is said about a person's board"
    note, strip = me.page.get_by_test_id("thoughts-note"), me.page.get_by_test_id("value-strip")
    note.wait_for()
    assert "from there Expert should see 0" in note.inner_text()
    assert "What Expert expects to earn from here on" in strip.inner_text()
    assert me.page.get_by_test_id("values").get_attribute("aria-label").startswith("Expert expects")
    me.still("canvas-rival")
    assert drawn(me) != plain
    me.page.reload()
    me.wait(f"window.mars && window.mars.state.rival && {FIRST}")
    assert me.page.get_by_test_id("show-thoughts").is_checked(), "the choice is remembered"
    me.page.get_by_test_id("show-thoughts").uncheck()
    strip.wait_for(state="hidden")
    assert note.is_hidden()
    me.page.reload()
    me.wait(f"window.mars && window.mars.state.rival && {FIRST}")
    assert not me.page.get_by_test_id("show-thoughts").is_checked(), "the choice is remembered"
    eventually(lambda: drawn(me) == plain)
    assert me.state("rival.expected") is None, "what nobody looks at is not worked out"
    assert me.errors == []


def goal_pixel(me):
    """The colour of the corner of the frame round the goal of the policy's newest frame, [red, green, blue]."""
    return me.page.get_by_test_id("canvas-rival").evaluate(
        """canvas => {
            const { frame, thought } = window.mars.state.rival, size = canvas.width / frame.cols, [row, col] = thought.goal;
            const inset = devicePixelRatio;
            return [...canvas.getContext("2d").getImageData(col * size + inset, row * size + size / 2, 1, 1).data].slice(0, 3);
        }"""
    )


@pytest.mark.parametrize(("size", "theme"), [((1440, 900), "dark"), ((390, 844), "light")])
def test_the_cell_that_a_rule_heads_for_is_marked_and_named_where_people_watch(
    serve, player, size, theme
):
    me = player(serve(), NO_3D)
    me.page.set_viewport_size({"width": size[0], "height": size[1]})
    me.page.emulate_media(color_scheme=theme)
    me.begin(rival="frontier-priced", size=[9, 12], seed=5)
    me.wait(FIRST)
    if size[0] < 700:
        me.page.get_by_test_id("tab-rival").click()
    row, col = me.state("rival.thought.goal")
    me.still("canvas-rival")  # on a phone it was hidden till now, and is drawn when it has its size
    plain = goal_pixel(me)
    assert max(plain) < 235, "nobody asked to see it"
    me.page.get_by_test_id("show-thoughts").check()
    said = me.page.get_by_test_id("thoughts-goal")
    said.wait_for()
    assert f"Heads for row {row}, column {col}" in said.inner_text()
    eventually(lambda: min(goal_pixel(me)) > 200)
    keep_picture(me.page, f"goal-{size[0]}")
    me.page.get_by_test_id("show-thoughts").uncheck()
    said.wait_for(state="hidden")
    eventually(lambda: goal_pixel(me) == plain)
    assert me.state("player.thought") is None, "nothing is said about a person's board"
    assert me.errors == []


def test_on_a_phone_each_of_two_watched_boards_goes_by_its_policy_and_says_where_it_heads(
    serve, player
):
    me = player(serve(), NO_3D, 390, 844, has_touch=True, reduced_motion="reduce")
    page = me.page
    me.begin(rival="frontier-cost", size=[9, 12], seed=5)
    me.wait(FIRST)
    tabs = [page.get_by_test_id(f"tab-{role}").inner_text() for role in ("player", "rival")]
    assert tabs == ["You", "Policy"]
    # long enough that both still play at the end
    me.begin(player="frontier-priced", rival="frontier-cost", size=42, seed=5)
    me.wait("mars.state.mode === 'watch'")
    for role, name in (("player", "Tidy"), ("rival", "Nearest")):
        tab = page.get_by_test_id(f"tab-{role}")
        eventually(lambda tab=tab, name=name: tab.inner_text() == name)
        tab.click()
        page.get_by_test_id("show-thoughts").check()
        said = page.get_by_test_id("thoughts-goal")
        said.wait_for()
        eventually(lambda said=said, name=name: f"({name})" in said.inner_text())
        assert name in page.get_by_test_id("key").inner_text()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    keep_picture(page, "watched-390")
    assert me.errors == []


def test_no_thought_comes_for_a_board_that_counts_and_paths_meet_only_after_the_end(serve, player):
    me = player(serve(), NO_3D)
    about = me.begin(size=[5, 7])
    assert about["counts"]
    me.page.wait_for_timeout(500)
    assert me.state("player.thought") is None
    assert me.state("rival") is None
    before = me.still("canvas-player")
    with me.page.expect_request("**/api/sessions") as asked:
        me.press("north")
    assert me.state()["outcome"] == "out_of_bounds"
    # so that the 3-D views show the paths as well
    assert asked.value.post_data_json["replays"] == about["session"]
    me.wait("window.mars.state.rival && window.mars.state.rival.trail.length > 1")
    assert me.page.get_by_test_id("same-again").is_hidden(), "a terrain counts once"
    me.changes("canvas-player", before)  # the policy's path is drawn under the player's
    parts = ("end-card", "board-player")
    card, board = (me.page.get_by_test_id(each).bounding_box() for each in parts)
    assert card["y"] >= board["y"] + board["height"], "the end card leaves the board uncovered"
    me.page.keyboard.press("Enter")
    me.wait("window.mars.state.rival === null")
    assert me.errors == []


def test_any_policy_can_be_given_to_either_board(serve, player):
    me = player(serve(), NO_3D)
    me.begin(player="frontier-cost", rival="ppo", size=[9, 12])
    for role, other, name in (("player", "rival", "random"), ("rival", "player", "planner")):
        session, kept = me.state("player.session"), me.state(f"{other}.name")
        me.page.get_by_test_id(f"pick-{role}").select_option(name)
        me.wait(f"window.mars.state.player.session !== '{session}' && window.mars.state.rival")
        assert me.state(f"{role}.name") == name
        assert me.state(f"{other}.name") == kept
    assert me.errors == []
