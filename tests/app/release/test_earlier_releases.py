"""The bundle and the database that earlier code wrote: they verify, import and are published again as before."""

import hashlib
import json
import re
import shutil

import pytest

from app.cli.main import main
from app.release.build import ReleaseRequest, build_release
from app.release.bundle import import_release, verify_bundle
from app.release.manifest import MANIFEST
from app.storage.merging import MergeError
from app.study.verification import verify_database
from tests.support import golden

EPISODES, MOVES = 53, 740


@pytest.fixture
def studies(tmp_path):
    """A copy of the earlier studies, with the bundle unpacked as `dunes-1`."""
    folder = golden.studies(tmp_path)
    shutil.unpack_archive(folder / "release" / "dunes-1.zip", folder)
    return folder


def printed(capsys, folder, *args):
    """What a command prints, without the rate of the simulation and the folder it was given."""
    with pytest.raises(SystemExit) as left:
        main([str(arg) for arg in args])
    text = re.sub(r", [\d,]+ episodes/s", "", capsys.readouterr().out).replace(f"{folder}/", "")
    text = re.sub(r"signer not checked: .*\n", "", text)  # a sentence of this version
    return f"{text}exit code {left.value.code}\n"


def without_release(text):
    """A document without what differs from one release to the next: version, dates, sizes and hashes."""
    text = re.sub(r"[0-9a-f]{64}|\d{4}-\d\d-\d\d(T[\d:]+Z)?|\b\d+ B\b", "?", text)
    succession = r"It supersedes version 1 \([^)]*\): please use this one and delete the other\."
    text = re.sub(succession, "This is the first version.", text)
    return re.sub(r'(?i)(version"?:? "?)\d+|-v\d+\b', r"\1?", text)


def test_verify_prints_what_it_printed_before(studies, tmp_path, capsys):
    found = ""
    for kind, name in (("--database", "studies-play.db"), ("--dataset", "dunes-1")):
        rest = ("--studies", studies) if kind == "--database" else ()
        found += f"$ marsexplorer verify {kind} {name}{' --studies .' if rest else ''}\n"
        found += printed(capsys, studies, "verify", kind, studies / name, *rest)
    assert found == (studies / "verify.txt").read_text()


def test_an_earlier_bundle_is_imported_once_and_refused_under_other_names(studies, tmp_path):
    counts = import_release(studies / "dunes-1", tmp_path / "new.db")
    assert (counts.added["participants"], counts.added["episodes"], counts.equal["episodes"]) == (
        10,
        EPISODES,
        0,
    )
    again = import_release(studies / "dunes-1", tmp_path / "new.db")
    assert (again.added["episodes"], again.equal["episodes"], again.equal["releases"]) == (
        0,
        EPISODES,
        0,
    )
    result = verify_database(tmp_path / "new.db")
    assert (result.findings, result.episodes, result.moves) == ((), EPISODES, MOVES)
    with pytest.raises(MergeError, match="under other names"):
        import_release(studies / "dunes-1", studies / "studies-play.db")
    assert verify_database(studies / "studies-play.db").findings == ()


def test_an_earlier_study_is_published_again_with_all_that_its_documents_held(studies, tmp_path):
    old = json.loads((studies / "dunes-1" / MANIFEST).read_text())
    request = ReleaseRequest(
        studies / "studies-play.db",
        "dunes",
        tmp_path / "dunes-2",
        tuple(old["authors"]),
        "https://example.org/dunes",
    )
    written = build_release(request)
    manifest_hash = hashlib.sha256((studies / "dunes-1" / MANIFEST).read_bytes()).hexdigest()
    assert (written.header.version, written.header.supersedes["manifest_sha256"]) == (
        2,
        manifest_hash,
    )
    assert verify_bundle(tmp_path / "dunes-2").verified.findings == ()
    assert (tmp_path / "dunes-2" / "protocol.json").read_text() == (
        studies / "dunes-1" / "protocol.json"
    ).read_text()
    for name in ("CITATION.cff", "LICENSE"):
        texts = [
            without_release((folder / name).read_text())
            for folder in (studies / "dunes-1", tmp_path / "dunes-2")
        ]
        assert texts[0] == texts[1]
    old_tables, new_tables = (
        columns(folder) for folder in (studies / "dunes-1", tmp_path / "dunes-2")
    )
    assert old_tables <= new_tables
    old_sets, new_sets = (
        record_sets(folder) for folder in (studies / "dunes-1", tmp_path / "dunes-2")
    )
    assert old_sets <= new_sets


def columns(folder):
    """Every column of a release's dictionary, with its type."""
    tables = json.loads((folder / "schema/columns.json").read_text())
    return {
        (name, each["name"], each["type"])
        for name, table in tables.items()
        for each in table["columns"]
    }


def record_sets(folder):
    """Every field of a release's Croissant metadata, with its type and where it is read from."""
    found = json.loads((folder / "croissant.json").read_text())["recordSet"]
    return {
        (field["@id"], field["dataType"], json.dumps(field["source"]))
        for each in found
        for field in each["field"]
    }
