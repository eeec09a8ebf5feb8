"""The examination finds what is odd; its even twin and Gymnasium's own pass."""

import json
import re
import tomllib

import pytest

from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium import doctor
from humanplay.tasks.gymnasium.description import Description, read_description
from humanplay.tasks.gymnasium.doctor import examine
from humanplay.tasks.gymnasium.hashed_episodes import HashedEpisode
from humanplay.tasks.gymnasium.proposals import proposals_of
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.odd_environments import REASONS

pytestmark = pytest.mark.usefixtures("executed_preparers")
ODD = "tests.support.odd_environments"
EXPECTED = {
    "python": ("fresh process", "observation", "random numbers"),
    "numpy": ("fresh process", "observation", "random numbers"),
    "clock": ("fresh process", "observation", "clock"),
    "sets": ("hash seed", "observation", "sets"),
    "pair": ("hash seed", "observation", "sets"),
    "mask": ("fresh process", "allowed actions", "random numbers"),
    "module": ("after other episodes", "observation", "module"),
    "counter": ("after other episodes", "observation", "counter"),
    "file": ("fresh process", "observation", "files"),
    "render": ("without rendering", "observation", "render"),
    "picture": ("fresh process", "picture", "clock"),
    "late": ("fresh process", "observation", "clock"),
}
"""Reason -> the variant that is named first, the part that differs, a word of the cause."""
REPEATS = {
    "python",
    "numpy",
    "clock",
    "module",
    "file",
    "late",
    "counter",
    "sets",
    "mask",
    "picture",
}
"""Reasons that are found by the same variant as another one, or by a test below: each examination starts ten processes."""


def examined(kind, reason):
    steps = 1100 if reason == "late" else 40
    return examine(f"gymnasium:{ODD}:{kind}-{reason}-v0", seeds=1, steps=steps)


@pytest.mark.parametrize(
    "reason",
    [pytest.param(odd, marks=[pytest.mark.long] * (odd in REPEATS)) for odd in EXPECTED],
)
def test_what_is_odd_is_named(reason):
    examination = examined("Odd", reason)
    first = examination.differences[0]
    variant, part, cause = EXPECTED[reason]
    assert (first.variant, first.part) == (variant, part)
    assert cause in examination.verdict
    assert (first.step > 1000) == (reason == "late")


def test_short_episodes_that_reach_the_next_first_seed_are_not_compared_with_its_own(monkeypatch):
    played = [
        HashedEpisode(first_seed, 10_000, [["-1", observed, "", "", "", None]], picture=(1, 1))
        for first_seed, observed in ((0, "of the last episode"), (10_000, "of the first"))
    ]
    monkeypatch.setattr(doctor, "_play", lambda request, folder, variables: played)
    assert examine(f"gymnasium:{ODD}:Odd-sets-v0").differences == ()


def test_what_heeds_the_seed_of_make_alone_is_told_what_to_write(capsys):
    env = f"{ODD}:Heeds-make-alone-v0"
    code, printed, _ = command(capsys, "doctor", env, "--seeds", 2, "--steps", 30)
    assert code == 1
    assert 'write `seeding = "kwarg"` into its file' in printed.splitlines()[0]
    description = Description(id=env, seeding="kwarg").told
    assert examine(f"gymnasium:{description}", seeds=1, steps=30).differences == ()


def test_what_would_take_longer_than_it_may_is_shortened_and_says_so(capsys):
    """Each of 2,000 moves begins an episode, which takes 0.1 s, seven times at least."""
    env = f"{ODD}:Slow-reset-v0"
    code, printed, shortened = command(capsys, "doctor", env, "--seeds", 1, "--minutes", 0.1)
    minutes, steps = re.search(
        r"would take up to (\d+) minutes: (\d+) moves for each seed are played; --minutes \1 plays",
        shortened,
    ).groups()
    assert int(minutes) >= 15
    assert 20 <= int(steps) < 200
    assert (code, f"no difference in {steps} steps" in printed) == (0, True)


def test_what_is_no_environment_of_gymnasium_is_refused_by_its_name(capsys):
    code, printed, refusal = command(capsys, "doctor", "mars")
    assert (code, printed) == (2, "")
    assert "expected an environment of Gymnasium's; MarsExplorer is a world of its own" in refusal


@pytest.mark.parametrize(
    ("env", "actions", "words"),
    [
        ("tests.support.four_ways:Field", ["down", "left", "right", "up"], "Bring the square"),
        ("tests.support.four_ways:Walled", ["down", "left", "right", "up"], "Bring the square"),
        ("tests.support.four_ways:Letters", ["up", "1", "down"], "Move the letter"),
        ("tests.support.own_environment:Line", ["left", "right"], "A marker on a line"),
    ],
)
def test_a_file_proposes_arrows_for_what_moves_a_marker(capsys, tmp_path, env, actions, words):
    code, printed, _ = command(capsys, "doctor", env, "--toml")
    fields = tomllib.loads(printed)
    assert (code, fields["actions"]) == (0, actions)
    moved = {f"Arrow{name.capitalize()}": name for name in actions if name.isalpha()}
    assert moved.items() <= fields["keys"].items()
    assert fields["instructions"].startswith(words)
    proposed = {line.split(" = ")[0] for line in printed.splitlines() if "# proposed: " in line}
    assert {"actions", "instructions", "agents_see"} == proposed
    path = tmp_path / "env.toml"
    path.write_text(printed)
    assert environment_of(f"gymnasium:{read_description(path).told}").actions == tuple(actions)


def test_a_file_is_printed_of_what_cannot_be_drawn(capsys):
    code, printed, _ = command(capsys, "doctor", "tests.support.four_ways:Faint", "--toml")
    fields = tomllib.loads(printed)
    assert (code, fields["actions"]) == (0, ["0", "1", "2", "3"])
    assert fields["instructions"] == "Bring the square into the corner, in numbers from 0 to 1."
    assert fields["agents_see"] == "2 whole numbers"


def test_no_further_state_is_tried_after_a_time(monkeypatch):
    field = environment_of("gymnasium:tests.support.four_ways:Field").configuration({})
    assert "actions" in proposals_of(field.description, field.make)
    monkeypatch.setattr("humanplay.tasks.gymnasium.proposals.LONGEST_S", -1.0)
    assert "actions" not in proposals_of(field.description, field.make)


@pytest.mark.long
@pytest.mark.parametrize("reason", REASONS)
def test_an_even_twin_passes(reason):
    even = examined("Even", reason)
    assert (even.differences, even.used) == ((), None)
    assert f"no difference in {even.steps:,} steps" in even.verdict


@pytest.mark.long
def test_a_state_that_reset_leaves_is_reported_and_does_not_count():
    examination = examined("Odd", "reset")
    assert examination.differences == ()
    assert (examination.used.variant, examination.used.step) == ("used environment", 0)


@pytest.mark.parametrize(
    "env",
    [pytest.param(env_id, marks=pytest.mark.long) for env_id in ("CartPole-v1", "FrozenLake-v1")],
)
def test_gymnasiums_own_pass_with_their_costs(env, capsys):
    code, printed, _ = command(capsys, "doctor", env, "--seeds", 2, "--steps", 30, "--json")
    examination = json.loads(printed)
    assert (code, examination["exact"], examination["steps"]) == (0, True, 60)
    assert min(examination["step_ms"], examination["picture_ms"], *examination["picture"]) > 0
    assert examination["picture_bytes"] > 100
    assert all(examination["keys"].values())


def test_what_differs_ends_with_1_and_what_cannot_be_played_with_2(capsys):
    odd = f"{ODD}:Odd-python-v0"
    code, printed, _ = command(capsys, "doctor", "--table", odd, "--seeds", 1, "--steps", 3)
    head, _, row = printed.splitlines()
    assert code == 1
    assert row.startswith(
        f"| {odd} | observation differs at seed 0, step 1 (fresh process); likely cause: "
        "random numbers of Python or numpy that the seed of reset does not reach"
    )
    assert row.count("|") == head.count("|")
    code, printed, _ = command(capsys, "doctor", "--table", "Nothing-v0", "mars", "Pendulum-v1")
    assert code == 2
    for line, words in zip(
        printed.splitlines()[2:], ("no environment", "Gymnasium's", "discrete"), strict=True
    ):
        assert "| cannot be played: " in line
        assert words in line
    for env, words in {"Nothing-v0": "knows no environment", "Pendulum-v1": "discrete"}.items():
        code, printed, message = command(capsys, "doctor", env)
        assert (code, printed) == (2, "")
        assert words in message


@pytest.mark.parametrize(
    ("how", "score", "wrong"), [("nan", "return", "its reward is nan"), ("told", "info.coins", "its info.coins is inf")]
)  # fmt: skip
def test_what_is_not_finite_is_found(how, score, wrong):
    description = Description(
        id="tests.support.environments:Failing-v0", kwargs={"how": how}, score=score
    ).told
    with pytest.raises(ValueError, match=wrong):
        examine(f"gymnasium:{description}", seeds=1, steps=30)


def test_no_study_is_frozen_of_what_does_not_pass(capsys, tmp_path, briefly_examined):
    database = ("--database", tmp_path / "play.db")
    env = ("--env", f"{ODD}:Odd-counter-v0", "--declarations", DECLARATIONS_FILE)
    assert command(capsys, "study", "new", "odd", *env, *database)[0] == 0
    code, _, message = command(capsys, "study", "freeze", "odd", "--underpowered", *database)
    assert code == 2
    assert "does not follow from seed and actions" in message
    assert "a counter kept on the class" in message
    assert "humanplay doctor" in message
    assert not (tmp_path / "play.db-studies" / "odd" / "secret").exists()
