"""How large is what an extra installs, in fresh environments of the wheel?

    python -m research.speed.sizes              no extra, [play] and [study], by the pinned packages
    python -m research.speed.sizes mars --most 12

Each is made in a temporary folder from the package index, so this needs the network and some
minutes. "Beside" is what is there beside Gymnasium and NumPy with what they need themselves. Sizes
are what the files take on the disk, with the bytecode that pip compiles.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import venv
from collections import Counter
from collections.abc import Iterator
from importlib.metadata import Distribution, distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]
EVERYBODYS = ("gymnasium", "numpy")
"""What whoever plays an environment in Python has already."""


def main() -> None:
    """Make the environments and print a line for each, with its largest packages."""
    parser = argparse.ArgumentParser(description="The sizes of fresh environments, by extra.")
    parser.add_argument("extras", nargs="*", default=["", "play", "study"], help="names of extras")
    parser.add_argument("--most", type=int, default=6, help="packages to list of each")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wheel = _build(Path(folder))
        print("|extra|packages|MB|MB beside Gymnasium and NumPy|largest|\n|---|---|---|---|---|")
        for extra in options.extras:
            print(_row(extra, wheel, Path(folder) / f"with-{extra}", options.most), flush=True)


def _row(extra: str, wheel: Path, folder: Path, most: int) -> str:
    venv.create(folder, symlinks=True)
    asked = f"{wheel}[{extra}]" if extra else str(wheel)
    constraints = ("--constraint", str(ROOT / "constraints.txt"))
    _pip("--python", folder / "bin/python", "install", *constraints, asked)
    (packages,) = folder.glob("lib/python*/site-packages")
    installed = {_name(package): package for package in distributions(path=[str(packages)])}
    sizes = Counter({name: _size(package) for name, package in installed.items()})
    beside = sum(sizes[name] for name in set(sizes) - set(_needed(installed, EVERYBODYS)))
    largest = ", ".join(f"{name} {_mb(size)}" for name, size in sizes.most_common(most))
    named = f"`[{extra}]`" if extra else "none"
    return f"|{named}|{len(sizes)}|{_mb(sizes.total())}|{_mb(beside)}|{largest}|"


def _build(folder: Path) -> Path:
    _pip("wheel", ROOT, "--no-deps", "--wheel-dir", folder)
    (wheel,) = folder.glob("*.whl")
    return wheel


def _pip(*words: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*command, *map(str, words)], check=True)


def _needed(installed: dict[str, Distribution], names: tuple[str, ...]) -> Iterator[str]:
    """Yield these packages and all that they need without an extra."""
    for name in names:
        if name in installed:
            yield name
            wanted = [line for line in installed[name].requires or () if "extra ==" not in line]
            yield from _needed(installed, tuple(map(_normalized, wanted)))


def _name(package: Distribution) -> str:
    return _normalized(package.metadata["Name"])


def _normalized(requirement: str) -> str:
    """The name at the beginning of a requirement, as the index writes it."""
    name = re.match(r"[\w.-]+", requirement)
    assert name is not None
    return re.sub(r"[-_.]+", "-", name[0]).lower()


def _size(package: Distribution) -> int:
    paths = (Path(str(package.locate_file(file))) for file in package.files or ())
    return sum(path.stat().st_blocks * 512 for path in paths if path.is_file())


def _mb(size: int) -> str:
    return f"{size / 1e6:.1f}"


if __name__ == "__main__":
    main()
