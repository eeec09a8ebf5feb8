"""What requests may reach: one typed object for each running server."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from humanplay.board.lobby import Lobby
from humanplay.board.ranked import PageBoards
from humanplay.board.sources import PlayerTokens
from humanplay.board.spectators import Replayer, Spectators
from humanplay.db.store import Store
from humanplay.jobs import Jobs
from humanplay.results.daily import DailyBoards
from humanplay.results.daily_table import DailyPolicies
from humanplay.results.leaderboard import Leaderboard
from humanplay.results.people import PeopleBoard
from humanplay.study.debrief import Debriefs
from humanplay.study.progress import ParticipantProgress
from humanplay.task import View3D
from humanplay.web.downloads import Downloads
from humanplay.web.operator.health import Health
from humanplay.web.operator.services import AdminServices
from humanplay.web.replays.service import Replays


@dataclass(frozen=True)
class Services:
    """The parts of one server, from its start to its end.

    store          the database that every move is recorded in
    jobs           what takes long, in processes beside this one
    downloads      the files that are made for somebody and sent
    lobby          the sessions
    page_boards    begins the boards of the page's players, and ends the ranked ones that are left
    replayer       plays stored episodes again
    spectators     what anybody may watch
    daily_boards   today's terrain, and the boards on which players attempt it
    daily_policies the shipped policies on daily terrains
    viewer         the 3-D view of the sessions; None if there is none
    player_tokens  signs and reads players' ids
    progress       the participants of the studies
    debriefs       what participants are shown at the end
    leaderboard    people and policies compared
    people         the people's board; None if the task has none
    replays        finished episodes as they went, and policies on their terrains
    health         the state of the disk and the database
    admin          the operator's part; None on a server without an operator's page
    asks_name      whether whoever comes chooses a name before the first episode
    """

    store: Store
    jobs: Jobs
    downloads: Downloads
    lobby: Lobby
    page_boards: PageBoards
    replayer: Replayer
    spectators: Spectators
    daily_boards: DailyBoards
    daily_policies: DailyPolicies
    viewer: View3D | None
    player_tokens: PlayerTokens
    progress: ParticipantProgress
    debriefs: Debriefs
    leaderboard: Leaderboard
    people: PeopleBoard | None
    replays: Replays
    health: Health
    admin: AdminServices | None = None
    asks_name: bool = False

    async def aclose(self) -> None:
        """End everything but the store, which whoever opened it closes."""
        self.daily_policies.close()
        await asyncio.to_thread(self.health.stop)
        await asyncio.to_thread(self.jobs.close)
        await asyncio.to_thread(self.downloads.close)
        self.replayer.close()
        self.lobby.close()
        if self.viewer is not None:
            self.viewer.close()
