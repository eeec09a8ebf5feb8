"""How often a player stands out as like a policy: `python -m app.moves.likeness_rates`.

The people are synthetic: each follows one of STYLES and slips, with a rate of their own,
into random valid moves. A program plays one policy exactly, or slips now and then to hide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import click
import numpy as np

from app.moves.likeness import find_likeness
from app.moves.regret_validation import FIRST_SEED, play_with_slips
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.agreement import Agreement, agreement_with
from marsexplorer.policies import load

STYLES = ("frontier-cost", "frontier-utility", "ppo")
"""What the synthetic people follow, and what they are compared with."""
SLIP, SLIP_SD = 0.15, 0.8
"""Median slip of the people, and its SD in logits."""


@dataclass(frozen=True)
class Player:
    """A style and how often its moves slip."""

    style: str
    slip: float


def draw_people(count: int, rng: np.random.Generator) -> list[Player]:
    """Draw synthetic people."""
    logits = np.log(SLIP / (1 - SLIP)) + SLIP_SD * rng.standard_normal(count)
    return [Player(str(rng.choice(STYLES)), float(1 / (1 + np.exp(-logit)))) for logit in logits]


def agreements_of(
    config: EnvConfig, player: Player, terrains: int, rng: np.random.Generator
) -> dict[str, Agreement]:
    """Play a player on some terrains and return its agreement with each of STYLES."""
    policies = {name: load(name, config.sensor_radius) for name in STYLES}
    found = dict.fromkeys(STYLES, Agreement())
    for seed in range(FIRST_SEED, FIRST_SEED + terrains):
        record = play_with_slips(
            load(player.style, config.sensor_radius), config, seed, player.slip, rng
        ).record()
        found = {
            name: found[name] + agreement_with(policy, record) for name, policy in policies.items()
        }
    return found


def share_standing_out(
    people: Sequence[dict[str, Agreement]],
    who: dict[str, Agreement],
    others: int,
    studies: int,
    rng: np.random.Generator,
) -> float:
    """Return in which share of studies a player stands out among `others` people drawn from a pool."""
    hits = 0
    for _ in range(studies):
        drawn = rng.choice(len(people), others, replace=False)
        study = {"who": who, **{str(index): people[index] for index in drawn}}
        hits += any(each.stands_out for each in find_likeness(study) if each.participant == "who")
    return hits / studies


@click.command()
@click.option("--people", default=60, show_default=True, help="Synthetic people played.")
@click.option("--terrains", default=10, show_default=True)
@click.option("--studies", default=500, show_default=True)
@click.option("--seed", default=0, show_default=True)
def main(people: int, terrains: int, studies: int, seed: int) -> None:
    """Print how often people and programs stand out among nine others, on level random at 21x21."""
    config, rng = EnvConfig(), np.random.default_rng(seed)
    pool = [agreements_of(config, player, terrains, rng) for player in draw_people(people, rng)]
    alarms = [
        share_standing_out(pool[:at] + pool[at + 1 :], own, 9, max(1, studies // 10), rng)
        for at, own in enumerate(pool)
    ]
    click.echo(f"people: {np.mean(alarms):.1%} stand out")
    for style in STYLES:
        for slip in (0.0, 0.02, 0.1):
            who = agreements_of(config, Player(style, slip), terrains, rng)
            share = share_standing_out(pool, who, 9, studies, rng)
            click.echo(f"a program that plays {style} with {slip:.0%} slips: {share:.0%} stand out")


if __name__ == "__main__":
    main()
