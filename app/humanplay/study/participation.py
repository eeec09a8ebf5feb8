"""What a study asks of every move of its participants (see `humanplay.board.session.Participation`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from humanplay.board.controls import ClockLimits
from humanplay.board.participation import RefusedError, StudyUnavailableError
from humanplay.board.sources import Sources
from humanplay.db.rows import PlayerSettings
from humanplay.db.series import StudyStore
from humanplay.db.study_rows import Participant
from humanplay.study.arms import reach_stage
from humanplay.study.asking import due_blocks
from humanplay.study.flow import STOPPED
from humanplay.study.folder import Folder, Study, StudyError
from humanplay.study.invitations import Invitations
from humanplay.study.outcome import Outcome
from humanplay.study.practice import has_passed

CLOSED_MESSAGE = "the study {!r} is closed: nobody can take part or go on any more"


class StageError(Exception):
    """What was asked for does not fit where the participant or the study stands; nothing has changed."""


class StudyParticipation:
    """The participation of one participant; the study is looked up at every move, so that closing it shows at once."""

    def __init__(
        self,
        participant: Participant,
        folder: Folder,
        study_store: StudyStore,
        sources: Sources,
        invitations: Invitations,
    ) -> None:
        self._participant, self._folder, self._study_store = participant, folder, study_store
        self._clock, self._invitations = sources.clock_ms, invitations
        self.driver, self.study = participant.kind, participant.study

    def is_erased(self) -> bool:
        """Whether the participant was erased meanwhile."""
        return not self._study_store.is_participant(self._participant.id)

    def hides_scores(self, episode_id: str) -> bool:
        """Return whether the episode is ranked and the participant has not come to the debrief."""
        found = self._study_store.phase_and_stage(episode_id)
        phase, stage = found or ("", "")
        return phase == "ranked" and (stage not in ("debrief", "complete") or self._is_asked())

    def is_secret(self, episode_id: str) -> bool:
        """Whether the episode is a ranked one of a study that is not closed."""
        found = self._study_store.phase_and_stage(episode_id)
        return found is not None and found[0] == "ranked" and self._study().is_open

    def check_open(self) -> None:
        """Check that the study is open; RefusedError when it is not."""
        if not self._study().is_running:
            raise RefusedError(CLOSED_MESSAGE.format(self._participant.study))

    @property
    def clock_limits(self) -> ClockLimits:
        """Return what the protocol allows an episode in time, where a clock runs."""
        return self._study().protocol.clock_limits

    def note_script(self, episode_id: str) -> None:
        """Note the deviation: a script moved where a person was at the controls."""
        sentence = "A program moved in an episode that a person had begun."
        detail = {"sentence": sentence, "episode": episode_id}
        self._study_store.add_stage_event(self._participant.id, self._clock(), "deviation", detail)

    def note_stopped(self, episode_id: str) -> None:
        """Note that the board stood still for longer than the protocol allows."""
        detail = {"episode": episode_id}
        self._study_store.add_stage_event(self._participant.id, self._clock(), STOPPED, detail)

    def note_end(self) -> None:
        """Move the participant on when the last episode of the stage has ended: warm-up to ranked, ranked to debrief.

        A warm-up that does not pass the practice begins again, or ends the study for them.
        """
        study = self._study()
        protocol = study.protocol
        participant = self._study_store.participant(self._participant.id)
        now, trials = self._clock(), self._study_store.trials(participant.id)
        ended = Counter(trial.phase for trial in trials if trial.ended_ms is not None)
        if participant.stage == "warm_up" and ended["warm_up"] >= protocol.warm_up:
            passed = True if protocol.practice is None else has_passed(protocol, trials)
            if passed is False and protocol.practice and protocol.practice.then == "screen_out":
                failed = Outcome.FAILED_PRACTICE
                self._study_store.withdraw(participant, now, outcome=failed)
            elif passed is not None:
                with self._available():
                    reach_stage(
                        self._study_store, study, participant, now, "ranked", self._invitations
                    )
        elif participant.stage == "ranked" and ended["ranked"] >= protocol.ranked:
            self._study_store.set_stage(participant.id, now, "debrief", completed_ms=now)

    def check_events(self, episode_id: str) -> None:
        """Check that input events of an episode are to be kept; RefusedError for any that is none of the participant's."""
        self.check_open()
        if not self._study_store.has_trial(self._participant.id, episode_id):
            what = f"episode {episode_id!r} is none of this participant's"
            raise RefusedError(f"{what}: no input events were kept")

    def settings(self) -> list[PlayerSettings]:
        """Return what the participant has chosen, every version so far."""
        return self._study_store.settings(self._participant.id)

    def supervised_ms(self) -> tuple[int, ...]:
        """Return when the operator's code was typed for the participant; empty when it never was."""
        return self._study_store.supervised_ms(self._participant.id)

    def _is_asked(self) -> bool:
        """Whether questions come before the debrief, which no score is to colour."""
        participant = self._study_store.participant(self._participant.id)
        trials = self._study_store.trials(participant.id)
        return bool(due_blocks(self._study_store, self._study(), participant, trials))

    def _study(self) -> Study:
        with self._available():
            return self._folder.study(self._participant.study)

    @contextmanager
    def _available(self) -> Iterator[None]:
        """Say of files that cannot be read that the study cannot go on now."""
        try:
            yield
        except StudyError as error:
            raise StudyUnavailableError(
                f"the study {self._participant.study!r} cannot go on now; tell whoever invited you"
            ) from error


class Participations:
    """Finds the participation that a session belongs to; a lobby asks it when it resumes a session."""

    def __init__(
        self,
        folder: Folder,
        study_store: StudyStore,
        sources: Sources,
        invitations: Invitations | None = None,
    ) -> None:
        self._folder, self._study_store, self._sources = folder, study_store, sources
        self._invitations = invitations or Invitations(folder)

    def of_session(self, session_id: str) -> StudyParticipation | None:
        """Return the participation at a session; None when it is no participant's board."""
        participant = self._study_store.participant_of_session(session_id)
        return None if participant is None else self.of(participant)

    def of(self, participant: Participant) -> StudyParticipation:
        """Return the participation of a participant."""
        files = self._folder, self._study_store, self._sources, self._invitations
        return StudyParticipation(participant, *files)
