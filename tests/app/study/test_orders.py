"""Participants take the rows of a Latin square in turn, and `verify` checks it."""

import json

import pytest

from humanplay.db import chain
from humanplay.study.verification import verify_database
from tests.support.recorded import ask
from tests.support.stored_studies import StudyRecorder, freeze
from tests.support.study import Person
from tests.support.study import freeze as freeze_small

ORDERS = """SELECT p.kind, json_extract(v.detail, '$.number'), (SELECT json_group_array(terrain) FROM
    (SELECT terrain FROM series_episodes WHERE participant_id = p.id AND phase = 'ranked' ORDER BY trial))
    FROM participants p JOIN stage_events v ON v.participant_id = p.id AND v.kind = 'order' ORDER BY p.joined_ms, p.id"""


def test_people_and_scripts_take_rows_in_turn_also_after_a_restart(serve, tmp_path):
    study = freeze_small(tmp_path / "playground.db-studies", warm_up=0)
    server = serve()
    people = []
    for kind in ("human", "script", "human", "human"):
        if len(people) == 2:
            server.stop()
            server = serve()
        join = {"script": "tester"} if kind == "script" else {}
        people.append(Person(server, **join))
        people[-1].to_warm_up()
        people[-1].call("next")
        people[-1].call("next")  # an episode runs: nothing changes, the row neither
    orders = ask(server.services.store.path, ORDERS)
    assert [(kind, number) for kind, number, _ in orders] == [
        ("human", 0),
        ("script", 0),
        ("human", 1),
        ("human", 2),
    ]
    for kind, number, terrains in orders:
        assert json.loads(terrains) == study.balanced_order(kind, number)[:1]
    firsts = sorted(terrains for kind, _, terrains in orders if kind == "human")
    assert firsts == ["[0]", "[1]", "[2]"]


def test_a_forgotten_participants_last_row_is_given_again_and_no_other(tmp_path):
    study = freeze(tmp_path / "studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    first, second, third = (recorder.join(number) for number in range(3))
    for participant in (first, second):
        recorder.play(participant, "ranked", 0)
    recorder.conn.execute("DELETE FROM stage_events WHERE participant_id = ?", [first])
    recorder.play(third, "ranked", 0)
    numbers = recorder.conn.execute(
        "SELECT json_extract(detail, '$.number') FROM stage_events WHERE kind = 'order'"
    ).fetchall()
    recorder.store.close()
    assert sorted(number for (number,) in numbers) == [1, 2]


@pytest.mark.parametrize(
    "detail", ['{"number": 1}', '{"number": -1}', '{"number": "0"}', "[]", "not json"]
)
def test_another_row_than_the_one_played_is_found_also_where_the_digest_was_made_anew(
    tmp_path, detail
):
    study = freeze(tmp_path / "studies")
    recorder = StudyRecorder(tmp_path / "play.db", study)
    participant = recorder.join(0)
    for trial in range(3):
        recorder.play(participant, "ranked", trial)
    recorder.conn.execute("UPDATE stage_events SET detail = ? WHERE kind = 'order'", [detail])
    chain.append(recorder.conn, "participant", participant)
    recorder.store.close()
    findings = [str(finding) for finding in verify_database(tmp_path / "play.db").findings]
    assert any(
        "order of ranked instances" in sentence or "number in the Latin square" in sentence
        for sentence in findings
    ), findings
