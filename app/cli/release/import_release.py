"""The command `marsexplorer import`: a released bundle into a database."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, pins_file, progress, reason, settings_of


@click.command("import", short_help="Bring a released bundle into a database.")
@click.argument("folder", type=PATH)
@click.option("--database", type=PATH, help="The database to bring it into; made when absent.")
@click.option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed the bundle.")
def import_release(folder: Path, database: Path | None, key: str | None) -> None:
    """Verify a bundle that `release` wrote and bring its study into a database, all of it or nothing.

    What is there already and equal is let be; the same episodes under other names are refused. People whom the database
    has forgotten stay out. No server may have the database meanwhile.

    \b
    Examples:
      marsexplorer import dunes-1 --database dunes.db
      marsexplorer report --study dunes --database dunes.db
    """
    from app.release import bundle
    from app.release.errors import ReleaseError
    from app.release.manifest import read_manifest
    from app.release.signing import check_signer, fingerprint_of
    from app.storage.database import StoreError

    path = database or settings_of().database
    try:
        expected = None if key is None else fingerprint_of(key)
        with progress("verifying (the rules are compiled first)") as advance:
            counts = bundle.import_release(folder, path, advance, expected)
        signer = check_signer(read_manifest(folder)[0], expected, pins_file())
    except (ReleaseError, StoreError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot bring {folder} into {path}: {reason(error)}") from error
    there = f", {counts.equal['episodes']:,} were there already" if counts.equal["episodes"] else ""
    left = (
        f"; {counts.forgotten} people stayed out, who were forgotten here"
        if counts.forgotten
        else ""
    )
    people, episodes = counts.added["participants"], counts.added["episodes"]
    click.echo(
        f"{path}: {people} participants and {episodes:,} episodes from {folder}{there}{left}"
    )
    click.echo(signer.sentence())
