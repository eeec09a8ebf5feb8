"""Whether somebody's warm-up came to what the protocol asks for."""

from __future__ import annotations

from collections.abc import Iterable

from humanplay.db.trial import Trial
from humanplay.study.protocol import Practice, Protocol
from humanplay.task import counted


def has_passed(protocol: Protocol, trials: Iterable[Trial]) -> bool | None:
    """Whether somebody passed the practice; None while that is open.

    Args:
        trials: Of one participant; those of the warm-up count, whoever drove them.
    """
    practice = protocol.practice
    if practice is None:
        return None
    ended = [trial for trial in trials if trial.phase == "warm_up" and trial.outcome is not None]
    ended.sort(key=lambda trial: trial.trial)
    tries = len(ended) // protocol.warm_up
    for number in range(tries):
        part = ended[number * protocol.warm_up : (number + 1) * protocol.warm_up]
        if sum(_is_reached(practice, trial) for trial in part) >= practice.reach:
            return True
    return False if tries >= practice.tries else None


def _is_reached(practice: Practice, trial: Trial) -> bool:
    if practice.score is None:
        return trial.succeeded
    return trial.score is not None and trial.score >= practice.score


def criterion(protocol: Protocol) -> str:
    """What participants read of the practice; empty where there is none."""
    practice = protocol.practice
    if practice is None:
        return ""
    environment, config = protocol.environment, protocol.env_config
    things, s = environment.texts(config).things, "s" if practice.reach == 1 else ""
    some = f"at least {practice.reach}" if practice.reach < protocol.warm_up else "all"
    which = f"{some} of its {protocol.warm_up} {things}"
    if protocol.warm_up == 1:
        which = f"its {things.removesuffix('s')}"
    goal = f"end{s} as “{environment.about.words.reached}”"
    if practice.score is not None:
        goal = f"score{s} {practice.score:g} or more"
    tries = f"You have {counted(practice.tries, 'try', 'tries')}"
    if practice.tries > 1:
        tries += f", each on other {things}"
    end = "the study ends for you" if practice.then == "screen_out" else "you go on all the same"
    return f"You pass the practice if {which} {goal}. {tries}; if you fail, {end}."
