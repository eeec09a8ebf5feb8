"""The command `marsexplorer release`: a study as a citable bundle."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import PATH, progress, reason, settings_of


@click.command(short_help="Write a study as a citable, signed bundle.")
@click.option("--study", required=True, help="The study's name.")
@click.option(
    "--out",
    type=PATH,
    required=True,
    help="A new folder for the bundle; it appears whole or not at all.",
)
@click.option("--database", type=PATH, help="The database the study was played in.")
@click.option("--studies", type=PATH, help="The folder of studies.  [default: data/studies]")
@click.option("--author", "authors", multiple=True, help="Who is to be cited; repeatable.")
@click.option("--url", help="Where the bundle will be found, a DOI's address say.")
@click.option(
    "--without-policy",
    "without",
    multiple=True,
    metavar="NAME",
    help="Leave a policy out of the report: its file is not at hand.",
)
def release(
    study: str,
    out: Path,
    database: Path | None,
    studies: Path | None,
    authors: tuple[str, ...],
    url: str | None,
    without: tuple[str, ...],
) -> None:
    """Write every finished episode of a closed study as SQLite, Parquet, CSV and Minari, described and signed.

    The study is verified first; one episode that fails, and nothing is written. The report is made from the bundle's own
    data and lies in it, with the episodes of the policies that it compares: `reproduce` derives it again. People appear
    under pseudonyms drawn anew for each release; identities, cookies and completion codes are never in it. The signing
    key lies beside the database and is drawn on first use: publish its fingerprint. docs/release.md says what is in a
    bundle and how a stranger checks it. It needs `pip install "marsexplorer-playground[export]"`.

    \b
    Examples:
      marsexplorer release --study dunes --out dunes-1 --author "Ada Lovelace"
      marsexplorer verify --dataset dunes-1
      marsexplorer reproduce dunes-1
    """
    from app.release.errors import ReleaseError, check_libraries

    try:
        check_libraries()
    except ReleaseError as error:
        raise click.ClickException(str(error)) from error
    from app.release.build import build_release, request_of
    from app.storage.database import StoreError
    from app.study.protocol import StudyError
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    settings = settings_of()
    places = database or settings.database, studies or settings.studies
    try:
        request = request_of(study, out, *places, authors, url, without)
        with progress("verifying and writing") as advance:
            built = build_release(request, advance, progress)
    except (PolicyNotFoundError, PolicyFileError) as error:
        raise click.ClickException(
            f"{error}; or leave that policy out of the report with --without-policy, which the datasheet then says"
        ) from error
    except (ReleaseError, StoreError, StudyError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(
            f"cannot write to {out}: {reason(error)}; choose another --out"
        ) from error
    rows = built.header.rows
    click.echo(
        f"{out}: version {built.header.version} of {study}, {rows['episodes']:,} episodes, {rows['steps']:,} moves"
    )
    if built.header.chain_head:
        click.echo(
            f"the head of the database's chain, for `marsexplorer verify --head {out}`: {built.header.chain_head}"
        )
    click.echo(f"the signing key's fingerprint, to publish beside it: {built.signer}")
