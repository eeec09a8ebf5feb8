"""A participation at its board: what a study asks of every move on it (see `app.play.session.Participation`)."""

from __future__ import annotations

from collections.abc import Callable

from app.play.messages import Events
from app.play.session import RefusedError, StudyUnavailableError
from app.play.sources import Sources
from app.storage.study_rows import Participant
from app.study.folder import Folder, Study, StudyError
from app.study.records import Records

CLOSED = "the study {!r} is closed: nobody can take part or go on any more"


class StudyParticipation:
    """The participation of one participant; the study is looked up at every move, so that closing it shows at once."""

    def __init__(self, participant: Participant, folder: Folder, records: Records, sources: Sources) -> None:
        self._participant, self._folder, self._records = participant, folder, records
        self._clock, self._code = sources.clock_ms, sources.completion_code
        self.driver = participant.kind

    def hides_scores(self, episode_id: str) -> bool:
        """Return whether the episode is ranked and the participant has not come to the debrief."""
        return self._records.hides_scores(episode_id)

    def check_open(self) -> None:
        """Return while the study is open; RefusedError otherwise."""
        if not self._study().is_open:
            raise RefusedError(CLOSED.format(self._participant.study))

    def note_script(self, episode_id: str) -> None:
        """Note the deviation: a script moved where a person was at the controls."""
        detail = {"what": "a step that was not a person's", "episode": episode_id}
        self._records.note(self._participant.id, self._clock(), "deviation", detail)

    def note_end(self) -> None:
        """Move the participant on when the episode that has ended was the last of its stage."""
        settle(self._records, self._records.get(self._participant.id), self._study(), self._clock(), self._code)

    def keep_events(self, events: Events) -> None:
        """Keep input events of one of the participant's episodes, each once; RefusedError for any other."""
        self.check_open()
        if not self._records.owns(self._participant.id, events.episode):
            raise RefusedError(f"episode {events.episode!r} is none of this participant's: no input events were kept")
        if not self._records.add_input(events, self._clock()):
            raise RefusedError("this episode has more input events than are kept; the rest is dropped")

    def _study(self) -> Study:
        try:
            return self._folder.study(self._participant.study)
        except StudyError as error:
            raise StudyUnavailableError(
                f"the study {self._participant.study!r} cannot go on now; tell whoever invited you"
            ) from error


class Participations:
    """Finds the participation that a session belongs to; a lobby asks it when it resumes a session."""

    def __init__(self, folder: Folder, records: Records, sources: Sources) -> None:
        self._folder, self._records, self._sources = folder, records, sources

    def of_session(self, session_id: str) -> StudyParticipation | None:
        """Return the participation at a session; None when it is no participant's board."""
        participant = self._records.seated_at(session_id)
        return None if participant is None else self.of(participant)

    def of(self, participant: Participant) -> StudyParticipation:
        """Return the participation of a participant."""
        return StudyParticipation(participant, self._folder, self._records, self._sources)


def settle(records: Records, participant: Participant, study: Study, now: int, code: Callable[[], str]) -> None:
    """Move a participant on whose last episode of the stage has ended: warm-up to ranked, ranked to debrief."""
    ended = [trial.phase for trial in records.trials(participant.id) if trial.ended_ms is not None]
    protocol = study.protocol
    if participant.stage == "warm_up" and ended.count("warm_up") >= protocol.warm_up:
        records.advance(participant.id, now, "ranked")
    elif participant.stage == "ranked" and ended.count("ranked") >= protocol.ranked:
        given = protocol.completion_code or code()
        records.advance(participant.id, now, "debrief", completed_ms=now, completion_code=given)
