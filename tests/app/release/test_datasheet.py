"""A release's datasheet counts people, and says "unknown" of what nobody knows."""

import json
import re
from contextlib import closing
from dataclasses import asdict

import pytest

from humanplay.db.erasure import forget
from humanplay.db.reader import Reader
from humanplay.report.build import build
from humanplay.report.making import load_with_folder
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations
from tests.support.command import run
from tests.support.declared import DECLARATIONS
from tests.support.stored_studies import StudyRecorder, freeze, write_chain_anew


def command(*args):
    assert run(*args) == 0, args


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A closed study by invitation with somebody at every point where people leave.

    It has two releases, one of an import.
    """
    folder = tmp_path_factory.mktemp("people")
    study = freeze(folder / "play.db-studies", close=False, recruitment="invitation")
    invitations = Invitations(Folder(folder / "play.db-studies"))
    issued = [invitation.id for invitation in invitations.issue(study.name, 9)]
    invitations.revoke(study.name, issued[-1:])
    recorder = StudyRecorder(folder / "play.db", study)
    people = []
    for number, stage in enumerate(
        ("complete", "complete", "ranked", "withdrawn", "questions", "consent", "withdrawn")
    ):
        people.append(recorder.join(number, stage=stage, consent=number < 5))
        recorder.conn.execute(
            "UPDATE participants SET invitation = ? WHERE id = ?", (issued[number], people[-1])
        )
        if stage == "complete":
            for trial in range(study.protocol.ranked):
                recorder.play(people[-1], "ranked", trial)
    recorder.play(people[2], "ranked", 0)
    recorder.join(7, kind="script", stage="ranked")
    write_chain_anew(recorder.conn)
    recorder.close()
    forget(folder / "play.db", people[0])
    Folder(folder / "play.db-studies").close(study.name)
    common = ("--study", study.name)
    database = "--database", folder / "play.db"
    command("release", *common, *database, "--out", folder / "one")
    command("import", folder / "one", "--database", folder / "new.db")
    command(
        "release",
        *common,
        "--database",
        folder / "new.db",
        "--out",
        folder / "two",
    )
    return folder


@pytest.mark.parametrize("name", ["one", "two"])
def test_the_flow_of_the_released_report_is_that_of_the_operators_own(place, name):
    with closing(Reader.open(place / "play.db")) as reader:
        data, _ = load_with_folder(reader, Folder(place / "play.db-studies"), "dunes")
    flow = build(data).groups[0].flow
    expected = asdict(flow)
    arrivals = {
        "declined": 1,
        "undecided": 1,
        "erased": 1,
        "issued": 9,
        "revoked": 1,
        "unopened": 1,
    }
    assert arrivals.items() <= expected["arrivals"].items()
    assert (flow.joined, flow.agreed, flow.began) == (7, 4, 2)
    assert flow.people == {
        "finished": 1,
        "left": 1,
        "withdrew_early": 1,
        "never_began": 1,
        "declined": 1,
        "undecided": 1,
        "erased": 1,
    }
    page = (place / name / "report.html").read_text()
    for label in (
        "Invitations issued: 9",
        "Opened the study: 7",
        "erased: 1",
        "Ended all ranked episodes: 1",
    ):
        assert label in page
    report = json.loads((place / name / "report.json").read_text())
    assert report["groups"][0]["flow"] == expected
    if name == "two":  # an import's release: the first one's tables are derived again with it
        command("reproduce", place / name)


@pytest.mark.parametrize("name", ["one", "two"])
def test_the_datasheet_says_what_is_known_and_no_more(place, name):
    protocol = json.loads((place / name / "protocol.json").read_text())
    text = " ".join((place / name / "DATASHEET.md").read_text().split())
    for phrase in (
        "1 person who was erased at their own request",
        "1 person withdrew later",
        "by single-use links, of which 9 were issued, 1 revoked and 1 never opened",
        "of the people's ranked episodes 4 ",
        f"the protocol requires `{protocol['required_attestation']}`",
        "Whether the commitment was published before anybody played is unknown to the software",
        "shows no figure of people while a study is open",
        *(f"- {name.replace('_', ' ')}: {answer}" for name, answer in DECLARATIONS.items()),
    ):
        assert phrase in text, phrase
    assert "Nothing else was removed" not in text
    assert "published before anybody played." not in text
    assert "without_consent" in json.loads((place / name / "MANIFEST.json").read_text())["left_out"]


def test_no_invitation_can_be_found_in_a_release(place):
    with closing(Reader.open(place / "play.db")) as reader:
        sql = "SELECT invitation FROM participants WHERE invitation IS NOT NULL"
        used = {row["invitation"] for row in reader.query(sql)}
    assert len(used) == 6
    used = {token for token in used if not token.isdigit()}  # digits stand in any table of numbers
    picture = re.compile(
        rb"base64,[0-9A-Za-z+/=]+"
    )  # four letters of one may stand in it by chance
    for path in (token for token in (place / "one").rglob("*") if token.is_file()):
        data = picture.sub(b"", path.read_bytes())
        assert not [ident for ident in used if ident.encode() in data], path
