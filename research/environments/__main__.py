"""`python -m research.environments`: draw the table of docs/environments.md again.

With names of families, print theirs.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

ROOT = Path(__file__).resolve().parents[2]
FAMILIES: Mapping[str, Mapping[str, Any]] = tomllib.loads(
    Path(__file__).with_name("families.toml").read_text("utf-8")
)
PAGE = ROOT / "docs" / "environments.md"
BLOCK = re.compile(r"^<!-- drawn: environments -->\n.*?^<!-- end -->$", re.M | re.S)


def rows_of(name: str, folder: Path, steps: int) -> tuple[str, str]:
    """The head of the table and a family's rows, from its virtual environment.

    The environment is made if there is none.
    """
    family, place = FAMILIES[name], folder / name.replace(" ", "-").lower()
    envs = [env if isinstance(env, str) else json.dumps(env) for env in family["environments"]]
    python = str(place / "bin" / "python")
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    pins = ("--constraint", f"{ROOT}/constraints.txt") if family.get("pinned", True) else ()
    pip = [python, "-m", "pip", "install", "--quiet", *pins]
    done = subprocess.run(
        [*pip, "--editable", f"{ROOT}", *family.get("install", ())],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        reason = next(line for line in done.stderr.splitlines() if line.startswith("ERROR: "))
        shown = (env if isinstance(env, str) else env["id"] for env in family["environments"])
        return "", "".join(f"| {env} | not installed: {reason[7:]} |{' |' * 6}\n" for env in shown)
    command = [python, "-m", "humanplay.cli", "doctor", "--table"]
    asked = ["--steps", str(family.get("steps", steps)), "--minutes", "600", *envs]
    environ = os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'app'}"} | family.get("environ", {})
    printed = subprocess.run(
        [*command, *asked], cwd=place, env=environ, stdout=subprocess.PIPE, text=True, check=False
    )
    head, line, *rows = printed.stdout.splitlines(keepends=True)
    return head + line, "".join(rows)


@click.command()
@click.argument("names", nargs=-1, type=click.Choice([*FAMILIES]))
@click.option("--venvs", type=click.Path(path_type=Path), default=ROOT / ".cache" / "environments")
@click.option("--steps", default=400, show_default=True, help="Moves for each of five seeds.")
def main(names: tuple[str, ...], venvs: Path, steps: int) -> None:
    """Examine each family of families.toml, and write docs/environments.md.

    A family is installed, and `humanplay doctor --table` examines it.
    """
    head, table = "", ""
    for name in names or FAMILIES:
        family_head, rows = rows_of(name, venvs, steps)
        head, table = head or family_head, table + rows
        click.echo(rows, nl=False)
    if not names:
        drawn = f"<!-- drawn: environments -->\n{head}{table}<!-- end -->"
        PAGE.write_text(BLOCK.sub(lambda _: drawn, PAGE.read_text("utf-8")), "utf-8")


main()
