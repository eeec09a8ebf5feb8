"""Whether an environment follows from its seed and its actions.

Fresh processes play the same episodes under different circumstances (`hashed_episodes`). Their hashes
are compared step by step with those of the first run.
"""

from __future__ import annotations

import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace

from humanplay.task import counted
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium import hashed_episodes
from humanplay.tasks.gymnasium.description import described
from humanplay.tasks.gymnasium.hashed_episodes import (
    AFTER_OTHERS,
    FIRST_RUN,
    LINE_MARK,
    PARTS,
    PROPOSALS,
    SEEDED_GLOBALS,
    SEEDS_APART,
    USED,
    WITHOUT_RENDERING,
    HashedEpisode,
    Request,
)
from humanplay.tasks.gymnasium.proposals import Proposals
from humanplay.tasks.processes import variables as fixed_variables

Progress = Callable[[int, int], None]
Variables = Mapping[str, str]

FRESH_PROCESS, HASH_SEED, ELSEWHERE = "fresh process", "hash seed", "elsewhere"
UNSEEDED = "random numbers of Python or numpy that the seed of reset does not reach"
CAUSES: Mapping[str, str] = {
    FRESH_PROCESS: f"{UNSEEDED}, the clock, sets of objects ordered by address, files on disk",
    HASH_SEED: "sets of strings, iterated in the order of their hashes",
    ELSEWHERE: "the clock, the time zone, files of the working folder",
    AFTER_OTHERS: "a counter kept on the class, a state of the module, a cache",
    WITHOUT_RENDERING: "a render that draws random numbers or changes the state",
    USED: "a state that reset leaves as it was",
}
"""Variant -> the usual causes of a difference. The first variant that differs is named first."""
RUNS: Mapping[str, Sequence[Variables]] = {variant: [{}] for variant in CAUSES} | {
    # two short sets have the same order by chance under half of all pairs of seeds
    HASH_SEED: [{"PYTHONHASHSEED": seed} for seed in ("77", "1", "2", "3")],
    ELSEWHERE: [{"TZ": "BBB-14"}],
}
"""Variant -> the environment variables of each of its runs."""
USUAL_VARIABLES = {"TZ": "AAA0"}
PROBE_STEPS = 20
"""Moves by which the time is estimated. Each seed is played for at least so many."""
TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class Difference:
    """The first difference between a variant and the first run.

    Attributes:
        seed: What `reset` of the episode was called with.
        step: 0 is what `reset` returned.
        part: One of PARTS.
        cause: The likely cause, if further runs found it; else empty.
    """

    variant: str
    seed: int
    step: int
    part: str
    cause: str = ""

    def __str__(self) -> str:
        cause = self.cause or f"usual causes: {CAUSES[self.variant]}"
        return (
            f"{self.part} differs at seed {self.seed}, step {self.step} ({self.variant}); {cause}"
        )


@dataclass(frozen=True)
class Examination:
    """What an examination found.

    Attributes:
        steps: Moves of all seeds, compared under each variant.
        differences: The first difference of each variant that has one.
        used: That of a used environment, which is no fault: the playground makes a fresh
            environment for each episode.
        step_ms, picture_ms: Median processor time of a step, and of a picture.
        picture: Its rows and columns: in pixels, or in characters of a text.
        picture_bytes: Median size of the picture as PNG; 0 for text.
        keys: Action -> its keys.
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
        """The verdict in a sentence."""
        title = environment_of(self.task).about.title
        if self.differences:
            return f"{title} does not follow from seed and actions: {self.differences[0]}"
        return f"{title}: no difference in {counted(self.steps, 'step')}"

    def to_dict(self) -> dict[str, object]:
        """The fields and the verdict, as JSON holds them."""
        return {"verdict": self.verdict, "exact": not self.differences, **asdict(self)}


def examine(
    task: str,
    seeds: int = 5,
    steps: int = 2000,
    progress: Progress = lambda done, total: None,
    *,
    config: Mapping[str, object] | None = None,
    rule: str | None = None,
    limit_s: float | None = None,
    shortened: Callable[[float, int], object] = lambda seconds, steps: None,
) -> Examination:
    """Play the same episodes in ten processes and compare them.

    Args:
        seeds: How many starts are played. Start k plays its episodes on the seeds from 10,000 k on.
        steps: Moves of each start.
        progress: Called with the processes that are done, and their number.
        config: What `GymnasiumEnvironment.configuration` takes.
        rule: MODULE:FUNCTION that returns an action for an observation. It takes turns with
            uniform and sticky random actions.
        limit_s: If all would take more seconds, fewer moves are played: at least `PROBE_STEPS`.
        shortened: Called then with the seconds that all would take, and the moves for each start.

    Raises:
        ValueError: If the environment cannot be made, played or drawn.
    """
    environment = environment_of(task)
    settings = environment.configuration(config or {}).to_dict()
    request = Request(task, FIRST_RUN, settings, seeds, steps, rule)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as other_folder:
        if limit_s is not None:
            request = _within_limit(request, limit_s, folder, shortened)
        first_run = _play(request, folder, {})
        differences = _differences(first_run, request, folder, other_folder, progress)
        if fresh := differences.get(FRESH_PROCESS):
            cause = _likely_cause(fresh, request, folder)
            differences[FRESH_PROCESS] = replace(fresh, cause=cause)
    rows, columns = first_run[0].picture or (0, 0)
    return Examination(
        task=task,
        steps=sum(len(episode.hashes) - 1 for episode in first_run),
        differences=tuple(
            differences[variant] for variant in CAUSES if variant in differences and variant != USED
        ),
        used=differences.get(USED),
        step_ms=_median(ms for episode in first_run for ms in episode.step_ms),
        picture_ms=_median(ms for episode in first_run for ms in episode.picture_ms),
        picture=(rows, columns),
        picture_bytes=int(_median(size for episode in first_run for size in episode.picture_bytes)),
        keys=environment.keys,
    )


def proposals(task: str) -> Proposals:
    """What a file may say of an environment where it says nothing yet."""
    with tempfile.TemporaryDirectory() as folder:
        (line,) = _lines(Request(task, PROPOSALS), folder, {})
    fields: Proposals = json.loads(line)
    return fields


def _workers() -> int:
    return max(1, min(4, os.cpu_count() or 1))


def _within_limit(
    request: Request, limit_s: float, folder: str, shortened: Callable[[float, int], object]
) -> Request:
    """The request, with fewer moves if it would take longer than the limit."""
    if request.steps <= PROBE_STEPS:
        return request
    runs = sum(map(len, RUNS.values()))
    # the first run, the others side by side, and those that look for a cause
    rounds = 1 + math.ceil(runs / _workers()) + 4 / min(2, _workers())
    fixed_s, move_s = _estimated_seconds(request, folder)
    whole_s = rounds * (fixed_s + move_s * request.steps)
    if whole_s <= limit_s:
        return request
    affordable = int((limit_s / rounds - fixed_s) / move_s)
    steps = min(request.steps, max(PROBE_STEPS, affordable))
    shortened(whole_s, steps)
    return replace(request, steps=steps)


def _estimated_seconds(request: Request, folder: str) -> tuple[float, float]:
    """Estimate the seconds of a run from a short one.

    Returns:
        The fixed seconds of a run, and the seconds that one more move of every seed adds. Episodes
        that ended by themselves add their restarts to the moves.
    """
    started_s = time.perf_counter()
    episodes = _play(replace(request, seeds=1, steps=PROBE_STEPS), folder, {})
    whole_s = time.perf_counter() - started_s
    restart_s = statistics.median(episode.restart_s for episode in episodes)
    moves_s = sum(episode.moves_s for episode in episodes)
    ended = sum(episode.ended for episode in episodes)
    process_s = whole_s - moves_s - len(episodes) * restart_s
    move_s = (moves_s + ended * restart_s) / PROBE_STEPS
    return process_s + request.seeds * restart_s, request.seeds * move_s


def _differences(
    first_run: Sequence[HashedEpisode],
    request: Request,
    folder: str,
    other_folder: str,
    progress: Progress,
) -> dict[str, Difference]:
    """Variant -> its first difference from the first run, of those that differ.

    Args:
        other_folder: Where the variant that is played elsewhere is played.
    """
    runs = [(variant, variables) for variant in CAUSES for variables in RUNS[variant]]
    progress(1, len(runs) + 1)

    def compare(run: tuple[str, Variables]) -> Difference | None:
        variant, variables = run
        run_folder = other_folder if variant == ELSEWHERE else folder
        episodes = _play(replace(request, variant=variant), run_folder, variables)
        return _first_difference(variant, first_run, episodes)

    differences: dict[str, Difference] = {}
    with ThreadPoolExecutor(_workers()) as threads:
        for done, difference in enumerate(threads.map(compare, runs), 2):
            if difference is not None:
                differences.setdefault(difference.variant, difference)
            progress(done, len(runs) + 1)
    return differences


def _first_difference(
    variant: str, first_run: Sequence[HashedEpisode], episodes: Sequence[HashedEpisode]
) -> Difference | None:
    """Where a variant's episodes first differ, in the order of the first run."""
    # many short episodes reach the seeds of the next start, which chooses other actions
    others = {(episode.first_seed, episode.seed): episode.hashes for episode in episodes}
    for episode in first_run:
        other = others.get((episode.first_seed, episode.seed), [])
        for step, step_hashes in enumerate(episode.hashes):
            if step >= len(other):
                return Difference(variant, episode.seed, step, "end")
            for part, hash, other_hash in zip(PARTS, step_hashes, other[step], strict=True):
                # a picture that one of them did not draw is not compared
                if hash != other_hash and None not in (hash, other_hash):
                    return Difference(variant, episode.seed, step, part)
    return None


def _likely_cause(difference: Difference, request: Request, folder: str) -> str:
    """The likely cause of a difference, by what removes it; empty if nothing does."""
    up_to_difference = replace(request, seeds=difference.seed // SEEDS_APART + 1)

    def is_removed(changed: Request) -> bool:
        try:
            with ThreadPoolExecutor(min(2, _workers())) as threads:
                run, other_run = threads.map(lambda _: _play(changed, folder, {}), range(2))
        except ValueError:  # it takes no such argument
            return False
        return _first_difference(FRESH_PROCESS, run, other_run) is None

    description = described(request.task.partition(":")[2])
    if description.seeding != "kwarg":
        by_keyword = description.model_copy(update={"seeding": "kwarg"})
        if is_removed(replace(up_to_difference, task=f"gymnasium:{by_keyword.told}")):
            return (
                'it heeds the seed of `make` alone, not that of `reset`: write `seeding = "kwarg"` '
                "into its file (`humanplay doctor ENV --toml`)"
            )
    seeded = replace(up_to_difference, variant=SEEDED_GLOBALS)
    return f"likely cause: {UNSEEDED}" if is_removed(seeded) else ""


def _median(numbers: Iterable[float]) -> float:
    return round(statistics.median([*numbers] or [0.0]), 4)


def _play(request: Request, folder: str, variables: Variables) -> list[HashedEpisode]:
    """Play a request in a fresh process; `_lines` says how."""
    return [HashedEpisode(**json.loads(line)) for line in _lines(request, folder, variables)]


def run_fresh(
    request: str, environ: Mapping[str, str], folder: str
) -> subprocess.CompletedProcess[str]:
    """Run `hashed_episodes` in a fresh process, with a request as JSON.

    Raises:
        subprocess.TimeoutExpired: If it takes longer than `TIMEOUT_S`.
    """
    return subprocess.run(
        [sys.executable, "-m", hashed_episodes.__name__],
        input=request,
        env=environ,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


def _lines(request: Request, folder: str, variables: Variables) -> list[str]:
    """What a fresh process prints for a request.

    Args:
        folder: Where it works.
        variables: Environment variables beside the usual ones.

    Raises:
        ValueError: If it fails; the text has the last line of its error.
    """
    environ = {**fixed_variables(), **USUAL_VARIABLES, **variables}
    if "HOME" in os.environ:
        environ["HOME"] = os.environ["HOME"]
    try:
        process = run_fresh(json.dumps(asdict(request)), environ, folder)
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"{request.task} took over {TIMEOUT_S:.0f} s: ask for fewer steps"
        ) from error
    if process.returncode:
        errors = process.stderr.strip().splitlines() or [f"it ended with {process.returncode}"]
        raise ValueError(
            f"{request.task} cannot be examined: {errors[-1]}; play it by its own package first"
        )
    lines = process.stdout.splitlines()
    return [line.removeprefix(LINE_MARK) for line in lines if line.startswith(LINE_MARK)]
