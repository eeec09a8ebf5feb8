"""A finished episode simulated again from what fixes it, and every difference from what was stored,
by name."""

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

    def __str__(self) -> str:
        return f"{self.where}: {self.what} is {_short(self.stored)}, found {_short(self.found)}"


def _short(value: object) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= 200 else text[:197] + "..."


def simulate(row: EpisodeRow, steps: Sequence[MoveRow]) -> tuple[Run | None, list[Finding]]:
    """Return a finished episode simulated again, None where it cannot be, and what differs from its
    rows.

    Args:
        row, steps: As `Reader.finished` and `Reader.steps` give them.
    """
    found: list[Found] = []
    episode = _simulated(row, list(steps), found)
    return episode, [Finding(f"episode {row['id']}", *each) for each in found]


Found = tuple[str, object, object]


def _simulated(row: EpisodeRow, steps: list[MoveRow], found: list[Found]) -> Run | None:
    try:
        trial = Trial.of(row)
    except (ValueError, TypeError) as error:
        found.append(("config", row["config"], f"no configuration: {error}"))
        return None
    version = trial.environment.version
    found += _of_config(row, trial)
    if row["core_version"] != version:
        try:
            here = trial.environment.lock.why_not_replayable(
                trial.record(steps), [step["reward"] for step in steps]
            )
        except (ValueError, TypeError, RuntimeError) as error:
            here = f"cannot be simulated here: {error}"
        found.append(("core_version", row["core_version"], here))
        return None
    numbers = [step["step"] for step in steps]
    if numbers != list(range(len(steps))):
        found.append(("steps", numbers, "0, 1, 2, ... without a gap"))
    try:
        record = trial.record(steps)
        found += _of_seed(row, trial)
        episode = trial.environment.replay_record(record)
    except (ValueError, TypeError, RuntimeError) as error:
        found.append(("cause", "something that cannot be played", str(error)))
        return None
    found += _of_totals(row, episode)
    found += _of_steps(steps, episode)
    if row["driver"] == "human" and any(step["driver"] != "human" for step in steps):
        found.append(("driver", "human", "script: a move of its did not come from a hand"))
    return episode


def _of_config(row: EpisodeRow, trial: Trial) -> Iterator[Found]:
    pairs = {
        "config_hash": (row["config_hash"], trial.config_hash),
        "level": (row["level"], trial.config.level),
        "terrain_hash": (row["terrain_hash"], trial.terrain_hash),
    }
    for name, (stored, value) in pairs.items():
        if stored != value:
            yield name, stored, value


def _of_seed(row: EpisodeRow, trial: Trial) -> Iterator[Found]:
    if trial.seed is None:
        return
    terrain, start = trial.environment.instance(trial.config, trial.seed)
    if row["terrain"] != terrain:
        yield "terrain", row["terrain"].hex(), f"{terrain.hex()} from seed {row['seed']}"
    if trial.start != start:
        yield "start", trial.start, start


def _of_totals(row: EpisodeRow, episode: Run) -> Iterator[Found]:
    record = episode.record()
    names = ("outcome", "steps", "discovered", "total", "trajectory_hash", "score")
    stored = {name: value for name, value in row.items() if name in names}
    for name in names:
        if stored[name] != getattr(record, name):
            yield name, stored[name], getattr(record, name)


def _of_steps(steps: list[MoveRow], episode: Run) -> Iterator[Found]:
    counts = episode.counts()
    for number, (step, reward) in enumerate(zip(steps, episode.rewards(), strict=True)):
        if step["reward"] != reward:
            yield f"reward of step {number}", step["reward"], reward
        if step["discovered"] != counts[number + 1]:
            yield f"discovered of step {number}", step["discovered"], counts[number + 1]
