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
def owner_and_link(request, serve, tmp_path):
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
    person.to_tutorial()
    person.call("next")
    return person, link


def identifier_in(link):
    """The participant ID of a platform's link, or the token of an invitation."""
    return link["outside_ids"]["PROLIFIC_PID"] if "outside_ids" in link else link["invitation"]


def platform_link(participant_id):
    return {"outside_ids": {"PROLIFIC_PID": participant_id}}


BRINGS = {
    "the link that was used": lambda state, link: (None, link),
    "the identifier in another link": lambda state, link: (
        None,
        platform_link(identifier_in(link)),
    ),
    "the identifier as a cookie": lambda state, link: (identifier_in(link), link),
    "the label as a cookie": lambda state, link: (
        state["participant"],
        platform_link(state["participant"]),
    ),
    "the label as an invitation": lambda state, link: (None, {"invitation": state["participant"]}),
    "the board's address": lambda state, link: (state["session"], {}),
}
"""The cookie and the link of a browser that brings what others may know."""


def intruder(owner, cookie):
    (name,) = owner.client.cookies
    cookies = {} if cookie is None else {name: cookie}
    return Person(owner.server, client=owner.server.client(cookies=cookies), joins=False)


@pytest.mark.parametrize("brought", BRINGS.values(), ids=BRINGS)
def test_who_brings_what_others_know_comes_to_nobodys_place(owner_and_link, brought):
    owner, used_link = owner_and_link
    path, session = owner.server.services.store.path, owner.where["session"]
    (ident,) = ask(path, "SELECT id FROM participants")[0]
    before = ask(path, PLACE, ident), ask(path, EPISODES, ident)
    cookie, link = brought(owner.where, used_link)
    other = intruder(owner, cookie)
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
