"""Small studies in real databases, written with the store and plain inserts."""

from __future__ import annotations

import itertools
import json
import random
import secrets
from contextlib import contextmanager
from functools import partial

import pytest

from humanplay.db import chain
from humanplay.db.series import StudyStore, add_series
from humanplay.db.store import Closing, SessionRow, StepRow, Store, Trial
from humanplay.db.study_rows import Participant
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.protocol_parts import Power
from humanplay.study.seeds import TUTORIAL_SEED, order_group
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.episode import Episode
from tests.support.declared import DECLARATIONS

_fields = itertools.count()
CONFIG = EnvConfig("random", 7, 9, sensor_radius=3)
BEGAN = 1_790_000_000_000
PAGE_BEGAN = BEGAN - 60_000
UNEVEN_MS = (100, 170, 90, 240, 130)
"""Between moves: nobody presses as evenly as a clock."""
KEYS = ("ArrowUp", "ArrowRight", "ArrowDown", "ArrowLeft")
"""By action: what a participant presses."""
IDENTITIES = {"PROLIFIC_PID": "5f3e9prolific{}zz", "SESSION_ID": "outside-session-{}"}
"""What must never be found in a release, by participant."""


@contextmanager
def freezing_at(at_ms):
    """Studies that are frozen within the block are so at this time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("humanplay.study.folder.now_ms", lambda: at_ms)
        yield


def freeze(root, name="dunes", close=True, config=CONFIG, draw=secrets.token_bytes, **rest):
    """A study of 2 + 3 episodes, registered before people come.

    It is closed unless `close` is False. `draw` gives its secret, `power` what was planned.
    """
    folder = Folder(root)
    planned = {"power": Power(**rest.pop("power"))} if "power" in rest else {}
    fields = {
        "warm_up": 2,
        "ranked": 3,
        "players": 3,
        "policies": ("random",),
        "debrief_policy": "random",
        "declarations": DECLARATIONS,
        "outside_ids": ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID"),
        **rest,
    }
    folder.create(default_protocol(name, config, **fields))
    with freezing_at(BEGAN):
        study = folder.freeze(name, draw=draw, planned=planned)
    return folder.close(name) if close else study


class StudyRecorder:
    """Records participants who play a study into a store."""

    def __init__(self, path, study):
        self.path, self.study = path, study
        self.store = Store(path)
        self.conn = self.store.connection
        self.clock = BEGAN
        self.random = random.Random(next(_fields))
        self.store.secret()
        add_series(self.store, study.row())

    def insert(self, table, *values):
        return self.conn.execute(
            f"INSERT OR IGNORE INTO {table} VALUES ({','.join('?' * len(values))})", values
        ).rowcount

    def tick(self, ms=100):
        self.clock += ms
        return self.clock

    def token(self):
        return self.random.randbytes(16).hex()

    def join(self, number, kind="human", stage="complete", consent=True, outside=IDENTITIES):
        """Add a participant with identity, stage events and session; return the id."""
        participant, player, session = (
            self.token(),
            f"player-{self.token()}",
            f"session-{self.token()}",
        )
        now = self.tick(1000)
        self.store.add_player(player, now)
        self.store.add_session(SessionRow(session, player, "human", None, "follow", 2.0, now))
        done = stage in ("debrief", "complete")
        row = Participant(
            id=participant,
            study=self.study.name,
            player_id=player,
            session_id=session,
            kind=kind,
            script="noisy-frontier" if kind == "script" else None,
            stage=stage,
            consent_version="1" if consent else None,
            consent_ms=now + 1 if consent else None,
            joined_ms=now,
            completed_ms=now + 9 if done else None,
            completion_code=f"CODE-{number}-{self.token()[:6]}",
            settings=json.dumps({"modality": "keyboard"}),
        )
        self.insert("participants", *vars(row).values())
        for name, template in outside.items():
            self.insert("identities", participant, name, template.format(number))
        for event, kind_of in enumerate(("joined", "stage", "answers")):
            self.insert(
                "stage_events",
                participant,
                event,
                now + event,
                kind_of,
                json.dumps({"session": session, "n": event}),
            )
        chain.append(self.conn, "participant", participant)
        if self.study.protocol.arms:
            draw = partial(self.study.arm, kind)
            StudyStore(self.store).assign_arm(row, now, draw)
        return participant

    def _order(self, participant):
        """The order of the ranked terrains for a participant, as a server gives it."""
        study, studies = self.study, StudyStore(self.store)
        person = studies.participant(participant)
        group = order_group(person.kind, studies.arm(person.id))
        return study.balanced_order(group, studies.order_number(person, self.clock))

    def play(self, participant, phase, trial, how="tour", spoil=None):
        """Return the id of an episode.

        how  a tour to its end, a `crash`, given up (`abandon`, `dawdle`, `idle`), left `open`, or a
             function from the episode at its start to its moves
        spoil  the step whose move has no press
        """
        study = self.study
        if phase == "tutorial":
            terrain, seed = 0, TUTORIAL_SEED
        elif phase == "warm_up":
            terrain, seed = trial, study.seed("warm-up", trial)
        else:
            terrain = self._order(participant)[trial]
            seed = study.seed("ranked", terrain)
        (session, kind) = self.conn.execute(
            "SELECT session_id, kind FROM participants WHERE id = ?", [participant]
        ).fetchone()
        driver = "human" if kind == "human" else "script"
        (number,) = self.conn.execute(
            "SELECT count(*) FROM episodes WHERE session_id = ?", [session]
        ).fetchone()
        config = study.protocol.env_config
        episode = Episode.begin(config, seed=seed)
        ident = f"episode-{self.token()[:12]}"
        row = Trial(
            id=ident,
            session_id=session,
            number=number,
            task="mars",
            core_version=CORE_VERSION,
            config=config,
            seed=seed,
            seed_chosen=False,
            terrain=episode.record().terrain,
            start=episode.start,
            policy_seed=3,
            driver=driver,
            assisted=False,
            started_ms=self.tick(),
        )
        self.store.next_episode((), [row])
        self.insert("series_episodes", ident, study.name, participant, None, phase, trial, terrain)
        self._events(ident, 0, 0)
        self.tick()
        for action in self._actions(episode, how):
            frame, pressed_ms = episode.steps, self.page_ms()
            reward = episode.step(action)
            input_kind = "key" if driver == "human" else None
            if frame != spoil:
                self._events(ident, 2 * episode.steps, frame, KEYS[action])
            step = StepRow(
                episode_id=ident,
                step=episode.steps - 1,
                action=action,
                reward=reward,
                discovered=episode.discovered,
                server_ms=self.tick(UNEVEN_MS[frame % len(UNEVEN_MS)]),
                client_ms=pressed_ms + 1.5,
                key_down_ms=pressed_ms,
                key_up_ms=pressed_ms + 80.25,
                input=input_kind,
                driver=driver,
            )
            self.store.add_step(step)
        if episode.ended:
            missing = f"step {spoil}: no press of its own was received before the move"
            level = ("attested", None) if spoil is None else ("spoilt", missing)
            self.store.next_episode([Closing(ident, episode.record(), self.clock, *level)], ())
        if how in ("abandon", "dawdle", "idle") and not episode.ended:
            episode.abandon()
            self.store.next_episode([Closing(ident, episode.record(), self.tick(), "attested")], ())
        self.tick()
        self._events(ident, 1000, episode.steps)
        return ident

    def page_ms(self):
        """Return the time on the clock of the participant's page."""
        return self.clock - PAGE_BEGAN + 0.25

    def _events(self, ident, number, step, code="ArrowUp"):
        for extra, kind in enumerate(("keydown", "keyup")):
            row = (
                ident,
                number + extra,
                0,
                0,
                kind,
                code,
                0,
                1,
                self.page_ms() + extra,
                step,
                12.5,
                self.clock,
            )
            self.insert("input_events", *row)
        chain.append_late_events(self.conn, ident, number)

    def _actions(self, episode, how):
        if callable(how):
            return how(episode)
        if how == "idle":
            return []
        if how in ("abandon", "open"):
            return _there_and_back(episode)
        if how == "crash":
            return [0]
        if how == "dawdle":
            return _there_and_back(episode) * (episode.config.limit // 4)
        return _tour(episode)

    def close(self):
        self.store.close()


def write_chain_anew(conn):
    """Forge a chain of the rows as they are now, as an owner of the file could."""
    for table in ("chain", "chain_salts"):
        conn.execute(f"DELETE FROM {table}")
    chain.append_all(conn, chain.things(conn))
    chain.append_marks(conn)


def _there_and_back(episode):
    return [1, 3] if not episode.terrain[0, 1] else [2, 0]


def _tour(episode):
    from marsexplorer.policies import load

    config = episode.config
    policy, twin = (
        load("frontier-cost", config.sensor_radius),
        Episode.begin(config, seed=episode.seed),
    )
    policy.reset(0)
    while not twin.ended:
        twin.step(policy.act(twin.observation()))
    return list(twin.actions)


def play_study(path, study, kinds=("human", "human", "script"), first=0):
    """Play a study with every sort of ending, close its file; return the ids."""
    recorder = StudyRecorder(path, study)
    people = []
    for number, kind in enumerate(kinds, first):
        person = recorder.join(number, kind)
        people.append(person)
        recorder.play(person, "tutorial", 0, "idle" if number == 1 else "abandon")
        for trial in range(study.protocol.warm_up):
            recorder.play(person, "warm_up", trial, "crash" if trial else "tour")
        for trial in range(study.protocol.ranked):
            recorder.play(person, "ranked", trial, "abandon" if number == trial == 0 else "tour")
    recorder.close()
    return people
