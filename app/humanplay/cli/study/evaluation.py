"""The command `marsexplorer evaluation`: agents on terrains that stay sealed, cards for their authors, receipts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.cli.console import (
    default_config,
    env_config_of,
    failures,
    print_table,
    progress,
    study_errors,
    task_name,
)
from humanplay.cli.options import (
    DATABASE_AND_STUDIES,
    KEY,
    PATH,
    STUDIES,
    SizeType,
    flag,
    path_option,
)
from humanplay.cli.study import study as studies

if TYPE_CHECKING:
    from humanplay.series.folder import Folder


@click.group(short_help="Evaluate agents on terrains that stay sealed.")
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
@option("--minutes", type=float, help="Until an attempt is abandoned.  [default: no limit]")
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
    from humanplay.series.evaluation import evaluation_of_study, evaluation_of_task
    from humanplay.series.protocol import Agents

    if (of is None) == (task is None):
        raise UsageError("expected either --of STUDY or --task ID")
    with study_errors():
        folder.path(name)
        agents = Agents.model_construct(**given)  # checked with the protocol that it enters
        if of is not None:
            protocol = evaluation_of_study(folder, name, of, agents)
        else:
            known = task_name(str(task))
            config = env_config_of(level, size) if known == "mars" else default_config(known)
            protocol = evaluation_of_task(name, config, known, instances, agents)
        path = folder.create(protocol)
    if protocol.agents is not None and protocol.agents.unpaired:
        echo(f"Not paired: {protocol.agents.unpaired}")
    echo(f"{path}: read it, edit it, then `marsexplorer evaluation freeze {name}`")


@evaluation.command(short_help="Fix the protocol and draw the secret.")
@argument("name")
@DATABASE_AND_STUDIES
def freeze(name: str, folder: Folder, database: Path) -> None:
    """Fix an evaluation's protocol for good, and print its hash and its commitment: publish them before any agent plays."""
    studies.check_kind("evaluation", "freeze", name, folder)
    found = studies.frozen(name, folder, database)
    echo(f"The evaluation {name!r} is frozen.\n{studies.hashes(found)}")
    if (paired := found.paired) is not None:
        of = f"Its instances are the ranked terrains of {paired.name!r}"
        echo(f"{of}:\n{studies.hashes(paired)}")
    echo(f"`marsexplorer evaluation card {name} --author NAME` makes an address for an agent")


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
    from humanplay.series.evaluation import SEEN_BEFORE, CardList, card_link

    with study_errors():
        issued = CardList(folder).issue(name, author)
        link = card_link(folder.study(name), issued.id, base)
    if issued.number > 1:
        what = f"Card {issued.number} of {author}: it {SEEN_BEFORE}, and does not rank"
        echo(what, err=True)
    echo(link)


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
            what = of.name if of else protocol.task
            rows.append((name, folder.status(name), str(protocol.ranked), what))
    if not rows:
        echo(f"no evaluations in {folder.root}; `marsexplorer evaluation new NAME` makes one")
        return
    print_table("Evaluations", ("name", "status", "instances", "of"), rows)


@evaluation.command(short_help="End an evaluation, reveal its terrains, and sign the receipts.")
@argument("name")
@flag("--yes", "Do not ask.")
@flag("--now", "Close it also while an agent is at it.")
@DATABASE_AND_STUDIES
def close(name: str, yes: bool, now: bool, folder: Folder, database: Path) -> None:
    """End an evaluation: attempts that run are abandoned and count, the secrets are revealed, and every card gets its receipt.

    The secret of the study whose terrains were played is revealed too. Receipts and the opening are written into the
    evaluation's folder, signed by the server's key, and are to be had on its page; called again it writes them again.
    """
    from humanplay.release.receipts import publish  # where it cannot be had nothing is closed
    from humanplay.series.policy_episodes import compared_policies

    studies.check_kind("evaluation", "close", name, folder)
    with study_errors(), _policy_errors():
        status, found = folder.status(name), folder.study(name)
        for each in compared_policies(found.protocol):
            found.policy_files.source(each)  # where one is lost nothing is closed either
    if status != "closed":
        question = f"Close the evaluation {name!r} for ever? What agents have not finished counts as it stands"
        studies.closed(name, None if yes else question, now, False, folder, database)
    if not database.exists():
        echo(
            f"The evaluation {name!r} is closed. There is no database at {database}, so no receipt was written: with the "
            f"--database in which agents have played, `marsexplorer evaluation close {name}` writes them"
        )
        return
    with failures(f"cannot sign the receipts of {name!r}"), study_errors(), _policy_errors():
        cards = publish(database, folder, name, progress)
    echo(f"The evaluation {name!r} is closed: {len(cards)} receipts and the opening")
    echo(f"are in {folder.path(name)}")


@contextmanager
def _policy_errors() -> Iterator[None]:
    """Turn a policy that cannot be played into its sentence."""
    from humanplay.task import PolicyError

    try:
        yield
    except PolicyError as error:
        raise ClickException(str(error)) from error


@evaluation.command(short_help="Check a receipt, without the server.")
@argument("receipt", type=PATH)
@path_option("--opening", "The evaluation's opening: simulate every episode again.", metavar="FILE")
@KEY
@option("--card", "ident", metavar="ID", help="The card that it must be of.")
@option("--evaluation", "of", metavar="NAME|HASH", help="The evaluation that it must be of.")
def verify(
    receipt: Path, opening: Path | None, key: str | None, ident: str | None, of: str | None
) -> int:
    """Check the signature and the chain of a receipt; with the opening, the commitments and every episode too.

    Exit code 1 where anything differs. A valid signature says who wrote the receipt only as far as the key is known: give the
    fingerprint that the server's operator published with --key.

    \b
    Examples:
      marsexplorer evaluation verify 7K3M.json --key 15f592c2...
      marsexplorer evaluation verify 7K3M.json --opening opening.json --card 7K3M
    """
    from humanplay.db.resimulation import Finding
    from humanplay.release import receipts, signing

    with failures("cannot read {file}"):
        content = receipts.read_signed(receipt, receipts.RECEIPT_FORMAT)
        found = list(receipts.check_receipt(content, ident, of))
        if opening is not None:
            opened = receipts.read_signed(opening, receipts.OPENING_FORMAT)
            found += receipts.check_opened(content, opened)
        signer = signing.fingerprint(content["public_key"].encode())
        wanted = None if key is None else signing.fingerprint_of(key)
    if wanted is not None and wanted != signer:
        found.append(Finding("receipt", "the signing key", signer, wanted))
    for each in found:
        echo(str(each))
    if not found:
        echo(receipts.description(content))
        echo(signing.SignerCheck(signer, "key" if wanted else None).sentence())
    what = "every episode simulated again" if opening else "no episode simulated without --opening"
    echo(f"{len(found) or 'nothing'} wrong; {what}")
    return 1 if found else 0


@evaluation.command(short_help="Show an evaluation and its cards.")
@argument("name")
@STUDIES
def show(name: str, folder: Folder) -> None:
    """Print how far an evaluation is, what was frozen, and its cards; never a secret of an open one, never a card's address."""
    from humanplay.series.evaluation import CardList

    studies.check_kind("evaluation", "show", name, folder)
    with study_errors():
        status, protocol = folder.status(name), folder.draft(name)
        found = None if status == "draft" else folder.study(name)
        cards = CardList(folder).of(name)
    agents = protocol.agents
    assert agents is not None
    of = protocol.task if agents.study is None else f"the ranked terrains of {agents.study.name}"
    of = f"instances of its own: {agents.unpaired}" if agents.unpaired else of
    echo(f"{name}: {status}, {folder.path(name)}\n{protocol.ranked} instances: {of}")
    given = f"{agents.hours:g} hours a card, {agents.calls} calls an instance"
    echo(f"agents see {agents.sees}; {given}")
    if found is not None:
        echo(studies.hashes(found))
    every = cards.values()
    rows = [(c.id, c.author, str(c.number), c.issued_at, c.revoked_at or "") for c in every]
    if rows:
        print_table("Cards", ("id", "author", "number", "issued", "revoked"), rows)


@evaluation.command(short_help="Take a card back.")
@argument("name")
@argument("ident", metavar="CARD")
@STUDIES
def revoke(name: str, ident: str, folder: Folder) -> None:
    """Take a card back by its id: nobody can go on with it, and what was played with it counts."""
    from humanplay.series.evaluation import CardList

    with study_errors():
        CardList(folder).revoke(name, ident)
    echo(f"revoked: {ident}")
