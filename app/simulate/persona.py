"""Who a synthetic player is: its kind, its skill, its tempo and its habits, all drawn from (seed, number)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.simulate.population import RANDOM, Population, draw

PHASES = ("tutorial", "warm_up", "ranked")


@dataclass(frozen=True)
class Kind:
    """What sets players of one kind apart from an ordinary person.

    is_random     makes valid moves at random instead of exploring
    pauses        probability, per move, of leaving the keyboard for one to three minutes
    leaves        goes for ever after some ranked episodes
    reloads       probability, per move, of reloading the page or losing the connection
    is_robotic    presses in a fixed beat and never releases a key
    cheats        tries what the server has to refuse
    crash         probability of a crash per move beside something to crash into; None is the population's
    """

    name: str
    summary: str
    is_random: bool = False
    pauses: float = 0.0
    leaves: bool = False
    reloads: float = 0.0
    is_robotic: bool = False
    cheats: bool = False
    crash: float | None = None


KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "noisy-frontier",
            "explores as people do, with slips; skill and luck of its own, a reload now and then",
            reloads=0.0005,
        ),
        Kind("random", "makes valid moves at random", is_random=True),
        Kind("idler", "leaves the keyboard for minutes now and then", pauses=0.004),
        Kind("dropper", "goes for ever after some ranked episodes, by closing the page or by withdrawing", leaves=True),
        Kind("reloader", "reloads the page, opens a second tab and loses the connection all the time", reloads=0.03),
        Kind(
            "cheater",
            "a beat like a machine's, no key-up, collisions, and everything a server has to refuse",
            is_robotic=True,
            cheats=True,
            crash=0.01,
        ),
    )
}
MIXED = (
    "noisy-frontier", "idler", "noisy-frontier", "reloader", "noisy-frontier",
    "dropper", "noisy-frontier", "cheater", "noisy-frontier", "random",
)  # fmt: skip
"""What `mixed` deals, round and round."""


@dataclass(frozen=True)
class Nature:
    """How an episode is played: probabilities of a slip and of a crash per move, and what names its stream of draws."""

    slip: float
    crash: float
    dice: int


@dataclass(frozen=True)
class Persona:
    """One synthetic player.

    number        0.. within its study
    think_ms      median time from a frame to the key, straight on; a machine's beat
    hold_ms       median time a key stays down
    modality      "keyboard" or "touch"
    leaves_after  ranked episodes after which it goes for ever, as a share of all; None for never
    withdraws     whether it then says so, rather than closing the page
    """

    number: int
    kind: Kind
    seed: int
    slip_logit: float
    crash: float
    luck_sd: float
    think_ms: float
    hold_ms: float
    modality: str
    leaves_after: float | None
    withdraws: bool

    def nature(self, phase: str, trial: int) -> Nature:
        """Return how the trial of a phase is played: the same whenever it is asked, so a resumed study goes on as before."""
        rng = self.rng(2 + PHASES.index(phase), trial)
        slip = 1.0 / (1.0 + np.exp(-(self.slip_logit + self.luck_sd * rng.standard_normal())))
        return Nature(float(slip), self.crash, int(rng.integers(0, 2**64, dtype=np.uint64)))

    def rng(self, *what: int) -> np.random.Generator:
        """Return a generator for one of this player's matters."""
        return np.random.default_rng([self.seed, self.number, *what])


def persona(number: int, kind: str, population: Population, seed: int) -> Persona:
    """Return the player `number` of the study that `seed` names; KeyError for an unknown kind."""
    what = KINDS[kind]
    rng = np.random.default_rng([seed, number, 1])
    skills = draw(RANDOM if what.is_random else population, 1, rng)
    return Persona(
        number=number,
        kind=what,
        seed=seed,
        slip_logit=float(skills.slip_logit[0]),
        crash=float(skills.crash[0]) if what.crash is None else what.crash,
        luck_sd=skills.luck_sd,
        think_ms=60.0 if what.is_robotic else float(rng.lognormal(np.log(320.0), 0.25)),
        hold_ms=float(rng.lognormal(np.log(90.0), 0.15)),
        modality="touch" if rng.random() < 0.2 and not what.is_robotic else "keyboard",
        leaves_after=float(rng.uniform(0.1, 0.9)) if what.leaves else None,
        withdraws=bool(rng.random() < 0.5),
    )


def deal(kinds: tuple[str, ...], players: int) -> tuple[str, ...]:
    """Return the kind of each player, dealt round and round; `mixed` stands for everything there is."""
    pack = [each for kind in kinds for each in (MIXED if kind == "mixed" else (kind,))]
    return tuple(pack[number % len(pack)] for number in range(players))
