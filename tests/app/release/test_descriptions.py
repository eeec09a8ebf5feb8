"""What a bundle says of itself to machines: its queries, the Data Package, Psych-DS, and the keys in its Croissant metadata."""

import csv
import json
import re
import shutil
import sqlite3
import subprocess
import sys
import warnings

import frictionless
import pyarrow.parquet as pq
import pytest

from app.release.columns import BUNDLE_COLUMNS, FOREIGN_KEYS, PRIMARY_KEYS
from app.release.tables import PARQUET, data_file
from app.settings import ROOT
from app.study.data import load
from marsexplorer.episode import Episode
from tests.support.stored_studies import CONFIG


def queried(out):
    """{table: rows} of the bundle's own queries.sql on its own database, with SQLite alone."""
    parts = re.split(r"^-- table: (\w+)$", (out / "queries.sql").read_text(), flags=re.M)
    conn = sqlite3.connect(out / "study.sqlite")
    conn.row_factory = sqlite3.Row
    found = {
        name: [dict(row) for row in conn.execute(sql)]
        for name, sql in zip(parts[1::2], parts[2::2], strict=True)
    }
    conn.close()
    return found


def test_the_queries_give_exactly_the_tables(made):
    out = made[0] / "out"
    found = queried(out)
    assert set(found) == set(BUNDLE_COLUMNS)
    for table in PARQUET:
        assert found[table] == pq.read_table(out / f"parquet/{table}.parquet").to_pylist(), table
        assert in_text(found[table], table) == read_csv(out / data_file("dunes", table)), table
    assert in_text(found["scores"], "scores") == read_csv(out / "scores.csv")
    assert in_text(found["participants"], "participants") == read_csv(out / "participants.csv")
    lines = [json.loads(line) for line in (out / "participants.jsonl").read_text().splitlines()]
    assert found["participants"] == lines
    assert len(found["policy_episodes"]) == 3


def in_text(rows, table):
    """Rows as a CSV file holds them."""
    truths = {column.name for column in BUNDLE_COLUMNS[table] if column.type == "boolean"}

    def text(name, value):
        if value is None:
            return ""
        return str(bool(value)).lower() if name in truths else str(value)

    return [{name: text(name, value) for name, value in row.items()} for row in rows]


def read_csv(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_steps_stand_where_a_replay_stands(made):
    out = made[0] / "out"
    steps = queried(out)["steps"]
    outcomes = set()
    for line in map(json.loads, (out / "episodes.jsonl").read_text().splitlines()):
        episode = Episode.begin(CONFIG, seed=line["seed"])
        for action in line["actions"]:
            episode.step(["north", "east", "south", "west"].index(action))
        own = [step for step in steps if step["episode"] == line["episode"]]
        assert [(step["row"], step["col"]) for step in own] == episode.path[1:]
        assert [step["coverage"] for step in own] == [
            count / CONFIG.n for count in episode.discoveries[1:]
        ]
        outcomes.add(line["outcome"])
    assert {"explored", "abandoned", "out_of_bounds"} <= outcomes


def test_the_participants_are_as_their_episodes_say(made):
    out = made[0] / "out"
    data = load(out / "study.sqlite", "dunes")
    rows = {row["participant"]: row for row in queried(out)["participants"]}
    assert set(rows) == {person.id for person in data.people}
    assert {row["kind"] for row in rows.values()} == {"human", "script"}
    for ident, row in rows.items():
        own = [
            trial for trial in data.trials if trial.participant == ident and trial.phase == "ranked"
        ]
        assert row["ranked_episodes"] == len(own) == 3
        assert row["ranked_by_human"] == sum(trial.driver == "human" for trial in own)
        assert row["ranked_labelled"] == sum(bool(trial.labels) for trial in own)
        assert row["labels"] == (
            "; ".join(sorted({label for trial in own for label in trial.labels})) or None
        )
        assert row["max_pause_share"] == max(trial.pause_share for trial in own)
        assert (row["attempts"], json.loads(row["answers"])) == (1, [[]])
        assert row["recruitment"] == data.protocol.recruitment
    assert not {"completion_code", "player_id", "session_id", "invitation"} & set(
        next(iter(rows.values()))
    )


def test_the_data_package_is_valid_with_every_row_and_key(made):
    out = made[0] / "out"
    report = frictionless.validate(str(out / "datapackage.json"))
    assert report.valid, report.flatten(["title", "message"])
    package = json.loads((out / "datapackage.json").read_text())
    described = {each["path"]: each["schema"] for each in package["resources"]}
    assert set(described) == {*(data_file("dunes", table) for table in PARQUET), "scores.csv"}
    for table in PARQUET:
        schema = described[data_file("dunes", table)]
        assert tuple(schema["primaryKey"]) == PRIMARY_KEYS[table]
        assert len(schema["foreignKeys"]) == len(FOREIGN_KEYS.get(table, {}))


@pytest.mark.parametrize(
    ("table", "harm", "said"),
    [
        ("steps", lambda line: line.replace(b"episode-", b"nobodys-"), "foreign-key"),
        ("episodes", lambda line: line + line, "primary-key"),
        ("episodes", lambda line: line.replace(b",explored,", b",explored,many"), "type-error"),
    ],
)
def test_the_data_package_notices_a_harmed_table(made, tmp_path, table, harm, said):
    shutil.copytree(
        made[0] / "out",
        tmp_path / "out",
        ignore=shutil.ignore_patterns("minari", "parquet", "*.sqlite"),
    )
    path = tmp_path / "out" / data_file("dunes", table)
    head, *rest = path.read_bytes().splitlines(keepends=True)
    at = next(number for number, line in enumerate(rest) if harm(line) != line)
    path.write_bytes(head + b"".join([*rest[:at], harm(rest[at]), *rest[at + 1 :]]))
    report = frictionless.validate(str(tmp_path / "out/datapackage.json"))
    assert said in {kind for (kind,) in report.flatten(["type"])}


def test_the_bundle_follows_the_rules_of_psych_ds(made):
    """https://psychds-docs.readthedocs.io, rules and conventions: metadata file, data directory, file names, columns."""
    out = made[0] / "out"
    about = json.loads((out / "dataset_description.json").read_text())
    assert (about["@context"], about["@type"]) == ("https://schema.org", "Dataset")
    assert about["name"]
    assert about["description"]
    variables = [each["name"] for each in about["variableMeasured"]]
    assert len(variables) == len(set(variables))
    assert all(
        each["@type"] == "PropertyValue" and each["description"]
        for each in about["variableMeasured"]
    )
    files = [path for path in (out / "data").rglob("*") if path.is_file()]
    assert len(files) == len(PARQUET)
    for path in files:
        assert re.fullmatch(r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv", path.name)
        with path.open(newline="") as file:
            header, *rows = list(csv.reader(file))
        assert len(header) == len(set(header))
        assert set(header) <= set(variables)
        assert all(len(row) == len(header) for row in rows)
    assert (
        data_file("two-words", "input_events")
        == "data/study-twowords_description-inputevents_data.csv"
    )


def test_croissants_record_sets_have_keys_and_references(made):
    import mlcroissant

    path = made[0] / "out/croissant.json"
    metadata = {each["@id"]: each for each in json.loads(path.read_text())["recordSet"]}
    for table, names in PRIMARY_KEYS.items():
        key = metadata[table]["key"]
        assert [each["@id"] for each in (key if isinstance(key, list) else [key])] == [
            f"{table}/{name}" for name in names
        ]
        for field in metadata[table]["field"]:
            other = FOREIGN_KEYS.get(table, {}).get(field["name"])
            expected = {"field": {"@id": f"{other}/{field['name']}"}} if other else None
            assert field.get("references") == expected
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = mlcroissant.Dataset(path)
        assert not dataset.metadata.ctx.issues.errors
        assert len(list(dataset.records("participants"))) == 3
        assert len(list(dataset.records("policy_episodes"))) == 3


RECOVER = """
import sys
if {hidden}:
    sys.modules["marsexplorer"] = None  # as where it is not installed
import minari
dataset = minari.load_dataset("marsexplorer/dunes/human-v1")
print(dataset.storage.metadata["requirements"], dataset.storage.metadata["description"])
print(dataset.recover_environment().reset(seed=1)[0].shape)
"""


@pytest.mark.parametrize("hidden", [False, True])
def test_minari_recovers_the_environment_in_a_fresh_process_or_names_what_to_install(
    made, hidden, monkeypatch
):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(made[0] / "out/minari"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    command = [sys.executable, "-c", RECOVER.format(hidden=hidden)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "['marsexplorer-playground']" in done.stdout
    assert "pip install marsexplorer-playground" in done.stdout
    assert done.stdout.endswith("(7, 9)\n") != hidden, done.stderr
    assert ("No module named 'marsexplorer" in done.stderr) == hidden
