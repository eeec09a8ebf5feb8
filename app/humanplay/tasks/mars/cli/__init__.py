"""The command `marsexplorer`: train, evaluate and share policies."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from humanplay.command.group import SETTINGS, Commands, Entry, run

COMMANDS = {
    "evaluate": Entry("evaluate", "play", "Score policies on the same terrains."),
    "train": Entry("train", "train", "Train a policy on this machine."),
    "puzzles": Entry("puzzles", "play", "Make the puzzles that come with the package."),
    "policies": Entry(
        "policies", "play", "List policies, show their cards, share them on the Hugging Face hub."
    ),
}


@click.group(
    cls=Commands, package="humanplay.tasks.mars.cli", table=COMMANDS, context_settings=SETTINGS
)
@click.version_option(package_name="humanplay", prog_name="marsexplorer")
def cli() -> None:
    """Train and evaluate policies that explore MarsExplorer's terrains.

    \b
    Begin with:
      marsexplorer evaluate --policy frontier-cost          score a policy, with an interval
      marsexplorer train --minutes 15 --out runs/mine       train a policy of your own
      humanplay serve --policy runs/mine/mine.onnx          watch it in the browser
    Every command has its own help: marsexplorer train --help
    """


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit with its code; `args` defaults to the process's words."""
    words = sys.argv[1:] if args is None else args
    if words and words[0] == "train":  # it keeps what it has done, as for Ctrl-C
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    run(cli, "marsexplorer", words)
