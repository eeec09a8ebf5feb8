"""The parts of a protocol: consent, declarations, power, practice and payment."""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from humanplay.study.outcome import BEFORE_CONSENT, Outcome
from humanplay.study.questions import Part

Declared = Annotated[str, Field(max_length=2_000)]
"""An author's statement about the study."""

_NO_ANSWER = re.compile(
    r"\W*|\W*(to ?do|tb[acdns]|fixme|xxx+|to be (added|announced|confirmed|decided|defined|determined|done|stated))\b.*",
    re.IGNORECASE | re.DOTALL,
)
"""A placeholder: blank, only punctuation, or beginning with TODO, TBD or the like."""


def is_no_answer(text: str) -> bool:
    """Whether a declaration answers nothing."""
    return _NO_ANSWER.fullmatch(text) is not None


def asked(question: str) -> str:
    """A text field that a draft may leave empty, with the question it answers."""
    return Field(default="", description=question)


class Consent(Part):
    """The text that a participant agrees to."""

    version: str = Field(default="1", min_length=1, max_length=40)
    """The version of the text; give a new text a new version."""

    text: str = Field(min_length=1, max_length=20_000)
    """Paragraphs, split by blank lines."""


class Declarations(Part):
    """What only the authors know about their study, stated before anybody plays.

    A draft has the description of each above it. It may leave texts
    empty.
    """

    contact: Declared = asked(
        "Who is responsible for the data, and at which address do participants reach them?"
    )
    retention: Declared = asked("How long are the recorded moves and the platform's ids stored?")
    population: Declared = asked("Whom do the people stand for, and by which criteria?")
    sampling_frame: Declared = asked("Where are people found, and how are they picked there?")
    recruitment_criteria: Declared = asked("Who is admitted, and whom does recruitment turn away?")
    author_baseliners: Declared = asked("Do members of the team take part?")
    training_compensation: Declared = asked("What is paid for tutorial, questions and warm-up?")
    testing_compensation: Declared = asked(
        "What is paid for the ranked episodes, and by the hour, the piece or the person?"
    )
    performance_bonus: Declared = asked("What more is paid for playing well, and by which rule?")
    ethics_review: Declared = asked(
        "Which board approved or exempted the study, under which number?"
    )
    pilots: Declared = asked("Which pilots came before, and what did they change?")
    demographics: Declared = asked("What is asked of people about themselves and will be reported?")
    registration: Declared = asked("Where is the study registered publicly before anybody plays?")
    data_availability: Declared = asked(
        "Where and when will the data be published, or why will they not be?"
    )

    def unanswered(self) -> list[str]:
        """The fields whose text answers nothing."""
        return [name for name, text in self if is_no_answer(text)]


class Power(Part):
    """How likely a study is to detect the planned differences, by simulation.

    The simulated studies follow the protocol's assumptions.
    """

    arms_differ: float | None = Field(default=None, ge=0, le=1)
    """Share (0..1) of simulated studies that detect `arm_difference`.

    None if the arms are not tested.
    """

    policy_better: float | None = Field(default=None, ge=0, le=1)
    """Share (0..1) that detect a policy better than people by `policy_difference`.

    None if no policy is tested.
    """

    people_better: float | None = Field(default=None, ge=0, le=1)
    """Share (0..1) that detect a policy worse than people by `policy_difference`."""

    half_width: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """Half the mean width of the 95 % interval of the mean of people who finish.

    None if there are too few people or terrains.
    """

    studies: int = Field(ge=1)
    """How many studies were simulated."""

    @property
    def deciding_power(self) -> float | None:
        """The share for arms if they are tested, else the lower one for policies."""
        if self.arms_differ is not None:
            return self.arms_differ
        if self.policy_better is None or self.people_better is None:
            return None
        return min(self.policy_better, self.people_better)


class Practice(Part):
    """What participants must achieve in the warm-up."""

    episodes_to_pass: int = Field(ge=1, le=500)
    """How many warm-up episodes must reach `score`."""

    score: float | None = Field(default=None, allow_inf_nan=False)
    """The score to reach; None: the episode must succeed."""

    tries: int = Field(default=2, ge=1, le=10)
    """How often the whole warm-up may be played, each time on new terrains."""

    if_failed: Literal["screen_out", "go_on"] = "screen_out"
    """What follows the last failed try: people are screened out, or go on.

    If they go on, an exclusion set or the flags must have the rule `passed_practice`.
    """


Money = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
"""An amount in the currency of the payment."""


class Payment(Part):
    """What participants are paid, in one currency."""

    currency: str = Field(pattern="^[A-Z]{3}$")
    """The three letters of the currency, like EUR."""

    base: Money = 0
    """What the platform pays a participant who finishes."""

    bonus_per_unit: Money = 0
    """The bonus for each unit of the ranked episodes."""

    bonus_unit: Literal["success", "steps", "score"] = "success"
    """What earns the bonus: successes, or steps or score on one side of `bonus_threshold`."""

    bonus_threshold: float = Field(default=0, allow_inf_nan=False)
    """The steps or the score of an episode from which units count."""

    bonus_direction: Literal["more", "fewer"] = "more"
    """Whether more than `bonus_threshold` earns the bonus, or fewer."""

    rounding: float = Field(default=0.01, ge=0.01, le=1e6, allow_inf_nan=False)
    """The bonus and pay by the hour are multiples of it; itself a multiple of 0.01."""

    bonus_limit: Money | None = None
    """The highest bonus; None: no limit. The lowest bonus is 0."""

    hourly_rate: Money = 0
    """Pay per hour for a participant whom the study's operators stop."""

    outcomes: dict[Outcome, Money] = Field(default_factory=dict)
    """Outcome other than finishing -> what it is paid, as a bonus."""

    screen_out: Outcome | None = None
    """The outcome in `outcomes` that the platform itself pays as a screen-out, if any."""

    bonus_at_once: bool = False
    """Whether amounts that follow from play are listed before the study is closed."""

    @field_validator("rounding")
    @classmethod
    def _check_rounding(cls, rounding: float) -> float:
        if Decimal(str(rounding)) % Decimal("0.01"):
            raise ValueError(f"rounding must be a multiple of 0.01, got {rounding:g}")
        return rounding

    @field_validator("outcomes")
    @classmethod
    def _check_outcomes(cls, amounts: dict[Outcome, float]) -> dict[Outcome, float]:
        if Outcome.FINISHED in amounts:
            raise ValueError(
                f"outcomes must not name {Outcome.FINISHED}: a participant who finishes gets base and the bonus"
            )
        return amounts

    @model_validator(mode="after")
    def _check_paid_are_known(self) -> Payment:
        unknown = BEFORE_CONSENT & self.outcomes.keys() - {self.screen_out}
        if unknown:
            raise ValueError(
                f"outcomes pays for {min(unknown)}, but nothing is stored about people before their consent, so nobody could "
                "pay them: name an outcome after the consent, or make it screen_out, which the platform pays by itself"
            )
        return self

    @model_validator(mode="after")
    def _check_screen_out(self) -> Payment:
        if self.screen_out is not None and self.screen_out not in self.outcomes:
            raise ValueError(
                f"screen_out must be an outcome that outcomes pays for, got {self.screen_out}"
            )
        return self

    @property
    def follows_from_play(self) -> bool:
        """Whether an amount says something of how somebody played."""
        return self.bonus_per_unit > 0

    def is_fixed(self, outcome: Outcome) -> bool:
        """Whether the operators pay exactly what `outcomes` says, whatever the time."""
        is_paid_by_time = self.hourly_rate > 0 and outcome is Outcome.STOPPED_BY_US
        return outcome is not self.screen_out and not is_paid_by_time
