"""Logs of finished trials with numbers that can be checked by hand."""

import json
from dataclasses import asdict

from research.paper.trial import ENDINGS, Trial

RESULT = {"terrains": 10, "first_seed": 10**9, "collisions": 0, "best_rule_steps": 80.0}


def write_trial(folder, trial, scores, result=None, begin=1):
    """Write the log of a trial whose score took these values evenly over its moves, one CPU second for each 100 moves.

    A line stands for 100 episodes. The coverage is the score, a half of what is left of it explores and the rest runs out of
    time; None: no episode had ended.
    """
    lines = [
        {
            "kind": "trial",
            "trial": asdict(trial),
            "settings": {"variant": trial.variant},
            "versions": {"torch": "2"},
        }
    ]
    for number, score in enumerate(scores, begin):
        moves = trial.moves * number // (len(scores) + begin - 1)
        shares = dict.fromkeys(ENDINGS, 0.0) | {
            "explored": score,
            "timed_out": None if score is None else 1 - score,
        }
        means = dict.fromkeys(shares) if score is None else shares
        line = {
            "kind": "curve",
            "moves": moves,
            "cpu_s": moves / 100,
            "episodes": 100 * number,
            "steps": 50.0,
        }
        lines.append({**line, "score": score, "coverage": score, **means})
    end = {
        "score": scores[-1],
        "coverage": scores[-1],
        "completion": scores[-1],
        "steps": 100.0,
        **RESULT,
        **(result or {}),
    }
    lines.append({"kind": "result", "moves": trial.moves, "cpu_s": trial.moves / 100 + 60, **end})
    (folder / trial.name).mkdir(parents=True)
    (folder / trial.name / "log.jsonl").write_text(
        "".join(json.dumps(line) + "\n" for line in lines)
    )


def trial_of(algorithm="ppo", variant="paper", seed=0, level="random", moves=1000):
    """Return a trial on 21x21."""
    return Trial(algorithm, variant, level, 21, seed, moves, 10)
