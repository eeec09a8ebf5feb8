"""Whether somebody's warm-up came to what the protocol asks for."""

from __future__ import annotations

from collections.abc import Iterable

from humanplay.db.trial import Trial
from humanplay.study.protocol import Protocol
from humanplay.study.protocol_parts import Practice
from humanplay.study.wording import Wording
from humanplay.task.sentences import Sentence


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
        if sum(_is_reached(practice, trial) for trial in part) >= practice.episodes_to_pass:
            return True
    return False if tries >= practice.tries else None


def _is_reached(practice: Practice, trial: Trial) -> bool:
    if practice.score is None:
        return trial.succeeded
    return trial.score is not None and trial.score >= practice.score


def criterion(protocol: Protocol, wording: Wording | None = None) -> str:
    """What participants read of the practice; empty where there is none.

    Args:
        wording: Says what the task calls its rounds and its goal; None: in English.
    """
    practice = protocol.practice
    if practice is None:
        return ""
    environment = protocol.environment
    things, reached = environment.texts(protocol.env_config).things, environment.about.words.reached
    if wording is not None:
        things = wording.text("task.things", things)
        reached = wording.text("task.reached", reached)
    ends = _ONE_GOAL if practice.episodes_to_pass == 1 else _GOAL
    if practice.score is not None:
        ends = _ONE_SCORE if practice.episodes_to_pass == 1 else _SCORE
    if protocol.warm_up == 1:
        which = _ONLY.format(thing=things.removesuffix("s"))
    else:
        some = _SOME if practice.episodes_to_pass < protocol.warm_up else _ALL
        which = some.format(number=practice.episodes_to_pass, of=protocol.warm_up, things=things)
    tries = _ONE_TRY if practice.tries == 1 else _TRIES
    return _CRITERION.format(
        which=which,
        goal=ends.format(reached=reached, score=f"{practice.score or 0:g}"),
        tries=tries.format(tries=practice.tries, things=things),
        end=_SCREENED_OUT if practice.if_failed == "screen_out" else _GOES_ON,
    )


_CRITERION = Sentence(
    "practice.criterion", "You pass the practice if {which} {goal}. {tries}; if you fail, {end}."
)
_SOME = Sentence("practice.some", "at least {number} of its {of} {things}")
_ALL = Sentence("practice.all", "all of its {of} {things}")
_ONLY = Sentence("practice.only", "its {thing}")
_GOAL = Sentence("practice.goal", "end as “{reached}”")
_ONE_GOAL = Sentence("practice.one_goal", "ends as “{reached}”")
_SCORE = Sentence("practice.score", "score {score} or more")
_ONE_SCORE = Sentence("practice.one_score", "scores {score} or more")
_ONE_TRY = Sentence("practice.one_try", "You have 1 try")
_TRIES = Sentence("practice.tries", "You have {tries} tries, each on other {things}")
_SCREENED_OUT = Sentence("practice.screened_out", "the study ends for you")
_GOES_ON = Sentence("practice.goes_on", "you go on all the same")
