"""The command `marsexplorer policies`: which there are, what their cards say, and the Hugging Face hub."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.command.console import print_table, progress, reason
from humanplay.command.options import flag, path_option

TOKEN = option("--token", envvar="HF_TOKEN", help="Your own.  [default: that of `hf auth login`]")


@click.group(short_help="List policies, show their cards, share them on the Hugging Face hub.")
def policies() -> None:
    """List policies, show their cards, and share them on the Hugging Face hub.

    \b
    Examples:
      marsexplorer policies list
      marsexplorer policies card ppo
      marsexplorer policies measure runs/mine/mine.onnx
      marsexplorer policies push runs/mine/mine.onnx ada/mars-explorer
      marsexplorer policies pull ada/mars-explorer
    """


@policies.command("list")
def list_policies() -> None:
    """List the policies that load by name."""
    from marsexplorer.policies import describe, names
    from marsexplorer.policies.files.card import of_paper

    rows = [(name, describe(name)) for name in (*names(), *of_paper())]
    print_table("Policies", ("name", "what it is"), rows)


@policies.command()
@argument("policy")
def card(policy: str) -> None:
    """Print the card in a policy's file as JSON. POLICY is a name or a path."""
    import json

    from marsexplorer.policies.files.card import read_card

    with policy_errors():
        echo(json.dumps(read_card(file_of(policy)), indent=2, ensure_ascii=False))


@policies.command()
@argument("policy")
def measure(policy: str) -> None:
    """Play the terrains of a policy's card again, and write what they come to into its file.

    POLICY is a name or a path. The card then lists the moves of every episode, so that anybody can play
    them again: `make cards` does with the shipped ones.
    """
    from marsexplorer.evaluation.cards import config_of, result_for_card
    from marsexplorer.policies.files.card import read_card, write_card

    with policy_errors():
        file = file_of(policy)
        found = read_card(file)
        if not found.get("results"):
            raise UsageError(f"the card of {file} has no results; `train` writes some")
        results = {}
        for where, each in found["results"].items():
            with progress(where) as advance:
                config, terrains, first = config_of(where), each["terrains"], each["first_seed"]
                results[where] = result_for_card(file, config, terrains, first, advance)
            moves = results[where]["steps"]
            echo(f"{where}: {moves} moves to 99 %, the card said {each['steps']}")
        write_card(file, {**found, "results": results})


@policies.command()
@argument("policy")
@argument("repo", metavar="OWNER/NAME")
@flag("--private", "Make the repository for you alone, if it is not there.")
@TOKEN
def push(policy: str, repo: str, private: bool, token: str | None) -> None:
    """Write a policy into a repository of the hub, with its card in words and as JSON, in one commit.

    POLICY is the name or path of a policy with a card. The repository is made when it is not there.
    """
    with policy_errors():
        from marsexplorer.policies.files import hub

        file = file_of(policy)
        with _hub_errors(hub.HubError):
            address = hub.push(file, repo, is_private=private, token=token)
        echo(f"{file.name} stands at {address}")


@policies.command()
@argument("repo", metavar="OWNER/NAME")
@path_option("--out", "Folder for the file.", default=Path(), show_default="the current one")
@option("--revision", help="A branch, tag or commit.  [default: the newest]")
@TOKEN
def pull(repo: str, out: Path, revision: str | None, token: str | None) -> None:
    """Download the policy of a repository of the hub and check its card. Nothing in the file is run."""
    with policy_errors("; choose another --out"):
        from marsexplorer.policies.files import hub
        from marsexplorer.policies.files.card import read_card

        with _hub_errors(hub.HubError):
            file = hub.pull(repo, out, revision=revision, token=token)
        echo(f"{file}: {read_card(file).get('summary', 'a policy')}")
        echo(f"Play beside it: humanplay serve --policy {file}")


def file_of(policy: str) -> Path:
    """Return the file of a policy; UsageError for a rule, which is code and has none."""
    from marsexplorer.policies.loading import BUILT_IN, find_file

    if policy in BUILT_IN:
        rule = f"{policy} is a rule, code of this package"
        raise UsageError(f"{rule}; name a policy that has a file, such as ppo")
    return find_file(policy)


@contextmanager
def policy_errors(way_out: str = "") -> Iterator[None]:
    """Turn a policy that is not there or cannot be read into a UsageError, a failing disk into a ClickException."""
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    try:
        yield
    except (PolicyFileError, PolicyNotFoundError) as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        why = f"{reason(error)}{way_out}"
        raise ClickException(f"cannot read or write the policy: {why}") from error


@contextmanager
def _hub_errors(kind: type[Exception]) -> Iterator[None]:
    try:
        yield
    except kind as error:
        raise ClickException(str(error)) from error
