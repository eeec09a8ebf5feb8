"""What `study freeze` prints to publish, and what the chain says of freezings."""

import json
from contextlib import closing

from humanplay.db.store import Store
from humanplay.report.build import build
from humanplay.study.data import load
from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from humanplay.study.verification import verify_database
from tests.support.command import command, run
from tests.support.declared import DECLARATIONS
from tests.support.drafts import draft_of, edit_draft
from tests.support.stored_studies import BEGAN, CONFIG, StudyRecorder, freezing_at, play_study

REST = {
    "declarations": DECLARATIONS,
    "warm_up": 2,
    "ranked": 3,
    "players": 3,
    "policies": ("random",),
    "debrief_policy": "random",
}


def frozen(tmp_path):
    """Freeze a study by the command; return its folder and its database's path."""
    folder, path = Folder(tmp_path / "play.db-studies"), tmp_path / "play.db"
    Store(path).close()
    folder.create(default_protocol("dunes", CONFIG, **REST))
    with freezing_at(BEGAN):
        assert run("study", "freeze", "dunes", "--underpowered", "--database", path) == 0
    return folder, path


def test_freezing_prints_one_line_to_publish_with_both_hashes(tmp_path, capsys):
    folder = Folder(tmp_path / "play.db-studies")
    folder.create(default_protocol("dunes", CONFIG, **REST))
    options = ("--underpowered", "--database", tmp_path / "play.db")
    code, printed, _ = command(capsys, "study", "freeze", "dunes", *options)
    study = folder.study("dunes")
    (line,) = (line for line in printed.splitlines() if study.protocol_hash in line)
    assert (code, study.commitment in line) == (0, True)


def test_a_study_that_was_frozen_again_is_told_by_the_chain(tmp_path, capsys):
    """The first freezing is in the chain although nobody joined that study."""
    folder, path = frozen(tmp_path)
    (folder.root / "dunes").rename(tmp_path / "first")
    frozen(tmp_path)
    play_study(path, folder.close("dunes"))
    assert verify_database(path).findings == ()
    (group,) = build(load(path, "dunes")).groups
    assert "was frozen 2 times" in " ".join(group.cautions)


def test_a_time_of_freezing_that_was_changed_before_anybody_joined_is_found(tmp_path, capsys):
    folder, path = frozen(tmp_path)
    file = folder.root / "dunes" / "frozen.json"
    file.write_text(
        json.dumps({**json.loads(file.read_text()), "frozen_at": "2026-01-01T00:00:00.000Z"})
    )
    with closing(StudyRecorder(path, folder.study("dunes"))) as recorder:
        recorder.join(0, stage="ranked")
    (finding,) = verify_database(path).findings
    assert (finding.where, finding.what) == ("series dunes", "what the chain says was frozen")


def test_a_consent_that_promises_erasure_is_not_frozen_where_episodes_are_kept(tmp_path, capsys):
    folder, database = Folder(tmp_path / "play.db-studies"), ("--database", tmp_path / "play.db")
    freeze = ("study", "freeze", "dunes", "--underpowered", *database)
    folder.create(default_protocol("dunes", CONFIG, **REST))
    draft = draft_of(folder.root, "dunes")
    edit_draft(draft, keep_episodes_when_forgotten=True)
    code, _, error = command(capsys, *freeze)
    assert (code, "promises that what was played is erased on request" in error) == (2, True)
    draft.unlink()
    folder.create(default_protocol("dunes", CONFIG, **REST, keep_episodes_when_forgotten=True))
    assert command(capsys, *freeze)[0] == 0
    assert "erased, with the moves" not in folder.study("dunes").protocol.consent.text
