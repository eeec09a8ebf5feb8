"""People come from the site that sends them, and go back to it.

From Prolific, SONA and Connect, in a class, and in a laboratory.
"""

import csv
import io
from contextlib import closing

import pytest

from humanplay.study.folder import Folder
from humanplay.study.protocol import default_protocol
from marsexplorer.config import EnvConfig
from tests.browser.test_study_page import RIGHT, Participant
from tests.support.browser import AS_A_PERSON, NO_3D
from tests.support.command import command
from tests.support.declared import DECLARATIONS
from tests.support.recorded import ask
from tests.support.recruitment_site import PROLIFIC, RecruitmentSite, prolific_export

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]
CONNECT_IDS = ("participantId", "assignmentId", "projectId")
PAY = {"currency": "GBP", "base": 2, "bonus_per_unit": 0.5, "outcomes": {"withdrew": 0.25}}
WIDE = {"viewport": {"width": 1440, "height": 900}, "reduced_motion": "reduce"}


class Recruit(Participant):
    """Somebody who comes to the study by the link that a site shows them."""

    def come(self, page):
        self.page.goto(page)
        self.page.get_by_role("link", name="Begin the study").click()
        self.wait("window.study && window.study.screen !== 'loading'")
        return self

    def to_questions(self):
        self.stands("consent")
        assert "?" not in self.page.url, "nobody copies an ID with the address"
        self.choose("agree")
        self.stands("instructions")
        self.choose("to-tutorial")
        self.driving()
        self.choose("skip")
        self.stands("questions")

    def to_the_end(self):
        self.to_questions()
        self.answer(RIGHT)
        self.stands("ready")
        self.choose("begin")
        self.driving()
        self.explore()
        self.page.keyboard.press("Enter")
        self.stands("debrief")
        self.choose("finish")
        self.stands("complete")

    def fails_the_questions(self):
        self.to_questions()
        for _ in range(2):
            self.answer([1, 0, 0])
        self.stands("withdrawn")

    def go_back(self):
        self.choose("return")
        self.page.get_by_text("You have come back.").wait_for()


@pytest.fixture
def site():
    with closing(RecruitmentSite()) as started:
        yield started


@pytest.fixture
def researcher(capsys, tmp_path):
    """`researcher("study", ...)` returns what a command prints that succeeds."""

    def types(*words):
        database = "--database", tmp_path / "playground.db"
        code, printed, refusal = command(capsys, *words, *database)
        assert code == 0, (words, printed, refusal)
        return printed

    return types


@pytest.fixture
def recruit(open_browser, serve, site, researcher, tmp_path):
    """`recruit(platform, outcomes...)` freezes a study as the guide says.

    The site has its address. It returns the server and `come(person, ids)`.
    """

    def start(platform, *outcomes, adds=False, options=(), **protocol):
        folder = Folder(tmp_path / "playground.db-studies")
        fields = {"recruitment": "open" if platform == "code" else "panel", **protocol}
        draft = default_protocol(
            "tiny", EnvConfig.of("random", (6, 8)), platform=platform, warm_up=0, ranked=1, players=5, question_tries=2,
            policies=("random",), debrief_policy="random", declarations=DECLARATIONS, pause_after_s=900, **fields,
        )  # fmt: skip
        folder.create(draft)
        if outcomes:
            researcher("study", "outcomes", "tiny", *outcomes)
        printed = researcher("study", "freeze", "tiny", "--underpowered", *options)
        server = serve()
        (ending,) = [
            line.rpartition(" ")[2]
            for line in printed.splitlines()
            if "give to the platform" in line
        ] or ["/study/tiny"]
        site.address = server.url + ending

        def come(person, ids=None):
            profile = open_browser((*NO_3D, *AS_A_PERSON)).new_context(**WIDE)
            site.stand_in_at(profile, PROLIFIC)
            page = site.send(person, ids or {}, adds)
            return Recruit(profile.new_page(), server.url).come(page)

        return server, come

    return start


def paid(researcher, tmp_path):
    """The list of payments, by identifier."""
    listed = tmp_path / "pay.csv"
    researcher("study", "payments", "tiny", "--csv", listed)
    return {row["identifier"]: row for row in csv.DictReader(io.StringIO(listed.read_text()))}


def from_prolific(digit):
    return {"PROLIFIC_PID": digit * 24, "STUDY_ID": "a" * 24, "SESSION_ID": "b" * 24}


def test_prolific_sends_people_and_reads_their_codes(recruit, site, researcher, tmp_path):
    (tmp_path / "pilot.txt").write_text("9" * 24 + "\n")
    back = f"{PROLIFIC}/submissions/complete?cc="
    _, come = recruit(
        "prolific", f"finished={back}C1DONE", "failed_questions=C2FAILED",
        options=("--exclude-ids", tmp_path / "pilot.txt"), payment=PAY,
    )  # fmt: skip
    assert site.address.endswith("&SESSION_ID={{%SESSION_ID%}}")
    finisher, failer, idler = (come(digit, from_prolific(digit)) for digit in "123")
    finisher.to_the_end()
    assert finisher.page.get_by_test_id("code").inner_text() == "C1DONE"
    finisher.go_back()
    failer.fails_the_questions()
    failer.go_back()
    assert site.returns == [
        ("/submissions/complete", {"cc": "C1DONE"}),
        ("/submissions/complete", {"cc": "C2FAILED"}),
    ]
    idler.to_questions()
    piloted = come("9", from_prolific("9"))
    piloted.stands("problem")
    assert (
        "for people who have not taken part before" in piloted.page.locator("#problem").inner_text()
    )
    unfilled = come("0", {})
    unfilled.stands("problem")
    assert "their link is not set up" in unfilled.page.locator("#problem").inner_text()

    researcher("study", "close", "tiny", "--yes", "--now")
    submissions = prolific_export(
        ("1" * 24, "AWAITING REVIEW", "C1DONE"),
        ("2" * 24, "AWAITING REVIEW", "C2FAILED"),
        ("3" * 24, "AWAITING REVIEW", "C1DONE"),
        ("4" * 24, "TIMED-OUT", ""),
        ("5" * 24, "RETURNED", ""),
    )
    (tmp_path / "export.csv").write_text(submissions)
    compared = researcher("study", "payments", "tiny", "--against", tmp_path / "export.csv")
    assert f"claim to have finished and have not: {'3' * 24}\n" in compared
    assert f"finished without a code: nobody\ntimed out: {'4' * 24}\n" in compared
    researcher("study", "payments", "tiny", "--bulk", tmp_path / "bulk.csv")
    assert (tmp_path / "bulk.csv").read_text() == f"{'1' * 24},0.50\n"
    unlinked = researcher("study", "unlink", "tiny", "--yes")
    assert "identifiers and codes of 3 people" in unlinked
    assert set(paid(researcher, tmp_path)) == {""}
    assert ask(tmp_path / "playground.db", "SELECT count(*) FROM identities") == [(0,)]


def test_sona_credits_the_person_whose_number_comes_back(recruit, site, researcher, tmp_path):
    credit = f"{site.url}/webstudy_credit.aspx?experiment_id=7&credit_token=4e48&survey_code="
    _, come = recruit(
        "sona", f"finished={credit}{{survey_code}}", f"withdrew={credit}{{survey_code}}"
    )
    assert site.address.endswith("?survey_code=%SURVEY_CODE%")
    student = come("student", {"survey_code": "40517"})
    student.to_the_end()
    student.go_back()
    tired = come("tired", {"survey_code": "40518"})
    tired.to_questions()
    tired.choose("open-leave")
    tired.choose("leave-now")
    tired.stands("withdrawn")
    tired.go_back()
    granted = {"experiment_id": "7", "credit_token": "4e48"}
    assert site.returns == [
        ("/webstudy_credit.aspx", {**granted, "survey_code": code}) for code in ("40517", "40518")
    ]
    rows = paid(researcher, tmp_path)
    assert {ident: row["outcome"] for ident, row in rows.items()} == {
        "40517": "finished",
        "40518": "withdrew",
    }


def test_connect_adds_its_parameters_and_has_an_address_for_part_of_a_study(
    recruit, site, researcher, tmp_path
):
    project = f"{site.url}/participant/project/41B26CAA44"
    _, come = recruit(
        "connect",
        f"finished={project}/complete",
        f"failed_questions={project}/partial/1",
        adds=True,
    )
    ids = [dict.fromkeys(CONNECT_IDS, f"{digit}F51E3A0B9") for digit in "12"]
    finisher, failer = (come(ident["participantId"], ident) for ident in ids)
    finisher.to_the_end()
    finisher.go_back()
    failer.fails_the_questions()
    failer.go_back()
    places = [path.rpartition("41B26CAA44")[2] for path, _ in site.returns]
    assert places == ["/complete", "/partial/1"]
    rows = paid(researcher, tmp_path)
    assert {ident: row["outcome"] for ident, row in rows.items()} == {
        "1F51E3A0B9": "finished",
        "2F51E3A0B9": "failed_questions",
    }


def test_a_class_hands_in_codes_that_are_drawn_for_each(recruit, site, researcher, tmp_path):
    _, come = recruit("code")
    for student in ("ada", "ben"):
        person = come(student)
        person.to_the_end()
        code = person.page.get_by_test_id("code").inner_text()
        person.page.goto(f"{site.url}/form")
        person.page.get_by_label("Code").fill(code)
        person.page.keyboard.press("Enter")
        person.page.get_by_text("You have come back.").wait_for()
    handed_in = [parameters["code"] for _, parameters in site.returns]
    assert len(set(handed_in)) == 2
    listed = tmp_path / "pay.csv"
    researcher("study", "payments", "tiny", "--csv", listed)
    rows = list(csv.DictReader(io.StringIO(listed.read_text())))
    assert [(row["code"], row["outcome"]) for row in rows] == [
        (code, "finished") for code in handed_in
    ]


def test_a_laboratory_has_a_private_window_for_each_and_its_operators_code(
    recruit, site, researcher, tmp_path, open_browser
):
    server, _ = recruit("code", recruitment="invitation", required_attestation="supervised")
    links = researcher("study", "invite", "tiny", 2, "--url", server.url).split()
    code, *_ = researcher("study", "supervise", "tiny").splitlines()
    browser = open_browser((*NO_3D, *AS_A_PERSON))
    profile = browser.new_context(**WIDE)
    for number, link in enumerate(links):
        window = profile if number == 0 else browser.new_context(**WIDE)
        person = Recruit(window.new_page(), server.url)
        site.address = link
        person.come(site.send(str(number), {}))
        person.stands("consent")
        person.choose("agree")
        person.stands("instructions")
        person.choose("open-supervise")
        person.page.keyboard.type(code)
        person.page.keyboard.press("Enter")
        person.page.get_by_test_id("supervise").wait_for(state="hidden")
        person.choose("to-tutorial")
        person.driving()
        person.choose("skip")
        person.stands("questions")
        person.answer(RIGHT)
        person.stands("ready")
        person.choose("begin")
        person.driving()
        person.explore()
        person.page.keyboard.press("Enter")
        person.stands("debrief")
        person.choose("finish")
        person.stands("complete")
        if number == 0:
            second = Recruit(profile.new_page(), server.url)
            site.address = links[1]
            second.come(site.send("second", {}))
            second.stands("problem")
            assert "a private window" in second.page.locator("#problem").inner_text()
    ranked = """SELECT attestation FROM episodes JOIN series_episodes ON episode_id = id
        WHERE phase = 'ranked'"""
    assert ask(tmp_path / "playground.db", ranked) == [("supervised",)] * 2
    rows = paid(researcher, tmp_path)
    assert [row["outcome"] for row in rows.values()] == ["finished"] * 2
    assert len({row["code"] for row in rows.values()}) == 2
