"""Of what one address asks for, one thing begins in a turn of the event loop."""

import asyncio

from app.protection.turns import Turns


def turns_of(names, cancelled=()):
    """Let things begin, by the names of who asks; return who began in which turn, and the turns that are still awaited."""
    turn, begun, turns = 0, [], Turns()

    async def ask(name):
        await turns.begin(name)
        begun.append((name, turn))

    async def everybody():
        nonlocal turn
        asking = [asyncio.create_task(ask(name)) for name in names]
        await asyncio.sleep(0)
        for number in cancelled:
            asking[number].cancel()
        while not all(each.done() for each in asking):
            turn += 1
            await asyncio.sleep(0)
        await asyncio.sleep(0)

    asyncio.run(everybody())
    return begun, turns._waiting


def test_each_address_begins_one_thing_in_a_turn_and_nothing_stays():
    begun, left = turns_of(["a"] * 5 + ["b"] * 3)
    assert [name for name, _ in begun[:2]] == ["a", "b"], "the first of each begins at once"
    for name, count in (("a", 5), ("b", 3)):
        assert len({turn for each, turn in begun if each == name}) == count
    assert not left


def test_whoever_has_gone_takes_no_turn():
    begun, left = turns_of(["a"] * 4, cancelled=(1, 2))
    assert [name for name, _ in begun] == ["a", "a"]
    assert not left


def test_messages_of_all_sockets_of_an_address_take_turns(server):
    """So thirty sockets at once keep somebody else waiting for the answer to one message."""
    client = server.client()
    session = client.post("/api/sessions", json={"size": 9}).json()["session"]
    turns, begun = server.services.protection.turns, []
    begin = turns.begin

    async def counted(address):
        begun.append(address)
        await begin(address)

    turns.begin = counted
    with server.socket(session, client) as one, server.socket(session, client) as other:
        begun.clear()
        for each in (one, other, one):
            each.send({"kind": "history"})
            each.receive("history")
            each.send("nonsense")
            each.receive("error")
    assert begun == ["127.0.0.1"] * 6
