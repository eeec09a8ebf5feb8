"""The command `marsexplorer reproduce`: the figures of a bundle derived again from the bundle alone, and compared."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from app.cli.console import PATH, pins_file, print_table, reason
from app.cli.report import show
from app.cli.study_report import REPORT_FILES, build_report, has_played, play_compared, replay_pictures

if TYPE_CHECKING:
    from app.report.model import Report
    from app.report.reproduction import Section
    from app.study.data import StudyData
    from app.study.policy_episodes import PolicyEpisode

MAX_PRINTED = 20
"""Differences that are printed; more are counted."""


@dataclass
class Derivation:
    """What was derived from a bundle: its data, the policies' episodes, what was compared, and what was not (sentences)."""

    folder: Path
    data: StudyData
    episodes: tuple[PolicyEpisode, ...]
    sections: dict[str, Section] = field(default_factory=dict)
    not_compared: list[str] = field(default_factory=list)


@click.command(short_help="Derive a bundle's figures again and compare.")
@click.argument("folder", type=PATH)
@click.option("--key", metavar="FINGERPRINT|FILE", help="The key that must have signed the bundle.")
@click.option("--recorded", is_flag=True, help="Do not play the policies again: replay their recorded moves only.")
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
        made = _read_bundle(folder)
        is_compared = _compare(made)
        if not recorded:
            _play_again(made)
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


def _read_bundle(folder: Path) -> Derivation:
    """Return the bundle's data and its policies' episodes."""
    from app.release.derived import read_policy_episodes
    from app.release.header import BUNDLE_DATABASE
    from app.release.manifest import read_manifest
    from app.storage.connection import reading
    from app.study.data import load
    from app.study.looks import LOOKS_FILE, read_looks

    manifest, _ = read_manifest(folder)
    with reading(folder / BUNDLE_DATABASE) as conn:
        episodes = read_policy_episodes(conn)
    data = load(folder / BUNDLE_DATABASE, str(manifest["study"]))
    return Derivation(folder, replace(data, looks=read_looks(folder / LOOKS_FILE)), episodes)


def _compare(made: Derivation) -> bool:
    """Derive each report that the bundle holds and compare; False when it holds none, and the derived one is shown."""
    found = [synthetic for synthetic in REPORT_FILES if (made.folder / REPORT_FILES[synthetic][0]).exists()]
    if not found:
        click.echo("this bundle holds no report, so there is nothing to compare with; the report derived from it:")
        if has_played(made.data, synthetic=False):
            made = replace(made, episodes=made.episodes or _play_at_hand(made))
        show(_derive(made, synthetic=False))
        return False
    for synthetic in found:
        _compare_report(made, synthetic)
    _replay_policies(made)
    return True


def _derive(made: Derivation, synthetic: bool) -> Report:
    from app.release.header import BUNDLE_DATABASE
    from app.storage.reader import Reader

    reader = Reader.open(made.folder / BUNDLE_DATABASE)
    try:
        pictures = replay_pictures(reader, made.data, synthetic)
    finally:
        reader.close()
    return build_report(made.data, made.episodes, synthetic, pictures)


def _compare_report(made: Derivation, synthetic: bool) -> None:
    """Compare one report's numbers, and its page as text."""
    from app.report.page import render
    from app.report.reproduction import NOT_COMPARED, Section, compare_reports

    json_name, html_name = REPORT_FILES[synthetic]
    recorded: dict[str, Any] = json.loads((made.folder / json_name).read_bytes())
    derived = _derive(made, synthetic)
    mark = "scripts: " if synthetic else ""
    made.sections |= {mark + name: section for name, section in compare_reports(recorded, derived.to_dict()).items()}
    if recorded["software_version"] == derived.software_version:
        page = render(replace(derived, made_at=recorded["made_at"]))
        section = made.sections.setdefault(f"{mark}page", Section())
        text = (made.folder / html_name).read_text(encoding="utf-8")
        section.add(html_name, "the page", "another page", page == text)
    else:
        made.not_compared.append(f"{html_name}: version {recorded['software_version']} of the software set it")
    made.not_compared.append(f"{json_name}: {' and '.join(NOT_COMPARED)}, which say when and by what it was made")


def _replay_policies(made: Derivation) -> None:
    """Compare the policies' recorded episodes with their replay on the terrains that follow from the study's secret."""
    from app.report.reproduction import Section
    from app.study.policy_episodes import ranked_seeds

    data, section = made.data, made.sections.setdefault("policies' episodes, replayed", Section())
    seeds = ranked_seeds(data.protocol, data.protocol_hash, data.secret) if data.secret else {}
    for each in made.episodes:
        where = f"{each.policy}, terrain {each.terrain}"
        section.add(f"{where}: seed", each.seed, seeds.get(each.terrain), each.seed == seeds.get(each.terrain))
        found = each.replay(data.protocol.env_config).record().trajectory_hash
        section.add(f"{where}: trajectory hash", each.trajectory_hash, found, each.trajectory_hash == found)


def _play_again(made: Derivation) -> None:
    """Play each policy again whose file is at hand and the same, and compare the moves."""
    from app.report.reproduction import Section
    from marsexplorer.config import CORE_VERSION

    recorded = {(each.policy, each.terrain): each for each in made.episodes}
    names = [name for name in dict.fromkeys(each.policy for each in made.episodes) if _is_at_hand(made, name)]
    if not names or made.data.protocol.core_version != CORE_VERSION:
        return
    seeds = {each.terrain: each.seed for each in made.episodes}
    section = made.sections.setdefault("policies' episodes, played again", Section())
    for each in play_compared(made.data, seeds, names):
        before = recorded[each.policy, each.terrain]
        hashes = before.trajectory_hash, each.trajectory_hash
        section.add(f"{each.policy}, terrain {each.terrain}: trajectory hash", *hashes, hashes[0] == hashes[1])


def _is_at_hand(made: Derivation, name: str) -> bool:
    """Return whether the policy that played is here; what is not is noted."""
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load, policy_hash

    (recorded, *_) = (each.policy_hash for each in made.episodes if each.policy == name)
    try:
        load(name, made.data.protocol.env_config.sensor_radius)
        is_same = policy_hash(name) == recorded
        why = f"its file here has another SHA-256 than {recorded}"
    except (PolicyNotFoundError, PolicyFileError) as error:
        is_same, why = False, str(error)
    if not is_same:
        made.not_compared.append(f"{name} was not played again, its recorded moves were replayed: {why}")
    return is_same


def _play_at_hand(made: Derivation) -> tuple[PolicyEpisode, ...]:
    """Return episodes of those policies of the protocol that are here, for a bundle that holds none."""
    from app.study.policy_episodes import compared_policies, ranked_seeds
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError, load

    data, names = made.data, []
    for name in compared_policies(data.protocol):
        try:
            load(name, data.protocol.env_config.sensor_radius)
            names.append(name)
        except (PolicyNotFoundError, PolicyFileError) as error:
            click.echo(f"- {name} is left out: {error}")
    seeds = ranked_seeds(data.protocol, data.protocol_hash, data.secret) if data.secret else data.seeds()
    return play_compared(data, seeds, names)


def _print(made: Derivation) -> int:
    """Print what was compared and what differs; return how many values differ."""
    rows = [(name, f"{each.compared:,}", f"{each.differ:,}") for name, each in made.sections.items()]
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
