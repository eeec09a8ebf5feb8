"""Eleven people walk through a study in a browser, and every account of them.

Payments, report, release, `reproduce` and a script that knows the data dictionary alone agree on
everybody who agreed; the others are counts. Nothing that leaves the study names anybody.
"""

import csv
import io
import json
import logging
from collections import Counter, defaultdict
from decimal import ROUND_HALF_UP, Decimal

import pytest

from humanplay.db.study_rows import participant_label
from humanplay.report.build import build
from humanplay.study.data import load
from tests.browser.test_study_page import RIGHT, Participant
from tests.support.browser import AS_A_PERSON, NO_3D, judge
from tests.support.command import command
from tests.support.recorded import ask
from tests.support.study import freeze

pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]
TEXTS = {
    "finished": "C1DONE",
    "unfit_device": "C2DEVICE",
    "no_consent": "C3REFUSED",
    "failed_questions": "C4QUESTIONS",
    "failed_practice": "C5PRACTICE",
    "over_quota": "C6FULL",
    "stopped_by_us": "C7STOPPED",
    "withdrew": "https://app.prolific.com/submissions/complete?cc=C8WITHDREW",
}
PAY = {
    "currency": "GBP",
    "base": 2,
    "bonus_per_unit": 0.5,
    "hourly_rate": 9,
    "outcomes": {"failed_questions": 0.5, "failed_practice": 0.75, "withdrew": 0.25},
}
ARMS = [
    {"name": "arm_one", "instructions": "Follow the walls first."},
    {"name": "arm_two", "instructions": "Begin in the middle."},
]
BLOCKS = [
    {"name": "hands", "at": "before", "title": "Your hands", "about": "your hands", "questions": [
        {"kind": "choice", "name": "hand", "question": "Which hand writes?", "choices": ["left", "right"]}]},
    {"name": "mood", "at": "after_warm_up", "title": "Your mood", "about": "your mood", "questions": [
        {"kind": "likert", "name": "rested", "question": "Do you agree?", "rows": ["I rested."], "points": ["no", "yes"]}]},
    {"name": "end", "at": "after", "title": "The end", "about": "the study", "questions": [
        {"kind": "text", "name": "remark", "question": "What else?", "long": True}]},
]  # fmt: skip
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
WIDE = {"viewport": {"width": 1440, "height": 900}}
WAYS = [
    "finisher",
    "questions",
    "practice",
    "unfit",
    "decliner",
    "withdraws",
    "erases",
    "moves",
    "late",
    "quitter",
    "stopped",
]


def ids_of(way):
    """The IDs of a person on Prolific, no two of which are alike."""
    digit = "123456789ab"[WAYS.index(way)]
    names = ("PROLIFIC_PID", "STUDY_ID", "SESSION_ID")
    return {name: (digit + str(number)) * 12 for number, name in enumerate(names)}


class Walker(Participant):
    """Somebody who walks through the study by keyboard."""

    choice = 0
    """Which of two answers they choose."""

    def answers(self, text=None):
        """Answer the block on the page: by their choice, or in words."""
        self.stands("block")
        form = self.page.locator("#block-form")
        for field in form.locator("fieldset").all():
            if field.locator("[type=radio]").count():
                field.locator("[type=radio]").nth(self.choice).check()
            elif text:
                field.locator("textarea").fill(text)
        self.choose("send-block")

    def press(self, action):
        """Think before each press: of few presses none may look like a program's."""
        self.page.wait_for_timeout(150)
        super().press(action)

    def to_quiz(self):
        self.stands("consent")
        self.choose("agree")
        self.answers()
        self.stands("instructions")
        self.choose("to-tutorial")
        self.driving()
        self.choose("skip")
        self.stands("questions")

    def to_practice(self):
        self.to_quiz()
        self.answer(RIGHT)
        self.stands("ready")
        self.choose("begin")
        self.driving()

    def to_what_counts(self):
        self.to_practice()
        self.explore()
        self.page.keyboard.press("Enter")
        self.answers()
        self.stands("ready")
        self.choose("begin")
        self.driving()

    def gives_up(self):
        self.driving()
        self.choose("open-give-up")
        self.choose("give-up-now")

    def passes_the_end(self):
        self.page.get_by_test_id("end-card").wait_for(state="visible")
        self.wait("window.study.painted.participant.about.frame.outcome")
        self.page.keyboard.press("Enter")

    def to_the_code(self, text=None):
        self.answers(text)
        self.stands("debrief")
        self.choose("finish")
        self.stands("complete")

    def leaves(self, test_id):
        self.choose("open-leave")
        self.choose(test_id)
        self.stands("withdrawn")

    def code(self):
        code = self.page.get_by_test_id("code")
        return code.inner_text() if code.is_visible() else None


@pytest.fixture
def walk(open_browser, serve, tmp_path):
    """The server, `come(way)` for a person from Prolific, and the browsers."""
    freeze(
        tmp_path / "playground.db-studies", "tiny", size=(6, 8), platform="prolific", recruitment="panel",
        device="computer", question_tries=2, cap=8, players=7, warm_up=1, ranked=1, blocks=BLOCKS, arms=ARMS,
        practice={"episodes_to_pass": 1, "tries": 1}, outcomes=TEXTS, payment=PAY, pause_after_s=900,
    )  # fmt: skip
    server = serve()

    def come(way, **context):
        profile = open_browser((*NO_3D, *AS_A_PERSON)).new_context(
            reduced_motion="reduce", **(context or WIDE)
        )
        query = "&".join(f"{name}={ident}" for name, ident in ids_of(way).items())
        person = Walker(profile.new_page(), server.url, f"?{query}")
        person.choice = WAYS.index(way) % 2
        return person.goto()

    return server, come, open_browser


def moves_to_another_device(person, server, open_browser):
    """Go on elsewhere by the link in the dialog, in the middle of what counts."""
    person.press(person.next_action())
    stood = person.frame
    person.page.keyboard.press("Tab")
    person.page.evaluate("document.querySelector('[data-open=elsewhere]').click()")
    address = person.page.get_by_test_id("elsewhere-address")
    address.wait_for(state="visible")
    assert judge(person.page, "study-elsewhere") == []
    link = address.inner_text()
    profile = open_browser((*NO_3D, *AS_A_PERSON)).new_context(reduced_motion="reduce", **WIDE)
    other = Walker(profile.new_page(), server.url)
    other.page.goto(link)
    other.driving()
    assert "#" not in other.page.url, "whoever copies the address hands on nothing"
    assert other.frame == stood
    person.stands("problem")
    assert (
        "gone on with this study on another device" in person.page.locator("#problem").inner_text()
    )
    assert judge(person.page, "study-went-on-elsewhere") == []
    person.page.reload()
    person.stands("problem")
    person.choose("open-recover")
    person.page.keyboard.type("0000-0000")
    person.page.keyboard.press("Enter")
    person.page.get_by_text("This is not a recovery code of this study").wait_for()
    assert judge(person.page, "study-recover") == []
    return other


def test_eleven_people_and_every_account_of_them_agree(walk, tmp_path, capsys, caplog):
    server, come, open_browser = walk
    caplog.set_level(logging.INFO)
    path = tmp_path / "playground.db"
    database = "--database", path
    people = {}

    finisher = people["finisher"] = come("finisher")
    assert "?" not in finisher.page.url
    finisher.to_what_counts()
    finisher.explore()
    finisher.page.keyboard.press("Enter")
    pid = ids_of("finisher")["PROLIFIC_PID"]
    finisher.to_the_code(f"I am {pid}, write to me@example.org")
    assert finisher.code() == "C1DONE"

    person = people["questions"] = come("questions")
    person.to_quiz()
    person.answer([1, 0, 0])
    person.page.get_by_text("You can answer once more").wait_for()
    person.answer([1, 0, 0])
    person.stands("withdrawn")
    assert person.code() == "C4QUESTIONS"

    person = people["practice"] = come("practice")
    person.to_practice()
    person.gives_up()
    person.stands("withdrawn")
    assert person.code() == "C5PRACTICE"

    person = people["unfit"] = come("unfit", **PHONE)
    person.stands("withdrawn")
    assert person.code() == "C2DEVICE"

    person = people["decliner"] = come("decliner")
    person.stands("consent")
    person.choose("disagree")
    person.choose("leave-now")
    person.stands("withdrawn")
    assert person.code() == "C3REFUSED"

    person = people["withdraws"] = come("withdraws")
    person.to_what_counts()
    person.press(person.next_action())
    person.leaves("leave-now")
    back = person.page.get_by_test_id("return").get_attribute("href")
    assert back.endswith("cc=C8WITHDREW")

    person = people["erases"] = come("erases")
    person.stands("consent")
    person.choose("agree")
    person.answers()
    person.stands("instructions")
    erased_label = person.state("participant.participant")
    person.leaves("leave-erase")

    person = people["moves"] = come("moves")
    person.to_what_counts()
    other = people["moved"] = moves_to_another_device(person, server, open_browser)
    other.explore()
    other.page.keyboard.press("Enter")
    other.to_the_code()
    assert other.code() == "C1DONE"

    person = people["quitter"] = come("quitter")
    person.to_what_counts()
    person.gives_up()
    person.passes_the_end()
    person.to_the_code()
    assert person.code() == "C1DONE"

    person = people["stopped"] = come("stopped")
    person.to_what_counts()
    person.press(person.next_action())

    person = people["late"] = come("late")
    person.stands("withdrawn")
    assert person.code() == "C6FULL"

    assert command(capsys, "study", "close", "tiny", "--yes", "--now", *database)[0] == 0
    people["stopped"].page.reload()
    people["stopped"].stands("problem")
    assert people["stopped"].code() == "C7STOPPED"
    for way, person in people.items():
        assert person.errors == [], way
    recovery_codes = [
        people[way].state("participant.recovery_code") for way in ("finisher", "moved")
    ]

    paid = payments(capsys, tmp_path, database)
    outcomes = {
        way: paid[ids_of(way)["PROLIFIC_PID"]]["outcome"]
        for way in WAYS
        if ids_of(way)["PROLIFIC_PID"] in paid
    }
    assert outcomes == {
        "finisher": "finished",
        "questions": "failed_questions",
        "practice": "failed_practice",
        "withdraws": "withdrew",
        "erases": "withdrew",
        "moves": "finished",
        "quitter": "finished",
        "stopped": "stopped_by_us",
    }
    drawn = dict(
        ask(
            path,
            "SELECT participant_id, value FROM identities WHERE name = 'PROLIFIC_PID'",
        )
    )
    labels = {participant_label(ident): value for ident, value in drawn.items()}
    assert {row["label"] for row in paid.values()} == set(labels)

    code, printed, error = command(capsys, "forget", erased_label, "--yes", *database)
    assert code == 0, printed + error
    del paid[ids_of("erases")["PROLIFIC_PID"]]
    assert payments(capsys, tmp_path, database) == paid
    server.stop()

    flow = build(load(path, "tiny")).groups[0].flow
    counted = {str(status): count for status, count in flow.people.items()}
    assert counted == {
        "finished": 2, "gave_up": 1, "withdrew": 1, "interrupted": 1, "failed_questions": 1, "failed_practice": 1,
        "declined": 1, "unfit_device": 1, "over_quota": 1, "erased": 1,
    }  # fmt: skip

    out = tmp_path / "bundle"
    wanted = "--answers", "--free-text", "--author", "A"
    code, printed, error = command(
        capsys, "release", "--study", "tiny", "--out", out, *wanted, *database
    )
    assert code == 0, printed + error
    rebuilt = rebuild(out)
    theirs = Counter(
        (row["outcome"], row["minutes"], row["amount"], row["arm"]) for row in paid.values()
    )
    assert (
        Counter(
            (row["outcome"], f"{row['minutes']:.1f}", f"{row['amount']:.2f}", row["arm"])
            for row in rebuilt
        )
        == theirs
    )
    published = Counter(row["status"] for row in rebuilt)
    assert published == {status: counted[status] for status in published}
    assert sum(published.values()) == len(paid) == flow.agreed
    assert sorted(row["devices"] for row in rebuilt) == [1] * 6 + [2]
    published = json.loads((out / "report.json").read_text())["groups"][0]
    assert Counter(row["language"] for row in rebuilt) == published["languages"] == {"en": 7}
    only_counted = {"declined", "unfit_device", "over_quota", "erased"}
    assert status_rows(out) == {
        row["status"]: (row["people"], row["as_played"], row["lowest"])
        for row in published["statuses"]
        if row["status"] not in only_counted
    }
    assert player_rows(out, published["worst"]["score"]) == sorted(
        (
            row["status"],
            row["episodes"],
            row["explored"],
            row["failed"],
            round(row["score"], 9),
            row["steps"],
        )
        for row in published["players"]
    )
    assert [row["people"] for row in published["answers"]] == [7, 5, None]
    assert answer_rows(out) == {
        row["question"]: [(cell["answers"], cell["people"]) for cell in row["cells"]]
        for row in published["answers"]
    }
    code, printed, error = command(capsys, "reproduce", out)
    assert code == 0, printed + error

    export, html = tmp_path / "export", tmp_path / "report.html"
    for words in (("export", "--out", export), ("report", "--study", "tiny", "--html", html)):
        code, printed, error = command(capsys, *words, *database)
        assert code == 0, printed + error
    secrets = [ident for way in WAYS for ident in ids_of(way).values()]
    secrets += [text.rpartition("=")[2] for text in TEXTS.values()] + recovery_codes
    secrets += ["app.prolific.com", "me@example.org", erased_label, *labels]
    written = [file for folder in (out, export) for file in folder.rglob("*") if file.is_file()]
    read = {str(file): file.read_bytes() for file in (*written, html)}
    read["log"] = repr([vars(record) for record in caplog.records]).encode()
    for secret in secrets:
        holders = [name for name, content in read.items() if secret.encode() in content]
        assert holders == [], secret


def payments(capsys, tmp_path, database):
    """The list of payments, by identifier."""
    listed = tmp_path / "pay.csv"
    code, printed, error = command(capsys, "study", "payments", "tiny", "--csv", listed, *database)
    assert code == 0, printed + error
    return {row["identifier"]: row for row in csv.DictReader(io.StringIO(listed.read_text()))}


def rebuild(bundle):
    """Each person's outcome, minutes and amount, by a bundle's dictionary alone."""
    columns = json.loads((bundle / "columns.json").read_text())
    payment = json.loads((bundle / "protocol.json").read_text())["payment"]
    tables = {name: table(bundle, name) for name in ("participants", "episodes")}
    for name, rows in tables.items():
        assert set(rows[0]) <= {column["name"] for column in columns[name]["columns"]}
    successes = Counter(
        row["participant"]
        for row in tables["episodes"]
        if row["phase"] == "ranked" and row["outcome"] in ("explored", "succeeded")
    )
    people = [row for row in tables["participants"] if row["kind"] == "human"]
    for row in people:
        row["minutes"], row["devices"] = float(row["minutes"]), int(row["devices"])
        amount = Decimal(str(payment["outcomes"].get(row["outcome"], 0)))
        if row["outcome"] == "finished":
            bonus = Decimal(str(payment["bonus_per_unit"])) * successes[row["participant"]]
            amount = Decimal(str(payment["base"])) + bonus
        elif row["outcome"] == "stopped_by_us":
            time = Decimal(str(payment["hourly_rate"])) * Decimal(row["minutes"]) / 60
            amount = max(amount, time.quantize(Decimal("0.01"), ROUND_HALF_UP))
        row["amount"] = amount
    return people


def status_rows(bundle):
    """By status: people, instances counted as played, the reasons of the others."""
    people, ranked = people_and_ranked(bundle)
    terrains = json.loads((bundle / "protocol.json").read_text())["ranked"]
    rows = {}
    for status in {row["status"] for row in people}:
        names = [row["participant"] for row in people if row["status"] == status]
        began = [name for name in names if name in ranked]
        reasons = Counter(row["lowest"] for name in began for row in ranked[name].values())
        reasons["not_ended"] += terrains * len(began) - reasons.total()
        as_played = reasons.pop("", 0)
        rows[status] = (len(names), as_played, dict(+reasons))
    return rows


def player_rows(bundle, worst):
    """The report's table of players, in an order of its own.

    worst  the score of an instance that counts at the lowest
    """
    people, ranked = people_and_ranked(bundle)
    protocol = json.loads((bundle / "protocol.json").read_text())
    rows = []
    for person in (row for row in people if row["participant"] in ranked):
        episodes = ranked[person["participant"]]
        counted = [episodes.get(str(at)) for at in range(protocol["ranked"])]
        played = [row for row in counted if row is not None and not row["lowest"]]
        missing = len(counted) - len(played)
        explored = sum(row["outcome"] in ("explored", "succeeded") for row in played)
        score = sum(float(row["score"]) for row in played) + missing * worst
        steps = (
            sum(int(row["steps_to_99"]) for row in played)
            + missing * protocol["config"]["max_steps"]
        )
        means = round(score / len(counted), 9), steps / len(counted)
        rows.append((person["status"], len(counted), explored, len(counted) - explored, *means))
    return sorted(rows)


def answer_rows(bundle):
    """The report's counts of answers, those of one or two people joined."""
    blocks = json.loads((bundle / "protocol.json").read_text())["blocks"]
    questions = {question["name"]: question for block in blocks for question in block["questions"]}
    answers = Counter((row["question"], float(row["answer"])) for row in table(bundle, "answers"))
    answers.update((row["question"], 0.0) for row in table(bundle, "free_texts"))
    rows = {}
    for name, question in questions.items():
        labels = question.get("choices") or question.get("points") or ["wrote something"]
        counts = [answers[name, place] for place in range(len(labels))]
        if sum(counts) < 3:
            rows[name] = []
        elif any(0 < count < 3 for count in counts):  # two answers, so all are joined
            rows[name] = [(" or ".join(labels), sum(counts))]
        else:
            rows[name] = list(zip(labels, counts, strict=True))
    return rows


def people_and_ranked(bundle):
    """The people of a bundle, and their ranked episodes by person and instance."""
    people = [row for row in table(bundle, "participants") if row["kind"] == "human"]
    ranked = defaultdict(dict)
    for row in table(bundle, "episodes"):
        if row["kind"] == "human" and row["phase"] == "ranked":
            ranked[row["participant"]][row["terrain_index"]] = row
    return people, ranked


def table(bundle, name):
    (file,) = bundle.rglob(f"{name}.csv")
    return list(csv.DictReader(file.read_text().splitlines()))
