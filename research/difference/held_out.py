"""What policies do in their last episodes of training and on terrains kept apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
import torch

from marsexplorer import policies
from marsexplorer.compat.env import KoutrasCode
from marsexplorer.training.envs import EVALUATION_SEEDS, RecentEpisodes
from research.paper.episodes.quadrants import quadrant_course

ENDINGS = ("explored", "collided", "out_of_bounds", "timed_out")
EPISODES_PER_LINE = 100
EPISODES, AT_ONCE = 200, 50
"""On terrains kept apart, and how many are played side by side."""
PATHS = 20
"""Episodes whose actions are kept."""
MOST = 0.9
"""A share of the cells that few policies cover."""


def episode_means(recent: RecentEpisodes) -> dict[str, float]:
    """The means over the last episodes that ended in training; empty without any."""
    columns: dict[str, Iterable[float]] = {
        "return": recent.returns,
        "coverage": recent.coverages,
        "steps": recent.steps,
        **{ending: [outcome == ending for outcome in recent.outcomes] for ending in ENDINGS},
    }
    means = {
        name: round(float(np.mean(list(column)[-EPISODES_PER_LINE:])), 4)
        for name, column in columns.items()
        if recent.count
    }
    return {"episodes": recent.count, **means}


@torch.inference_mode()
def play_held_out(batch: Callable[[int], Any], player: Any, seed: int) -> dict[str, Any]:
    """How a policy does on terrains kept apart, its actions drawn as in training.

    Args:
        batch: makes so many environments that observe codes.
        player: a `PolicyNetwork` on the CPU.
        seed: of the actions.
    """
    torch.manual_seed(seed)
    env, episodes = batch(AT_ONCE), list[dict[str, Any]]()
    for first in range(EVALUATION_SEEDS.start, EVALUATION_SEEDS.start + EPISODES, AT_ONCE):
        episodes += _play_side_by_side(env, player, first)
    actions = [episode["actions"] for episode in episodes[:PATHS]]
    return {**means(episodes), "actions": actions}


def play_rule(name: str) -> dict[str, Any]:
    """How a rule does on the same terrains of the code's world, of the videos' level."""
    rule, env, episodes = policies.load(name), KoutrasCode("videos", observation="uint8"), []
    for seed in range(EVALUATION_SEEDS.start, EVALUATION_SEEDS.start + EPISODES):
        codes, info = env.reset(seed=seed)
        rule.reset(seed)
        rows, cols = codes.shape
        path, moves, is_over = [info["position"]], 0, False
        while not is_over:
            action = rule.act(codes)
            codes, _, is_over, _, info = env.step(np.int64(action))
            path.append(info["position"])
            moves += 1
        course = quadrant_course([x * cols + y for x, y in path], rows, cols)
        episodes.append(
            {
                "coverage": info["coverage"],
                "outcome": info["outcome"],
                "moves": moves,
                "clean_u": course.never_goes_back,
            }
        )
    return {"policy": name, **means(episodes)}


def means(episodes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The means and shares over episodes."""
    shares = [episode["coverage"] for episode in episodes]
    outcomes = [episode["outcome"] for episode in episodes]
    return {
        "terrains": EPISODES,
        "coverage": round(float(np.mean(shares)), 4),
        "covers_most": float(np.mean(np.array(shares) >= MOST)),
        "steps": round(float(np.mean([episode["moves"] for episode in episodes])), 2),
        **{ending: outcomes.count(ending) / EPISODES for ending in ENDINGS},
        "clean_u": float(np.mean([episode["clean_u"] for episode in episodes])),
    }


def _play_side_by_side(env: Any, player: Any, first: int) -> list[dict[str, Any]]:
    """The first episode of each environment of a batch, on seeds from `first` on."""
    codes, info = env.reset(seed=first)
    rows, cols = codes.shape[1:]
    paths = [[int(x) * cols + int(y)] for x, y in info["position"]]
    actions = [""] * AT_ONCE
    episodes: dict[int, dict[str, Any]] = {}
    while len(episodes) < AT_ONCE:
        probabilities = player.logits(torch.from_numpy(codes)).float().softmax(1)
        chosen = torch.multinomial(probabilities, 1).squeeze(1).numpy()
        codes, _, terminated, truncated, info = env.step(chosen)
        ended = terminated | truncated
        for i in set(range(AT_ONCE)) - set(episodes):
            source = info["final_info"] if ended[i] else info
            x, y = source["position"][i]
            paths[i].append(int(x) * cols + int(y))
            actions[i] += str(int(chosen[i]))
            if ended[i]:
                episodes[i] = {
                    "coverage": float(source["coverage"][i]),
                    "outcome": str(source["outcome"][i]),
                    "actions": actions[i],
                    "moves": len(actions[i]),
                    "clean_u": quadrant_course(paths[i], rows, cols).never_goes_back,
                }
    return [episodes[i] for i in range(AT_ONCE)]
