"""The command `marsexplorer policies`: which there are, and what their cards say."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from app.cli.console import print_table, progress


@click.group(short_help="List policies, and show their cards.")
def policies() -> None:
    """List policies, and show their cards.

    \b
    Examples:
      marsexplorer policies list
      marsexplorer policies card ppo
      marsexplorer policies measure runs/mine/mine.onnx
    """


@policies.command("list")
def list_policies() -> None:
    """List the policies that load by name."""
    from marsexplorer.policies import describe, names
    from marsexplorer.policies.files.card import of_paper

    rows = [(name, describe(name)) for name in (*names(), *of_paper())]
    print_table("Policies", ("name", "what it is"), rows)


@policies.command()
@click.argument("policy")
def card(policy: str) -> None:
    """Print the card in a policy's file as JSON. POLICY is a name or a path."""
    import json

    from marsexplorer.policies.files.card import read_card

    with _policy_errors():
        click.echo(json.dumps(read_card(_file_of(policy)), indent=2, ensure_ascii=False))


@policies.command()
@click.argument("policy")
def measure(policy: str) -> None:
    """Play the terrains of a policy's card again, and write what they come to into its file.

    POLICY is a name or a path. The card then lists the moves of every episode, so that anybody can play
    them again: `make cards` does with the shipped ones.
    """
    from marsexplorer.evaluation.cards import config_of, result_for_card
    from marsexplorer.policies.files.card import read_card, write_card

    with _policy_errors():
        file = _file_of(policy)
        found = read_card(file)
        if not found.get("results"):
            raise click.UsageError(
                f"the card of {file} has no results; `marsexplorer train` writes some"
            )
        results = {}
        for where, each in found["results"].items():
            with progress(where) as advance:
                config, terrains, first = config_of(where), each["terrains"], each["first_seed"]
                results[where] = result_for_card(file, config, terrains, first, advance)
            click.echo(
                f"{where}: {results[where]['steps']} moves to 99 %, the card said {each['steps']}"
            )
        write_card(file, {**found, "results": results})


def _file_of(policy: str) -> Path:
    """Return the file of a policy; UsageError for a rule, which is code and has none."""
    from marsexplorer.policies.loading import BUILT_IN, find_file

    if policy in BUILT_IN:
        raise click.UsageError(
            f"{policy} is a rule, code of this package; name a policy that has a file, such as ppo"
        )
    return find_file(policy)


@contextmanager
def _policy_errors() -> Iterator[None]:
    """End the command where a policy is not found or its file cannot be read."""
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    try:
        yield
    except (PolicyFileError, PolicyNotFoundError) as error:
        raise click.UsageError(str(error)) from error
