"""The protocol of a study: all that is decided before the first participant joins.

Freezing publishes its hash, so that it cannot change afterwards. The defaults are those of Koutras et
al. 2021, section 3.2: 15 warm-up episodes, then 30 ranked ones, on level `random` 21x21.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Annotated, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from humanplay.board.controls import ClockLimits
from humanplay.board.messages import describe_errors
from humanplay.db.trial import Required
from humanplay.study.exclusion_rules import EXCLUSION, PER_PROTOCOL, ExclusionRules, check_rules
from humanplay.study.platforms import PLATFORMS, PlatformName
from humanplay.study.protocol_arms import (
    Arm,
    check_arms_differ,
    check_attention_of_arms,
    check_keys_of_arms,
)
from humanplay.study.protocol_parts import (
    Consent,
    Declarations,
    Declared,
    Payment,
    Power,
    Practice,
)
from humanplay.study.questions import (
    EARLY_POSITIONS,
    POSITIONS,
    Block,
    Line,
    Part,
    Question,
    attention_checks,
    check_blocks,
)
from humanplay.study.shipped_questions import with_shipped
from humanplay.study.texts import consent
from humanplay.task import Configuration, Environment, counted
from humanplay.task.registration import DEFAULT_TASK, environment_of
from marsexplorer.intervals import FEWEST

LONGEST_NAME = 40
"""The most characters of a study's name."""

NAME = rf"[a-z0-9][a-z0-9-]{{0,{LONGEST_NAME - 1}}}"
"""The pattern of a study's name."""

SOURCE_LANGUAGE = "en"
"""The language in which the software is written."""

Language = Annotated[str, Field(pattern=r"^[a-z]{2,3}(-[A-Za-z0-9]{2,8})?$")]
"""A language as the web names it: `de`, `pt-BR`."""

IdName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]
"""The name of a parameter of the study's link."""

PLANNED = (
    "assumed_mean",
    "assumed_player_sd",
    "assumed_terrain_sd",
    "assumed_episode_sd",
    "policy_difference",
    "power",
)
"""The fields that planning fills in if a draft leaves them empty."""


class StudyError(Exception):
    """A study cannot be used as asked.

    The message is one sentence: what was expected, what came, the way out.
    """


class UnknownStudyError(StudyError):
    """No study has this name."""


class DraftStudyError(StudyError):
    """The study has not been frozen yet."""


class Protocol(Part):
    """A study's protocol."""

    # the study and its languages

    format: Literal["humanplay-study-1"] = "humanplay-study-1"
    """The format of the file."""

    name: str = Field(pattern=f"^{NAME}$")
    """The name in the study's address."""

    title: Line
    """The title that participants read."""

    dry_run_of: str | None = Field(default=None, pattern=f"^{NAME}$")
    """The study that this is a dry run of; None: no dry run.

    A dry run has terrains of its own. Its results are shown at once, and it is never released.
    """

    languages: tuple[Language, ...] = Field(default=(SOURCE_LANGUAGE,), min_length=1, max_length=20)
    """The languages on offer; the protocol's own texts are in the first."""

    translated_by: Declared = ""
    """Who translated the texts, if a language other than English is on offer."""

    checked_by: Declared = ""
    """Who checked the translation."""

    texts: dict[Language, dict[str, str]] = Field(default_factory=dict)
    """Language -> text ID -> what participants read; freezing writes it."""

    # what is played

    task: str = DEFAULT_TASK
    """What is played: `mars`, or `gymnasium:` followed by an ID or a description as JSON."""

    config: dict[str, object]
    """The configuration of every episode, as `Configuration.to_dict` has it."""

    core_version: str = Field(default_factory=lambda fields: environment_of(fields["task"]).version)
    """The version of the rules for which the protocol was written."""

    lock: dict[str, object] = Field(default_factory=dict)
    """What must be the same on every server that plays it (`Lock.current`); freezing writes it."""

    warm_up: int = Field(default=15, ge=0, le=500)
    """How many episodes a participant plays that do not count."""

    ranked: int = Field(default=30, ge=1, le=500)
    """How many episodes a participant plays that count."""

    # how many people, and the time they have

    players: int = Field(default=10, ge=1, le=100_000)
    """How many participants are planned."""

    cap: int | None = Field(default=None, ge=1, le=100_000)
    """How many people may agree to take part; None: no limit."""

    place_minutes: float | None = Field(default=None, gt=0, le=525_600, allow_inf_nan=False)
    """Minutes from the consent after which the place of whoever has not finished is free again.

    None: it stays taken.
    """

    break_every: int = Field(default=10, ge=1)
    """After how many ranked episodes a break is offered."""

    pause_after_s: float = Field(default=60, gt=0, le=3600, allow_inf_nan=False)
    """Seconds without a key after which the page pauses."""

    max_pauses: int = Field(default=ClockLimits.pauses, ge=0, le=1000)
    """How often an episode on a clock may stand still; the next time ends it as left."""

    max_paused_s: float = Field(default=ClockLimits.paused_s, ge=0, le=86_400, allow_inf_nan=False)
    """Seconds for which an episode on a clock may stand still, in all."""

    max_late: float = Field(default=ClockLimits.late, ge=0, le=1, allow_inf_nan=False)
    """Share (0..1) of an episode's ticks that may be more than a frame late.

    An episode with a larger share gets a label.
    """

    # what participants read and are asked

    consent: Consent
    """What participants agree to."""

    questions: tuple[Question, ...] = Field(max_length=20)
    """Questions on the instructions, asked before anybody plays."""

    blocks: Annotated[tuple[Block, ...], BeforeValidator(with_shipped)] = Field(
        default=(), max_length=20
    )
    """Blocks of questions about the participants, in the order of their positions.

    A shipped block is given by its name.
    """

    arms: tuple[Arm, ...] = Field(default=(), max_length=10)
    """The conditions to which people are assigned at random; empty: there are none."""

    # who may go on to the ranked episodes

    device: Literal["any", "computer"] = "any"
    """The device that people need; `computer`: with a mouse or a similar pointer."""

    question_tries: int | None = Field(default=None, ge=2, le=20)
    """How many tries people have at the instruction questions; None: no limit.

    Whoever fails them all is screened out.
    """

    attention_limit: int | None = Field(default=None, ge=0)
    """How many attention checks a person may miss before the first ranked episode.

    Whoever misses more is screened out. None: no limit.
    """

    practice: Practice | None = None
    """What must be achieved before the first ranked episode; None: nothing."""

    # where people come from, and what they are paid

    platform: PlatformName = "code"
    """The recruitment platform; `code`: none, and each person gets a completion code."""

    outside_ids: tuple[IdName, ...] = Field(
        default_factory=lambda fields: tuple(PLATFORMS[fields["platform"]].ids), max_length=10
    )
    """The link's parameters that are stored; the first is the participant ID."""

    payment: Payment | None = None
    """What people are paid; None: it is not stated here."""

    # what is compared

    policies: tuple[Line, ...] = Field(
        default_factory=lambda fields: environment_of(fields["task"]).policies.compared
    )
    """The policies that the report compares, on exactly the ranked terrains."""

    debrief_policy: Line | None = Field(
        default_factory=lambda fields: environment_of(fields["task"]).policies.shown
    )
    """The policy shown to a participant on the warm-up terrains; None: none."""

    policy_hashes: dict[str, str] = Field(default_factory=dict)
    """Name or path of a policy -> SHA-256 (hex) of its file; freezing writes it."""

    exclusion: dict[str, ExclusionRules] = Field(default_factory=lambda: dict(EXCLUSION))
    """Name of an estimate -> the rules that its people must meet.

    The per-protocol estimate, `protocol`, is computed even if it is not named here.
    """

    flags: ExclusionRules = Field(default_factory=dict)
    """Rules whose breach is a data-quality flag; it excludes nobody."""

    primary_metric: Literal["steps", "score"] = "steps"
    """The metric that is tested and planned for; the other one is descriptive."""

    fixed_terrains: bool = False
    """Whether the claim is about exactly these terrains, and no others."""

    equivalence_margin: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """The difference in steps to 99 % within which learning counts as flat.

    The last third of the ranked episodes is compared with the first. None: learning never counts
    as flat.
    """

    # what is stored and released, and whose episodes count

    keep_episodes_when_forgotten: bool = False
    """Whether an erased person's episodes are kept, under new IDs."""

    data_licence: Line = "CC-BY-4.0"
    """The licence of the released data."""

    recruitment: Literal["open", "invitation", "panel"] = "open"
    """How people come: by an open link, by single-use invitations, or by a platform's link."""

    panel_links: Literal["unsigned", "signed"] = "unsigned"
    """Whether the IDs in a platform's links must be signed by the operator."""

    required_attestation: Required = "attested"
    """The lowest level at which an episode enters a human score."""

    # what planning assumes, in the primary metric

    assumed_mean: float | None = Field(default=None, allow_inf_nan=False)
    """The mean of people's episodes that do not fail."""

    assumed_player_sd: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """The standard deviation between people's true means."""

    assumed_terrain_sd: float | None = Field(default=None, ge=0, allow_inf_nan=False)
    """The standard deviation of policy minus people between terrains.

    None: it is computed from episodes of the policies.
    """

    assumed_episode_sd: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """The standard deviation of an episode around its player and its terrain."""

    assumed_failed_share: float = Field(default=0.01, ge=0, le=0.5, allow_inf_nan=False)
    """The share (0..1) of episodes that fail."""

    assumed_leaver_share: float = Field(default=0.05, ge=0, le=0.5, allow_inf_nan=False)
    """The share (0..1) of people who begin a ranked episode and leave."""

    policy_difference: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """The difference between a policy and people that the study should detect."""

    primary_family: Literal["policies", "arms"] = "policies"
    """Which comparisons are tested: policies with people, or the arms with each other."""

    arm_difference: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """The difference between two arms that the study should detect."""

    power: Power | None = None
    """The probability that the study detects this difference; freezing computes it."""

    # what the authors declare

    declarations: Declarations = Declarations()
    """What only the authors know; freezing needs all of it."""

    # checks of single fields

    @field_validator("languages", "outside_ids")
    @classmethod
    def _check_different(
        cls, names: tuple[str, ...], info: ValidationInfo[None]
    ) -> tuple[str, ...]:
        if len(set(names)) < len(names):
            raise ValueError(
                f"{info.field_name} must differ from each other, got {', '.join(names)}"
            )
        return names

    @field_validator("task")
    @classmethod
    def _name_task(cls, task: str) -> str:
        return environment_of(task).name

    @field_validator("config")
    @classmethod
    def _complete_config(
        cls, fields: dict[str, object], info: ValidationInfo[None]
    ) -> dict[str, object]:
        if "task" not in info.data:
            return fields  # the task is not valid, which is reported by itself
        environment = environment_of(info.data["task"])
        try:
            config = environment.configuration(fields)
        except TypeError as error:
            raise ValueError(f"config: {error}") from error
        environment.check_study(config)
        complete_fields: dict[str, object] = config.to_dict()
        return complete_fields

    @field_validator("blocks")
    @classmethod
    def _check_blocks(cls, blocks: tuple[Block, ...]) -> tuple[Block, ...]:
        check_blocks(blocks)
        return blocks

    @field_validator("policy_hashes")
    @classmethod
    def _check_hashes(cls, hashes: dict[str, str]) -> dict[str, str]:
        for policy, digest in hashes.items():
            if not re.fullmatch(r"[0-9a-f]{64}", digest):
                raise ValueError(
                    f"policy_hashes must hold 64 hexadecimal digits for each policy, got {digest!r} for {policy!r}"
                )
        return hashes

    # checks of fields together; the first that fails is the one that is reported

    @model_validator(mode="after")
    def _check_recruitment(self) -> Protocol:
        platform, recruitment = self.platform, self.recruitment
        if platform != "code" and recruitment != "panel":
            raise ValueError(
                f"recruitment must be panel, since everybody from {platform} comes with an ID; got {recruitment}"
            )
        for name in PLATFORMS[platform].ids:
            if name not in self.outside_ids:
                raise ValueError(
                    f"{platform} sends {name}, but outside_ids lacks it: leave outside_ids out, or name it there"
                )
        if recruitment == "panel" and not self.outside_ids:
            raise ValueError(
                "recruitment panel needs outside_ids, the first of which is the participant ID; got none"
            )
        if self.panel_links == "signed" and recruitment != "panel":
            raise ValueError(
                f"panel_links signed is for recruitment panel, got recruitment {recruitment}"
            )
        return self

    @model_validator(mode="after")
    def _check_cap(self) -> Protocol:
        if self.cap is None:
            if self.place_minutes is not None:
                raise ValueError(
                    "place_minutes frees places of a cap, but there is no cap: give the protocol one, or leave "
                    "place_minutes out"
                )
            return self
        least, reason = self._least_cap()
        if self.cap < least:
            raise ValueError(f"cap must be at least {least}, {reason}; got {self.cap}")
        return self

    def _least_cap(self) -> tuple[int, str]:
        """The lowest cap that the protocol allows, and what it consists of, in words."""
        if self.platform != "prolific":
            return self.players, "the number of players planned"
        # people who return the study there, or time out, have agreed here; Prolific replaces them
        replaced = math.ceil(self.players / 10)
        reason = (
            f"the {self.players} places on Prolific plus a tenth, since it replaces whoever returns"
        )
        return self.players + replaced, reason

    @model_validator(mode="after")
    def _check_attention(self) -> Protocol:
        early = attention_checks(self.blocks, *EARLY_POSITIONS)
        if self.attention_limit is not None and early <= self.attention_limit:
            raise ValueError(
                f"attention_limit is {self.attention_limit}, but only {counted(early, 'attention check')} can be missed "
                "before the first ranked episode: ask more there, or allow fewer misses"
            )
        has_rule = any("max_missed_checks" in rules for rules in self.rule_sets)
        if has_rule and not attention_checks(self.blocks, *POSITIONS):
            raise ValueError(
                "the protocol has the rule max_missed_checks, but no block has an attention check: ask one, or leave "
                "the rule out"
            )
        return self

    @model_validator(mode="after")
    def _check_arms(self) -> Protocol:
        check_arms_differ(self.arms, self.blocks)
        check_keys_of_arms(self.arms, self.environment)
        check_attention_of_arms(self.blocks)
        return self

    @model_validator(mode="after")
    def _check_comparison_of_arms(self) -> Protocol:
        if self.primary_family == "policies":
            return self
        if not self.arms or self.arm_difference is None:
            raise ValueError(
                "primary_family arms needs arms and arm_difference, the difference between two of them in the primary "
                "metric that the study should detect"
            )
        lowest, _ = self.environment.bounds(self.env_config)
        if self.primary_metric == "score" and not math.isfinite(lowest):
            raise ValueError(
                "primary_family arms tests both estimates, but people who left cannot enter the mean without a lowest "
                "score: give bounds in the environment's file, or make steps the primary_metric"
            )
        return self

    @model_validator(mode="after")
    def _check_practice(self) -> Protocol:
        has_rule = any(rules.get("passed_practice") for rules in self.rule_sets)
        if self.practice is None:
            if has_rule:
                raise ValueError(
                    "the protocol has the rule passed_practice, but there is no practice to pass: give the protocol one, "
                    "or leave the rule out"
                )
            return self
        if self.practice.episodes_to_pass > self.warm_up:
            raise ValueError(
                f"practice.episodes_to_pass must be at most warm_up, {self.warm_up}, got {self.practice.episodes_to_pass}"
            )
        if self.practice.if_failed == "go_on" and not has_rule:
            raise ValueError(
                "practice.if_failed is go_on, but neither flags nor an exclusion set has the rule passed_practice, so failing "
                "the practice would change nothing: add the rule, or screen out"
            )
        return self

    @model_validator(mode="after")
    def _check_rules(self) -> Protocol:
        for rules in self.rule_sets:
            check_rules(rules)
        return self

    @model_serializer(mode="wrap")
    def _without_empty_lock(self, dump: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The fields, without `lock` if the task locks nothing."""
        fields: dict[str, object] = dump(self)
        if not fields.get("lock"):
            fields.pop("lock", None)
        return fields

    # what follows from the fields

    @property
    def environment(self) -> Environment:
        """The environment that the task names."""
        return environment_of(self.task)

    @property
    def env_config(self) -> Configuration:
        """The configuration of every episode."""
        return self.environment.configuration(self.config)

    @property
    def clock_limits(self) -> ClockLimits:
        """How often and how long an episode on a clock may stand still."""
        return ClockLimits(self.max_pauses, self.max_paused_s, self.max_late)

    @property
    def most_warm_up(self) -> int:
        """The most warm-up episodes: those of a participant who needs every try."""
        tries = 1 if self.practice is None else self.practice.tries
        return self.warm_up * tries

    @property
    def question_count(self) -> int:
        """How many instruction questions a participant is asked, including their arm's."""
        # every arm asks as many
        return len(self.questions) + sum(len(arm.questions) for arm in self.arms[:1])

    @property
    def per_protocol(self) -> ExclusionRules:
        """The rules for the people of the per-protocol estimate."""
        return self.exclusion.get(PER_PROTOCOL, EXCLUSION[PER_PROTOCOL])

    @property
    def rule_sets(self) -> list[ExclusionRules]:
        """The rules of the estimates, and those of data-quality flags."""
        return [self.per_protocol, *self.exclusion.values(), self.flags]

    @property
    def terrains_drawn(self) -> bool:
        """Whether results generalise to other terrains: enough are drawn, none fixed."""
        return self.ranked >= FEWEST and not self.fixed_terrains


def default_protocol(
    name: str, config: Configuration, task: str = DEFAULT_TASK, **fields: object
) -> Protocol:
    """A protocol with the paper's defaults.

    Its texts are templates, which `humanplay.study.templates.fill` turns into what participants
    read.

    Args:
        fields: Fields that replace the defaults.

    Raises:
        StudyError: If the fields are not valid.
    """
    texts = environment_of(task).texts(config)
    keeps_episodes = bool(fields.get("keep_episodes_when_forgotten"))
    consent_text = consent(texts.opening, bool(texts.questions), texts.things, keeps_episodes)
    defaults = {
        "name": name,
        **({} if task == DEFAULT_TASK else {"task": task}),
        "config": config.to_dict(),
        "questions": [asdict(question) for question in texts.questions],
        "title": texts.study_title,
        "consent": {"text": consent_text},
    }
    return parse_protocol({**defaults, **fields})


def parse_protocol(fields: Mapping[str, object]) -> Protocol:
    """A protocol from plain values.

    Raises:
        StudyError: If they are not valid; the message is one sentence.
    """
    try:
        return Protocol.model_validate(fields)
    except ValidationError as error:
        # a wrong field also prevents defaults that depend on it; its own error is enough
        errors = [
            fault
            for fault in error.errors(include_url=False)
            if fault["type"] != "default_factory_not_called"
        ]
        raise StudyError(f"the protocol is not valid: {describe_errors(errors)}") from error


def canonical_json(value: object) -> bytes:
    """A value as canonical JSON: keys sorted, no spaces, UTF-8."""
    return json.dumps(
        value, allow_nan=False, sort_keys=True, separators=(",", ":"), ensure_ascii=False
    ).encode()


def canonical(protocol: Protocol) -> bytes:
    """The protocol's canonical JSON, with only the fields that were set.

    So a field that a later version adds changes no hash.
    """
    return canonical_json(protocol.model_dump(mode="json", exclude_unset=True))


def protocol_hash(protocol: Protocol) -> str:
    """SHA-256 (hex) of the protocol's canonical JSON."""
    return hashlib.sha256(canonical(protocol)).hexdigest()
