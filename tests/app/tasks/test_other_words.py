"""A study of another environment says no word of MarsExplorer's world."""

import json
import re
from html import unescape

import pytest

from humanplay.study.folder import Folder
from humanplay.web.api_docs import EXAMPLE
from humanplay.web.simulate import Participant, RandomMoves
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.recorded import alter, ask
from tests.support.words_of_mars import words_of_mars

LINE = """
id = "tests.support.own_environment:Line"
title = "Corridor"
instructions = "Go to the right end."
max_steps = 12
bounds = [-1.2, 1]
"""


def test_the_api_s_page_speaks_of_no_other_world_and_its_example_plays_it(serve, capsys):
    server = serve(task="gymnasium:FrozenLake-v1")
    page = server.client().get("/docs").text
    # in the fields of every world an instance is a terrain, and whoever moves drives
    calls = re.sub(
        r"terrains?|dr(ove|iv(e|en|es))\b|discovered", "", unescape(re.sub("<[^>]+>", "", page))
    )
    assert "r_invalid" not in calls
    assert words_of_mars(calls) == []
    exec(compile(EXAMPLE.replace("http://127.0.0.1:8000", server.url), "/docs", "exec"), {})
    assert re.fullmatch(
        r"(terminated|truncated|succeeded|failed) [01]\.0\n", capsys.readouterr().out
    )


@pytest.fixture(params=["FrozenLake", "own"])
def outputs(request, serve, tmp_path, capsys, briefly_examined):
    """What the commands of a study print and write, by name."""
    env = "FrozenLake-v1"
    if request.param == "own":
        env = tmp_path / "corridor.toml"
        env.write_text(LINE)
    database = ("--database", tmp_path / "playground.db")
    texts = {}

    def run(name, *arguments, of=database):
        code, *printed = command(capsys, *arguments, *of)
        assert code == 0, printed
        texts[name] = "\n".join(printed)

    sizes = ("--warm-up", 1, "--ranked", 3, "--players", 2, "--recruitment", "open")
    run("new", "study", "new", "any", "--env", env, *sizes, "--declarations", DECLARATIONS_FILE)
    run("freeze", "study", "freeze", "any", "--underpowered")
    run("preregister", "study", "preregister", "any", "--out", tmp_path / "preregistration.md")
    study = Folder(tmp_path / "playground.db-studies").study("any")
    server = serve(task=study.protocol.task)
    for number in range(2):
        policy = RandomMoves(study.protocol.environment.keys, number)
        person = Participant(server.page(), "any", policy, server.clock, number)
        person.call("join")
        while person.where["stage"] != "complete":
            person.take_step()
            person.me()
    server.stop()
    assert alter(tmp_path / "playground.db", "UPDATE episodes SET failure = '/home/author'")
    run("close", "study", "close", "any", "--yes")
    run("report", "report", "--study", "any", "--html", tmp_path / "report.html")
    run("release", "release", "--study", "any", "--out", tmp_path / "bundle")
    assert ask(tmp_path / "bundle/study.sqlite", "SELECT DISTINCT failure FROM episodes") == [
        (None,)
    ]
    run("verify", "verify")
    run("reproduce", "reproduce", tmp_path / "bundle", of=())
    for path in tmp_path.rglob("*"):
        if path.suffix in {".html", ".md", ".txt", ".cff", ".toml"}:
            texts[path.relative_to(tmp_path).as_posix()] = path.read_text()
    texts["bundle/columns.json"] = (tmp_path / "bundle/columns.json").read_text()
    return texts


def test_a_study_of_another_environment_speaks_of_it_alone(outputs):
    columns = json.loads(outputs.pop("bundle/columns.json")).values()
    meanings = [column["meaning"] for table in columns for column in table["columns"]]
    datasheet = outputs["bundle/DATASHEET.md"]
    assert [meaning for meaning in meanings if meaning not in datasheet] == []
    # every world's columns have the same names
    outputs["bundle/DATASHEET.md"] = re.sub(r"`\w+`", "", datasheet)
    pages = {"report.html", "report-methods.html", "report-checklist.html"}
    assert {*pages, "preregistration.md", "bundle/DATASHEET.md"} <= outputs.keys()
    examined = (
        r"moves came to the same in fresh processes; a rehearsed episode of \d+ moves? was recorded"
    )
    assert re.search(
        rf"^[\d,]+ {examined}, replayed and written as a data set", outputs["freeze"], re.MULTILINE
    )
    assert {name: lines for name, text in outputs.items() if (lines := words_of_mars(text))} == {}
