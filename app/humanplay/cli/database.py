"""Commands about what a server recorded.

They export, verify, back up, restore and merge databases, and forget people.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click import UsageError, argument, echo, option

from humanplay.cli.options import database_option
from humanplay.cli.settings import failures, pins_file, place, settings_of
from humanplay.command.console import progress
from humanplay.command.options import KEY, PATH, flag, path_option
from humanplay.task import counted

if TYPE_CHECKING:
    from humanplay.db.export import Keep
    from humanplay.db.reader import Who
    from humanplay.db.rows import AskedBy
    from humanplay.db.study_rows import Participant
    from humanplay.study.verification import Verification


SERVERS = "The database that the server records in, if it is not the default one."


@click.command(short_help="Write what was played as CSV.")
@database_option("The database to read; a running server may go on writing.")
@path_option("--out", "Folder for episodes.csv and steps.csv; made when absent.", required=True)
@option(
    "--who", type=click.Choice(["all", "human"]), default="all", help="human: only people's episodes that count.",
)  # fmt: skip
@flag("--parquet", "Write episodes.parquet and steps.parquet beside them too.")
@option(
    "--minari",
    metavar="ID",
    help="Write the counted episodes of people as this Minari dataset too.",
)
@flag("--open-studies", "Take in studies that are not closed; the chain and their reports say so.")
def export(
    database: Path, out: Path, who: Who, parquet: bool, minari: str | None, open_studies: bool
) -> None:
    """Write every finished episode, and every step of it, as two tables.

    Episodes of open studies are left out: nobody sees figures of people while a study runs.
    --open-studies takes them in, and the chain of the database and the study's report say when.

    Each episode is replayed on its way out; `verified` is false where the replay differs from what
    was recorded. Players appear under pseudonyms drawn anew for each export. docs/data.md lists the
    columns, and datapackage.json beside the files has their types. All appear whole or not at all.

    \b
    Examples:
      humanplay export --out results
      humanplay export --database lab.db --out results --who human
      humanplay export --database plays.db --out results --parquet --minari lake/people-v0
    """
    from humanplay.db.export import export_to
    from humanplay.release.plays import minari_of, parquet_paths, parquet_tables

    with failures(f"cannot write to {out}, choose another --out"), progress("exporting") as advance:
        tables: AbstractContextManager[Keep | None] = (
            parquet_tables(out) if parquet else nullcontext()
        )
        with tables as keep:
            summary = export_to(database, out, who, advance, open_studies, keep)
        if parquet:
            summary += f"; {', '.join(map(str, parquet_paths(out)))}"
        if minari is not None:
            summary += f"; {minari_of(database, minari)}"
    echo(summary)


MAX_PRINTED = 200
"""Findings that are printed; more are counted."""


@click.command(short_help="Simulate every episode again and compare.")
@path_option("--database", "The database to verify; a running server may go on writing.")
@path_option("--dataset", "A folder that `release` wrote, instead of a database.")
@KEY
@flag("--pin", "to_pin", "Remember the dataset's signing key as a known one, if all else is well.")
@option("--head", help="A head of the chain from before, or a release's folder, which holds one.")
@flag(
    "--accept-loss",
    "Verify what is there, and let a server start with it, although commits are missing.",
)
def verify(
    database: Path | None,
    dataset: Path | None,
    key: str | None,
    to_pin: bool,
    head: str | None,
    accept_loss: bool,
) -> int:
    """Simulate every finished episode again, and compare all that was recorded.

    An episode is simulated from its configuration, terrain and actions. Every reward, outcome,
    total, score and trajectory hash is compared, every seed with its terrain, every study with its
    protocol, and every stored field of episodes, sessions, players, participants and studies with
    the chain of hashes that grew while they were recorded. Each difference is printed; the exit
    code is 1 when there is one. A dataset's files and signature are checked as well. This proves
    the record consistent. The chain's head is printed: keep it, or publish it. --head with an
    earlier one says whether everything up to it still stands, and what was changed or forgotten
    since. Who made a dataset is proved by its signature, to whoever knows the key's fingerprint:
    --key. Without it, and while the key is not pinned, the signer is said to be not checked.

    \b
    Examples:
      humanplay verify
      humanplay verify --database lab.db
      humanplay verify --head 9c0d1ab2...
      humanplay verify --head dunes-1
      humanplay verify --dataset dunes-1 --key 15f592c2...
    """
    if database is not None and dataset is not None:
        raise UsageError("give --database or --dataset, not both")
    if dataset is None and (key is not None or to_pin):
        option_name = "--key" if key is not None else "--pin"
        raise UsageError(f"{option_name} goes with --dataset: a database is not signed")
    if dataset is not None and head is not None:
        raise UsageError("--head goes with --database: a dataset's signature stands for all of it")
    if dataset is not None and accept_loss:
        raise UsageError("--accept-loss goes with --database: nothing is noted beside a dataset")
    signer = None
    with failures(f"cannot read {dataset or 'the database'}"):
        if dataset is None:
            verification, about = _of_database(database, head, accept_loss)
        else:
            verification, about, signer = _of_dataset(dataset, key, to_pin)
    for finding in verification.findings[:MAX_PRINTED]:
        echo(str(finding))
    if len(verification.findings) > MAX_PRINTED:
        echo(f"... and {len(verification.findings) - MAX_PRINTED} more")
    echo(_sentence(verification, about))
    for line in _chain_lines(verification):
        echo(line)
    if signer:
        echo(signer)
    return 1 if verification.findings else 0


def _of_database(
    database: Path | None, head: str | None, accept_loss: bool
) -> tuple[Verification, str]:
    from humanplay.db.database import accept_missing
    from humanplay.study.folder import Folder
    from humanplay.study.verification import check_policy_files, verify_database

    path = database or place().database
    folder = Folder.beside(path)
    known_secrets = {name: secret for name, (_, secret) in folder.known_secrets().items()}
    earlier = None if head is None else _earlier_head(head)
    if accept_loss:
        accept_missing(path)
    with progress("verifying (the rules are compiled first)") as advance:
        verification = verify_database(path, advance, known_secrets, head=earlier)
    findings = (*verification.findings, *check_policy_files(folder, known_secrets))
    return replace(verification, findings=findings), str(path)


def _earlier_head(head: str) -> str:
    """The earlier head of a chain that --head names.

    Args:
        head: 64 hexadecimal digits, or a release's folder, whose manifest holds one.
    """
    from humanplay.release.errors import ReleaseError
    from humanplay.release.manifest import read_manifest

    if not Path(head).is_dir():
        if not re.fullmatch(r"[0-9a-fA-F]{64}", head):
            raise UsageError(
                f"--head is the 64 hexadecimal digits that `verify` printed, or a release's folder, got {head!r}"
            )
        return head.lower()
    in_manifest = read_manifest(Path(head))[0].get("chain_head")
    if not in_manifest:
        raise ReleaseError(f"{head} holds no head of a chain: give one that `release` wrote whole")
    return str(in_manifest)


def _of_dataset(dataset: Path, key: str | None, to_pin: bool) -> tuple[Verification, str, str]:
    """The verification, the dataset in words, and what is known of its signer."""
    from humanplay.release.bundle import verify_bundle
    from humanplay.release.signing import check_signer, fingerprint_of, pin

    expected = None if key is None else fingerprint_of(key)
    with progress("verifying (the rules are compiled first)") as advance:
        checked = verify_bundle(dataset, advance, expected)
    if to_pin and not checked.verified.findings:
        pin(pins_file(), checked.manifest)
    signer = check_signer(checked.manifest, expected, pins_file()).sentence()
    key_words = f"signed by the key {checked.manifest.get('signer')}"
    about = f"{dataset}, version {checked.manifest.get('version')} of {checked.manifest.get('study')}, {key_words}"
    return checked.verified, about, signer


def _sentence(verification: Verification, about: str) -> str:
    verdict, rate, rest = "all as recorded", "", ""
    if verification.findings:
        verdict = f"{counted(verification.failed, 'of its parts DIFFERS', 'of its parts DIFFER')} from what was recorded"
    if verification.seconds > 0 and verification.episodes:
        rate = f", {verification.episodes / verification.seconds:,.0f} episodes/s"
    if verification.still_open:
        rest = f"; {counted(verification.still_open, 'unfinished one was', 'unfinished ones were')} not simulated"
    return f"{about}: {verdict}; {counted(verification.episodes, 'episode')} simulated{rate}{rest}"


def _chain_lines(verification: Verification) -> Iterator[str]:
    """Yield the state of the chain, and what came after an earlier head."""
    if verification.chain is not None and verification.chain.entries:
        gone = verification.chain.forgotten
        forgotten = f", {gone} of them of forgotten people" if gone else ""
        yield f"chain: {counted(verification.chain.entries, 'entry', 'entries')}{forgotten}; head {verification.chain.head}"
    if (since := verification.since) is not None:
        day = datetime.fromtimestamp(since.day_ms / 1000, UTC).date().isoformat()
        yield f"the head {since.head} is that of entry {since.entry:,}, of {day}; since then: {_counted(since.added)}"
        yield f"of what stood then, changed since: {_counted(since.replaced)}; forgotten since: {_counted(since.forgotten)}"


def _counted(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{counts[kind]:,} of kind {kind}" for kind in sorted(counts)) or "nothing"


@click.command(short_help="Copy the database while people play.")
@argument("file", type=PATH)
@database_option("The database to copy; a running server may go on writing.")
def backup(file: Path, database: Path) -> None:
    """Write the database as it is now into FILE, a new file, and verify it.

    Every page, every reference and the chain are checked. FILE is there when the copy is whole, and
    not before: Ctrl-C leaves nothing. A server makes backups by itself with `serve --backup-every
    MINUTES --backup-to DIR`; `humanplay restore FILE` puts one back.

    \b
    Examples:
      humanplay backup monday.db
      humanplay backup /mnt/backups/lab.db --database lab.db
    """
    from humanplay.db.backup import back_up
    from humanplay.db.file import recordings_beside

    with failures("cannot read the database"), progress("copying") as advance:
        size = back_up(database, file, advance)
    folder = recordings_beside(file)
    beside = f"; the recordings are in {folder}" if folder.is_dir() else ""
    echo(f"wrote {file}: {size / 1e6:.1f} MB, verified{beside}")


@click.command(short_help="Put a backup in the place of the database.")
@argument("backup", type=PATH)
@database_option("The database whose place it takes.")
@flag("--yes", "Do not ask.")
def restore(backup: Path, database: Path, yes: bool) -> None:
    """Put a copy of BACKUP in the place of the database, once it is verified.

    What stood there stays beside it as NAME.before-TIME, so nothing is deleted. Stop the server
    first: while one runs, nothing is changed.

    \b
    Examples:
      humanplay restore monday.db
      humanplay restore /mnt/backups/lab-20261122T150000Z.db --database lab.db --yes
    """
    from humanplay.db.backup import check_restorable
    from humanplay.db.backup import restore as put_back

    if database.exists() and not yes:
        with failures("cannot read the database"):
            check_restorable(backup, database)
        click.confirm(f"Put {backup} in the place of {database}?", abort=True, err=True)
    with failures("cannot read the database"), progress("copying") as advance:
        old = put_back(backup, database, datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ"), advance)
    before = "" if old is None else f"; what stood there is {old}"
    echo(f"restored {database} from {backup}, verified{before}")


@click.command(short_help="Join the databases of several servers.")
@argument("databases", type=PATH, nargs=-1, required=True, metavar="A.db B.db ...")
@path_option("--out", "A new file for all of it; it appears whole or not at all.", required=True)
def merge(databases: tuple[Path, ...], out: Path) -> None:
    """Join databases in which the same study, or different ones, were played.

    The sources stay as they are. What two of them hold alike is taken once; two contents under one
    id are refused. Whoever was forgotten in one of them is left out. The key that signs cookies is
    not taken along, so the new file knows no browser again; names that players chose stay in their
    servers' own files, where they can be changed. A server may go on writing meanwhile.

    \b
    Examples:
      humanplay merge berlin.db athens.db --out both.db
      humanplay verify --database both.db
    """
    if len(databases) < 2:
        raise UsageError("give two databases or more: humanplay merge A.db B.db --out C.db")
    from humanplay.db import merging

    with failures(f"cannot write {out}, choose another --out"), progress("joining") as advance:
        counts, twice = merging.merge(databases, out, advance)
    equal = counts.equal["episodes"]
    alike = f", {equal:,} of them in more than one" if equal else ""
    left = (
        f"; {counted(counts.forgotten, 'person left out, who was', 'people left out, who were')} forgotten"
        if counts.forgotten
        else ""
    )
    people, episodes = counts.added["participants"], counts.added["episodes"]
    brought = f"{counted(people, 'participant')} and {counted(episodes, 'episode')}"
    echo(f"{out}: {brought} from {counted(len(databases), 'database')}{alike}{left}")
    if twice:
        echo(
            f"beware: {counted(twice, 'outside id or invitation', 'outside ids or invitations')} took part in a study "
            "twice, on two servers; the report counts each as two people"
        )


@click.command(short_help="Erase a participant, or a player.")
@argument("participant")
@option("--study", help="The study, where an outside id took part in several.")
@option(
    "--asked-by",
    type=click.Choice(["participant", "operator", "review board"]),
    help="Who asked for it: the report of the study says so.  [default: participant, if they asked on their page]",
)
@flag("--player", "A player by the name that they chose.")
@database_option("The database to erase them from.")
@flag("--yes", "Do not ask.")
def forget(
    participant: str,
    study: str | None,
    asked_by: AskedBy | None,
    player: bool,
    database: Path,
    yes: bool,
) -> None:
    """Erase a participant for good.

    Name them by id, the label of their page or the outside id of their link.

    With --player it is a player of the playground, by the name that they chose: name and all that
    they played go.

    Their outside ids, cookie and completion code go, and their episodes with every move and key
    press, those outside the study too, unless the study's protocol keeps episodes: then these stay
    under new ids. The file is written anew and its log emptied, within a minute, while a server may
    go on. Hashes of the erased trajectories stop a bundle from bringing them back; a keyed hash of
    their outside id keeps them out of the study until it is closed, when the key is deleted. Copies
    elsewhere, backups and bundles that were published, are yours to replace: backups are named, and
    the next `release` is a successor that says so. For --player stop the server first.

    \b
    Examples:
      humanplay forget 6ABA18A1
      humanplay forget 5f3e0c9a1b2d --study dunes
      humanplay forget Ada --player
      humanplay forget 0123456789abcdef0123456789abcdef --database lab.db --yes
    """
    from humanplay.db import erasure
    from humanplay.db.file import DatabaseLock
    from humanplay.report.costs import forget_costs

    with failures(f"cannot write {database}"):
        erasure.finish_erasure(database)
    if player:
        with failures(f"cannot write {database}"):
            erasure.find_player(database, participant)
            if not yes:
                DatabaseLock(database).close()
                question = f"Erase the player {participant} from {database} for good?"
                click.confirm(question, abort=True, err=True)
            count = erasure.forget_player(database, participant)
            forget_costs(database)
        echo(f"erased from {database}: the player {participant}, {counted(count, 'episode')}")
        return
    with failures(f"cannot write {database}"):
        person = erasure.find_participant(database, participant, study)
        if not yes:
            click.confirm(
                f"Erase the participant {participant} ({person.kind}, stage {person.stage}) of the study "
                f"{person.study} from {database} for good?",
                abort=True,
                err=True,
            )
        _keep_out(database, person)
        try:
            done = erasure.forget(database, person.id, study, asked_by)
        finally:
            forget_costs(database)
    stays = ""
    if done.keeps:
        stays = ", and the episodes of the study stay without a person, as its protocol says"
    erased = f"one participant of {done.study}, {counted(done.episodes, 'episode')}"
    echo(f"erased from {database}: {erased}{stays}")
    if done.outdated:
        versions = ", ".join(map(str, done.outdated))
        echo(
            f"released with the participant in it: version {versions} of {done.study}; publish the successor, "
            f"`humanplay release --study {done.study} --out DIR`, and withdraw the other"
        )
    if backups := _backups_of(database):
        echo(f"backups that still hold them: {', '.join(map(str, backups))}")


def _keep_out(database: Path, person: Participant) -> None:
    """Let a running study keep out whoever has a participant's outside id.

    It stores a keyed hash of the id.
    """
    from humanplay.db.erasure import identity_of_person
    from humanplay.study.folder import Folder, StudyError
    from humanplay.study.kept_out import keep_out

    folder, ident = Folder.beside(database), identity_of_person(database, person)
    try:
        is_running = folder.study(person.study).is_running
    except StudyError:  # the study's folder is not at hand
        return
    if ident is not None and is_running:
        keep_out(folder.path(person.study), [ident])


def _backups_of(database: Path) -> list[Path]:
    """The backups that a server made of a database, in the folder of the settings."""
    from humanplay.db.backup import Backups

    folder = database.with_name("backups")
    with suppress(UsageError):  # settings that concern only a server may be wrong
        folder = settings_of().backup_to or folder
    return Backups(database, folder, 1.0).existing() if folder.is_dir() else []
