"""Whether an environment follows from its seed and its actions: the same episodes in fresh processes, compared step by step.

`python -m humanplay.tasks.gymnasium.doctor` plays what a JSON request on stdin asks for. It prints a JSON
line for each episode.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from humanplay.task import counted
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.codes import ActionCodes, Mask
from humanplay.tasks.gymnasium.configuration import own_config
from humanplay.tasks.gymnasium.description import Description, described
from humanplay.tasks.gymnasium.pictures import pixels_of
from humanplay.tasks.gymnasium.proposals import Proposals, proposals_of
from humanplay.tasks.gymnasium.values import bytes_of, finite, reward_of
from humanplay.tasks.policies import Choose, chooser
from humanplay.tasks.processes import variables as fixed_variables

Progress = Callable[[int, int], None]

PARTS = ("action", "observation", "reward", "end", "allowed actions", "picture")
"""What is compared at each step, in this order. Actions differ only where a rule does."""
GLOBAL = "random numbers of Python or numpy that the seed of reset does not reach"
CAUSES: Mapping[str, str] = {
    "fresh process": f"{GLOBAL}, the clock, sets of objects ordered by address, files on disk",
    "hash seed": "sets of strings, iterated in the order of their hashes",
    "elsewhere": "the clock, the time zone, files of the working folder",
    "after other episodes": "a counter kept on the class, a state of the module, a cache",
    "without rendering": "a render that draws random numbers or changes the state",
    "used environment": "a state that reset leaves as it was",
}
"""Variant -> the usual causes of a difference from the first run, in the order in which a difference is blamed on one."""
FIRST = "first"
"""The variant that the others are compared with."""
GLOBALS = "seeded globals"
"""The variant that tells causes apart: random numbers of Python and numpy are seeded before each episode."""
PROPOSALS = "proposals"
"""The request for what its file may say; nothing is compared."""
TOLERATED = "used environment"
"""The variant that does not count: the playground makes a fresh environment for each episode."""
ENVIRON = {"TZ": "AAA0"}
RUNS: Mapping[str, Sequence[Mapping[str, str]]] = {name: [{}] for name in CAUSES} | {
    # two short sets have the same order by chance under half of all pairs of seeds
    "hash seed": [{"PYTHONHASHSEED": seed} for seed in ("77", "1", "2", "3")],
    "elsewhere": [{"TZ": "BBB-14"}],
}
"""Variant -> the variables of each of its runs."""
PROBED = 20
"""Moves by which the examination's time is estimated; each seed has at least so many."""
SEEDS_APART = 10_000
"""Between the first episodes of two seeds: the episodes after a first one have the seeds between."""
STICKY = 0.75
TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class Difference:
    """Where a variant first differs from the first run.

    seed   of the episode: what its reset was given
    step   0 is what reset returned
    part   one of PARTS
    cause  the likely one, if further runs told it from the others; else empty
    """

    variant: str
    seed: int
    step: int
    part: str
    cause: str = ""

    def __str__(self) -> str:
        where = f"seed {self.seed}, step {self.step} ({self.variant})"
        causes = f"usual causes: {CAUSES[self.variant]}"
        return f"{self.part} differs at {where}; {self.cause or causes}"


@dataclass(frozen=True)
class Examination:
    """What was found.

    steps         moves that were compared under each variant, of all seeds
    differences   the first difference of each variant that has one and counts
    used          that of a used environment after reset, which does not count
    step_ms       median processor time of a step; picture_ms that of a picture
    picture       its rows and columns, in pixels, of text in characters; picture_bytes the median size of its PNG, 0 for text
    keys          action -> its keys
    """

    task: str
    steps: int
    differences: tuple[Difference, ...]
    used: Difference | None
    step_ms: float
    picture_ms: float
    picture: tuple[int, int]
    picture_bytes: int
    keys: Mapping[str, tuple[str, ...]]

    @property
    def verdict(self) -> str:
        """Return the verdict in a sentence."""
        title = environment_of(self.task).about.title
        if self.differences:
            return f"{title} does not follow from seed and actions: {self.differences[0]}"
        return f"{title}: no difference in {counted(self.steps, 'step')}"

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON values."""
        return {"verdict": self.verdict, "exact": not self.differences, **asdict(self)}


def examine(
    task: str,
    seeds: int = 5,
    steps: int = 2000,
    progress: Progress | None = None,
    *,
    config: Mapping[str, Any] | None = None,
    rule: str | None = None,
    limit_s: float | None = None,
    shortened: Callable[[float, int], object] = lambda seconds, steps: None,
) -> Examination:
    """Play the same episodes in ten processes and compare hashes; ValueError for what cannot be made, played or drawn.

    steps     moves for each seed; where an episode of seed n ends, the next begins on n + 1
    progress  called with (processes done, of how many)
    config    what `GymnasiumEnvironment.configuration` takes
    rule      module:function, which returns an action for an observation; uniform and sticky actions take turns with it
    limit_s   seconds from which fewer moves are played, `PROBED` for each seed at least
    shortened  called then with the seconds that the whole would take, and the moves for each seed
    """
    environment = environment_of(task)
    settings = environment.configuration(config or {}).to_dict()
    advance = progress or (lambda done, total: None)
    runs = [(variant, variables) for variant in CAUSES for variables in RUNS[variant]]
    total, workers = len(runs) + 1, max(1, min(4, os.cpu_count() or 1))
    request = {"task": task, "config": settings, "seeds": seeds, "rule": rule, "steps": steps}
    with tempfile.TemporaryDirectory() as here, tempfile.TemporaryDirectory() as there:
        if limit_s is not None and steps > PROBED:
            # the first run, the others side by side, and those that look for a cause
            turns = 1 + math.ceil((total - 1) / workers) + 4 / min(2, workers)
            fixed_s, step_s = _probed({**request, "variant": FIRST}, here)
            whole_s = turns * (fixed_s + step_s * steps)
            if whole_s > limit_s:
                steps = min(steps, max(PROBED, int((limit_s / turns - fixed_s) / step_s)))
                request["steps"] = steps
                shortened(whole_s, steps)
        first = _play({**request, "variant": FIRST}, here, {})
        advance(1, total)

        def compare(run: tuple[str, Mapping[str, str]]) -> Difference | None:
            variant, variables = run
            folder = there if variant == "elsewhere" else here
            return _difference(
                variant, first, _play({**request, "variant": variant}, folder, variables)
            )

        with ThreadPoolExecutor(workers) as threads:
            differences = []
            for done, difference in enumerate(threads.map(compare, runs), 2):
                differences.append(difference)
                advance(done, total)
        first_of = {it.variant: it for it in reversed(differences) if it is not None}
        if "fresh process" in first_of:
            cause = _cause_of(first_of["fresh process"], request, here)
            first_of["fresh process"] = replace(first_of["fresh process"], cause=cause)
    costs = [episode["costs"] for episode in first]
    rows, columns = first[0]["picture"]
    return Examination(
        task, sum(len(episode["hashes"]) - 1 for episode in first),
        tuple(first_of[name] for name in CAUSES if name in first_of and name != TOLERATED),
        first_of.get(TOLERATED),
        _median(ms for each in costs for ms in each["step"]),
        _median(ms for each in costs for ms in each["picture"]),
        (rows, columns), int(_median(size for each in costs for size in each["bytes"])), environment.keys,
    )  # fmt: skip


def _probed(request: Mapping[str, Any], folder: str) -> tuple[float, float]:
    """Seconds of a run beside its moves, and of one move of every seed.

    They are measured over `PROBED` moves. A move has its share of the beginnings of episodes, as many as ended by themselves.
    """
    began = time.perf_counter()
    episodes = _play({**request, "seeds": 1, "steps": PROBED}, folder, {})
    whole_s = time.perf_counter() - began
    begin_s = statistics.median(episode["seconds"][0] for episode in episodes)
    moves_s = sum(episode["seconds"][1] for episode in episodes)
    ended = sum(episode["ended"] for episode in episodes)
    start_s = whole_s - moves_s - len(episodes) * begin_s
    step_s = (moves_s + ended * begin_s) / PROBED
    return start_s + request["seeds"] * begin_s, request["seeds"] * step_s


def _cause_of(difference: Difference, request: Mapping[str, object], folder: str) -> str:
    """The likely cause of a difference, by what mends it; empty if nothing does."""
    brief = {**request, "seeds": difference.seed // SEEDS_APART + 1}

    def is_mended(**changes: object) -> bool:
        try:
            with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as threads:
                asked = {**brief, **changes}
                one, two = threads.map(lambda _: _play(asked, folder, {}), range(2))
        except ValueError:  # it takes no such argument
            return False
        return _difference("fresh process", one, two) is None

    description = described(str(request["task"]).partition(":")[2])
    if description.seeding != "kwarg":
        by_keyword = description.model_copy(update={"seeding": "kwarg"})
        if is_mended(task=f"gymnasium:{by_keyword.told}", variant=FIRST):
            return (
                'it heeds the seed of `make` alone, not that of `reset`: write `seeding = "kwarg"` '
                "into its file (`humanplay doctor ENV --toml`)"
            )
    return f"likely cause: {GLOBAL}" if is_mended(variant=GLOBALS) else ""


def _median(values: Iterator[float]) -> float:
    return round(statistics.median([*values] or [0.0]), 4)


def _play(
    request: Mapping[str, Any], folder: str, variables: Mapping[str, str]
) -> list[dict[str, Any]]:
    """Return what a fresh process in a folder played; ValueError with what it says where it cannot."""
    environ = {**fixed_variables(), **ENVIRON, **variables}
    if "HOME" in os.environ:
        environ["HOME"] = os.environ["HOME"]
    command = [sys.executable, "-m", "humanplay.tasks.gymnasium.doctor"]
    try:
        done = subprocess.run(
            command, input=json.dumps(request), env=environ, cwd=folder, capture_output=True, text=True,
            timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        said = f"{request['task']} took over {TIMEOUT_S:.0f} s: ask for fewer steps"
        raise ValueError(said) from error
    if done.returncode:
        said = (done.stderr.strip().splitlines() or [f"it ended with {done.returncode}"])[-1]
        said = f"{request['task']} cannot be examined: {said}"
        raise ValueError(f"{said}; play it by its own package first")
    lines = [line.removeprefix(MARK) for line in done.stdout.splitlines() if line.startswith(MARK)]
    return [json.loads(line) for line in lines]


def _difference(
    variant: str, first: Sequence[Mapping[str, Any]], other: Sequence[Mapping[str, Any]]
) -> Difference | None:
    """Return where the episodes of a variant first differ, in the order of the first run."""
    again = {each["seed"]: each["hashes"] for each in other}
    for each in first:
        theirs = again.get(each["seed"], [])
        for step, mine in enumerate(each["hashes"]):
            if step >= len(theirs):
                return Difference(variant, each["seed"], step, "end")
            for part, one, two in zip(PARTS, mine, theirs[step], strict=True):
                if one != two and None not in (one, two):
                    return Difference(variant, each["seed"], step, part)
    return None


def proposals(task: str) -> Proposals:
    """What its file may say of an environment where it says nothing yet."""
    with tempfile.TemporaryDirectory() as folder:
        (fields,) = _play({"task": task, "variant": PROPOSALS}, folder, {})
        return fields


MARK = "doctor: "
"""Begins the lines of the child; an environment may print others."""


def _child(request: Mapping[str, Any]) -> None:
    """Play a request's seeds and print each episode."""
    environment, variant = environment_of(request["task"]), request["variant"]
    config = own_config(environment.configuration(request.get("config", {})))
    if variant == PROPOSALS:
        print(MARK + json.dumps(proposals_of(config.description, config.make)), flush=True)
        return
    described = config.description
    make, seeds = config.make, list(range(request["seeds"]))
    used = make(0) if variant == TOLERATED else None
    if variant == "after other episodes" or used is not None:
        for seed in (10**8, 10**8 + 1):
            env = used or make(seed)
            codes = ActionCodes(config.level, env.action_space)
            _episode(env, codes, seed, _chooser("uniform", seed, codes), 50, True, described)
            if used is None:
                env.close()
        seeds.reverse()
    choosers = ["uniform", "sticky", *([request["rule"]] if request["rule"] else [])]
    for seed in seeds:
        left, episode = request["steps"], 0
        while episode == 0 or left > 0:
            episode_seed = SEEDS_APART * seed + episode
            began_s = time.perf_counter()
            env = used or make(episode_seed)
            codes = ActionCodes(config.level, env.action_space)
            choose = _chooser(choosers[seed % len(choosers)], episode_seed, codes)
            renders = variant != "without rendering"
            if variant == GLOBALS:
                random.seed(episode_seed)
                np.random.seed(episode_seed)  # what an environment may draw from
            is_first = variant == FIRST
            played = _episode(env, codes, episode_seed, choose, left, renders, described, is_first)
            if used is None:
                env.close()
            moves_s = played.pop("moves_s")
            played["seconds"] = time.perf_counter() - began_s - moves_s, moves_s
            print(MARK + json.dumps({"seed": episode_seed, **played}), flush=True)
            left, episode = left - max(1, len(played["hashes"]) - 1), episode + 1


def _chooser(name: str, seed: int, codes: ActionCodes) -> Choose:
    """Return what chooses an episode's actions from those that are allowed, with random numbers of its own."""
    if name not in ("uniform", "sticky"):
        return chooser(name, seed, codes.of_own)
    dice, last, repeated = random.Random(seed), [-1], STICKY if name == "sticky" else 0.0

    def choose(observation: Any, mask: Mask) -> int:
        if last[0] < 0 or not mask[last[0]] or dice.random() >= repeated:
            last[0] = dice.choice(np.flatnonzero(mask).tolist())
        return last[0]

    return choose


def _episode(
    env: Any,
    codes: ActionCodes,
    seed: int,
    choose: Choose,
    steps: int,
    renders: bool,
    described: Description,
    measures: bool = False,
) -> dict[str, Any]:
    """Return an episode of at most so many steps: the hashes of PARTS at each, what they cost, and the picture's size.

    measures  also how large pictures are as PNG, which takes as long as drawing them

    ValueError where a reward, or the score that `info` tells, is not finite.
    """
    costs: dict[str, list[float]] = {"step": [], "picture": [], "bytes": []}
    hashes: list[list[str | None]] = []
    shape: Sequence[int] = ()
    (observation, info), action = described.begin(env, seed), -1
    reward, ends, began = 0.0, (False, False), time.perf_counter()
    while True:
        picture = None
        if renders:
            begun = time.process_time()
            drawn = env.render()
            costs["picture"].append(1000 * (time.process_time() - begun))
            if isinstance(drawn, str):
                rows, picture = drawn.splitlines(), _digest(drawn.encode())
                shape = (len(rows), max(map(len, rows), default=0))
            else:
                pixels = pixels_of(drawn)
                picture, shape = _digest(pixels.data, repr(pixels.shape).encode()), pixels.shape[:2]
                if measures and len(hashes) % 100 == 0:
                    costs["bytes"].append(_png_size(pixels))
        end = _digest(repr(ends).encode())
        seen, paid = (
            _digest(bytes_of(observation)),
            _digest(repr(finite("reward", reward_of(described.id, reward))).encode()),
        )
        ended = any(ends) or len(hashes) >= steps
        mask = None if ended else codes.mask_of(env, observation, info)
        allowed = "" if mask is None else _digest(bytes_of(mask))
        hashes.append([str(action), seen, paid, end, allowed, picture])
        if ended:
            return {
                "hashes": hashes,
                "costs": costs,
                "picture": shape,
                "ended": any(ends),
                "moves_s": time.perf_counter() - began,
            }
        action = choose(observation, np.ones(codes.count, bool) if mask is None else mask)
        begun = time.process_time()
        observation, reward, terminated, truncated, info = env.step(codes.own(action))
        costs["step"].append(1000 * (time.process_time() - begun))
        if described.score != "return":
            finite(described.score, info.get(described.score[5:], 0.0))
        ends = bool(terminated), bool(truncated)


def _digest(content: bytes | memoryview, about: bytes = b"") -> str:
    # processors have instructions for SHA-256, so that it takes half the time of a shorter hash
    digest = hashlib.sha256(content)
    digest.update(about)
    return digest.hexdigest()[:12]


def _png_size(pixels: Any) -> int:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.tell()


if __name__ == "__main__":
    _child(json.load(sys.stdin))
