"""The Bayesian mixed model in the report: sampled over the primary set of each group, and its tables."""

from __future__ import annotations

from dataclasses import replace

from app.report.model import GroupReport, Report
from app.report.page_table import PageTable
from app.statistics.bayesian_model import (
    BayesianModel,
    Posterior,
    Sampling,
    episodes_of,
    fit_bayesian_model,
)
from app.statistics.exclusion_sets import Cohort, members, people_of, scripts_of
from app.statistics.formatting import interval, number
from app.study.data import StudyData

HEADS = ("quantity", "posterior mean", "95 % interval")


def with_bayesian_models(
    report: Report, data: StudyData, sampling: Sampling | None = None
) -> Report:
    """Return the report with the Bayesian model of each group; data: what the report was made from."""
    cohorts = {
        cohort.name: cohort
        for cohort in (scripts_of(data) if report.synthetic else [people_of(data)])
    }
    groups = (
        replace(group, bayesian=_fitted(data, cohorts[group.name], group.primary, sampling))
        for group in report.groups
    )
    return replace(report, groups=tuple(groups))


def _fitted(
    data: StudyData, cohort: Cohort, primary: str, sampling: Sampling | None
) -> BayesianModel:
    ids = members(cohort, data.protocol.exclusion.get(primary, {}))
    return fit_bayesian_model(episodes_of(cohort, ids, data.protocol.env_config.limit), sampling)


def bayesian_rows(model: BayesianModel) -> list[tuple[str, str, str]]:
    """Return quantity, posterior mean and interval of each figure; nothing where nothing was sampled."""
    quantities = (
        ("typical steps to 99 % (average player and terrain)", model.typical, 1),
        ("mean steps to 99 %, other players and terrains", model.mean, 1),
        ("change from the first to the last trial, in %", model.change, 1),
        ("SD of log steps between players", model.player_sd, 3),
        ("SD of log steps between terrains", model.terrain_sd, 3),
        ("SD of log steps of the rest", model.rest_sd, 3),
    )
    return [
        (name, *_cells(found, digits)) for name, found, digits in quantities if found is not None
    ]


def bayesian_tables(group: GroupReport) -> tuple[PageTable, ...]:
    """Return the figures and the terrains' factors; nothing where no model was asked for or sampled."""
    model = group.bayesian
    if model is None or not (rows := bayesian_rows(model)):
        return ()
    factors = [(str(each.terrain), *_cells(each.factor, 3)) for each in model.terrains]
    return (
        PageTable(
            "Bayesian mixed model of the steps to 99 %, unfinished episodes censored", HEADS, rows
        ),
        PageTable(
            "By how much each ranked terrain multiplies everybody's steps",
            ("terrain", *HEADS[1:]),
            factors,
        ),
    )


def sampling_sentence(model: BayesianModel) -> str:
    """Return how many episodes entered and how well the chains mixed."""
    entered = f"{model.episodes} episodes entered, {model.censored} of them censored."
    if model.r_hat is None or model.effective is None:
        return f"{model.note} {entered}"
    return (
        f"{model.note} {entered} Largest R-hat {model.r_hat:.3f}, smallest effective sample size {model.effective:.0f}, "
        f"{model.diverging} divergent transitions."
    )


def _cells(found: Posterior, digits: int) -> tuple[str, str]:
    return number(found.mean, digits), interval(found.interval, digits)
