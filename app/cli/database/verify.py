"""The command `marsexplorer verify`: is everything as it was recorded?"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from app.cli.console import PATH, pins_file, progress, reason, settings_of

if TYPE_CHECKING:
    from app.study.verification import Verification

MAX_PRINTED = 200
"""Findings that are printed; more are counted."""


@click.command(short_help="Simulate every episode again and compare.")
@click.option(
    "--database", type=PATH, help="The database to verify; a running server may go on writing."
)
@click.option("--dataset", type=PATH, help="A folder that `release` wrote, instead of a database.")
@click.option(
    "--studies",
    type=PATH,
    help="The folder of studies, for the secrets of open ones.  [default: data/studies]",
)
@click.option(
    "--key",
    "--signer",
    "key",
    metavar="FINGERPRINT|FILE",
    help="The key that must have signed the dataset.",
)
@click.option(
    "--pin",
    "to_pin",
    is_flag=True,
    help="Remember the dataset's signing key as a known one, if all else is well.",
)
@click.option(
    "--head",
    help="A head of the database's chain from before, or a release's folder, which holds one.",
)
def verify(
    database: Path | None,
    dataset: Path | None,
    studies: Path | None,
    key: str | None,
    to_pin: bool,
    head: str | None,
) -> int:
    """Simulate every finished episode from its configuration, terrain and actions, and compare all that was recorded.

    Every reward, outcome, total, score and trajectory hash is compared, every seed with its terrain, every study
    with its protocol, and every stored field of episodes, sessions, players, participants and studies with the
    chain of hashes that grew while they were recorded. Each difference is printed; the exit code is 1 when there is
    one. A dataset's files and signature are checked as well.
    This proves the record consistent. The chain's head is printed: keep it, or publish it. --head with an earlier
    one says whether everything up to it still stands, and what was changed or forgotten since. Who made a
    dataset is proved by its signature, to whoever knows the key's fingerprint: --key. Without it, and while the key
    is not pinned, the signer is said to be not checked.

    \b
    Examples:
      marsexplorer verify
      marsexplorer verify --database lab.db
      marsexplorer verify --head 9c0d1ab2...
      marsexplorer verify --head dunes-1
      marsexplorer verify --dataset dunes-1 --key 15f592c2...
    """
    if database is not None and dataset is not None:
        raise click.UsageError("give --database or --dataset, not both")
    if dataset is None and (key is not None or to_pin):
        raise click.UsageError(
            f"--{'signer' if key is not None else 'pin'} goes with --dataset: a database is not signed"
        )
    if head is not None and dataset is not None:
        raise click.UsageError(
            "--head goes with --database: a dataset's signature stands for all of it"
        )
    from app.release.errors import ReleaseError
    from app.storage.database import StoreError

    try:
        about, signer = "", None
        if dataset is None:
            result, about = _of_database(database, studies, head)
        else:
            result, about, signer = _of_dataset(dataset, key, to_pin)
    except (StoreError, ReleaseError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error
    for finding in result.findings[:MAX_PRINTED]:
        click.echo(str(finding))
    if len(result.findings) > MAX_PRINTED:
        click.echo(f"... and {len(result.findings) - MAX_PRINTED} more")
    click.echo(_sentence(result, about))
    for line in _chain_lines(result):
        click.echo(line)
    if signer:
        click.echo(signer)
    return 1 if result.findings else 0


def _of_database(
    database: Path | None, studies: Path | None, head: str | None
) -> tuple[Verification, str]:
    from app.study.folder import Folder
    from app.study.verification import check_policy_files, verify_database

    settings = settings_of()
    path, folder = database or settings.database, Folder(studies or settings.studies)
    known = {name: secret for name, (_, secret) in folder.known_secrets().items()}
    earlier = None if head is None else _earlier_head(head)
    with progress("verifying (the rules are compiled first)") as advance:
        result = verify_database(path, advance, known, head=earlier)
    return replace(result, findings=(*result.findings, *check_policy_files(folder, known))), str(
        path
    )


def _earlier_head(given: str) -> str:
    """Return the head that was given in hexadecimal, or the one that a release's manifest holds."""
    from app.release.errors import ReleaseError
    from app.release.manifest import read_manifest

    if not Path(given).is_dir():
        if not re.fullmatch(r"[0-9a-fA-F]{64}", given):
            raise click.UsageError(
                f"--head is the 64 hexadecimal digits that `verify` printed, or a release's folder, got {given!r}"
            )
        return given.lower()
    found = read_manifest(Path(given))[0].get("chain_head")
    if not found:
        raise ReleaseError(
            f"{given} holds no head of a chain: an earlier version of the software wrote it"
        )
    return str(found)


def _of_dataset(dataset: Path, key: str | None, to_pin: bool) -> tuple[Verification, str, str]:
    """Return what was found, the dataset in words, and what is known of its signer."""
    from app.release.bundle import verify_bundle
    from app.release.signers import check_signer, fingerprint_of, pin

    expected = None if key is None else fingerprint_of(key)
    with progress("verifying (the rules are compiled first)") as advance:
        found = verify_bundle(dataset, advance, expected)
    if to_pin and not found.verified.findings:
        pin(pins_file(), found.manifest)
    signer = check_signer(found.manifest, expected, pins_file()).sentence()
    key_words = f"signed by the key {found.manifest.get('signer')}"
    about = f"{dataset}, version {found.manifest.get('version')} of {found.manifest.get('study')}, {key_words}"
    return found.verified, about, signer


def _sentence(result: Verification, about: str) -> str:
    rate = (
        f", {result.episodes / result.seconds:,.0f} episodes/s"
        if result.seconds > 0 and result.episodes
        else ""
    )
    still_open = (
        f"; {result.still_open} unfinished ones were not simulated" if result.still_open else ""
    )
    verdict = (
        f"{result.failed} of its parts DIFFER from what was recorded"
        if result.findings
        else "all as recorded"
    )
    return f"{about}: {verdict}; {result.episodes:,} episodes of {result.moves:,} moves simulated{rate}{still_open}"


def _chain_lines(result: Verification) -> Iterator[str]:
    """Yield what the chain is, and what came after the earlier head that was asked for."""
    if result.chain is not None and result.chain.entries:
        forgotten = (
            f", {result.chain.forgotten} of them of forgotten people"
            if result.chain.forgotten
            else ""
        )
        yield f"chain: {result.chain.entries:,} entries{forgotten}; head {result.chain.head}"
    if (since := result.since) is not None:
        day = datetime.fromtimestamp(since.day_ms / 1000, UTC).date().isoformat()
        yield f"the head {since.head} is that of entry {since.entry:,}, of {day}; since then: {_counted(since.added)}"
        yield f"of what stood then, changed since: {_counted(since.replaced)}; forgotten since: {_counted(since.forgotten)}"


def _counted(counts: Mapping[str, int]) -> str:
    return (
        ", ".join(f"{count:,} of kind {kind}" for kind, count in sorted(counts.items()))
        or "nothing"
    )
