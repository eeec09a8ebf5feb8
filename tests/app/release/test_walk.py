"""A study from `study new` to `reproduce`, its figures from released files alone."""

import csv
import json
import shutil

import pytest

from humanplay.task.registration import environment_of
from humanplay.web.simulate import NoisyPolicy
from tests.support.command import run
from tests.support.declared import DECLARATIONS_FILE
from tests.support.drafts import draft_of, edit_draft
from tests.support.independent_figures import figures
from tests.support.stored_studies import freezing_at
from tests.support.study import Person

RANKED, WITHDRAWS, LEAVES, GIVES_UP, ERASED = 6, 7, 8, 9, 0
HOURS_MS = 3 * 3_600_000
"""From the freezing to the closing, so that nobody is interrupted by it."""


def take_part(server, number):
    """Let a person finish, give all up, or withdraw or leave after two terrains."""
    person = Person(server, "walk", client=server.page())
    person._policy = NoisyPolicy(environment_of("mars"), "frontier-cost", number / 20, None, number)
    person.to_warm_up()
    ended = 0
    while person.me()["stage"] in ("warm_up", "ranked"):
        is_ranked = person.where["stage"] == "ranked"
        if is_ranked and number in (WITHDRAWS, LEAVES) and ended == 2:
            break
        person.call("next")
        if is_ranked and number == GIVES_UP:
            frame = person.me()["about"]["frame"]
            person.call("give-up", {"episode": frame["episode"], "step": frame["step"]})
        else:
            person.play()
        ended += is_ranked
    if number == WITHDRAWS:
        person.call("withdraw")
    return person.where["participant"]


@pytest.fixture
def released(tmp_path, serve):
    database = ("--database", tmp_path / "playground.db")
    sizes = ("--size", "7x9", "--warm-up", 1, "--ranked", RANKED, "--players", 10)
    plan = (*sizes, "--recruitment", "open", "--policy", "frontier-cost")
    assert run("study", "new", "walk", *plan, "--declarations", DECLARATIONS_FILE, *database) == 0
    draft = draft_of(tmp_path / "playground.db-studies", "walk")
    edit_draft(draft, debrief_policy="frontier-cost")
    server = serve()
    server.clock.set_back_ms = HOURS_MS
    with freezing_at(server.clock.now_ms()):
        assert run("study", "freeze", "walk", "--underpowered", *database) == 0
    people = [take_part(server, number) for number in range(10)]
    server.stop()
    assert run("study", "close", "walk", "--yes", *database) == 0
    assert run("forget", people[ERASED], "--yes", *database) == 0
    assert run("report", "--study", "walk", "--json", tmp_path / "report.json", *database) == 0
    assert run("verify", *database) == 0
    assert run("release", "--study", "walk", "--out", tmp_path / "walk-1", *database) == 0
    assert run("reproduce", tmp_path / "walk-1") == 0
    return tmp_path / "walk-1"


def differences(recomputed, release):
    """Return which figures of a release's report are not those that were found."""
    (group,) = json.loads((release / "report.json").read_text())["groups"]
    wanted = {row["status"]: row["people"] for row in group["statuses"]}
    wrong = [] if recomputed["statuses"] == wanted else ["statuses"]
    for figure in group["figures"]:
        for metric, (mean, ends) in recomputed.get(figure["name"], {}).items():
            if mean != pytest.approx(figure[metric]["mean"], rel=1e-9):
                wrong.append((figure["name"], metric, "mean"))
            if ends != pytest.approx(figure[metric]["interval"], abs=1e-6):
                wrong.append((figure["name"], metric, "interval"))
    return wrong


def test_an_independent_script_finds_the_figures_of_a_walked_study(released, tmp_path):
    recomputed = figures(released)
    assert recomputed["statuses"] == {
        "finished": 6,
        "gave_up": 1,
        "withdrew": 1,
        "left": 1,
        "erased": 1,
    }
    assert differences(recomputed, released) == []

    shutil.copytree(released, tmp_path / "changed")
    path = tmp_path / "changed/csv/episodes.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    ranked = next(row for row in rows if row["phase"] == "ranked" and not row["lowest"])
    ranked["score"] = str(float(ranked["score"]) + 0.001)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0].keys())
        writer.writeheader()
        writer.writerows(rows)
    assert ("everybody", "score", "mean") in differences(figures(tmp_path / "changed"), released)
