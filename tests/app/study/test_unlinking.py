"""People are erased, unlinked and kept out: no byte of them is left."""

import json
import shutil
from contextlib import closing, suppress

from humanplay.db.reader import Reader
from humanplay.report.making import load_with_folder
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, token_of
from humanplay.study.recruitment import KEPT_OUT
from tests.support.command import command
from tests.support.drafts import draft_of, edit_draft
from tests.support.recorded import ask
from tests.support.servers import eventually
from tests.support.study import Person, freeze

PID = "PROLIFIC_PID"
FIRST, SECOND, PILOT = (f"{name}-of-a-person" for name in ("first", "second", "pilot"))


def bytes_in(folder):
    """Everything in the files of a folder and the folders below it."""
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def comes(server, ident):
    person = Person(server, joins=False)
    answer = person.client.post(f"{person.url}/join", json={"outside_ids": {PID: ident}})
    person.where = answer.json()
    return person, answer.status_code


def test_whoever_is_erased_while_the_server_runs_is_gone_and_kept_out_until_it_is_closed(
    serve, tmp_path, capsys
):
    freeze(tmp_path / "playground.db-studies")
    server = serve()
    (first, _), (second, _) = comes(server, FIRST), comes(server, SECOND)
    for person in (first, second):
        person.to_warm_up()
        person.call("next")
        person.play(2)
    (tmp_path / "backups").mkdir()
    backup = tmp_path / "backups" / "playground-20260101T000000Z.db"
    assert command(capsys, "backup", backup, "--database", tmp_path / "playground.db")[0] == 0
    words = "forget", FIRST, "--yes", "--database", tmp_path / "playground.db"
    code, printed, _ = command(capsys, *words)
    assert (code, f"backups that still hold them: {backup}" in printed) == (0, True)
    backup.unlink()
    assert FIRST.encode() not in bytes_in(tmp_path)
    with suppress(Exception):  # their board is in memory still
        first.play(1)
    assert first.client.get(f"{first.url}/me").status_code == 404
    eventually(lambda: len(server.services.lobby.sessions()) == 1)
    second.play_on()
    assert second.where["stage"] == "debrief"
    orphans = "SELECT count(*) FROM steps WHERE episode_id NOT IN (SELECT id FROM episodes)"
    assert ask(tmp_path / "playground.db", orphans) == [(0,)]
    for again in (FIRST, f" {FIRST.upper()} "):
        refused, status = comes(server, again)
        assert (status, refused.where["detail"]) == (409, KEPT_OUT.format(name=PID))
    path = tmp_path / "playground.db-studies" / "small" / "kept_out.json"
    assert path.stat().st_mode & 0o777 == 0o600
    server.stop()
    assert FIRST.encode() not in bytes_in(tmp_path)
    Folder(tmp_path / "playground.db-studies").close("small")
    assert not path.exists()


def test_people_of_a_pilot_are_kept_out_by_hashes_alone(serve, tmp_path, capsys):
    folder = tmp_path / "playground.db-studies"
    freeze(folder, recruitment="panel")
    (folder / "again").mkdir()
    draft = draft_of(folder, "again")
    shutil.copy(draft_of(folder, "small"), draft)
    edit_draft(draft, name="again")
    (tmp_path / "ids.txt").write_text(f"{PILOT}\n\n{SECOND}\n")
    words = "study", "freeze", "again", "--underpowered", "--exclude-ids", tmp_path / "ids.txt"
    code, printed, _ = command(capsys, *words, "--database", tmp_path / "playground.db")
    assert (code, "2 people of pilots are kept out" in printed) == (0, True)
    (tmp_path / "ids.txt").unlink()
    assert PILOT.encode() not in bytes_in(tmp_path)
    server = serve()
    for ident, wanted in ((PILOT.upper(), 409), (FIRST, 201)):
        person = Person(server, "again", joins=False)
        join = {"outside_ids": {PID: ident}}
        assert person.client.post(f"{person.url}/join", json=join).status_code == wanted


def test_nobody_can_be_kept_out_by_an_id_that_no_link_has(tmp_path, capsys):
    folder = Folder(tmp_path / "playground.db-studies")
    freeze(tmp_path / "other", outside_ids=())
    (folder.root / "small").mkdir(parents=True)
    shutil.copy(draft_of(tmp_path / "other", "small"), draft_of(folder.root, "small"))
    (tmp_path / "ids.txt").write_text(PILOT)
    asks = "study", "freeze", "small", "--underpowered", "--exclude-ids", tmp_path / "ids.txt"
    code, _, refusal = command(capsys, *asks, "--database", tmp_path / "playground.db")
    assert (code, "leave --exclude-ids out" in refusal) == (2, True)
    assert not (folder.root / "small" / "kept_out.json").exists()


def test_nobody_is_erased_who_could_not_be_kept_out(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies")
    comes(serve(), FIRST)[0].to_tutorial()
    path = tmp_path / "playground.db-studies" / "small" / "kept_out.json"
    path.write_text("{")
    asks = "forget", FIRST, "--yes", "--database", tmp_path / "playground.db"
    code, _, refusal = command(capsys, *asks)
    assert (code, str(path) in refusal, "Traceback" in refusal) == (1, True, False)
    assert ask(tmp_path / "playground.db", "SELECT count(*) FROM identities") == [(1,)]
    path.unlink()
    assert command(capsys, *asks)[0] == 0


def test_once_everybody_is_paid_nobody_can_be_told_from_the_study(serve, tmp_path, capsys):
    freeze(tmp_path / "playground.db-studies", outcomes={"finished": "Thanks, {code}."})
    server = serve()
    person, _ = comes(server, FIRST)
    person.to_warm_up()
    person.play_on()
    database = "--database", tmp_path / "playground.db"
    ((drawn,),) = ask(tmp_path / "playground.db", "SELECT completion_code FROM participants")
    code, _, printed = command(capsys, "study", "unlink", "small", "--yes", *database)
    assert (code, "close it first" in printed) == (2, True)
    command(capsys, "study", "close", "small", "--yes", "--now", *database)
    code, printed, _ = command(capsys, "study", "unlink", "small", "--yes", *database)
    assert (code, "identifiers and codes of 1 person" in printed) == (0, True)
    after = bytes_in(tmp_path)
    assert [text for text in (FIRST, drawn, "Thanks, {code}.") if text.encode() in after] == []
    assert command(capsys, "verify", *database)[0] == 0
    ((note,),) = ask(tmp_path / "playground.db", "SELECT note FROM chain WHERE kind = 'acted'")
    assert (json.loads(note)["act"], json.loads(note)["people"]) == ("unlinked", 1)


def arrivals_in(folder):
    """The counts of a study's invitations."""
    with closing(Reader.open(folder / "playground.db")) as reader:
        data, _ = load_with_folder(reader, Folder(folder / "playground.db-studies"), "small")
    return data.arrivals


def test_nobody_can_be_told_by_the_invitation_they_used_and_the_counts_stay(
    serve, tmp_path, capsys
):
    study = freeze(tmp_path / "playground.db-studies", recruitment="invitation", outside_ids=())
    issued = Invitations(Folder(tmp_path / "playground.db-studies")).issue("small", 3)
    server = serve()
    for invitation in issued[:2]:
        Person(server, invitation=token_of(study, invitation.id)).to_tutorial()
    Invitations(Folder(tmp_path / "playground.db-studies")).revoke("small", [issued[0].id])
    database = "--database", tmp_path / "playground.db"
    assert command(capsys, "study", "close", "small", "--yes", "--now", *database)[0] == 0
    before = arrivals_in(tmp_path)
    code, text, _ = command(capsys, "study", "unlink", "small", "--yes", *database)
    assert (code, "of 2 people" in text) == (0, True)
    used = ask(tmp_path / "playground.db", "SELECT DISTINCT invitation FROM participants")
    assert len(used) == 2
    assert not {ident for (ident,) in used} & {invitation.id for invitation in issued}
    assert (before.unopened, before.revoked, arrivals_in(tmp_path)) == (1, 0, before)
    code, _, refusal = command(capsys, "study", "revoke", "small", issued[1].id, *database)
    assert (code, "none is left to take back" in refusal) == (2, True)
    code, text, _ = command(capsys, "study", "unlink", "small", "--yes", *database)
    assert (code, "of 0 people" in text) == (0, True)
    assert ask(tmp_path / "playground.db", "SELECT DISTINCT invitation FROM participants") == used
    assert command(capsys, "verify", *database)[0] == 0
