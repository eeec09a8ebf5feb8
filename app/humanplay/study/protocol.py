"""The protocol of a study: everything that is fixed before the first participant joins, and the hash that fixes it.

The defaults are those of Koutras et al. 2021, section 3.2: 15 episodes to warm up, then 30 that count, on level `random` 21x21.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from decimal import Decimal
from typing import Annotated, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    StrictBool,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from humanplay.board.controls import ClockLimits
from humanplay.board.messages import DRIVING_KEYS, describe_errors
from humanplay.db.trial import Required
from humanplay.study.outcome import BEFORE_CONSENT, Outcome
from humanplay.study.platforms import PLATFORMS, PlatformName
from humanplay.study.questions import (
    EARLY_POSITIONS,
    POSITIONS,
    Block,
    Line,
    Name,
    Part,
    Question,
    attention_checks,
    check_blocks,
    in_order,
)
from humanplay.study.shipped_questions import with_shipped
from humanplay.study.texts import consent
from humanplay.task import Configuration, Environment, counted
from humanplay.task.registration import DEFAULT_TASK, environment_of
from marsexplorer.intervals import FEWEST

LONGEST_NAME = 40
NAME = rf"[a-z0-9][a-z0-9-]{{0,{LONGEST_NAME - 1}}}"
"""What a study may be called."""

Rule = Literal[
    "completed",
    "all_ranked_driver_human",
    "most_given_up",
    "no_labels",
    "max_pause_share",
    "passed_practice",
    "least_minutes",
    "most_minutes",
    "most_missed_checks",
    "most_devices",
]
ExclusionRules = dict[Rule, StrictBool | float]
PER_PROTOCOL = "protocol"
"""The exclusion set of the per-protocol estimate."""
SHARES: tuple[Rule, ...] = ("most_given_up", "max_pause_share")
"""Rules that take a number, 0 to 1."""
NUMBERS: tuple[Rule, ...] = (
    *SHARES,
    "least_minutes",
    "most_minutes",
    "most_missed_checks",
    "most_devices",
)
"""Rules that take a number; the others are true or false."""
EXCLUSION: dict[str, ExclusionRules] = {
    PER_PROTOCOL: {"completed": True, "all_ranked_driver_human": True, "most_given_up": 0.5},
    "strict": {
        "completed": True,
        "all_ranked_driver_human": True,
        "most_given_up": 0.5,
        "no_labels": True,
        "max_pause_share": 0.5,
    },
}
"""Who enters each estimate beside the one for everybody."""


PLANNED = (
    "assumed_mean",
    "assumed_player_sd",
    "assumed_terrain_sd",
    "assumed_episode_sd",
    "policy_difference",
    "power",
)
"""The fields that planning fills in where a draft leaves them empty."""


class StudyError(Exception):
    """A study cannot be used as asked; the message is one sentence: what was expected, what came, the way out."""


class UnknownStudyError(StudyError):
    """No study goes by this name."""


class DraftStudyError(StudyError):
    """The study has not been frozen yet."""


class Consent(Part):
    """What a participant agrees to: paragraphs are split by blank lines, and a new text is a new version."""

    version: str = Field(default="1", min_length=1, max_length=40)
    text: str = Field(min_length=1, max_length=20_000)


Declared = Annotated[str, Field(max_length=2_000)]
_NO_ANSWER = re.compile(
    r"\W*|\W*(to ?do|tb[acdns]|fixme|xxx+|to be (added|announced|confirmed|decided|defined|determined|done|stated))\b.*",
    re.IGNORECASE | re.DOTALL,
)
"""A text that stands for one to be written: blank, marks only, or TODO, TBD and the like at its beginning."""


def asked(question: str) -> str:
    """A field for a text that a draft may leave empty, with the question that it answers."""
    return Field(default="", description=question)


class Declarations(Part):
    """What only the authors know of their study, said before anybody plays; a draft may leave texts empty.

    The descriptions are the questions of `study new` and the table of docs/study.md.
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
        """Return the fields whose text answers nothing."""
        return [name for name, text in self if _NO_ANSWER.fullmatch(text)]


class Power(Part):
    """What a study can see, by simulated studies with its assumptions.

    arms_differ    share that tell two arms apart which differ by `arm_difference`; None: arms are not tested
    policy_better  share (0..1) of studies that see a policy which is better by `policy_difference`; None: none is tested
    people_better  share that see one which is worse
    half_width     of the 95 % interval of the mean of those who finish, on average; None where people or terrains are too few
    studies        simulated
    """

    arms_differ: float | None = Field(default=None, ge=0, le=1)
    policy_better: float | None = Field(default=None, ge=0, le=1)
    people_better: float | None = Field(default=None, ge=0, le=1)
    half_width: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    studies: int = Field(ge=1)

    @property
    def lower(self) -> float | None:
        """The share that decides: that of the arms, else the lower of the two."""
        if self.arms_differ is not None:
            return self.arms_differ
        if self.policy_better is None or self.people_better is None:
            return None
        return min(self.policy_better, self.people_better)


class Practice(Part):
    """What the warm-up must come to.

    reach  episodes of the warm-up that must be reached
    score  that an episode must have; None: it must be a success
    tries  at the whole warm-up, each on terrains of its own
    then   what becomes of whoever fails the last one: they are screened out, or go on, and a rule names them
    """

    reach: int = Field(ge=1, le=500)
    score: float | None = Field(default=None, allow_inf_nan=False)
    tries: int = Field(default=2, ge=1, le=10)
    then: Literal["screen_out", "go_on"] = "screen_out"


Money = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]


class Payment(Part):
    """What people are paid, in one currency.

    base      who finishes gets it from the platform
    each      bonus for each success, or each unit, of the ranked episodes
    unit      what is counted: successes, or steps or score beyond a number in each episode
    beyond    the steps, or the score, of an episode from which on units count
    direction whether more or fewer than that earns
    rounding  the bonus, and pay by the hour, are multiples of it; itself a multiple of 0.01
    most      the bonus is at most this; None: there is no cap. It is never below 0
    hour      by the hour, for whoever we stop
    outcomes  what another outcome gets, as a bonus
    screen_out  the one of them that the platform pays by itself, as a screen-out; None: it pays none
    bonus_at_once  whether amounts that follow from play are listed before the study is closed
    """

    currency: str = Field(pattern="^[A-Z]{3}$")
    base: Money = 0
    each: Money = 0
    unit: Literal["success", "steps", "score"] = "success"
    beyond: float = Field(default=0, allow_inf_nan=False)
    direction: Literal["more", "fewer"] = "more"
    rounding: float = Field(default=0.01, ge=0.01, le=1e6, allow_inf_nan=False)
    most: Money | None = None
    hour: Money = 0
    outcomes: dict[Outcome, Money] = Field(default_factory=dict)
    screen_out: Outcome | None = None
    bonus_at_once: bool = False

    @field_validator("rounding")
    @classmethod
    def _rounding_can_be_paid(cls, rounding: float) -> float:
        if Decimal(str(rounding)) % Decimal("0.01"):
            raise ValueError(f"rounding must be a multiple of 0.01, got {rounding:g}")
        return rounding

    @field_validator("outcomes")
    @classmethod
    def _finishing_is_base(cls, amounts: dict[Outcome, float]) -> dict[Outcome, float]:
        if Outcome.FINISHED in amounts:
            raise ValueError("what finishing gets is base and bonus, and no entry of outcomes")
        return amounts

    @model_validator(mode="after")
    def _who_is_paid_is_listed(self) -> Payment:
        for outcome in sorted(BEFORE_CONSENT & self.outcomes.keys() - {self.screen_out}):
            raise ValueError(
                f"nothing is stored of whoever comes to {outcome}, so that nobody could pay them: expected an "
                "outcome after the consent, or screen_out, which the platform pays by itself"
            )
        return self

    @model_validator(mode="after")
    def _screen_out_is_paid(self) -> Payment:
        if self.screen_out is not None and self.screen_out not in self.outcomes:
            raise ValueError(
                f"screen_out is an outcome that outcomes gives an amount, got {self.screen_out}"
            )
        return self

    @property
    def follows_from_play(self) -> bool:
        """Whether an amount says something of how somebody played."""
        return self.each > 0

    def is_fixed(self, outcome: Outcome) -> bool:
        """Whether we pay exactly what `outcomes` says, whatever the time."""
        by_time = self.hour > 0 and outcome is Outcome.STOPPED_BY_US
        return outcome is not self.screen_out and not by_time


Key = Annotated[str, Field(max_length=32)]
"""The `event.code` of a key."""


class Arm(Part):
    """A condition, and what only the people who are assigned to it read.

    Blocks of questions name the arms that are asked them.

    name          that no participant reads
    instructions  paragraphs below the instructions, split by blank lines; empty: none
    hint          what stands beside the board in each episode; empty: nothing
    keys          of each action, as many as the task's; none: the task's. A person may choose others, as everybody
    questions     on the instructions, asked after the protocol's; every arm has as many
    """

    name: Name
    instructions: str = Field(default="", max_length=5_000)
    hint: str = Field(default="", max_length=500)
    keys: dict[Line, tuple[Key, ...]] = Field(default_factory=dict)
    questions: tuple[Question, ...] = Field(default=(), max_length=10)


class Protocol(Part):
    """A study's protocol.

    dry_run_of           the study that this is a dry run of, on terrains of its own: its figures are seen at once, and it is
                         never released; None: it is a study
    task                 what is played: mars, or gymnasium: with an id or a description as JSON
    config               of every episode, as the task's configuration says it
    core_version         of the rules it was made for
    lock                 what else must be the same where it is served (`Lock.current`); freezing writes it
    warm_up, ranked      episodes a participant plays that do not count, and that do
    players              participants planned
    cap                  people who may agree to take part, at most; None: nobody is turned away
    place_minutes        after so many minutes from their consent, the place of somebody who has not finished is free again;
                         None: never
    break_every          ranked episodes after which a break is offered
    pause_after_s        seconds without a key after which the page pauses
    max_pauses           how often an episode on a clock may stand still before it ends as left
    max_paused_s         for how many seconds in all it may
    max_late             share (0..1) of its ticks that may come more than a frame late; beyond, it is labelled
    device               with which people may take part; a computer is one whose browser has a mouse or the like
    blocks               of questions about people, in the order of where they stand; a name is that of a shipped block
    arms                 conditions to which people are assigned at random; none: everybody reads the same
    question_tries       at the questions, after which they are over; None: as many as are wanted
    attention_limit      attention checks that somebody may miss before the first ranked episode, and is screened out beyond;
                         None: nobody is
    practice             what the warm-up must come to before the first ranked episode; None: nothing
    platform             from which people come; `code`: from none, and a code is drawn for each person
    outside_ids          parameters of the link that are kept; the first one names the person
    payment              what people are paid; None: that is not the server's to know
    policies             compared in the report, on exactly the ranked terrains
    debrief_policy       compared with the participant on the warm-up terrains; None: nothing is
    policy_hashes        SHA-256 (hex) of the policies' files, by name or path; freezing writes them
    exclusion            estimates by name with who enters them; `protocol`, the per-protocol one, is there in any case
    flags                rules of which a break is a data-quality flag of a person, and leaves nobody out
    primary_metric       in which policies are tested against people, and the study is planned; the other one is descriptive
    fixed_terrains       whether the claim is about exactly these terrains, and not about others of their kind
    equivalence_margin   steps to 99 %: last third of the ranked trials against the first, within which learning is called flat;
                         None: it is never called flat
    recruitment          how participants come: by single-use invitations, from a panel's link, or by a link that is open to all
    panel_links          of recruitment by a panel: signed when only ids that the operator has signed are let in
    required_attestation the lowest level at which an episode enters a human score
    assumed_mean         of people's episodes that do not fail, in the primary metric; the power follows from this and the next
    assumed_player_sd    between people's true means
    assumed_terrain_sd   between terrains, of policy minus people; None: from playing the policies
    assumed_episode_sd   of an episode beside its player and its terrain
    assumed_failed_share of episodes that fail, 0..1
    assumed_leaver_share of the people who begin a ranked episode and leave, 0..1
    policy_difference    between a policy and the people, in the primary metric: what the study is planned to see
    primary_family       what is tested: the policies against the people, or the arms against each other
    arm_difference       between two arms, in the primary metric: what a study of arms is planned to see
    power                what freezing found the study to see
    declarations         what only the authors know; freezing asks for all of them
    """

    format: Literal["humanplay-study-1"] = "humanplay-study-1"
    name: str = Field(pattern=f"^{NAME}$")
    title: Line
    dry_run_of: str | None = Field(default=None, pattern=f"^{NAME}$")
    task: str = DEFAULT_TASK
    config: dict[str, object]
    core_version: str = Field(default_factory=lambda known: environment_of(known["task"]).version)
    lock: dict[str, object] = Field(default_factory=dict)
    warm_up: int = Field(default=15, ge=0, le=500)
    ranked: int = Field(default=30, ge=1, le=500)
    players: int = Field(default=10, ge=1, le=100_000)
    cap: int | None = Field(default=None, ge=1, le=100_000)
    place_minutes: float | None = Field(default=None, gt=0, le=525_600, allow_inf_nan=False)
    break_every: int = Field(default=10, ge=1)
    pause_after_s: float = Field(default=60, gt=0, le=3600, allow_inf_nan=False)
    max_pauses: int = Field(default=ClockLimits.pauses, ge=0, le=1000)
    max_paused_s: float = Field(default=ClockLimits.paused_s, ge=0, le=86_400, allow_inf_nan=False)
    max_late: float = Field(default=ClockLimits.late, ge=0, le=1, allow_inf_nan=False)
    consent: Consent
    questions: tuple[Question, ...] = Field(max_length=20)
    blocks: Annotated[tuple[Block, ...], BeforeValidator(with_shipped)] = Field(
        default=(), max_length=20
    )
    arms: tuple[Arm, ...] = Field(default=(), max_length=10)
    device: Literal["any", "computer"] = "any"
    question_tries: int | None = Field(default=None, ge=2, le=20)
    attention_limit: int | None = Field(default=None, ge=0)
    practice: Practice | None = None
    platform: PlatformName = "code"
    outside_ids: tuple[Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")], ...] = Field(
        default_factory=lambda known: tuple(PLATFORMS[known["platform"]].ids), max_length=10
    )
    payment: Payment | None = None
    policies: tuple[Line, ...] = Field(
        default_factory=lambda known: environment_of(known["task"]).policies.compared
    )
    debrief_policy: Line | None = Field(
        default_factory=lambda known: environment_of(known["task"]).policies.shown
    )
    policy_hashes: dict[str, str] = Field(default_factory=dict)
    exclusion: dict[str, ExclusionRules] = Field(default_factory=lambda: dict(EXCLUSION))
    flags: ExclusionRules = Field(default_factory=dict)
    primary_metric: Literal["steps", "score"] = "steps"
    fixed_terrains: bool = False
    equivalence_margin: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    keep_episodes_when_forgotten: bool = False
    data_licence: Line = "CC-BY-4.0"
    recruitment: Literal["open", "invitation", "panel"] = "open"
    panel_links: Literal["unsigned", "signed"] = "unsigned"
    required_attestation: Required = "attested"
    assumed_mean: float | None = Field(default=None, allow_inf_nan=False)
    assumed_player_sd: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    assumed_terrain_sd: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    assumed_episode_sd: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    assumed_failed_share: float = Field(default=0.01, ge=0, le=0.5, allow_inf_nan=False)
    assumed_leaver_share: float = Field(default=0.05, ge=0, le=0.5, allow_inf_nan=False)
    policy_difference: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    primary_family: Literal["policies", "arms"] = "policies"
    arm_difference: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    power: Power | None = None
    declarations: Declarations = Declarations()

    @field_validator("task")
    @classmethod
    def _task_is_ours(cls, given: str) -> str:
        return environment_of(given).name

    @field_validator("config")
    @classmethod
    def _config_is_one(
        cls, values: dict[str, object], info: ValidationInfo[None]
    ) -> dict[str, object]:
        if "task" not in info.data:
            return values  # what is wrong with the task has been said
        environment = environment_of(info.data["task"])
        try:
            config = environment.configuration(values)
        except TypeError as error:
            raise ValueError(f"config: {error}") from error
        environment.check_study(config)
        full: dict[str, object] = config.to_dict()
        return full

    @field_validator("policy_hashes")
    @classmethod
    def _hashes_are_sha256(cls, given: dict[str, str]) -> dict[str, str]:
        for policy, digest in given.items():
            if not re.fullmatch(r"[0-9a-f]{64}", digest):
                raise ValueError(
                    f"policy_hashes holds 64 hexadecimal digits for each policy, got {digest!r} for {policy!r}"
                )
        return given

    @field_validator("outside_ids")
    @classmethod
    def _no_id_twice(cls, given: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(given)) < len(given):
            raise ValueError(f"outside_ids must differ from each other, got {', '.join(given)}")
        return given

    @field_validator("blocks")
    @classmethod
    def _blocks_follow_each_other(cls, blocks: tuple[Block, ...]) -> tuple[Block, ...]:
        check_blocks(blocks)
        return blocks

    @model_validator(mode="after")
    def _panel_names_people(self) -> Protocol:
        if self.platform != "code" and self.recruitment != "panel":
            raise ValueError(
                f"an ID comes with everybody from {self.platform}: expected recruitment panel, got {self.recruitment}"
            )
        if missing := [
            name for name in PLATFORMS[self.platform].ids if name not in self.outside_ids
        ]:
            raise ValueError(
                f"{self.platform} sends {missing[0]}, which outside_ids lacks: leave outside_ids out, or name it there"
            )
        if self.recruitment == "panel" and not self.outside_ids:
            why = "the first one names the person, got none"
            raise ValueError(f"recruitment by a panel needs outside_ids: {why}")
        if self.panel_links == "signed" and self.recruitment != "panel":
            got = f"got recruitment {self.recruitment}"
            raise ValueError(f"panel_links signed is for recruitment panel, {got}")
        return self

    @model_validator(mode="after")
    def _cap_leaves_room(self) -> Protocol:
        if self.cap is None:
            if self.place_minutes is not None:
                raise ValueError(
                    "place_minutes frees places of a cap, and there is no cap: give the protocol one, or take place_minutes "
                    "out"
                )
            return self
        least, reason = self.players, "who are planned"
        if self.platform == "prolific":
            # who returns or times out there has agreed here, and Prolific sends another person
            least = self.players + math.ceil(self.players / 10)
            reason = f"the {self.players} places on Prolific plus a tenth, since it replaces whoever returns"
        if self.cap < least:
            raise ValueError(f"cap must be at least {least}, {reason}; got {self.cap}")
        return self

    @model_validator(mode="after")
    def _checks_are_asked(self) -> Protocol:
        early = attention_checks(self.blocks, *EARLY_POSITIONS)
        if self.attention_limit is not None and early <= self.attention_limit:
            raise ValueError(
                f"attention_limit is {self.attention_limit}, and {counted(early, 'attention check')} can be missed before the "
                "first ranked episode: ask more there, or allow fewer misses"
            )
        is_named = any("most_missed_checks" in rules for rules in self.rule_sets)
        if is_named and not attention_checks(self.blocks, *POSITIONS):
            raise ValueError(
                "a rule is most_missed_checks, but no block has an attention check: ask one, or take the rule out"
            )
        return self

    @model_validator(mode="after")
    def _arms_differ(self) -> Protocol:
        names = [arm.name for arm in self.arms]
        if len(names) == 1 or len(set(names)) < len(names):
            raise ValueError(
                f"arms must be none, or two or more of different names; got {', '.join(names)}"
            )
        for block in self.blocks:
            if unknown := [name for name in block.arms if name not in names]:
                raise ValueError(
                    f"the block {block.name!r} is for the arm {unknown[0]!r}, which there is not: there are "
                    f"{', '.join(names) or 'none'}"
                )
        if len({len(arm.questions) for arm in self.arms}) > 1:
            raise ValueError("every arm asks as many questions: more of them keep more people out")
        reads: dict[object, str] = {}
        for arm in self.arms:
            own_blocks = {block.name for block in self.blocks if arm.name in block.arms}
            keys = tuple(sorted(arm.keys.items()))
            content = arm.instructions, arm.hint, keys, arm.questions, frozenset(own_blocks)
            if other := reads.get(content):
                raise ValueError(
                    f"the arms {other!r} and {arm.name!r} differ in nothing: give one of them instructions, a hint, keys or "
                    "questions, or name one in the arms of a block"
                )
            reads[content] = arm.name
        return self

    @model_validator(mode="after")
    def _keys_of_arms_drive(self) -> Protocol:
        usual = self.environment.keys
        wanted = {action: len(codes) for action, codes in usual.items()}
        # the task's own, such as Space in a game that fires with it, drive in every arm
        may_drive = DRIVING_KEYS.union(*usual.values())
        for arm in self.arms:
            codes = [code for action_codes in arm.keys.values() for code in action_codes]
            if strange := [code for code in codes if code not in may_drive]:
                raise ValueError(
                    f"keys of the arm {arm.name!r}: expected the code of a key that may drive, like KeyI or ArrowUp, or one "
                    f"of the task's own, got {strange[0]!r}"
                )
            counts = {action: len(action_codes) for action, action_codes in arm.keys.items()}
            if arm.keys and (counts != wanted or len(set(codes)) < len(codes)):
                expected = ", ".join(f"{count} of {action}" for action, count in wanted.items())
                raise ValueError(f"keys of the arm {arm.name!r} must be different keys: {expected}")
        return self

    @model_validator(mode="after")
    def _checks_are_of_every_arm(self) -> Protocol:
        of_some: set[str] = set()
        for block in in_order(self.blocks):
            is_of_some = block.shown_if is not None and block.shown_if.question in of_some
            if not block.arms and not is_of_some:
                continue
            of_some |= {question.name for question in block.questions}
            if block.attention_checks:
                raise ValueError(
                    f"the block {block.name!r} has an attention check for some arms alone, so that checks would leave out "
                    "more of one arm: ask everybody"
                )
        return self

    @model_validator(mode="after")
    def _arms_can_be_tested(self) -> Protocol:
        if self.primary_family == "policies":
            return self
        if not self.arms or self.arm_difference is None:
            raise ValueError(
                "primary_family arms needs arms, and arm_difference: the difference between two of them, in the primary "
                "metric, that the study is to see"
            )
        lowest, _ = self.environment.bounds(self.env_config)
        if self.primary_metric == "score" and not math.isfinite(lowest):
            raise ValueError(
                "primary_family arms tests both estimates, and everybody who began has no mean score without a lowest one: "
                "give the environment's file bounds, or make steps the primary_metric"
            )
        return self

    @model_validator(mode="after")
    def _practice_is_of_the_warm_up(self) -> Protocol:
        is_named = any(rules.get("passed_practice") for rules in self.rule_sets)
        if self.practice is None:
            if is_named:
                raise ValueError(
                    "a rule is passed_practice, but there is no practice to pass: give the protocol one, or take the rule "
                    "out"
                )
            return self
        if self.practice.reach > self.warm_up:
            raise ValueError(
                f"practice.reach must be at most warm_up, {self.warm_up}, got {self.practice.reach}"
            )
        if self.practice.then == "go_on" and not is_named:
            raise ValueError(
                "practice.then is go_on, but neither flags nor an exclusion set has the rule passed_practice, so that "
                "failing it would mean nothing: add the rule, or screen out"
            )
        return self

    @model_serializer(mode="wrap")
    def _without_an_empty_lock(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        """Return the fields: a task that locks nothing has no field for it."""
        fields: dict[str, object] = dump(self)
        if not fields.get("lock"):
            fields.pop("lock", None)
        return fields

    @property
    def rule_sets(self) -> list[ExclusionRules]:
        """The rules of the estimates, and those of data-quality flags."""
        return [self.per_protocol, *self.exclusion.values(), self.flags]

    @model_validator(mode="after")
    def _rules_have_bounds(self) -> Protocol:
        for rules in self.rule_sets:
            for rule, bound in rules.items():
                expected = "a number" if rule in NUMBERS else "true or false"
                if isinstance(bound, bool) is (rule in NUMBERS):
                    raise ValueError(f"the rule {rule} takes {expected}, got {bound}")
                if rule in SHARES and not 0 <= bound <= 1:
                    raise ValueError(f"the rule {rule} takes a share, 0 to 1, got {bound:g}")
            misses = rules.get("most_missed_checks", 0)
            if misses < 0 or misses % 1:
                raise ValueError(
                    f"the rule most_missed_checks takes a whole number from 0, got {misses:g}"
                )
            devices = rules.get("most_devices", 1)
            if devices < 1 or devices % 1:
                raise ValueError(
                    f"the rule most_devices takes a whole number from 1, got {devices:g}"
                )
            least, most = rules.get("least_minutes", 0.0), rules.get("most_minutes", math.inf)
            if not 0 <= least < most:
                raise ValueError(
                    f"least_minutes must be at least 0 and below most_minutes, got {least:g} and {most:g}"
                )
        return self

    @property
    def per_protocol(self) -> ExclusionRules:
        """Who enters the per-protocol estimate."""
        return self.exclusion.get(PER_PROTOCOL, EXCLUSION[PER_PROTOCOL])

    @property
    def question_count(self) -> int:
        """The questions on the instructions that everybody is asked, of their arm too."""
        return len(self.questions) + sum(len(arm.questions) for arm in self.arms[:1])

    @property
    def most_warm_up(self) -> int:
        """The warm-up episodes of whoever needs every try at the practice."""
        return self.warm_up * (1 if self.practice is None else self.practice.tries)

    @property
    def environment(self) -> Environment:
        """The rules of the task."""
        return environment_of(self.task)

    @property
    def terrains_drawn(self) -> bool:
        """Whether figures are for other terrains too: enough are played, and none is fixed."""
        return self.ranked >= FEWEST and not self.fixed_terrains

    @property
    def clock_limits(self) -> ClockLimits:
        """What an episode may have in time, where a clock runs."""
        return ClockLimits(self.max_pauses, self.max_paused_s, self.max_late)

    @property
    def env_config(self) -> Configuration:
        """The configuration of every episode."""
        return self.environment.configuration(self.config)


def default_protocol(
    name: str, config: Configuration, task: str = DEFAULT_TASK, **rest: object
) -> Protocol:
    """Return a protocol with the paper's defaults, `rest` in their place where given; StudyError when one cannot be.

    Its texts are templates: `humanplay.study.templates.fill` gives what participants read.
    """
    texts = environment_of(task).texts(config)
    keeps_episodes = bool(rest.get("keep_episodes_when_forgotten"))
    text = consent(texts.opening, bool(texts.questions), texts.things, keeps_episodes)
    parts = {
        "name": name,
        **({} if task == DEFAULT_TASK else {"task": task}),
        "config": config.to_dict(),
        "questions": [asdict(question) for question in texts.questions],
        "title": texts.study_title.replace("{name}", name),
        "consent": {"text": text},
    }
    return parse_protocol({**parts, **rest})


def parse_protocol(data: Mapping[str, object]) -> Protocol:
    """Return the protocol of plain values; StudyError with one sentence when they make none."""
    try:
        return Protocol.model_validate(data)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        # said of a default that follows from a field which is wrong, and said itself
        errors = [fault for fault in errors if fault["type"] != "default_factory_not_called"]
        raise StudyError(f"the protocol does not hold: {describe_errors(errors)}") from error


def canonical_json(value: object) -> bytes:
    """Return JSON in its one canonical form: keys sorted, no spaces, UTF-8."""
    return json.dumps(
        value, allow_nan=False, sort_keys=True, separators=(",", ":"), ensure_ascii=False
    ).encode()


def canonical(protocol: Protocol) -> bytes:
    """Return the protocol's canonical JSON, without what it was made without: a later version's new fields change no hash."""
    return canonical_json(protocol.model_dump(mode="json", exclude_unset=True))


def protocol_hash(protocol: Protocol) -> str:
    """Return SHA-256 (hex) of the canonical JSON."""
    return hashlib.sha256(canonical(protocol)).hexdigest()
