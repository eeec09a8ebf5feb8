"""`study new`, `freeze`, `show` and `preregister` as a researcher meets them."""

import json
import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from humanplay.cli.main import cli
from humanplay.study.folder import Folder
from humanplay.study.policy_episodes import play_policies
from humanplay.task.registration import environment_of
from marsexplorer.config import EnvConfig
from tests.support.command import command, run
from tests.support.declared import DECLARATIONS, DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft

SHORT = [
    "--size",
    "7x9",
    "--warm-up",
    "2",
    "--ranked",
    "6",
    "--players",
    "12",
    "--policy",
    "frontier-cost",
    "--declarations",
    DECLARATIONS_FILE,
]


@pytest.fixture
def study(tmp_path, capsys):
    """`study(...)` runs a command on its own folder: exit code, stdout, stderr."""

    return lambda *args: command(capsys, "study", *args, "--database", tmp_path / "playground.db")


@pytest.fixture(scope="module")
def new_study(tmp_path_factory):
    """A folder with the draft `mine`, for which `study new` plays 200 terrains."""
    folder = tmp_path_factory.mktemp("new")
    assert run("study", "new", "mine", *SHORT, "--database", folder / "playground.db") == 0
    return folder


@pytest.fixture
def drafted(new_study, tmp_path):
    """The draft `mine` lies in the test's folder."""
    shutil.copytree(new_study, tmp_path, dirs_exist_ok=True)


def edit(tmp_path, **changes):
    edit_draft(draft_of(tmp_path / "playground.db-studies", "mine"), **changes)


def test_a_new_study_holds_effects_that_its_players_see_and_freezes(study, tmp_path):
    code, out, err = study("new", "mine", *SHORT)
    assert (code, err) == (0, "")
    draft = Folder(tmp_path / "playground.db-studies").draft("mine")
    assert draft.equivalence_margin is None
    assert draft.power is None
    assert f"better than people by {draft.policy_difference:g} in steps to 99 %" in out
    assert "By 2,000 simulated studies" in out
    assert f"{draft.assumed_terrain_sd:g} between instances (of policy minus people)" in out
    assert "{warm_up} practice terrains" in draft.consent.text
    code, out, err = study("freeze", "mine")
    assert (code, err) == (0, "")
    assert "2 practice terrains and 6 terrains that count" in out
    assert "By 10,000 simulated studies" in out
    frozen = Folder(tmp_path / "playground.db-studies").study("mine").protocol
    assert (frozen.power.studies, frozen.policy_difference) == (10_000, draft.policy_difference)
    assert 0.5 <= frozen.power.deciding_power <= frozen.power.policy_better
    power_sentence = f"is seen in {100 * frozen.power.policy_better:.0f} % of studies"
    assert power_sentence in out
    assert power_sentence in study("preregister", "mine")[1]


def test_a_study_of_arms_freezes_with_the_power_of_its_arms(study, drafted, tmp_path):
    arms = [{"name": "told", "hint": "Walls first."}, {"name": "control"}]
    tested = {"arms": arms, "primary_family": "arms", "policy_difference": None}
    edit(tmp_path, **tested, arm_difference=1)
    code, _, refusal = study("freeze", "mine")
    assert (code, "plan more players, or a larger arm_difference" in refusal) == (2, True), refusal
    edit(tmp_path, arm_difference=30, players=8)
    code, _, refusal = study("freeze", "mine")
    assert (code, "below five people in an arm" in refusal) == (2, True), refusal
    edit(tmp_path, players=12)
    power = study("power", "mine", "--difference", 25)[1]
    assert "Two arms of 6 people each that differ by 25 in steps to 99 %" in power
    code, out, err = study("freeze", "mine")
    assert (code, err) == (0, "")
    frozen = Folder(tmp_path / "playground.db-studies").study("mine").protocol
    assert (frozen.power.policy_better, frozen.policy_difference) == (None, None)
    sentence = (
        "Two arms of 6 people each that differ by 30 in steps to 99 % are told apart in "
        f"{100 * frozen.power.arms_differ:.0f} % of studies: that is the power."
    )
    assert sentence in out
    assert "No instance favours an arm." in out
    assert "of policy minus people" not in out
    text = study("preregister", "mine")[1]
    for words in (sentence, "of each arm too", "every policy plays them too", "For each two arms"):
        assert words in text


def test_arms_without_an_assumption_of_people_are_not_frozen_without_power(study, tmp_path):
    task = 'gymnasium:{"id": "FrozenLake-v1", "bounds": [null, null]}'
    env = task.removeprefix("gymnasium:")
    sizes = SHORT[2:-4]
    assert study("new", "mine", "--env", env, *sizes, *SHORT[-2:])[0] == 0
    arms = [{"name": "told", "hint": "Walls first."}, {"name": "control"}]
    tested = {"arms": arms, "primary_family": "arms", "arm_difference": 0.5}
    edit(tmp_path, **tested, primary_metric="score")
    code, _, refusal = study("freeze", "mine")
    assert (code, "people who left cannot enter the mean without a lowest score" in refusal) == (
        2,
        True,
    ), refusal


def test_the_terrains_spread_is_that_of_the_policies_on_200_other_terrains(
    study, drafted, tmp_path
):
    config = EnvConfig.of("random", (7, 9))
    played = play_policies(
        ("frontier-cost",), environment_of("mars"), config, {seed: seed for seed in range(200)}
    )
    steps = [len(episode.actions) for episode in played]
    draft = Folder(tmp_path / "playground.db-studies").draft("mine")
    assert draft.assumed_terrain_sd == pytest.approx(np.std(steps, ddof=1), rel=0.01)
    edit(tmp_path, assumed_terrain_sd=None)
    (cache_file,) = (tmp_path / "playground.db-studies" / "played").iterdir()
    held = json.loads(cache_file.read_text())
    cache_file.write_text(json.dumps({**held, "steps": [3.0, 5.0]}))
    assert "1.41 between instances" in study("power", "mine")[1], "what was played is kept"


def test_the_power_of_a_draft_is_shown_with_the_way_to_80_percent(study, drafted, tmp_path):
    draft = draft_of(tmp_path / "playground.db-studies", "mine")
    before = draft.read_text()
    code, out, err = study("power", "mine", "--players", 8, "--difference", 12)
    assert (code, err) == (0, "")
    assert "better than people by 12 in steps to 99 % is seen in " in out
    fewest = int(re.search(r"To see more: plan about (\d+) players, for 80 %", out)[1])
    _, more, _ = study("power", "mine", "--players", fewest, "--difference", 12)
    shares = re.search(
        r"is seen in (\d+) % of studies, one that is worse by as much in (\d+) %", more
    )
    assert min(map(int, shares.groups())) > 75
    assert draft.read_text() == before


def test_the_papers_study_comes_with_a_text_to_recruit_with_and_a_page_of_things_to_do(
    study, tmp_path
):
    code, out, err = study("new", "koutras2021", "--policy", "frontier-cost")
    assert (code, err) == (0, "")
    draft = Folder(tmp_path / "playground.db-studies").draft("koutras2021")
    config = draft.env_config
    assert (draft.players, draft.warm_up, draft.ranked) == (10, 15, 30)
    assert (config.level, config.rows, config.cols) == ("random", 21, 21)
    folder = tmp_path / "playground.db-studies" / "koutras2021"
    asked, todo = folder / "recruitment.txt", (folder / "checklist.md").read_text()
    assert str(asked) in out
    assert str(folder / "checklist.md") in out
    assert "Each link is for one person" in asked.read_text()
    assert "{" not in todo
    assert len(todo.splitlines()) < 60, "one page"
    rehearsed = "--declarations", folder / "rehearsal.toml"
    few = "--players", "4", "--policy", "frontier-cost"
    assert study("new", "rehearsal", *few, *rehearsed)[0] == 0
    rehearsal = draft_of(tmp_path / "playground.db-studies", "rehearsal")
    edit_draft(rehearsal, players=7, ranked=3)
    assert study("freeze", "rehearsal", "--underpowered")[0] == 0
    asked = rehearsal.with_name("recruitment.txt")
    assert "for 7 people" in asked.read_text()
    assert "about 20 minutes" in asked.read_text(), "as the draft was edited"
    commands = re.findall(r"`humanplay ([^`]+)`", todo)
    assert len(commands) > 9
    for line in commands:
        words = line.split()
        group = [*words[: 2 if words[0] == "study" else 1], "--help"]
        assert CliRunner().invoke(cli, group).exit_code == 0, line


def test_a_draft_is_shown_as_participants_would_read_it(study, drafted, tmp_path):
    edit(tmp_path, ranked=9)
    code, out, _ = study("show", "mine")
    assert (code, "{ranked}" in out) == (0, False)
    assert "2 practice terrains and 9 terrains that count" in out


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"players": 3}, "No interval and no p is given below five people"),
        ({"players": 5, "policy_difference": 8}, "for: plan about "),
        ({"policy_difference": 0.5}, "or more as policy_difference, for "),
        ({"consent": {"text": "You play 6 rounds."}}, "consent.text counts by hand: '6 rounds'"),
        ({"consent": {"text": "{runds}"}}, "unknown placeholder {runds}"),
    ],
)
def test_what_cannot_be_frozen_is_refused_with_the_way_out(
    study, drafted, tmp_path, changes, reason
):
    edit(tmp_path, **changes)
    code, _, err = study("freeze", "mine")
    assert (code, reason in err, err.count("\n")) == (2, True, 1), err
    assert Folder(tmp_path / "playground.db-studies").status("mine") == "draft"


def test_a_study_that_leaves_declarations_empty_is_told_which_and_not_frozen(study, tmp_path):
    study("new", "mine", *SHORT[:-2])
    for wrong in (
        {},
        {"pilots": " ", "ethics_review": "TODO: ask the board", "population": "TBD."},
    ):
        declared = {**DECLARATIONS, **wrong} if wrong else {}
        edit(tmp_path, declarations=declared)
        code, _, err = study("freeze", "mine")
        assert (code, err.count("\n")) == (2, 1), err
        assert {name for name in DECLARATIONS if name in err.split(":")[1]} == set(
            wrong or DECLARATIONS
        )
        assert "protocol.toml" in err
        assert "--declarations FILE" in err
        assert Folder(tmp_path / "playground.db-studies").status("mine") == "draft"
    edit(tmp_path, declarations={**DECLARATIONS, "pilots": "none"})
    assert study("freeze", "mine")[0] == 0


def test_people_who_leave_are_part_of_what_freezing_refuses(study, drafted, tmp_path):
    edit(tmp_path, assumed_leaver_share=0.4)
    code, _, err = study("freeze", "mine")
    assert (code, "Below 50 % a study more likely misses" in err) == (2, True), err
    assert study("freeze", "mine", "--underpowered")[0] == 0
    frozen = Folder(tmp_path / "playground.db-studies").study("mine").protocol
    assert (frozen.assumed_leaver_share, frozen.power.deciding_power < 0.5) == (0.4, True)


def test_a_study_that_can_see_no_difference_is_told_to_plan_more_of_both(study, tmp_path):
    study("new", "mine", "--size", "9x13", "--warm-up", "2", "--ranked", "5", "--players", "5")
    edit(tmp_path, declarations=DECLARATIONS)
    _, _, err = study("freeze", "mine")
    assert "No difference, however large, is seen in 60 % of studies of this size." in err
    assert ": plan more players and more ranked episodes; or freeze with --underpowered" in err


def test_a_study_that_compares_no_policy_says_that_none_is_tested(study, drafted, tmp_path):
    edit(tmp_path, policies=["random"])
    _, out, _ = study("power", "mine")
    assert "No policy is tested against people, so no difference is looked for." in out


def test_a_file_of_declarations_with_a_wrong_key_is_refused(study, tmp_path):
    path = tmp_path / "declared.toml"
    path.write_text('poplation = "adults"')
    code, _, err = study("new", "mine", *SHORT, "--declarations", path)
    reason = f"{path} declares 'poplation', which is none of contact, retention, population, "
    assert (code, reason in err, err.count("\n")) == (2, True, 1), err
    path.write_text("population = 3")
    code, _, err = study("new", "mine", *SHORT, "--declarations", path)
    assert (code, "population must be" in err) == (2, True), err
    assert Folder(tmp_path / "playground.db-studies").names() == []


def test_the_preregistration_names_everything_that_is_fixed(study, drafted, tmp_path):
    asked = {"recruitment": "panel", "outside_ids": ["PROLIFIC_PID"], "blocks": ["demographics"]}
    edit(tmp_path, **asked)
    code, draft, _ = study("preregister", "mine")
    assert (code, "> **DRAFT.**" in draft, "protocol hash" in draft) == (0, True, False)
    assert draft.count("TO BE STATED") == 1
    study("freeze", "mine")
    frozen = Folder(tmp_path / "playground.db-studies").study("mine")
    code, out, _ = study("preregister", "mine", "--out", tmp_path / "mine.md")
    assert (code, "TO BE STATED" in out) == (0, True)
    text = (tmp_path / "mine.md").read_text()
    for phrase in (
        frozen.protocol_hash, frozen.commitment, "Planned: 12 people who finish. Through a recruiting panel",
        "| `strict` | who ended every ranked episode", "never called flat", "Holm's method",
        "rows of a balanced Latin square",
        *DECLARATIONS.values(), "(`demographics`), before the first episode:\n  - ",
        "6 ranked episodes", "What is not preregistered", "empirical likelihood on the means",
    ):  # fmt: skip
        assert phrase in text, phrase
    assert "DRAFT" not in text
    assert frozen.secret.hex() not in text
    assert max(map(len, text.splitlines())) < 2000


def test_a_preregistration_says_when_figures_are_seen(study, drafted, tmp_path):
    assert "shows no figure of people while the study is open" in study("preregister", "mine")[1]
    code, _, err = study("preregister", "mine", "--out", tmp_path / "no" / "such.md")
    assert (code, "cannot write" in err) == (1, True)


def test_a_level_is_refused_of_an_environment_without_levels(study):
    code, _, err = study("new", "lake", "--env", "FrozenLake-v1", "--level", "1-1-1")
    assert code == 2
    assert "FrozenLake-v1 has no levels and sizes: leave --level and --size out" in err
