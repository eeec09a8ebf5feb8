"""The command: help, one sentence and an exit code for every mistake."""

import csv
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import tomllib
from contextlib import suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from humanplay.cli.main import COMMANDS, cli
from humanplay.command.extras import EXTRAS, INCLUDED, missing_extra
from humanplay.command.options import SizeType
from humanplay.db.database import reading
from humanplay.db.store import Store
from humanplay.tasks.mars import cli as mars
from humanplay.web.settings import DEFAULT_DATABASE
from marsexplorer.maps import GridMap, write_map
from tests.support.command import command
from tests.support.declared import DECLARATIONS_FILE
from tests.support.policy_files import write_onnx
from tests.support.recorded import play
from tests.support.servers import PATIENCE_S, eventually

ROOT = Path(__file__).parents[3]


@pytest.fixture
def run(capsys):
    """`run("export", ...)` -> (exit code, stdout, stderr)."""

    return partial(command, capsys)


@pytest.fixture
def database(tmp_path):
    store = Store(tmp_path / "play.db")
    play(store, seed=1, explore=True)
    play(store, seed=2, player="bob", driver="script")
    store.close()
    return store.path


def is_one_sentence(text):
    begins = text.startswith(("humanplay: ", "marsexplorer: "))
    return begins and text.count("\n") == 1 and "Traceback" not in text


@pytest.mark.parametrize("name", [*COMMANDS, *mars.COMMANDS])
def test_help_teaches_with_examples(run, name):
    code, out, _ = run(name, "--help")
    assert code == 0
    assert "Examples:" in out
    program = "marsexplorer" if name in mars.COMMANDS else "humanplay"
    assert out.count(f"{program} {name}") >= 2


@pytest.mark.parametrize(
    ("module", "program", "commands"),
    [
        ("humanplay.cli", "humanplay", COMMANDS),
        ("humanplay.tasks.mars.cli", "marsexplorer", mars.COMMANDS),
    ],
)
def test_help_names_every_command_and_the_version_is_printed(module, program, commands):
    def say(option):
        words = [sys.executable, "-m", module, option]
        return subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT).stdout

    assert all(name in say("--help") for name in commands)
    assert say("--version") == f"{program}, version {version('humanplay')}\n"


@pytest.mark.parametrize(
    ("module", "words", "sentence"),
    [
        ("torch", "train --steps 1 --out new", "`marsexplorer train` needs the extra [train]"),
        ("numba", "evaluate --policy random", "`marsexplorer evaluate` needs the extra [play]"),
        ("matplotlib", "report --study pilot", "`humanplay report` needs the extra [study]"),
    ],
)
def test_a_missing_extra_is_one_sentence_and_exit_code_2(tmp_path, module, words, sentence):
    program = sentence.partition(" ")[0].removeprefix("`")
    module_of_program = {
        "humanplay": "humanplay.cli.main",
        "marsexplorer": "humanplay.tasks.mars.cli",
    }[program]
    code = f"""import sys
sys.modules[{module!r}] = None
sys.path.insert(0, {str(ROOT)!r})
sys.argv[1:] = {words.split()!r}
from {module_of_program} import main
main()
"""
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    extra = sentence.partition("[")[2].rstrip("]")
    install = f"pip install 'humanplay[{extra}]'"
    assert process.stderr == f"{program}: {sentence}: {install}\n"
    assert (process.returncode, process.stdout) == (2, "")


NO_CACHE = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "NUMBA_CACHE_DIR": ""}
"""The variables by which numba uses no folder, as for a user without one that may be written to."""


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("humanplay", "serve --port 0"),
        ("humanplay", "play --no-browser"),
        ("marsexplorer", "evaluate --policy random"),
        ("marsexplorer", "train --steps 1 --out new"),
    ],
)
def test_without_a_folder_for_compiled_rules_a_sentence_names_the_variable(
    tmp_path, program, words
):
    module = {"humanplay": "humanplay.cli", "marsexplorer": "humanplay.tasks.mars.cli"}[program]
    process = subprocess.run(
        [sys.executable, "-m", module, *words.split()],
        env=os.environ | NO_CACHE,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert is_one_sentence(process.stderr), process.stderr
    assert process.stderr.startswith(f"{program}: ")
    assert "set the variable NUMBA_CACHE_DIR" in process.stderr
    assert process.returncode == 1


def test_without_a_folder_for_compiled_rules_the_environment_names_the_variable(tmp_path):
    code = "import gymnasium, marsexplorer; gymnasium.make('MarsExplorer-v0')"
    process = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | NO_CACHE,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert process.stderr.splitlines()[-1].startswith("ImportError: MarsExplorer's compiled rules")


@pytest.mark.parametrize("module", ["numba", "onnxruntime", "viser"])
def test_without_what_plays_marsexplorer_any_other_environment_is_named(run, monkeypatch, module):
    monkeypatch.setitem(sys.modules, module, None)
    code, _, err = run("serve", "--port", 0)
    assert code == 2
    assert err == (
        "humanplay: the environment mars needs the extra [play]: pip install 'humanplay[play]'. One of Gymnasium works now: "
        "humanplay serve --env FrozenLake-v1 (see humanplay serve --help)\n"
    )


def test_a_missing_module_that_no_extra_brings_is_an_error_of_ours():
    assert (
        missing_extra(ModuleNotFoundError("no module", name="humanplay.lost"), "humanplay", "")
        is None
    )


def test_the_extras_are_those_of_the_package():
    """Every library of an extra brings the extra's name into the error."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = project["optional-dependencies"]
    for extra in ("analysis", "audit", "dev", "docs"):  # no command needs them
        del declared[extra]
    declared["agents"] = [  # the examples of agents need these, and no command
        line for line in declared["agents"] if not line.startswith(("openenv", "openai"))
    ]
    imported_as = {
        "pillow": "PIL",
        "pyyaml": "yaml",
        "python-json-logger": "pythonjsonlogger",
        "pygame-ce": "pygame",
    }
    assert set(declared) == set(EXTRAS)
    for extra, requirements in declared.items():
        names = [re.split(r"[<>=\[ ]", requirement)[0] for requirement in requirements]
        modules = {imported_as.get(name, name) for name in names if name != "humanplay"}
        assert {
            name if name in EXTRAS[extra] else name.replace("-", "_") for name in modules
        } <= set(EXTRAS[extra])
        included = ",".join(re.findall(r"humanplay\[([a-z,]+)\]", " ".join(requirements)))
        assert tuple(included.split(",") if included else ()) == INCLUDED.get(extra, ()), extra
    entries = [*COMMANDS.values(), *mars.COMMANDS.values()]
    assert {entry.extra for entry in entries} <= {"", *EXTRAS}


def test_help_loads_nothing_heavy():
    code = """import sys, humanplay.cli.main
from humanplay.tasks.mars import cli as mars
for program in (humanplay.cli.main, mars):
  for args in (["--help"], *([name, "--help"] for name in program.COMMANDS)):
    try:
        program.main(args)
    except SystemExit:
        pass
    print(args, sorted({"numpy", "numba", "fastapi", "torch", "scipy", "pydantic", "tqdm"} & set(sys.modules)), file=sys.stderr)
"""
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True
    )
    lines = process.stderr.splitlines()
    assert len(lines) == 2 + len(COMMANDS) + len(mars.COMMANDS)
    assert all(line.endswith(" []") for line in lines), lines


@pytest.mark.parametrize(
    ("args", "part"),
    [
        ("evaluate --policy random --size 3x3", "rows must be at least 5, got 3"),
        (
            "evaluate --policy random --size big",
            "expected a side like 21 or ROWSxCOLS like 42x84, got 'big'",
        ),
        ("evaluate --policy random --level moon", "no level 'moon'; choose one of: random"),
        ("evaluate --policy random --episodes 0", "--episodes"),
        ("evaluate --policy random --seed -1", "--seed"),
        (f"evaluate --policy random --seed {2**53}", "seed"),
        ("evaluate --policy ppo2", 'no policy "ppo2"'),
        ("evaluate --policy gone.onnx", "no policy file at gone.onnx"),
        ("evaluate random", "--policy"),
        ("evaluate --policy random --map gone.yaml", "gone.yaml is no readable YAML file"),
        (
            "evaluate --policy random --map gone.yaml --plots new",
            "--map takes no --csv, --plots or --ray",
        ),
        ("serve --port 70000", "--port"),
        ("serve nonsense", "unexpected argument 'nonsense'"),
        ("export", "--out"),
        ("export --out x --format xml", "--format"),
        ("policies card frontier-cost", "frontier-cost is a rule"),
        ("fly", "No such command 'fly'. (see"),
        ("sevre", "No such command 'sevre'. Did you mean 'serve'? (see"),
        ("study freze", "No such command 'freze'. Did you mean 'freeze'? (see"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2(run, args, part):
    code, out, err = run(*args.split())
    assert (code, out) == (2, "")
    assert is_one_sentence(err), err
    assert part in err


@pytest.mark.parametrize(
    ("name", "setting", "expected"),
    [
        ("HUMANPLAY_PORT", "many", "expected a whole number, got 'many'"),
        ("HUMANPLAY_PORT", "70000", "expected 65535 or less, got '70000'"),
        ("HUMANPLAY_DURABLE", "maybe", "expected true or false, got 'maybe'"),
        ("HUMANPLAY_LOG_FORMAT", "xml", "expected 'text' or 'json', got 'xml'"),
        ("HUMANPLAY_IDLE_S", "0", "expected a number above 0, got '0'"),
        (
            "HUMANPLAY_PUBLIC_URL",
            "mars",
            "expected the address of the pages, like https://mars.example",
        ),
        ("HUMANPLAY_TRUSTED_PROXIES", "127.0.0.1", 'expected JSON, such as ["127.0.0.1"]'),
        ("HUMANPLAY_LIMITS", "7", "expected a JSON object of limits, got 7"),
        ("HUMANPLAY_LIMITS__TOKEN", "abc", "expected at least 16 characters: correct"),
        ("HUMANPLAY_LIMITS__TOKN", "abc", "expected no setting of this name, got 'abc'"),
        ("HUMANPLAY_LIMITS__MESSAGES", "q", "expected BURST+RATE/s"),
    ],
)
def test_a_wrong_setting_in_the_environment_names_itself_and_the_way_out(
    run, monkeypatch, name, setting, expected
):
    monkeypatch.setenv(name, setting)
    code, _, err = run("serve")
    assert (code, is_one_sentence(err)) == (2, True), err
    assert err.startswith(f"humanplay: {name}: {expected}"), err
    assert "correct it or unset it" in err


def test_a_wrong_setting_of_the_server_stops_no_command_that_does_not_need_it(
    run, monkeypatch, database, tmp_path
):
    monkeypatch.setenv("HUMANPLAY_LIMITS__TOKEN", "abc")
    monkeypatch.setenv("HUMANPLAY_DATABASE", str(database))
    assert run("export", "--out", tmp_path / "out")[0] == 0
    assert run("study", "list")[0] == 0


def test_a_variable_that_is_no_setting_is_named_with_the_one_that_was_meant(run, monkeypatch):
    monkeypatch.setenv("HUMANPLAY_DATABSE", "lab.db")
    code, _, err = run("study", "list")
    assert code == 0
    note = "the variable HUMANPLAY_DATABSE is no setting and is ignored; did you mean HUMANPLAY_DATABASE?"
    assert note in err


def test_two_databases_share_no_study_and_one_option_names_both(run, tmp_path):
    """A study is beside its database, its freezing in the chain of that one alone."""
    for name in ("a", "a.sqlite", "b.db"):
        Store(tmp_path / name).close()
    database = "--database", tmp_path / "b.db"
    new = "--size", "7", "--warm-up", 0, "--ranked", 1, "--players", 2, "--policy", "random"
    assert (
        run("study", "new", "dunes", *new, "--declarations", DECLARATIONS_FILE, *database)[0] == 0
    )
    assert run("study", "freeze", "dunes", "--underpowered", *database)[0] == 0
    for name in ("a", "a.sqlite"):
        code, out, _ = run("study", "list", "--database", tmp_path / name)
        assert (code, "no studies in" in out) == (0, True)
        with reading(tmp_path / name) as conn:
            assert conn.execute("SELECT count(*) FROM chain WHERE kind = 'frozen'").fetchone() == (
                0,
            )
    with reading(tmp_path / "b.db") as conn:
        assert conn.execute("SELECT count(*) FROM chain WHERE kind = 'frozen'").fetchone() == (1,)
    (tmp_path / "link.db").symlink_to(tmp_path / "b.db")
    assert "dunes" in run("study", "list", "--database", tmp_path / "link.db")[1]
    options = {
        name
        for group in (
            cli,
            mars.cli,
            *(cli.get_command(None, name) for name in ("study", "agents")),
        )
        for name, command in (
            (name, group.get_command(None, name)) for name in group.list_commands(None)
        )
        if any("--studies" in option.opts for option in command.params)
    }
    assert options == set()


def test_sizes_are_read_as_sides_or_rows_by_columns():
    read = SizeType().convert
    assert read("21", None, None) == 21
    assert read("42x84", None, None) == read("42X84", None, None) == (42, 84)


def test_export_writes_both_tables(run, database, tmp_path):
    code, out, err = run("export", "--database", database, "--out", tmp_path / "new" / "out")
    assert (code, err) == (0, "")
    assert out.startswith("2 episodes in ")
    with (tmp_path / "new" / "out" / "episodes.csv").open() as file:
        episodes = list(csv.DictReader(file))
    with (tmp_path / "new" / "out" / "steps.csv").open() as file:
        steps = list(csv.DictReader(file))
    assert [row["verified"] for row in episodes] == ["true", "true"]
    assert len(steps) == sum(int(row["steps"]) for row in episodes)
    assert {row["player"] for row in steps} == {row["player"] for row in episodes}


def test_export_of_the_human_episodes(run, database, tmp_path):
    assert run("export", "--database", database, "--out", tmp_path, "--who", "human")[0] == 0
    (row,) = csv.DictReader((tmp_path / "episodes.csv").read_text().splitlines())
    assert row["driver"] == "human"


def test_export_reads_while_a_server_runs(run, database, tmp_path):
    store = Store(database)
    play(store, seed=3)
    assert run("export", "--database", database, "--out", tmp_path)[1].startswith("3 episodes")
    store.close()


@pytest.mark.parametrize("kind", ["missing", "text", "folder"])
def test_export_refuses_what_is_no_database_of_ours(run, tmp_path, kind):
    path = tmp_path / "it"
    if kind == "text":
        path.write_text("hello " * 30)
    if kind == "folder":
        path.mkdir()
    code, _, err = run("export", "--database", path, "--out", tmp_path / "out")
    assert code == 1
    assert is_one_sentence(err)
    assert "--database" in err
    assert not (tmp_path / "out").exists()


def test_an_unwritable_folder_is_named_and_nothing_is_left(run, database, tmp_path):
    (tmp_path / "file").write_text("mine")
    code, _, err = run("export", "--database", database, "--out", tmp_path / "file")
    assert code == 1
    assert is_one_sentence(err)
    assert "choose another --out" in err
    assert (tmp_path / "file").read_text() == "mine"
    (tmp_path / "out" / "steps.csv").mkdir(parents=True)
    assert run("export", "--database", database, "--out", tmp_path / "out")[0] == 1
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["steps.csv"]


def test_evaluate_prints_a_table_and_writes_it(run, tmp_path):
    target = tmp_path / "table.json"
    args = [
        "evaluate",
        "--policy",
        "random",
        "frontier-cost",
        "--size",
        "5x7",
        "--episodes",
        "3",
        "--seed",
        "3",
    ]
    levels = ["--level", "random", "--level", "1-1-1"]
    files = "--csv", tmp_path / "table.csv", "--plots", tmp_path / "new" / "pictures"
    code, out, err = run(*args, *levels, *files, "--json", target)
    assert (code, err) == (0, "")
    for word in ("random", "frontier-cost", "frontier-utility", "1-1-1"):
        assert word in out
    for word in ("mean score", "95 % interval", "completion", "to rule"):
        assert word in out
    document = json.loads(target.read_text())
    assert len(document["results"]) == 3 * 2 * 3
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], row["level"]) for row in rows] == [
        (policy, level)
        for level in ("random", "1-1-1")
        for policy in ("random", "frontier-cost", "frontier-utility")
    ]
    for row in rows:
        is_compared = row["rule_reference"] not in ("", row["policy"])
        assert (row["rule_ratio_mean"] != "") == is_compared
    pictures = {path.name for path in (tmp_path / "new" / "pictures").iterdir()}
    assert {"coverage-random-5x7.png", "coverage-1-1-1-5x7.png", "heat-random.png"} < pictures
    assert {path.name for path in tmp_path.iterdir()} == {"table.json", "table.csv", "new"}


def test_a_place_for_the_table_is_looked_for_before_playing(run, tmp_path):
    args = ["evaluate", "--policy", "random", "--size", "1000", "--episodes", "1000000", "--json"]
    for wrong in (tmp_path / "none" / "table.json", tmp_path):
        code, _, err = run(*args, wrong)
        assert code == 1
        assert is_one_sentence(err)
        assert "choose another --json" in err
    (tmp_path / "file").write_text("mine")
    assert "choose another --csv" in run(*args[:-1], "--csv", tmp_path / "none" / "table.csv")[2]
    assert "choose another --plots" in run(*args[:-1], "--plots", tmp_path / "file")[2]
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_without_ray_a_sentence_says_how_to_get_it(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    few = ["--size", "5", "--episodes", "2", "--ray", "local"]
    code, out, err = run("evaluate", "--policy", "random", *few)
    assert (code, out) == (1, "")
    assert is_one_sentence(err)
    assert "pip install 'humanplay[ray]'" in err


def test_measuring_names_no_option_that_it_lacks_where_the_disk_refuses(run, tmp_path):
    result = {"terrains": 2, "first_seed": 1, "steps": 0}
    card = {"summary": "One.", "results": {"random 6x7": result}}
    file = write_onnx(tmp_path / f"{'m' * 245}.onnx", card=card)  # too long for one beside it
    code, _, err = run("policies", "measure", file)
    assert (code, is_one_sentence(err), "file name too long" in err) == (1, True, True)
    assert "--out" not in err


def test_serve_refuses_a_taken_port_and_a_file_that_is_none(run, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        code, _, err = run(
            "serve", "--port", taken.getsockname()[1], "--database", tmp_path / "play.db"
        )
    assert code == 1
    assert is_one_sentence(err)
    assert "choose another with --port" in err
    assert not (tmp_path / "play.db").exists()
    code, _, err = run("serve", "--port", 0, "--database", tmp_path / "no" / "such" / "play.db")
    assert is_one_sentence(err), err
    assert (code, "there is no folder" in err) == (1, True)
    assert not (tmp_path / "no").exists()
    (tmp_path / "text").write_text("hello " * 30)
    code, _, err = run("serve", "--port", 0, "--database", tmp_path / "text")
    assert code == 1
    assert is_one_sentence(err)
    assert "not a database" in err


def test_flags_reach_the_server_as_settings(run, monkeypatch, tmp_path):
    import humanplay.web.server

    seen = []
    monkeypatch.setattr(humanplay.web.server, "run", seen.append)
    monkeypatch.setenv("HUMANPLAY_HOST", "::1")
    flags = ["--port", "9", "--policy", "a.b", "c.d", "--durable", "--database"]
    assert run("serve", *flags, tmp_path / "a.db")[0] == 0
    assert run("serve")[0] == 0
    assert run("serve", "--paper")[0] == 0
    first, second, third = seen
    assert (first.host, first.port, first.durable) == ("::1", 9, True)
    assert (first.database, first.policies) == (tmp_path / "a.db", (Path("a.b"), Path("c.d")))
    assert (second.port, second.durable, second.policies) == (8000, False, ())
    assert second.database == DEFAULT_DATABASE
    paper = "a2c-works ppo-paper ppo-works rainbow-works sac-works"
    assert [path.stem for path in third.policies] == paper.split()


def heed_control_c():
    """Undo a shell's ignoring of Ctrl-C for what it starts in the background.

    The process has one core, hence one worker process.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def signal_process(process):
    os.kill(process.pid, signal.SIGINT)


def press_control_c(process):
    """Signal the whole group, worker processes included, as a terminal does."""
    os.killpg(process.pid, signal.SIGINT)


@pytest.mark.parametrize("interrupt", [signal_process, press_control_c])
def test_control_c_leaves_quietly_with_130_and_nothing_half_written(tmp_path, interrupt):
    args = [
        "-m",
        "humanplay.tasks.mars.cli",
        "evaluate",
        "--policy",
        "frontier-cost",
        "--size",
        "84",
        "--episodes",
        "100000",
        "--json",
    ]
    process = subprocess.Popen(
        [sys.executable, *args, str(tmp_path / "t.json")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        start_new_session=True,
        preexec_fn=heed_control_c,
    )
    with process:
        try:
            eventually(lambda: list(tmp_path.iterdir()), 60)
            time.sleep(3)
            interrupt(process)
            out, err = process.communicate(timeout=PATIENCE_S)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert (process.returncode, out, err.strip()) == (130, "", "")
    assert list(tmp_path.iterdir()) == []


def test_every_option_is_explained():
    for name in [*COMMANDS, *mars.COMMANDS]:
        command = (cli if name in COMMANDS else mars.cli).get_command(None, name)
        assert command.name == name
        for option in command.params:
            assert option.param_type_name == "argument" or option.help, (command.name, option.name)


def test_policies_are_evaluated_on_map_files(run, tmp_path):
    terrain = np.zeros((6, 9), bool)
    terrain[2, 1:8] = True
    for name in ("hall", "shed"):
        write_map(GridMap(terrain, 0.5, (0.0, 0.0, 0.0), (0, 0)), tmp_path / f"{name}.yaml")
    maps = "--map", tmp_path / "hall.yaml", "--map", tmp_path / "shed.yaml"
    options = "--policy", "frontier-priced", "--json", tmp_path / "figures.json"
    code, out, err = run("evaluate", *options, *maps)
    assert code == 0
    assert "frontier-priced" in out
    assert "hall.yaml: 6 x 9 cells of 0.5 m, start in row 5, column 0, at (0.25, 0.25) m" in err
    maps = json.loads((tmp_path / "figures.json").read_text())["maps"]
    assert [grid_map["name"] for grid_map in maps] == ["hall", "shed"]
    names = "frontier-priced frontier-cost frontier-utility"
    assert [result["policy"] for result in maps[1]["results"]] == names.split()
