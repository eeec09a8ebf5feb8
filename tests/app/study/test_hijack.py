"""An identifier, a label or an old link opens nobody's place."""

import pytest
from websockets.exceptions import ConnectionClosed

from humanplay.study.folder import Folder
from humanplay.study.invitations import Invitations, token_of
from humanplay.web.simulate import RefusedError
from tests.support.recorded import ask
from tests.support.study import Person, freeze

YES = {"version": "1", "agree": True}
IDS = {"PROLIFIC_PID": "5f1a" * 6, "STUDY_ID": "6a0b" * 6, "SESSION_ID": "7c2d" * 6}
PLACE = "SELECT stage, session_id, player_id, consent_ms, settings FROM participants WHERE id = ?"
EPISODES = """SELECT e.id, e.ended_ms FROM series_episodes s JOIN episodes e ON e.id = s.episode_id
    WHERE s.participant_id = ? ORDER BY 1"""


@pytest.fixture(params=["panel", "invitation"])
def owner(request, serve, tmp_path):
    """Somebody who plays the tutorial of a study, and what their link held."""
    by_panel = {
        "recruitment": "panel",
        "platform": "prolific",
        "outcomes": {"finished": "C1A2B3C4"},
    }
    kind = by_panel if request.param == "panel" else {"recruitment": "invitation"}
    study = freeze(tmp_path / "playground.db-studies", **kind)
    link = {"outside_ids": IDS}
    if request.param == "invitation":
        (issued,) = Invitations(Folder(tmp_path / "playground.db-studies")).issue("small", 1)
        link = {"invitation": token_of(study, issued.id)}
    person = Person(serve(), **link)
    person.link = link
    person.to_tutorial()
    person.call("next")
    return person


def intruder(owner, brings):
    """A browser that brings what others may know, as a cookie and in its link."""
    (cookie,) = owner.client.cookies
    label, session = owner.where["participant"], owner.where["session"]
    first = next(iter(owner.link.values()))
    identifier = first["PROLIFIC_PID"] if "outside_ids" in owner.link else first
    cookies, link = {
        "the link that was used": ({}, owner.link),
        "the identifier in another link": ({}, {"outside_ids": {"PROLIFIC_PID": identifier}}),
        "the identifier as a cookie": ({cookie: identifier}, owner.link),
        "the label as a cookie": ({cookie: label}, {"outside_ids": {"PROLIFIC_PID": label}}),
        "the label as an invitation": ({}, {"invitation": label}),
        "the board's address": ({cookie: session}, {}),
    }[brings]
    return Person(owner.server, client=owner.server.client(cookies=cookies), joins=False), link


@pytest.mark.parametrize(
    "brings",
    [
        "the link that was used",
        "the identifier in another link",
        "the identifier as a cookie",
        "the label as a cookie",
        "the label as an invitation",
        "the board's address",
    ],
)
def test_who_brings_what_others_know_comes_to_nobodys_place(owner, brings):
    path, session = owner.server.services.store.path, owner.where["session"]
    (ident,) = ask(path, "SELECT id FROM participants")[0]
    before = ask(path, PLACE, ident), ask(path, EPISODES, ident)
    other, link = intruder(owner, brings)
    assert other.refused("join", link), "nobody is let in as somebody else"
    with pytest.raises(RefusedError) as refusal:
        other.me()
    assert refusal.value.status == 404
    frame = owner.frame
    give_up = {"episode": frame["episode"], "step": frame["step"]}
    for verb, body in (
        ("consent", YES),
        ("advance", {"from": "tutorial"}),
        ("next", None),
        ("give-up", give_up),
        ("settings", {"palette": "high-contrast"}),
        ("withdraw", {"erase": True}),
    ):
        other.refused(verb, body, status=404)
    act = {"kind": "act", **give_up, "action": "south"}
    assert other.client.post(f"/api/sessions/{session}/act", json=act).status_code == 404
    with (
        pytest.raises(ConnectionClosed) as closed,
        owner.server.socket(session, other.client) as socket,
    ):
        socket.receive("frame")
    assert closed.value.rcvd.code == 4404
    assert (ask(path, PLACE, ident), ask(path, EPISODES, ident)) == before
    assert len(ask(path, "SELECT id FROM participants")) == 1
    with owner.socket() as socket:
        frame = socket.receive("frame")
        socket.act(frame, "south", input="key")
        assert socket.frame_after(frame["step"])["step"] == frame["step"] + 1, "the owner plays on"
