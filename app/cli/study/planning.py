"""What `marsexplorer study` says of a study's power, and the command `study preregister`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, STUDIES, folder_of, reason, study_errors

if TYPE_CHECKING:
    from app.statistics.planning import StudyPlan
    from app.study.protocol import Protocol


def with_reachable_effects(protocol: Protocol) -> Protocol:
    """Return a new protocol with the margin and the difference from a policy that its players see with 80 % power."""
    from app.statistics.planning import derived_difference, derived_margin
    from app.study.protocol import parse_protocol

    reachable = {
        "equivalence_margin": derived_margin(protocol),
        "policy_difference": derived_difference(protocol),
    }
    found = {name: value for name, value in reachable.items() if value is not None}
    return parse_protocol({**protocol.model_dump(mode="json", exclude_unset=True), **found})


def echo_reachable_effects(protocol: Protocol) -> None:
    """Print what margin and difference a new protocol holds, and what they rest on."""
    if protocol.policy_difference is None:
        click.echo(
            "One player gives no interval and no test: plan at least two to compare anything."
        )
        return
    margin = (
        f"changes of ±{protocol.equivalence_margin:g}"
        if protocol.ranked >= 3
        else "no learning (below 3 ranked episodes)"
    )
    click.echo(
        f"{protocol.players} players see, with 80 % power, {margin} and differences from a policy of "
        f"{protocol.policy_difference:g} steps: equivalence_margin and policy_difference. That rests on standard deviations of "
        f"{protocol.assumed_player_sd:g} steps between players and {protocol.assumed_episode_sd:g} between episodes, which are "
        "those of synthetic players: put better ones into the protocol where you have them."
    )


def checked_plan(protocol: Protocol, is_underpowered_fine: bool) -> StudyPlan:
    """Return what the protocol can see; UsageError where a planned comparison has less than 50 % power."""
    from app.statistics.planning import plan_study

    plan = plan_study(protocol)
    if plan.underpowered and not is_underpowered_fine:
        each = plan.underpowered[0]
        ways = [f"plan {each.players} players"] if each.players is not None else []
        if each.least is not None and each.least < protocol.env_config.limit:
            ways.append(f"write {math.ceil(each.least)} or more as {each.field}")
        raise click.UsageError(
            f"{_comparison(each)}, and below 50 % a study more likely misses than sees what it is for: "
            f"{', or '.join([*ways, 'freeze with --underpowered where it is a rehearsal or a pilot'])}"
        )
    return plan


def echo_plan(plan: StudyPlan) -> None:
    """Print the width of the interval and the power of each planned comparison."""
    assumed = (
        "those of a new study, since the protocol names none"
        if plan.is_default
        else "the protocol's"
    )
    click.echo(
        f"assumed standard deviations ({assumed}): {plan.player_sd:g} steps between players, {plan.episode_sd:g} episodes"
    )
    if plan.half_width is not None:
        click.echo(
            f"mean steps to 99 %: ±{plan.half_width[0]:.1f} on average, at most ±{plan.half_width[1]:.1f} in 80 % of studies"
        )
    for each in plan.comparisons:
        more = "" if each.least is None else f"; 80 % from {each.least:.1f} steps"
        click.echo(f"power: {_comparison(each)}{more}")


def _comparison(each: Any) -> str:
    return f"{each.what}: seen in {100 * each.power:.0f} % of studies"


@click.command(short_help="Write the preregistration, ready for OSF.")
@click.argument("name")
@click.option(
    "--out", type=PATH, metavar="FILE", help="Write it to this file.  [default: print it]"
)
@STUDIES
def preregister(name: str, out: Path | None, studies: Path | None) -> None:
    """Write a study's preregistration as Markdown, to be uploaded to OSF or elsewhere before anybody plays.

    Hypotheses, estimands, sample and recruitment, exclusion, the stopping rule, analyses, power, and the
    hash and the commitment that fix protocol and terrains; and what is not preregistered. What only you know is marked
    TO BE STATED. A draft gives a preview, marked DRAFT, without hash and commitment.

    \b
    Examples:
      marsexplorer study preregister pilot
      marsexplorer study preregister pilot --out pilot-preregistration.md
    """
    from app.report.preregistration import preregistration
    from app.study.templates import fill
    from marsexplorer.files import write_whole

    folder = folder_of(studies)
    with study_errors():
        found = None if folder.status(name) == "draft" else folder.study(name)
        protocol = fill(folder.draft(name)) if found is None else found.protocol
        text = preregistration(protocol, found)
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        with write_whole(out) as file:
            file.write(text.encode())
    except OSError as error:
        raise click.ClickException(
            f"cannot write {out}: {reason(error)}; choose another --out"
        ) from error
    click.echo(
        f"{out}: read it, state what is marked TO BE STATED, then register it before anybody plays"
    )
