"""A study's report made from a database.

Its data are read, episodes replayed, policies played on the same terrains, and moves analysed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from humanplay.db.reader import Reader
from humanplay.db.series import find_study, participants
from humanplay.db.study_rows import is_same_study
from humanplay.db.trial import LEFT
from humanplay.report.build import build
from humanplay.report.costs import CostSummary, ProgressBar, cost_cache, costs_of_people
from humanplay.report.model import PolicyRun, Report
from humanplay.report.page import pages
from humanplay.report.statistics.summaries import (
    Pictures,
    curve_and_visits,
    summarize_groups,
    summary_of,
)
from humanplay.study.closing import UNNOTED
from humanplay.study.data import StudyData, load
from humanplay.study.flow import with_invitations
from humanplay.study.folder import SECRET_KEPT, Folder
from humanplay.study.invitations import Invitations
from humanplay.study.policy_episodes import PolicyEpisode, compared_policies, play_policies
from humanplay.study.policy_files import FOLDER
from humanplay.study.protocol import Protocol, StudyError

REPORT_STEMS = {False: "report", True: "report-synthetic"}
"""How the files of a report in a release begin: of the people, and of the scripts."""


def make_study_report(
    database: Path,
    folder: Folder,
    name: str,
    bar: ProgressBar,
    synthetic: bool = False,
    with_policies: bool = True,
    with_moves: bool = True,
) -> Report:
    """The report of a study in a database and in the folder of studies.

    It has policies only if somebody has finished a ranked episode, and costs only once the study is
    closed.

    Raises:
        StudyError: As `load_with_folder`.
        Exception: As `policies.load` for a policy that cannot be loaded.
    """
    with closing(Reader.open(database)) as reader:
        with reader.snapshot():
            data, seeds = load_with_folder(reader, folder, name)
            data = data.shown()
            pictures = _pictures(reader, data, synthetic, bar)
        is_played, names = has_played(data, synthetic), compared_policies(data.protocol)
        episodes = play_compared(data, seeds, names, bar) if with_policies and is_played else ()
        costs: Mapping[str, CostSummary] = {}
        if with_moves and is_played and not synthetic and data.closed_ms is not None:
            costs = costs_of_people(reader, data, bar, cost_cache(database))
    return _built(data, episodes, synthetic, pictures, costs)


def make_report(
    reader: Reader,
    data: StudyData,
    episodes: Sequence[PolicyEpisode],
    synthetic: bool,
    bar: ProgressBar,
    costs: Mapping[str, CostSummary] | None = None,
) -> Report:
    """The report of a study's people or scripts beside the policies' episodes.

    Args:
        costs: By group's name.
    """
    return _built(data, episodes, synthetic, _pictures(reader, data, synthetic, bar), costs)


def _pictures(
    reader: Reader, data: StudyData, synthetic: bool, bar: ProgressBar
) -> dict[str, Pictures]:
    with bar("replaying episodes") as advance:
        return summarize_groups(reader, data, synthetic, advance)


def _built(
    data: StudyData,
    episodes: Sequence[PolicyEpisode],
    synthetic: bool,
    pictures: Mapping[str, Pictures],
    costs: Mapping[str, CostSummary] | None,
) -> Report:
    runs = runs_of(episodes, data.protocol) if has_played(data, synthetic) else ()
    return build(data, runs, synthetic, pictures, costs)


def report_files(report: Report) -> dict[str, bytes]:
    """Name -> content of the files of a report in a release."""
    stem = REPORT_STEMS[report.synthetic]
    files = {name: page.encode() for name, page in pages(report, f"{stem}.html").items()}
    return {f"{stem}.json": (report.to_json() + "\n").encode(), **files}


def has_played(data: StudyData, synthetic: bool) -> bool:
    """Whether a person (a script, when synthetic) has finished a ranked episode."""
    ended = {t.kind for t in data.trials if t.phase == "ranked" and t.ended_ms is not None}
    return ("script" if synthetic else "human") in ended


def play_compared(
    data: StudyData, seeds: Mapping[int, int], names: Sequence[str], bar: ProgressBar
) -> tuple[PolicyEpisode, ...]:
    """Play the policies on the terrains of these seeds now.

    Raises:
        Exception: As `play_policies`.
    """
    with bar("policies on the same instances") as advance:
        environment, config = data.protocol.environment, data.protocol.env_config
        return play_policies(names, environment, config, seeds, advance, data.policy_files)


def runs_of(episodes: Sequence[PolicyEpisode], protocol: Protocol) -> tuple[PolicyRun, ...]:
    """One run per policy from its episodes, which are replayed.

    A failure counts as it does for people.
    """
    by_policy: dict[str, dict[int, PolicyEpisode]] = {}
    for episode in episodes:
        by_policy.setdefault(episode.policy, {})[episode.terrain] = episode
    return tuple(_run(name, by_terrain, protocol) for name, by_terrain in by_policy.items())


def _run(name: str, episodes: Mapping[int, PolicyEpisode], protocol: Protocol) -> PolicyRun:
    environment, config, terrains = protocol.environment, protocol.env_config, protocol.ranked
    score, steps = np.full(terrains, np.nan), np.full(terrains, np.nan)
    outcomes, groups = [""] * terrains, []
    lowest, _ = environment.bounds(config)
    for index, episode in sorted(episodes.items()):
        run = episode.replay(environment, config)
        record = run.record()
        outcomes[index], score[index] = record.outcome, record.score
        if record.outcome in LEFT and np.isfinite(lowest):
            score[index] = lowest
        steps[index] = record.steps if record.outcome in environment.successes else config.limit
        groups.append([summary_of(environment, run)])
    return PolicyRun(name, score, steps, tuple(outcomes), curve_and_visits(config, groups))


def load_with_folder(reader: Reader, folder: Folder, name: str) -> tuple[StudyData, dict[int, int]]:
    """A study's data, and the seeds of its ranked terrains by index.

    If the folder has the study, it gives every seed and says whether the study is closed; otherwise
    the seeds are those of terrains that somebody has begun. A study that nobody has joined is known
    from the folder alone.

    Raises:
        StudyError: If the study is in neither, or there are two different ones of that name.
    """
    study = folder.study(name) if name in folder.names() else None
    policies = folder.root / name / FOLDER
    row = find_study(reader, name)
    joined = row is not None
    if (study is not None and study.keeps_secret) or (
        study is None
        and row is not None
        and row.secret_kept_ms is not None
        and row.closed_ms is None
    ):
        raise StudyError(SECRET_KEPT.format(name))
    if study is None:
        data = load(reader, name).with_policies_in(policies)
        return data, data.seeds()
    if joined:
        data = load(reader, name)
    else:
        data = StudyData(
            protocol=study.protocol,
            protocol_hash=study.protocol_hash,
            commitment=study.commitment,
            frozen_ms=study.frozen_ms,
            closed_ms=None,
            secret=None,
            people=(),
            trials=(),
            policy_files=study.policy_files,
        )
    if not is_same_study(data, study):
        raise StudyError(
            f"the study {name!r} in {reader.path} is another one than that in {folder.root}: put that of this database there"
        )
    if study.protocol.recruitment == "invitation":
        opened = [p.invitation for p in participants(reader, name) if p.invitation is not None]
        arrivals = with_invitations(data.arrivals, Invitations(folder).of(name), opened)
        data = replace(data, arrivals=arrivals)
    if study.closed_ms is not None:
        if data.closed_ms is None and any(trial.ended_ms is None for trial in data.trials):
            raise StudyError(UNNOTED.format(name, reader.path))
        data = replace(data, closed_ms=study.closed_ms, secret=study.secret.hex())
    data = data.with_policies_in(policies)
    return data, {i: study.seed("ranked", i) for i in range(study.protocol.ranked)}
