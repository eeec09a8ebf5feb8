"""The command `marsexplorer policies`: list, show and share policies."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.command.console import print_table, progress, reason
from humanplay.command.options import PATH, SizeType, flag, path_option, several

TOKEN = option("--token", envvar="HF_TOKEN", help="Your own.  [default: that of `hf auth login`]")


@click.group(short_help="List policies, show their cards, share them on the Hugging Face hub.")
def policies() -> None:
    """List policies, show their cards, and share them on the Hugging Face hub.

    \b
    Examples:
      marsexplorer policies list
      marsexplorer policies card ppo
      marsexplorer policies add net.onnx --values eq6 --acts greedy
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
    from marsexplorer.policies.files.card import read_card

    with policy_errors():
        echo(json.dumps(read_card(file_of(policy)), indent=2, ensure_ascii=False))


@policies.command(short_help="Read a policy that another library exported as ONNX.")
@argument("file", type=PATH)
@path_option("--out", "The policy file to write.  [default: NAME-added.onnx, here]")
@option(
    "--values",
    type=click.Choice(["eq6", "codes"]),
    help="What a float input holds: 0, 0.3, 0.6 and 1, or codes 0 to 3.",
)
@option("--size", type=SizeType(), help="The board of a flat input, as in 21x21.")
@option(
    "--frames", type=click.Choice(["oldest", "newest"]), help="Which of stacked frames comes first."
)
@option(
    "--padding",
    type=click.Choice(["zeros", "repeat"]),
    help="What stands before an episode's first frame.",
)
@option("--output", metavar="NAME", help="The output that chooses the move, if several could.")
@option("--acts", type=click.Choice(["greedy", "samples"]), help="Take the best move, or draw it.")
@option(
    "--scores",
    type=click.Choice(["logits", "q"]),
    help="What the scores are, if moves are drawn from them.",
)
@several(
    "--state",
    "states",
    "An input that is the OUTPUT of the move before; repeatable.",
    metavar="INPUT=OUTPUT",
)
@option("--initial", type=click.Choice(["zeros"]), help="The states at the start of an episode.")
@option(
    "--episode-start",
    "start",
    metavar="NAME",
    help="The input that is 1 at the start of an episode.",
)
def add(
    file: Path,
    out: Path | None,
    size: int | tuple[int, int] | None,
    states: tuple[str, ...],
    **answers: str | None,
) -> None:
    """Read FILE, another library's ONNX model, and write one policy file from it.

    Stable-Baselines3, CleanRL, Tianshou, RLlib and plain torch export such models; the policy file plays without them.
    What the shapes in FILE do not say is asked for by an option. All that is amiss is listed at once, each with the line that
    mends it. The card of the file says how it was read. It needs the extra [onnx]; the file that it writes does not.

    \b
    Examples:
      marsexplorer policies add net.onnx --values eq6 --acts greedy
      marsexplorer policies add flat.onnx --values eq6 --size 21x21 --acts samples --scores logits
      marsexplorer policies add stacked.onnx --values codes --frames oldest --padding repeat --acts greedy
      marsexplorer policies add lstm.onnx --values eq6 --acts greedy --state h=h_out --state c=c_out --initial zeros
    """
    with policy_errors():
        try:
            from marsexplorer.evaluation.boards import observations
            from marsexplorer.policies.files.adopt import adopt
            from marsexplorer.policies.files.adoption import Answers
        except ModuleNotFoundError as error:
            raise ClickException(
                f"`policies add` needs the package {error.name}: pip install 'humanplay[mars,onnx]'; "
                "the file that it writes does not"
            ) from error
        pairs = tuple(_pair(state) for state in states)
        board = (size, size) if isinstance(size, int) else size
        out = out or Path(f"{file.stem}-added.onnx")
        notes = adopt(file, out, Answers(size=board, states=pairs, **answers), observations)
    for subject, note in notes.items():
        echo(f"{subject}: {note}")
    echo(f"{out}: play beside it with humanplay serve --policy {out}")


def _pair(state: str) -> tuple[str, str]:
    """The input and the output of a --state."""
    name, _, following = state.partition("=")
    if not name or not following:
        raise UsageError(f"--state: expected INPUT=OUTPUT, got {state!r}")
    return name, following


@policies.command()
@argument("policy")
def measure(policy: str) -> None:
    """Play the terrains of a policy's card again, and write the results into it.

    POLICY is a name or a path. The card then lists the moves of every episode, so that anybody can play
    them again: `make cards` does with the shipped ones.
    """
    from marsexplorer.evaluation.cards import config_of, result_for_card
    from marsexplorer.policies.files.card import read_card, write_card

    with policy_errors():
        file = file_of(policy)
        card = read_card(file)
        if not card.get("results"):
            raise UsageError(f"the card of {file} has no results; `train` writes some")
        results = {}
        for place, claimed in card["results"].items():
            with progress(place) as advance:
                config = config_of(place)
                terrains, first = claimed["terrains"], claimed["first_seed"]
                results[place] = result_for_card(file, config, terrains, first, advance)
            moves = results[place]["steps"]
            echo(f"{place}: {moves} moves to 99 %, the card said {claimed['steps']}")
        write_card(file, {**card, "results": results})


@policies.command()
@argument("policy")
@argument("repo", metavar="OWNER/NAME")
@flag("--private", "Make the repository for you alone, if it is not there.")
@TOKEN
def push(policy: str, repo: str, private: bool, token: str | None) -> None:
    """Write a policy and its card, as text and as JSON, to a hub repository.

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
    """Download a policy from a hub repository and check its card.

    Nothing in the file is run.
    """
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
    """Make a missing or unreadable policy a UsageError, a disk's a ClickException."""
    from marsexplorer.policies import PolicyFileError, PolicyNotFoundError

    try:
        yield
    except (PolicyFileError, PolicyNotFoundError) as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise ClickException(
            f"cannot read or write the policy: {reason(error)}{way_out}"
        ) from error


@contextmanager
def _hub_errors(kind: type[Exception]) -> Iterator[None]:
    try:
        yield
    except kind as error:
        raise ClickException(str(error)) from error
