"""How many processor hours would decide an undecided finding.

`python -m research.paper.claims.hours` measures and stores an update of the paper's PPO, in seconds
of one thread of the processor. An update is 4,000 moves and 960 gradient steps.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from research.paper.claims.policy_claims import LEVEL as LARGE_LEVEL
from research.paper.claims.policy_claims import SIZES
from research.paper.claims.results import CONTRARY, UNDECIDED, Results
from research.paper.episodes.play import DIFFICULTIES
from research.paper.jobs import write_text
from research.paper.plan import LEVEL, LEVEL_MOVES, MOVES_OF_AN_UPDATE, PAPER_MOVES, SEEDS, SIZE

FILE = Path(__file__).resolve().parents[1] / "data" / "update.json"
UPDATES = 3
"""How many are measured; the fastest counts."""


@dataclass(frozen=True)
class Needed:
    """Trainings of PPO with the paper's moves and gradient steps, SEEDS a level."""

    levels: Sequence[str]
    moves: int
    words: str
    sides: Sequence[int] = (SIZE,)


RANDOM = Needed((LEVEL,), PAPER_MOVES["ppo"], "PPO on `random`")
LEVELS = Needed(DIFFICULTIES, LEVEL_MOVES, "PPO on the 12 levels")
LARGE = Needed((LARGE_LEVEL,), LEVEL_MOVES, "PPO at 42x42 and 84x84", SIZES)
"""As long as on the 12 levels: the paper does not say how long its trainings there are."""
NEEDED: Mapping[str, Needed] = {
    "best": RANDOM,
    "second": RANDOM,
    "half": RANDOM,
    "morphology-first": LEVELS,
    "morphology-degrades": LEVELS,
    "hardest": LEVELS,
    "bonus-little": LEVELS,
    "no-knee": LARGE,
}
"""Finding -> what can decide it, if it is undecided; the others no training of PPO can."""


def seconds_of_an_update() -> float:
    """The stored seconds of an update."""
    return float(json.loads(FILE.read_text())["seconds"])


def hours(needed: Needed, results: Results, seconds: float) -> float:
    """Processor hours of what is not trained yet, finished or not.

    An update takes as much longer as the grid has more cells.
    """
    progress = [(record.trial, record.result["moves"]) for record in results.records]
    progress += [(line["trial"], line["moves"]) for line in results.unfinished]
    moves = {
        (level, side, seed): 0
        for level in needed.levels
        for side in needed.sides
        for seed in range(SEEDS)
    }
    for trial, trained in progress:
        place = trial.level, trial.size, trial.seed
        is_of_kind = (trial.algorithm, trial.variant) == ("ppo", "appendix")
        if is_of_kind and place in moves:
            moves[place] = max(moves[place], min(trained, needed.moves))
    left = sum((needed.moves - done) * (side / SIZE) ** 2 for (_, side, _), done in moves.items())
    return left / MOVES_OF_AN_UPDATE * seconds / 3600


def to_decide(name: str, verdict: str, results: Results) -> str:
    """What can decide an undecided finding, with its hours; empty if nothing can."""
    if verdict not in (UNDECIDED, CONTRARY) or name not in NEEDED:
        return ""
    needed = NEEDED[name]
    left = hours(needed, results, seconds_of_an_update())
    return f"{needed.words}: {left:.0f} h" if left else ""


def main() -> None:
    """Measure an update and store its seconds."""
    import torch

    from marsexplorer.config import EnvConfig
    from research.paper.algorithms import begin
    from research.paper.trial import hardware

    torch.set_num_threads(1)
    trainer = begin("ppo", "appendix", EnvConfig(), seed=0, moves=PAPER_MOVES["ppo"])
    lengths = []
    for _ in range(UPDATES):
        begun = time.process_time()
        trainer.advance()
        lengths.append(time.process_time() - begun)
    measured = {"seconds": round(min(lengths), 1), "hardware": hardware()}
    write_text(FILE, json.dumps(measured) + "\n")
    print(FILE.read_text(), end="")


if __name__ == "__main__":
    main()
