"""A bundle for machines: its queries, and the keys in its Croissant metadata."""

import csv
import json
import re
import sqlite3
import subprocess
import sys
import warnings

import pyarrow.parquet as pq
import pytest

from humanplay import ROOT
from humanplay.db.columns import BUNDLE_TABLES, bundle_reference, bundle_table
from humanplay.release.tables import PARQUET
from humanplay.study.data import load
from marsexplorer.config import ACTIONS
from marsexplorer.episode import Episode
from tests.support.stored_studies import CONFIG


def queried(out):
    """Table -> rows of the bundle's queries.sql on its own database.

    SQLite alone runs them, but for the names of actions.
    """
    parts = re.split(r"^-- table: (\w+)$", (out / "queries.sql").read_text(), flags=re.M)
    conn = sqlite3.connect(out / "study.sqlite")
    conn.row_factory = sqlite3.Row
    tables = {
        name: [dict(row) for row in conn.execute(sql)]
        for name, sql in zip(parts[1::2], parts[2::2], strict=True)
    }
    conn.close()
    for step in tables["steps"]:
        step["action"] = ACTIONS[step["action"]]
    return tables


def test_the_queries_give_exactly_the_tables(published):
    out = published[0] / "out"
    tables = queried(out)
    assert set(tables) == set(BUNDLE_TABLES)
    for table in PARQUET:
        assert tables[table] == pq.read_table(out / f"parquet/{table}.parquet").to_pylist(), table
    for table in BUNDLE_TABLES:
        assert in_text(tables[table], table) == read_csv(out / f"csv/{table}.csv"), table
    assert len(tables["policy_episodes"]) == 3


def in_text(rows, table):
    """Rows as a CSV file holds them."""
    truths = {column.name for column in bundle_table(table)[1] if column.type == "boolean"}

    def text(name, value):
        if value is None:
            return ""
        return str(bool(value)).lower() if name in truths else str(value)

    return [{name: text(name, value) for name, value in row.items()} for row in rows]


def read_csv(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_steps_stand_where_a_replay_stands(published):
    out = published[0] / "out"
    steps = queried(out)["steps"]
    outcomes = set()
    for line in queried(out)["episodes"]:
        of_episode = [step for step in steps if step["episode"] == line["episode"]]
        episode = Episode.begin(CONFIG, seed=line["seed"])
        for step in of_episode:
            episode.step(ACTIONS.index(step["action"]))
        assert [(step["row"], step["col"]) for step in of_episode] == episode.path[1:]
        assert [step["coverage"] for step in of_episode] == [
            count / CONFIG.n for count in episode.discoveries[1:]
        ]
        assert (
            line["outcome"] == "abandoned"
            or episode.record().trajectory_hash == line["trajectory_hash"]
        )
        outcomes.add(line["outcome"])
    assert {"explored", "abandoned", "out_of_bounds"} <= outcomes


def test_the_participants_are_as_their_episodes_say(published):
    out = published[0] / "out"
    data = load(out / "study.sqlite", "dunes")
    rows = {row["participant"]: row for row in queried(out)["participants"]}
    assert set(rows) == {person.id for person in data.people}
    assert {row["kind"] for row in rows.values()} == {"human", "script"}
    for ident, row in rows.items():
        ranked = [
            trial for trial in data.trials if trial.participant == ident and trial.phase == "ranked"
        ]
        assert row["ranked_episodes"] == len(ranked) == 3
        assert row["ranked_by_human"] == sum(trial.driver == "human" for trial in ranked)
        assert row["ranked_labelled"] == sum(bool(trial.labels) for trial in ranked)
        assert row["labels"] == (
            "; ".join(sorted({label for trial in ranked for label in trial.labels})) or None
        )
        assert row["max_pause_share"] == max(trial.pause_share for trial in ranked)
        assert (row["attempts"], json.loads(row["answers"])) == (1, [[]])
        assert row["recruitment"] == data.protocol.recruitment
    assert not {"completion_code", "player_id", "session_id", "invitation"} & set(
        next(iter(rows.values()))
    )


def test_every_row_has_its_key_and_every_reference_its_row(published):
    tables = queried(published[0] / "out")
    for table in BUNDLE_TABLES:
        made_from, columns = bundle_table(table)
        keys = [tuple(row[name] for name in made_from.keys) for row in tables[table]]
        assert len(set(keys)) == len(keys), table
        for column in columns:
            values = {row[column.name] for row in tables[table]}
            assert column.optional or None not in values, column.name
            if (other := bundle_reference(table, column.name)) is not None:
                assert values <= {row[column.name] for row in tables[other]}, (table, column.name)


def test_croissants_record_sets_have_keys_and_references(published):
    import mlcroissant

    path, rows_of = published[0] / "out/croissant.json", queried(published[0] / "out")
    content = json.loads(path.read_text())
    assert content["conformsTo"] == "http://mlcommons.org/croissant/1.1"
    metadata = {record_set["@id"]: record_set for record_set in content["recordSet"]}
    for table in BUNDLE_TABLES:
        key = metadata[table]["key"]
        assert [field["@id"] for field in (key if isinstance(key, list) else [key])] == [
            f"{table}/{name}" for name in bundle_table(table)[0].keys
        ]
        for field in metadata[table]["field"]:
            other = bundle_reference(table, field["name"])
            expected = {"field": {"@id": f"{other}/{field['name']}"}} if other else None
            assert field.get("references") == expected
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = mlcroissant.Dataset(path)
        assert not dataset.metadata.ctx.issues.errors
        assert not dataset.metadata.ctx.issues.warnings
        for table in ("participants", "episodes", "policy_episodes", "scores"):
            assert len(list(dataset.records(table))) == len(rows_of[table]) > 0


RECOVER = """
import sys
if {hidden}:
    sys.modules["marsexplorer"] = None  # as where it is not installed
import minari
dataset = minari.load_dataset("humanplay/dunes/human-v1")
print(dataset.storage.metadata["requirements"], dataset.storage.metadata["description"])
print(dataset.recover_environment().reset(seed=1)[0].shape)
"""


@pytest.mark.parametrize("hidden", [False, True])
def test_minari_recovers_the_environment_in_a_fresh_process_or_names_what_to_install(
    published, hidden, monkeypatch
):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(published[0] / "out/minari"))
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{ROOT / 'app'}")
    command = [sys.executable, "-c", RECOVER.format(hidden=hidden)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert "['humanplay[mars]']" in done.stdout
    assert "pip install 'humanplay[mars]'" in done.stdout
    assert done.stdout.endswith("(7, 9)\n") != hidden, done.stderr
    assert ("No module named 'marsexplorer" in done.stderr) == hidden
