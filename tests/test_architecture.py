"""Imports follow the layers: every import of the project is held to the table below, and the table has no cycle.

A unit is a folder of modules; where a folder has folders of modules inside, each module of its own is a unit too. Imports
inside functions and under TYPE_CHECKING count, and so do modules that are named in calls of `import_module`.
"""

import ast
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("marsexplorer", "app")

ALLOWED: dict[str, set[str]] = {
    "app": set(),
    "app.admin": {
        "app.operators",
        "app.play",
        "app.settings",
        "app.statistics",
        "app.storage",
        "app.study",
        "marsexplorer.score",
    },
    "app.backup": {"app.database_file", "app.storage"},
    "app.cli": set(),
    "app.cli.__main__": {"app.cli.main"},
    "app.cli.console": {"app.settings", "app.study", "marsexplorer.config", "marsexplorer.training"},
    "app.cli.database": {
        "app.backup",
        "app.cli.console",
        "app.moves",
        "app.operators",
        "app.release",
        "app.replay",
        "app.storage",
        "app.study",
        "marsexplorer.files",
        "marsexplorer.policies",
    },
    "app.cli.extras": set(),
    "app.cli.main": {"app.cli", "app.cli.extras"},
    "app.cli.release": {
        "app.cli.console",
        "app.cli.study",
        "app.moves",
        "app.release",
        "app.report",
        "app.storage",
        "app.study",
        "marsexplorer.config",
        "marsexplorer.policies",
    },
    "app.cli.serve": {"app.cli.console", "app.server", "app.storage", "marsexplorer.policies.files"},
    "app.cli.study": {
        "app.cli.console",
        "app.moves",
        "app.release",
        "app.report",
        "app.simulate",
        "app.statistics",
        "app.storage",
        "app.study",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.policies",
    },
    "app.cli.training": {
        "app.cli.console",
        "app.leaderboard",
        "app.moves",
        "app.release",
        "app.storage",
        "app.study",
        "marsexplorer.bench",
        "marsexplorer.config",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.maps",
        "marsexplorer.paper.algorithms",
        "marsexplorer.paper.episodes",
        "marsexplorer.paper.figures",
        "marsexplorer.paper.job",
        "marsexplorer.paper.plan",
        "marsexplorer.paper.scheduling",
        "marsexplorer.policies",
        "marsexplorer.policies.base",
        "marsexplorer.policies.files",
        "marsexplorer.policies.loading",
        "marsexplorer.policies.network",
        "marsexplorer.policies.priced",
        "marsexplorer.training",
    },
    "app.coverage": {"app.statistics", "marsexplorer.evaluation"},
    "app.daily": {"app.leaderboard", "app.play", "app.storage", "marsexplorer.policies"},
    "app.database_file": set(),
    "app.leaderboard": {
        "app.moves",
        "app.play",
        "app.settings",
        "app.statistics",
        "app.storage",
        "app.study",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.policies",
        "marsexplorer.policies.files",
    },
    "app.monitoring": set(),
    "app.moves": {
        "app.play",
        "app.statistics",
        "app.storage",
        "app.study",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.observation",
        "marsexplorer.policies",
        "marsexplorer.score",
    },
    "app.operators": {"app.storage"},
    "app.play": {
        "app.database_file",
        "app.storage",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.maps",
        "marsexplorer.policies",
        "marsexplorer.policies.files",
        "marsexplorer.policies.kernels",
        "marsexplorer.policies.network",
        "marsexplorer.terrain",
        "marsexplorer.world",
    },
    "app.protection": {"app.settings"},
    "app.release": {
        "app.database_file",
        "app.moves",
        "app.storage",
        "app.study",
        "marsexplorer",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.score",
    },
    "app.replay": {
        "app.play",
        "app.settings",
        "app.storage",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.policies",
    },
    "app.report": {
        "app.coverage",
        "app.moves",
        "app.play",
        "app.statistics",
        "app.storage",
        "app.study",
        "marsexplorer.config",
        "marsexplorer.evaluation",
    },
    "app.server": {
        "app.admin",
        "app.backup",
        "app.daily",
        "app.leaderboard",
        "app.monitoring",
        "app.moves",
        "app.play",
        "app.protection",
        "app.replay",
        "app.services",
        "app.settings",
        "app.storage",
        "app.study",
        "app.viewer3d",
        "app.web",
        "marsexplorer.config",
        "marsexplorer.evaluation",
        "marsexplorer.policies",
    },
    "app.services": {
        "app.admin",
        "app.daily",
        "app.leaderboard",
        "app.moves",
        "app.play",
        "app.protection",
        "app.replay",
        "app.storage",
        "app.study",
        "app.viewer3d",
    },
    "app.settings": {"marsexplorer.maps"},
    "app.simulate": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.observation",
        "marsexplorer.policies.frontier",
        "marsexplorer.policies.kernels",
        "marsexplorer.random_numbers",
        "marsexplorer.rules",
        "marsexplorer.score",
        "marsexplorer.world",
    },
    "app.statistics": {
        "app.play",
        "app.storage",
        "app.study",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.score",
    },
    "app.storage": {
        "app.database_file",
        "app.monitoring",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.files",
        "marsexplorer.score",
        "marsexplorer.terrain",
        "marsexplorer.world",
    },
    "app.study": {
        "app.play",
        "app.storage",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.policies",
        "marsexplorer.score",
        "marsexplorer.terrain",
    },
    "app.viewer3d": {"app.play", "app.settings", "marsexplorer.config", "marsexplorer.episode"},
    "app.web": {
        "app.admin",
        "app.daily",
        "app.leaderboard",
        "app.moves",
        "app.operators",
        "app.play",
        "app.protection",
        "app.replay",
        "app.services",
        "app.settings",
        "app.statistics",
        "app.storage",
        "app.study",
        "app.viewer3d",
        "marsexplorer.config",
        "marsexplorer.episode",
    },
    "marsexplorer": set(),
    "marsexplorer.bench": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.observation",
        "marsexplorer.policies",
        "marsexplorer.policies.network",
        "marsexplorer.world",
    },
    "marsexplorer.bitmap": {"marsexplorer.compiled", "marsexplorer.config", "marsexplorer.lidar"},
    "marsexplorer.buffers": {"marsexplorer.compiled"},
    "marsexplorer.columns": {
        "marsexplorer.bitmap",
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.lidar",
        "marsexplorer.rules",
    },
    "marsexplorer.compiled": set(),
    "marsexplorer.config": set(),
    "marsexplorer.env": {
        "marsexplorer.config",
        "marsexplorer.maps",
        "marsexplorer.observation",
        "marsexplorer.rules",
        "marsexplorer.score",
        "marsexplorer.terrain",
        "marsexplorer.world",
    },
    "marsexplorer.episode": {
        "marsexplorer.config",
        "marsexplorer.observation",
        "marsexplorer.rules",
        "marsexplorer.score",
        "marsexplorer.world",
    },
    "marsexplorer.evaluation": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.files",
        "marsexplorer.lidar",
        "marsexplorer.maps",
        "marsexplorer.observation",
        "marsexplorer.policies",
        "marsexplorer.policies.base",
        "marsexplorer.policies.files",
        "marsexplorer.policies.frontier",
        "marsexplorer.policies.guard",
        "marsexplorer.policies.kernels",
        "marsexplorer.policies.loading",
        "marsexplorer.policies.network",
        "marsexplorer.random_numbers",
        "marsexplorer.rules",
        "marsexplorer.score",
        "marsexplorer.world",
    },
    "marsexplorer.files": set(),
    "marsexplorer.generators": {
        "marsexplorer.bitmap",
        "marsexplorer.compiled",
        "marsexplorer.lidar",
        "marsexplorer.random_numbers",
    },
    "marsexplorer.lidar": {"marsexplorer.compiled"},
    "marsexplorer.maps": {"marsexplorer.config"},
    "marsexplorer.observation": {"marsexplorer.compiled", "marsexplorer.config"},
    "marsexplorer.paper": set(),
    "marsexplorer.paper.algorithms": {"marsexplorer.config", "marsexplorer.paper.trainer", "marsexplorer.paper.trainers"},
    "marsexplorer.paper.claims": {
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.observation",
        "marsexplorer.paper.algorithms",
        "marsexplorer.paper.episodes",
        "marsexplorer.paper.figures",
        "marsexplorer.paper.plan",
        "marsexplorer.policies",
        "marsexplorer.rules",
        "marsexplorer.score",
        "marsexplorer.terrain",
    },
    "marsexplorer.paper.episodes": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.paper.job",
        "marsexplorer.policies",
        "marsexplorer.policies.kernels",
        "marsexplorer.random_numbers",
        "marsexplorer.terrain",
    },
    "marsexplorer.paper.figures": {
        "marsexplorer.config",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.paper.episodes",
        "marsexplorer.paper.job",
        "marsexplorer.paper.trial",
    },
    "marsexplorer.paper.job": set(),
    "marsexplorer.paper.plan": {
        "marsexplorer.config",
        "marsexplorer.paper.algorithms",
        "marsexplorer.paper.episodes",
        "marsexplorer.paper.figures",
        "marsexplorer.paper.job",
        "marsexplorer.paper.trial",
    },
    "marsexplorer.paper.scheduling": {"marsexplorer.evaluation", "marsexplorer.files", "marsexplorer.paper.job"},
    "marsexplorer.paper.trainer": {"marsexplorer.training"},
    "marsexplorer.paper.trainers": {"marsexplorer.config", "marsexplorer.policies.network", "marsexplorer.training"},
    "marsexplorer.paper.trial": {
        "marsexplorer.config",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.paper.algorithms",
        "marsexplorer.paper.job",
        "marsexplorer.paper.trainer",
        "marsexplorer.score",
        "marsexplorer.training",
    },
    "marsexplorer.policies": {"marsexplorer.policies.base", "marsexplorer.policies.loading"},
    "marsexplorer.policies.base": {"marsexplorer.observation"},
    "marsexplorer.policies.files": {"marsexplorer.files", "marsexplorer.observation", "marsexplorer.policies.base"},
    "marsexplorer.policies.frontier": {
        "marsexplorer.compiled",
        "marsexplorer.observation",
        "marsexplorer.policies.base",
        "marsexplorer.policies.kernels",
    },
    "marsexplorer.policies.guard": {"marsexplorer.compiled", "marsexplorer.policies.base", "marsexplorer.policies.frontier"},
    "marsexplorer.policies.kernels": {"marsexplorer.compiled", "marsexplorer.config", "marsexplorer.lidar"},
    "marsexplorer.policies.loading": {
        "marsexplorer.config",
        "marsexplorer.policies.base",
        "marsexplorer.policies.files",
        "marsexplorer.policies.frontier",
        "marsexplorer.policies.network",
        "marsexplorer.policies.planner",
        "marsexplorer.policies.priced",
        "marsexplorer.policies.random_policy",
    },
    "marsexplorer.policies.network": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.files",
        "marsexplorer.lidar",
        "marsexplorer.observation",
        "marsexplorer.policies.base",
        "marsexplorer.policies.files",
        "marsexplorer.policies.guard",
        "marsexplorer.policies.kernels",
        "marsexplorer.policies.priced",
        "marsexplorer.random_numbers",
    },
    "marsexplorer.policies.planner": {
        "marsexplorer.compiled",
        "marsexplorer.observation",
        "marsexplorer.policies.base",
        "marsexplorer.policies.guard",
        "marsexplorer.policies.kernels",
        "marsexplorer.random_numbers",
    },
    "marsexplorer.policies.priced": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.observation",
        "marsexplorer.policies.base",
        "marsexplorer.policies.guard",
        "marsexplorer.policies.kernels",
    },
    "marsexplorer.policies.random_policy": {"marsexplorer.observation", "marsexplorer.random_numbers"},
    "marsexplorer.random_numbers": {"marsexplorer.compiled"},
    "marsexplorer.rules": {
        "marsexplorer.bitmap",
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.lidar",
        "marsexplorer.scan",
        "marsexplorer.terrain",
    },
    "marsexplorer.scan": {"marsexplorer.bitmap", "marsexplorer.compiled", "marsexplorer.config", "marsexplorer.lidar"},
    "marsexplorer.score": {"marsexplorer.config"},
    "marsexplorer.sharing": {
        "marsexplorer.bitmap",
        "marsexplorer.columns",
        "marsexplorer.compiled",
        "marsexplorer.observation",
        "marsexplorer.rules",
    },
    "marsexplorer.terrain": {
        "marsexplorer.bitmap",
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.generators",
        "marsexplorer.random_numbers",
    },
    "marsexplorer.training": {
        "marsexplorer.compiled",
        "marsexplorer.config",
        "marsexplorer.episode",
        "marsexplorer.evaluation",
        "marsexplorer.files",
        "marsexplorer.lidar",
        "marsexplorer.observation",
        "marsexplorer.policies.files",
        "marsexplorer.policies.kernels",
        "marsexplorer.policies.network",
        "marsexplorer.policies.priced",
        "marsexplorer.rules",
        "marsexplorer.vector",
        "marsexplorer.world",
    },
    "marsexplorer.vector": {
        "marsexplorer.buffers",
        "marsexplorer.config",
        "marsexplorer.env",
        "marsexplorer.observation",
        "marsexplorer.rules",
        "marsexplorer.terrain",
        "marsexplorer.world",
    },
    "marsexplorer.world": {
        "marsexplorer.bitmap",
        "marsexplorer.buffers",
        "marsexplorer.columns",
        "marsexplorer.config",
        "marsexplorer.lidar",
        "marsexplorer.observation",
        "marsexplorer.rules",
        "marsexplorer.sharing",
        "marsexplorer.terrain",
    },
}
"""Unit -> the units that it may import."""

LIBRARIES: dict[str, set[str]] = {
    "app.admin": {"itsdangerous"},
    "app.cli.console": {"click", "pydantic", "rich"},
    "app.cli.database": {"click"},
    "app.cli.main": {"click"},
    "app.cli.release": {"click"},
    "app.cli.serve": {"click"},
    "app.cli.study": {"click"},
    "app.cli.training": {"click", "rich", "torch"},
    "app.coverage": {"click", "numpy", "rich", "scipy"},
    "app.leaderboard": {"numpy"},
    "app.monitoring": {"prometheus_client", "pythonjsonlogger", "starlette"},
    "app.moves": {"click", "numpy", "scipy"},
    "app.operators": {"argon2", "pyotp"},
    "app.play": {"itsdangerous", "msgspec", "numpy", "pydantic"},
    "app.protection": {"h11", "limits", "secure", "starlette", "uvicorn", "websockets"},
    "app.release": {"cryptography", "gymnasium", "jinja2", "numpy"},
    "app.replay": {"PIL", "av", "jinja2", "markupsafe", "numpy"},
    "app.report": {"jinja2", "matplotlib", "numpy"},
    "app.server": {"fastapi"},
    "app.settings": {"pydantic", "pydantic_settings"},
    "app.simulate": {"click", "httpx", "numpy", "websockets"},
    "app.statistics": {"click", "jax", "numpy", "numpyro", "scipy", "statsmodels"},
    "app.storage": {"numpy", "sqlite_utils"},
    "app.study": {"pydantic"},
    "app.viewer3d": {"PIL", "msgspec", "numpy", "starlette", "viser", "websockets", "zstandard"},
    "app.web": {"fastapi", "jinja2", "markupsafe", "pydantic", "starlette", "uvicorn"},
    "marsexplorer": {"gymnasium"},
    "marsexplorer.bench": {"crafter", "envpool", "gymnasium", "minigrid", "numpy"},
    "marsexplorer.bitmap": {"numpy"},
    "marsexplorer.buffers": {"numpy"},
    "marsexplorer.columns": {"numpy"},
    "marsexplorer.compiled": {"llvmlite", "numba"},
    "marsexplorer.env": {"gymnasium", "numpy"},
    "marsexplorer.episode": {"numpy"},
    "marsexplorer.evaluation": {"matplotlib", "numpy", "ray", "scipy"},
    "marsexplorer.generators": {"numpy"},
    "marsexplorer.lidar": {"numpy"},
    "marsexplorer.maps": {"PIL", "numpy", "yaml"},
    "marsexplorer.observation": {"numpy"},
    "marsexplorer.paper.claims": {"PIL", "numpy", "scipy"},
    "marsexplorer.paper.episodes": {"numpy"},
    "marsexplorer.paper.figures": {"matplotlib", "numpy"},
    "marsexplorer.paper.trainers": {"gymnasium", "numpy", "tianshou", "torch"},
    "marsexplorer.paper.trial": {"numpy", "torch"},
    "marsexplorer.policies.base": {"numpy"},
    "marsexplorer.policies.files": {"httpx2", "huggingface_hub", "numpy", "onnx", "onnxruntime", "safetensors", "torch"},
    "marsexplorer.policies.frontier": {"numpy"},
    "marsexplorer.policies.guard": {"numpy"},
    "marsexplorer.policies.kernels": {"numpy"},
    "marsexplorer.policies.loading": {"numpy"},
    "marsexplorer.policies.network": {"numpy", "onnx", "torch"},
    "marsexplorer.policies.planner": {"numpy"},
    "marsexplorer.policies.priced": {"numpy"},
    "marsexplorer.policies.random_policy": {"numpy"},
    "marsexplorer.random_numbers": {"numpy"},
    "marsexplorer.rules": {"numpy"},
    "marsexplorer.scan": {"numpy"},
    "marsexplorer.sharing": {"llvmlite", "numba", "numpy"},
    "marsexplorer.terrain": {"numpy"},
    "marsexplorer.training": {"cmaes", "gymnasium", "matplotlib", "numpy", "ray", "tensorboardX", "torch"},
    "marsexplorer.vector": {"gymnasium", "numpy"},
    "marsexplorer.world": {"numpy"},
}
"""Unit -> the libraries that it may import besides Python's own."""


def unit_of(module, root=ROOT):
    """Return the unit of a dotted module name, or of a dotted name inside a module."""
    parts = module.split(".")
    while parts:
        path = root.joinpath(*parts)
        if path.is_dir():
            return ".".join(parts)
        if path.with_suffix(".py").is_file():
            folder = path.parent
            has_folders = any((each / "__init__.py").is_file() for each in folder.iterdir() if each.is_dir())
            return ".".join(parts if has_folders else parts[:-1])
        parts.pop()
    raise AssertionError(f"{module} is no module of the project")


def imports(path):
    """Yield every module that a file imports, anywhere in it, by full dotted name."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and "import_module" in ast.unparse(node.func) and node.args:
            name = node.args[0]
            if isinstance(name, ast.JoinedStr) and isinstance(name.values[0], ast.Constant):
                yield name.values[0].value.rstrip(".")
            elif isinstance(name, ast.Constant):
                yield name.value


def problems(root, allowed, libraries):
    """Return one sentence for each import that the tables do not allow, and for each unit that has no row."""
    found = []
    for path in sorted(path for package in PACKAGES for path in (root / package).rglob("*.py")):
        relative = path.relative_to(root)
        unit = unit_of(".".join(relative.with_suffix("").parts).removesuffix(".__init__"), root)
        if unit not in allowed:
            found.append(f"{unit} has no row")
            continue
        for name in imports(path):
            top = name.split(".")[0]
            if top in PACKAGES:
                target = unit_of(name, root)
                if target != unit and target not in allowed[unit]:
                    found.append(f"{relative} imports {target}")
            elif top not in sys.stdlib_module_names and top not in libraries.get(unit, set()):
                found.append(f"{relative} imports {top}")
    return found


def test_every_import_is_in_the_table():
    assert problems(ROOT, ALLOWED, LIBRARIES) == []


def test_the_table_has_no_cycle_and_no_row_for_nothing():
    TopologicalSorter(ALLOWED).prepare()
    for unit in {*ALLOWED, *LIBRARIES}.union(*ALLOWED.values()):
        assert unit_of(unit) == unit


def test_no_row_allows_what_nothing_imports():
    """A row that is wider than the code would let the next upward import pass unseen."""
    used = {unit: set() for unit in ALLOWED}
    for path in (path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        unit = unit_of(".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"))
        for name in imports(path):
            used[unit].add(unit_of(name) if name.split(".")[0] in PACKAGES else name.split(".")[0])
    for unit in ALLOWED:
        assert ALLOWED[unit] | LIBRARIES.get(unit, set()) <= used[unit], unit


@pytest.fixture
def small(tmp_path):
    """`small(**files)` writes a project of two layers, storage under web, and returns what the test says of it."""

    def write(**files):
        for name, text in {"app/__init__": "", "app/storage/__init__": "", "app/web/__init__": "", **files}.items():
            path = tmp_path / f"{name}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        (tmp_path / "marsexplorer").mkdir(exist_ok=True)
        return problems(tmp_path, {"app": set(), "app.storage": set(), "app.web": {"app.storage"}}, {})

    return write


def test_an_import_downward_passes(small):
    assert small(**{"app/web/pages": "from app.storage import store\n", "app/storage/store": ""}) == []


@pytest.mark.parametrize(
    "text",
    [
        "from app.web import pages\n",
        "import app.web.pages\n",
        "def f():\n    from app.web.pages import index\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from app.web import pages\n",
        'from importlib import import_module\npages = import_module("app.web.pages")\n',
    ],
    ids=["upward", "whole", "lazy", "for types", "by name"],
)
def test_an_import_upward_is_found_wherever_it_stands(small, text):
    assert small(**{"app/web/pages": "index = 1\n", "app/storage/store": text}) == ["app/storage/store.py imports app.web"]


def test_a_cycle_in_the_table_is_found():
    with pytest.raises(CycleError):
        TopologicalSorter({**ALLOWED, "app.storage": {*ALLOWED["app.storage"], "app.web"}}).prepare()


def test_a_library_needs_a_row_and_a_unit_too(small):
    assert small(**{"app/storage/store": "import numpy\n", "app/cli/main": ""}) == [
        "app.cli has no row",
        "app/storage/store.py imports numpy",
    ]


def test_the_core_knows_nothing_of_the_web():
    web = {"app", "fastapi", "starlette", "uvicorn", "viser", "sqlite_utils", "pydantic", "click", "rich"}
    for unit, libraries in LIBRARIES.items():
        assert not (unit.startswith("marsexplorer") and libraries & web), unit
    assert not any(
        unit.startswith("marsexplorer") and any(each.startswith("app") for each in ALLOWED[unit]) for unit in ALLOWED
    )


def test_a_policy_decides_from_the_observation_alone():
    for unit in (unit for unit in ALLOWED if unit.startswith("marsexplorer.policies")):
        assert not ALLOWED[unit] & {"marsexplorer.rules", "marsexplorer.world", "marsexplorer.terrain", "marsexplorer.episode"}


def test_folders_stay_small_enough_to_be_read():
    for folder in {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}:
        modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        most = {"app": 4}.get(folder.name, 20)
        assert len(modules) <= most, f"{folder.relative_to(ROOT)} has {len(modules)} modules"


def test_only_the_web_knows_the_services():
    importers = {unit for unit, targets in ALLOWED.items() if "app.services" in targets}
    assert importers == {"app.web", "app.server"}
