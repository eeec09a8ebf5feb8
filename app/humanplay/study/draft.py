"""A draft: a study's protocol as people edit it, with a comment for each field.

Freezing reads `protocol.toml` and writes the protocol that counts, `protocol.json`.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date, time
from pathlib import Path

import tomli_w

from humanplay.study.files import read_toml
from humanplay.study.protocol import Protocol, StudyError
from humanplay.study.protocol_parts import Declarations
from humanplay.study.questions import NONE, Block
from humanplay.study.shipped_questions import BLOCKS, shipped

FILE = "protocol.toml"

FIELDS: dict[str, dict[str, str]] = {
    "What is played": {
        "name": "In the study's address: small letters, digits and dashes.",
        "title": "What participants read at the top.",
        "dry_run_of": 'The study that `study dry-run` rehearses; "none": this is a study.',
        "languages": 'Languages on offer, such as ["en", "de"]; the first is that of this file.',
        "translated_by": "Who translated the texts into the other languages.",
        "checked_by": "Who checked the translations.",
        "task": "The environment that is played; `study new --env` writes it.",
        "core_version": "Version of the rules that a server must have; not for editing.",
        "config": "Settings of every episode, in the task's own fields.",
        "warm_up": "Episodes that do not count, with their scores shown.",
        "ranked": "Episodes that count, with their scores hidden until the end.",
        "break_every": "Ranked episodes after which a break is offered.",
        "pause_after_s": "Seconds without a key after which the page pauses.",
        "max_pauses": "Where time runs: pauses after which an episode ends as left.",
        "max_paused_s": "Where time runs: paused seconds after which an episode ends as left.",
        "max_late": "Where time runs: share of late frames above which an episode is labelled.",
    },
    "Who takes part, and what they get": {
        "players": "Participants planned.",
        "cap": 'People who may agree to take part, at most; "none": nobody is turned away.',
        "place_minutes": "Minutes after the consent at which an unfinished place is free again; "
        '"none": never.',
        "recruitment": "invitation: by single-use links; panel: by a site that sends IDs; open: "
        "anybody.",
        "platform": "prolific, sona or connect; code: none, and everybody gets their own code.",
        "outside_ids": "Parameters of the link that are stored; the first names the person.",
        "panel_links": "unsigned, or signed: only for IDs with a link of `study invite --ids`.",
        "device": "any, or computer: only browsers with a mouse or the like.",
        "payment": 'Such as {currency = "GBP", base = 4.5, hourly_rate = 9}; "none": not the server\'s to '
        "know.",
    },
    "What people are asked": {
        "questions": "About the instructions; answer: the right choice, from 0; why: shown after "
        "a wrong one.",
        "question_tries": 'Attempts at these questions, 2 or more; "none": unlimited.',
        "blocks": 'About people: shipped ones, such as ["demographics", "tools"], or your own.',
        "attention_limit": "Attention checks that may be missed before the ranked episodes; "
        '"none": any.',
        "practice": 'To pass the warm-up, such as {episodes_to_pass = 2, tries = 2, if_failed = "screen_out"}.',
        "arms": 'Conditions, such as [{name = "hinted", hint = "Walls first."}, {name = "plain"}].',
    },
    "What is estimated, and from whom": {
        "policies": "Compared with people in the report, on exactly the ranked instances.",
        "debrief_policy": "Shown to participants beside their own warm-up episodes.",
        "policy_hashes": "SHA-256 of the policies' files.",
        "primary_metric": "steps or score: the metric of tests and power.",
        "primary_family": "What is tested: policies (against people) or arms (against each other).",
        "required_attestation": "Lowest level at which an episode enters the per-protocol "
        "estimate.",
        "fixed_terrains": "true: the claim is about exactly these instances, not others like them.",
        "equivalence_margin": "Difference in steps below which learning is called flat; "
        '"none": never.',
        "exclusion": "Estimates beside that of everybody, and the rules by which people enter.",
        "flags": "Rules whose breach the report counts; nobody is left out.",
    },
    "What the power rests on": {
        "policy_difference": "Difference from people to detect, in the primary metric; "
        '"none": the smallest with enough power.',
        "arm_difference": "Difference between two arms to detect, in a study of arms.",
        "assumed_mean": "Mean of people's episodes that do not fail; "
        '"none": of synthetic players.',
        "assumed_player_sd": 'Standard deviation between people; "none": of synthetic players.',
        "assumed_terrain_sd": "Standard deviation between instances, of policy minus people; "
        '"none": as played.',
        "assumed_episode_sd": 'Standard deviation of the rest; "none": of synthetic players.',
        "assumed_failed_share": "Share of episodes that fail.",
        "assumed_leaver_share": "Share of the people who begin a ranked episode and then leave.",
    },
    "What is published, and what participants agree to": {
        "keep_episodes_when_forgotten": "true: erasing somebody leaves their episodes, without a "
        "name.",
        "data_licence": "Licence of the published data.",
        "consent": "Blank lines split paragraphs. Have it read by your ethics board.",
    },
    "What only you can say": {
        "declarations": 'Freezing refuses an empty one; "none" is an answer.',
    },
}
"""Heading -> field -> what a draft says of it, in the order of a draft."""
BY_FREEZING = ("format", "lock", "power", "texts")
"""The fields that are in no draft."""
_HEAD = """\
# The protocol of the study {name!r}. Edit it, then `humanplay study freeze {name}`.
# "none" stands for no value; {{ranked}} and the like are filled in by freezing, which writes
# protocol.json. A field with a # before it follows from the others: remove the # to change it.
"""
_TABLES = """

# Tables, which stand below all other fields
# -------------------------------------------
"""


def draft_text(protocol: Protocol) -> str:
    """A protocol as a draft."""
    lines, tables = [_HEAD.format(name=protocol.name)], [_TABLES]
    for heading, comments in FIELDS.items():
        fields = [(comment, _field(protocol, name)) for name, comment in comments.items()]
        tables += [_section(*field) for field in fields if field[1].startswith("[")]
        values = [_section(*field) for field in fields if field[1][:1] not in ("", "[")]
        lines += [f"\n\n# {heading}\n# {'-' * len(heading)}\n", *values] if values else []
    return "".join(lines + tables)


def read_draft(path: Path) -> dict[str, object]:
    """The fields of a protocol that a draft has; StudyError when it cannot be read."""
    fields = read_toml(path)
    # of the other fields the protocol's types know which may be None
    return {**fields, "config": _without_words(fields["config"])} if "config" in fields else fields


def _section(comment: str, text: str) -> str:
    return f"\n# {comment}\n{text}"


def _field(protocol: Protocol, name: str) -> str:
    """A field as TOML; one that follows from others as a comment."""
    content = protocol.model_dump(mode="json", include={name})[name]
    if name == "policy_hashes" and not content:
        return ""
    if name == "declarations":
        return _declarations(protocol.declarations)
    if name == "blocks":
        names = map(shipped_name, protocol.blocks)
        content = [name or block for name, block in zip(names, content, strict=True)]
    if name == "config" and _without_words(content) != content:
        raise StudyError(f'config has the text "{NONE}", which a draft reads as no value')
    text = toml({name: _written(content)})
    follows = Protocol.model_fields[name].default_factory_takes_validated_data
    if follows and name not in protocol.model_fields_set:
        return "".join(f"#{line}\n" for line in text.splitlines())
    return text


def _declarations(declarations: Declarations) -> str:
    """The declarations, with the question above each."""
    fields = (
        f"# {field.description}\n{toml({name: getattr(declarations, name)})}"
        for name, field in Declarations.model_fields.items()
    )
    return "[declarations]\n" + "".join(fields)


def toml(fields: Mapping[str, object]) -> str:
    """Fields in the format of a draft."""
    return tomli_w.dumps(fields, multiline_strings=True)


def shipped_name(block: Block) -> str | None:
    """The name under which a block is shipped; None for any other."""
    names = (name for name in BLOCKS if Block.model_validate(shipped(name)) == block)
    return next(names, None)


def _written(content: object) -> object:
    """What a draft says, which has NONE where a protocol has None."""
    if content is None:
        return NONE
    if isinstance(content, Mapping):
        return {name: _written(part) for name, part in content.items()}
    return [_written(part) for part in content] if isinstance(content, list) else content


def _without_words(content: object) -> object:
    """What a draft means, with None where it says NONE; StudyError for a date."""
    if isinstance(content, (date, time)):
        raise StudyError(f"config has the date or time {content}: write it in quotes")
    if isinstance(content, dict):
        return {name: _without_words(part) for name, part in content.items()}
    if isinstance(content, list):
        return [_without_words(part) for part in content]
    return None if content == NONE else content
