"""The command `marsexplorer reproduce`: the figures of a bundle derived again from the bundle alone, and compared."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, pins_file, print_table, reason
from app.cli.release.derivation import (
    Derivation,
    derive,
    known_moves,
    play_again,
    play_at_hand,
    read_bundle,
    replay_policies,
)
from app.cli.study.report import show
from app.cli.study.study_report import REPORT_FILES, has_played

if TYPE_CHECKING:
    from app.moves.analysis import KnownMoves

MAX_PRINTED = 20
"""Differences that are printed; more are counted."""


@click.command(short_help="Derive a bundle's figures again and compare.")
@click.argument("folder", type=PATH)
@click.option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed the bundle.")
@click.option(
    "--recorded",
    is_flag=True,
    help="Do not play the policies again: replay their recorded moves only.",
)
def reproduce(folder: Path, key: str | None, recorded: bool) -> int:
    """Derive every figure of a bundle's report from the bundle alone, and compare number by number.

    The people's episodes come from the bundle's database. The policies' episodes are replayed from their recorded moves;
    a policy whose file is here and has the same SHA-256 is played again as well. The exit code is 1 when a figure
    differs, or when a file is not the one that was signed. Neither the original database nor the study's folder is needed.

    \b
    Examples:
      marsexplorer reproduce dunes-1
      marsexplorer reproduce dunes-1 --key 15f592c2...
    """
    from app.release.errors import ReleaseError
    from app.storage.database import StoreError
    from app.study.protocol import StudyError

    try:
        findings = _check_bundle(folder, key)
        made = read_bundle(folder)
        is_compared = _compare(made, not recorded)
        if not recorded:
            play_again(made)
    except (ReleaseError, StoreError, StudyError) as error:
        raise click.ClickException(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"cannot read {error.filename}: {reason(error)}") from error
    differ = _print(made) if is_compared else 0
    return 1 if differ or findings else 0


def _check_bundle(folder: Path, key: str | None) -> int:
    """Print whether the files are those that were signed, and by whom; return how many findings there are."""
    from app.release.manifest import check_files, read_manifest
    from app.release.signers import check_signer, fingerprint_of

    manifest, _ = read_manifest(folder)
    expected = None if key is None else fingerprint_of(key)
    findings = list(check_files(folder, manifest, expected))
    for finding in findings[:MAX_PRINTED]:
        click.echo(str(finding))
    click.echo(f"{folder}: {len(manifest['files'])} files, {len(findings) or 'none'} not as signed")
    click.echo(check_signer(manifest, expected, pins_file()).sentence())
    return len(findings)


def _compare(made: Derivation, plays_again: bool) -> bool:
    """Derive each report that the bundle holds and compare; False when it holds none, and the derived one is shown."""
    found = [
        synthetic
        for synthetic in REPORT_FILES
        if (made.folder / REPORT_FILES[synthetic][0]).exists()
    ]
    if not found:
        click.echo(
            "this bundle holds no report, so there is nothing to compare with; the report derived from it:"
        )
        if has_played(made.data, synthetic=False):
            made = replace(made, episodes=made.episodes or play_at_hand(made))
        show(derive(made, synthetic=False))
        return False
    with TemporaryDirectory() as cache:
        known = known_moves(made, Path(cache), plays_again)
        for synthetic in found:
            _compare_report(made, synthetic, known)
    replay_policies(made)
    return True


def _compare_report(made: Derivation, synthetic: bool, known: KnownMoves | None) -> None:
    """Compare one report's numbers, and its page as text."""
    from app.report.page import render
    from app.report.reproduction import MOVE_KEYS, NOT_COMPARED, compare_reports

    json_name, html_name = REPORT_FILES[synthetic]
    recorded: dict[str, Any] = json.loads((made.folder / json_name).read_bytes())
    derived = derive(made, synthetic, known)
    has_moves = known is not None or not made.regret_policy_hash
    mark = "scripts: " if synthetic else ""
    found = compare_reports(recorded, derived.to_dict(), () if has_moves else MOVE_KEYS)
    made.sections |= {mark + name: section for name, section in found.items()}
    made.not_compared.append(
        f"{json_name}: {' and '.join(NOT_COMPARED)}, which say when and by what it was made"
    )
    if recorded["software_version"] != derived.software_version:
        made.not_compared.append(
            f"{html_name}: version {recorded['software_version']} of the software set it"
        )
    elif not has_moves:
        made.not_compared.append(f"{html_name}, and in {json_name} what the moves say")
    else:
        page = render(replace(derived, made_at=recorded["made_at"]))
        is_same = page == (made.folder / html_name).read_text(encoding="utf-8")
        made.section(f"{mark}page").add(html_name, "the page", "another page", is_same)


def _print(made: Derivation) -> int:
    """Print what was compared and what differs; return how many values differ."""
    rows = [
        (name, f"{each.compared:,}", f"{each.differ:,}") for name, each in made.sections.items()
    ]
    compared = sum(each.compared for each in made.sections.values())
    differ = sum(each.differ for each in made.sections.values())
    print_table("figures derived again from the bundle", ("section", "compared", "differ"), rows)
    named = [line for each in made.sections.values() for line in each.differences]
    for line in named[:MAX_PRINTED]:
        click.echo(line)
    if differ > len(named[:MAX_PRINTED]):
        click.echo(f"... and {differ - len(named[:MAX_PRINTED])} more")
    for line in made.not_compared:
        click.echo(f"not compared: {line}")
    click.echo(f"{compared:,} values compared, {differ:,} differ")
    return differ
