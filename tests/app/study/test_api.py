"""A participant goes through a whole study; the server refuses steps out of order."""

import json
from contextlib import closing

import pytest

from humanplay.db.reader import Reader
from humanplay.study.folder import Folder
from humanplay.task import describe
from humanplay.web.operator.participants import list_participants
from marsexplorer.config import EnvConfig
from marsexplorer.episode import replay
from tests.support.study import Person, freeze


@pytest.fixture
def study(tmp_path):
    return freeze(tmp_path / "playground.db-studies")


@pytest.fixture
def server(serve, study, tmp_path):
    return serve()


def rows(server, sql, *values):
    """Rows of the database as a reader sees them while the server runs."""
    import sqlite3
    from contextlib import closing

    with closing(sqlite3.connect(server.services.store.path)) as db:
        db.row_factory = sqlite3.Row
        return [dict(row) for row in db.execute(sql, values).fetchall()]


def test_a_study_publishes_hash_and_commitment_and_its_secret_when_closed(server, study, tmp_path):
    client = server.client()
    offered = {"recruitment": "open", "warm_up": 2, "ranked": 3}
    assert client.get("/api/studies").json() == [
        {"name": "small", "title": study.protocol.title, "status": "open", **offered}
    ]
    described = client.get("/api/studies/small").json()
    assert described == {
        "name": "small", "title": study.protocol.title, "status": "open", "protocol_hash": study.protocol_hash,
        "commitment": study.commitment, "secret": None,
        "task": describe(study.protocol.environment),
        "level": "random", "rows": 7, "cols": 9,
        "config": study.protocol.env_config.to_dict(),
        "warm_up": 2, "ranked": 3, "players": 2, "consent_version": "1",
    }  # fmt: skip
    Folder(tmp_path / "playground.db-studies").close("small")
    now = client.get("/api/studies/small").json()
    assert (now["status"], now["secret"]) == ("closed", study.secret.hex())


def test_the_whole_way_from_consent_to_completion_code(server, study):
    person = Person(
        server, outside_ids={"PROLIFIC_PID": "pid-1", "STUDY_ID": "s-1", "WEATHER": "fine"}
    )
    state = person.where
    assert (state["stage"], state["session"], state["about"], state["phase"]) == (
        "consent",
        None,
        None,
        None,
    )
    assert state["consent"]["text"] == study.protocol.consent.text
    assert "2 practice terrains and 3 terrains that count" in state["consent"]["text"]
    assert state["rules"] == {"coverage": "99 %", "lidar_radius": "6", "max_steps": "63"}
    assert [set(question) for question in state["questions"]] == [{"question", "choices"}] * 3
    person.call("consent", {"version": "1", "agree": True})
    person.call("advance", {"from": "instructions"})
    assert person.where["stage"] == "tutorial"
    person.call("next")
    assert (person.where["phase"], person.where["tutorial"]["done"]) == ("tutorial", False)
    assert person.play()[-1]["score"] is not None
    assert person.me()["tutorial"]["done"] is True
    person.call("advance", {"from": "tutorial"})
    assert person.call("answers", {"answers": [0, 0, 1]})["right"] == [True, False, True]
    assert person.where["stage"] == "questions"
    person.call("answers", {"answers": [0, 1, 1]})
    assert (person.where["stage"], person.where["right"]) == ("warm_up", [True] * 3)
    seen = person.play_on()
    assert [len(frames) for frames in seen.values()] == [0, 2, 3]
    assert all(frame["score"] is not None for frames in seen["warm_up"] for frame in frames)
    hidden = [frame for frames in seen["ranked"] for frame in frames][:-1]
    assert all(frame[name] is None for frame in hidden for name in ("reward", "return", "score"))
    last = seen["ranked"][-1][-1]
    assert (last["outcome"], last["score"] is not None) == ("explored", True)
    state = person.where
    assert state["stage"] == "debrief"
    debrief = state["debrief"]
    assert [episode["outcome"] for episode in debrief["episodes"]] == ["explored"] * 3
    policy = debrief["policy"]
    assert policy.keys() == {"name", "mean_steps_warm_up", "own_mean_steps_warm_up"}
    assert policy["name"] == "frontier-cost"
    assert policy["mean_steps_warm_up"] == policy["own_mean_steps_warm_up"]
    ending = person.where["ending"]
    assert (ending["outcome"], len(ending["code"])) == ("finished", 8)
    for index in range(2):
        replays = person.client.get(f"{person.url}/debrief/{index}").json()
        assert replays["own"] == seen["warm_up"][index]
        assert [frame["grid"] for frame in replays["policy"]["frames"]] == [
            frame["grid"] for frame in replays["own"]
        ]
    assert person.client.get(f"{person.url}/debrief/2").status_code == 404
    person.call("advance", {"from": "debrief"})
    assert (person.where["stage"], person.where["ending"]) == ("complete", ending)
    identities = rows(server, "SELECT name, value FROM identities ORDER BY name")
    assert [tuple(row.values()) for row in identities] == [
        ("PROLIFIC_PID", "pid-1"),
        ("STUDY_ID", "s-1"),
    ]
    check_rows(server, study)


def check_rows(server, study):
    """The database holds what was played, on the study's terrains, in the right order."""
    (participant,) = rows(server, "SELECT * FROM participants")
    assert (participant["kind"], participant["stage"], participant["consent_version"]) == (
        "human",
        "complete",
        "1",
    )
    assert participant["completed_ms"] >= participant["consent_ms"] >= participant["joined_ms"]
    trials = rows(
        server,
        "SELECT * FROM series_episodes t JOIN episodes e ON e.id = t.episode_id ORDER BY e.number",
    )
    order = study.balanced_order("human", 0)
    assert [(trial["phase"], trial["trial"], trial["terrain"]) for trial in trials] == [
        ("tutorial", 0, 0), ("warm_up", 0, 0), ("warm_up", 1, 1), *(("ranked", i, order[i]) for i in range(3))
    ]  # fmt: skip
    seeds = [
        1,
        study.seed("warm-up", 0),
        study.seed("warm-up", 1),
        *(study.seed("ranked", i) for i in order),
    ]
    assert [trial["seed"] for trial in trials] == seeds
    assert {(trial["seed_chosen"], trial["assisted"], trial["driver"]) for trial in trials} == {
        (0, 0, "human")
    }
    assert {trial["session_id"] for trial in trials} == {participant["session_id"]}
    for trial in trials:
        record = server.services.store.load_record(trial["id"])
        assert replay(record).record() == record
    kinds = [
        event["kind"] for event in rows(server, "SELECT kind FROM stage_events ORDER BY number")
    ]
    assert kinds[:4] == ["joined", "stage", "stage", "stage"]
    assert (kinds.count("answers"), kinds.count("break"), kinds[-1]) == (2, 1, "stage")


def test_a_break_is_offered_after_some_ranked_episodes_until_the_next_begins(server):
    person = Person(server)
    person.to_warm_up()
    person.play_on(until=("ranked",))
    offered = []
    for _ in range(3):
        person.call("next")
        assert person.where["break_due"] is False
        person.play()
        offered.append(person.me()["break_due"])
    assert offered == [False, True, False]


def test_giving_up_is_explicit_and_costs_what_a_collision_costs(server):
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    frames = person.play(moves=2)
    stale = person.refused("give-up", {"episode": frames[0]["episode"], "step": 0})
    assert stale == "step 0 is not the current one, which is 2"
    person.call("give-up", {"episode": frames[0]["episode"], "step": 2})
    frame = person.frame
    assert (frame["outcome"], frame["step"]) == ("abandoned", 2)
    assert frame["return"] == frames[2]["return"] - 63
    assert person.where["warm_up"] == {"done": 1, "of": 2}
    assert "has ended" in person.refused("give-up", {"episode": frames[0]["episode"], "step": 2})


def test_next_is_idempotent_and_no_terrain_is_drawn_again(server):
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    first = person.where["about"]
    person.play(moves=1)
    person.call("next")
    assert person.where["about"]["session"] == first["session"]
    assert (person.frame["episode"], person.frame["step"]) == (first["frame"]["episode"], 1)
    url = f"/api/sessions/{first['session']}"
    act = {"episode": first["frame"]["episode"], "step": 1, "action": "south", "input": "key"}
    for path, body, sentence in (
        ("act", act, "its moves come over the socket"),
        ("episodes", {}, "its terrains are the study's"),
        ("pace", {"pause": True}, "no pace"),
    ):
        answer = person.client.post(f"{url}/{path}", json=body)
        assert (answer.status_code, sentence in answer.json()["detail"]) == (409, True)
    assert person.client.get(url).json()["step"] == 1


def test_each_step_out_of_turn_is_refused_in_words(server):
    person = Person(server)
    yes = {"version": "1", "agree": True}
    assert "you are at the consent" in person.refused("next")
    assert "you are at the consent" in person.refused("answers", {"answers": [0, 1, 1]})
    assert "you are at the consent, not at the instructions" in person.refused(
        "advance", {"from": "instructions"}
    )
    assert "the consent text is version '1', not '2'" in person.refused(
        "consent", {**yes, "version": "2"}
    )
    person.call("consent", yes)
    assert "you are at the instructions; this belongs to the consent" in person.refused(
        "consent", yes
    )
    person.call("advance", {"from": "instructions"})
    assert "play the tutorial to its end first" in person.refused("advance", {"from": "tutorial"})
    assert "nothing to give up" in person.refused("give-up", {"episode": "e", "step": 0})
    person.call("next")
    assert "play the tutorial" in person.refused("advance", {"from": "tutorial"})
    person.play()
    person.call("advance", {"from": "tutorial"})
    assert "one choice for each of 3 questions, got 1" in person.refused(
        "answers", {"answers": [0]}, 422
    )
    assert "answer 2 must be 0 to 2, the index of a choice, got 7" in person.refused(
        "answers", {"answers": [0, 1, 7]}, 422
    )
    assert "at least 0" in person.refused("answers", {"answers": [0, 1, -1]}, 422)
    person.call("answers", {"answers": [0, 1, 1]})
    assert person.client.get(f"{person.url}/debrief/0").status_code == 409
    assert "not at the debrief" in person.refused("advance", {"from": "debrief"})
    assert person.where["stage"] == "warm_up"


def test_unknown_things_and_bad_bodies_are_said_in_words(server, tmp_path):
    client = server.client()
    for name in ("none", "..", "A B", "x" * 60):
        assert client.get(f"/api/studies/{name}").status_code == 404
    assert (
        client.post("/api/studies/none/join").json()["detail"]
        == "there is no such study here: check the link"
    )
    freeze(tmp_path / "playground.db-studies", "later")
    assert client.post("/api/studies/later/join").status_code == 201
    stranger = server.client()
    answer = stranger.get("/api/studies/small/me")
    assert (answer.status_code, "have not joined" in answer.json()["detail"]) == (404, True)
    for route in ("next", "withdraw"):
        assert stranger.post(f"/api/studies/small/{route}").status_code == 404
    person = Person(server)
    for route, body, sentence in (
        ("consent", {"version": "1"}, "agree is missing"),
        ("consent", {"version": "1", "agree": "yes"}, "agree must be true or false"),
        ("advance", {"from": "ranked"}, "from must be"),
        ("advance", {"form": "tutorial"}, "unknown field 'form'; the fields are: from"),
        ("settings", {"palette": "pink"}, "palette must be"),
        (
            "settings",
            {"keys": {"north": ["KeyW"], "south": ["KeyW"]}},
            "one key cannot mean two directions",
        ),
        ("join", {"outside_ids": {"PROLIFIC_PID": "x" * 300}}, "at most 201 characters"),
    ):
        assert sentence in person.refused(route, body, 422)
    assert str(tmp_path) not in client.get("/api/studies/none").text


def test_a_draft_and_a_thawed_study_cannot_be_joined_and_tell_no_path(server, tmp_path):
    from humanplay.study.protocol import default_protocol

    folder = Folder(tmp_path / "playground.db-studies")
    folder.create(default_protocol("draft", EnvConfig.of("random", 7)))
    client = server.client()
    answer = client.post("/api/studies/draft/join")
    assert (answer.status_code, "not begun yet" in answer.json()["detail"]) == (409, True)
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    path = folder.path("small") / "protocol.json"
    was = path.read_text()
    path.write_text(was.replace('"ranked":3', '"ranked":1'))
    for route in ("join", "next"):
        refusal = person.refused(route)
        assert "its files have changed" in refusal
        assert str(tmp_path) not in refusal
    with person.socket() as socket:
        socket.act(socket.receive("frame"), "south", input="key")
        assert "cannot go on now" in socket.receive("refused")["reason"]
    assert client.get("/api/studies").json() == []
    assert "its files have changed" in client.get("/api/studies/small").json()["detail"]
    assert client.get("/study/small").status_code == 200
    path.write_text(was)
    assert person.me()["stage"] == "warm_up"


def test_a_closed_study_can_be_read_and_not_played(server, study, tmp_path):
    done, person = Person(server), Person(server)
    done.to_warm_up()
    done.play_on()
    person.to_warm_up()
    person.call("next")
    with person.socket() as socket:
        frame = socket.receive("frame")
        Folder(tmp_path / "playground.db-studies").close("small")
        socket.act(frame, "south", input="key")
        assert "is closed" in socket.receive("refused")["reason"]
    assert "is closed" in person.refused("next")
    assert "is closed" in person.refused("join")
    assert "is closed" in Person(server, joins=False).refused("join")
    assert person.me()["note"].startswith("This study has been closed")
    assert done.me()["ending"]["code"]
    done.call("advance", {"from": "debrief"})
    assert rows(server, "SELECT secret FROM series") == [{"secret": study.secret.hex()}]
    (
        tmp_path / "playground.db-studies" / "small" / "closed.json"
    ).unlink()  # its terrains are public: there is no way back
    assert "is closed" in person.refused("next")


def test_declining_and_withdrawing_end_the_way_and_say_what_is_kept(server):
    shy = Person(server, outside_ids={"PROLIFIC_PID": "shy"})
    assert len(rows(server, "SELECT * FROM identities")) == 1
    shy.call("consent", {"version": "1", "agree": False})
    assert (shy.where["stage"], "did not agree" in shy.where["note"]) == ("withdrawn", True)
    assert rows(server, "SELECT * FROM identities") == []
    assert "the end (withdrawn)" in shy.refused("advance", {"from": "instructions"})
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    person.play(moves=1)
    person.call("withdraw")
    assert person.where["stage"] == "withdrawn"
    assert person.where["participant"] in person.where["note"]
    assert person.frame["outcome"] == "abandoned"
    assert "nothing to withdraw from" in person.refused("withdraw")
    for route in ("next", "consent"):
        person.refused(route, {"version": "1", "agree": True} if route == "consent" else None)
    assert Person(server, client=person.client).where["stage"] == "withdrawn"


def test_settings_are_kept_and_each_change_is_on_record(server):
    person = Person(server)
    assert person.where["settings"] == {
        "modality": None,
        "palette": "standard",
        "keys": None,
        "language": None,
    }
    keys = {"north": ["KeyI"], "east": ["KeyL"], "south": ["KeyK"], "west": ["KeyJ"]}
    person.call("settings", {"modality": "touch", "keys": keys})
    person.call("settings", {"palette": "high-contrast"})
    assert person.me()["settings"] == {
        "modality": "touch",
        "palette": "high-contrast",
        "keys": keys,
        "language": None,
    }
    assert len(rows(server, "SELECT * FROM stage_events WHERE kind = 'settings'")) == 2


def test_a_script_is_a_script_for_ever(server):
    script = Person(server, script="noisy-frontier")
    assert script.where["stage"] == "consent"
    script.to_warm_up()
    script.play_on()
    assert {episode["driver"] for episode in rows(server, "SELECT driver FROM episodes")} == {
        "script"
    }
    assert {step["driver"] for step in rows(server, "SELECT driver FROM steps")} == {"script"}
    (participant,) = rows(server, "SELECT kind, script FROM participants")
    assert tuple(participant.values()) == ("script", "noisy-frontier")
    assert script.client.post(f"{script.url}/join").status_code == 200
    assert "as the script 'noisy-frontier' already" in script.refused("join", {"script": "random"})
    person = Person(server)
    assert "takes part as a person already" in person.refused("join", {"script": "noisy-frontier"})


def test_a_scripts_step_in_a_persons_episode_is_a_deviation_on_record(server):
    person = Person(server)
    person.to_warm_up()
    person.call("next")
    person.play(moves=1)
    person.play(moves=1, input=None)
    person.play(moves=1)
    (row,) = rows(
        server,
        "SELECT e.driver FROM episodes e JOIN series_episodes t ON t.episode_id = e.id WHERE t.phase = 'warm_up'",
    )
    assert row["driver"] == "script"
    noted = rows(server, "SELECT detail FROM stage_events WHERE kind = 'deviation'")
    assert [json.loads(event["detail"])["episode"] for event in noted] == [person.frame["episode"]]
    assert rows(server, "SELECT kind FROM participants") == [{"kind": "human"}]


def test_series_episodes_never_enter_the_playgrounds_own_human_level(server, tmp_path):
    person = Person(server)
    person.to_warm_up()
    person.play_on()
    Folder(tmp_path / "playground.db-studies").close("small")
    client = server.client()
    client.get("/api/studies/small")
    assert len(client.get("/api/episodes").json()) == 6
    assert client.get("/api/episodes?who=human").json() == []
    assert client.get("/api/human-level").json()["figures"] == []
    assert not any(episode["counts"] for episode in client.get("/api/episodes").json())


def test_a_database_that_holds_another_study_of_that_name_is_not_mixed_with_it(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies")
    Person(serve()).server.stop()
    (tmp_path / "playground.db-studies").rename(tmp_path / "former")
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    assert "cannot be played on this server now" in Person(server, joins=False).refused("join")


def test_a_study_without_warm_up_or_outside_ids_goes_from_the_questions_to_the_ranked_rounds(
    serve, tmp_path
):
    freeze(tmp_path / "playground.db-studies", "bare", warm_up=0, ranked=1, outside_ids=(),
           outcomes={"finished": "THANKS"})  # fmt: skip
    person = Person(serve(), "bare", outside_ids={"PROLIFIC_PID": "p"})
    person.to_warm_up()
    assert person.where["stage"] == "ranked"
    person.play_on()
    debrief = person.where["debrief"]
    assert (debrief["policy"], debrief["warm_up_terrains"]) == (None, 0)
    assert person.where["ending"]["code"] == "THANKS"


def test_whoever_withdraws_chooses_whether_what_they_played_is_kept_or_erased(server, study):
    declared = study.protocol.declarations
    for erase, sentence in (
        (False, "is kept without your name. To have it erased, write to"),
        (
            True,
            "You asked that what you had played be erased. The people who run the study do that before",
        ),
    ):
        person = Person(server)
        person.to_warm_up()
        assert person.call("withdraw", {"erase": erase})["stage"] == "withdrawn"
        note = person.me()["note"]
        assert sentence in note
        assert declared.contact.rstrip(".") in note
        assert person.where["participant"] in note
        with closing(Reader.open(server.services.store.path)) as reader:
            listed = list_participants(reader, study.name, server.clock.now_ms(), True)
        (row,) = (row for row in listed if row.label == person.where["participant"])
        assert row.asks_erasure is erase


def test_a_study_that_keeps_episodes_offers_no_erasure(serve, tmp_path):
    freeze(tmp_path / "playground.db-studies", keep_episodes_when_forgotten=True)
    person = Person(serve())
    person.to_warm_up()
    assert person.me()["can_be_erased"] is False
    assert "keeps what was played" in person.refused("withdraw", {"erase": True})
    assert person.call("withdraw", {"erase": False})["stage"] == "withdrawn"
    assert "To have it erased" not in person.me()["note"]


def test_the_consent_text_says_what_is_stored_how_long_by_whom_and_how_it_is_erased(study):
    text, declared = study.protocol.consent.text, study.protocol.declarations
    for part in (
        declared.contact,
        declared.retention,
        "We record every move and every key press",
        "We do not record your name",
        "kept without your name, or it is erased",
        "the name by which this page calls you",
    ):
        assert part in text
