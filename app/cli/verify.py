"""The command `marsexplorer verify`: is everything as it was recorded?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, progress, reason, settings_of

if TYPE_CHECKING:
    from app.study.verification import Verification

MAX_PRINTED = 200
"""Findings that are printed; more are counted."""


@click.command(short_help="Simulate every episode again and compare.")
@click.option("--database", type=PATH, help="The database to verify; a running server may go on writing.")
@click.option("--dataset", type=PATH, help="A folder that `release` wrote, instead of a database.")
@click.option("--studies", type=PATH, help="The folder of studies, for the secrets of open ones.  [default: data/studies]")
@click.option("--signer", help="The fingerprint that the dataset's signing key must have.")
def verify(database: Path | None, dataset: Path | None, studies: Path | None, signer: str | None) -> int:
    """Simulate every finished episode from its configuration, terrain and actions, and compare all that was recorded.

    Every reward, outcome, total, score and trajectory hash is compared, every seed with its terrain, every study
    with its protocol, and a digest over every stored field with one kept when the episode ended. Each difference is
    printed; the exit code is 1 when there is one. A dataset's files and signature are checked as well.
    This proves the record consistent. Who made it is proved by the signature, to whoever knows the key's
    fingerprint: --signer.

    \b
    Examples:
      marsexplorer verify
      marsexplorer verify --database lab.db
      marsexplorer verify --dataset dunes-1 --signer 15f592c2...
    """
    if database is not None and dataset is not None:
        raise click.UsageError("give --database or --dataset, not both")
    if signer is not None and dataset is None:
        raise click.UsageError("--signer goes with --dataset: a database is not signed")
    from app.release.errors import ReleaseError
    from app.storage.database import StoreError

    try:
        result, about = _of_dataset(dataset, signer) if dataset is not None else _of_database(database, studies)
    except (StoreError, ReleaseError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error
    for finding in result.findings[:MAX_PRINTED]:
        click.echo(str(finding))
    if len(result.findings) > MAX_PRINTED:
        click.echo(f"... and {len(result.findings) - MAX_PRINTED} more")
    click.echo(_sentence(result, about))
    return 1 if result.findings else 0


def _of_database(database: Path | None, studies: Path | None) -> tuple[Verification, str]:
    from app.study.folder import Folder
    from app.study.verification import verify_database

    settings = settings_of()
    path = database or settings.database
    known = {name: secret for name, (_, secret) in Folder(studies or settings.studies).known_secrets().items()}
    with progress("verifying (the rules are compiled first)") as advance:
        return verify_database(path, advance, known), str(path)


def _of_dataset(dataset: Path, signer: str | None) -> tuple[Verification, str]:
    from app.release.bundle import verify_bundle

    with progress("verifying (the rules are compiled first)") as advance:
        found = verify_bundle(dataset, advance, signer)
    key = f"signed by the key {found.manifest.get('signer')}"
    return found.verified, f"{dataset}, version {found.manifest.get('version')} of {found.manifest.get('study')}, {key}"


def _sentence(result: Verification, about: str) -> str:
    rate = f", {result.episodes / result.seconds:,.0f} episodes/s" if result.seconds > 0 and result.episodes else ""
    still_open = f"; {result.still_open} unfinished ones were not simulated" if result.still_open else ""
    verdict = f"{result.failed} of its parts DIFFER from what was recorded" if result.findings else "all as recorded"
    return f"{about}: {verdict}; {result.episodes:,} episodes of {result.moves:,} moves simulated{rate}{still_open}"
