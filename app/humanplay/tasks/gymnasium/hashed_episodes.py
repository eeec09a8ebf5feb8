"""Episodes of an environment, hashed step by step in a process of their own.

`python -m humanplay.tasks.gymnasium.hashed_episodes` reads a `Request` as JSON from stdin, plays its
episodes, and prints a line of JSON for each.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import random
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import gymnasium
import numpy as np
from numpy.typing import NDArray

from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.codes import ActionCodes, Mask
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig, own_config
from humanplay.tasks.gymnasium.pictures import pixels_of
from humanplay.tasks.gymnasium.proposals import proposals_of
from humanplay.tasks.gymnasium.values import bytes_of, finite, reward_of
from humanplay.tasks.policies import Choose, chooser

Env = gymnasium.Env[object, object]

FIRST_RUN = "first run"
"""The variant that the others are compared with."""
AFTER_OTHERS = "after other episodes"
"""Two other episodes are played first, then the starts in reverse order."""
WITHOUT_RENDERING = "without rendering"
USED = "used environment"
"""One environment, which has played other episodes before, plays all of them."""
SEEDED_GLOBALS = "seeded globals"
"""The random numbers of Python and NumPy are seeded before each episode."""
PROPOSALS = "proposals"
"""Nothing is played: what a file may say of the environment is printed instead."""

PARTS = ("action", "observation", "reward", "end", "allowed actions", "picture")
"""What is hashed at each step, in this order."""
SEEDS_APART = 10_000
"""Start k plays its episodes on seeds 10,000 k, 10,000 k + 1, and so on."""

STICKINESS = 0.75
"""How likely the sticky chooser repeats its last action."""
PICTURES_PER_SIZE = 100
"""One picture in so many is compressed to measure its size, which takes as long as drawing it."""
LINE_MARK = "episode: "
"""Begins each line that is printed here: an environment may print lines of its own."""


@dataclass(frozen=True)
class Request:
    """What a process plays.

    Attributes:
        variant: How the run differs from the first one.
        config: As `Configuration.to_dict` has it.
        seeds: How many starts are played, each on seeds of its own (`SEEDS_APART`).
        steps: Moves for each start. If an episode ends before, another one begins on the next
            seed.
        rule: MODULE:FUNCTION that chooses the actions of every third start, if any.
    """

    task: str
    variant: str
    config: Mapping[str, object] = field(default_factory=dict)
    seeds: int = 1
    steps: int = 0
    rule: str | None = None


@dataclass(frozen=True)
class HashedEpisode:
    """The hashes of an episode and what it took.

    Attributes:
        first_seed: Seed of the first episode of its start.
        seed: What `reset` was called with.
        hashes: For each step, from 0 for what `reset` returned, a hash of each of PARTS. None for a
            picture that was not drawn.
        step_ms, picture_ms: Processor time of each step, and of each picture.
        picture_bytes: Sizes of some pictures as PNG. Empty for text, and if none was measured.
        picture: Rows and columns of the last picture, in pixels or characters, if any was drawn.
        ended: Whether the environment ended it, rather than the number of moves.
        moves_s: Seconds of its moves.
        restart_s: Its other seconds: making and resetting the environment, and closing it.
    """

    first_seed: int
    seed: int
    hashes: Sequence[Sequence[str | None]]
    step_ms: Sequence[float] = ()
    picture_ms: Sequence[float] = ()
    picture_bytes: Sequence[int] = ()
    picture: Sequence[int] | None = None
    ended: bool = False
    moves_s: float = 0.0
    restart_s: float = 0.0


def main(request: Request) -> None:
    """Print what a request asks for."""
    config = own_config(environment_of(request.task).configuration(request.config))
    if request.variant == PROPOSALS:
        print(LINE_MARK + json.dumps(proposals_of(config.description, config.make)), flush=True)
        return
    for episode in episodes_of(request, config):
        print(LINE_MARK + json.dumps(asdict(episode)), flush=True)


def episodes_of(request: Request, config: GymnasiumConfig) -> Iterator[HashedEpisode]:
    """Play the episodes of a request, one after the other."""
    starts = list(range(request.seeds))
    used_env = config.make(0) if request.variant == USED else None
    if request.variant in (AFTER_OTHERS, USED):
        _play_others(config, used_env)
        starts.reverse()
    for start in starts:
        yield from _episodes_of_start(request, config, start, used_env)


def _play_others(config: GymnasiumConfig, used_env: Env | None) -> None:
    """Play two episodes that nobody compares, on seeds that no start reaches."""
    for seed in (10**8, 10**8 + 1):
        env = used_env or config.make(seed)
        codes = ActionCodes(config.level, env.action_space)
        _Episode(env, config, codes, has_pictures=True).play(
            seed, _chooser("uniform", seed, codes), 50
        )
        if used_env is None:
            env.close()


def _episodes_of_start(
    request: Request, config: GymnasiumConfig, start: int, used_env: Env | None
) -> Iterator[HashedEpisode]:
    """Play the episodes of one start until they have as many moves as were asked for."""
    # the starts take turns with the choosers
    choosers = ["uniform", "sticky", *([request.rule] if request.rule else [])]
    chooser_name = choosers[start % len(choosers)]
    first_seed, moves_left = SEEDS_APART * start, request.steps
    for seed in itertools.count(first_seed):
        started_s = time.perf_counter()
        env = used_env or config.make(seed)
        codes = ActionCodes(config.level, env.action_space)
        choose = _chooser(chooser_name, seed, codes)
        if request.variant == SEEDED_GLOBALS:
            random.seed(seed)
            np.random.seed(seed)
        has_pictures = request.variant != WITHOUT_RENDERING
        played = _Episode(env, config, codes, has_pictures, request.variant == FIRST_RUN)
        episode = played.play(seed, choose, moves_left)
        if used_env is None:
            env.close()
        restart_s = time.perf_counter() - started_s - episode.moves_s
        yield replace(episode, first_seed=first_seed, restart_s=restart_s)
        # an episode that ends at once counts as a move, so that this ends too
        moves_left -= max(1, len(episode.hashes) - 1)
        if moves_left <= 0:
            return


def _chooser(name: str, seed: int, codes: ActionCodes) -> Choose:
    """Chooses among the allowed actions; no environment draws from its random numbers."""
    if name not in ("uniform", "sticky"):
        return chooser(name, seed, codes.of_own)
    dice = random.Random(seed)
    stickiness = STICKINESS if name == "sticky" else 0.0
    last: int | None = None

    def choose(observation: object, mask: Mask) -> int:
        nonlocal last
        if last is None or not mask[last] or dice.random() >= stickiness:
            last = int(dice.choice(np.flatnonzero(mask).tolist()))
        return last

    return choose


class _Episode:
    """An episode that is about to be played.

    Args:
        has_pictures: Whether it is rendered after each step.
        measures_pictures: Whether sizes of pictures as PNG are measured too.
    """

    def __init__(
        self,
        env: Env,
        config: GymnasiumConfig,
        codes: ActionCodes,
        has_pictures: bool,
        measures_pictures: bool = False,
    ) -> None:
        self._env, self._codes, self._description = env, codes, config.description
        self._has_pictures, self._measures_pictures = has_pictures, measures_pictures
        self._picture: tuple[int, int] | None = None
        self._picture_ms: list[float] = []
        self._picture_bytes: list[int] = []

    def play(self, seed: int, choose: Choose, steps: int) -> HashedEpisode:
        """Play and hash at most so many steps.

        Raises:
            ValueError: If a reward, or the score that `info` holds, is not finite.
        """
        env, codes, description = self._env, self._codes, self._description
        hashes: list[list[str | None]] = []
        step_ms: list[float] = []
        observation, info = description.begin(env, seed)
        action, ends = -1, (False, False)
        reward: object = 0.0
        started_s = time.perf_counter()
        while True:
            # 1. hash the state
            picture = self._draw() if self._has_pictures else None
            is_last = any(ends) or len(hashes) >= steps
            mask = None if is_last else codes.mask_of(env, observation, info)
            hashes.append(
                [
                    str(action),
                    _hash(bytes_of(observation)),
                    _hash(repr(finite("reward", reward_of(description.id, reward))).encode()),
                    _hash(repr(ends).encode()),
                    "" if mask is None else _hash(bytes_of(mask)),
                    picture,
                ]
            )
            if is_last:
                break
            # 2. choose and step
            action = choose(observation, np.ones(codes.count, bool) if mask is None else mask)
            cpu_started_s = time.process_time()
            observation, reward, terminated, truncated, info = env.step(codes.own(action))
            step_ms.append(1000 * (time.process_time() - cpu_started_s))
            ends = bool(terminated), bool(truncated)
            # 3. check the score, as a board does
            if description.score != "return":
                finite(description.score, info.get(description.score.removeprefix("info."), 0.0))
        return HashedEpisode(
            first_seed=seed,
            seed=seed,
            hashes=hashes,
            step_ms=step_ms,
            picture_ms=self._picture_ms,
            picture_bytes=self._picture_bytes,
            picture=self._picture,
            ended=any(ends),
            moves_s=time.perf_counter() - started_s,
        )

    def _draw(self) -> str:
        """Render the state, note what that costs, and hash the picture."""
        cpu_started_s = time.process_time()
        rendered: object = self._env.render()
        self._picture_ms.append(1000 * (time.process_time() - cpu_started_s))
        if isinstance(rendered, str):
            lines = rendered.splitlines()
            self._picture = len(lines), max(map(len, lines), default=0)
            return _hash(rendered.encode())
        pixels = pixels_of(rendered)
        rows, columns, *_ = pixels.shape
        self._picture = rows, columns
        if self._measures_pictures and len(self._picture_ms) % PICTURES_PER_SIZE == 1:
            self._picture_bytes.append(_png_size(pixels))
        return _hash(pixels.data, repr(pixels.shape).encode())


def _hash(content: bytes | memoryview, shape: bytes = b"") -> str:
    # processors have instructions for SHA-256, so it takes half the time of a shorter hash
    digest = hashlib.sha256(content)
    digest.update(shape)
    return digest.hexdigest()[:12]


def _png_size(pixels: NDArray[np.uint8]) -> int:
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.tell()


if __name__ == "__main__":
    main(Request(**json.load(sys.stdin)))
