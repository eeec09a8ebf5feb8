"""CPU time of policies to decide a move, alone and in a stack of boards."""

from __future__ import annotations

import time

import numpy as np

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.evaluation.rollouts import GreedyRollouts
from marsexplorer.policies.network.policy import NetworkPolicy
from research.speed.figures import Figure

STACK = 32
"""Boards that a network decides together."""


def time_alone(name: str, config: EnvConfig, seed: int = 0) -> float:
    """The mean CPU time of a move in ms, over an episode on a seed's terrain.

    Moves to warm up come before.
    """
    policy = policies.load(name, config.sensor_radius)
    spent, moves = 0.0, 0
    for is_measured in (False, True):
        episode = Episode.begin(config, seed=seed)
        policy.reset(seed)
        while not episode.ended and (is_measured or episode.steps < 50):
            began = time.process_time()
            action = policy.act(episode.codes)
            if is_measured:
                spent, moves = spent + time.process_time() - began, moves + 1
            episode.step(action)
    return 1e3 * spent / moves


def time_in_stack(name: str, config: EnvConfig, seed: int = 0) -> float | None:
    """The mean CPU time of a move in ms for each of STACK boards, as long as all play."""
    policy = policies.load(name, config.sensor_radius)
    if not isinstance(policy, NetworkPolicy):
        return None
    net = policy.net
    rules = net.rules_that_count(config.rows, config.cols)
    rollouts, spent, rounds = GreedyRollouts(config, STACK, rules), 0.0, 0
    rollouts.worlds.start(np.arange(seed, seed + STACK))
    rollouts.step(rollouts.decide(net).actions)
    while rollouts.running.all():
        began = time.process_time()
        decisions = rollouts.decide(net)
        spent, rounds = spent + time.process_time() - began, rounds + 1
        rollouts.step(decisions.actions)
    return 1e3 * spent / (rounds * STACK)


def decide(name: str, side: int) -> list[Figure]:
    """Return the figures of one policy on level random, `side` cells a side."""
    config, at = EnvConfig.of("random", side), f"{side}x{side}"
    alone, in_stack = time_alone(name, config), time_in_stack(name, config)
    figures = [Figure("decisions", f"{name}, a move alone, {at}", alone, "CPU ms")]
    if in_stack is not None:
        label = f"{name}, a move of {STACK} together, {at}"
        figures.append(Figure("decisions", label, in_stack, "CPU ms"))
    return figures
