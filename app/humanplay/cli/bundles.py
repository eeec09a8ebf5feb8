"""Commands about bundles: release a study, derive its results again, import one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import ClickException, argument, echo, option

from humanplay.cli.options import DATABASE_AND_STUDIES, database_option
from humanplay.cli.settings import failures, pins_file
from humanplay.cli.study.report import show
from humanplay.command.console import print_table, progress
from humanplay.command.options import KEY, PATH, flag, path_option, several
from humanplay.task import counted

if TYPE_CHECKING:
    from humanplay.release.reproduce import Reproduction
    from humanplay.study.folder import Folder

MAX_PRINTED = 20
"""Differences that are printed; more are counted."""


@click.command(short_help="Write a study as a citable, signed bundle.")
@option("--study", required=True, help="The study's name.")
@path_option("--out", "A new folder for the bundle; it appears whole or not at all.", required=True)
@DATABASE_AND_STUDIES
@several("--author", "authors", "Who is to be cited; repeatable.")
@option("--url", help="Where the bundle will be found, a DOI's address say.")
@flag(
    "--answers",
    "Add each person's answers to the questions, where your consent says so; else there are counts of them.",
)
@flag(
    "--free-text",
    "Add what people wrote, where your consent says so; addresses and long numbers are masked, names are not.",
)
@several("--without-policy", "without", "Leave out a policy without a file here.", metavar="NAME")
def release(
    study: str,
    out: Path,
    database: Path,
    folder: Folder,
    authors: tuple[str, ...],
    url: str | None,
    without: tuple[str, ...],
    answers: bool,
    free_text: bool,
) -> None:
    """Write a closed study's episodes as SQLite, Parquet, CSV and Minari, signed.

    The study is verified first; one episode that fails, and nothing is written. The report is made
    from the bundle's own data and lies in it, with the episodes of the policies that it compares:
    `reproduce` derives it again. People appear under pseudonyms drawn anew for each release;
    identities, cookies and completion codes are never in it. The signing key lies beside the
    database and is drawn on first use: publish its fingerprint. docs/release.md says what is in a
    bundle and how a stranger checks it. It needs `pip install "humanplay[export]"`.

    \b
    Examples:
      humanplay release --study dunes --out dunes-1 --author "Ada Lovelace"
      humanplay verify --dataset dunes-1
      humanplay reproduce dunes-1
    """
    from humanplay.release.errors import check_libraries

    way_out = "; choose another --out"
    with failures(f"cannot write to {out}", way_out):
        check_libraries()
    from humanplay.release.build import build_release, request_of
    from humanplay.task import PolicyError

    try:
        with failures(f"cannot write to {out}", way_out):
            request = request_of(
                study, out, database, folder, authors, url, without, answers, free_text
            )
            with progress("verifying and writing") as advance:
                built = build_release(request, advance, progress)
    except PolicyError as error:
        raise ClickException(
            f"{error}; or leave that policy out of the report with --without-policy, which the datasheet then says"
        ) from error
    rows = built.header.rows
    counts = f"{counted(rows['episodes'], 'episode')}, {counted(rows['steps'], 'move')}"
    echo(f"{out}: version {built.header.version} of {study}, {counts}")
    if answers:
        unique, answered, _ = built.unique
        languages = " and the language that they read" * (len(built.header.protocol.languages) > 1)
        echo(
            f"{unique} of {counted(answered, 'person', 'people')} who answered {'is' if unique == 1 else 'are'} unique by "
            f"their answers{languages}: whoever knows these about somebody finds what they played"
        )
    if free_text:
        texts = counted(built.unique.texts, "free text")
        echo(
            f"{texts} in {out}/csv/free_texts.csv: a name is not masked, so read them before you publish"
        )
    if built.header.chain_head:
        head = built.header.chain_head
        echo(f"the head of the database's chain, for `humanplay verify --head {out}`: {head}")
    echo(f"the signing key's fingerprint, to publish beside it: {built.signer}")


@click.command(short_help="Derive a bundle's figures again and compare.")
@argument("folder", type=PATH)
@KEY
@flag("--recorded", "Do not play the policies again: replay their recorded moves only.")
def reproduce(folder: Path, key: str | None, recorded: bool) -> int:
    """Derive a bundle's report from the bundle alone, and compare every number.

    The people's episodes come from the bundle's database. The policies' episodes are replayed from
    their recorded moves; a policy whose file is here and has the same SHA-256 is played again as
    well. The exit code is 1 when a figure differs, or when a file is not the one that was signed.
    Neither the original database nor the study's folder is needed.

    \b
    Examples:
      humanplay reproduce dunes-1
      humanplay reproduce dunes-1 --key 15f592c2...
    """
    from humanplay.release import reproduce as derivation

    with failures("cannot read {file}"):
        reproduction = derivation.reproduce(folder, pins_file(), key, not recorded, progress)
    _show(folder, reproduction)
    return 1 if reproduction.differ or reproduction.findings else 0


def _show(folder: Path, reproduction: Reproduction) -> None:
    """Print whose files they are, what was compared and what differs."""
    for finding in reproduction.findings[:MAX_PRINTED]:
        echo(str(finding))
    echo(
        f"{folder}: {counted(reproduction.files, 'file')}, {len(reproduction.findings) or 'none'} not as signed"
    )
    echo(reproduction.signer.sentence())
    if reproduction.derived is not None:
        echo(
            "this bundle holds no report, so there is nothing to compare with; the report derived from it:"
        )
        for line in reproduction.left_out:
            echo(f"- {line}")
        show(reproduction.derived)
        return
    rows = [(name, f"{s.compared:,}", f"{s.differ:,}") for name, s in reproduction.sections.items()]
    print_table("figures derived again from the bundle", ("section", "compared", "differ"), rows)
    named = [line for section in reproduction.sections.values() for line in section.differences]
    for line in named[:MAX_PRINTED]:
        echo(line)
    if reproduction.differ > len(named[:MAX_PRINTED]):
        echo(f"... and {reproduction.differ - len(named[:MAX_PRINTED])} more")
    for line in reproduction.not_compared:
        echo(f"not compared: {line}")
    compared = sum(section.compared for section in reproduction.sections.values())
    echo(
        f"{counted(compared, 'value')} compared, {counted(reproduction.differ, 'differs', 'differ')}"
    )


@click.command("import", short_help="Bring a released bundle into a database.")
@argument("folder", type=PATH)
@database_option("The database to bring it into; made when absent.")
@KEY
def import_release(folder: Path, database: Path, key: str | None) -> None:
    """Verify a bundle that `release` wrote and bring its study into a database.

    All of it is brought in, or nothing. What is there already and equal stays; the same episodes
    under other names are refused. People whom the database has forgotten stay out. No server may
    have the database meanwhile.

    \b
    Examples:
      humanplay import dunes-1 --database dunes.db
      humanplay report --study dunes --database dunes.db
    """
    from humanplay.release import bundle
    from humanplay.release.manifest import read_manifest
    from humanplay.release.signing import check_signer, fingerprint_of

    with failures(f"cannot bring {folder} into {database}"):
        expected = None if key is None else fingerprint_of(key)
        with progress("verifying (the rules are compiled first)") as advance:
            counts = bundle.import_release(folder, database, advance, expected)
        signer = check_signer(read_manifest(folder)[0], expected, pins_file())
    there = (
        f", {counted(counts.equal['episodes'], 'was', 'were')} there already"
        if counts.equal["episodes"]
        else ""
    )
    words = (
        "person stayed out, who was forgotten here",
        "people stayed out, who were forgotten here",
    )
    left = f"; {counted(counts.forgotten, *words)}" if counts.forgotten else ""
    people, episodes = counts.added["participants"], counts.added["episodes"]
    brought = f"{counted(people, 'participant')} and {counted(episodes, 'episode')}"
    echo(f"{database}: {brought} from {folder}{there}{left}")
    echo(signer.sentence())
