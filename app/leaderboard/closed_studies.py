"""Closed studies on the leaderboard: people and policies on the very same terrains.

An open study is not shown: a mean that changes with every episode would reveal hidden scores to its players.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from app.moves.likeness import human_likeness
from app.statistics.exclusion_sets import members, people_of
from app.statistics.group_summaries import summarize_groups
from app.statistics.study_figures import live_figure
from app.statistics.summaries import EpisodeSummary, trial_summaries
from app.storage.reader import Reader
from app.storage.study_reader import closed_studies, count_participants
from app.study.data import StudyData, load
from app.study.policy_files import FOLDER
from app.study.seeds import seed


class ClosedStudies:
    """The closed studies of a database; each is read once, because it no longer changes.

    studies  the folder of studies, which keeps the files of their policies
    """

    def __init__(self, studies: Path) -> None:
        self._folder = studies
        self._known: dict[tuple[str, int | None, int], tuple[StudyData, dict[str, Any] | None]] = {}

    def closed(self, reader: Reader) -> list[tuple[StudyData, dict[str, Any] | None]]:
        """Return each closed study with its people's figure and pictures, None for nobody; seconds the first time."""
        found = []
        for study in closed_studies(reader):
            # one who is forgotten afterwards is gone from here as well
            key = (study.name, study.closed_ms, count_participants(reader, study.name))
            if key not in self._known:
                data = load(reader, study.name).with_policies_in(self._folder / study.name / FOLDER)
                self._known[key] = (data, _people(reader, data))
            found.append(self._known[key])
        return found


def ranked_seeds(data: StudyData) -> tuple[int, ...]:
    """Return the seeds of a closed study's ranked terrains, in order."""
    assert data.secret is not None
    secret = bytes.fromhex(data.secret)
    return tuple(seed(secret, data.protocol_hash, "ranked", i) for i in range(data.protocol.ranked))


def _people(reader: Reader, data: StudyData) -> dict[str, Any] | None:
    figure = live_figure(data)
    if not figure["players"]:
        return None
    cohort = people_of(data)
    rules = data.protocol.exclusion.get(figure["set"], {})
    ranked = [cohort.ranked[person] for person in members(cohort, rules)]
    groups = [
        [
            EpisodeSummary(each.outcome or "", each.score or 0.0, each.steps_to_99 or 0, (), ())
            for each in own
        ]
        for own in ranked
    ]
    completed = float(
        np.mean([np.mean([each.outcome == "explored" for each in own]) for own in groups])
    )
    pictures = summarize_groups(reader, data, synthetic=False).get("people", {})
    plain = {name: figure[name] for name in ("set", "players", "episodes", "score", "steps")}
    likeness = human_likeness(reader, data, cohort, members(cohort, rules))
    shown = {"completed": completed, "curve": None, "visits": None, **pictures}
    return {**plain, **shown, "trials": trial_summaries(groups), "likeness": likeness}
