"""Agents play a sealed evaluation with cards: once at each instance, from what was seen alone, and without a score."""

import asyncio

import pytest

from humanplay.series.cards import NO_CARD, CardError
from humanplay.series.folder import Folder
from humanplay.series.verification import verify_database
from tests.support.agents import Agent, own, sealed, token_of
from tests.support.command import command
from tests.support.study import freeze


@pytest.fixture
def root(tmp_path):
    freeze(tmp_path / "playground.db-studies")
    sealed(tmp_path / "playground.db-studies")
    return tmp_path / "playground.db-studies"


@pytest.fixture
def agent(serve, root):
    token = token_of(root)
    return Agent(serve(), token)


def refused(agent, *given, **named):
    """Return status and sentence of a refusal."""
    with pytest.raises(CardError) as refusal:
        agent.call(*given, **named)
    return refusal.value.status, str(refusal.value)


def test_the_address_of_a_card_is_of_no_use_once_the_evaluation_is_closed(agent, root):
    agent.play(0, moves=2)
    folder = Folder(root)
    folder.close("small", seals=True)
    folder.close("agents")
    assert refused(agent, "act", 0, 1) == (404, NO_CARD)


def test_calls_at_once_make_one_participant_and_one_attempt(serve, root):
    server, token = serve(), token_of(root)
    cards = server.services.cards

    async def reset():
        return await cards.begin(await cards.find(token), 0)

    async def at_once():
        return await asyncio.gather(*(reset() for _ in range(8)))

    assert len(set(map(str, server.on_loop(at_once())))) == 1
    count = server.services.store.connection.execute
    assert count("SELECT count(*) FROM participants").fetchall() == [(1,)]
    assert count("SELECT count(*) FROM series_episodes").fetchall() == [(1,)]
    for spelling in (
        token.lower(),
        f"{token[:4]}-{token[4:]}",
        f" {token}",
        token.replace("0", "O"),
    ):
        if spelling != token:
            with pytest.raises(CardError):
                Agent(server, spelling)


def test_a_reset_that_waits_for_the_end_of_its_card_begins_nothing(agent):
    agent.play(0, moves=1)
    cards = agent.server.services.cards

    async def both():
        card = await cards.find(agent.token)
        return await asyncio.gather(cards.close(card), cards.begin(card, 1), return_exceptions=True)

    _, refusal = agent.server.on_loop(both())
    assert (refusal.status, str(refusal)) == (404, NO_CARD)
    rows = agent.server.services.store.connection.execute("SELECT outcome FROM episodes").fetchall()
    assert rows == [("abandoned",)]


def test_the_limits_of_calls_and_of_time_hold(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    sealed(tmp_path / "playground.db-studies", calls=3, minutes=5, hours=1)
    agent = Agent(serve(), token_of(tmp_path / "playground.db-studies"))
    agent.play(0, moves=1)
    agent.server.clock.wait(6 * 60_000)
    status, said = refused(agent, "act", 0, 0)
    assert (status, said) == (409, "instance 0 is finished: no move is made any more")
    agent.play(1, moves=0)
    for _ in range(9 - 4):
        agent.call("begin", 1)
    assert refused(agent, "begin", 1)[0] == 429
    agent.server.clock.wait(3_600_000)
    assert refused(agent, "begin", 1) == (404, NO_CARD)
    outcomes = agent.server.services.store.connection.execute(
        "SELECT outcome FROM episodes"
    ).fetchall()
    assert outcomes == [("abandoned",)] * 2


def test_the_count_of_calls_goes_on_after_a_restart(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    sealed(tmp_path / "playground.db-studies", calls=2)
    agent = Agent(serve(), token_of(tmp_path / "playground.db-studies"))
    for index in range(3):  # one attempt and one move each are 2 x 3 calls
        agent.play(index, moves=1)
    assert refused(agent, "begin", 0)[0] == 429
    agent.server.stop()
    assert refused(Agent(serve(), agent.token), "begin", 0)[0] == 429


def test_an_erased_card_plays_no_further_and_its_number_is_kept(serve, root, tmp_path, capsys):
    token, database = token_of(root), tmp_path / "playground.db"
    agent = Agent(serve(), token)
    agent.play(0, moves=2)
    agent.server.stop()
    code, out, said = command(capsys, "forget", token[:4], "--yes", "--database", database)
    assert (code, "one participant of agents, 1 episode" in out) == (0, True), said
    server = serve()
    with pytest.raises(CardError) as refusal:
        Agent(server, token)
    assert (refusal.value.status, str(refusal.value)) == (404, NO_CARD)
    assert Agent(server, token_of(root)).card.number == 2
    server.stop()
    assert verify_database(database).findings == ()


@pytest.mark.long
def test_another_environment_is_played_the_same_way(serve, tmp_path):
    own(tmp_path / "playground.db-studies", instances=2)
    agent = Agent(
        serve(task="gymnasium:FrozenLake-v1"), token_of(tmp_path / "playground.db-studies")
    )
    about = agent.cards.about(agent.card)
    assert about["actions"] == ["left", "down", "right", "up"]
    assert agent.cards.task_name(agent.card) == "FrozenLake-v1"
    seen = agent.call("begin", 0)
    assert isinstance(seen.observation, int)
    assert seen.picture.startswith("data:image/png")
    while not seen.done:
        seen = agent.call("act", 0, "down")
    assert isinstance(seen.observation, int)
