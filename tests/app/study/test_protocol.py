"""A study before anybody plays: protocol, seeds, freezing and closing."""

import hashlib
import hmac
import itertools
import json
import os
import shutil
import stat
from pathlib import Path

import pytest

from humanplay.study.folder import Folder, StudyError
from humanplay.study.protocol import canonical, default_protocol, parse_protocol, protocol_hash
from humanplay.study.seeds import balanced_order, commitment, seed
from humanplay.study.templates import fill
from humanplay.study.translation import with_texts
from marsexplorer.config import CORE_VERSION, EnvConfig
from marsexplorer.policies import find_file
from tests.support.command import command
from tests.support.declared import DECLARATIONS, DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft

SMALL = EnvConfig.of("random", (7, 9))


def small(name="small", **rest):
    return default_protocol(
        name,
        SMALL,
        **{"warm_up": 2, "ranked": 3, "players": 2, "declarations": DECLARATIONS, **rest},
    )


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path / "playground.db-studies")


@pytest.fixture
def frozen(folder):
    folder.create(small())
    folder.freeze("small")
    return folder


def test_the_defaults_are_the_papers_protocol():
    protocol = default_protocol("paper", EnvConfig.of("random", 21))
    assert (protocol.warm_up, protocol.ranked, protocol.players, protocol.break_every) == (
        15,
        30,
        10,
        10,
    )
    assert (protocol.env_config, protocol.core_version) == (
        EnvConfig.of("random", 21),
        CORE_VERSION,
    )
    assert len(protocol.questions) == 3
    assert "15 practice terrains and 30 terrains" in fill(protocol).consent.text
    assert protocol.consent.text.count("\n\n") == 5


def test_the_hash_is_that_of_sorted_json_without_spaces_and_changes_with_any_field():
    protocol = small(title="Größe – 🚀")
    raw = json.loads(canonical(protocol))
    text = json.dumps(raw, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()
    assert canonical(protocol) == text
    assert protocol_hash(protocol) == hashlib.sha256(text).hexdigest()
    assert parse_protocol(raw) == protocol
    changed = {
        "ranked": 4,
        "consent": {"version": "2", "text": "yes"},
        "equivalence_margin": 5.5,
        "outside_ids": ["ID"],
        "declarations": {**DECLARATIONS, "pilots": "one of three people"},
    }
    hashes = {
        protocol_hash(parse_protocol({**raw, name: value})) for name, value in changed.items()
    }
    assert len(hashes | {protocol_hash(protocol)}) == 6


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"ranked": 0}, "ranked must be at least 1, got 0"),
        ({"name": "../x"}, "name"),
        ({"config": {"level": "8-8-8"}}, "no level '8-8-8'"),
        ({"config": {"hills": 3}}, "unexpected keyword argument 'hills'"),
        ({"config": {"level": "map"}}, "of which all cells count; got 'map'"),
        ({"config": {"level": "cave"}}, "of which all cells count; got 'cave'"),
        ({"config": {"rows": 200}}, "at most 128 cells a side, got 200x21"),
        (
            {"questions": [{"question": "?", "choices": ["a", "b"], "answer": 2}]},
            "index of a choice, 0 to 1, got 2",
        ),
        ({"platform": "prolific"}, "recruitment must be panel"),
        (
            {"platform": "sona", "recruitment": "panel", "outside_ids": ["id"]},
            "sona sends survey_code",
        ),
        ({"platform": "mail"}, "platform"),
        ({"outside_ids": ["A", "A"]}, "must differ"),
        ({"rankde": 3}, "rankde"),
        ({"exclusion": {"mine": {"weather": True}}}, "weather"),
        ({"policy_hashes": {"ppo": "de42"}}, "policy_hashes"),
    ],
)
def test_a_wrong_field_is_named(wrong, reason):
    with pytest.raises(StudyError, match="the protocol is not valid") as error:
        parse_protocol({**json.loads(canonical(small())), **wrong})
    assert reason in str(error.value)
    assert "default" not in str(error.value)


def test_seeds_are_the_first_53_bits_of_an_hmac():
    secret, digest = bytes(range(32)), "ab" * 32
    for label in ("ranked", "warm-up"):
        for i in (0, 1, 29):
            full = hmac.new(secret, f"{digest}|{label}|{i}".encode(), "sha256").hexdigest()
            assert f"{seed(secret, digest, label, i):053b}" == f"{int(full, 16):0256b}"[:53]
    assert seed(secret, digest, "ranked", 0) == 7860817211655972
    assert commitment(secret) == hashlib.sha256(secret).hexdigest()


def test_freezing_fixes_protocol_and_secret_and_closing_reveals_it(folder):
    path = folder.create(small())
    assert (folder.status("small"), folder.names()) == ("draft", ["small"])
    with pytest.raises(
        StudyError, match="is a draft: freeze it first with `humanplay study freeze small`"
    ):
        folder.study("small")
    study = folder.freeze("small")
    hashes = {
        "ppo": hashlib.sha256(find_file("ppo").read_bytes()).hexdigest()
    }  # the other policies are rules
    assert (folder.status("small"), study.is_open, study.protocol) == (
        "open",
        True,
        with_texts(small(policy_hashes=hashes), path.parent),
    )
    frozen_json = json.loads((path.parent / "frozen.json").read_text())
    assert set(frozen_json) == {
        "protocol_hash",
        "commitment",
        "frozen_at",
        "core_version",
        "software_version",
        "examined",
    }
    assert frozen_json["commitment"] == hashlib.sha256(study.secret).hexdigest()
    secret = path.parent / "secret"
    assert (len(secret.read_text().strip()), stat.S_IMODE(secret.stat().st_mode)) == (64, 0o600)
    protocol_json = (path.parent / "protocol.json").read_bytes()
    assert hashlib.sha256(protocol_json).hexdigest() == frozen_json["protocol_hash"]
    assert study.secret.hex() not in protocol_json.decode() + json.dumps(frozen_json) + repr(study)
    assert len({*study.seeds()}) == 5
    closed = folder.close("small")
    assert (folder.status("small"), closed.is_open, closed.secret) == (
        "closed",
        False,
        study.secret,
    )
    assert json.loads((path.parent / "closed.json").read_text())["secret"] == study.secret.hex()


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # six lines close no files
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_anyone_can_recheck_a_closed_study_with_the_lines_of_the_guide(
    tmp_path, monkeypatch, capsys
):
    text = (Path(__file__).parents[3] / "docs" / "how-a-study-works.md").read_text(encoding="utf-8")
    lines = text.split("```python\n")[1].split("```")[0]
    folder = Folder(tmp_path / "data" / "playground.db-studies")
    folder.create(small("pilot", title="Größe"))
    folder.freeze("pilot")
    study = folder.close("pilot")
    monkeypatch.chdir(tmp_path)
    exec(lines, {})
    assert json.loads(capsys.readouterr().out) == study.seeds()[:3]
    (folder.path("pilot") / "closed.json").write_text(json.dumps({"secret": "00" * 32}))
    with pytest.raises(AssertionError):
        exec(lines, {})


def thaw(folder):
    path = folder.path("small") / "protocol.json"
    path.write_text(path.read_text().replace('"ranked":3', '"ranked":4'))


def lose_the_secret(folder):
    (folder.path("small") / "secret").unlink()


def swap_the_secret(folder):
    (folder.path("small") / "secret").write_text("00" * 32)


def break_the_file(folder):
    (folder.path("small") / "frozen.json").write_text("{")


@pytest.mark.parametrize(
    ("harm", "reason"),
    [
        (thaw, "thawed protocol"),
        (lose_the_secret, "damaged"),
        (swap_the_secret, "is not the one committed to"),
        (break_the_file, "is not JSON"),
    ],
)
def test_a_frozen_study_that_was_touched_is_refused(frozen, harm, reason):
    assert frozen.study("small").is_open
    harm(frozen)
    with pytest.raises(StudyError, match=reason):
        frozen.study("small")


def test_a_draft_that_is_edited_once_it_is_frozen_changes_nothing(frozen):
    study = frozen.study("small")
    edit_draft(draft_of(frozen.root, "small"), ranked=4)
    assert Folder(frozen.root).study("small") == study
    assert frozen.draft("small") == study.protocol


def test_mistakes_are_said_in_one_sentence(frozen):
    for act, sentence in (
        (lambda: frozen.study("none"), r"no study 'none' in .*; there are: small"),
        (lambda: frozen.path("a/b"), "a study's name is"),
        (lambda: frozen.create(small()), "there is a study 'small' already"),
        (lambda: frozen.freeze("small"), "is frozen already"),
    ):
        with pytest.raises(StudyError, match=sentence):
            act()
    frozen.close("small")
    with pytest.raises(StudyError, match="is closed already, since"):
        frozen.close("small")
    frozen.create(small("older", core_version="0"))
    with pytest.raises(StudyError, match="for core version 0, this is version 1"):
        frozen.freeze("older")
    frozen.create(small("odd", policies=("ppo9",)))
    with pytest.raises(StudyError, match="policy 'ppo9' cannot be loaded"):
        frozen.freeze("odd")
    assert frozen.status("odd") == "draft"
    (frozen.root / "other").mkdir()
    shutil.copy(draft_of(frozen.root, "small"), draft_of(frozen.root, "other"))
    with pytest.raises(StudyError, match="names the study 'small'"):
        frozen.draft("other")


def test_a_freeze_cut_short_leaves_a_draft(folder, monkeypatch):
    folder.create(small())
    monkeypatch.setattr("humanplay.study.folder.version", lambda name: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        folder.freeze("small")
    monkeypatch.undo()
    assert folder.status("small") == "draft"
    assert folder.freeze("small").is_open


def run(capsys, *args):
    return command(capsys, "study", *args)


def test_the_command_leads_from_a_draft_to_a_closed_study(tmp_path, capsys):
    at = ["--database", str(tmp_path / "playground.db")]
    short = [
        "--size",
        "7x9",
        "--warm-up",
        "2",
        "--ranked",
        "3",
        "--players",
        "2",
        "--outside-id",
        "PID",
        "--policy",
        "frontier-cost",
        "--declarations",
        str(DECLARATIONS_FILE),
    ]
    code, out, err = run(capsys, "new", "mine", *short, *at)
    assert (code, err) == (0, "")
    assert "study freeze mine" in out
    code, out, _ = run(capsys, "show", "mine", *at)
    assert code == 0
    assert "draft" in out
    code, out, _ = run(capsys, "freeze", "mine", "--underpowered", *at)
    assert code == 0
    study = Folder(tmp_path / "playground.db-studies").study("mine")
    assert (study.protocol.outside_ids, study.protocol.ranked) == (("PID",), 3)
    assert study.commitment in out
    assert study.secret.hex() not in out
    assert study.secret.hex() not in run(capsys, "show", "mine", *at)[1]
    code, out, _ = run(capsys, "close", "mine", "--yes", *at)
    assert code == 0
    assert study.secret.hex() in out
    assert not (tmp_path / "playground.db").exists()
    code, out, _ = run(capsys, "list", *at)
    assert [word for word in ("mine", "closed") if word not in out] == []


@pytest.mark.parametrize(
    ("args", "code", "sentence"),
    [
        (["freeze", "none"], 2, "no study 'none'"),
        (["show", "none"], 2, "no study 'none'"),
        (["new", "Bad Name"], 2, "a study's name is 1 to 40 small letters"),
        (["new", "x", "--ranked", "0"], 2, "ranked"),
        (["new", "x", "--level", "9-9-9"], 2, "no level '9-9-9'"),
        (["new", "x", "--size", "200"], 2, "at most 128 cells a side"),
        (["new", "x", "--size", "wide"], 2, "expected a side like 21"),
        (["list", "--sort"], 2, "No such option"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_sentence(tmp_path, capsys, args, code, sentence):
    result = run(capsys, *args, "--database", str(tmp_path / "playground.db"))
    assert (result[0], sentence in result[2], result[2].count("\n")) == (code, True, 1), result[2]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_named(tmp_path, capsys):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    code, _, err = run(capsys, "new", "mine", "--database", str(locked / "playground.db"))
    assert (code, "cannot write" in err, "--database" in err) == (1, True, True)


def test_a_file_in_the_folders_place_is_named(tmp_path, capsys):
    (tmp_path / "playground.db-studies").write_text("not a folder")
    code, _, err = run(capsys, "new", "mine", "--database", str(tmp_path / "playground.db"))
    assert (code, "cannot write" in err, err.count("\n")) == (1, True, 1)


@pytest.mark.parametrize("ranked", [1, 2, 5, 8])
def test_each_terrain_comes_equally_often_at_each_position_of_a_whole_square(ranked):
    square = [balanced_order(b"s" * 32, "h", "human", number, ranked) for number in range(ranked)]
    assert all(
        sorted(line) == list(range(ranked)) for line in [*square, *zip(*square, strict=True)]
    )
    if ranked % 2 == 0:
        pairs = [pair for line in square for pair in itertools.pairwise(line)]
        assert len(set(pairs)) == len(pairs) == ranked * (ranked - 1)


def test_the_square_follows_from_the_secret_and_is_another_for_scripts_and_for_the_next_participants():
    def square(secret=b"s" * 32, digest="h", group="human", first=0):
        return tuple(
            tuple(balanced_order(secret, digest, group, first + number, 6)) for number in range(6)
        )

    assert square() == square()
    others = (
        square(),
        square(b"t" * 32),
        square(digest="i"),
        square(group="script"),
        square(first=6),
    )
    assert len(set(others)) == len(others)
    assert balanced_order(bytes(range(32)), "ab" * 32, "human", 7, 6) == [4, 0, 2, 5, 1, 3]
