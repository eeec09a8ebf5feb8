"""The report on a stored study is the one that earlier code wrote of it (`tests/fixtures/README.md`)."""

import json

import pytest

from app.cli.main import main
from tests.support import earlier

ROUNDING = {"rel": 1e-9, "abs": 1e-12}
"""Sums in another order differ in the last bits."""


def leaves(value, path=()):
    """Yield (path, value) for every number and text of a JSON document, in its order."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from leaves(each, (*path, key))
    elif isinstance(value, list):
        yield path, len(value)
        for index, each in enumerate(value):
            yield from leaves(each, (*path, index))
    else:
        yield path, value


COMPUTED_OTHERWISE = {"made_at", "software_version"}
"""Keys whose values this version computes in another way than the earlier one did, or that tell the two apart."""


def differences(expected, found):
    """Return the earlier report's leaves that this one lacks or has otherwise; what only this one has is new."""
    known = dict(leaves(found))
    version = expected["software_version"], found["software_version"]
    return [
        (path, value, known.get(path))
        for path, value in leaves(expected)
        if not COMPUTED_OTHERWISE & set(path) and not (path in known and same(value, known[path], version))
    ]


def same(one, other, version):
    if isinstance(one, float) and isinstance(other, float):
        return other == pytest.approx(one, **ROUNDING)
    return (one.replace(*version) if isinstance(one, str) else one) == other


@pytest.mark.parametrize(("name", "options"), [("report.json", ()), ("report-synthetic.json", ("--synthetic",))])
def test_the_numbers_of_an_earlier_report_come_out_again(tmp_path, capsys, name, options):
    folder = earlier.studies(tmp_path)
    where = ("--database", str(folder / "studies-play.db"), "--studies", str(folder))
    with pytest.raises(SystemExit) as left:
        main(["report", "--study", "dunes", *where, "--json", str(tmp_path / "new.json"), *options])
    assert not left.value.code, capsys.readouterr().err
    expected, found = (json.loads(path.read_text()) for path in (folder / name, tmp_path / "new.json"))
    assert differences(expected, found) == []
    assert sum(isinstance(value, float) for _, value in leaves(expected)) > 500


def test_a_changed_number_a_changed_sentence_and_a_lost_key_are_seen():
    old = {"software_version": "1", "made_at": "now", "score": 0.5, "rule": "t of version 1"}
    assert differences(old, {**old, "software_version": "2", "made_at": "later", "rule": "t of version 2"}) == []
    assert differences(old, {**old, "score": 0.5000001})
    assert differences(old, {**old, "rule": "z of version 1"})
    assert differences(old, {key: old[key] for key in ("software_version", "made_at", "score")})
