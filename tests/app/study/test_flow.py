"""The flow of people from invitation to analysis, from a real database in which one of them was erased."""

from contextlib import closing

from app.db.erasure import forget
from app.db.reader import Reader
from app.report import build
from app.report.making import load_with_folder
from app.report.page import render
from app.series.flow import ParticipantFlow
from app.series.folder import Folder
from app.series.invitations import Invitations
from tests.support.stored_studies import StudyRecorder, freeze


def test_everybody_is_counted_where_they_left_and_the_erased_stay_counted(tmp_path):
    study = freeze(tmp_path / "studies", close=False, recruitment="invitation")
    invitations = Invitations(Folder(tmp_path / "studies"))
    issued = [each.id for each in invitations.issue(study.name, 9)]
    invitations.revoke(study.name, issued[-1:])
    path = tmp_path / "play.db"
    recorder = StudyRecorder(path, study)
    stages = ("complete", "complete", "ranked", "withdrawn", "questions", "consent", "withdrawn")
    people = []
    for number, stage in enumerate(stages):
        person = recorder.join(number, stage=stage, consent=number < 5)
        people.append(person)
        recorder.conn.execute(
            "UPDATE participants SET invitation = ? WHERE id = ?", (issued[number], person)
        )
        if stage == "complete":
            for trial in range(study.protocol.ranked):
                recorder.play(person, "ranked", trial)
    recorder.play(people[2], "ranked", 0)
    recorder.join(7, kind="script")
    recorder.close()
    forget(path, people[0])
    Folder(tmp_path / "studies").close(study.name)
    with closing(Reader.open(path)) as reader:
        data, _ = load_with_folder(reader, Folder(tmp_path / "studies"), study.name)
    report = build(data)
    flow = report.groups[0].flow
    assert isinstance(flow, ParticipantFlow)
    arrivals = flow.arrivals
    assert (arrivals.issued, arrivals.revoked, arrivals.unopened) == (9, 1, 1)
    assert (arrivals.declined, arrivals.undecided, arrivals.erased) == (1, 1, 1)
    assert (flow.joined, flow.agreed, flow.withdrew_early, flow.stayed_early) == (
        7,
        4,
        1,
        {"questions": 1},
    )
    assert (flow.ranked, flow.withdrew, flow.unfinished, flow.completed) == (2, 0, 1, 1)
    page = render(report)
    for label in (
        "Invitations issued: 9",
        "Opened the study: 7",
        "erased at their request: 1",
        "Ended all ranked episodes: 1",
    ):
        assert label in page
