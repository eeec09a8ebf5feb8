"""Studies made from numbers: participants and trials with a test's own scores."""

import numpy as np

from humanplay.db.rows import StageEvent
from humanplay.db.trial import Trial
from humanplay.report.model import PolicyRun
from humanplay.study.data import Person, StudyData
from humanplay.study.protocol import default_protocol, protocol_hash
from marsexplorer.config import CORE_VERSION, EnvConfig
from tests.support.declared import DECLARATIONS

CONFIG = EnvConfig("random", 7, 9, sensor_radius=3)
FROZEN_MS = 1_790_000_000_000


def protocol(**rest):
    """Return a protocol of six ranked episodes and no warm-up."""
    return default_protocol(
        "made",
        CONFIG,
        **{
            "warm_up": 0,
            "ranked": 6,
            "players": 4,
            "policies": ("random",),
            "declarations": DECLARATIONS,
            **rest,
        },
    )


def person(number, kind="human", script=None, stage="complete", completed=True, events=()):
    """The participant of a number, who joined so many seconds after registration."""
    joined = FROZEN_MS + 1000 * number
    done = joined + 500 if completed else None
    return Person(
        id=f"{number:032x}",
        kind=kind,
        script=script,
        stage=stage,
        joined_ms=joined,
        consent_version="1",
        completed_ms=done,
        settings={},
        events=tuple(StageEvent(*event) for event in events),
    )


def trial(who, index, score=0.9, steps=20, **rest):
    """A finished ranked episode of a person; `rest` replaces fields."""
    fields = {
        "participant": who.id,
        "kind": who.kind,
        "phase": "ranked",
        "trial": index,
        "terrain_index": index,
        "id": f"{who.id}-{index}",
        "session_id": who.id,
        "number": index,
        "task": "mars",
        "core_version": CORE_VERSION,
        "config": CONFIG,
        "seed_chosen": False,
        "terrain": b"",
        "start": (0, 0),
        "policy_seed": 0,
        "assisted": False,
        "driver": who.kind,
        "outcome": "explored",
        "steps": steps,
        "score": score,
        "total": 0.0,
        "discovered": 63,
        "started_ms": FROZEN_MS,
        "ended_ms": FROZEN_MS + 30_000,
        "active_ms": 30_000.0,
        "trajectory_hash": "0" * 64,
        "seed": 1000 + index,
        "attestation": "attested" if who.kind == "human" else None,
        **rest,
    }
    return Trial(**fields)


def study(people=(), trials=(), closed=True, **rest):
    """The StudyData of people and trials."""
    frozen = protocol(**rest)
    closed_ms = FROZEN_MS + 10_000_000 if closed else None
    return StudyData(
        protocol=frozen,
        protocol_hash=protocol_hash(frozen),
        commitment="c" * 64,
        frozen_ms=FROZEN_MS,
        closed_ms=closed_ms,
        secret=None,
        people=tuple(people),
        trials=tuple(trials),
    )


def played(scores, kind="human", script=None, first=0, steps=None, **rest):
    """People (or bots) and their trials, a row of `scores` each; NaN if not played."""
    people, trials = [], []
    for number, row in enumerate(np.asarray(scores, float), first):
        whole = not np.isnan(row).any()
        who = person(number, kind, script, completed=whole, stage="complete" if whole else "ranked")
        people.append(who)
        for index, score in enumerate(row):
            if not np.isnan(score):
                count = (
                    20 + number % 10 + index if steps is None else int(steps[number - first][index])
                )
                trials.append(trial(who, index, float(score), count, **rest))
    return people, trials


def run(name, score, steps=None, outcome="explored"):
    """Return a policy's run with these values."""
    score = np.asarray(score, float)
    steps = np.full(len(score), 30.0) if steps is None else np.asarray(steps, float)
    return PolicyRun(name, score, steps, tuple(outcome for _ in score))
