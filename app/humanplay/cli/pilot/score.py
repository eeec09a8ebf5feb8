"""`score`: how well people play, beside policies on the same instances."""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from humanplay.cli.pilot.episodes import Pilot, PilotEpisode, State, only_task, read
from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.plays import Plays
from humanplay.cli.pilot.policies import played_score
from humanplay.db.playground import ExclusionCounts
from humanplay.report.statistics.comparisons import quotient_interval
from humanplay.report.statistics.formatting import number, percent
from humanplay.report.statistics.intervals import Interval, estimate
from humanplay.task import counted
from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.description import described
from humanplay.tasks.gymnasium.environment import GymnasiumEnvironment
from marsexplorer.intervals import FEWEST, Floats

BOTH_WAYS = 0.05
"""Share of left and failed episodes above which both ways of counting them are printed."""
DIGITS = 2
RANDOM = "random"


@dataclass(frozen=True)
class Line:
    """A mean over people of their means, or of a policy's scores on what they played.

    interval             of the mean, for other people on these instances; None below five people, and of a policy
    normalized           (policy - random) / (people - random); None unless people are surely better than random actions
    normalized_interval  of it
    """

    name: str
    mean: float
    interval: Interval | None = None
    normalized: float | None = None
    normalized_interval: Interval | None = None


@dataclass(frozen=True)
class Score:
    """What was played, in figures.

    people      with how many there are, and how many episodes each has played at least and at most
    policies    `random` first
    states      episodes that ended, were left, failed and are open
    left_as     what an episode counts that did not end
    without     the mean of people without those; None if none of theirs ended
    has_bound   whether the lowest possible score is known
    left_out    ended episodes that do not count
    is_recorded whether nothing steps the environment again, so that nothing is verified
    no_random   why random actions are left out; empty if they are not
    """

    task: str
    metric: str
    people: Line
    count: int
    fewest: int
    most: int
    policies: tuple[Line, ...]
    states: dict[State, int]
    left_as: float
    without: float | None
    has_bound: bool
    left_out: ExclusionCounts
    is_recorded: bool = False
    no_random: str = ""

    def to_dict(self) -> dict[str, object]:
        """The figures by their names, as JSON holds them."""
        return asdict(self)

    def to_frame(self) -> object:
        """The table as a data frame; PilotError without pandas."""
        if find_spec("pandas") is None:
            raise PilotError(
                "a data frame needs pandas: pip install pandas; `to_dict` needs nothing"
            )
        return import_module("pandas").DataFrame([asdict(line) for line in self.lines])

    @property
    def lines(self) -> tuple[Line, ...]:
        """People, then the policies."""
        return (self.people, *self.policies)

    @property
    def headline(self) -> str:
        """All figures in one line."""
        fewest = str(self.fewest) if self.fewest == self.most else f"{self.fewest} to {self.most}"
        episodes = "episode" if self.most == 1 else "episodes"
        people = "person" if self.count == 1 else "people"
        parts = [
            f"people {_with(self.people.mean, self.people.interval)}, {self.count} {people}, {fewest} {episodes} each"
        ]
        for line in self.policies:
            parts.append(f"{line.name} {number(line.mean, DIGITS)}")
            if line.normalized is not None:
                ratio = _with(line.normalized, line.normalized_interval)
                parts.append(f"{line.name}, human-normalized {ratio}")
        return " · ".join(parts)

    @property
    def notes(self) -> list[str]:
        """What must be known to read the figures."""
        notes = []
        if self.count < FEWEST:
            notes.append(f"no interval below {FEWEST} people")
        played = sum(self.states.values())
        unended = {state: n for state, n in self.states.items() if state != "ended" and n}
        if unended:
            words = ", ".join(
                f"{n} {'still open' if state == 'open' else state}" for state, n in unended.items()
            )
            bound = (
                "the lowest score that there can be"
                if self.has_bound
                else "the worst score of an episode that ended"
            )
            notes.append(
                f"of {counted(played, 'episode')}: {words}; each counts {number(self.left_as, DIGITS)}, {bound}"
            )
        if played and sum(unended.values()) > BOTH_WAYS * played:
            share = percent(sum(unended.values()) / played)
            alone = (
                "no person has an episode that ended"
                if self.without is None
                else f"people {number(self.without, DIGITS)} without these"
            )
            notes.append(f"{share} of the episodes did not end: {alone}")
        if not self.has_bound:
            notes.append(
                "no lowest score is known, so that leaving an episode can raise the figure: name `bounds` in a description"
            )
        if self.is_recorded:
            notes.append(
                "not verified, and nothing beside it: the program that held the environment stepped it itself"
            )
        if self.no_random:
            notes.append(f"random actions are left out: {self.no_random}")
        if words := _left_out(self.left_out):
            notes.append(f"not counted: {words}")
        notes.append(
            f"pilot: people chose how often to play. To be quoted, play a study: {_study(self.task)}"
        )
        return notes

    def __str__(self) -> str:
        return "\n".join([self.headline, *self.notes])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        head = "".join(
            f"<th>{word}</th>" for word in ("", self.metric, "95 %", "human-normalized", "95 %")
        )
        rows = "".join(
            f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in _cells(line))}</tr>"
            for line in self.lines
        )
        notes = "<br>".join(map(html.escape, [self.headline, *self.notes]))
        return f"<table><tr>{head}</tr>{rows}</table><p>{notes}</p>"


def _left_out(episodes: ExclusionCounts) -> str:
    """Say how many episodes do not count, and why; empty if all do."""
    reasons = {
        "on an instance that was chosen or met before": episodes.repeated,
        "of a program, such as a browser that says that one drives it": episodes.by_program,
        "with a move that fits no key or touch of the page": episodes.unattested,
        "in which the environment failed at the first move": episodes.unmoved,
    }
    return "; ".join(
        f"{counted(number, 'episode')} {reason}" for reason, number in reasons.items() if number
    )


def _with(mean: float, interval: Interval | None) -> str:
    return number(mean, DIGITS) + (f" {_interval(interval)}" if interval else "")


def _interval(interval: Interval | None) -> str:
    if interval is None:
        return ""
    return f"[{number(interval[0], DIGITS)}, {number(interval[1], DIGITS)}]"


def _cells(line: Line) -> list[str]:
    ratio = "" if line.normalized is None else number(line.normalized, DIGITS)
    return [
        line.name,
        number(line.mean, DIGITS),
        _interval(line.interval),
        ratio,
        _interval(line.normalized_interval),
    ]


def _study(task: str) -> str:
    """The command that plans a study of a task."""
    name = task.partition(":")[2]
    if described(name).has_no_module:
        return "move what makes the environment into a module, and `humanplay study new NAME --env MODULE:NAME`"
    if name.startswith("{"):
        return "`humanplay study new NAME --env FILE.toml`, with these fields in the file: " + name
    return f"humanplay study new NAME --env {name}"


def score(plays: Plays | str | Path, policies: Mapping[str, object] | None = None) -> Score:
    """Score people, random actions and policies on the instances that people played.

    Counted are first meetings of an instance that a person did not choose, played alone. A policy plays each of
    these instances once, and weighs as the people who played it do.

    Args:
        plays: What `play` returned, whose page may stay open; or the file of its database.
        policies: By a name of yours: a file, a function of the observation, or an object with `predict`, which
            decides in this program.

    Raises:
        PilotError: Nothing was played that counts, a policy cannot play, or it is called `random`.
    """
    if isinstance(plays, Plays):
        database, task = plays.database, plays.task
    else:
        database = Path(plays)
        task = only_task(database)
    if not task.startswith("gymnasium:"):
        raise PilotError(f"expected plays of an environment of Gymnasium, got {task}")
    pilot = read(database, task)
    if not pilot.episodes:
        left_out = _left_out(pilot.left_out)
        reasons = f"; not counted: {left_out}" if left_out else ""
        raise PilotError(
            f"nothing counts yet in {database}: play a round with keys or by touch{reasons}"
        )
    if RANDOM in (policies or {}):
        raise PilotError(
            f"{RANDOM!r} names the random actions that all others are compared with: call your policy something else"
        )
    return _scored(task, pilot, policies or {})


def _scored(task: str, pilot: Pilot, policies: Mapping[str, object]) -> Score:
    environment = environment_of(task)
    metric = environment.metrics[0]
    ended = [episode.score for episode in pilot.episodes if episode.score is not None]
    if metric.lowest is None and not ended:
        raise PilotError(
            "no episode that counts has ended, and no lowest score is known that the others could count as: "
            "play one to its end, or name `bounds` in a description"
        )
    worst = min(ended) if metric.lowest is None else metric.lowest
    table, instances = _table(pilot.episodes, worst)
    bounds = (
        -np.inf if metric.lowest is None else metric.lowest,
        np.inf if metric.highest is None else metric.highest,
    )
    estimated = estimate(table, bounds, metric.lowest, terrains_drawn=False)
    played = Counter(episode.person for episode in pilot.episodes)
    alone = [episode for episode in pilot.episodes if episode.score is not None]
    states = Counter(episode.state for episode in pilot.episodes)
    if environment.is_recorded and policies:
        raise PilotError(
            "policies need an environment of their own, and the program that held this one stepped it itself: play "
            "what makes it, a class or a function"
        )
    lines, no_random = list[Line](), ""
    if not environment.is_recorded:
        lines, no_random = _policies(task, table, instances, metric.lowest, policies)
    return Score(
        task=task,
        metric=metric.name,
        people=Line("people", estimated.mean, estimated.interval),
        count=len(played),
        fewest=min(played.values()),
        most=max(played.values()),
        policies=tuple(lines),
        states={state: states[state] for state in ("ended", "left", "failed", "open")},
        left_as=worst,
        without=_mean(_table(alone, worst)[0]) if alone else None,
        has_bound=metric.lowest is not None,
        left_out=pilot.left_out,
        is_recorded=environment.is_recorded,
        no_random=no_random,
    )


def _table(episodes: Sequence[PilotEpisode], worst: float) -> tuple[Floats, list[PilotEpisode]]:
    """The scores, and an episode of each instance.

    Returns:
        float64[people, instances], NaN for what somebody did not play; and one episode per column.
    """
    people = dict.fromkeys(episode.person for episode in episodes)
    rows = {person: row for row, person in enumerate(people)}
    instances = {episode.trial.terrain_hash: episode for episode in episodes}
    columns = {name: column for column, name in enumerate(instances)}
    table = np.full((len(rows), len(columns)), np.nan)
    for episode in episodes:
        at = rows[episode.person], columns[episode.trial.terrain_hash]
        table[at] = worst if episode.score is None else episode.score
    return table, list(instances.values())


def _mean(table: Floats) -> float:
    """The mean over people of their means."""
    return float(np.nanmean(table, axis=1).mean())


def _policies(
    task: str,
    table: Floats,
    instances: Sequence[PilotEpisode],
    lowest: float | None,
    policies: Mapping[str, object],
) -> tuple[list[Line], str]:
    """The lines of random actions and policies, and why the first is left out."""
    environment = environment_of(task)
    assert isinstance(environment, GymnasiumEnvironment)  # `score` has refused others
    causes = [
        (environment.configuration(episode.trial.config.to_dict()), _seed(episode))
        for episode in instances
    ]

    def scores_of(name: str, policy: object) -> Floats:
        return np.array(
            [played_score(environment, name, policy, config, seed) for config, seed in causes]
        )

    def mean_of(scores: Floats) -> float:
        return _mean(np.where(np.isnan(table), np.nan, scores))

    lines = list[Line]()
    random: Floats | None = None
    no_random = ""
    try:
        random = scores_of(RANDOM, RANDOM)
        lines.append(Line(RANDOM, mean_of(random)))
    except PilotError as error:  # an environment that breaks must not hide what people reached
        no_random = str(error)
    for name, policy in policies.items():
        scores = scores_of(name, policy)
        ratio, interval = None, None
        if random is not None:
            worst = None if lowest is None else lowest - random
            ratio, interval = quotient_interval(
                scores - random, table - random, worst, terrains_drawn=False
            )
        lines.append(Line(name, mean_of(scores), None, ratio if interval else None, interval))
    return lines, no_random


def _seed(episode: PilotEpisode) -> int:
    seed = episode.trial.seed
    if seed is None:
        raise PilotError(
            "policies play instances that follow from a seed, and one of these does not"
        )
    return seed
