"""The process that plays policies' episodes for the leaderboard: `python -m app.leaderboard.worker`, jobs in, figures out.

Each line on stdin is a job {"policy", "config", "seeds"}; each line on stdout is {"done": episodes so far}, then
{"figure": ...} or {"error": sentence}. It runs at the lowest priority and ends with its stdin or with whoever reads it.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

from app.statistics.summaries import EpisodeSummary, summarize_episodes, summary_of
from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.episodes import play_episode


def main() -> None:
    """Answer jobs until stdin ends."""
    os.nice(19)
    for line in sys.stdin:
        try:
            job = json.loads(line)
            figure, _ = evaluate_policy(
                job["policy"],
                EnvConfig(**job["config"]),
                job["seeds"],
                lambda done: send({"done": done}),
            )
            send({"figure": figure})
        except (ValueError, LookupError, OSError, RuntimeError) as error:
            send({"error": str(error) or type(error).__name__})


def evaluate_policy(
    source: str,
    config: EnvConfig,
    seeds: Sequence[int],
    advance: Callable[[int], None] = lambda done: None,
) -> tuple[dict[str, Any], list[int]]:
    """Return a policy's figure on the terrains of some seeds, and its steps to 99 % on each.

    source is what `policies.load` takes; `advance` is called with the number of episodes played.
    """
    policy = policies.load(source, config.sensor_radius)
    played: list[EpisodeSummary] = []
    for seed in seeds:
        played.append(summary_of(play_episode(policy, config, seed)))
        advance(len(played))
    return summarize_episodes(config, [[each] for each in played]), [each.steps for each in played]


def send(message: dict[str, Any]) -> None:
    """Print one message; a reader that has gone ends the process."""
    try:
        print(json.dumps(message, separators=(",", ":")), flush=True)
    except BrokenPipeError:
        os._exit(0)


if __name__ == "__main__":
    main()
