"""The process that plays policies' episodes for the leaderboard: `python -m app.leaderboard.worker`, jobs in, figures out.

Each line on stdin is a job {"policy", "config", "seeds"}; each line on stdout is {"done": episodes so far}, then
{"figure": ...} or {"error": sentence}. It runs at the lowest priority and ends with its stdin or with whoever reads it.
"""

from __future__ import annotations

import json
import os
import sys
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
            send({"figure": evaluate_job(json.loads(line))})
        except (ValueError, LookupError, OSError, RuntimeError) as error:
            send({"error": str(error) or type(error).__name__})


def evaluate_job(job: dict[str, Any]) -> dict[str, Any]:
    """Return the figure of a job, and send a message after each episode."""
    config = EnvConfig(**job["config"])
    policy = policies.load(job["policy"], config.sensor_radius)
    groups: list[list[EpisodeSummary]] = []
    for seed in job["seeds"]:
        groups.append([summary_of(play_episode(policy, config, seed))])
        send({"done": len(groups)})
    return summarize_episodes(config, groups)


def send(message: dict[str, Any]) -> None:
    """Print one message; a reader that has gone ends the process."""
    try:
        print(json.dumps(message, separators=(",", ":")), flush=True)
    except BrokenPipeError:
        os._exit(0)


if __name__ == "__main__":
    main()
