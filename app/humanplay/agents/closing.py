"""The end of an evaluation.

What runs is abandoned, and the terrains of its study are revealed.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from humanplay.agents.evaluation import (
    ACTIVE_MS,
    Evaluation,
    EvaluationError,
    actions_of,
    attempts_of,
    cards_of,
    changing,
    end_attempt,
    find_evaluation,
    looking,
    simulate_episode,
)
from humanplay.agents.receipts import compared_policies
from humanplay.db.store import Store, StoreError
from humanplay.release.signing import signing_key
from humanplay.study.closing import note_closed
from humanplay.study.files import now_ms
from humanplay.study.folder import Folder
from humanplay.task import counted


def check_closable(database: Path, evaluation: Evaluation, now: bool) -> None:
    """Check that an evaluation can be closed and its receipts written.

    Args:
        now: Whether it may be closed although an agent is at it.

    Raises:
        EvaluationError: If an agent is at it, or its study runs.
        ReleaseError: If there is no key.
        PolicyError: If the file of a policy is lost.
    """
    signing_key(database)
    protocol = evaluation.protocol
    for policy in compared_policies(protocol):
        protocol.environment.policies.load(
            evaluation.policy_files.source(policy), protocol.env_config
        )
    if evaluation.closed_ms is not None:
        return
    study = evaluation.study
    if study is not None and study.is_running:
        raise EvaluationError(
            f"people still play these terrains in the study {study.name!r}: close that first, with --keep-secret"
        )
    with looking(database) as conn:
        cards = cards_of(conn, evaluation.name)
        active = 0
        for card in cards:
            moved_ms, attempts = card.moved_ms or 0, attempts_of(conn, card.id)
            has_left = card.closed_ms or card.revoked_ms or not evaluation.is_open
            ended = sum(attempt.ended_ms is not None for attempt in attempts)
            is_done = has_left or ended == protocol.instances
            active += not is_done and now_ms() - moved_ms < ACTIVE_MS
    if active and not now:
        raise EvaluationError(
            f"{counted(active, 'agent has', 'agents have')} moved in {evaluation.name!r} within the last ten minutes: nothing "
            "was closed; wait until they have finished, or close it now (--now), which abandons their attempts"
        )


def close_evaluation(database: Path, folder: Folder, name: str) -> None:
    """Close an evaluation, and abandon the attempts that run where they stand.

    A closed evaluation stays as it is.
    """
    with changing(database) as conn:
        evaluation = find_evaluation(conn, folder, name)
        if evaluation.closed_ms is not None:
            return
        at_ms = now_ms()
        for card in cards_of(conn, name):
            for attempt in attempts_of(conn, card.id):
                if attempt.ended_ms is None:
                    number = evaluation.seed(attempt.instance)
                    came_to = simulate_episode(
                        evaluation.protocol, number, actions_of(conn, attempt.id)
                    )
                    end_attempt(conn, attempt.id, at_ms, came_to)
        sql = "UPDATE agents_evaluations SET closed_ms = ? WHERE name = ?"
        conn.execute(sql, (at_ms, name))


def reveal_study(database: Path, folder: Folder, evaluation: Evaluation) -> None:
    """Reveal the secret of the study whose terrains were played.

    It is noted in the database, unless a server has it open: then the server notes it.
    """
    study = evaluation.study
    if study is None or not study.is_open:
        return
    revealed = folder.close(study.name)
    try:
        with closing(Store(database)) as store:
            note_closed(store, revealed)
    except StoreError:
        pass  # a server has it open, and notes it itself
