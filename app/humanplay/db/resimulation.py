"""A finished episode simulated again, and every difference from what was stored.

It is simulated from what fixes it: its configuration, instance and actions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from humanplay.db.rows import EpisodeRow, MoveRow
from humanplay.db.trial import Trial
from humanplay.task import Run


@dataclass(frozen=True)
class Finding:
    """One thing that is not as it should be.

    Attributes:
        where: "episode ID", "participant ID", "study NAME", "file PATH".
        what: The field, or a few words.
        stored: What is kept.
        found: What it should be.
    """

    where: str
    what: str
    stored: object
    found: object

    @property
    def is_not_stepped(self) -> bool:
        """Whether it only says that nothing steps the episode again."""
        return (self.what, self.stored, self.found) == NOT_STEPPED

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is {_short(self.stored)}, found {_short(self.found)}"


NOT_STEPPED = ("cause", "stepped in place", "nothing that steps it again: it is not verified")
"""What is said of an episode whose replay is what was recorded when it was played."""


def _short(content: object) -> str:
    text = content if isinstance(content, str) else repr(content)
    return text if len(text) <= 200 else text[:197] + "..."


def simulate(row: EpisodeRow, steps: Sequence[MoveRow]) -> tuple[Run | None, list[Finding]]:
    """Simulate a finished episode again and compare it with its rows.

    Args:
        row, steps: As `Reader.finished` and `Reader.steps` give them.

    Returns:
        The run, None if it cannot be simulated; and what differs.
    """
    differences: list[Difference] = []
    run = _simulated(row, list(steps), differences)
    name = f"episode {row['id']}"
    return run, [Finding(name, *difference) for difference in differences]


Difference = tuple[str, object, object]
"""A field, what is stored, and what it should be."""


def _simulated(row: EpisodeRow, steps: list[MoveRow], differences: list[Difference]) -> Run | None:
    try:
        trial = Trial.of(row)
    except (ValueError, TypeError) as error:
        differences.append(("config", row["config"], f"no configuration: {error}"))
        return None
    version = trial.environment.version
    differences += _of_config(row, trial)
    if row["core_version"] != version:
        try:
            here = trial.environment.lock.why_not_replayable(
                trial.record(steps), [step["reward"] for step in steps]
            )
        except (ValueError, TypeError, RuntimeError) as error:
            here = f"cannot be simulated here: {error}"
        differences.append(("core_version", row["core_version"], here))
        return None
    numbers = [step["step"] for step in steps]
    if numbers != list(range(len(steps))):
        differences.append(("steps", numbers, "0, 1, 2, ... without a gap"))
    try:
        record = trial.record(steps)
        differences += _of_seed(row, trial)
        episode = trial.environment.replay_record(record)
    except (ValueError, TypeError, RuntimeError) as error:
        differences.append(("cause", "something that cannot be played", str(error)))
        return None
    if trial.environment.is_recorded:
        differences.append(NOT_STEPPED)
    differences += _of_totals(row, episode)
    differences += _of_steps(steps, episode)
    if row["driver"] == "human" and any(step["driver"] != "human" for step in steps):
        differences.append(("driver", "human", "script: a move of its did not come from a hand"))
    return episode


def _of_config(row: EpisodeRow, trial: Trial) -> Iterator[Difference]:
    pairs = {
        "config_hash": (row["config_hash"], trial.config_hash),
        "level": (row["level"], trial.config.level),
        "terrain_hash": (row["terrain_hash"], trial.terrain_hash),
    }
    for name, (stored, derived) in pairs.items():
        if stored != derived:
            yield name, stored, derived


def _of_seed(row: EpisodeRow, trial: Trial) -> Iterator[Difference]:
    if trial.seed is None:
        return
    terrain, start = trial.environment.instance(trial.config, trial.seed)
    if row["terrain"] != terrain:
        yield "terrain", row["terrain"].hex(), f"{terrain.hex()} from seed {row['seed']}"
    if trial.start != start:
        yield "start", trial.start, start


def _of_totals(row: EpisodeRow, episode: Run) -> Iterator[Difference]:
    record = episode.record()
    names = ("outcome", "steps", "discovered", "total", "trajectory_hash", "score")
    stored = {name: content for name, content in row.items() if name in names}
    for name in names:
        if stored[name] != getattr(record, name):
            yield name, stored[name], getattr(record, name)


def _of_steps(steps: list[MoveRow], episode: Run) -> Iterator[Difference]:
    counts = episode.counts()
    for number, (step, reward) in enumerate(zip(steps, episode.rewards(), strict=True)):
        if step["reward"] != reward:
            yield f"reward of step {number}", step["reward"], reward
        if step["discovered"] != counts[number + 1]:
            yield f"discovered of step {number}", step["discovered"], counts[number + 1]
