"""Arms: each person is assigned once, by the study's secret."""

import csv
import json
from collections import Counter

import numpy as np
import pytest

from humanplay.db.erasure import forget
from humanplay.report.build import build
from humanplay.report.charts import flow_steps
from humanplay.report.model import PolicyRun
from humanplay.report.preregistration import preregistration
from humanplay.study.data import load
from humanplay.study.protocol import StudyError
from humanplay.study.seeds import drawn_arm
from humanplay.study.verification import verify_database
from tests.support.command import command
from tests.support.dying_server import dying
from tests.support.golden_study import moves_of
from tests.support.recorded import alter, ask
from tests.support.stored_studies import StudyRecorder
from tests.support.stored_studies import freeze as freeze_stored
from tests.support.study import CHECK, Person, agree_at_once, freeze

YES, NO = ({"version": "1", "agree": agree} for agree in (True, False))
TOLD = {"name": "told", "instructions": "Walls first.\n\nThen the rest of {ranked} rounds."}
ARMS = (TOLD, {"name": "control"})
PASSWORD = "a password of the operator"
ASSIGNED = """SELECT p.kind, json_extract(v.detail, '$.number'), json_extract(v.detail, '$.arm')
    FROM stage_events v JOIN participants p ON p.id = v.participant_id WHERE v.kind = 'arm' ORDER BY 1, 2"""
ORDERS = """SELECT json_extract(a.detail, '$.arm'), json_extract(v.detail, '$.number'), x.terrain FROM participants p
    JOIN stage_events a ON a.participant_id = p.id AND a.kind = 'arm'
    JOIN stage_events v ON v.participant_id = p.id AND v.kind = 'order'
    JOIN series_episodes x ON x.participant_id = p.id AND x.phase = 'ranked' AND x.trial = 0"""
ABOUT = {"title": "Walls", "about": "walls"}
SAME_KEYS = {action: ["KeyI", "KeyJ"] for action in ("north", "east", "south", "west")}
CHOICE = {"kind": "choice", "name": "liked", "question": "Liked it?", "choices": ["yes", "no"]}
NOTICED = {"kind": "statement", "name": "noticed", "question": "I looked for walls."}


def test_people_are_assigned_in_blocks_when_they_come_to_the_first_page_that_differs(
    serve, tmp_path
):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS)
    server = serve()
    people = [Person(server) for _ in range(9)]
    decliner = people.pop(2)
    decliner.call("consent", NO)
    assert {person.where["instructions"] for person in people} == {""}, "nobody is assigned yet"
    for person in people:
        person.call("consent", YES)
    script = Person(server, script="tester")
    script.call("consent", YES)
    assigned = ask(server.services.store.path, ASSIGNED)
    assert assigned == [
        *(("human", number, study.arm("human", number)) for number in range(8)),
        ("script", 0, study.arm("script", 0)),
    ]
    for block in (assigned[:4], assigned[4:8]):
        assert Counter(arm for _, _, arm in block) == {"told": 2, "control": 2}
    texts = Counter(person.where["instructions"] for person in people)
    assert texts == {"": 4, "Walls first.\n\nThen the rest of 3 rounds.": 4}
    assert "control" not in json.dumps([person.where for person in people]), "nobody reads a name"


def test_whoever_leaves_or_is_erased_keeps_their_slot_and_nobody_is_assigned_anew(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS)
    server = serve()
    gone, erased, stays = (Person(server) for _ in range(3))
    for person in (gone, stays, erased):
        person.call("consent", YES)
    gone.call("withdraw")
    before = stays.me()["instructions"]
    path, cookies = server.services.store.path, dict(stays.client.cookies)
    server.stop()
    forget(path, erased.where["participant"])
    again = serve()
    back = Person(again, client=again.client(cookies=cookies))
    assert back.where["instructions"] == before
    Person(again).call("consent", YES)
    numbers = [number for _, number, _ in ask(path, ASSIGNED)]
    assert numbers == [0, 1, 3], "the erased person's place is not given again"
    assert load(path, study.name).arrivals.erased_by_arm == {study.arm("human", 2): 1}


def test_a_server_that_dies_between_the_page_and_the_assignment_assigns_everybody_once(
    spawn, tmp_path
):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS)
    path = tmp_path / "playground.db"
    with dying(path, moves=6) as server:
        crowd = [Person(server) for _ in range(12)]
        cookies = [dict(person.client.cookies) for person in crowd]
        agree_at_once(crowd)
    before = ask(path, ASSIGNED)
    assert len(before) <= 5, "the sixth was not committed"
    at_the_page = ask(path, "SELECT count(*) FROM participants WHERE stage = 'instructions'")
    assert at_the_page == [(len(before),)], "nobody is at the page that differs without an arm"
    server = spawn()
    agree_at_once(
        [Person(server, client=server.client(cookies=jar), joins=False) for jar in cookies]
    )
    after = ask(path, ASSIGNED)
    assert after == [("human", number, study.arm("human", number)) for number in range(12)]
    assert after[: len(before)] == before
    server.close()


@pytest.mark.parametrize(
    ("arms", "blocks", "stage"),
    [
        (ARMS, [], "instructions"),
        ([{"name": "a"}, {"name": "b"}], [{"name": "w", "at": "before", "arms": ["b"]}], "instructions"),
        ([{"name": "a", "hint": "Look at {lidar_radius} cells."}, {"name": "b"}], [], "tutorial"),
        ([{"name": "a"}, {"name": "b"}], [{"name": "w", "at": "after", "arms": ["b"]}], "ranked"),
    ],
)  # fmt: skip
def test_an_assignment_waits_for_what_differs_and_blocks_ask_their_arms_alone(
    serve, tmp_path, arms, blocks, stage
):
    blocks = [{**ABOUT, **block, "questions": [NOTICED]} for block in blocks]
    study = freeze(
        tmp_path / "playground.db-studies", arms=arms, blocks=blocks, warm_up=0, ranked=1
    )
    server = serve()
    asked = {}
    for number in range(4):
        person = Person(server)
        noted = {}
        stages = person.where["stage"]
        person.call("consent", YES)
        arm, blocked = study.arm("human", number), []
        while person.where["stage"] != "complete":
            stages = person.where["stage"]
            noted[stages] = len(ask(server.services.store.path, ASSIGNED)) > number
            if block := person.where["block"]:
                blocked.append(block["name"])
                person.call(
                    "block", {"block": block["name"], "turn": 0, "answers": {"noticed": True}}
                )
            elif stages == "tutorial":
                person.call("next")
                hint = {"a": arms[0].get("hint", "").format(lidar_radius=6)}.get(arm, "")
                assert person.where["hint"] == hint
                person.call(
                    "give-up", {"episode": person.frame["episode"], "step": person.frame["step"]}
                )
                person.call("advance", {"from": "tutorial"})
            elif stages == "questions":
                person.answer_questions()
            elif stages == "ranked":
                person.play_on()
            else:
                person.call("advance", {"from": stages})
        assert next(name for name, is_assigned in noted.items() if is_assigned) == stage
        asked.setdefault(arm, set()).add(tuple(blocked))
    wanted = {arm["name"]: {()} for arm in arms}
    for block in blocks:
        wanted[block["arms"][0]] = {("w",)}
    assert asked == wanted


def test_each_arm_is_asked_its_own_questions_on_the_instructions(serve, tmp_path):
    def asks(answer):
        question = {"question": "Is {ranked} many?", "choices": ["yes", "no"], "answer": answer}
        return [{**question, "why": f"It is {answer}."}]

    arms = [{"name": "a", "questions": asks(0)}, {"name": "b", "questions": asks(1)}]
    study = freeze(tmp_path / "playground.db-studies", arms=arms)
    server = serve()
    everybody = len(study.protocol.questions)
    assert f"{everybody + 1} questions" in study.protocol.consent.text
    for number in range(4):
        person = Person(server)
        person.to_tutorial()
        assert len(person.where["questions"]) == everybody, "nobody is assigned yet"
        person.call("next")
        person.call("give-up", {"episode": person.frame["episode"], "step": 0})
        person.call("advance", {"from": "tutorial"})
        assert person.where["questions"][-1] == {"question": "Is 3 many?", "choices": ["yes", "no"]}
        right = {"a": 0, "b": 1}[study.arm("human", number)]
        shared = [question.answer for question in study.protocol.questions]
        person.call("answers", {"answers": [*shared, 1 - right]})
        assert person.where["why"][-1] == f"It is {right}."
        person.call("answers", {"answers": [*shared, right]})
        assert person.where["stage"] == "warm_up"
    assert "the question “Is 3 many?”" in preregistration(study.protocol, study)


def test_people_of_an_arm_with_keys_begin_with_them_and_may_choose_others(serve, tmp_path):
    keys = {"north": ["KeyI", "KeyW"], "east": ["KeyL", "KeyD"], "south": ["KeyK", "KeyS"]}
    keys["west"] = ["KeyJ", "KeyA"]
    arms = [{"name": "letters", "keys": keys}, {"name": "arrows"}]
    study = freeze(tmp_path / "playground.db-studies", arms=arms)
    server = serve()
    usual = {action: list(codes) for action, codes in study.protocol.environment.keys.items()}
    remembered = {action: list(reversed(codes)) for action, codes in usual.items()}
    for number in range(4):
        person = Person(server)
        person.call("settings", {"palette": "high-contrast", "keys": remembered})
        assert person.where["task"]["keys"] == usual, "nobody is assigned yet"
        person.call("consent", YES)
        wanted = keys if study.arm("human", number) == "letters" else usual
        assert list(person.where["task"]["keys"].items()) == list(wanted.items())
        assert person.where["settings"]["keys"] == wanted
        assert person.where["settings"]["palette"] == "high-contrast"
        late = {"modality": "touch", "keys": remembered, "stage": "consent"}
        person.call("settings", late)
        assert person.where["settings"]["keys"] == wanted, "these were chosen before the arm's"
        assert person.where["settings"]["modality"] == "touch"
        person.call("settings", {"keys": usual, "stage": "instructions"})
        assert person.where["settings"]["keys"] == usual
    assert "begin with the keys KeyI, KeyW for north" in preregistration(study.protocol, study)


def test_an_invitation_with_an_arm_is_assigned_by_the_operator_and_takes_no_slot(
    serve, tmp_path, capsys
):
    root = tmp_path / "playground.db-studies"
    study = freeze(root, arms=ARMS, recruitment="invitation", warm_up=0, ranked=1, players=4)
    path = tmp_path / "playground.db"
    invite = "study", "invite", study.name, "2", "--database", path
    assert "has no arm 'else'" in command(capsys, *invite, "--arm", "else")[2]
    listed = "study", "invite", study.name, "--list", "--arm", "control", "--database", path
    assert "--arm goes with the number of links" in command(capsys, *listed)[2]
    named = command(capsys, *invite, "--arm", "control", "--csv", tmp_path / "links.csv")[1]
    drawn = command(capsys, *invite)[1]
    rows = list(csv.DictReader((tmp_path / "links.csv").read_text().splitlines()))
    assert [row["arm"] for row in rows] == ["control", "control"]
    server = serve()
    for link in (*named.split(), *drawn.split()):
        person = Person(server, invitation=link.partition("invitation=")[2])
        person.to_warm_up()
        person.play_on()
    assert server.services.store.path == path
    server.stop()
    assert ask(path, ASSIGNED) == [
        *[("human", None, "control")] * 2,
        *(("human", number, study.arm("human", number)) for number in range(2)),
    ]
    assert verify_database(path, secrets={study.name: study.secret}).findings == ()
    closing = "--yes", "--now", "--database", path
    assert command(capsys, "study", "close", study.name, *closing)[0] == 0
    serve().stop()  # it takes note
    sentence = "2 people were assigned to an arm by the operator, with the invitation, and not by"
    assert sentence in " ".join(build(load(path, study.name)).deviations)
    out = tmp_path / "bundle"
    code, printed, error = command(
        capsys, "release", "--study", study.name, "--out", out, "--author", "A", "--database", path
    )
    assert code == 0, printed + error
    people = csv.DictReader(next(out.rglob("participants.csv")).read_text().splitlines())
    assert Counter(row["arm_assigned_by"] for row in people) == {"operator": 2, "chance": 2}
    code, printed, error = command(capsys, "reproduce", out)
    assert code == 0, printed + error


def test_orders_are_rows_of_a_square_of_each_arm(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS, warm_up=0)
    server = serve()
    for _ in range(4):
        person = Person(server)
        person.to_warm_up()
        person.call("next")
    rows = sorted(ask(server.services.store.path, ORDERS))
    assert [(arm, number) for arm, number, _ in rows] == [
        ("control", 0), ("control", 1), ("told", 0), ("told", 1),
    ]  # fmt: skip
    for arm, number, terrain in rows:
        assert terrain == study.balanced_order(f"human|{arm}", number)[0]
    assert (
        verify_database(server.services.store.path, secrets={study.name: study.secret}).findings
        == ()
    )


def test_another_arm_than_the_drawn_one_and_a_missing_one_are_found(serve, tmp_path):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS)
    server = serve()
    people = [Person(server) for _ in range(2)]
    for person in people:
        person.call("consent", YES)
    path = server.services.store.path
    server.stop()
    secrets = {study.name: study.secret}
    assert verify_database(path, secrets=secrets).findings == ()
    other = {"told": "control", "control": "told"}[study.arm("human", 0)]
    alter(
        path,
        f"""UPDATE stage_events SET detail = '{{"arm": "{other}", "number": 0}}'
        WHERE kind = 'arm' AND json_extract(detail, '$.number') = 0""",
        "DELETE FROM stage_events WHERE kind = 'arm' AND json_extract(detail, '$.number') = 1",
    )
    whats = {finding.what for finding in verify_database(path, secrets=secrets).findings}
    assert {"arm", "assignment to an arm"} <= whats


def test_report_and_release_say_who_left_which_arm_and_both_estimates_by_arm(
    serve, tmp_path, capsys
):
    study = freeze(tmp_path / "playground.db-studies", arms=ARMS, warm_up=0, ranked=1, players=4)
    server = serve(admin_password=PASSWORD)
    people = [Person(server) for _ in range(6)]
    for person in people[:5]:
        person.to_warm_up()
        person.play_on()
    people[5].to_tutorial()
    people[5].call("withdraw")
    path = server.services.store.path
    arms = [study.arm("human", number) for number in range(6)]
    client = server.client(headers={"Origin": server.url})
    assert client.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    listed = client.get("/api/admin/studies/small").json()["participants"]
    assert [person["arm"] for person in listed] == arms
    server.stop()
    assert build(load(path, study.name)).groups[0].arms == (), "an open study says nothing by arm"
    database = "--yes", "--now", "--database", path
    assert command(capsys, "study", "close", study.name, *database)[0] == 0
    serve().stop()  # it takes note
    report = build(load(path, study.name))
    rows = {row.arm: row for row in report.groups[0].arms}
    flow = flow_steps(report.groups[0].flow, report.groups[0].arms)
    by_arm = {step.label: step.detail for step in flow}
    for label, people in (("Assigned to an arm", arms), ("Per protocol", arms[:5])):
        counts = Counter(people)
        assert by_arm[label] == f"told {counts['told']}, control {counts['control']}"
    pay = tmp_path / "pay.csv"
    assert command(capsys, "study", "payments", "small", "--csv", pay, *database[2:])[0] == 0
    assert [row["arm"] for row in csv.DictReader(pay.read_text().splitlines())] == arms
    assert {arm: row.assigned for arm, row in rows.items()} == Counter(arms)
    for arm, row in rows.items():
        through = arms[:5].count(arm)
        assert (row.began, row.ended, row.per_protocol.players) == (through,) * 3
        left = {"withdrew_early": 1} if arm == arms[5] else {}
        assert row.statuses == {"finished": through, **left}
    out = tmp_path / "release"
    code, _, error = command(
        capsys, "release", "--study", study.name, "--out", out, "--author", "A", "--database", path
    )
    assert code == 0, error
    table = next(out.rglob("participants.csv")).read_text().splitlines()
    column = table[0].split(",").index("arm")
    assert Counter(row.split(",")[column] for row in table[1:]) == Counter(arms)
    code, printed, error = command(capsys, "reproduce", out)
    assert code == 0, printed + error
    assert "They have no p: the policies are tested" in preregistration(study.protocol, study)


@pytest.mark.parametrize(
    ("protocol", "sentence"),
    [
        ({"arms": [{"name": "a"}]}, "arms must be none, or two or more"),
        ({"arms": [{"name": "a"}, {"name": "a"}]}, "with different names"),
        ({"arms": [{"name": "a"}, {"name": "b"}]}, "do not differ"),
        (
            {"arms": [{"name": "a", "keys": {"north": ["KeyI"]}}, {"name": "b"}]},
            "keys of the arm 'a' must be different keys: 2 of north, 2 of east",
        ),
        (
            {"arms": [{"name": "a", "keys": SAME_KEYS}, {"name": "b"}]},
            "keys of the arm 'a' must be different keys",
        ),
        (
            {"blocks": [{**ABOUT, "name": "w", "at": "before", "arms": ["c"], "questions": [NOTICED]}]},
            "names the arm 'c', but the protocol has no such arm .it has: none.",
        ),
        (
            {"arms": ARMS, "blocks": [{**ABOUT, "name": "w", "at": "before", "arms": ["told"], "questions": [CHECK]}]},
            "an attention check for some arms alone",
        ),
        (
            {"arms": ARMS, "blocks": [
                {**ABOUT, "name": "w", "at": "before", "arms": ["told"], "questions": [CHOICE]},
                {**ABOUT, "name": "v", "at": "before", "shown_if": {"question": "liked", "answers": [0]}, "questions": [CHECK]},
            ]},
            "the block 'v' has an attention check for some arms alone",
        ),
        (
            {"arms": [{"name": "a", "keys": {**SAME_KEYS, "north": ["KeyI", "Space"]}}, {"name": "b"}]},
            "must be codes of keys that may drive, .* got 'Space'; Space, Enter, Tab and Escape stay with the page",
        ),
        ({"arms": [{"name": "a b"}, {"name": "b"}]}, "name: String should match pattern"),
        ({"primary_family": "arms"}, "primary_family arms needs arms and arm_difference"),
        (
            {"arms": [{"name": "a", "questions": [{"question": "?", "choices": ["a", "b"], "answer": 0}]}, {"name": "b"}]},
            "all arms must ask the same number of questions, .* got 1 and 0",
        ),
        ({"arms": [{"name": "a", "hint": "{rows_}"}, {"name": "b"}]}, "unknown placeholder"),
        ({"arms": [{"name": "a", "hint": "Play 30 rounds."}, {"name": "b"}]}, "counts by hand"),
    ],
)  # fmt: skip
def test_arms_that_are_none_are_refused(tmp_path, protocol, sentence):
    with pytest.raises(StudyError, match=sentence):
        freeze(tmp_path, **protocol)


def test_arms_of_a_block_are_as_many_of_each_in_an_order_that_changes(tmp_path):
    draws = [drawn_arm(b"s" * 32, "h", "human", number, 3) for number in range(600)]
    blocks = [tuple(draws[at : at + 6]) for at in range(0, 600, 6)]
    assert {tuple(sorted(block)) for block in blocks} == {(0, 0, 1, 1, 2, 2)}
    assert len(set(blocks)) > 50
    assert draws[:6] != [drawn_arm(b"s" * 32, "h", "script", number, 3) for number in range(6)]


def test_a_dry_run_compares_its_arms_while_it_is_open(tmp_path):
    run = freeze_stored(
        tmp_path / "studies", name="dry", arms=ARMS, dry_run_of="small", ranked=2, close=False
    )
    recorder = StudyRecorder(tmp_path / "play.db", run)
    for number in range(4):
        person = recorder.join(number)
        for trial in range(2):
            recorder.play(person, "ranked", trial, moves_of(0.1, number, trial))
    recorder.close()
    data = load(tmp_path / "play.db", "dry")
    assert data.closed_ms is None
    group = build(data).groups[0]
    assert sorted((row.arm, row.ended) for row in group.arms) == [("control", 2), ("told", 2)]
    assert {row.metric for row in group.arm_comparisons} == {"score", "steps"}


def test_a_study_of_arms_tests_them_and_no_policy(tmp_path):
    study = freeze_stored(
        tmp_path / "studies",
        draw=lambda length: b"\5" * length,  # on some terrains slips hardly lengthen an episode
        arms=ARMS,
        primary_family="arms",
        arm_difference=5,
        ranked=5,
        players=12,
        assumed_mean=20,
        assumed_player_sd=4,
        assumed_terrain_sd=4,
        assumed_episode_sd=4,
        power={"arms_differ": 0.9, "studies": 100},
    )
    recorder = StudyRecorder(tmp_path / "play.db", study)
    for number in range(12):
        person = recorder.join(number)
        slips = 0.05 if study.arm("human", number) == "told" else 0.5
        for trial in range(5):
            recorder.play(person, "ranked", trial, moves_of(slips, number, trial))
    recorder.close()
    data = load(tmp_path / "play.db", study.name)
    report = build(data, [PolicyRun("frontier-cost", np.ones(5), np.full(5, 20.0), ("",) * 5)])
    group = report.groups[0]
    rows = {row.metric: row for row in group.arm_comparisons}
    assert {(row.arm, row.other) for row in rows.values()} == {("told", "control")}
    steps = rows["steps"]
    means = [row.per_protocol.steps.mean for row in group.arms]
    assert steps.difference == pytest.approx(means[0] - means[1])
    assert steps.interval[0] < steps.difference < steps.interval[1] < 0
    assert steps.p_value == steps.p_adjusted < 0.05
    assert rows["score"].p_value is None
    assert group.comparisons
    assert all(row.p_value is None for row in group.comparisons)
    assert "For each two arms" in preregistration(study.protocol, study)
    items = {item.number: item for item in report.checklist}
    assert items["4.1.1"].answer.startswith("Test of the differences between arms")
    assert items["1.8.1"].detail == "5 steps to 99 % between two arms, named before the study."


@pytest.mark.parametrize(
    ("arms", "blocks", "before"),
    [
        ([{"name": "hinted", "hint": "Walls first."}, {"name": "control"}], [], "instructions"),
        (
            [{"name": "hinted"}, {"name": "control"}],
            [{**ABOUT, "name": "w", "at": "after", "arms": ["hinted"], "questions": [NOTICED]}],
            "warm_up",
        ),
    ],
)
def test_the_operators_arm_is_noted_when_chances_is_so_that_attrition_counts_the_same_people(
    serve, tmp_path, capsys, arms, blocks, before
):
    root, path = tmp_path / "playground.db-studies", tmp_path / "playground.db"
    study = freeze(root, arms=arms, blocks=blocks, recruitment="invitation", warm_up=1, ranked=1)
    invite = "study", "invite", study.name, "1", "--database", path
    named = command(capsys, *invite, "--arm", "control")[1].split()
    drawn = command(capsys, *invite)[1].split()
    server = serve()
    for number, link in enumerate((*named, *drawn)):
        person = Person(server, invitation=link.partition("invitation=")[2])
        if before == "warm_up":
            person.to_warm_up()
        else:
            person.call("consent", YES)
        assert len(ask(path, ASSIGNED)) == number, "nobody is assigned before the page that differs"
        if before == "instructions":
            person.call("advance", {"from": "instructions"})
        else:
            person.call("next")
            person.play()
        assert len(ask(path, ASSIGNED)) == number + 1
    server.stop()
    assert ask(path, ASSIGNED) == [
        ("human", None, "control"),
        ("human", 0, study.arm("human", 0)),
    ]
