"""`marsexplorer simulate`: synthetic players play a whole study over the sockets that browsers use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, print_table, progress

if TYPE_CHECKING:
    from app.simulate.outcome_log import OutcomeLog

KIND_NAMES = ("noisy-frontier", "random", "idler", "dropper", "reloader", "cheater", "mixed")
POPULATION_NAMES = ("skilled", "mixed", "clumsy")


@click.command()
@click.option("--study", required=True, metavar="NAME", help="A frozen study of the server.")
@click.option(
    "--players",
    type=click.IntRange(1, 1000),
    help="How many play at once.  [default: as many as the study plans]",
)
@click.option(
    "--kind", "kinds", type=click.Choice(KIND_NAMES), multiple=True, default=("noisy-frontier",), show_default=True,
    help="What they are like; given several times, the kinds are assigned in turn.",
)  # fmt: skip
@click.option(
    "--population", type=click.Choice(POPULATION_NAMES), default="mixed", show_default=True,
    help="What skill is drawn from: slips, luck and collisions.",
)  # fmt: skip
@click.option(
    "--url", default="http://127.0.0.1:8000", show_default=True, help="Where the server is."
)
@click.option(
    "--speed",
    type=click.FloatRange(0.1, 1e6),
    default=20.0,
    show_default=True,
    help="Times faster than people.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**53 - 1),
    default=0,
    show_default=True,
    help="Fixes skills, luck and slips.",
)
@click.option(
    "--patience",
    type=click.FloatRange(0),
    default=60.0,
    show_default=True,
    help="Seconds a stopped server is waited for.",
)
@click.option(
    "--state",
    type=PATH,
    help="File that keeps the players' cookies: the same command goes on after Ctrl-C.",
)
def simulate(
    study: str, players: int, kinds: tuple[str, ...], population: str, url: str, speed: float, seed: int, patience: float,
    state: Path | None,
) -> None:  # fmt: skip
    """Let synthetic players take part in a study of a running server, from the link to the completion code.

    \b
    They read the consent, play the tutorial, answer the questions, warm up, play the ranked episodes with breaks and
    look at the debrief, over the same HTTP calls and sockets as a browser. They are labelled `script` for ever and enter
    no human figure. When the server stops they wait for it and go on where they stood.

    \b
    Kinds:
      noisy-frontier  explores as people do, with slips; skill and luck of its own
      random          makes valid moves at random
      idler           leaves the keyboard for minutes now and then
      dropper         goes for ever after some ranked episodes
      reloader        reloads, opens a second tab and loses the connection all the time
      cheater         a machine's beat, no key-up, collisions, and everything a server has to refuse
      mixed           some of each

    \b
    Examples:
      marsexplorer simulate --study pilot                             as many players as planned, 20 times faster than people
      marsexplorer simulate --study pilot --kind mixed --speed 100         a rehearsal with everything that can go wrong
      marsexplorer simulate --study pilot --state pilot.json               Ctrl-C, and the same command goes on
      marsexplorer simulate --study load --players 100 --speed 1           load: moves per second and round trips at the end

    A server limits how many join and play from one address. With MARS_LIMITS__TOKEN set to the same text for the server
    and for this command, it does not limit these players.

    Exit code 1 when the server allowed something it must refuse, showed a ranked score, or lost a move.
    """
    import asyncio

    from app.simulate.outcome_log import OutcomeLog
    from app.simulate.participant import StudyOverError
    from app.simulate.persona import assign_kinds
    from app.simulate.run import fetch_study, simulate
    from app.simulate.state_file import SimulationConfig, StudyNotReadyError

    log, url = OutcomeLog(), url.rstrip("/")
    try:
        count = players or int(asyncio.run(fetch_study(url, study))["players"])
        config = SimulationConfig(
                url=url, study=study, kinds=assign_kinds(kinds, count), population=population, seed=seed, speed=speed,
                patience_s=patience, state=state,
            )  # fmt: skip
        with progress(f"{count} players") as advance:
            asyncio.run(simulate(config, log, advance))
    except StudyNotReadyError as error:
        raise click.UsageError(str(error)) from error
    except StudyOverError as error:
        _print_outcome(log)
        raise click.ClickException(str(error)) from error
    except KeyboardInterrupt:
        advice = (
            "the same command goes on"
            if state
            else "what was played is kept, but only --state FILE lets players go on"
        )
        click.echo(f"marsexplorer: stopped after {log.episodes} episodes; {advice}", err=True)
        raise click.Abort from None
    _print_outcome(log)
    if log.faults:
        more = f" (and {len(log.faults) - 1} more)" if len(log.faults) > 1 else ""
        raise click.ClickException(f"the server did what it must not: {log.faults[0]}{more}")


def _print_outcome(log: OutcomeLog) -> None:
    """Print one line for each player, then the load of the server."""
    rows = []
    for player in log.players:
        own = player.debrief or {}
        counts = [str(player.episodes[phase]) for phase in ("warm_up", "ranked")]
        means = [_shown(own.get("mean_score"), 4), _shown(own.get("mean_steps"), 1)]
        rows.append(
            [f"{player.number} {player.kind}", player.stage, *counts, *means, player.code or ""]
        )
    if rows:
        print_table(
            "Synthetic players",
            ["player", "stage", "warm-up", "ranked", "mean score", "mean steps", "code"],
            rows,
        )
    seconds = log.seconds()
    latency = ", ".join(f"{name} {ms:.1f}" for name, ms in log.latency_ms().items()) or "no move"
    click.echo(
        f"{log.moves} moves in {seconds:.1f} s: {log.moves / seconds:.0f} moves/s; act to frame in ms: {latency}"
    )
    click.echo(
        f"{log.episodes} episodes ended; {log.reloads} reloads; {log.lost_connections} lost connections"
    )
    if log.attempts:
        times, refused = (sum(pair[i] for pair in log.attempts.values()) for i in range(2))
        click.echo(f"cheating: {refused} of {times} attempts of {len(log.attempts)} kinds refused")
    for fault in log.faults:
        click.echo(f"fault: {fault}")


def _shown(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
