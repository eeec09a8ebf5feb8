"""The command `marsexplorer clone`: a policy that moves as the people of a release do."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, interruptible, progress, reason

if TYPE_CHECKING:
    from app.moves.clones import CloneEpisodes
    from app.study.data import StudyData

COMPARED = ("ppo", "frontier-cost", "frontier-utility")
"""Policies whose agreement with the players is printed with the clone's."""


@click.command(short_help="Train a policy on the moves of a release's people.")
@click.argument("folder", type=PATH)
@click.option("--out", type=PATH, help="The policy's file.  [default: clone-STUDY.safetensors]")
@click.option(
    "--epochs",
    default=12,
    show_default=True,
    type=click.IntRange(1, 1000),
    help="Passes over the moves.",
)
@click.option(
    "--seed",
    default=0,
    show_default=True,
    help="Of the weights, the batches and the terrains that are held out.",
)
@click.option(
    "--synthetic",
    is_flag=True,
    help="Train on the scripts of the release; the card says SYNTHETIC.",
)
def clone(folder: Path, out: Path | None, epochs: int, seed: int, synthetic: bool) -> None:
    """Train a network by behaviour cloning on a release, and print how much it moves like its people.

    A fifth of the ranked terrains is held out; the agreement is the share of moves there that the clone would have made
    too, in the mean over players. The file plays like any other policy. It takes a few minutes of one core.

    \b
    Examples:
      marsexplorer clone dunes-1
      marsexplorer clone dunes-1 --out dunes-clone.safetensors
      marsexplorer serve --policy dunes-clone.safetensors
    """
    from app.release.errors import ReleaseError
    from app.release.header import BUNDLE_DATABASE
    from app.release.manifest import check_files, read_manifest
    from app.storage.database import StoreError

    try:
        manifest, _ = read_manifest(folder)
        findings = list(check_files(folder, manifest))
        if findings:
            raise click.ClickException(
                f"{folder} is not as it was signed: {findings[0]}; get the release again"
            )
        data, episodes = _read(folder / BUNDLE_DATABASE, str(manifest["study"]), synthetic, seed)
        file = out or Path(f"clone-{data.protocol.name}.safetensors")
        _train(file, data, episodes, epochs, seed, synthetic)
    except (ReleaseError, StoreError, ValueError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(
            f"cannot write the policy: {reason(error)}; choose another --out"
        ) from error


def _read(
    database: Path, study: str, synthetic: bool, seed: int
) -> tuple[StudyData, CloneEpisodes]:
    from app.moves.clones import clone_episodes
    from app.storage.reader import Reader
    from app.study.data import load

    reader = Reader.open(database)
    try:
        data = load(reader, study)
        return data, clone_episodes(reader, data, synthetic, seed)
    finally:
        reader.close()


def _train(
    file: Path, data: StudyData, episodes: CloneEpisodes, epochs: int, seed: int, synthetic: bool
) -> None:
    """Train the clone, write its file with its card, and print what it came to."""
    from app.moves.clones import agreement_on, mean_steps
    from marsexplorer.policies import load
    from marsexplorer.policies.files.weights import save_network
    from marsexplorer.policies.network.model import NetworkPolicy
    from marsexplorer.training.clone import CloneConfig, demonstrations_of, train_clone

    config, radius = CloneConfig(epochs=epochs, seed=seed), data.protocol.env_config.sensor_radius
    demonstrations = demonstrations_of(episodes.trained)
    with progress("cloning") as advance:
        net = interruptible(lambda: train_clone(demonstrations, config, advance))
    policy = NetworkPolicy(file.stem, net, radius)
    likeness, steps = agreement_on(episodes, policy), mean_steps(episodes.records(), policy)
    who = "scripts (SYNTHETIC)" if synthetic else "people"
    card: dict[str, Any] = {
        "summary": f"A clone of the {who} of the study {data.protocol.name}, from {len(demonstrations.actions):,} moves.",
        "command": f"marsexplorer clone FOLDER --epochs {epochs} --seed {seed}"
        + " --synthetic" * synthetic,
        "size": [data.protocol.env_config.rows, data.protocol.env_config.cols],
        "results": {
            "human_likeness": likeness,
            "steps": steps,
            "held_out_terrains": len(episodes.terrains),
        },
        "training": {
            **asdict(config),
            "moves": len(demonstrations.actions),
            "protocol_hash": data.protocol_hash,
        },
        "synthetic": synthetic,
    }
    save_network(net, file, card)
    click.echo(f"{file}: {card['summary']}")
    click.echo(f"on {len(episodes.terrains)} held-out terrains it makes {likeness:.1%} of the players' moves, "
               f"and needs {steps:.1f} steps to 99 %")  # fmt: skip
    compared = (f"{name} {agreement_on(episodes, load(name, radius)):.1%}" for name in COMPARED)
    click.echo(f"other policies make of them: {', '.join(compared)}")
