"""The command `humanplay`.

It serves any environment in the browser, runs studies, and publishes their results.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import NoReturn

import click

from humanplay.command.group import SETTINGS, Commands, Entry, run

COMMANDS = {
    "serve": Entry("serve", "play", "Play and watch in a browser; every move is recorded."),
    "play": Entry("serve", "play", "Play one environment on this machine, in its browser."),
    "doctor": Entry("doctor", "", "Say whether an environment follows from seed and actions."),
    "study": Entry(
        "study.study", "study", "Plan, freeze, open and close a study with participants."
    ),
    "simulate": Entry("study.simulate", "study", "Let synthetic players take part in a study."),
    "report": Entry(
        "study.report",
        "study",
        "Write a study's figures with their intervals, as a page and as JSON.",
    ),
    "costs": Entry("study.report", "study", "Show where the players of a study lose moves."),
    "export": Entry("database", "", "Write the recorded episodes as CSV."),
    "replay": Entry("replay", "play", "Write an episode as a page in one file, a GIF or an MP4."),
    "verify": Entry("database", "study", "Simulate every recorded episode again and compare."),
    "release": Entry("bundles", "export", "Write a study as a citable, signed bundle."),
    "reproduce": Entry("bundles", "export", "Derive a bundle's figures again and compare."),
    "import": Entry(
        "bundles", "export", "Write the episodes of a released bundle into a database."
    ),
    "merge": Entry("database", "", "Join the databases of several servers."),
    "forget": Entry("database", "study", "Erase a participant from a database."),
    "backup": Entry("database", "", "Copy the database into one verified file while people play."),
    "restore": Entry("database", "", "Put a backup in the place of the database."),
    "leaderboard": Entry(
        "leaderboard", "play", "Make the leaderboard's figures of the shipped policies."
    ),
    "agents": Entry(
        ".agents.commands",
        "agents",
        "Evaluate other people's agents on instances that stay secret.",
    ),
}


@click.group(cls=Commands, package="humanplay.cli", table=COMMANDS, context_settings=SETTINGS)
@click.version_option(package_name="humanplay", prog_name="humanplay")
def cli() -> None:
    """Let people play an environment in the browser, and publish a human baseline.

    Every episode is recorded.

    \b
    Begin with:
      humanplay serve                                    MarsExplorer at http://127.0.0.1:8000
      humanplay play FrozenLake-v1                       any environment of Gymnasium
      humanplay study new pilot                          a study with participants
      humanplay export --out results                     write the recorded episodes as tables
    Every command has its own help: humanplay serve --help. `marsexplorer` trains and evaluates policies.
    """


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command and exit with its code.

    Args:
        args: The words after `humanplay`, those of the process by default.
    """
    run(cli, "humanplay", sys.argv[1:] if args is None else args)
