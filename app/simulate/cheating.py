"""What a cheater tries. Each attempt says how it got through, or None when the server refused it as it must.

The attempts change nothing when they are refused, so a cheater's episodes are counted like anybody's.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosed

from app.simulate.client import ConnectionLostError, Page, hang_up
from app.simulate.outcome_log import Tally

EVERY = 40
"""Moves between two rounds of attempts."""


@dataclass(frozen=True)
class Heist:
    """What a cheater knows at the moment: its page, its running episode, and the session and episode of somebody else."""

    page: Page
    session: str
    frame: dict[str, Any]
    phase: str
    other_session: str | None

    @property
    def episode(self) -> str:
        """The running episode."""
        return str(self.frame["episode"])


Attempt = Callable[[Heist], Awaitable[str | None]]


def granted(answer: httpx.Response) -> str | None:
    """Return what an answer gave away, None when it is a refusal (4xx); an error of the server (5xx) is no refusal."""
    return None if 400 <= answer.status_code < 500 else f"{answer.status_code} for {answer.request.url.path}"


def refused(method: str, path: str, body: Any = None) -> Attempt:
    """Return the attempt to make a call that must be refused; names in braces are the heist's."""

    async def attempt(heist: Heist) -> str | None:
        known = {"session": heist.session, "episode": heist.episode, "study": heist.page.study, "other": heist.other_session}
        if "{other}" in path and heist.other_session is None:
            return None
        filled = {key: heist.episode if value == "{episode}" else value for key, value in (body or {}).items()}
        return granted(await heist.page.ask(method, path.format(**known), filled if body is not None else None))

    return attempt


async def begin_again(heist: Heist) -> str | None:
    """Ask for the next episode while one runs."""
    where = await heist.page.call("next", {})
    came = where["about"]["frame"]
    same = came["episode"] == heist.episode and came["step"] == heist.frame["step"]
    return None if same else f"next gave episode {came['episode']} at move {came['step']}"


async def become_human(heist: Heist) -> str | None:
    """Join again, this time as a person: it must be the same participant as before, where it stood."""
    answer = await heist.page.ask("POST", f"api/studies/{heist.page.study}/join", {"outside_ids": {}, "script": None})
    if answer.is_error:
        return granted(answer)
    same = answer.json()["session"] == heist.session
    return None if same else "joining again made another participant"


async def find_itself_in(path: str, heist: Heist) -> str | None:
    """Return a sentence when a public answer names the running episode or its session."""
    answer = await heist.page.ask("GET", path)
    leaks = heist.episode in answer.text or heist.session in answer.text
    return f"/{path} names an episode of the study" if leaks and not answer.is_error else None


def not_in(path: str) -> Attempt:
    """Return the attempt to find the study's episodes in a public answer."""

    async def attempt(heist: Heist) -> str | None:
        return await find_itself_in(path, heist)

    return attempt


async def read_secret(heist: Heist) -> str | None:
    """Ask for the study's secret."""
    return "the secret is shown while the study is open" if (await heist.page.call(""))["secret"] else None


async def forge_cookie(heist: Heist) -> str | None:
    """Come with a cookie that the server did not sign."""
    cookie = heist.page.cookie or ""
    page = Page(heist.page.url, heist.page.study, ("0" if cookie[:1] != "0" else "1") + cookie[1:])
    try:
        return granted(await page.ask("GET", f"api/studies/{heist.page.study}/me"))
    finally:
        await page.close()


async def peep(path: str, session: str | None, heist: Heist) -> str | None:
    """Open somebody else's socket: it must be closed before it says anything of the board."""
    if session is None:
        return None
    try:
        socket = await heist.page.dial(f"{path}/{session}")
    except ConnectionLostError:
        return None
    try:
        said = await socket.recv()
        shows = isinstance(said, bytes) or '"grid"' in said
        return f"/{path}/ of somebody else showed {len(said)} bytes" if shows else None
    except ConnectionClosed:
        return None
    finally:
        await hang_up(socket)


async def peep_at_play(heist: Heist) -> str | None:
    """Follow somebody else's board."""
    return await peep("ws/sessions", heist.other_session, heist)


async def peep_at_view(heist: Heist) -> str | None:
    """Look at somebody else's 3-D view."""
    return await peep("viewer", heist.other_session, heist)


async def watch_as_operator(heist: Heist) -> str | None:
    """Look at somebody else's board by the operator's way."""
    return await peep("ws/admin/sessions", heist.other_session, heist)


ATTEMPTS: dict[str, Attempt] = {
    "another terrain": refused("POST", "api/sessions/{session}/episodes", {}),
    "a terrain of its choice": refused("POST", "api/sessions/{session}/episodes", {"seed": 7}),
    "next while one runs": begin_again,
    "giving up a past move": refused("POST", "api/studies/{study}/give-up", {"episode": "{episode}", "step": 10**6}),
    "a move over HTTP": refused("POST", "api/sessions/{session}/act", {"episode": "{episode}", "step": 0, "action": "east"}),
    "a policy's help": refused("POST", "api/sessions/{session}/pace", {"step": True}),
    "a second consent": refused("POST", "api/studies/{study}/consent", {"version": "1", "agree": True}),
    "skipping to the end": refused("POST", "api/studies/{study}/advance", {"from": "debrief"}),
    "the debrief too early": refused("GET", "api/studies/{study}/debrief/0"),
    "its own running episode": refused("GET", "api/episodes/{episode}"),
    "the list of episodes": not_in("api/episodes?limit=500"),
    "the exported episodes": not_in("api/export/episodes.jsonl"),
    "the exported steps": not_in("api/export/steps.csv"),
    "the leaderboard": not_in("api/leaderboard"),
    "somebody else's frame": refused("GET", "api/sessions/{other}"),
    "somebody else's path": refused("GET", "api/sessions/{other}/history"),
    "somebody else's board": refused("GET", "api/sessions/{other}/about"),
    "somebody else's socket": peep_at_play,
    "somebody else's view": peep_at_view,
    "the secret": read_secret,
    "the operator's figures": refused("GET", "api/admin/studies/{study}"),
    "closing the study": refused("POST", "api/admin/studies/{study}/close", {}),
    "the operator's socket": watch_as_operator,
    "a forged cookie": forge_cookie,
    "becoming human": become_human,
}
"""By name."""


class Cheats:
    """Makes the round of all attempts now and then."""

    def __init__(self, page: Page, tally: Tally) -> None:
        self._page, self._tally = page, tally

    async def maybe(self, session: str, frame: dict[str, Any], phase: str, other_session: str | None) -> None:
        """Try everything, if it is time for that: at the start of an episode, and every EVERY moves."""
        if frame["step"] % EVERY == 1:
            heist = Heist(self._page, session, frame, phase, other_session)
            for name, attempt in ATTEMPTS.items():
                self._tally.tried(name, await attempt(heist))
