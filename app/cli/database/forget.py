"""The command `marsexplorer forget`: a participant erased."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, reason, settings_of


@click.command(short_help="Erase a participant.")
@click.argument("participant")
@click.option("--study", help="The study, where an outside id took part in several.")
@click.option("--database", type=PATH, help="The database to erase them from.")
@click.option("--yes", is_flag=True, help="Do not ask.")
def forget(participant: str, study: str | None, database: Path | None, yes: bool) -> None:
    """Erase a participant, named by their id, the label their page shows or the outside id of their link, for good.

    Their outside ids, cookie and completion code go, and their episodes with every move and key press, those outside the
    study too, unless the study's protocol keeps episodes: then these stay under new ids. The file is written anew and its
    log emptied. Hashes of the erased trajectories stop a bundle from bringing them back. Copies elsewhere, backups and
    bundles that were published, are yours to replace: the next `release` is a successor that says so.
    Stop the server first.

    \b
    Examples:
      marsexplorer forget 6ABA18A1
      marsexplorer forget 5f3e0c9a1b2d --study dunes
      marsexplorer forget 0123456789abcdef0123456789abcdef --database lab.db --yes
    """
    from app.moves.regret import forget_regrets
    from app.storage import erasure
    from app.storage.database import StoreError

    path = database or settings_of().database
    try:
        found = erasure.find_participant(path, participant, study)
        if not yes:
            what = f"the participant {participant} ({found['kind']}, stage {found['stage']}) of the study {found['study']}"
            click.confirm(f"Erase {what} from {path} for good?", abort=True, err=True)
        done = erasure.forget(path, participant, study)
        forget_regrets(path)
    except StoreError as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot write {path}: {reason(error)}") from error
    kept = (
        ", and the episodes of the study stay without a person, as its protocol says"
        if done.keeps
        else ""
    )
    click.echo(
        f"erased from {path}: one participant of {done.study}, {done.episodes} episodes{kept}"
    )
    if done.outdated:
        versions = ", ".join(map(str, done.outdated))
        click.echo(
            f"released with the participant in it: version {versions} of {done.study}; publish the successor, "
            f"`marsexplorer release --study {done.study} --out DIR`, and withdraw the other"
        )
