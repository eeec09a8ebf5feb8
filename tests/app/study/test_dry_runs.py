"""A dry run by people: other instances, figures at once, no release."""

import json
from contextlib import closing

import pytest

from humanplay.db.reader import Reader
from humanplay.db.series import closed_studies
from humanplay.report.build import build
from humanplay.report.page import render
from humanplay.study.data import load
from humanplay.study.folder import Folder
from tests.support.command import command
from tests.support.servers import eventually
from tests.support.study import Person, freeze

PASSWORD = "a password of the operator"
COUNTED = "The database knows that 1 dry run has been made with 2 people, on other instances; they are in no figure."


def plays(server, study):
    person = Person(server, study)
    person.to_warm_up()
    person.play_on()


@pytest.fixture
def played(serve, tmp_path, capsys):
    """A server and database of a study and its dry run, finished by two people."""
    database = "--database", tmp_path / "playground.db"
    freeze(tmp_path / "playground.db-studies", policies=("frontier-cost",))
    code, text, error = command(capsys, "study", "dry-run", "small", *database)
    assert (code, "`humanplay study freeze small-dry-1`" in text) == (0, True), error
    assert command(capsys, "study", "freeze", "small-dry-1", *database)[0] == 0
    server = serve(admin_password=PASSWORD)
    for _ in range(2):
        plays(server, "small-dry-1")
    return server, database


def test_a_dry_run_has_instances_of_its_own_and_figures_at_once_and_says_what_it_is(
    played, tmp_path, capsys
):
    server, database = played
    folder = Folder(tmp_path / "playground.db-studies")
    study, dry = folder.study("small"), folder.study("small-dry-1")
    assert (dry.protocol.dry_run_of, dry.protocol.title) == (
        "small",
        f"{study.protocol.title} (dry run)",
    )
    assert not set(study.seeds()) & set(dry.seeds())
    page = tmp_path / "dry.html"
    code, text, error = command(
        capsys, "report", "--study", "small-dry-1", "--html", page, *database
    )
    sentence = "This is a dry run of small: nothing here is a figure of that study. "
    assert (code, sentence in text, "Per protocol: 2 players" in text) == (0, True, True), error
    assert sentence in page.read_text()
    assert "of this configuration" not in page.read_text()
    _, document, _ = command(capsys, "study", "preregister", "small-dry-1", *database)
    assert "This is a dry run of\n`small`: its figures are seen at once" in document
    assert "shows no figure of people" not in document
    client = server.client(headers={"Origin": server.url})
    assert client.post("/api/admin/login", json={"password": PASSWORD}).status_code == 200
    url = "/api/admin/studies/small-dry-1"
    shown = eventually(lambda: (now := client.get(url).json())["figure"] and now)
    assert (shown["figure"]["players"], sentence in shown["figure"]["sentence"]) == (2, True)


def test_a_dry_run_is_never_released_and_the_study_counts_it(played, tmp_path, capsys):
    server, database = played
    plays(server, "small")
    for name in ("small-dry-1", "small"):
        assert command(capsys, "study", "close", name, "--yes", "--now", *database)[0] == 0
    server.stop()
    with closing(Reader.open(tmp_path / "playground.db")) as reader:
        assert [row.name for row in closed_studies(reader)] == ["small"], "no page compares with it"
    how = "--study", "small-dry-1", "--out", tmp_path / "no", *database
    code, _, refusal = command(capsys, "release", *how)
    assert (code, "is a dry run of 'small'" in refusal) == (1, True), refusal
    assert not (tmp_path / "no").exists()
    data = load(tmp_path / "playground.db", "small")
    report = build(data)
    assert report.groups[0].figure.players == 1
    assert COUNTED in {item.number: item for item in report.checklist}["1.6"].detail
    assert COUNTED in render(report)
    assert "of this configuration" not in " ".join(report.groups[0].cautions)
    bundle = tmp_path / "bundle"
    assert command(capsys, "release", "--study", "small", "--out", bundle, *database)[0] == 0
    code, text, error = command(capsys, "reproduce", bundle)
    assert (code, text.splitlines()[-1].endswith(" compared, 0 differ")) == (0, True), text + error
    released = json.loads((bundle / "report.json").read_text())
    assert released["groups"][0]["flow"]["arrivals"]["dry_run_people"] == 2
    assert COUNTED in (bundle / "report.html").read_text()


def test_whoever_still_plays_in_a_dry_run_is_in_neither_estimate(played, tmp_path):
    server, _ = played
    person = Person(server, "small-dry-1")
    person.to_warm_up()
    person.play_on(until=("ranked",))
    person.call("next")
    (group,) = build(load(tmp_path / "playground.db", "small-dry-1")).groups
    rows = {row.status: row for row in group.statuses}
    assert (rows["playing"].people, rows["playing"].in_everybody) == (1, False)
    assert (group.figure.players, group.everybody.players) == (2, 2)


def test_the_name_of_a_dry_run_fits_whatever_the_length_of_the_studys(tmp_path, capsys):
    name = "s" * 40
    freeze(tmp_path / "playground.db-studies", name)
    database = "--database", tmp_path / "playground.db"
    code, text, error = command(capsys, "study", "dry-run", name, *database)
    assert code == 0, error
    dry = f"{'s' * 34}-dry-1"
    assert f"`humanplay study freeze {dry}`" in text
    assert Folder(tmp_path / "playground.db-studies").draft(dry).dry_run_of == name


def test_a_dry_run_has_no_dry_run(tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies")
    database = "--database", tmp_path / "playground.db"
    for number in (1, 2):
        code, text, _ = command(capsys, "study", "dry-run", "small", *database)
        assert (code, f"small-dry-{number}" in text) == (0, True)
    code, _, refusal = command(capsys, "study", "dry-run", "small-dry-1", *database)
    assert (code, "begin another one of that" in refusal) == (2, True)
