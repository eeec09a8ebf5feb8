"""What a cheater tries. Each attempt returns how it got through, or None when the server refused it as it must.

The attempts change nothing when they are refused, so a cheater's episodes are counted like anybody's.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosed

from app.simulate.client import ConnectionLostError, Page, close_or_abort
from app.simulate.outcome_log import OutcomeLog

MOVES_BETWEEN_ATTEMPTS = 40
"""Moves from one round of all attempts to the next."""


@dataclass(frozen=True)
class CheatContext:
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


Attempt = Callable[[CheatContext], Awaitable[str | None]]


def what_was_granted(answer: httpx.Response) -> str | None:
    """Return what an answer gave away, None when it is a refusal (4xx); an error of the server (5xx) is no refusal."""
    return (
        None
        if 400 <= answer.status_code < 500
        else f"{answer.status_code} for {answer.request.url.path}"
    )


def refused_call(method: str, path: str, body: Any = None) -> Attempt:
    """Return the attempt to make an HTTP call that must be refused; names in braces are filled from the context."""

    async def attempt(context: CheatContext) -> str | None:
        study, other = context.page.study, context.other_session
        if "{other}" in path and other is None:
            return None
        address = path.format(
            session=context.session, episode=context.episode, study=study, other=other
        )
        filled = {
            key: context.episode if value == "{episode}" else value
            for key, value in (body or {}).items()
        }
        return what_was_granted(
            await context.page.ask(method, address, filled if body is not None else None)
        )

    return attempt


async def ask_for_next_early(context: CheatContext) -> str | None:
    """Ask for the next episode while one runs."""
    progress = await context.page.call("next", {})
    came = progress["about"]["frame"]
    same = came["episode"] == context.episode and came["step"] == context.frame["step"]
    return None if same else f"next gave episode {came['episode']} at move {came['step']}"


async def join_again_as_human(context: CheatContext) -> str | None:
    """Join again, this time as a person: it must be the same participant as before, at the same stage."""
    answer = await context.page.ask(
        "POST", f"api/studies/{context.page.study}/join", {"outside_ids": {}, "script": None}
    )
    if answer.is_error:
        return what_was_granted(answer)
    same = answer.json()["session"] == context.session
    return None if same else "joining again made another participant"


async def find_own_episode(path: str, context: CheatContext) -> str | None:
    """Return a sentence when a public answer names the running episode or its session."""
    answer = await context.page.ask("GET", path)
    leaks = context.episode in answer.text or context.session in answer.text
    return f"/{path} names an episode of the study" if leaks and not answer.is_error else None


def absent_from(path: str) -> Attempt:
    """Return the attempt to find the study's episodes in a public answer."""

    async def attempt(context: CheatContext) -> str | None:
        return await find_own_episode(path, context)

    return attempt


async def read_secret(context: CheatContext) -> str | None:
    """Ask for the study's secret."""
    return (
        "the secret is shown while the study is open"
        if (await context.page.call(""))["secret"]
        else None
    )


async def forge_cookie(context: CheatContext) -> str | None:
    """Come with a cookie that the server did not sign."""
    cookie = context.page.cookie or ""
    page = Page(
        context.page.url, context.page.study, ("0" if cookie[:1] != "0" else "1") + cookie[1:]
    )
    try:
        return what_was_granted(await page.ask("GET", f"api/studies/{context.page.study}/me"))
    finally:
        await page.close()


async def open_foreign_socket(path: str, session: str | None, context: CheatContext) -> str | None:
    """Open somebody else's socket: the server must close it before it shows anything of the board."""
    if session is None:
        return None
    try:
        socket = await context.page.connect(f"{path}/{session}")
    except ConnectionLostError:
        return None
    try:
        said = await socket.recv()
        shows = isinstance(said, bytes) or '"grid"' in said
        return f"/{path}/ of somebody else showed {len(said)} bytes" if shows else None
    except ConnectionClosed:
        return None
    finally:
        await close_or_abort(socket)


async def watch_foreign_session(context: CheatContext) -> str | None:
    """Follow somebody else's board."""
    return await open_foreign_socket("ws/sessions", context.other_session, context)


async def watch_foreign_view(context: CheatContext) -> str | None:
    """Look at somebody else's 3-D view."""
    return await open_foreign_socket("viewer", context.other_session, context)


async def watch_foreign_session_as_operator(context: CheatContext) -> str | None:
    """Look at somebody else's board over the operator's socket."""
    return await open_foreign_socket("ws/admin/sessions", context.other_session, context)


ATTEMPTS: dict[str, Attempt] = {
    "another terrain": refused_call("POST", "api/sessions/{session}/episodes", {}),
    "a terrain of its choice": refused_call("POST", "api/sessions/{session}/episodes", {"seed": 7}),
    "next while one runs": ask_for_next_early,
    "giving up a past move": refused_call(
        "POST", "api/studies/{study}/give-up", {"episode": "{episode}", "step": 10**6}
    ),
    "a move over HTTP": refused_call(
        "POST", "api/sessions/{session}/act", {"episode": "{episode}", "step": 0, "action": "east"}
    ),
    "a policy's help": refused_call("POST", "api/sessions/{session}/pace", {"step": True}),
    "a second consent": refused_call(
        "POST", "api/studies/{study}/consent", {"version": "1", "agree": True}
    ),
    "skipping to the end": refused_call("POST", "api/studies/{study}/advance", {"from": "debrief"}),
    "the debrief too early": refused_call("GET", "api/studies/{study}/debrief/0"),
    "its own running episode": refused_call("GET", "api/episodes/{episode}"),
    "the list of episodes": absent_from("api/episodes?limit=500"),
    "the exported episodes": absent_from("api/export/episodes.jsonl"),
    "the exported steps": absent_from("api/export/steps.csv"),
    "the leaderboard": absent_from("api/leaderboard"),
    "somebody else's frame": refused_call("GET", "api/sessions/{other}"),
    "somebody else's path": refused_call("GET", "api/sessions/{other}/history"),
    "somebody else's board": refused_call("GET", "api/sessions/{other}/about"),
    "somebody else's socket": watch_foreign_session,
    "somebody else's view": watch_foreign_view,
    "the secret": read_secret,
    "the operator's figures": refused_call("GET", "api/admin/studies/{study}"),
    "closing the study": refused_call("POST", "api/admin/studies/{study}/close", {}),
    "the operator's socket": watch_foreign_session_as_operator,
    "a forged cookie": forge_cookie,
    "becoming human": join_again_as_human,
}
"""Name -> attempt."""


class Cheater:
    """A player that makes all attempts now and then."""

    def __init__(self, page: Page, log: OutcomeLog) -> None:
        self._page, self._log = page, log

    async def try_all_when_due(
        self, session: str, frame: dict[str, Any], phase: str, other_session: str | None
    ) -> None:
        """Make all attempts after the first move of an episode, and every MOVES_BETWEEN_ATTEMPTS moves from then on."""
        if frame["step"] % MOVES_BETWEEN_ATTEMPTS == 1:
            context = CheatContext(self._page, session, frame, phase, other_session)
            for name, attempt in ATTEMPTS.items():
                self._log.count_attempt(name, await attempt(context))
