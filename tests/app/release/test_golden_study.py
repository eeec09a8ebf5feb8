"""The golden study: its report and its bundle hold the figures they always held."""

import json
import shutil

import matplotlib
import pytest

from humanplay import ROOT
from humanplay.study.verification import verify_database
from tests.support import golden_study
from tests.support.command import run

ROUNDING = {"rel": 1e-9, "abs": 1e-12}
"""Sums in another order differ in the last bits."""
NOTEBOOK = ROOT / "examples" / "analysis.ipynb"
OF_THE_DAY = {"made_at", "software_version"}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The study's folder, its database and its bundle."""
    folder = tmp_path_factory.mktemp("golden")
    shutil.copytree(golden_study.STUDIES, folder / "golden.db-studies")
    golden_study.play(folder / "golden.db")
    database = ("--database", folder / "golden.db")
    assert run("release", "--study", "golden", *database, "--out", folder / "bundle") == 0
    return folder


def report(database, path, *options):
    assert golden_study.write_report(database, path, *options) == 0
    return json.loads(path.read_text())


def leaves(value, path=()):
    """Yield (path, value) for every number and text of a JSON document."""
    if isinstance(value, (dict, list)):
        yield (*path, "length"), len(value)
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in pairs:
            yield from leaves(part, (*path, key))
    else:
        yield path, value


def differences(expected, derived):
    """What of two reports is not equal: (path, expected, derived)."""
    one, two = dict(leaves(expected)), dict(leaves(derived))
    software = expected["software_version"], derived["software_version"]
    return [
        (path, one.get(path, "nothing"), two.get(path, "nothing"))
        for path in one | two
        if path[0] not in OF_THE_DAY
        and not same(one.get(path, "nothing"), two.get(path, "nothing"), software)
    ]


def same(one, other, software):
    if isinstance(one, float) and isinstance(other, float):
        return other == pytest.approx(one, **ROUNDING)
    return other == (one.replace(*software) if isinstance(one, str) else one)


@pytest.mark.parametrize(("name", "options"), golden_study.REPORTS.items())
def test_the_report_has_the_figures_that_it_always_had(place, tmp_path, name, options):
    expected = json.loads((golden_study.STUDIES / name).read_text())
    derived = report(place / "golden.db", tmp_path / name, *options)
    assert differences(expected, derived) == [], golden_study.AGAIN
    assert sum(isinstance(value, float) for _, value in leaves(expected)) > 400


def test_a_changed_number_a_changed_sentence_and_a_lost_key_are_seen():
    old = {"software_version": "1", "made_at": "now", "score": 0.5, "rule": "t of version 1"}
    new = {**old, "software_version": "2", "made_at": "later", "rule": "t of version 2"}
    assert differences(old, new) == []
    assert differences(old, {**old, "score": 0.5000001})
    assert differences(old, {**old, "rule": "z of version 1"})
    assert differences(old, {**old, "more": 1})
    assert differences(old, {key: old[key] for key in old if key != "rule"})


def test_the_database_and_the_bundle_verify_and_every_figure_is_derived_again(place, capsys):
    verified = verify_database(place / "golden.db")
    assert (verified.findings, verified.episodes) == ((), 69)
    assert run("verify", "--dataset", place / "bundle") == 0
    assert run("reproduce", place / "bundle", "--recorded") == 0
    assert ", 0 differ" in capsys.readouterr().out


def test_a_bundle_is_imported_once_with_every_figure_and_refused_under_other_names(
    place, tmp_path, capsys
):
    for _ in range(2):
        assert run("import", place / "bundle", "--database", tmp_path / "new.db") == 0
    assert "69 were there already" in capsys.readouterr().out
    assert verify_database(tmp_path / "new.db").findings == ()
    for name, options in golden_study.REPORTS.items():
        derived = report(tmp_path / "new.db", tmp_path / name, *options)
        expected = json.loads((golden_study.STUDIES / name).read_text())
        paths = [path for path, *_ in differences(expected, derived)]
        assert [path for path in paths if path[0] == "groups"] == []
    copy = shutil.copy(place / "golden.db", tmp_path / "copy.db")
    assert run("import", place / "bundle", "--database", copy) == 1
    assert "under other names" in capsys.readouterr().err
    assert verify_database(copy).findings == ()


def test_the_notebook_reads_the_bundle_and_agrees_with_its_report(place, tmp_path, monkeypatch):
    matplotlib.use("agg")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dunes-1").symlink_to(place / "bundle")
    notebook = json.loads(NOTEBOOK.read_text())
    names = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    group = json.loads((place / "bundle" / "report.json").read_text())["groups"][0]
    mean = group["figures"][0]["steps"]["mean"]
    assert names["of_people"]["mean"] == pytest.approx(mean)
    assert names["fit"].fe_params["Intercept"] == pytest.approx(mean)
    assert dict(names["against"]["people need more"]) == pytest.approx(
        {
            comparison["policy"]: -comparison["difference"]
            for comparison in group["comparisons"]
            if comparison["metric"] == "steps"
        }
    )
    shown = [moves for line in names["axes"].lines[1:] for moves in line.get_xdata()]
    means = [*names["table"].mean(axis=1), *names["against"]["policy's moves"]]
    assert sorted(shown) == pytest.approx(sorted(means))
