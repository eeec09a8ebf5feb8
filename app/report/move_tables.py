"""The tables of where players lose moves, and of how much they move like the policies."""

from __future__ import annotations

from dataclasses import dataclass

from app.moves.analysis import MoveAnalysis
from app.moves.likeness import Likeness
from app.moves.regret import RegretSummary
from app.report.page_table import PageTable
from app.statistics.formatting import NONE, interval, number, percent


@dataclass(frozen=True)
class MoveTables:
    """None where there is nothing to show."""

    regret: PageTable | None
    by_tenth: PageTable | None
    players: PageTable | None
    likeness: PageTable | None


def move_tables(moves: MoveAnalysis) -> MoveTables:
    """Return the tables of a group's moves."""
    found = moves.regret
    return MoveTables(
        regret=_regret(found) if found else None,
        by_tenth=_by_tenth(found) if found else None,
        players=_players(found) if found else None,
        likeness=_likeness(moves.likeness) if moves.likeness else None,
    )


def _regret(found: RegretSummary) -> PageTable:
    """Return the mean regret per episode and the share of each kind of loss."""
    rows = [
        ("mean regret per episode, moves", number(found.mean, 1)),
        ("its 95 % interval over players", interval(found.interval, 1)),
        (f"{found.policy}\u2019s own on the same terrains", number(found.policy_mean, 1)),
        *((f"share: {kind}", percent(share)) for kind, share in found.by_kind.items()),
    ]
    return PageTable(
        f"Regret over {len(found.by_player)} players, {found.episodes} episodes",
        ("quantity", "value"),
        rows,
    )


def _by_tenth(found: RegretSummary) -> PageTable:
    rows = [
        (f"{10 * tenth} to {10 * tenth + 10} %", number(moves, 1))
        for tenth, moves in enumerate(found.by_tenth)
    ]
    return PageTable(
        "Mean regret of an episode, by what was known before the move",
        ("cells known", "moves lost"),
        rows,
    )


def _players(found: RegretSummary) -> PageTable:
    rows = [
        (
            each.player,
            str(each.episodes),
            number(each.mean, 1),
            *(number(moves, 1) for moves in each.by_kind.values()),
        )
        for each in found.by_player
    ]
    return PageTable(
        "Each player\u2019s mean regret per episode",
        ("player", "episodes", "regret", *found.by_kind),
        rows,
    )


def _likeness(rows: tuple[Likeness, ...]) -> PageTable:
    """Return a row for each player, a column for each policy."""
    policies = sorted({each.policy for each in rows})
    found = {(each.participant, each.policy): each for each in rows}
    players = sorted({each.participant for each in rows})
    cells = [
        (player, *(_share(found.get((player, policy))) for policy in policies))
        for player in players
    ]
    return PageTable(
        caption="Share of each player\u2019s ranked moves that a policy would have made too",
        heads=("player", *policies),
        rows=cells,
    )


def _share(likeness: Likeness | None) -> str:
    return NONE if likeness is None else percent(likeness.share, 1)
