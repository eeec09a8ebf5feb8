"""What the moves of an episode cost, as a page shows it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from humanplay.tasks.mars.run import encode_grid
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Record
from marsexplorer.evaluation.cost import CostEstimator, EpisodeCosts, check_judged, counted_moves
from marsexplorer.evaluation.missed import MissedCells
from marsexplorer.evaluation.mistakes import Mistake

MOST_NAMED = 5
"""Mistakes that are named, at most."""
LEAST_COST = 2
"""Moves that a mistake costs to be named, at least."""


@lru_cache(4)
def _estimator(expert: str, cache: Path) -> CostEstimator:
    return CostEstimator(expert, cache)


def explain(cache: Path, record: Record, expert: str) -> dict[str, object]:
    """Compare an episode with Expert's: moves, their cost, the greatest mistakes.

    On boards where no move is judged it says so, beside the lengths of the two episodes.

    cache   the folder that costs are kept in
    expert  name or path of Expert's file
    """
    estimator = _estimator(expert, cache)
    try:
        check_judged(record.config)
    except ValueError as error:
        return explain_without_costs(record, str(error), estimator.expert_moves(record))
    costs = estimator.costs(record)
    mistakes = [mistake for mistake in costs.biggest(MOST_NAMED) if mistake.cost >= LEAST_COST]
    missed = estimator.missed(record, mistakes)
    return {
        "reason": None,
        "counts": costs.counts,
        "expert_moves": costs.expert_moves,
        "total": costs.total,
        "given_up": costs.without_move,
        "gained": costs.gained,
        "by_kind": {str(kind): moves for kind, moves in costs.by_kind().items()},
        "mistakes": [
            describe_mistake(record, *pair) for pair in zip(mistakes, missed, strict=True)
        ],
        "expert": describe_expert(costs, record.config.limit),
    }


def explain_without_costs(
    record: Record, reason: str, expert_moves: int | None = None
) -> dict[str, object]:
    """Compare an episode with Expert's where no move is judged: only the lengths.

    `reason` says why; `expert_moves` is None if Expert's file is missing.
    """
    counts = counted_moves(record)
    return {
        "reason": reason,
        "counts": counts,
        "expert_moves": expert_moves,
        "total": None if expert_moves is None else counts - expert_moves,
        "given_up": None,
        "gained": None,
        "by_kind": {},
        "mistakes": [],
        "expert": [],
    }


def describe_expert(costs: EpisodeCosts, limit: int) -> list[dict[str, object]]:
    """Return for each move what Expert would have done instead.

    shares  of ACTIONS, as the network finds them before the move
    action  Expert's
    needs   moves from there to the end if Expert plays on; None where it does not get there within the limit
    cost    moves by which the move made lengthened the episode, below 0 where it gained
    """
    lengths = costs.lengths.tolist()
    return [
        {
            "shares": [round(float(share), 3) for share in costs.advice.shares[step]],
            "action": ACTIONS[costs.advice.actions[step]],
            "after": None,
            "needs": lengths[step] - step if lengths[step] < limit else None,
            "cost": cost,
        }
        for step, cost in enumerate(costs.costs.tolist())
    ]


def describe_mistake(record: Record, mistake: Mistake, missed: MissedCells) -> dict[str, object]:
    """Return a mistake for a page.

    `step` is the number of moves before its costliest, `previous` the last of them.

    `grid` and `discovered` are what was known then, as in a frame; the rest is `evaluation.missed.MissedCells`.
    """
    return {
        "first": mistake.first,
        "last": mistake.last,
        "step": mistake.step,
        "cost": mistake.cost,
        "action": ACTIONS[mistake.action],
        "expert_action": ACTIONS[mistake.expert_action],
        "kind": str(mistake.kind),
        "previous": ACTIONS[record.actions[mistake.step - 1]] if mistake.step else None,
        "position": list(missed.position),
        "grid": encode_grid(missed.codes),
        "discovered": missed.discovered,
        "missed": missed.cells.tolist(),
        "seen_at": missed.seen_at,
    }
