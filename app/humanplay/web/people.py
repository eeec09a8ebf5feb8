"""The people's board, by the names that people chose; and one's own name.

A name is no account: it belongs to the player's cookie, and nothing of a study knows that cookie.
"""

from __future__ import annotations

import asyncio
import re
import unicodedata
from functools import partial
from typing import Literal

from fastapi import APIRouter, HTTPException, Request, Response
from pydantic import Field

from humanplay.board.messages import Message
from humanplay.db import names
from humanplay.results.people import WEEK_MS, PeopleTable
from humanplay.web.access import player_of, remember_player, services_of
from humanplay.web.answers.people import OwnName, People
from humanplay.web.protection import has_own_origin

router = APIRouter(prefix="/api", tags=["results"])

Period = Literal["week", "all"]

SHORTEST, LONGEST = 2, 20
"""Letters of a name."""

_LOOKS_LIKE = """0o 1i 3e 4a 5s 7t @a $s !i |i ıi аa вb еe ѕs іi јj кk мm нh оo рp сc тt уy хx гr
    αa βb εe ηn ιi κk νv οo ρp τt υy χx"""
"""Characters, and the letter of the Latin script that each looks like."""
_SAME = {ord(each[0]): each[1] for each in _LOOKS_LIKE.split()}
_SAME |= dict.fromkeys(map(ord, "'-_. "), "")
_ANYWHERE = """arschloch asshole bastard bitch cunt faggot fotze fuck hitler hurensohn mierda nazi nigga nigger penis porn
    putain retard schwuchtel shit slut vagina wank whore wichser"""
_WHOLE = "anus arsch ass cock coon cum dick fag heil hure kike kkk merde nutte paki puta rape salope spic tit twat"
_RESERVED = """administrator admin moderator operator you somebody nobody anonymous humanplay marsexplorer people
    human script policy expert nearest greedy random tidy ppo"""


NOTHING_PLAYED = "play a terrain first: a name belongs to what was played in this browser"


class NewName(Message):
    """The name by which the player wants to be shown."""

    name: str = Field(max_length=100, examples=["Ada"])


def likeness(name: str) -> str:
    """What a name looks like: equal for names that readers confuse."""
    letters = unicodedata.normalize("NFKD", name.casefold())
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return plain.translate(_SAME).replace("i", "l").replace("rn", "m").replace("vv", "w")


def cleaned(text: str) -> str:
    """A name as it is shown; ValueError if it cannot be shown."""
    name = " ".join(word for word in unicodedata.normalize("NFKC", text).split(" ") if word)
    if not SHORTEST <= len(name) <= LONGEST:
        raise ValueError(f"a name has {SHORTEST} to {LONGEST} characters, this one {len(name)}")
    wrong = {sign for sign in name if not (sign.isalpha() or sign.isdecimal() or sign in " -_.'")}
    if wrong or not any(sign.isalpha() for sign in name):
        raise ValueError("a name is made of letters, with digits, spaces, and - _ . ' if you like")
    scripts = {unicodedata.name(sign, "?").split(" ")[0] for sign in name if sign.isalpha()}
    others = scripts - {"CJK", "HIRAGANA", "KATAKANA", "HANGUL"}
    if len(others) > 1 or ("LATIN" in scripts and len(scripts) > 1):
        raise ValueError("a name is written in one script: letters of two can look alike")
    looks = likeness(name)
    words = {looks, *map(likeness, re.split(r"[ ._-]", name))}
    if looks in map(likeness, _RESERVED.split()):
        raise ValueError("this name stands for something else here: choose another")
    is_bad = any(likeness(word) in looks for word in _ANYWHERE.split())
    if is_bad or words & set(map(likeness, _WHOLE.split())):
        raise ValueError("this name may offend somebody: choose another")
    return name


@router.get("/people", response_model=People, summary="People by their distance from Expert")
async def get_people(request: Request, period: Period = "all") -> PeopleTable:
    """Return who plays ranked terrains like the daily, nearest to Expert first.

    All ranked terrains of the period count that Expert finishes, `most_behind` moves at most each;
    one that was not finished, or with moves that fit no key, counts as many. From `fewest` on a
    person has a place, by the worse end of the interval. `comparing` terrains wait for Expert's own run on them.
    404 where the environment has no leaderboard.
    """
    services, player_id = services_of(request), player_of(request)
    if (board := services.people) is None:
        raise HTTPException(404, f"{services.lobby.task.about.title} has no leaderboard")
    since_ms = 0 if period == "all" else services.lobby.sources.clock_ms() - WEEK_MS
    return await asyncio.to_thread(board.table, player_id, since_ms)


@router.put("/me/name", response_model=OwnName, summary="Choose the name by which you are shown")
async def set_name(request: Request, response: Response, wanted: NewName) -> dict[str, object]:
    """Choose a name, or another one.

    422 for one that cannot be shown; 409 for a taken one, and before the first terrain.

    A server that asks for names takes one before it too.
    """
    services = services_of(request)
    store, sources = services.store, services.lobby.sources
    player_id = _new_player(request) if services.asks_name else _own_player(request)
    change = names.introduce if services.asks_name else names.set_name
    try:
        name = cleaned(wanted.name)
        if not await store.change(change, player_id, name, likeness(name), sources.clock_ms()):
            raise HTTPException(409, NOTHING_PLAYED)
    except names.NameTakenError as error:
        raise HTTPException(409, str(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    if services.asks_name:
        remember_player(response, request, player_id)
    return {**await store.read(partial(names.own, store, player_id))}


@router.delete("/me/name", response_model=OwnName, summary="Be shown no more")
async def remove_name(request: Request) -> dict[str, object]:
    """Remove your name; what was played stays, without one."""
    player_id, store = _own_player(request), services_of(request).store
    await store.change(names.remove_name, player_id)
    return {**await store.read(partial(names.own, store, player_id))}


def _new_player(request: Request) -> str:
    """The player who asks, or a new one; 403 unless a page of this server asks."""
    if not has_own_origin(request):
        raise HTTPException(403, "a name is chosen on this server's page")
    return player_of(request) or services_of(request).lobby.sources.player_id()


def _own_player(request: Request) -> str:
    """The player who asks; 403 unless our page asks, 409 without a cookie."""
    if not has_own_origin(request):
        raise HTTPException(403, "a name is chosen on this server's page /me")
    if (player_id := player_of(request)) is None:
        raise HTTPException(409, NOTHING_PLAYED)
    return player_id
