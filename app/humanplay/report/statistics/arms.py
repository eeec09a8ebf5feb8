"""The people of each arm of a study: where they are, and both estimates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from humanplay.report.statistics.arm_comparisons import ArmComparison, compare_arms
from humanplay.report.statistics.exclusion_sets import (
    METRICS,
    Cohort,
    Everybody,
    members,
    statuses,
)
from humanplay.report.statistics.study_figures import StudyFigure, estimates_of, worst_value
from humanplay.study.data import StudyData
from humanplay.study.flow import BEGAN, ENDED, Status


@dataclass(frozen=True)
class ArmRow:
    """The people who were assigned to one arm.

    Attributes:
        assigned: All of them, the erased and bots too.
        began: A ranked episode; bots left out.
        ended: All ranked episodes.
        statuses: People by status, the erased too.
        per_protocol, everybody: Both estimates, of this arm alone.
    """

    arm: str
    assigned: int
    began: int
    ended: int
    statuses: dict[str, int]
    per_protocol: StudyFigure
    everybody: StudyFigure


def arm_rows(data: StudyData, cohort: Cohort, everybody: Everybody) -> tuple[ArmRow, ...]:
    """A row for each arm of the protocol; none of people of an open study.

    Who leaves which arm is an outcome, too.
    """
    if not _is_shown(data, cohort):
        return ()
    return tuple(_row(data, cohort, everybody, arm.name) for arm in data.protocol.arms)


def arm_comparisons(
    data: StudyData, cohort: Cohort, everybody: Everybody
) -> tuple[ArmComparison, ...]:
    """Every two arms in each metric; none of people of an open study."""
    protocol = data.protocol
    if not _is_shown(data, cohort):
        return ()
    ids = members(cohort, protocol.per_protocol), members(everybody.cohort, {})
    finished, began = (
        {arm.name: _of_arm(cohort, some, arm.name) for arm in protocol.arms} for some in ids
    )
    rows: list[ArmComparison] = []
    for metric in METRICS:
        tables = {arm: cohort.table(people, metric) for arm, people in finished.items()}
        second = None
        if worst_value(protocol.environment, protocol.env_config, metric) is not None:
            second = {arm: everybody.cohort.table(people, metric) for arm, people in began.items()}
        is_primary = protocol.primary_family == "arms" and metric == protocol.primary_metric
        is_tested = is_primary and second is not None
        rows += compare_arms(metric, tables, second, is_tested, protocol.terrains_drawn)
    return tuple(rows)


def _is_shown(data: StudyData, cohort: Cohort) -> bool:
    return data.shows_people or cohort.kind != "human"


def _of_arm(cohort: Cohort, ids: Sequence[str], arm: str) -> list[str]:
    """Those of some participants who were assigned to an arm."""
    assigned = {person.id for person in cohort.people if person.arm == arm}
    return [ident for ident in ids if ident in assigned]


def _row(data: StudyData, cohort: Cohort, everybody: Everybody, arm: str) -> ArmRow:
    by_person = statuses(data, cohort)
    people = Counter(by_person[ident] for ident in _of_arm(cohort, list(by_person), arm))
    if cohort.kind == "human":
        people[Status.ERASED] = data.arrivals.erased_by_arm.get(arm, 0)
    finished = _of_arm(cohort, members(cohort, data.protocol.per_protocol), arm)
    began = _of_arm(cohort, members(everybody.cohort, {}), arm)
    both = estimates_of(data, cohort, everybody, finished, began)
    return ArmRow(
        arm,
        assigned=people.total(),
        began=sum(people[status] for status in BEGAN),
        ended=sum(people[status] for status in ENDED),
        statuses={status.value: people[status] for status in Status if people[status]},
        per_protocol=both[0],
        everybody=both[1],
    )
