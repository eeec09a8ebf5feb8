"""The command `marsexplorer policies`: which there are, and what their cards say."""

from __future__ import annotations

from pathlib import Path

import click

from app.cli.console import print_table


@click.group(short_help="List policies, and show their cards.")
def policies() -> None:
    """List policies, and show their cards.

    \b
    Examples:
      marsexplorer policies list
      marsexplorer policies card ppo
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

    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError
    from marsexplorer.policies.files.card import read_card

    try:
        click.echo(json.dumps(read_card(_file_of(policy)), indent=2, ensure_ascii=False))
    except (PolicyFileError, PolicyNotFoundError) as error:
        raise click.UsageError(str(error)) from error


def _file_of(policy: str) -> Path:
    """Return the file of a policy; UsageError for a rule, which is code and has none."""
    from marsexplorer.policies.loading import BUILT_IN, find_file

    if policy in BUILT_IN:
        raise click.UsageError(
            f"{policy} is a rule, code of this package; name a policy that has a file, such as ppo"
        )
    return find_file(policy)
