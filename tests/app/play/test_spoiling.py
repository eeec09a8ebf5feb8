"""A person's episode that is spoilt counts as abandoned; what fails on the server's side spoils nothing."""

import json
import sqlite3
from contextlib import closing

import pytest

from humanplay.db.reader import Reader
from humanplay.db.store import Closing, Store
from humanplay.db.trial import Trial
from humanplay.db.volunteers import players_of
from humanplay.study.verification import verify_database
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from tests.support.recorded import add_session, add_steps, open_episode, tour

SIZE = (9, 12)
CONFIG = EnvConfig.of("random", SIZE)


def drive(server, spoil=None, at=4):
    """Play a ranked episode to its end as a person does, but for `spoil(socket, frame, action)` at one step."""
    client = server.page()
    begun = client.post("/api/sessions", json={"size": SIZE}).json()

    def instead(socket, frame, action):
        return spoil is not None and frame["step"] == at and spoil(socket, frame, action)

    frame = server.explore(client, begun["session"], instead)
    return client, begun["session"], frame


def without_press(socket, frame, action):
    socket.send({"kind": "act", "episode": frame["episode"], "step": frame["step"], "action": action,
                 "input": "key", "key_down_ms": 7.0, "client_ms": 7.0})  # fmt: skip
    return True


def by_script(socket, frame, action):
    socket.send(
        {"kind": "act", "episode": frame["episode"], "step": frame["step"], "action": action}
    )
    return True


@pytest.mark.parametrize("spoil", [without_press, by_script])
def test_a_ranked_episode_that_is_spoilt_counts_as_abandoned_and_one_never_begun_by_hand_does_not(
    server, spoil
):
    drive(server)
    client, session, frame = drive(server, spoil)
    drive(server, spoil, at=0)
    about = client.get(f"/api/sessions/{session}/about").json()
    assert (about["counts"], about["attestation"]) == (True, "spoilt")
    (figure,) = server.client().get("/api/human-level").json()["figures"]
    assert (figure["players"], figure["episodes"], figure["spoilt"]) == (2, 2, 1)
    assert figure["abandoned"] == 1
    stored = server.services.store.find_episode(frame["episode"]).episode
    with closing(Reader.open(server.services.store.path)) as reader:
        sums = sorted(players_of(reader, CONFIG.hash))
    (own,) = (each for each in sums if each.spoilt)
    assert stored.forfeited().steps_to_target == CONFIG.limit == own.steps > own.played_steps
    assert own.score < own.played_score
    assert [each.failed for each in sums] == [each.spoilt for each in sums]
    assert "1 spoilt" in server.client().get("/api/human-level").json()["sentence"]
    assert verify_database(server.services.store.path).findings == ()


def test_a_spoilt_episode_is_worth_what_giving_it_up_at_its_end_is():
    episode = Episode.begin(CONFIG, seed=3)
    whole = tour(episode)
    for action in whole:
        episode.step(action)
    given_up = Episode.begin(CONFIG, seed=3)
    for action in whole[:-1]:
        given_up.step(action)
    given_up.abandon()
    record, given = episode.record(), given_up.record()
    trial = Trial(
        id="one", session_id="s", number=0, task="mars", core_version=record.core_version, config=CONFIG, seed=3,
        seed_chosen=False, terrain=record.terrain, start=record.start, policy_seed=1, driver="human", assisted=False,
        started_ms=1, ended_ms=2, outcome=record.outcome, steps=record.steps, discovered=record.discovered, total=record.total,
        score=record.score, attestation="spoilt",
    )  # fmt: skip
    last = episode.rewards[-1] - CONFIG.r_bonus
    cells = CONFIG.n + CONFIG.r_invalid + CONFIG.r_bonus
    assert trial.forfeited().score == pytest.approx(given.score + last / cells)
    nothing = Episode.begin(CONFIG, seed=3)
    nothing.abandon()
    assert nothing.score == 0, "what intention to treat counts a terrain as that was not begun"


def test_choosing_what_to_spoil_gains_no_step(tmp_path):
    """Of twenty episodes the worse half is spoilt: the figure is that of the same player who left them."""
    figures = []
    for how in ("as played", "left", "spoilt"):
        with closing(Store(tmp_path / f"{how}.db")) as store:
            moves = sorted(_play(store, seed, "as played") for seed in range(20))
        with closing(Store(tmp_path / f"{how} half.db")) as store:
            for seed in range(20):
                made = _play(store, seed, how, worse_than=moves[9])
                assert made
            with closing(Reader.open(store.path)) as reader:
                (own,) = players_of(reader, CONFIG.hash)
                figures.append(own.steps / own.episodes)
    played, left, spoilt = figures
    assert spoilt == left > played


def _play(store, seed, how, worse_than=10**9):
    """Play a ranked episode as "ada" and return its moves; those that take more than `worse_than` end as `how` says."""
    row, episode = open_episode(store, add_session(store), seed, CONFIG)
    whole = tour(episode)
    is_bad = len(whole) > worse_than
    if is_bad and how == "left":
        add_steps(store, row, episode, whole[:-1])
        episode.abandon()
        store.next_episode(
            [Closing(row.id, episode.record(), row.started_ms + 10**6, "attested")], ()
        )
    elif is_bad and how == "spoilt":
        add_steps(store, row, episode, whole[:-1])
        add_steps(store, row, episode, whole[-1:], level="spoilt")
    else:
        add_steps(store, row, episode, whole)
    return len(whole)


def test_a_press_that_could_not_be_written_refuses_its_move_and_spoils_nothing(server):
    """Another program lets every write of input events fail for a while."""
    path = server.services.store.path

    def fails_once(socket, frame, action):
        with closing(sqlite3.connect(path, timeout=20)) as other:
            other.execute(
                "CREATE TRIGGER full BEFORE INSERT ON input_events BEGIN SELECT RAISE(ABORT, 'full'); END"
            )
            socket.act(frame, action, input="key")
            assert "nothing has changed" in socket.receive("error")["detail"]
            other.execute("DROP TRIGGER full")
        return False

    client, session, _ = drive(server, fails_once)
    about = client.get(f"/api/sessions/{session}/about").json()
    assert (about["counts"], about["not_attested"]) == (True, None), json.dumps(about)
