"""SIGKILL between two writes of answers and assignments loses nothing."""

import random
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from humanplay.db.study_rows import participant_label
from humanplay.study.verification import verify_database
from tests.support.dying_server import dying
from tests.support.recorded import ask
from tests.support.study import CHECK, Person, freeze

PEOPLE = 3
"""Who take part at the same time."""
LATEST_WRITE = 150
"""After so many writes a server has died."""
ABOUT = {"title": "About you", "about": "you"}
SLEEP = {"kind": "number", "name": "hours", "question": "How long did you sleep?", "maximum": 24}
RESTED = {
    "kind": "likert",
    "name": "rested",
    "question": "How do you feel?",
    "rows": ["rested", "awake", "well"],
    "points": ["no", "yes"],
}
WORDS = {"kind": "text", "name": "words", "question": "In your words?"}
BLOCKS = (
    {**ABOUT, "name": "night", "at": "before", "questions": [SLEEP, RESTED, WORDS]},
    {
        **ABOUT,
        "name": "walls",
        "at": "after_warm_up",
        "arms": ["told"],
        "questions": [{**WORDS, "name": "seen"}],
    },
    {**ABOUT, "name": "last", "at": "after", "questions": [CHECK, {**SLEEP, "name": "age"}]},
)
ARMS = ({"name": "told", "instructions": "Walls first."}, {"name": "control"})
STORED = """SELECT 'event', participant_id, number, kind, detail FROM stage_events
    UNION ALL SELECT 'answer', participant_id, block || turn, question || part, answer FROM answers
    UNION ALL SELECT 'text', participant_id, block || turn, question, words FROM free_texts"""
NOTED = """SELECT participant_id, json_extract(detail, '$.block') FROM stage_events
    WHERE kind = 'block'"""
ANSWERED = """SELECT participant_id, block FROM answers
    UNION SELECT participant_id, block FROM free_texts"""
ARMS_OF = """SELECT json_extract(detail, '$.number'), json_extract(detail, '$.arm'), participant_id
    FROM stage_events WHERE kind = 'arm' ORDER BY 1"""


def take_step(person):
    """Do what is next; an episode is given up at its first move."""
    state = person.where
    plays = state["stage"] == "ranked" or (
        state["stage"] == "tutorial" and not state["tutorial"]["done"]
    )
    if state["block"] is not None or not plays:
        person.take_step()
        return
    person.call("next")
    frame = {"episode": person.frame["episode"], "step": person.frame["step"]}
    person.call("give-up", frame)


def go_on(person, acknowledged):
    """Go on to the end, and note which blocks the server said that it has."""
    while person.where["stage"] != "complete":
        block = person.where["block"]
        take_step(person)
        if block is not None:
            acknowledged.add((person.where["participant"], block["name"]))


def take_part(server, cookies, acknowledged):
    """Go on where a server was killed, then one after another, until this one is.

    Returns:
        The cookies of who has not come to the end; None if nobody had begun.
    """
    while True:
        client = server.client(cookies=cookies)
        person = Person(server, client=client, joins=False)
        try:
            if cookies is None:
                person.call("join")
                cookies = dict(client.cookies)
            person.me()
            go_on(person, acknowledged)
            cookies = None
        except httpx.TimeoutException:
            continue  # a slow server is not a dead one
        except httpx.TransportError:
            return cookies


def check(path, study, acknowledged):
    """What was acknowledged is there, nothing by half, and nobody is assigned twice."""
    assert verify_database(path, secrets={study.name: study.secret}).findings == ()
    noted = ask(path, NOTED)
    assert len(set(noted)) == len(noted)
    assert set(ask(path, ANSWERED)) <= set(noted), "answers without their block"
    assert acknowledged <= {(participant_label(ident), block) for ident, block in noted}
    assigned = ask(path, ARMS_OF)
    assert len({participant for *_, participant in assigned}) == len(assigned)
    assert [(number, arm) for number, arm, _ in assigned] == [
        (number, study.arm("human", number)) for number in range(len(assigned))
    ]


@pytest.mark.parametrize(
    ("batch", "kills"),
    [(0, 2), *(pytest.param(number, 10, marks=pytest.mark.long) for number in range(1, 11))],
)
def test_a_kill_between_two_writes_loses_no_answer_and_assigns_nobody_twice(
    spawn, tmp_path, batch, kills
):
    study = freeze(
        tmp_path / "playground.db-studies", arms=ARMS, blocks=BLOCKS, warm_up=0, ranked=1
    )
    path, dice = tmp_path / "playground.db", random.Random(batch)
    unfinished, acknowledged, before = [None] * PEOPLE, set(), set()
    for _ in range(kills):
        with dying(path, writes=dice.randrange(1, LATEST_WRITE)) as server:
            with ThreadPoolExecutor(PEOPLE) as pool:
                walks = [
                    pool.submit(take_part, server, cookies, acknowledged) for cookies in unfinished
                ]
            unfinished = [walk.result() for walk in walks]
        stored = set(ask(path, STORED))
        assert before <= stored, "what was written once stays"
        check(path, study, acknowledged)
        before = stored
    server = spawn()
    for cookies in filter(None, unfinished):
        person = Person(server, client=server.client(cookies=cookies), joins=False)
        person.me()
        go_on(person, acknowledged)
    server.close()
    check(path, study, acknowledged)
    assert len(acknowledged) > kills
