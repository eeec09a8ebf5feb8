import re
from pathlib import Path

import pytest

from marsexplorer.files import replace_whole, to_cell, write_whole


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_whole_under_its_name_and_replaces_the_old_one(tmp_path):
    path = tmp_path / "kept.json"
    for text in (b"first", b"second"):
        with write_whole(path) as file:
            file.write(text[:3])
            assert not path.exists() or path.read_bytes() == b"first"
            file.write(text[3:])
        assert path.read_bytes() == text
    assert names(tmp_path) == ["kept.json"]


def test_a_block_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "kept.json"
    path.write_bytes(b"old")

    def fail():
        with write_whole(path) as file:
            file.write(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["kept.json"]


def test_a_folder_is_no_place_for_a_file(tmp_path):
    with pytest.raises(IsADirectoryError, match="is a folder"), write_whole(tmp_path):
        pass


def test_a_folder_appears_whole_in_the_place_of_an_empty_one(tmp_path):
    path = tmp_path / "release"
    path.mkdir()
    with replace_whole(path) as unfinished:
        unfinished.mkdir()
        (unfinished / "study.sqlite").write_bytes(b"rows")
        assert names(path) == []
    assert (path / "study.sqlite").read_bytes() == b"rows"
    assert names(tmp_path) == ["release"]


@pytest.mark.parametrize(
    "suffixes", [("",), ("", "-wal", "-shm"), ()], ids=["a file", "a database", "a folder"]
)
def test_what_is_written_by_its_path_leaves_nothing_when_it_fails(tmp_path, suffixes):
    def fail():
        with replace_whole(tmp_path / "play.db") as unfinished:
            for suffix in suffixes:
                unfinished.with_name(unfinished.name + suffix).write_bytes(b"")
            if not suffixes:
                unfinished.mkdir()
                (unfinished / "half").write_bytes(b"")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert names(tmp_path) == []


def test_a_spreadsheet_runs_no_cell():
    formulas = [
        "=1+1",
        "=cmd|' /C calc'!A0",
        "+1+cmd|'x'!A",
        "-2+3",
        "@SUM(A1)",
        "＝1",
        "-(1)",
        "- 1",
    ]
    for text in [*formulas, "\t=1", "\r=1", "\n=1"]:
        assert to_cell(text) == "'" + text


def test_numbers_and_ids_are_cells_as_they_are():
    texts = ["", "-5", "+1.5e-3", "-0.25", "-aB_9-x", "plain", "a=1", "'=1"]
    for value in [-5, -0.5, 1e-9, None, True, *texts]:
        assert to_cell(value) is value


def test_every_module_that_writes_csv_writes_its_cells_this_way():
    root = Path(__file__).parents[2]
    writers = [
        path
        for top in ("app", "marsexplorer")
        for path in (root / top).rglob("*.py")
        if "csv." in path.read_text()
    ]
    writers = [path for path in writers if re.search(r"csv\.(Dict)?[wW]riter", path.read_text())]
    assert len(writers) >= 4
    assert [
        str(path)
        for path in writers
        if not re.search(r"(to|csv)_cell\(", re.sub(r"import .*", "", path.read_text()))
        and "to_cell," not in path.read_text()
    ] == []
