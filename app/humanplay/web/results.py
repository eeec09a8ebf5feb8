"""Results over HTTP: what has been played, how well, and by whom.

They are everybody's, a player's own, and people and policies compared.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated, Literal

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import Response

from humanplay.board.participation import HUMAN
from humanplay.db.export import ExportTable, write_human_scores, write_table
from humanplay.db.reader import Best, Reader
from humanplay.db.trial import Trial
from humanplay.db.volunteers import Sums, player_sums, players_of
from humanplay.report.costs import cost_cache
from humanplay.report.statistics.human_level import LEAST_EPISODES
from humanplay.report.statistics.human_level import HumanLevel as Figures
from humanplay.results.leaderboard import UnknownEntryError
from humanplay.results.people import PeopleBoard
from humanplay.study.policy_files import PolicyFiles
from humanplay.task import Configuration, PolicyError, Record, place_of
from humanplay.task.registration import environment_of
from humanplay.web.access import owner_of, player_of, services_of
from humanplay.web.answers.leaderboard import HumanLevel, LeaderboardEntry
from humanplay.web.answers.leaderboard import Leaderboard as LeaderboardAnswer
from humanplay.web.answers.replays import EpisodeCosts
from humanplay.web.answers.results import CSV, ZIP, Episode, ListedEpisode, OwnHistory

router = APIRouter(prefix="/api")
mine = APIRouter(prefix="/api/me", tags=["me"])
"""A player's own episodes: by their cookie alone, so nobody sees anybody else's."""
leaderboard = APIRouter(prefix="/api/leaderboard", tags=["results"])
Who = Literal["all", "human"]
COSTS_S = 120.0
"""Seconds that the costs of one episode may take."""
UNKNOWN = "no finished episode {!r}; GET /api/episodes lists them"


@contextmanager
def _reader(request: Request) -> Iterator[Reader]:
    """Yield a read-only connection for one request.

    Long queries run in a thread and delay no move.
    """
    database, at_ms = _database_now(request)
    with closing(Reader.open(database, public=True, at_ms=at_ms)) as reader:
        yield reader


def _database_now(request: Request) -> tuple[Path, int]:
    """The path of the database, and the time by the server's clock."""
    services = services_of(request)
    return services.store.path, services.lobby.sources.clock_ms()


@router.get(
    "/human-level",
    response_model=HumanLevel,
    response_model_exclude_unset=True,
    tags=["results"],
    summary="How well this playground's volunteers play: no human level",
)
def get_human_level(request: Request) -> Figures:
    """Return one figure per configuration, from ranked episodes.

    Those are alone, on terrains that were neither chosen nor met before.

    Volunteers select themselves: this is no human level, which is a closed study's figure. The
    means are over the players in `entering`, who have five episodes each; they are null while
    `missing` says how many of the five such players are missing. Each weighs the same, the interval
    is the report's, and `abandoned` says how many of all `episodes` were left.
    """
    with _reader(request) as reader:
        return services_of(request).leaderboard.volunteers.human_level(reader)


@router.get(
    "/episodes",
    response_model=list[ListedEpisode],
    response_model_exclude_unset=True,
    tags=["results"],
    summary="Finished episodes",
)
def get_episodes(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=200)] = 100,
    after: Annotated[str | None, Query(max_length=128)] = None,
    who: Who = "all",
) -> list[dict[str, object]]:
    """List finished episodes, the newest first.

    `who=human` lists those that count. `after` is the id of the last episode of the page before;
    404 where there is no such finished episode any more.
    """
    with _reader(request) as reader:
        try:
            return reader.episodes(limit, after, who)
        except LookupError as error:
            raise HTTPException(404, str(error)) from error


@router.get(
    "/episodes/{episode_id}",
    response_model=Episode,
    response_model_exclude_unset=True,
    tags=["results"],
    summary="One finished episode: seed, actions, times",
)
def get_episode(request: Request, episode_id: str) -> dict[str, object]:
    """Return a finished episode.

    404 while it runs, because its seed gives the terrain away. 404 as well for one of an open
    study, and for one of a daily terrain before its day is over, whoever asks.
    """
    with _reader(request) as reader:
        episode = reader.episode(episode_id)
    if episode is None:
        raise HTTPException(404, UNKNOWN.format(episode_id))
    return episode


@router.get(
    "/episodes/{episode_id}/costs",
    response_model=EpisodeCosts,
    tags=["results"],
    summary="What the moves of a finished episode cost",
)
async def get_costs(request: Request, episode_id: str) -> dict[str, object]:
    """Return the episode beside the expert's, and its greatest mistakes.

    For each move it says what the expert would have done. docs/evaluation.md says what a cost is.

    Each mistake has what the environment says of it. Where no move is judged, `reason` says why.
    404 as for the episode itself; 503 when too many ask.
    """
    record = await asyncio.to_thread(_public_record, request, episode_id)
    return {"episode": episode_id, **await costs_of(request, record)}


async def costs_of(
    request: Request, record: Record, files: PolicyFiles | None = None
) -> dict[str, object]:
    """What the moves of an episode cost that the asker may see.

    Args:
        files: Of the study that the episode is of; None: the shipped ones.

    Raises:
        HTTPException: If that cannot be said.
    """
    services = services_of(request)
    task = services.lobby.task
    courses, expert = task.courses, task.expert
    if courses is None or expert is None:
        raise HTTPException(422, f"moves of {task.about.title} are not judged")
    cache, owner = cost_cache(services.store.path), owner_of(request)
    try:
        try:
            source = expert if files is None else files.expert(expert)
        except PolicyError as error:
            return {"policy": expert, **courses.explain_without_costs(record, str(error))}
        cause = (record.config.hash, record.terrain, record.trajectory_hash, record.outcome)
        costs = await services.jobs.run(
            courses.explain,
            cache,
            record,
            source,
            owner=owner,
            key=("costs", source, *cause),
            limit_s=COSTS_S,
        )
        return {"policy": expert, **costs}
    except ValueError as error:
        raise HTTPException(422, str(error)) from error


def _public_record(request: Request, episode_id: str) -> Record:
    """The cause of a finished episode that the asker may see.

    Raises:
        HTTPException: 404 otherwise.
    """
    with _reader(request) as reader:
        if reader.trial(episode_id) is None:
            raise HTTPException(404, UNKNOWN.format(episode_id))
        return reader.load_record(episode_id)


@router.get(
    "/export/{table}.csv",
    response_class=Response,
    responses=CSV,
    tags=["results"],
    summary="Everything finished, as CSV",
)
async def export(request: Request, table: ExportTable, who: Who = "all") -> Response:
    """Export every finished episode under pseudonyms.

    `who=human` exports those that count. 503 with Retry-After while another table of the same
    address is being written. Two are written at a time; others wait.
    """
    return await _sent(request, f"{table}.csv", table, who)


@router.get(
    "/export/human-scores.zip",
    response_class=Response,
    responses=ZIP,
    tags=["results"],
    summary="The human-score data set",
)
async def export_human_scores(request: Request) -> Response:
    """Export the episodes and moves of people that count.

    They are two CSV files in a ZIP with their datasheet; 503 as for a table.
    """
    database, at_ms = _database_now(request)
    downloads = services_of(request).downloads
    asked = "human-scores.zip", write_human_scores, database, at_ms
    return await downloads.answer(owner_of(request), *asked)


def describe_own(trial: Trial, expert_moves: int | None = None) -> dict[str, object]:
    """An episode of a player's own list.

    `kind` is "daily", "ranked" or "practice"; `counts` says whether a ranked one enters the
    volunteers' figures.
    """
    return {
        "episode": trial.id,
        "kind": _kind(trial),
        "counts": trial.counts,
        "day": trial.day,
        "place": place_of(trial.environment, trial.config),
        "outcome": trial.outcome,
        "moves": trial.steps,
        "coverage": trial.coverage,
        "score": trial.score,
        "ended_ms": trial.ended_ms,
        "not_attested": trial.attestation_reason,
        "met_before": trial.terrain_met_before,
        "expert_moves": expert_moves,
    }


def _kind(trial: Trial) -> str:
    if trial.day:
        return "daily"
    is_practice = trial.assisted or trial.seed_chosen or trial.driver != HUMAN
    return "practice" if is_practice else "ranked"


def _compared(trials: Sequence[Trial], board: PeopleBoard | None) -> tuple[dict[str, int], int]:
    """A player's ranked episodes beside the expert.

    Returns:
        The expert's moves by the episode's id, and on how many more of the terrains it has yet to
        drive.
    """
    if board is None:
        return {}, 0
    ranked = [
        (trial.id, trial.seed)
        for trial in trials
        if _kind(trial) == "ranked" and trial.config_hash == board.config_hash
    ]
    seeds = {episode: seed for episode, seed in ranked if seed is not None}
    moves = board.expert_moves(list(seeds.values()))
    counts = {episode: moves.get(seed) for episode, seed in seeds.items()}
    expert = {episode: count for episode, count in counts.items() if count is not None}
    return expert, sum(seed not in moves for seed in seeds.values())


def personal_bests(reader: Reader, player: str) -> list[dict[str, object]]:
    """Describe what a player has played by configuration, the most played first."""
    return [_figure(reader, player, best) for best in reader.bests_of(player)]


def _figure(reader: Reader, player: str, played: Best) -> dict[str, object]:
    """Describe one configuration.

    `people` places the player's ranked episodes among the volunteers'.
    """
    config = played.config
    return {
        "place": place_of(environment_of(played.task), config),
        "max_steps": config.limit,
        "episodes": played.episodes,
        "successes": played.successes,
        "best": None if played.best is None else describe_own(played.best),
        "people": _standing(reader, config, player),
    }


def _standing(reader: Reader, config: Configuration, player: str) -> dict[str, object]:
    """Volunteers' mean moves, sorted and without names, and the player's own.

    A mean is of LEAST_EPISODES ranked episodes that count, or more; `you` is None while `missing`
    are missing.
    """
    of_player = player_sums(reader, config.hash, player)
    ranked = 0 if of_player is None else of_player.episodes
    missing = max(0, LEAST_EPISODES - ranked)
    entering = [sums for sums in players_of(reader, config.hash) if sums.episodes >= LEAST_EPISODES]
    return {
        "means": sorted(_mean_steps(sums) for sums in entering),
        "you": None if of_player is None or missing else _mean_steps(of_player),
        "ranked": ranked,
        "missing": missing,
    }


def _mean_steps(sums: Sums) -> float:
    return round(sums.steps / sums.episodes, 1)


@mine.get("/history", response_model=OwnHistory, summary="My own episodes and bests")
def get_own_history(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    after: Annotated[str | None, Query(max_length=128)] = None,
) -> dict[str, object]:
    """Return what you have driven, the newest first.

    Per configuration there are your best and your place among the volunteers. It goes by your
    cookie alone; without one everything is empty. Episodes of open studies are left out. `after` is
    the id of the last episode of the page before; 404 where there is no such episode of yours.
    """
    player_id = player_of(request)
    if player_id is None:
        return {"total": 0, "episodes": [], "bests": [], "comparing": 0}
    with closing(Reader.open(services_of(request).store.path, public=True)) as reader:
        try:
            shown = reader.played_by(player_id, limit, after)
        except LookupError as error:
            raise HTTPException(
                404, f"no episode {after!r} of yours to go on after; begin without one"
            ) from error
        played = reader.bests_of(player_id)
        expert, comparing = _compared(shown, services_of(request).people)
        return {
            "total": sum(best.episodes for best in played),
            "comparing": comparing,
            "episodes": [describe_own(trial, expert.get(trial.id)) for trial in shown],
            "bests": [_figure(reader, player_id, best) for best in played],
        }


@mine.get(
    "/export/{table}.csv",
    response_class=Response,
    responses=CSV,
    summary="My own episodes, as CSV",
)
async def export_own(request: Request, table: ExportTable) -> Response:
    """Export what you have driven, by your cookie alone.

    404 without one, 503 as for everybody's.
    """
    player_id = player_of(request)
    if player_id is None:
        raise HTTPException(
            404, "this browser has no player's cookie: nothing was played with it; play at / first"
        )
    return await _sent(request, f"my-{table}.csv", table, "all", player_id)


async def _sent(
    request: Request, name: str, table: ExportTable, who: Who, player: str | None = None
) -> Response:
    database, at_ms = _database_now(request)
    asked = database, table, who, player, at_ms
    return await services_of(request).downloads.answer(owner_of(request), name, write_table, *asked)


@leaderboard.get(
    "", response_model=list[LeaderboardEntry], summary="What people and policies are compared on"
)
async def get_boards(request: Request) -> list[dict[str, object]]:
    """List one entry per closed study and per configuration.

    What people have played stands first.
    """
    services = services_of(request)
    await services.progress.note_all_closed()
    return [entry.to_dict() for entry in await services.leaderboard.newest_entries()]


@leaderboard.get(
    "/{board}",
    response_model=LeaderboardAnswer,
    response_model_exclude_unset=True,
    summary="People, policies and rules on one scale",
)
async def get_board(request: Request, board: str, evaluate: bool = False) -> dict[str, object]:
    """Return means with 95 % intervals.

    People's are over players, policies' over held-out terrains. A policy without a figure here has
    the `state` missing; `evaluate=true` has it evaluated in the background, and its `state` is
    waiting or computing until then.
    """
    try:
        return await services_of(request).leaderboard.detail(board, evaluate)
    except UnknownEntryError as error:
        raise HTTPException(404, str(error)) from error
