"""What the operator's requests work on: login, studies, health, figures, exports."""

from __future__ import annotations

import time

from humanplay.jobs import Jobs
from humanplay.study.progress import ParticipantProgress
from humanplay.study.protocol import StudyError
from humanplay.web.answers.operator import FolderStudy
from humanplay.web.downloads import Downloads
from humanplay.web.operator import participants
from humanplay.web.operator.exports import Exports
from humanplay.web.operator.health import Health
from humanplay.web.operator.login import AdminLogin, AdminPassword


class AdminServices:
    """The operator's part of one server.

    began  monotonic seconds of the server's start
    """

    def __init__(
        self,
        password: AdminPassword,
        progress: ParticipantProgress,
        health: Health,
        jobs: Jobs,
        downloads: Downloads,
    ) -> None:
        store = progress.lobby.store
        self.progress, self.health = progress, health
        self.login = AdminLogin(password)
        self.figures = participants.LiveFigures(store.path)
        self.exports = Exports(store.path, jobs, downloads)
        self.began = time.monotonic()

    def studies(self) -> list[FolderStudy]:
        """Every study in the folder: drafts and broken ones too, with what is wrong."""
        return [self._listed(name) for name in self.progress.folder.names()]

    def _listed(self, name: str) -> FolderStudy:
        folder = self.progress.folder
        try:
            status, title = folder.status(name), folder.draft(name).title
            if status != "draft":
                folder.study(name)
        except StudyError as error:
            return FolderStudy(name=name, title=name, status="broken", error=str(error))
        return FolderStudy(name=name, title=title, status=status, error=None)
