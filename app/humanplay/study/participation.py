"""The rules of a study for its participants' boards.

They implement `humanplay.board.participation.Participation`.
"""

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
from humanplay.task.sentences import Sentence

CLOSED_MESSAGE = Sentence(
    "refused.closed", "the study '{name}' is closed: nobody can take part or go on any more"
)
CANNOT_GO_ON = Sentence(
    "refused.cannot_go_on", "the study '{name}' cannot go on now; tell whoever invited you"
)


class StageError(Exception):
    """The participant or the study is at another stage; nothing has changed."""


class StudyParticipation:
    """The participation of one participant.

    The study is looked up at every move, so that closing it takes effect at once.
    """

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
        """Whether the episode is ranked, and the participant is not at the debrief yet."""
        phase, stage = self._study_store.phase_and_stage(episode_id) or ("", "")
        return phase == "ranked" and (stage not in ("debrief", "complete") or self._is_asked())

    def is_secret(self, episode_id: str) -> bool:
        """Whether the episode is a ranked one of a study that is not closed."""
        phase, _ = self._study_store.phase_and_stage(episode_id) or ("", "")
        return phase == "ranked" and self._study().is_open

    def check_open(self) -> None:
        """Check that the study is open; RefusedError if it is not."""
        if not self._study().is_running:
            raise RefusedError(CLOSED_MESSAGE.format(name=self._participant.study))

    @property
    def clock_limits(self) -> ClockLimits:
        """How often and how long an episode on a clock may stand still."""
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
        """Move the participant to the next stage, if the stage's last episode has ended.

        If the practice was not passed, the warm-up begins again, or the participant is screened out.
        """
        study = self._study()
        protocol = study.protocol
        participant = self._study_store.participant(self._participant.id)
        now, trials = self._clock(), self._study_store.trials(participant.id)
        ended = Counter(trial.phase for trial in trials if trial.ended_ms is not None)
        if participant.stage == "warm_up" and ended["warm_up"] >= protocol.warm_up:
            passed = True if protocol.practice is None else has_passed(protocol, trials)
            if (
                passed is False
                and protocol.practice
                and protocol.practice.if_failed == "screen_out"
            ):
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
        """Check that the participant may add input events to an episode.

        Raises:
            RefusedError: If the study is closed, or the episode is not the participant's.
        """
        self.check_open()
        if not self._study_store.has_trial(self._participant.id, episode_id):
            raise RefusedError(
                f"episode {episode_id!r} is none of this participant's: no input events were kept"
            )

    def settings(self) -> list[PlayerSettings]:
        """Every version of the settings that the participant has chosen."""
        return self._study_store.settings(self._participant.id)

    def supervised_ms(self) -> tuple[int, ...]:
        """When the operator's code was typed for the participant; empty if never."""
        return self._study_store.supervised_ms(self._participant.id)

    def _is_asked(self) -> bool:
        """Whether questions come before the debrief."""
        # scores stay hidden until they are answered, so as not to colour the answers
        participant = self._study_store.participant(self._participant.id)
        trials = self._study_store.trials(participant.id)
        return bool(due_blocks(self._study_store, self._study(), participant, trials))

    def _study(self) -> Study:
        with self._available():
            return self._folder.study(self._participant.study)

    @contextmanager
    def _available(self) -> Iterator[None]:
        """Raise StudyUnavailableError if the study's files cannot be read."""
        try:
            yield
        except StudyError as error:
            raise StudyUnavailableError(
                CANNOT_GO_ON.format(name=self._participant.study)
            ) from error


class Participations:
    """Finds a session's participation; a lobby asks it when it resumes a session."""

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
        """The participation of a session; None if it is no participant's board."""
        participant = self._study_store.participant_of_session(session_id)
        return None if participant is None else self.of(participant)

    def of(self, participant: Participant) -> StudyParticipation:
        """The participation of a participant."""
        return StudyParticipation(
            participant, self._folder, self._study_store, self._sources, self._invitations
        )
