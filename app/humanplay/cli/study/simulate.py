"""`humanplay simulate`: synthetic participants try a study before people come."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click
from click import ClickException, UsageError, echo, option

from humanplay.command.console import print_table, progress
from humanplay.task import counted

if TYPE_CHECKING:
    from humanplay.web.simulate import ParticipantSummary

TOKEN_VARIABLE = "HUMANPLAY_LIMITS__TOKEN"
"""The variable that holds the server's token, with which any number may play from one address."""
SHARE = click.FloatRange(0, 1)


@click.command()
@option("--study", required=True, metavar="NAME", help="A frozen study of the server.")
@option(
    "--participants",
    type=click.IntRange(1, 1000),
    help="How many take part side by side.  [default: as many as the study plans]",
)
@option(
    "--policy", help="Name or path of what they follow.  [default: the environment's, else none]"
)
@option("--noise", type=SHARE, default=0.1, help="Share of random moves; all without a policy.")
@option("--leaving", type=SHARE, default=0.0, help="Share who leave in a ranked episode.")
@option("--speed", type=click.FloatRange(0.1, 1e6), default=20.0, help="Times faster than people.")
@option("--seed", default=0, help="Fixes moves, tempo and who leaves.")
@option("--url", default="http://127.0.0.1:8000", help="Where the server is.")
def simulate(study: str, participants: int | None, url: str, **options: Any) -> None:
    """Let synthetic participants take part in a running server's study.

    They agree to the consent, play the tutorial, answer the questions, warm up, play the ranked
    episodes and look at the debrief, over the calls and the socket of the study's page. They are
    labelled `script` for ever and enter no human score. When the server stops they wait for it for a
    minute and go on where they stood.

    \b
    Examples:
      humanplay simulate --study pilot
      humanplay simulate --study pilot --leaving 0.2 --noise 0.3
      humanplay simulate --study load --participants 100 --speed 1

    A server limits how many join and play from one address. With HUMANPLAY_LIMITS__TOKEN set to the same
    text for the server and for this command, it does not limit these participants.
    """
    from httpx import HTTPError

    from humanplay.web.simulate import Plan, RefusedError, ServerAwayError, fetch_study, simulate

    plan = Plan(url.rstrip("/"), study, 0, token=os.environ.get(TOKEN_VARIABLE), **options)
    summaries: list[ParticipantSummary] = []
    try:
        plan = replace(plan, participants=participants or int(fetch_study(plan)["players"]))
        with progress(f"{counted(plan.participants, 'participant')}") as advance:
            simulate(plan, summaries, advance)
    except HTTPError as error:
        raise UsageError(
            f"no server at {url} ({error}): start one with `humanplay serve`, or say where with --url"
        ) from error
    except ValueError as error:
        raise UsageError(str(error)) from error
    except (RefusedError, ServerAwayError) as error:
        raise ClickException(str(error)) from error
    finally:
        _print_summaries(summaries)


def _print_summaries(summaries: list[ParticipantSummary]) -> None:
    """Print a line for each participant, then how long the server took for moves."""
    import numpy as np

    if not summaries:
        return
    names = ("mean_score", "mean_steps")
    print_table(
        "Synthetic participants",
        ["number", "stage", "warm-up", "ranked", "minutes", "mean score", "mean steps", "code"],
        [
            [
                str(summary.number),
                summary.stage,
                str(summary.warm_up),
                str(summary.ranked),
                f"{summary.minutes:.1f}",
            ]
            + [_shown((summary.debrief or {}).get(name)) for name in names]
            + [_shown(summary.code)]
            for summary in summaries
        ],
    )
    echo("minutes: at a person's pace of pressing keys, without the time to read and think")
    trips = [ms for summary in summaries for ms in summary.round_trips_ms]
    if trips:
        p50, p95, p99 = np.percentile(trips, (50, 95, 99))
        echo(
            f"{counted(len(trips), 'move')}; act to frame in ms: p50 {p50:.1f}, p95 {p95:.1f}, p99 {p99:.1f}, "
            f"max {max(trips):.1f}"
        )


def _shown(value: float | str | None) -> str:
    return f"{value:.4f}" if isinstance(value, float) else str(value or "")
