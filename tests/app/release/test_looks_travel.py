"""The looks taken at a study's figures travel with its release: into a database, its report, a merge, a new release."""

import pytest

from app.cli.main import main
from app.release.build import ReleaseRequest, build_release
from app.release.bundle import import_release
from app.storage.merging import merge
from app.study.data import LookTaken, load
from app.study.looks import LOOKS_FILE, read_looks
from tests.support.stored_studies import freeze, play_study

LOOKS = (
    LookTaken("planned", "2026-01-01T00:00:00Z", 2, 2, ""),
    LookTaken("emergency", "2026-01-02T00:00:00Z", 2, None, "somebody felt unwell"),
)


def test_looks_are_known_wherever_a_release_was_imported(tmp_path, capsys):
    study = freeze(
        tmp_path / "studies", players=3, looks=[2, 3], spending="pocock", hides_interim=True
    )
    play_study(tmp_path / "play.db", study)
    first = tmp_path / "first"
    build_release(ReleaseRequest(tmp_path / "play.db", "dunes", first, looks=LOOKS))
    for _ in range(2):  # a second import adds nothing
        import_release(first, tmp_path / "other.db")
    assert load(tmp_path / "other.db", "dunes").looks == LOOKS
    merge([tmp_path / "other.db"], tmp_path / "whole.db")
    assert load(tmp_path / "whole.db", "dunes").looks == LOOKS
    where = ("--database", tmp_path / "whole.db", "--studies", tmp_path / "none")
    with pytest.raises(SystemExit) as left:
        main(["report", "--study", "dunes", "--no-policies", "--no-moves", *map(str, where)])
    assert not left.value.code
    assert "somebody felt unwell" in capsys.readouterr().out
    build_release(ReleaseRequest(tmp_path / "whole.db", "dunes", tmp_path / "second"))
    assert read_looks(tmp_path / "second" / LOOKS_FILE) == LOOKS
