"""How people come into a study, in a real browser.

Invitations, refused links, the operator's code, the operator's list.
"""

import sqlite3
from contextlib import closing

import pytest

from humanplay.cli.main import main
from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, link_of
from humanplay.study.recruitment import code_of
from tests.browser.test_study_page import Participant
from tests.support.browser import AS_A_PERSON, NO_3D, fetched, judge
from tests.support.declared import DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft
from tests.support.servers import eventually
from tests.support.study import freeze

PASSWORD = "red-planet-4"


@pytest.fixture
def visitor(open_browser):
    """`visitor(url)` opens an address in a fresh browser profile.

    The page has loaded when it is returned.
    """

    def start(url, server):
        wide = {"width": 1440, "height": 900}
        browser = open_browser((*NO_3D, *AS_A_PERSON))
        profile = browser.new_context(viewport=wide, reduced_motion="reduce")
        participant = Participant(profile.new_page(), server.url)
        participant.page.goto(url)
        participant.wait("window.study && window.study.screen !== 'loading'")
        return participant

    return start


def look(person, name):
    """Judge a screen at both sizes with axe, and keep pictures of it."""
    assert judge(person.page, f"study-{name}") == []


def refusal(person):
    """Wait for the screen of a refusal and return its sentence."""
    person.stands("problem")
    return person.page.locator("#problem").inner_text()


@pytest.fixture
def invited(serve, tmp_path):
    """A server with an operator and a study by invitation, the study, two invitations."""
    study = freeze(
        tmp_path / "playground.db-studies", "tiny", recruitment="invitation", pause_after_s=1
    )
    issued = Invitations(Folder(tmp_path / "playground.db-studies")).issue("tiny", 2)
    return serve(admin_password=PASSWORD), study, issued


def test_a_platforms_id_leaves_the_address_and_a_reload_goes_on_with_it(serve, visitor, tmp_path):
    freeze(tmp_path / "playground.db-studies", "tiny", recruitment="panel")
    server = serve()
    me = visitor(f"{server.url}/study/tiny?PROLIFIC_PID=p-77&SESSION_ID=s", server)
    me.stands("consent")
    assert me.page.url == f"{server.url}/study/tiny"
    me.page.reload()
    me.stands("consent")
    me.choose("agree")
    me.stands("instructions")
    with closing(sqlite3.connect(tmp_path / "playground.db")) as database:
        identities = database.execute("SELECT name, value FROM identities ORDER BY name").fetchall()
    assert identities == [("PROLIFIC_PID", "p-77"), ("SESSION_ID", "s")]


def test_a_link_lets_one_browser_in_and_a_copied_address_none(invited, visitor):
    server, study, (invitation, _) = invited
    link = link_of(study, invitation.id, server.url)
    me = visitor(link, server)
    me.stands("consent")
    assert me.page.url == f"{server.url}/study/tiny", "whoever copies it hands on no invitation"
    assert me.page.evaluate("() => history.length") <= 2
    assert me.page.get_by_test_id("consent-invited").is_visible()
    other = visitor(link, server)
    other.stands("consent")
    me.page.reload()
    me.stands("consent")
    me.choose("agree")
    me.stands("instructions")
    other.choose("agree")
    sentence = (
        "This invitation has been used: if it was you, go on in the browser in which you began"
    )
    assert refusal(other).startswith(sentence)
    sentence = "This study is by invitation: open the link that you were sent."
    assert refusal(visitor(me.page.url, server)) == sentence
    code = code_of(study, server.services.lobby.sources.clock_ms())
    supervise(me, code)
    me.choose("to-tutorial")
    me.driving()
    me.page.get_by_test_id("pause").wait_for(state="visible")
    me.choose("supervise-in-pause")
    me.page.keyboard.press("ArrowRight")
    assert me.frame["step"] == 0, "what is typed in the dialog drives nothing"
    look(me, "supervise")
    me.page.keyboard.press("Escape")
    assert me.errors == other.errors == []


def supervise(me, code):
    """Type a wrong code, then the right one, by keyboard."""
    me.choose("open-supervise")
    me.page.keyboard.type("WRONG-CODE")
    me.page.keyboard.press("Enter")
    status = me.page.get_by_test_id("supervise-status")
    eventually(lambda: "not the operator's code" in status.inner_text())
    me.page.keyboard.type(code.lower())
    me.page.keyboard.press("Enter")
    me.page.get_by_test_id("supervise").wait_for(state="hidden")
    supervised = me.page.get_by_test_id("supervised")
    eventually(lambda: supervised.inner_text().startswith("Supervised until"))


@pytest.mark.long
def test_the_operator_makes_watches_and_revokes_links_and_axe_finds_nothing_where_people_come_in(
    invited, visitor
):
    server, study, (first, second) = invited
    me = visitor(link_of(study, first.id, server.url), server)
    other = visitor(link_of(study, first.id, server.url), server)
    look(me, "consent-invited")
    me.choose("agree")
    other.choose("agree")
    refusal(other)
    look(other, "invitation-used")
    copied = visitor(me.page.url, server)
    refusal(copied)
    look(copied, "invitation-missing")
    me.stands("instructions")
    supervise(me, code_of(study, server.services.lobby.sources.clock_ms()))
    look(me, "supervised")
    me.choose("to-tutorial")
    me.page.get_by_test_id("pause").wait_for(state="visible")
    look(me, "supervise-in-pause")

    operator = visitor_at_admin(me, server)
    operator.get_by_test_id("show-invitations").click()
    row = operator.get_by_test_id(f"invitation-{first.id}")
    row.wait_for(state="visible")
    assert row.locator("td").first.inner_text() == "used"
    operator.get_by_test_id("invite-count").fill("3")
    operator.keyboard.press("Enter")
    operator.get_by_test_id("links").wait_for(state="visible")
    links = operator.get_by_test_id("links").input_value().split()
    assert [link.split("=")[0] for link in links] == [f"{server.url}/study/tiny?invitation"] * 3
    operator.get_by_role("button", name=f"Revoke {second.id}").press("Enter")
    operator.locator(f"[data-testid=invitation-{second.id}][data-state=revoked]").wait_for()
    assert judge(operator, "admin-invitations", full_page=True) == []
    assert "has been taken back" in refusal(visitor(link_of(study, second.id, server.url), server))


def visitor_at_admin(me, server):
    """Return the operator's page, logged in, in a profile of its own."""
    page = me.page.context.browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
    page.goto(f"{server.url}/admin")
    page.get_by_test_id("password").fill(PASSWORD)
    page.keyboard.press("Enter")
    page.wait_for_function("() => document.body.dataset.in === 'yes'")
    return page


def command(capsys, *args):
    """Run `marsexplorer ...`, expect success and return what it printed."""
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main([str(arg) for arg in args])
    output = capsys.readouterr()
    assert ended.value.code == 0, (args, output.out, output.err)
    return output.out


@pytest.mark.long
def test_a_whole_study_by_invitation_from_its_draft_to_a_bundle_that_is_derived_again(
    serve, visitor, tmp_path, capsys
):
    database = ("--database", tmp_path / "playground.db")
    plan = [
        "--size=7x9",
        "--warm-up=1",
        "--ranked=2",
        "--players=2",
        "--break-every=1",
        "--policy=frontier-cost",
        f"--declarations={DECLARATIONS_FILE}",
    ]
    command(capsys, "study", "new", "tiny", *plan, *database)
    draft = draft_of(tmp_path / "playground.db-studies", "tiny")
    edit_draft(draft, debrief_policy="frontier-cost", pause_after_s=900)
    assert "by invitation" in command(
        capsys, "study", "freeze", "tiny", "--underpowered", *database
    )
    server = serve()
    links = command(capsys, "study", "invite", "tiny", 2, "--url", server.url, *database).split()

    people = [visitor(link, server) for link in links]
    for me in people:
        me.to_ranked()
        watcher = visitor(me.page.url, server)
        assert "open the link that you were sent" in refusal(watcher)
        board = f"{server.url}/api/sessions/{me.state('participant.session')}"
        assert fetched(watcher.page, board).status == 404
        me.explore()
        me.page.keyboard.press("Enter")
        me.stands("break")
        me.page.keyboard.press("Enter")
        me.driving()
        me.explore()
        me.page.keyboard.press("Enter")
        me.stands("debrief")
        me.choose("finish")
        me.stands("complete")
        assert me.errors == []
    listed = command(capsys, "study", "invite", "tiny", "--list", *database)
    assert listed.count("used") == 2

    command(capsys, "study", "close", "tiny", "--yes", *database)
    late = visitor(links[0], server)
    assert "is closed" in late.page.get_by_test_id("problem").inner_text()
    server.stop()
    command(capsys, "study", "show", "tiny", *database)
    command(capsys, "verify", *database)
    bundle = tmp_path / "tiny-1"
    command(capsys, "release", "--study", "tiny", "--out", bundle, *database)
    command(capsys, "reproduce", bundle)
    sql = "SELECT attestation, count(*) FROM episodes WHERE driver = 'human' GROUP BY attestation"
    with closing(sqlite3.connect(tmp_path / "playground.db")) as db:
        levels = dict(db.execute(sql))
    assert levels == {"attested": 8}, "every key that drove was matched with its own input event"
