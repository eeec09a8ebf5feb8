"""What a description may say of an environment that says nothing of it itself."""

from __future__ import annotations

import inspect
import random
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from humanplay.tasks.gymnasium.codes import ActionCodes, allowed_in
from humanplay.tasks.gymnasium.description import Description, actions_of
from humanplay.tasks.gymnasium.pictures import pixels_of

Env = gymnasium.Env[object, object]
Make = Callable[[int], Env]
Proposals = dict[str, object]
"""Field of a description -> what it may say."""
Picture = NDArray[np.generic]
STATES, MOST_BEFORE = 12, 5
"""From so many states every action is tried, each after so many moves at most."""
MOST_ACTIONS = 10
"""Of more actions none is tried."""
LONGEST_S = 10.0
"""Seconds after which no further state is tried."""
FEWEST, SHARE = 2, 0.7
"""States in which an action moves the marker one way; their share of all in which it moves."""


def proposals_of(description: Description, make: Make) -> Proposals:
    """What empty fields of an environment's description may say.

    Args:
        make: Makes it with a seed.
    """
    with closing(make(0)) as env:
        codes = ActionCodes(description.id, env.action_space)
        actions = actions_of(description, env)
        docstring = type(env.unwrapped).__doc__ or ""
        proposals: Proposals = {"agents_see": _space_in_words(env.observation_space)}
    paragraphs = inspect.cleandoc(docstring).split("\n\n")
    words = next((text for text in paragraphs if not text.startswith("#")), "")
    proposals["instructions"] = " ".join(words.split())[:2000]
    names = codes.names()
    if len(names) <= MOST_ACTIONS and actions == names and not description.keys:
        ways = _directions(description, make, codes)
        if len(ways) > 1:
            proposals["actions"] = [ways.get(code, name) for code, name in enumerate(names)]
    return {
        name: field for name, field in proposals.items() if field and not getattr(description, name)
    }


def _space_in_words(space: gymnasium.Space[object]) -> str:
    """What an agent observes, by its space."""
    match space:
        case spaces.Discrete(n=count, start=start):
            return f"a number from {start} to {start + count - 1}"
        case spaces.Box(shape=(count,)):
            return "a number" if count == 1 else f"{count} numbers"
        case spaces.Box(shape=shape):
            return f"an array of {' x '.join(map(str, shape))} numbers"
        case spaces.MultiDiscrete(shape=(count,)):
            return f"{count} whole numbers"
        case spaces.Dict():
            return f"the fields {', '.join(space)}"
    return str(space)[:200]


def _directions(description: Description, make: Make, codes: ActionCodes) -> dict[int, str]:
    """Action -> the way in which it alone moves what is drawn."""
    votes = [Counter[str]() for _ in range(codes.count)]
    began = time.perf_counter()
    for state in range(STATES):
        if time.perf_counter() - began > LONGEST_S:
            break
        try:
            moves = _moves(description, make, codes, state)
        except Exception:  # an environment of somebody's own may raise anything
            continue
        for code, way in moves.items():
            votes[code][way] += 1
    ways = {}
    for code, counter in enumerate(votes):
        for way, count in counter.most_common(1):
            if count >= max(FEWEST, SHARE * counter.total()):
                ways[code] = way
    claims = Counter(ways.values())
    return {code: way for code, way in ways.items() if claims[way] == 1}


def _moves(description: Description, make: Make, codes: ActionCodes, seed: int) -> dict[int, str]:
    """Action -> the way in which the marker moves from one state, where that is clear."""
    changes: dict[int, NDArray[np.bool_]] = {}
    for code in range(codes.count):
        pictures = _pictures(description, make, codes, seed, code)
        if pictures is None:
            continue
        earlier, later = pictures
        changed = earlier != later
        if changed.ndim == 3:
            changed = changed.any(axis=2)
        if changed.any():
            changes[code] = changed
    if len(changes) < 2:
        return {}
    left = np.logical_and.reduce(list(changes.values()))  # where the marker was, whatever moves it
    if not left.any():
        return {}
    ways = {}
    for code, changed in changes.items():
        if (entered := changed & ~left).any():
            down, right = np.argwhere(entered).mean(axis=0) - np.argwhere(left).mean(axis=0)
            if abs(down) > 2 * abs(right):
                ways[code] = "down" if down > 0 else "up"
            elif abs(right) > 2 * abs(down):
                ways[code] = "right" if right > 0 else "left"
    return ways


def _pictures(
    description: Description, make: Make, codes: ActionCodes, seed: int, last: int
) -> tuple[Picture, Picture] | None:
    """The pictures before and after a last move, which follows allowed ones.

    None if the episode ends before it, or it is not allowed there.
    """
    dice = random.Random(seed)
    with closing(make(seed)) as env:
        observation, info = description.begin(env, seed)
        for _ in range(seed % (MOST_BEFORE + 1)):
            code = dice.choice(_allowed(codes, env, observation, info))
            observation, _, terminated, truncated, info = env.step(codes.own(code))
            if terminated or truncated:
                return None
        if last not in _allowed(codes, env, observation, info):
            return None
        earlier = _drawn(env.render())
        env.step(codes.own(last))
        later = _drawn(env.render())
    return (earlier, later) if earlier.shape == later.shape else None


def _allowed(
    codes: ActionCodes, env: Env, observation: object, info: Mapping[str, object]
) -> Sequence[int]:
    """The actions that an environment allows."""
    allowed = allowed_in(codes.mask_of(env, observation, info))
    return range(codes.count) if allowed is None else allowed


def _drawn(picture: object) -> Picture:
    """A picture, or a text as its characters in rows."""
    if not isinstance(picture, str):
        return pixels_of(picture)
    rows = picture.splitlines()
    width = max(map(len, rows), default=0)
    return np.array([list(row.ljust(width)) for row in rows])
