"""Where an episode lost moves, as a page shows it: worked out as a job, so no move waits for one."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.jobs import Jobs
from app.tasks.mars.run import encode_grid
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Record
from marsexplorer.evaluation.losses import Loss
from marsexplorer.evaluation.missed import Missed
from marsexplorer.evaluation.regret import EpisodeRegret, RegretEstimator, check_size

BIGGEST = 5
"""Losses that are named."""
LEAST_NAMED = 2
"""Moves lost that are worth naming."""
LIMIT_S = 120.0
"""Seconds that one episode may take."""


async def explanation_of(jobs: Jobs, cache: Path, record: Record, owner: str) -> dict[str, Any]:
    """Return what `explain` says of a finished episode; the regret is kept in the folder `cache`.

    Whoever asks has checked that the asker may see the episode; `owner` is whose turn the job has. ValueError for a board that
    is too large or an episode that cannot be replayed; JobError and JobsFullError as `Jobs` raises them.
    """
    check_size(record.config)
    key = ("regret", record.config.hash, record.terrain, record.trajectory_hash)
    return await jobs.run(explain, cache, record, owner=owner, key=key, limit_s=LIMIT_S)


@lru_cache(1)
def _estimator(cache: Path) -> RegretEstimator:
    return RegretEstimator(cache=cache)


def explain(cache: Path, record: Record) -> dict[str, Any]:
    """Return what a page shows of where an episode lost moves: its regret, the biggest losses with what was
    missed, and what the policy would have done at each move.

    cache  the folder that regrets are kept in
    """
    estimator = _estimator(cache)
    found = estimator.regret(record)
    losses = [loss for loss in found.biggest(BIGGEST) if loss.regret >= LEAST_NAMED]
    missed = estimator.missed(record, losses)
    return {
        "total": found.total,
        "given_up": found.given_up,
        "by_kind": {str(kind): lost for kind, lost in found.by_kind().items()},
        "losses": [describe_loss(record, *pair) for pair in zip(losses, missed, strict=True)],
        "expert": describe_expert(found, estimator.shares(record), record.config.limit),
    }


def describe_expert(
    found: EpisodeRegret, shares: NDArray[np.float32], limit: int
) -> list[dict[str, Any]]:
    """Return for each move what the policy would have done instead.

    shares  of ACTIONS, before the move; `action` is the one of the greatest
    needs   moves from there to the end, the policy playing on; None where it does not get there within the limit
    costs   moves that the move made needs more, below 0 for fewer; None where one of the two does not get there
    """
    steps = np.arange(len(shares))
    chosen = shares.argmax(1)
    own, made = found.lengths[steps, chosen], found.lengths[steps, found.actions]
    return [
        {
            "shares": [round(float(share), 3) for share in shares[step]],
            "action": ACTIONS[chosen[step]],
            "needs": int(own[step]) - step if own[step] < limit else None,
            "costs": int(made[step] - own[step]) if max(own[step], made[step]) < limit else None,
        }
        for step in steps.tolist()
    ]


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
