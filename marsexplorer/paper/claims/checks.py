"""What the paper says of its environment, tested without training: `python -m marsexplorer.paper.claims.checks [NAME ...]`.

`--out FILE` writes the lines of all checks, as they are shipped in `data/paper/environment.jsonl`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from marsexplorer.files import write_whole
from marsexplorer.paper.claims import rule_checks, terrain_checks
from marsexplorer.paper.claims.rule_checks import Finding

COMMAND = "python -m marsexplorer.paper.claims.checks"
CHECKS: dict[str, Callable[[], Finding]] = {
    "actions": rule_checks.actions,
    "state": rule_checks.state,
    "reward": rule_checks.reward,
    "invalid": rule_checks.invalid,
    "bonus": rule_checks.bonus,
    "table-1": terrain_checks.table_1,
    "diversity": terrain_checks.diversity,
    "random-obstacles": terrain_checks.random_obstacles,
    "score-zero": rule_checks.score_zero,
    "score-one": rule_checks.score_one,
    "shares": rule_checks.shares,
    "lattice": terrain_checks.lattice,
    "topology": terrain_checks.topology,
    "morphology": terrain_checks.morphology,
    "bonus-levels": terrain_checks.bonus_levels,
    "combinations": terrain_checks.combinations,
    "structure": terrain_checks.structure,
    "discovered-obstacles": terrain_checks.discovered_obstacles,
    "sizes": terrain_checks.sizes,
}
"""The claim of docs/paper.md -> its check."""


def run(names: Iterable[str] = CHECKS) -> list[dict[str, Any]]:
    """Return a line for each check named: `kind` "check", `claim`, `holds` and the sentence `measured`.

    ValueError when there is no check of a name.
    """
    lines = []
    for name in names:
        if name not in CHECKS:
            raise ValueError(f"no check {name!r}; choose from: {', '.join(CHECKS)}")
        finding = CHECKS[name]()
        lines.append(
            {
                "kind": "check",
                "claim": name,
                "holds": bool(finding.holds),
                "measured": finding.measured,
            }
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the checks that the command line names, all by default, and print what they found."""
    parser = argparse.ArgumentParser(
        prog=COMMAND, description="Test the paper's statements on the environment."
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"checks to run; all by default: {', '.join(CHECKS)}",
    )
    parser.add_argument("--out", type=Path, help="also write the lines to this file (JSON Lines)")
    options = parser.parse_args(arguments)
    try:
        lines = run(options.names or CHECKS)
    except ValueError as error:
        parser.error(str(error))
    for line in lines:
        print(
            f"{line['claim']}: {'holds' if line['holds'] else 'does not hold'}. {line['measured']}."
        )
    if options.out is not None:
        with write_whole(options.out) as file:
            file.write("".join(json.dumps(line) + "\n" for line in lines).encode())


if __name__ == "__main__":
    main()
