"""A Bayesian mixed model of the steps to 99 % that treats an episode without 99 % as censored; an extra, made when asked for.

log steps = mean + slope trial + player + terrain + rest, all three normal, players and terrains crossed. An episode that ended
after n moves without 99 % says only that more than n moves would have been needed: it enters by the probability of that (right
censoring; Kalbfleisch and Prentice 2002, section 3.2). So a crash after 16 moves tells little, where the primary figure counts
the limit: this is about how fast people explore where nothing ends it early, and it takes for granted that what ends an episode
does not depend on how many moves it would have taken. The posterior is sampled by NUTS (Hoffman and Gelman 2014, JMLR 15)
through numpyro, which is loaded where it is needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.statistics.intervals import Interval
from marsexplorer.evaluation.intervals import Floats

if TYPE_CHECKING:
    from app.statistics.exclusion_sets import Cohort

FEWEST = 3
"""Players, and terrains, below which nothing is sampled."""
MEAN_SD, SLOPE_SD, SPREAD_SD = 1.0, 0.5, 0.5
"""Of the priors, in units of log steps."""
MEAN_PART = 4
"""The prior of the mean has its middle at the limit of an episode over this."""
MOST_R_HAT, LEAST_SAMPLES = 1.01, 400.0
"""Beyond these the sampling is called poor (Vehtari et al. 2021, Bayesian Analysis 16(2), sections 4 and 5)."""
TAILS = (0.025, 0.975)


@dataclass(frozen=True)
class Sampling:
    """How much is sampled: `chains` of `draws` each after `warm_up`, from `seed`."""

    chains: int = 4
    warm_up: int = 500
    draws: int = 500
    seed: int = 0


@dataclass(frozen=True)
class Episodes:
    """The episodes that enter, one value each: player and terrain (indices), trial (0..), moves made, was 99 % reached.

    limit   most moves of an episode; planned: ranked trials of a player
    """

    player: NDArray[np.intp]
    terrain: NDArray[np.intp]
    trial: NDArray[np.intp]
    moves: Floats
    is_explored: NDArray[np.bool_]
    limit: int
    planned: int


@dataclass(frozen=True)
class Posterior:
    """A quantity's posterior mean with its central 95 % interval."""

    mean: float
    interval: Interval


@dataclass(frozen=True)
class TerrainFactor:
    """By how much a terrain multiplies everybody's steps; terrain: its index among the ranked ones, 0.. ."""

    terrain: int
    factor: Posterior


@dataclass(frozen=True)
class BayesianModel:
    """The sampled model; where nothing could be sampled, `note` says why and the figures are None.

    typical   steps of the average player on the average terrain at the middle trial, the median over episodes
    mean      steps, the mean over other players and other terrains
    change    of the steps from the first to the last trial, in percent of the first
    player_sd, terrain_sd, rest_sd   standard deviations of log steps: 0.1 is about 10 %
    censored  of `episodes`, those that ended without 99 %
    r_hat     the largest split R-hat, effective: the smallest effective sample size, over all that was sampled
    diverging transitions after the warm-up
    priors    in words; warnings: a sentence for each sign that the sampling is poor
    """

    episodes: int
    censored: int
    typical: Posterior | None
    mean: Posterior | None
    change: Posterior | None
    player_sd: Posterior | None
    terrain_sd: Posterior | None
    rest_sd: Posterior | None
    terrains: tuple[TerrainFactor, ...]
    r_hat: float | None
    effective: float | None
    diverging: int
    chains: int
    draws: int
    priors: tuple[str, ...]
    warnings: tuple[str, ...]
    note: str


def episodes_of(cohort: Cohort, ids: list[str], limit: int) -> Episodes:
    """Return the finished ranked episodes of these participants; limit: most moves of an episode."""
    found = [
        (number, each.terrain, each.trial, each.steps, each.outcome == "explored")
        for number, person in enumerate(ids)
        for each in cohort.ranked[person]
        if each.steps
    ]
    player, terrain, trial, moves, explored = (
        (np.array(column) for column in zip(*found, strict=True)) if found else _NOTHING
    )
    return Episodes(
        player.astype(np.intp), terrain.astype(np.intp), trial.astype(np.intp), moves.astype(np.float64),
        explored.astype(np.bool_), limit, cohort.terrains,
    )  # fmt: skip


_NOTHING = tuple(np.zeros(0) for _ in range(5))


def priors_in_words(limit: int) -> tuple[str, ...]:
    """Return the priors, a sentence each."""
    middle = limit / MEAN_PART
    low, high = (middle * math.exp(sign * 1.96 * MEAN_SD) for sign in (-1, 1))
    most = 100 * (math.exp(1.96 * SLOPE_SD) - 1)
    return (
        f"The mean of log steps: normal around log {middle:g} with SD {MEAN_SD:g} (95 %: {low:.0f} to {high:.0f} steps).",
        f"The change of log steps from the first to the last trial: normal around 0 with SD {SLOPE_SD:g} "
        f"(95 %: up to {most:.0f} % more).",
        f"The SDs of log steps between players, between terrains and of the rest: half-normal with scale {SPREAD_SD:g}.",
    )


def fit_bayesian_model(episodes: Episodes, sampling: Sampling | None = None) -> BayesianModel:
    """Return the sampled model; ModuleNotFoundError where numpyro, of the extra `bayes`, is not installed."""
    sampling = sampling or Sampling()
    terrains = np.unique(episodes.terrain)
    players = np.unique(episodes.player)
    if min(len(players), len(terrains)) < FEWEST:
        return _unsampled(
            episodes,
            f"No Bayesian model: it takes {FEWEST} players and {FEWEST} terrains at least.",
        )
    if not episodes.is_explored.any():
        return _unsampled(episodes, "No Bayesian model: no episode reached 99 %.")
    samples, diverging = _sample(episodes, (players, terrains), sampling)
    return _summary(episodes, terrains, samples, diverging, sampling)


def sampling_warnings(r_hat: float, effective: float, diverging: int) -> tuple[str, ...]:
    """Return a sentence for each sign that the chains do not describe the posterior."""
    found = []
    if not r_hat <= MOST_R_HAT:
        found.append(
            f"The chains disagree: the largest R-hat is {r_hat:.3f}, above {MOST_R_HAT}. Do not use these figures."
        )
    if not effective >= LEAST_SAMPLES:
        found.append(
            f"Too few independent draws: the smallest effective sample size is {effective:.0f}, below {LEAST_SAMPLES:.0f}."
        )
    if diverging:
        found.append(
            f"{diverging} transitions diverged: the sampler may have missed a part of the posterior."
        )
    return tuple(found)


def _unsampled(episodes: Episodes, note: str) -> BayesianModel:
    censored = int((~episodes.is_explored).sum())
    none = dict.fromkeys(
        ("typical", "mean", "change", "player_sd", "terrain_sd", "rest_sd", "r_hat", "effective")
    )
    return BayesianModel(
        episodes=len(episodes.moves), censored=censored, terrains=(), diverging=0, chains=0, draws=0,
        priors=priors_in_words(episodes.limit), warnings=(), note=note, **none,
    )  # fmt: skip


def _sample(
    episodes: Episodes, levels: tuple[NDArray[np.intp], NDArray[np.intp]], sampling: Sampling
) -> tuple[dict[str, Floats], int]:
    """Return the draws of each quantity, float64[chains, draws, ...], and the number of divergent transitions.

    levels  the players and the terrains that have episodes, sorted
    """
    import jax
    import numpyro
    from jax.scipy.stats import norm
    from numpyro import distributions as dist
    from numpyro.infer import MCMC, NUTS

    numpyro.enable_x64()
    player, terrain = (
        np.searchsorted(*pair)
        for pair in zip(levels, (episodes.player, episodes.terrain), strict=True)
    )
    values = np.log(episodes.moves)
    trial = (episodes.trial - (episodes.planned - 1) / 2) / max(episodes.planned - 1, 1)
    middle = math.log(episodes.limit / MEAN_PART)

    def model() -> None:
        mean = numpyro.sample("mean", dist.Normal(middle, MEAN_SD))
        slope = numpyro.sample("slope", dist.Normal(0.0, SLOPE_SD))
        spreads = numpyro.sample("spreads", dist.HalfNormal(SPREAD_SD).expand([3]).to_event(1))
        # around the mean, not around 0: with tens of episodes a player this has the chains mix several times faster
        players = numpyro.sample(
            "players", dist.Normal(mean, spreads[0]).expand([len(levels[0])]).to_event(1)
        )
        terrains = numpyro.sample(
            "terrains", dist.Normal(0.0, spreads[1]).expand([len(levels[1])]).to_event(1)
        )
        expected = players[player] + terrains[terrain] + slope * trial
        is_explored = episodes.is_explored
        log_density = norm.logpdf(values, expected, spreads[2])
        numpyro.factor(
            "steps",
            jax.numpy.where(
                is_explored, log_density, norm.logsf(values, expected, spreads[2])
            ).sum(),
        )

    run = MCMC(
        NUTS(model, dense_mass=True, target_accept_prob=0.9),
        num_warmup=sampling.warm_up,
        num_samples=sampling.draws,
        num_chains=sampling.chains,
        chain_method="vectorized",
        progress_bar=False,
    )
    run.run(jax.random.PRNGKey(sampling.seed), extra_fields=("diverging",))
    samples = {
        name: np.asarray(draws) for name, draws in run.get_samples(group_by_chain=True).items()
    }
    return samples, int(np.asarray(run.get_extra_fields()["diverging"]).sum())


def _summary(
    episodes: Episodes,
    terrains: NDArray[np.intp],
    samples: dict[str, Floats],
    diverging: int,
    sampling: Sampling,
) -> BayesianModel:
    """Return the figures of the draws; terrains: those that have episodes, in the draws' order."""
    r_hat, effective = _diagnostics(samples)
    spreads = samples["spreads"]
    found: dict[str, Any] = {
        name: _posterior(spreads[..., column])
        for column, name in enumerate(("player_sd", "terrain_sd", "rest_sd"))
    }
    return BayesianModel(
        episodes=len(episodes.moves),
        censored=int((~episodes.is_explored).sum()),
        typical=_posterior(np.exp(samples["mean"])),
        mean=_posterior(
            np.exp(samples["mean"] + (spreads**2).sum(axis=-1) / 2)
        ),  # of a log-normal value
        change=_posterior(100 * np.expm1(samples["slope"])),
        terrains=tuple(
            TerrainFactor(int(terrain), _posterior(np.exp(samples["terrains"][..., column])))
            for column, terrain in enumerate(terrains)
        ),
        r_hat=r_hat,
        effective=effective,
        diverging=diverging,
        chains=sampling.chains,
        draws=sampling.draws,
        priors=priors_in_words(episodes.limit),
        warnings=sampling_warnings(r_hat, effective, diverging),
        note=f"Sampled by NUTS: {sampling.chains} chains of {sampling.draws} draws after {sampling.warm_up}.",
        **found,
    )


def _diagnostics(samples: dict[str, Floats]) -> tuple[float, float]:
    """Return the largest split R-hat and the smallest effective sample size over every sampled number."""
    from numpyro.diagnostics import effective_sample_size, split_gelman_rubin

    values = [draws.reshape(*draws.shape[:2], -1) for draws in samples.values()]
    whole = np.concatenate(values, axis=2)
    return float(np.max(split_gelman_rubin(whole))), float(np.min(effective_sample_size(whole)))


def _posterior(draws: Floats) -> Posterior:
    low, high = map(float, np.quantile(draws, TAILS))
    return Posterior(float(draws.mean()), (low, high))
