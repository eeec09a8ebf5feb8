"""What a study does with an episode, done once before people play."""

from __future__ import annotations

import random
from pathlib import Path
from tempfile import TemporaryDirectory

from humanplay.db.trial import Trial
from humanplay.release.errors import ReleaseError
from humanplay.release.minari_data import datasets_in, write_plays
from humanplay.study.protocol import Protocol, StudyError
from humanplay.task import counted

MOST_MOVES = 200
SEED = 2**53 - 1
"""Of the rehearsed instance: a study draws it once in 2^53 times."""


def rehearse(protocol: Protocol) -> str:
    """Play an episode at random, replay it, write it as a data set and say so.

    Raises:
        StudyError: Something of it fails.
    """
    environment, config = protocol.environment, protocol.env_config
    dice = random.Random(SEED)
    try:
        run = environment.run(config, SEED)
        for _ in range(MOST_MOVES):
            if run.ended:
                break
            allowed = (run.allowed() or [None])[-1] or range(len(environment.actions))
            run.step(dice.choice(allowed))
        if not run.ended:
            run.abandon()
        record = run.record()
        environment.frames(record, "rehearsal")
        terrain, start = environment.instance(config, SEED)
        trial = Trial(
            id="rehearsal",
            session_id="rehearsal",
            number=0,
            task=protocol.task,
            core_version=environment.version,
            config=config,
            seed=SEED,
            seed_chosen=False,
            terrain=terrain,
            start=start,
            policy_seed=0,
            driver="human",
            assisted=False,
            started_ms=0,
            outcome=record.outcome,
        )
        with TemporaryDirectory() as folder, datasets_in(Path(folder)):
            plays = [(trial, environment.replay_record(record))]
            written = write_plays("rehearsal/rehearsal-v0", plays)
    except ReleaseError as error:  # a library of [export] is not installed
        return f"a rehearsed episode was recorded and replayed, not written as a data set: {error}"
    except Exception as error:  # an environment of somebody's own may raise anything
        raise StudyError(
            f"the study {protocol.name!r} cannot be frozen: a rehearsed episode failed: {error}"
        ) from error
    moves = counted(len(record.actions), "move")
    if not written:
        return f"a rehearsed episode of {moves} was recorded and replayed, and is too short for a data set"
    return f"a rehearsed episode of {moves} was recorded, replayed and written as a data set"
