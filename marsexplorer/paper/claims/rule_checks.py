"""What the paper says of the rules (sections 2.2 to 2.5 and 3.2), tested by playing episodes that seeds fix."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from marsexplorer import policies
from marsexplorer.config import EnvConfig
from marsexplorer.episode import Episode
from marsexplorer.observation import DISPLACEMENTS
from marsexplorer.rules import R_MOVE
from marsexplorer.score import score

EPISODES = 40
MOST_NEW_CELLS = 13
"""No single move on open ground shows more at radius 6: a disc shifted by one cell."""


@dataclass(frozen=True)
class Finding:
    """What a check found: whether the paper's statement holds, and the sentence that says what was measured."""

    holds: bool
    measured: str


def played(config: EnvConfig, policy: str, count: int = EPISODES) -> Iterator[Episode]:
    """Yield ended episodes of a policy by name on the terrains of seeds 0, 1, ...; "blind" draws any of the four moves."""
    driver = None if policy == "blind" else policies.load(policy)
    for seed in range(count):
        episode, rng = Episode.begin(config, seed=seed), np.random.default_rng(seed)
        if driver is not None:
            driver.reset(seed)
        while not episode.ended:
            episode.step(driver.act(episode.codes) if driver is not None else int(rng.integers(4)))
        yield episode


def actions() -> Finding:
    """Four moves, each to a neighbour that shares an edge (eq. 3)."""
    config, ground = EnvConfig(rows=9, cols=9), np.zeros((9, 9), bool)
    moved = []
    for action in range(len(DISPLACEMENTS)):
        episode = Episode.begin(config, terrain=ground, start=(4, 4))
        episode.step(action)
        moved.append((episode.position[0] - 4, episode.position[1] - 4))
    holds = moved == [(-1, 0), (0, 1), (1, 0), (0, -1)]
    return Finding(
        holds,
        f"actions 0 to 3 move the rover by {', '.join(f'({row}, {col})' for row, col in moved)}",
    )


def state() -> Finding:
    """The state matrix holds 0, 0.3, 0.6 and 1, and 0.6 where the rover stands (eq. 6)."""
    found: set[float] = set()
    rovers, moves = set(), 0
    for seed in range(EPISODES):
        episode, rule = Episode.begin(EnvConfig(), seed=seed), policies.load("frontier-cost")
        rule.reset(seed)
        while not episode.ended:
            episode.step(rule.act(episode.codes))
            matrix = episode.observation()
            found.update(np.unique(matrix.round(6)).tolist())
            rovers.add(
                (
                    int((matrix == np.float32(0.6)).sum()),
                    bool(matrix[episode.position] == np.float32(0.6)),
                )
            )
            moves += 1
    values = sorted(round(value, 1) for value in found)
    holds = values == [0.0, 0.3, 0.6, 1.0] and rovers == {(1, True)}
    return Finding(
        holds, f"values {values} in {moves:,} observations, 0.6 in the rover's cell alone"
    )


def reward() -> Finding:
    """A valid move earns the newly discovered cells less 0.5 (eq. 7 and 8), and the scan at the start nothing."""
    right, moves = 0, 0
    for episode in played(EnvConfig(), "blind", 20 * EPISODES):
        new = np.diff(episode.discoveries)
        valid = episode.steps - int(episode.outcome in ("collided", "out_of_bounds", "explored"))
        right += sum(episode.rewards[k] == new[k] - 0.5 for k in range(valid))
        moves += valid
    return Finding(
        right == moves and R_MOVE == 0.5,
        f"{right:,} of {moves:,} valid moves earned their new cells less {R_MOVE}",
    )


def invalid() -> Finding:
    """An invalid move costs n and ends the episode; nothing else of its reward remains (eq. 8)."""
    config = EnvConfig()
    ended = [
        each
        for each in played(config, "blind", 20 * EPISODES)
        if each.outcome in ("collided", "out_of_bounds")
    ]
    holds = all(episode.rewards[-1] == -config.n for episode in ended)
    crashes = sum(episode.outcome == "collided" for episode in ended)
    return Finding(
        holds,
        f"{len(ended):,} invalid moves, {crashes:,} of them into obstacles: each gave -{config.n} and ended it",
    )


def bonus() -> Finding:
    """The move that brings the discovered share to beta earns n on top, and ends the episode (eq. 8)."""
    config = EnvConfig()
    ended = list(played(config, "frontier-cost"))
    rewards = [
        episode.rewards[-1] - (episode.discoveries[-1] - episode.discoveries[-2] - 0.5)
        for episode in ended
    ]
    enough = all(e.discoveries[-1] / config.n >= 0.99 > e.discoveries[-2] / config.n for e in ended)
    holds = (
        enough and set(rewards) == {float(config.n)} and all(e.outcome == "explored" for e in ended)
    )
    return Finding(
        holds,
        f"{len(ended)} completed episodes: each ended with the move that passed 99 % and gave {config.n} more",
    )


def score_zero() -> Finding:
    """The normalized score is 0 for an invalid first move (section 3.2)."""
    config = EnvConfig()
    episode = Episode.begin(config, seed=0)
    episode.step(0)
    value = score(config, episode.total)
    return Finding(value == 0.0, f"north at the start, off the grid: score {value:g}")


def score_one() -> Finding:
    """The normalized score is 1 for the bonus plus the number of cells (section 3.2), which no episode can reach."""
    config = EnvConfig()
    value = score(config, config.r_bonus + config.n)
    bounds = []
    for seed in range(500):
        first = Episode.begin(config, seed=seed).discovered
        moves = -(-(config.target - first) // MOST_NEW_CELLS)
        bounds.append(score(config, config.r_bonus + config.n - first - R_MOVE * moves))
    measured = f"a return of {config.r_bonus + config.n} scores {value:g}; but the first scan earns nothing and moves cost, so "
    measured += f"no episode can score more than {max(bounds):.3f} (mean bound of 500 terrains {np.mean(bounds):.3f})"
    return Finding(value == 1.0, measured)


def shares() -> Finding:
    """The three shares printed in section 3.2 follow from one another: 85.8 %, 50.04 % and 42.73 %."""
    low, high = 0.8575 * 0.50035, 0.8585 * 0.50045
    measured = f"85.8 % times 50.04 % is {0.858 * 0.5004:.2%} ({low:.2%} to {high:.2%} with rounding), and 42.73 % is printed"
    return Finding(low <= 0.4273 <= high, measured)
