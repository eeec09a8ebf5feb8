"""Logs of finished trials with numbers that can be checked by hand."""

from dataclasses import asdict

from research.paper.jobs import write_lines
from research.paper.trial import ENDINGS, Trial

RESULT = {"terrains": 10, "first_seed": 10**9, "collisions": 0, "best_rule_steps": 80.0}


def write_trial(folder, trial, scores, result=None, begin=1):
    """Write the log of a trial whose score took these values evenly over its moves.

    One CPU second for each 100 moves.

    A line stands for 100 episodes. The coverage is the score, a half of what is left of it explores
    and the rest runs out of time; None: no episode had ended.
    """
    head = {"trial": asdict(trial), "settings": {"variant": trial.variant}}
    lines = [{"kind": "trial", **head, "versions": {"torch": "2"}, "hardware": "a CPU"}]
    for number, score in enumerate(scores, begin):
        moves = trial.moves * number // (len(scores) + begin - 1)
        shares = dict.fromkeys(ENDINGS, None if score is None else 0.0)
        if score is not None:
            shares |= {"explored": score, "timed_out": 1 - score}
        line = {"kind": "curve", "moves": moves, "cpu_s": moves / 100, "episodes": 100 * number}
        lines.append({**line, "steps": 50.0, "score": score, "coverage": score, **shares})
    end = dict.fromkeys(("score", "coverage", "completion"), scores[-1]) | {"steps": 100.0}
    spent = {"moves": trial.moves, "cpu_s": trial.moves / 100 + 60}
    lines.append({"kind": "result", **spent, **end, **RESULT, **(result or {})})
    write_lines(folder / trial.name / "log.jsonl", lines)


def trial_of(algorithm="ppo", variant="paper", seed=0, level="random", moves=1000):
    """Return a trial on 21x21."""
    return Trial(algorithm, variant, level, 21, seed, moves, 10)
