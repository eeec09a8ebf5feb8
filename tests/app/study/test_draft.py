"""A draft in TOML loses no value and no kind of number of its protocol."""

import json
import tomllib
from itertools import chain
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from humanplay.study.draft import BY_FREEZING, FIELDS, FILE, draft_text, read_draft
from humanplay.study.folder import Folder
from humanplay.study.protocol import (
    Protocol,
    StudyError,
    canonical,
    default_protocol,
    parse_protocol,
)
from humanplay.study.protocol_parts import Practice
from humanplay.study.questions import NONE, Part
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from tests.support.declared import DECLARATIONS
from tests.support.drafts import draft_of, edit_draft
from tests.support.study import CHECK

CONFIG = EnvConfig.of("random", (7, 9))
LAKE = "gymnasium:FrozenLake-v1"
ASKED = {
    "name": "more",
    "at": "before",
    "title": "More",
    "about": 'more, and "quotes"\\',
    "shown_if": {"question": "gender", "answers": [1]},
    "questions": [
        {"kind": "number", "name": "hours", "question": "Hours?", "minimum": 1, "maximum": 24},
        {
            "kind": "scale",
            "name": "tired",
            "question": "Tired?",
            "steps": 7,
            "low": "a",
            "high": "b",
        },
        {
            "kind": "text",
            "name": "dream",
            "question": "Dreams?",
            "tells": "exposure",
            "max_length": 99,
        },
        {"kind": "several", "name": "days", "question": "Days?", "choices": ["none", "all"]},
    ],
}
ATTENTION = {"name": "checks", "at": "before", "title": "?", "about": "?", "questions": [CHECK]}
EVERYTHING = {
    "warm_up": 2,
    "ranked": 5,
    "players": 10,
    "cap": 11,
    "place_minutes": 60,
    "question_tries": 2,
    "attention_limit": 0,
    "max_late": 1,
    "practice": {"episodes_to_pass": 1, "score": 1, "tries": 2, "if_failed": "go_on"},
    "platform": "prolific",
    "recruitment": "panel",
    "payment": {
        "currency": "GBP",
        "base": 4,
        "bonus_per_unit": 1,
        "bonus_unit": "steps",
        "bonus_threshold": 60,
        "rounding": 1,
        "bonus_limit": 3,
        "hourly_rate": 9,
        "outcomes": {"failed_questions": 1},
        "screen_out": "failed_questions",
    },
    "blocks": ["demographics", ATTENTION, ASKED],
    "arms": [
        {
            "name": "hinted",
            "hint": "Walls first.",
            "keys": {action: list(keys) for action, keys in environment_of("mars").keys.items()},
        },
        {"name": "plain"},
    ],
    "exclusion": {
        "protocol": {"completed": True, "max_given_up_share": 1, "max_pause_share": 1},
        "quick": {"min_minutes": 1, "max_minutes": 90, "max_missed_checks": 0},
    },
    "flags": {"max_devices": 1, "passed_practice": True},
    "equivalence_margin": 3,
    "dry_run_of": "pilot",
    "debrief_policy": "frontier-cost",
    "primary_family": "arms",
    "arm_difference": 20,
    "policy_difference": 20,
    "assumed_mean": 40,
    "assumed_player_sd": 8,
    "assumed_terrain_sd": 8,
    "assumed_episode_sd": 8,
    "assumed_failed_share": 0,
    "assumed_leaver_share": 0,
    "declarations": {**DECLARATIONS, "pilots": "none", "contact": "Zoë\nRoom \"1\" \\ 'x'"},
}


def full(**changes):
    """A protocol in which every field says something."""
    return default_protocol("full", CONFIG, **{**EVERYTHING, **changes})


def read(text, folder):
    """The protocol that a draft stands for."""
    path = folder / FILE
    path.write_text(text, encoding="utf-8")
    return parse_protocol(read_draft(path))


def frozen_text(protocol):
    """What freezing would hash, with every field set."""
    return canonical(parse_protocol(protocol.model_dump(mode="json")))


def parts(model=Part):
    """Every part of a protocol."""
    return [model, *chain.from_iterable(map(parts, model.__subclasses__()))]


def kinds_of(annotation):
    """The types in an annotation."""
    return {annotation, *chain.from_iterable(map(kinds_of, get_args(annotation)))}


def leaves(tree, path=()):
    """Yield each number of a draft but its configuration's, with its path."""
    if isinstance(tree, (dict, list)):
        steps = tree.items() if isinstance(tree, dict) else enumerate(tree)
        for step, branch in steps:
            if (*path, step) != ("config",):
                yield from leaves(branch, (*path, step))
    elif isinstance(tree, (int, float)) and not isinstance(tree, bool):
        yield path, tree


def with_number(fields, path, number):
    """Fields with another number at the end of a path."""
    *steps, last = path
    fields = json.loads(json.dumps(fields))
    branch = fields
    for step in steps:
        branch = branch[step]
    branch[last] = number
    return fields


@pytest.mark.parametrize("protocol", [full(), default_protocol("small", CONFIG)])
def test_a_draft_says_all_of_a_protocol(protocol, tmp_path):
    again = read(draft_text(protocol), tmp_path)
    assert frozen_text(again) == frozen_text(protocol)
    assert again == protocol


def test_every_field_of_a_protocol_has_one_line_in_its_draft_or_is_written_by_freezing():
    commented = [name for comments in FIELDS.values() for name in comments]
    assert sorted([*commented, *BY_FREEZING]) == sorted(Protocol.model_fields)
    lines = draft_text(full()).splitlines()
    assert max(len(line) for line in lines if line.startswith("# ")) <= 100
    for name, comment in (
        (name, text) for texts in FIELDS.values() for name, text in texts.items()
    ):
        if name == "policy_hashes":
            continue
        below = lines[lines.index(f"# {comment}") + 1].lstrip("#[")
        assert below.startswith(name), "the field stands below what is said of it"


def test_each_value_that_may_be_none_is_the_word_none_in_a_draft(tmp_path):
    optional = Protocol.optional_fields() - set(BY_FREEZING)
    needed = {"arm_difference": {"primary_family": "policies"}, "cap": {"place_minutes": None}}
    needed["practice"] = {"flags": {}}
    for name in sorted(optional):
        assert getattr(full(), name) is not None, f"{name} says something in the other tests"
        protocol = full(**{name: None}, **needed.get(name, {}))
        text = draft_text(protocol)
        assert f'{name} = "none"\n' in text
        assert frozen_text(read(text, tmp_path)) == frozen_text(protocol), name


def test_each_none_within_a_part_is_the_word_none_too(tmp_path):
    payment, practice = EVERYTHING["payment"], EVERYTHING["practice"]
    block = {**ASKED, "shown_if": None}
    block["questions"] = [{**question, "tells": None} for question in block["questions"]]
    protocol = full(
        payment={**payment, "bonus_limit": None, "screen_out": None},
        practice={**practice, "score": None},
        blocks=[ATTENTION, block],
    )
    text = draft_text(protocol)
    named = {"bonus_limit", "screen_out", "score", "shown_if", "tells"}
    assert named == {
        name
        for part in parts()
        if part.__name__ not in ("Power", "Protocol")
        for name in part.optional_fields()
    }
    for name in named:
        assert f'{name} = "none"' in text
    again = read(text, tmp_path)
    assert frozen_text(again) == frozen_text(protocol)
    assert again.blocks[-1].questions[-1].choices == ("none", "all"), "a choice is a text"
    assert again.declarations.pilots == "none", "an honest answer is a text"


def test_a_number_is_the_same_with_a_point_and_without(tmp_path):
    protocol = full()
    fields = tomllib.loads(draft_text(protocol))
    numbers = dict(leaves(fields))
    named = {
        name
        for part in parts()
        if part.__name__ != "Power"
        for name, field in part.model_fields.items()
        if {int, float} & kinds_of(field.annotation)
    }
    named -= {"exclusion", "flags", "outcomes", "answers"}  # these hold numbers by other names
    assert named <= {step for path in numbers for step in path}, "every number is in the draft"
    for path, number in numbers.items():
        assert number == int(number), path
        for written in (int(number), float(number)):
            again = parse_protocol(with_number(fields, path, written))
            assert frozen_text(again) == frozen_text(protocol), (path, written)


def test_a_configuration_keeps_none_and_tells_whole_numbers_from_others(tmp_path):
    config = environment_of(LAKE).configuration({"kwargs": {"desc": None, "success_rate": 1.0}})
    protocol = default_protocol("lake", config, LAKE)
    text = draft_text(protocol)
    assert 'desc = "none"' in text
    assert "success_rate = 1.0" in text
    assert frozen_text(read(text, tmp_path)) == frozen_text(protocol)
    whole = environment_of(LAKE).configuration({"kwargs": {"desc": None, "success_rate": 1}})
    other = default_protocol("lake", whole, LAKE)
    assert frozen_text(read(draft_text(other), tmp_path)) == frozen_text(other)
    assert frozen_text(other) != frozen_text(protocol)


@settings(deadline=None, max_examples=50)
@given(
    st.text(st.characters(codec="utf-8", exclude_characters="\r"), max_size=300),
    st.floats(0, 1e6, allow_nan=False, exclude_min=True),
)
def test_texts_and_numbers_come_back_as_they_were(tmp_path_factory, text, number):
    protocol = full(consent={"text": text or "x"}, equivalence_margin=number)
    again = read(draft_text(protocol), tmp_path_factory.mktemp("draft"))
    assert frozen_text(again) == frozen_text(protocol)


def test_a_draft_that_cannot_be_read_is_refused_in_a_sentence(tmp_path):
    text = draft_text(full())
    for harm, reason in (
        (text + "\nranked = = 3", "is not TOML: Invalid value (at line"),
        (
            text.replace("[config]", "[config]\nday = 2026-01-01"),
            "config has the date or time 2026",
        ),
        (text.replace("players = 10", 'players = "none"'), "players must be"),
        (text.replace("players = 10", "player = 10"), "player"),
    ):
        with pytest.raises(StudyError) as refusal:
            read(harm, tmp_path)
        assert reason in str(refusal.value)
        assert "\n" not in str(refusal.value)
    (tmp_path / FILE).write_bytes(b"\xff\xfe")
    with pytest.raises(StudyError, match="is not TOML"):
        read_draft(tmp_path / FILE)
    config = environment_of(LAKE).configuration(
        {"kwargs": {"desc": ["SF", "FG"], "map_name": NONE}}
    )
    with pytest.raises(StudyError, match='the text "none"'):
        draft_text(default_protocol("lake", config, LAKE))


def test_shipped_blocks_are_named_and_a_changed_one_is_written_out(tmp_path):
    named = default_protocol("full", CONFIG, blocks=["demographics", "nasa-tlx"])
    fields = tomllib.loads(draft_text(named))
    assert fields["blocks"] == ["demographics", "nasa-tlx"]
    changed = named.blocks[0].model_copy(update={"title": "You"})
    protocol = default_protocol("full", CONFIG, blocks=[changed, "nasa-tlx"])
    block, name = tomllib.loads(draft_text(protocol))["blocks"]
    assert (block["title"], name) == ("You", "nasa-tlx")
    assert read(draft_text(protocol), tmp_path) == protocol


def test_a_field_that_follows_from_others_follows_them_when_they_are_edited(tmp_path):
    folder = Folder(tmp_path)
    folder.create(default_protocol("small", CONFIG, declarations=DECLARATIONS))
    draft = draft_of(folder.root, "small")
    assert "#outside_ids = []\n" in draft.read_text()
    edit_draft(draft, platform="prolific", recruitment="panel")
    assert folder.draft("small").outside_ids[0] == "PROLIFIC_PID"
    edit_draft(draft, practice={"episodes_to_pass": 2})
    assert folder.draft("small").practice == Practice(episodes_to_pass=2)
