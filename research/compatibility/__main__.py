"""Run the environment with several versions of its needs; draw the page of it.

The page is docs/compatibility.md.

    python -m research.compatibility

Each row is an environment of its own, made with pip in a temporary folder: Gymnasium, NumPy, Numba
and Pillow, without the rest of the playground. TorchRL and Tianshou are tried where this command's
own interpreter has them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "compatibility.md"
CHECKS = ("checker", "copies", "stack", "wrapper")
PROBE_S = 900
VERSIONS = "import gymnasium, numpy; print(gymnasium.__version__, numpy.__version__)"


@dataclass(frozen=True)
class Case:
    """What is run together; "" for the newest version that pip finds."""

    python: str = "3.11"
    gymnasium: str = ""
    numpy: str = ""


CASES = (
    Case(gymnasium="1.0.0", numpy="1.26.4"),
    Case(gymnasium="1.1.1", numpy="2.0.2"),
    Case(gymnasium="1.2.3", numpy="2.2.6"),
    Case(),
    Case(gymnasium="1.0.0"),
    Case(numpy="1.26.4"),
    Case(python="3.12"),
    Case(python="3.13"),
)
LIBRARIES = ("torchrl", "tianshou")

HEAD = """# Compatibility

*Reference. `python -m research.compatibility` drew this page.*

For each row of the first table these ran: Gymnasium's own check, copies by `copy.deepcopy` and `pickle`, our
vector environment against Gymnasium's `SyncVectorEnv`, and a vector wrapper.
`tests/marsexplorer/test_as_gymnasium_expects.py` tests every vector wrapper.

|Python|Gymnasium|NumPy|result|
|---|---|---|---|
"""


def try_case(case: Case, folder: Path) -> str:
    """Make an environment, run the checks, and return the row of the page."""
    python = shutil.which(f"python{case.python}")
    wanted = f"|{case.python}|{case.gymnasium or 'newest'}|{case.numpy or 'newest'}|"
    if python is None or subprocess.run([python, "-c", ""], capture_output=True).returncode:
        return f"{wanted}not run: no python{case.python} on the machine that drew this page|"
    subprocess.run([python, "-m", "venv", folder], check=True)
    case_python = folder / "bin" / "python"
    packages = [
        name if not version else f"{name}=={version}"
        for name, version in (("gymnasium", case.gymnasium), ("numpy", case.numpy))
    ]
    command: list[str | Path] = [
        case_python,
        "-m",
        "pip",
        "install",
        "-q",
        "--disable-pip-version-check",
        *packages,
    ]
    installed = subprocess.run([*command, "numba", "pillow"], capture_output=True, text=True)
    if installed.returncode:
        lines = [line for line in installed.stderr.splitlines() if line.startswith("ERROR")]
        return f"{wanted}does not install: {(lines or ['pip failed'])[0][:150]}|"
    gymnasium, numpy = subprocess.run(
        [case_python, "-c", VERSIONS], capture_output=True, text=True, check=True
    ).stdout.split()
    return f"|{case.python}|{gymnasium}|{numpy}|{probe(case_python, folder, CHECKS)}|"


def probe(python: Path, folder: Path, checks: tuple[str, ...]) -> str:
    """Run checks in an environment; return "passed", or the first that failed and why."""
    environ = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder / "kernels")}
    script = Path(__file__).with_name("probe.py")
    try:
        done = subprocess.run(
            [python, script, *checks],
            env=environ,
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=PROBE_S,
        )
    except subprocess.TimeoutExpired as error:
        output = error.stdout or b""
        return f"{_unfinished(checks, output.decode())} not done after {PROBE_S} s"
    if done.returncode == 0:
        return "passed"
    lines = done.stderr.strip().splitlines() or [f"Python ended with code {done.returncode}"]
    return f"{_unfinished(checks, done.stdout)} failed: {lines[-1][:150]}"


def _unfinished(checks: tuple[str, ...], output: str) -> str:
    """The first check that did not print its name, or the end of Python."""
    return next((check for check in checks if check not in output.split()), "the end")


def libraries(folder: Path) -> Iterator[str]:
    """The rows of the libraries that this interpreter has."""
    yield "\n|library|version|result|\n|---|---|---|"
    for name in LIBRARIES:
        version = subprocess.run(
            [
                sys.executable,
                "-c",
                f"from importlib.metadata import version; print(version('{name}'))",
            ],
            capture_output=True,
            text=True,
        ).stdout.strip()
        result = probe(Path(sys.executable), folder, (name,)) if version else "not installed"
        yield f"|{name}|{version or '-'}|{result}|"


def main() -> None:
    """Run all cases and write the page."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number, case in enumerate(CASES):
            rows.append(try_case(case, Path(folder) / str(number)))
            print(rows[-1], flush=True)
        for row in libraries(Path(folder)):
            rows.append(row)
            print(row, flush=True)
    PAGE.write_text(HEAD + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
