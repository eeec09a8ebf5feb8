"""`humanplay report` as a user meets it."""

import json
import shutil
from functools import partial

import pytest

from humanplay.db.store import Store
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from marsexplorer.config import EnvConfig
from tests.support.command import command
from tests.support.declared import DECLARATIONS
from tests.support.stored_studies import BEGAN, CONFIG, freeze, freezing_at, play_study


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a closed study: two people and a script have played it."""
    folder = tmp_path_factory.mktemp("report")
    play_study(folder / "play.db", freeze(folder / "play.db-studies"))
    for name in ("alone", "draft", "thawed"):
        shutil.copy(folder / "play.db", folder / f"{name}.db")
    return folder


@pytest.fixture
def report(place, capsys):
    """`report(...)` runs the command on the place: exit code, stdout, stderr."""

    def run(*args, study="dunes", database="play.db"):
        options = "--database", place / database
        return command(capsys, "report", "--study", study, *options, *args)

    return run


def test_people_on_the_terminal_as_a_page_and_as_json(report, tmp_path):
    code, out, err = report("--html", tmp_path / "r.html", "--json", tmp_path / "r.json")
    assert (code, err) == (0, "")
    assert "people: means over players" in out
    assert "policies on the same instances, beside people" in out
    assert "SYNTHETIC" not in out
    document = json.loads((tmp_path / "r.json").read_text())
    (people,) = document["groups"]
    assert people["figures"][1]["players"] == 2
    assert document["scripts"] == {"noisy-frontier": 1}
    assert {comparison["policy"] for comparison in people["comparisons"]} == {"random"}
    assert people["pictures"]["curve"]["mean"]
    page = (tmp_path / "r.html").read_text()
    assert f"{people['figures'][1]['score']['mean']:.4f}" in page
    assert page.count("<svg") == 12


def test_scripts_are_reported_when_asked_for_and_marked(report, tmp_path):
    code, out, _ = report("--synthetic", "--json", tmp_path / "r.json", "--no-policies")
    assert code == 0
    assert "SYNTHETIC: every number here was produced by scripts" in out
    assert "SYNTHETIC, script noisy-frontier: means over players" in out
    document = json.loads((tmp_path / "r.json").read_text())
    assert document["synthetic"] is True
    assert [group["kind"] for group in document["groups"]] == ["script"]
    assert document["policies"] == []


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        ({"study": "moon"}, 2, "nobody has joined a study 'moon'"),
        ({"database": "none.db"}, 1, "no database at"),
        ({"study": "dunes", "database": "alone.db"}, 0, ""),
    ],
)
def test_mistakes_are_one_sentence(report, arguments, code, sentence):
    ended, out, err = report("--no-policies", **arguments)
    assert ended == code
    assert sentence in err
    assert len(err.splitlines()) == (1 if code else 0)
    assert bool(out) == (code == 0)


def test_a_draft_and_a_thawed_protocol_are_refused(report, place):
    from humanplay.study.folder import Folder
    from humanplay.study.protocol import default_protocol
    from marsexplorer.config import EnvConfig

    Folder(place / "draft.db-studies").create(default_protocol("dunes", EnvConfig("random", 7, 9)))
    code, _, err = report("--no-policies", database="draft.db")
    assert (code, "is a draft" in err) == (2, True)
    text = (place / "play.db-studies/dunes/protocol.json").read_text()
    thawed = place / "thawed.db-studies/dunes"
    thawed.mkdir(parents=True)
    for name in ("frozen.json", "closed.json", "secret"):
        (thawed / name).write_bytes((place / "play.db-studies/dunes" / name).read_bytes())
    (thawed / "protocol.json").write_text(text.replace('"players":3', '"players":30'))
    code, _, err = report("--no-policies", database="thawed.db")
    assert (code, "thawed protocol" in err) == (2, True)


def test_a_file_that_cannot_be_written_leaves_nothing_half_done(report, tmp_path):
    code, _, err = report("--no-policies", "--html", tmp_path / "no/such/folder.html")
    assert (code, "cannot write" in err) == (1, True)
    (tmp_path / "kept.html").write_text("old")
    assert report("--no-policies", "--html", tmp_path / "kept.html", study="moon")[0] == 2
    assert (tmp_path / "kept.html").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["kept.html"]


def test_an_open_study_shows_no_figure_and_makes_no_page(tmp_path, capsys):
    play_study(tmp_path / "play.db", freeze(tmp_path / "play.db-studies", close=False))

    database = "--database", tmp_path / "play.db"
    run = partial(command, capsys, "report", "--study", "dunes", *database, "--no-policies")
    code, out, _ = run()
    assert (code, "mean score" in out) == (0, False)
    assert "No figure is shown until the study is closed: 2 of 3 have finished." in out
    page = tmp_path / "r.html"
    code, out, err = run("--html", page)
    assert (code, out, page.exists()) == (2, "", False)
    assert "close it (`humanplay study close dunes`), or leave --html out" in err
    assert run("--html", page, "--synthetic")[0] == 0
    assert "SYNTHETIC" in run("--synthetic")[1]
    Folder(tmp_path / "play.db-studies").close("dunes")
    code, out, _ = run()
    assert (code, "2 players, 6 ranked episodes: mean score" in out) == (0, True)


def test_other_studies_of_the_configuration_that_the_chain_knows_are_named(tmp_path, capsys):
    """The best of three studies is reported: report and release name the others."""
    path, folder = tmp_path / "play.db", Folder(tmp_path / "play.db-studies")
    Store(path).close()
    database = ("--database", path)
    for name in ("third", "dunes", "second", "alone"):
        config = EnvConfig("random", 9, 9, sensor_radius=3) if name == "alone" else CONFIG
        rest = {"policies": ("random",), "debrief_policy": "random", "declarations": DECLARATIONS}
        folder.create(default_protocol(name, config, warm_up=2, ranked=3, players=3, **rest))
        with freezing_at(BEGAN):
            assert command(capsys, "study", "freeze", name, "--underpowered", *database)[0] == 0
        if name != "third":  # nobody came to it
            play_study(path, folder.study(name), first=10 * len(name))
            assert command(capsys, "study", "close", name, "--yes", "--now", *database)[0] == 0
    shutil.rmtree(folder.path("second"))
    report = partial(command, capsys, "report", "--no-policies", *database)
    alone, html = tmp_path / "alone.json", tmp_path / "dunes.html"
    assert report("--study", "alone", "--json", alone)[0] == 0
    assert report("--study", "dunes", "--json", tmp_path / "dunes.json", "--html", html)[0] == 0
    out = tmp_path / "dunes"
    assert command(capsys, "release", "--study", "dunes", *database, "--out", out)[0] == 0
    assert command(capsys, "reproduce", out)[0] == 0

    assert cautions_of_others(alone) == []
    for document in (tmp_path / "dunes.json", out / "report.json"):
        (line,) = cautions_of_others(document)
        assert line.startswith("2 other studies of this configuration were frozen")
        assert "third on 20" in line
        assert "second on 20" in line
        assert line.endswith("Studies of other databases cannot be seen.")
    for page in (html, out / "report.html"):
        assert "Studies of other databases cannot be seen." in page.read_text()


def cautions_of_others(document):
    """What a report (JSON) says of other studies."""
    (group,) = json.loads(document.read_text())["groups"]
    return [line for line in group["cautions"] if "this configuration" in line]
