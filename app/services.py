"""What requests may reach: one typed object for each running server."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Any

from app.admin.health import Health
from app.admin.services import AdminServices
from app.daily import DailyPolicies
from app.jobs import Jobs
from app.leaderboard.leaderboard import Leaderboard
from app.play.daily import DailyBoards
from app.play.lobby import Lobby
from app.play.ranked import PageBoards
from app.play.sources import PlayerTokens
from app.play.spectators import Spectators
from app.replay.service import Replays
from app.storage.store import Store
from app.study.debrief import Debriefs
from app.study.progress import ParticipantProgress


@dataclass(frozen=True)
class Services:
    """The parts of one server, from its start to its end.

    store          the database that every move is recorded in
    jobs           what takes long, in processes beside this one
    lobby          the sessions
    page_boards    begins the boards of the page's players, and ends the ranked ones that are left
    spectators     what anybody may watch
    daily_boards   today's terrain, and the boards on which players attempt it
    daily_policies the shipped policies on daily terrains
    viewer         the 3-D view of the sessions: its `page`, `serve(websocket, session)` and `close()`
    player_tokens  signs and reads players' ids
    progress       the participants of the studies
    debriefs       what participants are shown at the end
    leaderboard    people and policies compared
    replays        finished episodes as they went, and policies on their terrains
    health         the state of the disk and the database
    admin          the operator's part; None on a server without an operator's page
    """

    store: Store
    jobs: Jobs
    lobby: Lobby
    page_boards: PageBoards
    spectators: Spectators
    daily_boards: DailyBoards
    daily_policies: DailyPolicies
    viewer: Any
    player_tokens: PlayerTokens
    progress: ParticipantProgress
    debriefs: Debriefs
    leaderboard: Leaderboard
    replays: Replays
    health: Health
    admin: AdminServices | None = None

    async def aclose(self) -> None:
        """End everything but the store, which whoever opened it closes."""
        self.daily_policies.close()
        await asyncio.to_thread(self.jobs.close)
        if self.admin is not None:
            await asyncio.to_thread(self.admin.exports.close)
        self.lobby.close()
        self.viewer.close()
