"""The process that works out regrets for a server: `python -m app.moves.worker FOLDER`, episodes in, regrets out.

Each line on stdin is an episode as `record_to_json` writes it; each line on stdout is what `explain` says of it, or
{"error": sentence}. It runs at the lowest priority and ends with its stdin.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from app.play.messages import encode_grid
from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Record
from marsexplorer.evaluation.losses import Loss
from marsexplorer.evaluation.missed import Missed
from marsexplorer.evaluation.regret import RegretEstimator

BIGGEST = 5
"""Losses that are named."""
LEAST_NAMED = 2
"""Moves lost that are worth naming."""


def main() -> None:
    """Answer episodes until stdin ends. The first argument is the folder of the cache."""
    os.nice(19)
    estimator: RegretEstimator | None = None
    for line in sys.stdin:
        try:
            estimator = estimator or RegretEstimator(cache=Path(sys.argv[1]))
            answer = explain(estimator, record_from_json(line))
        except (ValueError, LookupError, OSError, RuntimeError, ModuleNotFoundError) as error:
            answer = {"error": str(error) or type(error).__name__}
        try:
            print(json.dumps(answer, separators=(",", ":")), flush=True)
        except BrokenPipeError:
            os._exit(0)


def record_to_json(record: Record) -> str:
    """Return an episode's cause as one line of JSON."""
    fields = {
        **vars(record),
        "config": record.config.to_dict(),
        "terrain": record.terrain.hex(),
        "actions": record.actions.hex(),
    }
    return json.dumps(fields)


def record_from_json(text: str) -> Record:
    """Return the cause that `record_to_json` wrote."""
    fields = json.loads(text)
    fields |= {"config": EnvConfig(**fields["config"]), "start": tuple(fields["start"])}
    fields |= {name: bytes.fromhex(fields[name]) for name in ("terrain", "actions")}
    return Record(**fields)


def explain(estimator: RegretEstimator, record: Record) -> dict[str, Any]:
    """Return what a page shows of where an episode lost moves: its regret, and the biggest losses with what was missed."""
    found = estimator.regret(record)
    losses = [loss for loss in found.biggest(BIGGEST) if loss.regret >= LEAST_NAMED]
    missed = estimator.missed(record, losses)
    return {
        "total": found.total,
        "given_up": found.given_up,
        "by_kind": {str(kind): lost for kind, lost in found.by_kind().items()},
        "losses": [describe_loss(record, *pair) for pair in zip(losses, missed, strict=True)],
    }


def describe_loss(record: Record, loss: Loss, missed: Missed) -> dict[str, Any]:
    """Return a loss for a page. `step` is the number of moves made before it, `previous` the action of the last of them.

    `grid` and `discovered` are what was known then, as in a frame; the rest is `evaluation.missed.Missed`.
    """
    return {
        "step": loss.step,
        "regret": loss.regret,
        "action": ACTIONS[loss.action],
        "best_action": ACTIONS[loss.best_action],
        "kind": str(loss.kind),
        "previous": ACTIONS[record.actions[loss.step - 1]] if loss.step else None,
        "position": list(missed.position),
        "grid": encode_grid(missed.codes),
        "discovered": missed.discovered,
        "missed": missed.cells.tolist(),
        "seen_at": missed.seen_at,
    }


if __name__ == "__main__":
    main()
