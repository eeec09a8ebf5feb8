"""What a program counts as that has a valid cookie, Origin and invitation."""

import random
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from humanplay.report.statistics.exclusion_sets import everybody_of, people_of
from humanplay.report.statistics.study_figures import study_figures
from humanplay.study.data import load as load_study
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, token_of
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from humanplay.tasks.mars.run import occupancy_codes
from humanplay.web.simulate import Clock, NoisyPolicy, Participant
from marsexplorer.config import ACTIONS
from marsexplorer.policies import load
from tests.support.keyboard import press
from tests.support.recorded import ask
from tests.support.study import Person, freeze

SIZE = (15, 15)
"""Boards that take more moves than the fewest whose timing is compared."""
KEYS = {"north": "ArrowUp", "east": "ArrowRight", "south": "ArrowDown", "west": "ArrowLeft"}


class Forger:
    """A program that calls its moves keys; `stamps(step)` is a press's stamp or None."""

    def __init__(self, stamps, pace_ms=3.0, real=False):
        self.stamps, self.pace_ms, self.real = stamps, pace_ms, real

    def play(self, socket, clock):
        """Play the board's episode to its end, a move every `pace_ms` of server time."""
        policy = load("frontier-cost")
        policy.reset(1)
        frame = socket.receive("frame")
        while frame["outcome"] is None:
            if self.real:
                time.sleep(self.pace_ms / 1000)
            else:
                clock.skipped_ms += int(self.pace_ms)
            self.move(socket, frame, ACTIONS[policy.act(occupancy_codes(frame))], clock)
            frame = socket.frame_after(frame["step"])
        return frame

    def move(self, socket, frame, action, clock):
        stamp = self.stamps(frame["step"], clock)
        if stamp is None:
            now = clock.page_ms()
            socket.send(
                {"kind": "act", "episode": frame["episode"], "step": frame["step"], "action": action, "input": "key",
                 "key_down_ms": now, "client_ms": now}
            )  # fmt: skip
            return
        press(socket, frame["episode"], frame["step"], action, KEYS[action], stamp)


def forgers(copied):
    """Return the forgers by name; `copied` are the presses of a real episode (ms)."""
    jitter = random.Random(5)
    paces = [jitter.uniform(150, 450) for _ in range(500)]
    human = [sum(paces[:step]) for step in range(500)]
    start = copied[0]

    def replayed(step, clock):
        """Send the copied gaps at the pace at which they were pressed, from now on."""
        if step == 0:
            replayed.began = clock.page_ms()
            return replayed.began
        until = replayed.began + copied[step % len(copied)] - start + (step // len(copied)) * 10_000
        clock.skipped_ms += max(0, int(until - clock.page_ms()) + 1)
        return round(until, 1)

    def hurried(step, clock):
        """Send the time, at most 10 ms after the last press, so that none looks human."""
        hurried.last = clock.page_ms() if step == 0 else min(clock.page_ms(), hurried.last + 10)
        return round(hurried.last, 1)

    return {
        "no events": Forger(lambda step, clock: None, 250),
        "copied events": Forger(lambda step, clock: copied[step % len(copied)], 250),
        "copied gaps, replayed": Forger(replayed, 0),
        "all stamps at once": Forger(lambda step, clock: 5_000.0, 250),
        "a clock that runs ten times as fast": Forger(
            lambda step, clock: round(clock.page_ms() * 10, 1), 30
        ),
        "a person's stamps in a hundredth of the time": Forger(
            lambda step, clock: round(5_000 + human[step], 1), 3
        ),
        "stamps before the frames": Forger(
            lambda step, clock: round(clock.page_ms() - 500 * step, 1), 250
        ),
        "a hundred times a person's speed": Forger(hurried, 3),
    }


def presses_of(path, episode):
    sql = "SELECT key_down_ms FROM steps WHERE episode_id = ? ORDER BY step"
    return [at for (at,) in ask(path, sql, episode)]


def honest_board(server):
    """Return the last frame of a person's ranked episode on the playground."""
    client = server.client(headers={"Origin": server.url})
    begun = client.post("/api/sessions", json={"size": SIZE}).json()
    return server.explore(client, begun["session"])


def counted(server):
    """Return the ids of the episodes that count for the playground's figure."""
    episodes = server.client().get("/api/episodes", params={"who": "human", "limit": 200}).json()
    return {episode["episode"] for episode in episodes}


@pytest.mark.parametrize("times", [1, pytest.param(10, marks=pytest.mark.long)])
def test_no_forger_of_the_playground_counts_as_played_and_the_person_does(server, tmp_path, times):
    honest = honest_board(server)["episode"]
    forged = {}
    for name, forger in times * [*forgers(presses_of(tmp_path / "playground.db", honest)).items()]:
        client = server.client(headers={"Origin": server.url})
        begun = client.post("/api/sessions", json={"size": SIZE}).json()
        assert begun["counts"] is True
        with server.socket(begun["session"], client) as socket:
            forged[name] = forger.play(socket, server.clock)["episode"]
        about = client.get(f"/api/sessions/{begun['session']}/about").json()
        assert about["counts"] is (about["attestation"] == "spoilt"), name
        assert about["not_attested"], name
    spoilt = counted(server) - {honest}
    (figure,) = server.client().get("/api/human-level").json()["figures"]
    whole = (1 + len(spoilt), len(spoilt), len(spoilt))
    assert (figure["episodes"], figure["spoilt"], figure["abandoned"]) == whole


def test_an_episode_with_the_timing_of_another_is_spoilt_and_verified_as_it_is_stored(
    server, tmp_path
):
    levels = []
    for _ in range(2):
        client = server.client(headers={"Origin": server.url})
        begun = client.post("/api/sessions", json={"size": SIZE}).json()
        with server.socket(begun["session"], client) as socket:
            Forger(lambda step, clock: 5_000.0 + 10 * step, 250).play(socket, server.clock)
        levels.append(client.get(f"/api/sessions/{begun['session']}/about").json()["attestation"])
    assert levels == ["spoilt", "spoilt"]
    assert verify_database(tmp_path / "playground.db").findings == ()


def play_forged(person, forger):
    """Let a participant play every warm-up and ranked episode as a forger does."""
    while person.me()["stage"] not in ("debrief", "complete"):
        person.call("next")
        with person.socket() as socket:
            forger.play(socket, person.server.clock)


@pytest.mark.parametrize("times", [1, pytest.param(10, marks=pytest.mark.long)])
def test_no_forger_in_a_study_enters_a_human_score_but_as_one_who_left(server, tmp_path, times):
    small = {"size": SIZE, "ranked": 1, "warm_up": 1, "recruitment": "invitation"}
    study = freeze(tmp_path / "playground.db-studies", **small)
    issued = Invitations(Folder(tmp_path / "playground.db-studies")).issue(
        study.name, 1 + 8 * times
    )
    invitations = iter([token_of(study, invitation.id) for invitation in issued])
    person = Person(server, invitation=next(invitations))
    person.to_warm_up()
    person.play_on()
    path = tmp_path / "playground.db"
    sql = "SELECT episode_id FROM series_episodes WHERE phase = 'ranked' AND trial = 0"
    ((copied,),) = ask(path, sql)
    names = times * [*forgers(presses_of(path, copied))]
    for forger in times * [*forgers(presses_of(path, copied)).values()]:
        other = Person(server, invitation=next(invitations))
        other.to_warm_up()
        play_forged(other, forger)
    data = replace(load_study(path, "small"), closed_ms=1)
    levels = {}
    for trial in data.trials:
        if trial.phase == "ranked":
            levels.setdefault(trial.participant, []).append(trial.attestation)
    counting = [
        name
        for name, attestations in zip(["the person", *names], levels.values(), strict=True)
        if "attested" in attestations
    ]
    assert counting == ["the person"]
    spoilt = sum(attestations == ["spoilt"] for attestations in levels.values())
    assert sum(attestations == ["unattested"] for attestations in levels.values()) + spoilt == len(
        names
    )
    ranked = [trial for trials in people_of(data).ranked.values() for trial in trials]
    assert [trial.outcome for trial in ranked].count("abandoned") == spoilt == len(ranked) - 1
    cohort = people_of(data)
    finished, *_ = study_figures(data, cohort, everybody_of(data, cohort))
    assert finished.players == 1, "the spoilt ones gave up more than half"


@pytest.mark.long
@pytest.mark.parametrize(("speed", "fewest", "most"), [(100.0, 0, 0), (1.0, 18, 20)])
def test_a_program_at_a_persons_speed_is_not_told_apart(server, tmp_path, speed, fewest, most):
    """Measure docs/attestation.md's forgers with honest times; faster, none counts."""
    boards = {"size": (9, 12), "ranked": 2, "warm_up": 1, "players": 10}
    study = freeze(tmp_path / "playground.db-studies", recruitment="invitation", **boards)
    issued = Invitations(Folder(tmp_path / "playground.db-studies")).issue(study.name, 10)

    def take_part(number):
        policy = NoisyPolicy(environment_of("mars"), "frontier-cost", 0.1, None, number)
        forger = Participant(server.page(), study.name, policy, Clock(speed), number)
        forger.call("join", {"invitation": token_of(study, issued[number].id)})
        while forger.me()["stage"] != "complete":
            forger.take_step()

    with ThreadPoolExecutor(10 if speed == 1 else 1) as pool:
        list(pool.map(take_part, range(10)))
    data = replace(load_study(tmp_path / "playground.db", study.name), closed_ms=1)
    levels = Counter(trial.attestation for trial in data.trials if trial.phase == "ranked")
    counted = sum(map(len, people_of(data).ranked.values()))
    print(f"\n{speed:g} times a person's speed: {dict(levels)}, counted {counted} of 20")
    assert levels["attested"] + levels["unattested"] + levels["spoilt"] == 20
    assert fewest <= levels["attested"] <= most
    assert levels["attested"] + levels["spoilt"] == counted
