"""Who a synthetic player is: its kind, its skill, its tempo and its habits, all drawn from (seed, number)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.simulate.population import RANDOM_MOVES, SimulatedPopulation, draw_players

PHASES = ("tutorial", "warm_up", "ranked")


@dataclass(frozen=True)
class PlayerKind:
    """What sets players of one kind apart from an ordinary person.

    is_random     makes valid moves at random instead of exploring
    pauses        probability, per move, of leaving the keyboard for one to three minutes
    leaves        goes for ever after some ranked episodes
    reloads       probability, per move, of reloading the page or losing the connection
    is_robotic    presses at a fixed interval and never releases a key
    cheats        tries what the server has to refuse
    crash         probability of a crash per move next to something to crash into; None is the population's
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


PLAYER_KINDS = {
    kind.name: kind
    for kind in (
        PlayerKind(
            "noisy-frontier",
            "explores as people do, with slips; skill and luck of its own, a reload now and then",
            reloads=0.0005,
        ),
        PlayerKind("random", "makes valid moves at random", is_random=True),
        PlayerKind("idler", "leaves the keyboard for minutes now and then", pauses=0.004),
        PlayerKind(
            "dropper",
            "goes for ever after some ranked episodes, by closing the page or by withdrawing",
            leaves=True,
        ),
        PlayerKind(
            "reloader",
            "reloads the page, opens a second tab and loses the connection all the time",
            reloads=0.03,
        ),
        PlayerKind(
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
"""The kinds that `mixed` stands for; they are assigned in turn."""


@dataclass(frozen=True)
class PlayStyle:
    """How an episode is played: probabilities of a slip and of a crash per move, and the seed of its random stream."""

    slip: float
    crash: float
    stream: int


@dataclass(frozen=True)
class Persona:
    """One synthetic player.

    number        0.. within its study
    decision_ms   median time from a frame to the key, going straight on; the interval of a robotic player
    hold_ms       median time a key stays down
    modality      "keyboard" or "touch"
    leaves_after  ranked episodes after which it goes for ever, as a share of all; None for never
    withdraws     whether it then says so, rather than closing the page
    """

    number: int
    kind: PlayerKind
    seed: int
    slip_logit: float
    crash: float
    luck_sd: float
    decision_ms: float
    hold_ms: float
    modality: str
    leaves_after: float | None
    withdraws: bool

    def style(self, phase: str, trial: int) -> PlayStyle:
        """Return how the trial of a phase is played: the same at every call, so a resumed study goes on as before."""
        rng = self.rng(2 + PHASES.index(phase), trial)
        slip = 1.0 / (1.0 + np.exp(-(self.slip_logit + self.luck_sd * rng.standard_normal())))
        return PlayStyle(float(slip), self.crash, int(rng.integers(0, 2**64, dtype=np.uint64)))

    def rng(self, *purpose: int) -> np.random.Generator:
        """Return a random generator of this player's for one purpose, which the numbers name."""
        return np.random.default_rng([self.seed, self.number, *purpose])


def draw_persona(number: int, kind: str, population: SimulatedPopulation, seed: int) -> Persona:
    """Draw the player `number` of the study that `seed` names; KeyError for an unknown kind."""
    player_kind = PLAYER_KINDS[kind]
    rng = np.random.default_rng([seed, number, 1])
    skills = draw_players(RANDOM_MOVES if player_kind.is_random else population, 1, rng)
    return Persona(
        number=number,
        kind=player_kind,
        seed=seed,
        slip_logit=float(skills.slip_logit[0]),
        crash=float(skills.crash[0]) if player_kind.crash is None else player_kind.crash,
        luck_sd=skills.luck_sd,
        decision_ms=60.0 if player_kind.is_robotic else float(rng.lognormal(np.log(320.0), 0.25)),
        hold_ms=float(rng.lognormal(np.log(90.0), 0.15)),
        modality="touch" if rng.random() < 0.2 and not player_kind.is_robotic else "keyboard",
        leaves_after=float(rng.uniform(0.1, 0.9)) if player_kind.leaves else None,
        withdraws=bool(rng.random() < 0.5),
    )


def assign_kinds(kinds: tuple[str, ...], players: int) -> tuple[str, ...]:
    """Return the kind of each player, assigned in turn; `mixed` stands for the kinds of MIXED."""
    in_turn = [each for kind in kinds for each in (MIXED if kind == "mixed" else (kind,))]
    return tuple(in_turn[number % len(in_turn)] for number in range(players))
