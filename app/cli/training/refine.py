"""The command `marsexplorer refine`: a trained policy learns what other moves would have cost it."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, reason, seed_option
from app.cli.training.cards import commit, hardware, measure_policy
from app.cli.training.refining import RefineOutput, refine_policy


@click.command(short_help="Improve a trained policy by trying other moves.")
@click.argument("policy", default="ppo")
@click.option(
    "--rounds",
    type=click.IntRange(min=1),
    default=30,
    show_default=True,
    help="Rounds of playing and learning; the first takes longest.",
)
@click.option(
    "--size",
    "sizes",
    type=click.IntRange(21, 84),
    multiple=True,
    default=(21,),
    show_default=True,
    help="Side of the square grids whose episodes are branched; repeatable.",
)
@seed_option("The same seed and rounds give the same weights.")
@click.option("--out", type=PATH, help="Folder of the run.  [default: runs/POLICY-refined-sSEED]")
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes that play episodes.  [default: one for each core]",
)
def refine(
    policy: str,
    rounds: int,
    sizes: tuple[int, ...],
    seed: int,
    out: Path | None,
    workers: int | None,
) -> None:
    """Improve a policy that `train` made, POLICY being its name or file.

    Its episodes are branched: at some steps another move is made and the episode is played to its end, so that the network
    learns which moves would have been better. On grids that are not branched the network is kept close to what it
    was. The folder --out gets the policy with its card and a log after every round; Ctrl-C
    loses only the round under way. Refining takes about 3 GiB of memory, and 1 GiB more for each process.

    \b
    Examples:
      marsexplorer refine                                           the shipped policy, 30 rounds
      marsexplorer refine runs/mine/mine.safetensors --rounds 10
      marsexplorer serve --policy runs/mine-refined-s0/mine-refined-s0.safetensors
    """
    from app.jobs import cores
    from marsexplorer.config import EnvConfig
    from marsexplorer.policies.base import PolicyFileError
    from marsexplorer.policies.files.card import read_card, shipped
    from marsexplorer.policies.network.model import load_net
    from marsexplorer.training.refine import RefineRun, config_for

    path = shipped().get(policy, Path(policy))
    try:
        net, card = load_net(path), read_card(path)
    except PolicyFileError as error:
        raise click.UsageError(str(error)) from error
    folder = out or Path("runs") / f"{path.stem}-refined-s{seed}"
    file = folder / f"{folder.resolve().name}.safetensors"
    if file.exists():
        raise click.UsageError(
            f"{file} exists already; go on from it (marsexplorer refine {file}) or give another --out"
        )
    options = "".join(f" --size {size}" for size in sizes if sizes != (21,))
    command = (
        f"marsexplorer refine {policy}{options} --rounds {rounds} --seed {seed} --out {folder.name}"
    )
    processes = workers or cores()
    run = RefineRun(
        net, seed, config_for(rounds, sizes, was_refined="pairs" in card.get("training", {}))
    )
    own_card = {"command": command, "commit": commit(), "hardware": hardware(processes)}
    output = RefineOutput(file, run, rounds, card, own_card, folder / "log.jsonl")
    try:
        refine_policy(output, processes)
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {folder}: {reason(error)}; choose another --out"
        ) from error
    except KeyboardInterrupt:
        left = (
            f"{file} is as it was after round {run.rounds_done}"
            if run.rounds_done
            else "nothing is written before the first round is done"
        )
        click.echo(f"stopped; {left}", err=True)
        raise
    click.echo(f"{file}: {measure_policy(file, output.save_policy, [EnvConfig()])}")
