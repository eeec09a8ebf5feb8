"""How many processor hours would decide an undecided finding.

`python -m research.paper.claims.hours` measures and stores an update of the paper's PPO, in seconds
of one thread of the processor. An update is 4,000 moves and 960 gradient steps.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from research.paper.claims.results import UNDECIDED, Results
from research.paper.jobs import write_text
from research.paper.plan import LEVEL_MOVES, PAPER_MOVES

FILE = Path(__file__).resolve().parents[1] / "data" / "update.json"
MOVES_OF_AN_UPDATE = 4000
UPDATES = 3
"""That are measured; the fastest one counts."""


@dataclass(frozen=True)
class Needed:
    """Trainings of PPO with the paper's moves and gradient steps."""

    trainings: int
    moves: int
    of: str


RANDOM = Needed(3, PAPER_MOVES["ppo"], "PPO on `random`")
LEVELS = Needed(36, LEVEL_MOVES, "PPO on the 12 levels")
NEEDED: Mapping[str, Needed] = {
    "best": RANDOM,
    "second": RANDOM,
    "half": RANDOM,
    "millions": RANDOM,
    "no-knee": RANDOM,
    "morphology-first": LEVELS,
    "morphology-degrades": LEVELS,
    "hardest": LEVELS,
    "bonus-little": LEVELS,
    "harder-generalises": LEVELS,
    "generalises": Needed(12, PAPER_MOVES["ppo"], "PPO on `random`, four numbers of terrains"),
}
"""Finding -> what decides it, if it is undecided."""


def seconds_of_an_update() -> float:
    """The stored seconds of an update."""
    return float(json.loads(FILE.read_text())["seconds"])


def hours(needed: Needed, results: Results, seconds: float) -> float:
    """Processor hours of what is not trained yet."""
    moves = needed.trainings * needed.moves
    if needed is RANDOM:
        moves -= sum(line["moves"] for line in results.unfinished)
    return moves / MOVES_OF_AN_UPDATE * seconds / 3600


def to_decide(name: str, verdict: str, results: Results) -> str:
    """What decides an undecided finding, with its hours; empty for others."""
    if verdict != UNDECIDED or name not in NEEDED:
        return ""
    needed = NEEDED[name]
    return f"{needed.of}: {hours(needed, results, seconds_of_an_update()):.0f} h"


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
