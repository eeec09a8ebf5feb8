"""A person's spoilt episode counts as abandoned; a server's fault spoils nothing."""

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
    """Play a ranked episode as a person, but for `spoil(socket, frame, action)` once."""
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
    (spoilt_sums,) = (player for player in sums if player.spoilt)
    assert (
        stored.forfeited().steps_to_target
        == CONFIG.limit
        == spoilt_sums.steps
        > spoilt_sums.played_steps
    )
    assert spoilt_sums.score < spoilt_sums.played_score
    assert [player.failed for player in sums] == [player.spoilt for player in sums]
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
    record, given_up_record = episode.record(), given_up.record()
    trial = Trial(
        id="one", session_id="s", number=0, task="mars", core_version=record.core_version, config=CONFIG, seed=3,
        seed_chosen=False, terrain=record.terrain, start=record.start, policy_seed=1, driver="human", assisted=False,
        started_ms=1, ended_ms=2, outcome=record.outcome, steps=record.steps, discovered=record.discovered, total=record.total,
        score=record.score, attestation="spoilt",
    )  # fmt: skip
    last = episode.rewards[-1] - CONFIG.r_bonus
    cells = CONFIG.n + CONFIG.r_invalid + CONFIG.r_bonus
    assert trial.forfeited().score == pytest.approx(given_up_record.score + last / cells)
    nothing = Episode.begin(CONFIG, seed=3)
    nothing.abandon()
    assert nothing.score == 0, "what intention to treat counts a terrain as that was not begun"


def test_choosing_what_to_spoil_gains_no_step(tmp_path):
    """Spoiling the worse half of twenty episodes gives the figure of leaving it."""
    figures = []
    for how in ("as played", "left", "spoilt"):
        with closing(Store(tmp_path / f"{how}.db")) as store:
            moves = sorted(_play(store, seed, "as played") for seed in range(20))
        with closing(Store(tmp_path / f"{how} half.db")) as store:
            for seed in range(20):
                moves_made = _play(store, seed, how, worse_than=moves[9])
                assert moves_made
            with closing(Reader.open(store.path)) as reader:
                (sums,) = players_of(reader, CONFIG.hash)
                figures.append(sums.steps / sums.episodes)
    played, left, spoilt = figures
    assert spoilt == left > played


def _play(store, seed, how, worse_than=10**9):
    """Play a ranked episode as "ada"; return its moves.

    Those that take more than `worse_than` end as `how` says.
    """
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
