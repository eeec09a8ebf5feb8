"""The commit and the measurements that a trained policy's card states."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from marsexplorer.config import EnvConfig

HELD_OUT_TERRAINS = 200
"""Terrains of 21x21 or less that a finished policy is measured on for its card; on larger grids fewer, with as many cells."""


def commit() -> str | None:
    """Return the commit of this checkout; None outside one.

    None also for a package that lies inside another checkout.
    """
    root = Path(__file__).resolve().parents[5]
    command = ["git", "-C", str(root), "rev-parse", "--show-toplevel", "HEAD"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    top, head = done.stdout.splitlines()
    return head if Path(top) == root else None


def measure_policy(
    file: Path, save_policy: Callable[[dict[str, object]], None], configs: list[EnvConfig]
) -> str:
    """Return a sentence on a policy's moves on each configuration's held-out terrains.

    save_policy   is called with the numbers, to write them into the card
    """
    from humanplay.jobs import Jobs
    from marsexplorer.config import EnvConfig
    from marsexplorer.evaluation.cards import result_for_card
    from marsexplorer.training.envs import EVALUATION_SEEDS

    results, sentences = {}, []
    with Jobs() as jobs:
        for config in configs:
            terrains = min(HELD_OUT_TERRAINS, max(2, HELD_OUT_TERRAINS * EnvConfig().n // config.n))
            place, first = f"{config.level} {config.rows}x{config.cols}", EVALUATION_SEEDS.start
            measurement = results[place] = result_for_card(
                file, config, terrains, first, executor=jobs
            )
            sentences.append(
                f"{measurement['steps']:.1f} steps to 99 % on {terrains} terrains of {place} "
                f"({measurement['completion']:.0%} explored), the best rule {measurement['best_rule_steps']:.1f}"
            )
    save_policy({"results": results})
    return "; ".join(sentences)
