"""Clones of a study's players: which of their episodes train one, and how much it moves like them where it has not trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.moves.likeness import mean_agreement
from app.statistics.exclusion_sets import Cohort, members, people_of, scripts_of
from app.storage.reader import Reader
from app.study.data import StudyData, trial_records
from marsexplorer.config import CORE_VERSION
from marsexplorer.episode import Record
from marsexplorer.evaluation.agreement import Agreement, agreement_with
from marsexplorer.evaluation.episodes import play_terrain
from marsexplorer.policies import Policy
from marsexplorer.score import steps_to_target

HELD_OUT = 0.2
"""Share of the ranked terrains whose episodes train nothing."""


@dataclass(frozen=True)
class CloneEpisodes:
    """Episodes for a clone: those it is trained on, and by player those on the terrains that are held out."""

    trained: tuple[Record, ...]
    held_out: dict[str, tuple[Record, ...]]
    terrains: tuple[int, ...]

    def records(self) -> list[Record]:
        """Return one episode of each terrain that is held out."""
        found = {record.terrain: record for own in self.held_out.values() for record in own}
        return list(found.values())


def clone_episodes(reader: Reader, data: StudyData, synthetic: bool, seed: int) -> CloneEpisodes:
    """Return the finished ranked and warm-up episodes of a study's people (or scripts), some ranked terrains held out.

    The terrains are drawn by `seed`, and the same whoever played. ValueError when there are no episodes on both sides.
    """
    cohorts = scripts_of(data) if synthetic else [people_of(data)]
    count = data.protocol.ranked
    drawn = np.random.default_rng(seed).permutation(count)[: max(1, round(HELD_OUT * count))]
    held = tuple(sorted(int(index) for index in drawn))
    trained, held_out = list[Record](), dict[str, tuple[Record, ...]]()
    for cohort in cohorts:
        for player in members(cohort, {}):
            trained += _records(reader, cohort, player, held, is_held=False)
            if own := _records(reader, cohort, player, held, is_held=True):
                held_out[player] = tuple(own)
    if not trained or not held_out:
        who = "scripts" if synthetic else "people"
        way_out = (
            "" if synthetic else "; --synthetic trains on its scripts, and says so on the card"
        )
        raise ValueError(
            f"a clone needs finished ranked episodes of {who} on several terrains, and there are none{way_out}"
        )
    return CloneEpisodes(tuple(trained), held_out, held)


def agreement_on(episodes: CloneEpisodes, policy: Policy) -> float:
    """Return the mean over players of the share of moves on held-out terrains that the policy would have made too, 0..1."""
    found = {
        player: {
            "policy": sum((agreement_with(policy, record) for record in own), start=Agreement())
        }
        for player, own in episodes.held_out.items()
    }
    return mean_agreement(found, "policy") or 0.0


def mean_steps(records: Sequence[Record], policy: Policy) -> float:
    """Return the policy's mean steps to 99 % on the terrains of some episodes."""
    steps = []
    for record in records:
        episode = play_terrain(policy, record)
        steps.append(steps_to_target(record.config, episode.outcome, episode.steps))
    return float(np.mean(steps))


def _records(
    reader: Reader, cohort: Cohort, player: str, held: Sequence[int], is_held: bool
) -> list[Record]:
    ranked = [trial for trial in cohort.ranked[player] if (trial.terrain in held) == is_held]
    trials = ranked if is_held else [*cohort.warm_up[player], *ranked]
    return [
        record
        for trial, record in trial_records(reader, trials)
        if trial.core_version == CORE_VERSION
    ]
