"""What readers' defaults make of an export, and what its schema does."""

import csv
import json
import re

import duckdb
import polars
import pytest

from humanplay.board.sources import Sources
from humanplay.study.invitations import new_id
from marsexplorer.config import EnvConfig
from tests.support.command import command
from tests.support.recorded import alter, play

parquet = pytest.importorskip("pyarrow.parquet")

REASONS = ("NA", "=1+1", "null", "1-2-1")
"""Words that some reader takes for something else."""
CHANGED = {
    "pandas": {"core_version", "attestation_reason"},
    "polars": {"core_version"},
    "DuckDB": {"core_version", "level"},
}
"""The columns of these episodes that a reader's defaults change, as docs/data.md says."""


@pytest.fixture
def exported(store, tmp_path, capsys):
    """The folder of an export of level 1-2-1, with text of all kinds."""
    for seed, reason in enumerate(REASONS):
        row = play(store, seed=seed, config=EnvConfig.of("1-2-1", 9))
        sql = "UPDATE episodes SET attestation_reason = ? WHERE id = ?".replace("?", "{!r}")
        alter(store.path, sql.format(reason, row.id))
    folder = tmp_path / "out"
    words = ("--database", store.path, "--out", folder, "--parquet")
    code, _, error = command(capsys, "export", *words)
    assert code == 0, error
    return folder


def written(folder):
    return parquet.read_table(folder / "episodes.parquet").to_pylist()


def fields(folder):
    (episodes, _) = json.loads((folder / "datapackage.json").read_text())["resources"]
    return {column["name"]: column["type"] for column in episodes["schema"]["fields"]}


KINDS = ("string", "integer", "number", "boolean")
TYPES = {
    "pandas": ("string", "Int64", "float64", "boolean"),
    "polars": (polars.String, polars.Int64, polars.Float64, polars.Boolean),
    "DuckDB": ("VARCHAR", "BIGINT", "DOUBLE", "BOOLEAN"),
}
"""A reader's types, in the order of KINDS."""


def types_of(reader, folder):
    types = dict(zip(KINDS, TYPES[reader], strict=True))
    return {name: types[kind] for name, kind in fields(folder).items()}


def by_pandas(path, types):
    pandas = pytest.importorskip("pandas")
    options = {"dtype": types, "keep_default_na": False, "na_values": [""]} if types else {}
    frame = pandas.read_csv(path, **options)
    return frame.astype(object).where(frame.notna(), None).to_dict("records")


def by_polars(path, types):
    return polars.read_csv(path, schema_overrides=types).to_dicts()


def by_duckdb(path, types):
    rows = duckdb.read_csv(str(path), **({"dtype": types} if types else {}))
    return [dict(zip(rows.columns, row, strict=True)) for row in rows.fetchall()]


READERS = {"pandas": by_pandas, "polars": by_polars, "DuckDB": by_duckdb}


def differences(read, rows):
    """The columns that are not as they were written.

    Absent and empty text are one in CSV.
    """
    return {
        name
        for one, other in zip(read, rows, strict=True)
        for name, cell in other.items()
        if (one[name] or None) != (as_in_csv(cell) or None) or one[name] != one[name]
    }


def as_in_csv(cell):
    """A cell as docs/data.md says: formulas begin with an apostrophe."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith("=") else cell


def test_parquet_holds_every_word_as_it_was_written(exported):
    assert [row["attestation_reason"] for row in written(exported)] == list(REASONS)
    assert {row["level"] for row in written(exported)} == {"1-2-1"}


@pytest.mark.parametrize("reader", READERS)
def test_by_the_shipped_schema_every_cell_comes_back(exported, reader):
    read = READERS[reader](exported / "episodes.csv", types_of(reader, exported))
    assert differences(read, written(exported)) == set()


@pytest.mark.parametrize("reader", READERS)
def test_by_default_a_reader_changes_what_the_page_says(exported, reader):
    read = READERS[reader](exported / "episodes.csv", None)
    assert differences(read, written(exported)) == CHANGED[reader]


def excel_changes(text):
    """Whether Excel, by its known rules, reads a cell as something else."""
    number = r"\s*[-+(]?[$€£]?[\d,]*\.?\d+(e[-+]?\d+)?\s*%?\)?\s*"
    month = "(?:jan|feb|mar|apr|may|jun|jul|aug|sep|sept|oct|nov|dec)[a-z]*"
    date = r"\d{1,4}(?P<mark>[-/.])\d{1,2}((?P=mark)\d{1,4})?|\d{1,2}:\d\d.*"
    date += rf"|\d{{1,2}}[- ]?{month}([- ]?\d{{2,4}})?|{month}[- ]?\d{{1,4}}"
    return re.fullmatch(f"{number}|{date}|true|false|=.*", text, re.I) is not None


def test_excel_leaves_what_identifies_alone(exported):
    with (exported / "episodes.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("episode", "player", "task", "terrain", "config_hash", "trajectory_hash", "actions")
    assert not [row[name] for row in rows for name in names if excel_changes(row[name])]
    changed = {
        name
        for row in rows
        for name in fields(exported)
        if fields(exported)[name] == "string" and excel_changes(row[name])
    }
    assert changed == {"level", "core_version", "attestation_reason"}
    sources = vars(Sources())
    for draw in (sources["episode_id"], sources["player_id"], lambda: new_id(())):
        assert not [drawn for drawn in (draw() for _ in range(2000)) if excel_changes(drawn)]
