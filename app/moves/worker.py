"""The process that works out regrets for a server: `python -m app.moves.worker FOLDER`, episodes in, regrets out.

Each line on stdin is an episode as `record_to_json` writes it; each line on stdout is what `describe_regret` says of it, or
{"error": sentence}. It runs at the lowest priority and ends with its stdin.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from marsexplorer.config import ACTIONS, EnvConfig
from marsexplorer.episode import Record
from marsexplorer.evaluation.regret import EpisodeRegret, RegretEstimator

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
            answer = describe_regret(estimator.regret(record_from_json(line)))
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


def describe_regret(found: EpisodeRegret) -> dict[str, Any]:
    """Return what a page shows of an episode's regret; `step` is the number of moves made before the loss."""
    losses = [loss for loss in found.biggest(BIGGEST) if loss.regret >= LEAST_NAMED]
    return {
        "total": found.total,
        "given_up": found.given_up,
        "by_kind": {str(kind): lost for kind, lost in found.by_kind().items()},
        "losses": [
            {
                "step": loss.step,
                "regret": loss.regret,
                "action": ACTIONS[loss.action],
                "best_action": ACTIONS[loss.best_action],
                "kind": str(loss.kind),
            }
            for loss in losses
        ],
    }


if __name__ == "__main__":
    main()
