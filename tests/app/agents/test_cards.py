"""Agents play an evaluation with cards: each instance once, without a score."""

import asyncio

import pytest

from humanplay.agents.cards import NO_CARD, CardError
from humanplay.agents.turns import Turns
from humanplay.study.folder import Folder
from tests.support.agents import Agent, begun, own, rows_of, token_of
from tests.support.command import command
from tests.support.study import freeze

OUTCOMES = "SELECT json_extract(came_to, '$.outcome') FROM agents_attempts ORDER BY id"


@pytest.fixture
def database(tmp_path):
    freeze(tmp_path / "playground.db-studies")
    begun(tmp_path / "playground.db")
    return tmp_path / "playground.db"


@pytest.fixture
def agent(serve, database):
    token = token_of(database)
    return Agent(serve(), token)


def refused(agent, *given, **named):
    """Return status and sentence of a refusal."""
    with pytest.raises(CardError) as refusal:
        agent.call(*given, **named)
    return refusal.value.status, str(refusal.value)


@pytest.mark.parametrize("ends", ["evaluation", "study", "card"])
def test_the_address_of_a_card_is_of_no_use_once_one_of_three_is_closed(
    agent, database, ends, capsys
):
    agent.play(0, moves=2)
    Folder.beside(database).close("small", keeps_secret=ends != "study")
    if ends == "evaluation":
        close = "agents", "close", "agents", "--yes", "--now", "--database", database
        code, _, errors = command(capsys, *close)
        assert code == 0, errors
    elif ends == "card":
        words = "agents", "revoke", "agents", agent.token[:4], "--database", database
        assert command(capsys, *words)[0] == 0
    assert refused(agent, "act", 0, 1) == (404, NO_CARD)
    assert rows_of(database, "SELECT count(*) FROM agents_moves") == [(2,)]


def test_calls_at_once_make_one_attempt(serve, database):
    server, token = serve(), token_of(database)
    cards = server.app.state.agents

    async def reset():
        return await cards.begin(await cards.find(token), 0)

    async def at_once():
        return await asyncio.gather(*(reset() for _ in range(8)))

    assert len(set(map(str, server.on_loop(at_once())))) == 1
    assert rows_of(database, "SELECT count(*) FROM agents_attempts") == [(1,)]
    for spelling in (
        token.lower(),
        f"{token[:4]}-{token[4:]}",
        f" {token}",
        token.replace("0", "O"),
    ):
        if spelling != token:
            with pytest.raises(CardError):
                Agent(server, spelling)


def test_a_reset_that_waits_for_the_end_of_its_card_begins_nothing(agent, database):
    agent.play(0, moves=1)

    async def both():
        card = await agent.cards.find(agent.token)
        closing, begins = agent.cards.close(card), agent.cards.begin(card, 1)
        return await asyncio.gather(closing, begins, return_exceptions=True)

    _, refusal = agent.server.on_loop(both())
    assert (refusal.status, str(refusal)) == (404, NO_CARD)
    assert rows_of(database, OUTCOMES) == [("abandoned",)]


def test_the_limits_of_calls_and_of_time_hold(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    begun(tmp_path / "playground.db", calls=3, minutes=5, hours=1)
    agent = Agent(serve(), token_of(tmp_path / "playground.db"))
    agent.play(0, moves=1)
    agent.server.clock.wait(6 * 60_000)
    status, reason = refused(agent, "act", 0, 0)
    assert (status, reason) == (409, "instance 0 is finished: no move is made any more")
    agent.play(1, moves=0)
    for _ in range(9 - 4):
        agent.call("begin", 1)
    assert refused(agent, "begin", 1)[0] == 429
    agent.server.clock.wait(3_600_000)
    assert refused(agent, "begin", 1) == (404, NO_CARD)
    assert rows_of(tmp_path / "playground.db", OUTCOMES) == [("abandoned",)] * 2


def test_the_count_of_calls_goes_on_after_a_restart(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    begun(tmp_path / "playground.db", calls=2)
    agent = Agent(serve(), token_of(tmp_path / "playground.db"))
    for index in range(3):  # one attempt and one move each are 2 x 3 calls
        agent.play(index, moves=1)
    assert refused(agent, "begin", 0)[0] == 429
    agent.server.stop()
    assert refused(Agent(serve(), agent.token), "begin", 0)[0] == 429


def test_a_forgotten_card_plays_no_further(agent, database, capsys):
    agent.play(0, moves=2)
    forget = "agents", "forget", "agents", agent.token[:4], "--yes", "--database", database
    assert command(capsys, *forget)[:2] == (0, f"erased: {agent.token[:4]}\n")
    assert refused(agent, "act", 0, 0) == (404, NO_CARD)
    left = [
        rows_of(database, f"SELECT count(*) FROM agents_{table}")[0][0]
        for table in ("cards", "attempts", "moves")
    ]
    assert left == [0, 0, 0]


@pytest.mark.long
def test_another_environment_is_played_the_same_way(serve, tmp_path):
    own(tmp_path / "playground.db", instances=2)
    agent = Agent(serve(task="gymnasium:FrozenLake-v1"), token_of(tmp_path / "playground.db"))
    about = agent.cards.about(agent.card)
    assert about["actions"] == ["left", "down", "right", "up"]
    assert agent.cards.task_name(agent.card) == "FrozenLake-v1"
    seen = agent.call("begin", 0)
    assert isinstance(seen.observation, int)
    assert seen.picture.startswith("data:image/png")
    assert agent.call("act", 0, "left").step == 1


def test_agents_take_turns_and_leave_others_three_times_as_long():
    import itertools

    async def check():
        turns, running, spans = Turns(), [], []
        loop = asyncio.get_running_loop()

        async def work():
            running.append(1)
            assert len(running) == 1
            began = loop.time()
            await asyncio.sleep(0.02)
            spans.append((began, loop.time()))
            running.pop()
            return 7

        assert await asyncio.gather(*(turns.take(work()) for _ in range(5))) == [7] * 5
        rests = [later[0] - earlier[1] for earlier, later in itertools.pairwise(spans)]
        assert min(rests) >= 0.05

        async def fails():
            raise ValueError("no")

        with pytest.raises(ValueError, match="no"):
            await turns.take(fails())
        assert await turns.take(work()) == 7

    asyncio.run(check())
