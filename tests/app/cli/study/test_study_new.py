"""From three answers to a draft that freezes: `study new` and `study check`."""

import os
import pty
import re
import subprocess
import sys

import pytest

from humanplay.study.folder import Folder
from humanplay.study.protocol_parts import Declarations
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft

SMALL = ("--size", "7x9", "--warm-up", 2, "--ranked", 6)
FEW = ("--players", 6, "--policy", "frontier-cost")


@pytest.fixture
def study(tmp_path, capsys):
    """`study(...)` runs a command on its own folder: exit code, stdout, stderr."""
    return lambda *args: command(capsys, "study", *args, "--database", tmp_path / "play.db")


def draft(tmp_path):
    return draft_of(tmp_path / "play.db-studies", "mine")


def typed(tmp_path, *lines):
    """What `study new` prints on a terminal at which these lines are typed."""
    ours, theirs = pty.openpty()
    start = [sys.executable, "-c", "from humanplay.cli.main import main; main()", "study", "new"]
    options = ["mine", "--warm-up", "2", "--ranked", "6", "--database", str(tmp_path / "play.db")]
    with subprocess.Popen(
        [*start, *options], stdin=theirs, stdout=subprocess.PIPE, text=True
    ) as process:
        os.write(ours, "".join(f"{line}\n" for line in lines).encode())
        output, _ = process.communicate(timeout=120)
    os.close(ours)
    os.close(theirs)
    assert process.returncode == 0
    return output


def test_three_answers_make_a_draft_and_each_number_of_people_shows_what_it_can_tell(tmp_path):
    output = typed(tmp_path, "9-9-9", "1-1-1 9x13", "frontier", "frontier-cost", "6", "12", "")
    assert output.count("What is played?") == 2, "no such level: asked again"
    assert output.count("With which policies") == 2, "no such policy: asked again"
    few, more = (float(width) for width in re.findall(r"is ±([\d.]+) wide on average", output))
    assert more < few
    assert output.count("is seen in ") == 2
    assert "`humanplay study check mine` lists what is to be written" in output
    protocol = Folder(tmp_path / "play.db-studies").draft("mine")
    assert (protocol.config["level"], protocol.config["rows"]) == ("1-1-1", 9)
    assert (protocol.policies, protocol.players) == (("frontier-cost",), 12)
    assert list(protocol.declarations.model_dump().values()) == [""] * len(
        Declarations.model_fields
    )


def test_another_environment_is_compared_with_nothing_if_that_is_wanted(tmp_path):
    typed(tmp_path, "FrozenLake-v1", "none", "8", "")
    protocol = Folder(tmp_path / "play.db-studies").draft("mine")
    assert (protocol.task, protocol.policies) == ("gymnasium:FrozenLake-v1", ())


def test_check_lists_what_is_to_be_written_and_the_lines_written_so_make_it_freeze(study, tmp_path):
    study("new", "mine", *SMALL, *FEW)
    code, printed, err = study("check", "mine")
    assert (code, err) == (0, "")
    for name, field in Declarations.model_fields.items():
        assert f'  {name} = "..."  # {field.description}\n' in printed
    text = draft(tmp_path).read_text()
    for name in re.findall(r'^  (\w+) = "\.\.\."', printed, re.M):
        assert f'\n{name} = ""\n' in text
        text = text.replace(f'\n{name} = ""\n', f'\n{name} = "none"\n')
    draft(tmp_path).write_text(text)
    assert "To write" not in study("check", "mine")[1]
    code, _, err = study("freeze", "mine", "--underpowered")
    assert (code, err) == (0, "")
    assert "A reviewer will ask" not in study("check", "mine")[1], "nothing can be written any more"


def test_a_line_that_check_prints_answers_what_a_reviewer_will_ask(study, tmp_path):
    declared = ("--declarations", DECLARATIONS_FILE)
    study("new", "mine", *SMALL, *FEW, *declared, "--recruitment", "open")
    questions = re.findall(r"^  (\S.*)\n    (\w+) = (.*)$", study("check", "mine")[1], re.M)
    assert len(questions) == 6
    for question, field, content in questions:
        if field == "assumed_mean":
            edit_draft(draft(tmp_path), assumed_mean=33.0)
        else:
            text = draft(tmp_path).read_text()
            pattern = rf"^{field} = .*$"
            assert len(re.findall(pattern, text, re.M)) == 1, field
            draft(tmp_path).write_text(re.sub(pattern, f"{field} = {content}", text, flags=re.M))
        code, printed, err = study("check", "mine")
        assert (code, err) == (0, "")
        assert question not in printed
    assert "A reviewer will ask" not in printed


def test_blocks_that_are_there_stay_in_the_line_for_more_of_them(study, tmp_path):
    study("new", "mine", *SMALL, *FEW, "--ask", "nasa-tlx", "--ask", "exposure")
    printed = study("check", "mine")[1]
    assert (
        "Of people: who took part; whether they used a tool or an AI; how they decided?" in printed
    )
    assert '    blocks = ["nasa-tlx", "exposure", "demographics", "tools"]\n' in printed


def test_check_says_all_that_freezing_would_refuse_at_once(study, tmp_path):
    study("new", "mine", *SMALL, *FEW, "--platform", "prolific")
    edit_draft(draft(tmp_path), keep_episodes_when_forgotten=True, core_version="0")
    printed = study("check", "mine")[1]
    for words in (
        "people come from Prolific, and nothing leads them back",
        "promises that what was played is erased on request",
        "the protocol is for core version 0",
    ):
        assert re.search(f"Freezing would refuse: .*{words}", printed), words
    assert "recruitment.txt has TODO 3 times" in printed


def test_a_name_that_is_taken_is_refused_before_anything_is_asked(study):
    study("new", "mine", *SMALL, *FEW)
    code, _, err = study("new", "mine")
    assert (code, "there is a study 'mine' already" in err) == (2, True)
