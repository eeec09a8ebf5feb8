"""The contents of a report as frozen values.

`to_json` is its machine-readable form (docs/report.md describes it).
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from humanplay.report.costs import CostSummary
from humanplay.report.statistics.arm_comparisons import ArmComparison
from humanplay.report.statistics.arms import ArmRow
from humanplay.report.statistics.attestation_summary import AttestationSummary
from humanplay.report.statistics.comparisons import PolicyComparison
from humanplay.report.statistics.first_attempts import FirstAttempts
from humanplay.report.statistics.intervals import Interval
from humanplay.report.statistics.learning import Learning, TrialMean
from humanplay.report.statistics.spread import VarianceComponents
from humanplay.report.statistics.study_figures import StatusRow, StudyFigure
from humanplay.report.statistics.summaries import Pictures
from humanplay.study.answer_counts import AnswerCounts
from humanplay.study.flow import ParticipantFlow
from humanplay.task import Words
from humanplay.task.registration import environment_of
from marsexplorer.intervals import Floats

FORMAT = "humanplay-report-1"
_WHO = "every number here was produced by scripts. None of it says anything about people."
SYNTHETIC = f"SYNTHETIC: {_WHO}"


@dataclass(frozen=True)
class Item:
    """An item of the reporting checklist: its number and name there, and the answer.

    Attributes:
        source: Where the answer comes from; "missing" if neither database nor protocol nor software
            can know.
    """

    number: str
    name: str
    answer: str
    detail: str
    source: Literal["database", "protocol", "software", "missing"]


@dataclass(frozen=True)
class Metric:
    """The further statistics of one metric ("score" or "steps") per protocol.

    Attributes:
        iqm: The interquartile mean over all episodes, with its interval for other players.
        warm_up: Per warm-up trial as `Learning.by_trial`; their terrains come in the same order
            for everybody.
    """

    name: str
    mean: float
    iqm: float
    iqm_interval: Interval | None
    variance: VarianceComponents | None
    learning: Learning
    warm_up: tuple[TrialMean, ...] = ()


@dataclass(frozen=True)
class PlayerRow:
    """Somebody who began a ranked episode, under a pseudonym of this report alone.

    Means over the ranked terrains, as they enter the estimate for everybody.
    """

    name: str
    episodes: int
    score: float
    steps: float
    explored: int
    failed: int
    status: str


@dataclass(frozen=True)
class GroupReport:
    """The people of a study, or one kind of script.

    words       what the task calls its figures
    joined, started, finished   participants who joined, began a ranked episode, ended all of them
    stages      participants by stage
    figures     estimates: per protocol, everybody, and those of the protocol's other exclusion sets
    worst       by metric the value of a terrain that counts at the lowest score; None where none is declared
    statuses    everybody who came, by where they are
    arms        people and estimates by the protocol's arms; empty without arms
    arm_comparisons  every two arms compared, in each metric
    left        began to play and have neither finished nor are still expected to: withdrawn, or the study is closed
    outcomes    ranked episodes by outcome; labels: ranked episodes by label
    flags       of those who began, people of whom it does not hold, by what the protocol's `flags` ask for
    deviations  from the protocol, a sentence each
    cautions    what a reader must know before using the figure, a sentence each
    costs       of the players' moves; None where they were not worked out
    no_costs    why no move of the study is judged, a sentence; None where moves are
    first_attempts   as ARC-AGI-3 counts them; None for scripts
    exposure    who met which ranked terrains when, a sentence; None for scripts
    languages   people who agreed, by the language that they read, those of few people joined; empty for scripts, for an
                open study and where all are joined
    flow        of the people through the study; None for scripts
    attestation what the server could attest; None for scripts
    repeated    people who show a sign of taking part more than once, by sign
    pictures    curves and visit maps, empty where no episodes were replayed
    """

    name: str
    kind: str
    words: Words
    joined: int
    started: int
    finished: int
    left: int
    stages: dict[str, int]
    outcomes: dict[str, int]
    labels: dict[str, int]
    flags: dict[str, int]
    figures: tuple[StudyFigure, ...]
    worst: dict[str, float | None]
    statuses: tuple[StatusRow, ...]
    arms: tuple[ArmRow, ...]
    arm_comparisons: tuple[ArmComparison, ...]
    metrics: tuple[Metric, ...]
    players: tuple[PlayerRow, ...]
    comparisons: tuple[PolicyComparison, ...]
    deviations: tuple[str, ...]
    cautions: tuple[str, ...]
    first_attempts: FirstAttempts | None = None
    exposure: str | None = None
    answers: tuple[AnswerCounts, ...] = ()
    languages: dict[str, int] = field(default_factory=dict)
    flow: ParticipantFlow | None = None
    attestation: AttestationSummary | None = None
    repeated: dict[str, int] = field(default_factory=dict)
    costs: CostSummary | None = None
    no_costs: str | None = None
    pictures: Pictures = field(default_factory=Pictures, repr=False)

    @property
    def figure(self) -> StudyFigure:
        """The per-protocol estimate."""
        return self.figures[0]

    @property
    def everybody(self) -> StudyFigure:
        """The estimate for everybody who began a ranked episode."""
        return self.figures[1]

    def metric(self, name: str) -> Metric | None:
        """The further statistics of "score" or "steps"; None while nobody has finished."""
        return next((metric for metric in self.metrics if metric.name == name), None)


@dataclass(frozen=True)
class PolicyRun:
    """A policy's episodes by terrain index.

    NaN (and the outcome "") if the terrain's seed is not known.
    """

    name: str
    score: Floats
    steps: Floats
    outcomes: tuple[str, ...]
    pictures: Pictures = field(default_factory=Pictures, repr=False)

    def values(self, metric: Literal["score", "steps"]) -> Floats:
        """float64[terrains] of a metric."""
        return self.score if metric == "score" else self.steps


@dataclass(frozen=True)
class PolicyRow:
    """A policy on the study's ranked terrains.

    Attributes:
        completed, failed: Numbers of episodes.
    """

    name: str
    episodes: int
    score: float
    steps: float
    completed: int
    failed: int
    pictures: Pictures = field(default_factory=Pictures, repr=False)


@dataclass(frozen=True)
class Report:
    """A study's report: over scripts if `synthetic`, else over people.

    It is never over both.

    Attributes:
        estimand: What the estimates are of, in words.
        rule: How intervals are made.
        interval_for: Whom they are for.
        deviations: Of the study as a whole.
        scripts: Scripted participants, by kind: counted and left out.
    """

    study: str
    title: str
    synthetic: bool
    status: str
    made_at: str
    software_version: str
    core_version: str
    protocol_hash: str
    commitment: str
    frozen_at: str
    closed_at: str | None
    protocol: dict[str, Any]
    estimand: str
    rule: str
    interval_for: str
    sentence: str
    groups: tuple[GroupReport, ...]
    policies: tuple[PolicyRow, ...]
    deviations: tuple[str, ...]
    scripts: dict[str, int]
    checklist: tuple[Item, ...]

    def title_of(self, policy: str) -> str:
        """What the report calls a policy: code, or the file that played.

        The file is named by the hash that the protocol has.
        """
        digest = self.protocol["policy_hashes"].get(policy)
        if digest is None and environment_of(self.protocol["task"]).policies.is_rule(policy):
            return f"{self.called(policy)} (code)"
        hash_in_words = f"SHA-256 {digest[:12]}…" if digest else "whose SHA-256 was not recorded"
        return f"{policy} (this file, {hash_in_words})"

    def called(self, policy: str) -> str:
        """What people read in place of a policy's name."""
        return environment_of(self.protocol["task"]).policies.title(policy)

    def to_dict(self) -> dict[str, object]:
        """Everything as plain values, the watermark first in a synthetic report.

        NaN and infinities become None.
        """
        mark = {"watermark": SYNTHETIC} if self.synthetic else {}
        return _plain_object({"format": FORMAT, **mark, **asdict(self)})

    def to_json(self) -> str:
        """`to_dict` as JSON."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)


def _plain_object(values: dict[str, object]) -> dict[str, object]:
    return {name: _plain(content) for name, content in values.items()}


def _plain(content: object) -> object:
    if isinstance(content, dict):
        return _plain_object(content)
    if isinstance(content, (list, tuple)):
        return [_plain(element) for element in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
