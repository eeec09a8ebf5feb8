"""The replay of an environment that takes its time for a move."""

import time

import pytest

from humanplay.tasks.gymnasium.description import Description
from tests.app.tasks.test_gymnasium import begin, play
from tests.support.browser import NO_3D
from tests.support.servers import eventually

STEP_S, MOVES = 0.4, 8
SLOW = Description(
    id="tests.support.environments:Failing-v0",
    kwargs={"how": "never", "step_s": STEP_S},
    max_steps=MOVES,
)


@pytest.fixture
def ended(serve):
    """A server of a slow environment, and the address of an ended episode's replay."""
    server = serve(task=f"gymnasium:{SLOW.told}")
    client = server.page()
    frames = play(server, client, begin(server, client, player="human"), ["forward"])
    return client, f"{server.url}/replay/{frames[-1]['episode']}"


def test_the_page_says_that_it_is_played_again_and_goes_on_by_itself(ended, player):
    _, address = ended
    page = player(address, NO_3D).page
    page.goto(address)
    page.get_by_text("This episode is being played again").wait_for()
    page.wait_for_function("() => window.replay?.playback.last")
    assert page.evaluate("window.replay.playback.last") == MOVES


@pytest.mark.alone
def test_the_page_answers_before_the_environment_does(ended):
    client, address = ended
    began = time.perf_counter()
    answer = client.get(address)
    took_s = time.perf_counter() - began
    assert "being played again" in answer.text
    assert took_s <= 0.3
    eventually(lambda: "being played again" not in client.get(address).text)
    assert time.perf_counter() - began > STEP_S * MOVES * 0.5
