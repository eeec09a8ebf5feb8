"""A closed study whose secret is kept shows nothing of its terrains."""

import pytest
from numpy import packbits

from humanplay.study.folder import Folder
from humanplay.study.verification import verify_database
from marsexplorer.terrain import generate
from tests.support.command import command, run
from tests.support.stored_studies import freeze, play_study
from tests.support.study import Person
from tests.support.study import freeze as freeze_small

CLOSE = "study", "close", "dunes", "--yes", "--database"


@pytest.fixture
def database(tmp_path):
    """A study that three have played and whose secret is kept."""
    study = freeze(tmp_path / "playground.db-studies", close=False)
    play_study(tmp_path / "playground.db", study)
    assert run(*CLOSE, tmp_path / "playground.db", "--keep-secret") == 0
    return tmp_path / "playground.db"


def secrets_of(database):
    """All that would reveal a ranked terrain: the secret, seeds, packed maps."""
    study = Folder.beside(database).study("dunes")
    seeds = [study.seed("ranked", index) for index in range(3)]
    maps = [packbits(generate(study.protocol.env_config, seed)).tobytes().hex() for seed in seeds]
    return [study.secret.hex(), *map(str, seeds), *maps]


def test_every_command_refuses_its_terrains_with_a_sentence(database, tmp_path, capsys):
    of_database = "--database", database
    for words in (["report"], ["costs"], ["release", "--out", tmp_path / "bundle"]):
        code, out, error = command(capsys, *words, "--study", "dunes", *of_database)
        assert (code != 0, "is closed and its secret kept" in error) == (True, True), (words, error)
        assert not [secret for secret in secrets_of(database) if secret in out + error]
    assert not (tmp_path / "bundle").exists()
    for more in ((), ("--open-studies",)):
        out = tmp_path / f"csv{len(more)}"
        code, printed, error = command(capsys, "export", *more, *of_database, "--out", out)
        assert (code, "their secrets are kept: dunes" in printed) == (0, True), error
        tables = [path.read_text() for path in out.glob("*.csv")]
        assert [table.count("\n") for table in tables] == [1, 1], "heads alone"
    code, out, _ = command(capsys, "study", "show", "dunes", *of_database)
    assert (code, out.startswith("dunes: secret kept")) == (0, True)
    assert not [secret for secret in secrets_of(database) if secret in out]
    replay = "replay", "episode", "--out", tmp_path / "r.html", *of_database
    code, _, error = command(capsys, *replay)
    assert (code, "no finished episode" in error) == (2, True)
    assert verify_database(database).findings == ()


def test_it_is_closed_again_to_reveal_the_secret(database, capsys):
    folder = Folder.beside(database)
    code, _, error = command(capsys, *CLOSE, database, "--keep-secret")
    assert (code, "its secret kept already" in error) == (2, True)
    code, out, error = command(capsys, *CLOSE, database)
    assert (code, folder.study("dunes").secret.hex() in out) == (0, True), error
    assert folder.status("dunes") == "closed"
    code, _, error = command(capsys, *CLOSE, database, "--keep-secret")
    assert (code, "is closed already" in error, "its secret is known" in error) == (2, True, True)
    words = "report", "--study", "dunes", "--no-policies", "--no-moves", "--database", database
    assert command(capsys, *words)[0] == 0
    assert verify_database(database).findings == ()


def test_nobody_takes_part_and_a_participant_is_shown_no_ranked_terrain(serve, tmp_path):
    freeze_small(tmp_path / "playground.db-studies")
    folder, server = Folder(tmp_path / "playground.db-studies"), serve()
    person = Person(server)
    person.to_warm_up()
    person.play_on()
    folder.close("small", keeps_secret=True)
    for url in ("debrief/0?phase=ranked", "debrief/0/costs?phase=ranked"):
        answer = person.client.get(f"/api/studies/small/{url}")
        says_so = "'small' is closed and its secret kept" in answer.json()["detail"]
        assert (answer.status_code, says_so) == (409, True)
    assert person.client.get("/api/studies/small/debrief/0").status_code == 200  # warm-up
    assert person.client.get("/api/me/history").json()["episodes"] == []
    assert server.client().post("/api/studies/small/join").status_code == 409
    folder.close("small")
    assert person.client.get("/api/studies/small/debrief/0?phase=ranked").status_code == 200
