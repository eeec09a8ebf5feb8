"""The command `marsexplorer evaluation`: agents on terrains that stay sealed, cards for their authors, receipts."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import argument, option

from app.cli.console import (
    DATABASE,
    STUDIES,
    SizeType,
    default_config,
    env_config_of,
    print_table,
    study_errors,
    task_name,
)
from app.cli.study import study as studies

if TYPE_CHECKING:
    from app.series.folder import Folder


@click.group(
    short_help="Evaluate agents on terrains that stay sealed.",
    context_settings={"show_default": True},
)
def evaluation() -> None:
    """Let agents play the terrains that people played, unseen, and sign what came of it.

    An evaluation is frozen and committed like a study, lies in the same folder, and is played on the same server. Authors of
    agents play by cards, one for each author; no score is told before the evaluation closes, which publishes everything.

    \b
    Examples:
      marsexplorer study close pilot --sealed
      marsexplorer evaluation new pilot-agents --of pilot --sees picture
      marsexplorer evaluation freeze pilot-agents
      marsexplorer evaluation card pilot-agents --author "Ann Lee"   the address for her agent
      marsexplorer serve
      marsexplorer evaluation close pilot-agents
      marsexplorer evaluation verify receipt.json --opening opening.json
    """


@evaluation.command(short_help="Begin an evaluation: write its protocol as a draft.")
@argument("name")
@option("--of", "of", metavar="STUDY", help="The study whose ranked terrains are played.")
@option("--task", "task", metavar="ID", help="An environment, on instances of its own; mars too.")
@option("--level", default="random", help="With --task mars.")
@option("--size", type=SizeType(), default="21", help="With --task mars.")
@option("--instances", default=30, help="With --task: how many.")
@option(
    "--sees", type=click.Choice(["picture", "observation", "both"]), default="both",
    help="What agents are shown: what people see, what policies are given, or both.",
)  # fmt: skip
@option("--hours", default=168.0, help="From a card's first attempt until the card is closed.")
@option(
    "--minutes",
    type=float,
    help="From the beginning of an attempt until it is abandoned.  [default: no limit]",
)
@option("--calls", default=20_000, help="Calls that a card may make, for each instance.")
@STUDIES
def new(
    name: str,
    of: str | None,
    task: str | None,
    level: str,
    size: int | tuple[int, int],
    instances: int,
    folder: Folder,
    **given: Any,
) -> None:
    """Write an evaluation's protocol.json, a draft to read and edit before it is frozen.

    With --of the instances are the ranked terrains of that study, as long as they are secret: while it is open, or closed with
    --sealed. Of one that was closed without, others of the same distribution are drawn, and the comparison is not paired.

    \b
    Examples:
      marsexplorer evaluation new pilot-agents --of pilot
      marsexplorer evaluation new lake-agents --task FrozenLake-v1 --instances 50 --sees observation
    """
    from app.series.evaluation import evaluation_of_study, evaluation_of_task
    from app.series.protocol import Agents

    if (of is None) == (task is None):
        raise click.UsageError("expected either --of STUDY or --task ID")
    with study_errors():
        folder.path(name)
        agents = Agents(**given)
        if of is not None:
            protocol = evaluation_of_study(folder, name, of, agents)
        else:
            known = task_name(str(task))
            config = env_config_of(level, size) if known == "mars" else default_config(known)
            protocol = evaluation_of_task(name, config, known, instances, agents)
        path = folder.create(protocol)
    if protocol.agents is not None and protocol.agents.unpaired:
        click.echo(f"Not paired: {protocol.agents.unpaired}")
    click.echo(f"{path}: read it, edit it, then `marsexplorer evaluation freeze {name}`")


@evaluation.command(short_help="Fix the protocol and draw the secret.")
@argument("name")
@option("--beacon", is_flag=True, help="As of `study freeze`, for instances of its own.")
@DATABASE
@STUDIES
def freeze(name: str, beacon: bool, folder: Folder, database: Path) -> None:
    """Fix an evaluation's protocol for good, and print its hash and its commitment: publish them before any agent plays."""
    found = studies.frozen(name, beacon, folder, database)
    click.echo(f"The evaluation {name!r} is frozen.\n{studies.hashes(found)}")
    if (paired := found.paired) is not None:
        click.echo(
            f"Its instances are the ranked terrains of {paired.name!r}:\n{studies.hashes(paired)}"
        )
    if found.waits_for_beacon:
        click.echo(f"Then `marsexplorer evaluation open {name}`")
    click.echo(
        f"`marsexplorer evaluation card {name} --author NAME` makes the address for an author's agent"
    )


evaluation.add_command(studies.open_, "open")


@evaluation.command(short_help="Issue a card to the author of an agent.")
@argument("name")
@option("--author", required=True, help="Who answers for the agent: a person or a group.")
@option("--base", default="http://127.0.0.1:8000", help="The server's address.")
@STUDIES
def card(name: str, author: str, base: str, folder: Folder) -> None:
    """Issue a card and print its address: whoever has it plays with it, once at each instance.

    A further card of an author is numbered, its receipt says that it has seen these instances, and it never ranks.

    \b
    Examples:
      marsexplorer evaluation card pilot-agents --author "Ann Lee" --base https://mars.example.org
    """
    from app.series.evaluation import SEEN_BEFORE, CardList, card_link

    with study_errors():
        issued = CardList(folder).issue(name, author)
        link = card_link(folder.study(name), issued.id, base)
    if issued.number > 1:
        click.echo(
            f"Card {issued.number} of {author}: it {SEEN_BEFORE}, and does not rank", err=True
        )
    click.echo(link)


@evaluation.command("list", short_help="List all evaluations.")
@STUDIES
def list_(folder: Folder) -> None:
    """Print every evaluation in the folder with its state."""
    rows = []
    for name in folder.names():
        with study_errors():
            protocol = folder.draft(name)
        if protocol.agents is not None:
            of = protocol.agents.study
            rows.append(
                (name, folder.status(name), str(protocol.ranked), of.name if of else protocol.task)
            )
    if not rows:
        click.echo(
            f"no evaluations in {folder.root}; `marsexplorer evaluation new NAME` begins one"
        )
        return
    print_table("Evaluations", ("name", "status", "instances", "of"), rows)
