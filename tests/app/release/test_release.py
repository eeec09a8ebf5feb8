"""The commands `release` and `import`.

What is in a bundle, that nobody can be recognised in it, that it comes back unchanged, and each
refusal.
"""

import csv
import hashlib
import json
import re
import shutil
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pyarrow.parquet as pq
import pytest

from humanplay.db import chain
from humanplay.db.columns import BUNDLE_TABLES, bundle_table, dictionary
from humanplay.db.series import StudyStore
from humanplay.db.store import SessionRow, Store, StoreError
from humanplay.release import signing
from humanplay.release.build import ReleaseRequest, build_release
from humanplay.release.bundle import import_release, verify_bundle
from humanplay.release.errors import ReleaseError
from humanplay.release.manifest import MANIFEST, PUBLIC_KEY, SIGNATURE, listing, sha256
from humanplay.release.tables import PARQUET
from humanplay.study.protocol import canonical, canonical_json, parse_protocol
from humanplay.study.verification import verify_database
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from tests.support.command import command as run
from tests.support.recorded import alter, ask
from tests.support.stored_studies import (
    BEGAN,
    CONFIG,
    IDENTITIES,
    StudyRecorder,
    freeze,
    play_study,
)

ROOT = Path(__file__).parents[3]


@pytest.fixture
def copy(published, tmp_path):
    """A copy of the release, and of its database, that may be harmed."""
    shutil.copytree(published[0] / "out", tmp_path / "out")
    for path in published[0].glob("play.db*"):
        if path.is_file():
            shutil.copy(path, tmp_path / path.name)
    return tmp_path


def table(path, name, order):
    return ask(path, f"SELECT * FROM {name} ORDER BY {order}")


def test_a_release_holds_what_it_says_and_verifies(published):
    folder, built = published
    out = folder / "out"
    names = {
        *("study.sqlite", "croissant.json", "protocol.json", "DATASHEET.md", "CITATION.cff"),
        *("LICENSE", MANIFEST, SIGNATURE, PUBLIC_KEY, "columns.json"),
        *(f"parquet/{name}.parquet" for name in PARQUET), *(f"csv/{name}.csv" for name in BUNDLE_TABLES),
        "queries.sql",
        *(f"report{kind}.{form}" for kind in ("", "-synthetic") for form in ("json", "html")),
        *(f"minari/humanplay/dunes/{who}-v1/data/{name}" for who in ("human", "script")
          for name in ("main_data.hdf5", "metadata.json")),
    }  # fmt: skip
    assert names <= set(listing(out))
    checked = verify_bundle(out, signer=built.signer)
    assert checked.verified.findings == ()
    assert checked.verified.episodes == 18
    assert checked.manifest["rows"]["episodes"] == 18
    assert checked.manifest["left_out"] == {"open_episodes": 0, "without_consent": 1}
    assert not list(folder.glob(".out*"))


def traces(folder):
    """Everything in the database that says who somebody is, or lets one act for them."""
    texts = {value.format(number) for value in IDENTITIES.values() for number in (0, 1, 2, 7)}
    ids = "participants.id players.id sessions.id participants.completion_code"
    for name in f"{ids} identities.value".split():
        texts |= {
            row[0] for row in ask(folder / "play.db", f"SELECT {name} FROM {name.split('.')[0]}")
        }
    texts |= {
        row[0] for row in ask(folder / "play.db", "SELECT value FROM meta WHERE name = 'secret'")
    }
    assert len(texts) > 20
    return texts


def test_nobody_is_found_in_any_byte_of_it(published):
    folder, _ = published
    for name in listing(folder / "out"):
        path = folder / "out" / name
        data = path.read_bytes()
        if path.suffix == ".parquet":
            data += repr(pq.read_table(path).to_pylist()).encode()
        for trace in traces(folder):
            assert trace.encode() not in data, f"{trace} is in {name}"
    assert "CODE-0" in "".join(traces(folder))
    assert b"P" in (folder / "out/csv/scores.csv").read_bytes()


def test_the_dictionary_names_every_column(published):
    out = published[0] / "out"
    columns = json.loads((out / "columns.json").read_text())
    assert columns == dictionary(environment_of("mars").about.columns)
    for name in BUNDLE_TABLES:
        names = [column.name for column in bundle_table(name)[1]]
        if name in PARQUET:
            assert pq.read_schema(out / f"parquet/{name}.parquet").names == names
        with (out / f"csv/{name}.csv").open() as file:
            assert next(csv.reader(file)) == names


@pytest.mark.parametrize("driver", ["human", "script"])
def test_the_minari_dataset_loads_and_replays_through_gymnasium(published, monkeypatch, driver):
    import minari

    folder, _ = published
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder / "out/minari"))
    dataset = minari.load_dataset(f"humanplay/dunes/{driver}-v1")
    assert dataset.total_episodes == (11 if driver == "human" else 6)
    metadata = list(dataset.storage.get_episode_metadata(range(dataset.total_episodes)))
    about = dataset.storage.metadata
    assert (about["ref_min_score"], about["ref_max_score"]) == (-63.0, 126.0)
    episodes = pq.read_table(folder / "out/parquet/episodes.parquet").to_pylist()
    rows = {row["episode"]: row for row in episodes}
    config = {"level": "random", "size": (7, 9), "sensor_radius": 3}
    made_again = gymnasium.make("MarsExplorer-v0", **config, observation="uint8")
    for env in (dataset.recover_environment(), made_again):
        for episode, about in zip(dataset.iterate_episodes(), metadata, strict=True):
            row = rows[about["episode"]]
            columns = about.keys() & row.keys()
            assert {"participant", "phase", "seed", "core_version", "config_hash"} <= columns
            assert {name: about[name] for name in columns} == {name: row[name] for name in columns}
            observation, _ = env.reset(seed=about["seed"])
            assert np.array_equal(observation, episode.observations[0])
            for number, action in enumerate(episode.actions):
                observation, reward, terminated, truncated, _ = env.step(action)
                assert np.array_equal(observation, episode.observations[number + 1])
                assert reward == episode.rewards[number]
                assert terminated == episode.terminations[number]
                assert truncated == episode.truncations[number] or row["outcome"] == "abandoned"
            if row["outcome"] != "abandoned":
                normalized = minari.get_normalized_score(dataset, np.array([episode.rewards.sum()]))
                assert normalized[0] == pytest.approx(row["score"])


def test_boards_of_the_size_of_pictures_are_kept_as_they_are(tmp_path, monkeypatch):
    """Minari would compress them like photographs, and lose cells."""
    import minari

    study = freeze(
        tmp_path / "play.db-studies", config=EnvConfig("random", 33, 34), warm_up=0, ranked=1
    )
    recorder = StudyRecorder(tmp_path / "play.db", study)
    ident = recorder.play(recorder.join(0, stage="ranked"), "ranked", 0)
    recorder.close()
    build_release(ReleaseRequest(tmp_path / "play.db", "dunes", tmp_path / "out"))
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "out/minari"))
    dataset = minari.load_dataset("humanplay/dunes/human-v1")
    (about,), (episode,) = dataset.storage.get_episode_metadata([0]), dataset.iterate_episodes()
    assert about["episode"] == ident
    env = dataset.recover_environment()
    seen = [env.reset(seed=about["seed"])[0], *(env.step(action)[0] for action in episode.actions)]
    assert np.array_equal(np.stack(seen), episode.observations)


def test_a_release_is_built_while_a_server_runs(copy):
    recorder = StudyRecorder(copy / "play.db", freeze(copy / "studies2", "unused"))
    built = build_release(ReleaseRequest(copy / "play.db", "dunes", copy / "new"))
    assert built.header.version == 2
    recorder.play(recorder.join(9, stage="ranked"), "warm_up", 0)
    recorder.close()
    assert verify_database(copy / "play.db").findings == ()
    assert [row[1] for row in table(copy / "play.db", "releases", "version")] == [1, 2]


def test_a_study_in_which_nobody_finished_anything_is_a_release_too(tmp_path):
    study = freeze(tmp_path / "play.db-studies")
    recorder = StudyRecorder(tmp_path / "play.db", study)
    recorder.play(recorder.join(0, stage="ranked"), "warm_up", 0, "open")
    recorder.close()
    built = build_release(ReleaseRequest(tmp_path / "play.db", "dunes", tmp_path / "out"))
    assert (built.header.rows["participants"], built.header.rows["episodes"]) == (1, 0)
    assert built.header.left_out["open_episodes"] == 1
    assert verify_bundle(tmp_path / "out").verified.findings == ()


def test_the_papers_say_whom_to_cite_and_what_the_licence_is(published):
    out = published[0] / "out"
    assert "Ada Lovelace" in (out / "CITATION.cff").read_text()
    assert "license: CC-BY-4.0" in (out / "CITATION.cff").read_text()
    assert "creativecommons.org/licenses/by/4.0" in (out / "LICENSE").read_text()
    datasheet = (out / "DATASHEET.md").read_text()
    for heading in [
        "Motivation",
        "Composition",
        "Collection",
        "Privacy",
        "Uses",
        "Verify",
        "Maintenance",
        "Columns",
    ]:
        assert f"## {heading}" in datasheet
    assert "openssl pkeyutl" in datasheet


def test_the_protocol_has_the_hash_that_was_frozen_whatever_fields_later_versions_bring(
    published, tmp_path, monkeypatch
):
    manifest = json.loads((published[0] / "out" / MANIFEST).read_text())
    text = json.loads((published[0] / "out/protocol.json").read_text())
    assert hashlib.sha256(canonical_json(text)).hexdigest() == manifest["protocol_hash"]
    without = {name: value for name, value in text.items() if name != "title"} | {"title": "older"}
    del without["equivalence_margin"]  # as if this field had come later
    assert json.loads(canonical(parse_protocol(without))) == without


def test_openssl_alone_can_check_the_signature(published):
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here")
    files = f"-inkey {PUBLIC_KEY} -rawin -in {MANIFEST} -sigfile {SIGNATURE}"
    command = f"openssl pkeyutl -verify -pubin {files}".split()
    done = subprocess.run(command, cwd=published[0] / "out", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


ORDERS = {
    "series": "name", "participants": "joined_ms", "players": "created_ms", "sessions": "created_ms",
    "episodes": "started_ms", "steps": "episode_id, step", "stage_events": "at_ms", "series_episodes": "episode_id",
    "input_events": "episode_id, number",
}  # fmt: skip


def nameless(path):
    """The rows of a release without its pseudonyms: what must come back."""
    rows = {name: table(path, name, order) for name, order in ORDERS.items()}
    return json.loads(re.sub(r'\b[PBSI][0-9a-f]{12}\b', "?", json.dumps(rows, default=bytes.hex)))  # fmt: skip


def test_release_import_verify_release_is_equal_row_by_row(published, tmp_path):
    folder, built = published
    joined = import_release(folder / "out", tmp_path / "again.db")
    assert joined.added["episodes"] == 18
    assert verify_database(tmp_path / "again.db").findings == ()
    request = ReleaseRequest(tmp_path / "again.db", "dunes", tmp_path / "out2", ("Ada Lovelace",))
    again = build_release(request)
    assert nameless(folder / "out/study.sqlite") == nameless(tmp_path / "out2/study.sqlite")
    assert again.header.version == 2
    assert again.header.supersedes["manifest_sha256"] == built.manifest_hash
    for name in ("episodes", "steps", "input_events"):
        old, new = (
            pq.read_table(out / f"parquet/{name}.parquet").to_pylist()
            for out in (folder / "out", tmp_path / "out2")
        )
        for row in (*old, *new):
            row.pop("participant", None)
        assert old == new
    people = [
        {row[0] for row in table(path, "participants", "id")}
        for path in (folder / "out/study.sqlite", tmp_path / "out2/study.sqlite")
    ]
    assert not people[0] & people[1]
    assert verify_bundle(tmp_path / "out2").verified.findings == ()


def test_an_import_waits_for_no_server(published, tmp_path):
    study = freeze(tmp_path / "play.db-studies", "other")
    recorder = StudyRecorder(tmp_path / "play.db", study)
    with pytest.raises(StoreError, match="in use by another server"):
        import_release(published[0] / "out", tmp_path / "play.db")
    recorder.close()


def test_a_harmed_release_is_not_imported_and_leaves_no_database(copy):
    (copy / "out/csv/scores.csv").write_text("nothing")
    with pytest.raises(ReleaseError, match=r"no import: file csv/scores.csv"):
        import_release(copy / "out", copy / "new.db")
    assert not list(copy.glob("new.db*"))


def test_any_changed_file_is_found(copy):
    for name in listing(copy / "out"):
        path = copy / "out" / name
        data = path.read_bytes()
        path.write_bytes(bytes([data[0] ^ 1]) + data[1:])
        try:
            findings = verify_bundle(copy / "out").verified.findings
        except ReleaseError:
            assert name in (MANIFEST, PUBLIC_KEY)
        else:
            changed = MANIFEST if name == SIGNATURE else name
            assert any(changed in finding.where for finding in findings), name
        path.write_bytes(data)
    assert verify_bundle(copy / "out").verified.findings == ()


def test_a_file_too_many_or_too_few_is_found(copy):
    (copy / "out/extra.txt").write_text("hello")
    (copy / "out/csv/scores.csv").unlink()
    places = {finding.where for finding in verify_bundle(copy / "out").verified.findings}
    assert places == {"file extra.txt", "file csv/scores.csv"}


def test_a_forged_release_has_another_signer(published, copy):
    """A changed field that is signed again is consistent, but has another key.

    The key that was published tells the two apart.
    """
    key = signing.signing_key(copy / "forger.db")
    out = copy / "out"
    (out / PUBLIC_KEY).write_bytes(signing.public_pem(key))
    manifest = json.loads((out / MANIFEST).read_text())
    manifest["signer"] = signing.fingerprint((out / PUBLIC_KEY).read_bytes())
    manifest["files"][PUBLIC_KEY]["sha256"] = sha256(out / PUBLIC_KEY)
    (out / MANIFEST).write_text(json.dumps(manifest))
    (out / SIGNATURE).write_bytes(key.sign((out / MANIFEST).read_bytes()))
    assert verify_bundle(out).verified.findings == ()
    (finding,) = verify_bundle(out, signer=published[1].signer).verified.findings
    assert finding.what == "the signing key"


def test_a_changed_field_in_the_bundles_database_is_named(copy):
    alter(copy / "out/study.sqlite", "UPDATE steps SET key_down_ms = 1.0 WHERE step = 0")
    findings = verify_bundle(copy / "out").verified.findings
    assert "digest of its stored fields in the table steps" in {
        finding.what for finding in findings
    }
    assert "file study.sqlite" in {finding.where for finding in findings}


def refused(folder, match, **changes):
    before = sorted(path.name for path in folder.iterdir())
    wanted = ReleaseRequest(folder / "play.db", "dunes", folder / "new")
    with pytest.raises(ReleaseError, match=match):
        build_release(replace(wanted, **changes))
    beside = {f"play.db-{name}" for name in ("signing-key", "wal", "shm")}
    assert {path.name for path in folder.iterdir()} - beside <= set(before)


def test_no_release_of_an_unknown_study_or_into_a_folder_that_is_there(copy):
    refused(copy, "nobody has joined a study 'dune'.*studies in it: dunes", study="dune")
    refused(copy, "is there already", out=copy / "out")


def test_no_release_with_one_failing_episode(copy):
    first = "(SELECT min(episode_id) FROM steps)"
    alter(
        copy / "play.db", f"UPDATE steps SET client_ms = 5 WHERE step = 0 AND episode_id = {first}"
    )
    refused(copy, "no release: episode episode-.*digest of its stored fields")


def test_no_release_where_free_text_holds_an_identity(copy):
    conn = sqlite3.connect(copy / "play.db")
    (who,) = conn.execute(
        "SELECT participant_id FROM identities WHERE value LIKE '%0zz'"
    ).fetchone()
    conn.execute("UPDATE stage_events SET detail = ? WHERE participant_id = ? AND number = 1",
                 (json.dumps({"from": IDENTITIES["PROLIFIC_PID"].format(0)}), who))  # fmt: skip
    chain.append(conn, "participant", who)
    conn.commit()
    conn.close()
    refused(copy, "stage_events.detail holds somebody's PROLIFIC_PID")


@pytest.fixture
def noting(tmp_path):
    """`noting(ident, detail)` adds an event to a closed study of one person."""

    def add(ident, detail, number=0):
        if not (tmp_path / "play.db").exists():
            study = freeze(tmp_path / "play.db-studies")
            recorder = StudyRecorder(tmp_path / "play.db", study)
            person = recorder.join(0, stage="ranked", outside={"survey_code": ident})
            recorder.play(person, "ranked", 0)
            recorder.close()
        ((person,),) = ask(tmp_path / "play.db", "SELECT id FROM participants")
        store = Store(tmp_path / "play.db")
        StudyStore(store).add_stage_event(person, BEGAN + 3_600_000 + number, "answers", detail)
        store.close()
        return tmp_path

    return add


@pytest.mark.parametrize(
    ("ident", "note"),
    [
        ("12345", "I am 12345."),
        ("12345", "12345"),
        ("12345", "12345-x"),
        ("ada@example.org", "write to ada@example.org."),
        ("ada@example.org", "ada@example.org.com"),
        ("P-12345", "I am P-12345"),
        ("P-12345", "P-12345-x"),
        ("-12345-", "x-12345-x"),
        ("@", "@"),
    ],
)
def test_no_release_where_a_text_holds_an_id(noting, ident, note):
    folder = noting(ident, {"note": note})
    refused(folder, "stage_events.detail holds somebody's survey_code")


def test_no_release_where_a_text_that_is_a_bare_number_is_an_id(noting):
    folder = noting("12345", {})
    conn = sqlite3.connect(folder / "play.db")
    conn.execute("UPDATE input_events SET code = '12345' WHERE number = 0")
    for (episode,) in conn.execute("SELECT id FROM episodes").fetchall():
        chain.append(conn, "episode", episode)
    conn.commit()
    conn.close()
    refused(folder, "input_events.code holds somebody's survey_code")


def test_an_id_within_a_number_or_a_longer_word_is_no_leak(noting):
    folder = noting("12345", {"length_ms": 7123456})
    noting("12345", {"n": 12345, "note": "123456 x12345"}, 1)
    build_release(ReleaseRequest(folder / "play.db", "dunes", folder / "out"))


def test_a_short_id_is_no_leak_within_a_text(noting):
    folder = noting("an", {"note": "an id"})
    build_release(ReleaseRequest(folder / "play.db", "dunes", folder / "out"))


def test_an_open_study_is_not_released(tmp_path):
    play_study(tmp_path / "play.db", freeze(tmp_path / "play.db-studies", close=False))
    refused(tmp_path, "still open and a release would give its instances away: close it first")
    assert table(tmp_path / "play.db", "releases", "version") == []


def test_a_study_closed_in_its_folder_alone_is_released_with_its_secret(tmp_path, capsys):
    """`study close` may have run while no server noted it in the database."""
    study = freeze(tmp_path / "play.db-studies", close=False)
    recorder = StudyRecorder(tmp_path / "play.db", study)
    recorder.play(recorder.join(0, stage="ranked"), "ranked", 0)
    recorder.close()
    from humanplay.study.folder import Folder

    Folder(tmp_path / "play.db-studies").close(study.name)
    database = "--database", tmp_path / "play.db"
    code, out, err = run(
        capsys, "release", "--study", "dunes", *database, "--out", tmp_path / "out"
    )
    assert code == 0, err
    manifest = json.loads((tmp_path / "out" / MANIFEST).read_text())
    assert manifest["secret"] == study.secret.hex()
    assert manifest["signer"] in out


def test_playground_episodes_of_the_same_database_stay_out(copy):
    study = freeze(copy / "studies2", "unused")
    recorder = StudyRecorder(copy / "play.db", study)
    from tests.support.recorded import play

    play(recorder.store, seed=5, player="somebody-else", config=CONFIG)
    (player,) = recorder.conn.execute("SELECT player_id FROM participants LIMIT 1").fetchone()
    recorder.store.add_session(
        SessionRow("own-board", player, "human", None, "follow", 2.0, recorder.tick())
    )
    recorder.close()
    built = build_release(ReleaseRequest(copy / "play.db", "dunes", copy / "new"))
    assert built.header.rows["episodes"] == 18
    assert {row[0] for row in table(copy / "new/study.sqlite", "series", "name")} == {"dunes"}
    assert len(table(copy / "new/study.sqlite", "sessions", "id")) == 3


@pytest.mark.parametrize("name", ["pyarrow", "minari", "h5py", "mlcroissant", "cryptography"])
def test_a_missing_library_is_asked_for_by_name(published, tmp_path, monkeypatch, capsys, name):
    monkeypatch.setitem(sys.modules, name, None)
    options = "--database", published[0] / "play.db", "--out", tmp_path / "out"
    code, _, err = run(capsys, "release", "--study", "dunes", *options)
    assert code == 1
    assert err.startswith(f"humanplay: {name} is not installed")
    assert "humanplay[export]" in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_disk_that_refuses_is_a_sentence(published, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ReleaseError, match=r"cannot write .*file/out.*choose another --out"):
        build_release(ReleaseRequest(published[0] / "play.db", "dunes", tmp_path / "file" / "out"))


def test_the_commands_report_what_they_did(copy, capsys):
    code, out, _ = run(capsys, "verify", "--database", copy / "play.db")
    assert (code, "all as recorded; 18 episodes" in out) == (0, True)
    code, out, _ = run(capsys, "verify", "--dataset", copy / "out", "--key", "00")
    assert (code, "the signing key is" in out) == (1, True)
    code, out, _ = run(capsys, "import", copy / "out", "--database", copy / "new.db")
    assert (code, "3 participants and 18 episodes" in out) == (0, True)
    alter(copy / "new.db", "UPDATE episodes SET score = 2 WHERE number = 1")
    code, out, _ = run(capsys, "verify", "--database", copy / "new.db")
    assert (code, out.count("score is 2.0")) == (1, 3)
    assert "3 of its parts DIFFER" in out


@pytest.mark.parametrize(
    ("args", "code", "sentence"),
    [
        ("verify --database a --dataset b", 2, "not both"),
        ("verify --database a --key b", 2, "--key goes with --dataset"),
        ("verify --database missing.db", 1, "no database at"),
        ("verify --dataset missing", 1, "is not a release"),
        ("import missing", 1, "is not a release"),
        ("release --study x", 2, "--out"),
        ("merge one.db --out c.db", 2, "two databases or more"),
        ("forget somebody --database missing.db", 1, "no database at"),
    ],
)
def test_mistakes_get_one_sentence(capsys, tmp_path, monkeypatch, args, code, sentence):
    monkeypatch.chdir(tmp_path)
    got, _, err = run(capsys, *args.split())
    assert (got, err.count("\n")) == (code, 1)
    assert sentence in err
    assert list(tmp_path.iterdir()) == []
