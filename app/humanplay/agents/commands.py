"""The command `humanplay agents`: evaluations of agents on secret instances.

It issues cards to authors and signs receipts.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.cli.options import DATABASE_AND_STUDIES
from humanplay.cli.settings import config_of, failures, study_errors, task_name
from humanplay.command.console import print_table, progress
from humanplay.command.options import KEY, PATH, SizeType, flag, path_option

if TYPE_CHECKING:
    from humanplay.agents.evaluation import Evaluation
    from humanplay.study.folder import Folder


@click.group(short_help="Evaluate agents on instances that stay secret, with signed receipts.")
def agents() -> None:
    """Let agents play the terrains that people played, unseen, and sign the results.

    An evaluation lies in the database, and a server on that database serves it. Authors of agents
    play by cards, one for each author; no score is told before the evaluation closes, which
    publishes everything.

    \b
    Examples:
      humanplay study close pilot --keep-secret
      humanplay agents new pilot-agents --of pilot --sees picture
      humanplay agents card pilot-agents --author "Ann Lee"       the address for her agent
      humanplay serve
      humanplay agents close pilot-agents
      humanplay agents verify receipt.json --opening opening.json
    """


@agents.command(short_help="Begin an evaluation: fix what is played, and draw the secret.")
@argument("name")
@option("--of", "study", metavar="STUDY", help="The study whose ranked terrains are played.")
@option("--task", "task", metavar="ID", help="An environment, on instances of its own; mars too.")
@option("--level", help="With --task mars.  [default: random]")
@option("--size", type=SizeType(), help="With --task mars.  [default: 21]")
@option("--instances", default=30, help="With --task: how many.")
@option(
    "--sees",
    type=click.Choice(["picture", "observation", "both"]),
    default="both",
    help="What agents are shown: what people see, what policies are given, or both.",
)
@option("--hours", default=168.0, help="From a card's first attempt until the card is closed.")
@option("--minutes", type=float, help="Until an attempt is abandoned.  [default: no limit]")
@option("--calls", default=20_000, help="Calls that a card may make, for each instance.")
@DATABASE_AND_STUDIES
def new(
    name: str,
    study: str | None,
    task: str | None,
    level: str | None,
    size: int | tuple[int, int] | None,
    instances: int,
    folder: Folder,
    database: Path,
    **limits: Any,
) -> None:
    """Fix an evaluation for good, and print its hash and its commitment.

    Publish them before any agent plays.

    With --of the instances are the ranked terrains of that study, as long as they are secret: while
    it is open, or closed with --keep-secret. The secret of instances of its own is in the database:
    keep it to yourself.

    \b
    Examples:
      humanplay agents new pilot-agents --of pilot
      humanplay agents new lake-agents --task FrozenLake-v1 --instances 50 --sees observation
    """
    from humanplay.agents.evaluation import begin_evaluation
    from humanplay.study.files import now_ms

    if (study is None) == (task is None):
        raise UsageError("expected either --of STUDY or --task ID")
    wanted = {"name": name, **limits}
    if task is None:
        wanted["study"] = study
    else:
        task_id = task_name(task)
        config = config_of(task_id, level, size)
        wanted |= {"task": task_id, "config": config.to_dict(), "instances": instances}
    with failures(f"cannot write {database}"), study_errors():
        begun = begin_evaluation(database, folder, wanted, now_ms())
    echo(f"The evaluation {name!r} is open.\n{_hashes(begun)}")
    echo(f"`humanplay agents card {name} --author NAME` makes an address for an agent")


@agents.command(short_help="Issue a card to the author of an agent.")
@argument("name")
@option("--author", required=True, help="Who answers for the agent: a person or a group.")
@option("--base", default="http://127.0.0.1:8000", help="The server's address.")
@DATABASE_AND_STUDIES
def card(name: str, author: str, base: str, folder: Folder, database: Path) -> None:
    """Issue a card and print its address.

    Whoever has the address plays with the card, once at each instance.

    A further card of an author is numbered, its receipt says that it has seen these instances, and
    it never ranks.

    \b
    Examples:
      humanplay agents card pilot-agents --author "Ann Lee" --base https://mars.example.org
    """
    from humanplay.agents.evaluation import changing, find_evaluation, issue_card
    from humanplay.study.files import now_ms

    with failures(f"cannot write {database}"), study_errors(), changing(database) as conn:
        evaluation = find_evaluation(conn, folder, name)
        issued = issue_card(conn, evaluation, author, now_ms())
    if issued.note is not None:
        echo(issued.note, err=True)
    echo(evaluation.link(issued.id, base))


@agents.command(short_help="List the evaluations, or show one and its cards.")
@argument("name", required=False)
@DATABASE_AND_STUDIES
def show(name: str | None, folder: Folder, database: Path) -> None:
    """Print every evaluation, or of one what was fixed and its cards.

    The secret of an open one and the addresses of cards are never printed.
    """
    from humanplay.agents.evaluation import cards_of, evaluations, find_evaluation, looking
    from humanplay.study.files import iso

    with failures(f"cannot read {database}"), study_errors(), looking(database) as conn:
        listed = [find_evaluation(conn, folder, name)] if name else evaluations(conn, folder)
        cards = cards_of(conn, name) if name else []
    if not listed:
        echo(f"no evaluations in {database}; `humanplay agents new NAME` begins one")
    elif name is None:
        rows = []
        for evaluation in listed:
            protocol = evaluation.protocol
            played = protocol.study.name if protocol.study else protocol.task
            rows.append((evaluation.name, _status(evaluation), str(protocol.instances), played))
        print_table("Evaluations", ("name", "status", "instances", "of"), rows)
    else:
        (evaluation,) = listed
        protocol = evaluation.protocol
        whose = f"ranked terrains of {protocol.study.name}" if protocol.study else protocol.task
        echo(f"{name}: {_status(evaluation)}, {protocol.instances} instances: {whose}")
        limits = f"{protocol.hours:g} hours a card, {protocol.calls} calls an instance"
        echo(f"agents see {protocol.sees}; {limits}\n{_hashes(evaluation)}")
        issued = [
            (
                card.id,
                card.author,
                str(card.number),
                iso(card.issued_ms),
                iso(card.revoked_ms) if card.revoked_ms else "",
            )
            for card in cards
        ]
        if issued:
            print_table("Cards", ("id", "author", "number", "issued", "revoked"), issued)


@agents.command(short_help="Take a card back.")
@argument("name")
@argument("ident", metavar="CARD")
@DATABASE_AND_STUDIES
def revoke(name: str, ident: str, folder: Folder, database: Path) -> None:
    """Take a card back by its id.

    Nobody can go on with it, and what was played with it counts.
    """
    from humanplay.agents.evaluation import changing, find_card, find_evaluation
    from humanplay.study.files import now_ms

    with failures(f"cannot write {database}"), study_errors(), changing(database) as conn:
        find_card(conn, find_evaluation(conn, folder, name).name, ident)
        sql = "UPDATE agents_cards SET revoked_ms = coalesce(revoked_ms, ?) WHERE id = ?"
        conn.execute(sql, (now_ms(), ident))
    echo(f"revoked: {ident}")


@agents.command(short_help="Erase a card, with all that was played with it.")
@argument("name")
@argument("ident", metavar="CARD")
@flag("--yes", "Do not ask.")
@DATABASE_AND_STUDIES
def forget(name: str, ident: str, yes: bool, folder: Folder, database: Path) -> None:
    """Erase a card by its id, with its author and all that was played, for good.

    Of a closed evaluation, `humanplay agents close` then writes the files again without it.
    """
    from humanplay.agents.evaluation import changing, find_card, find_evaluation, forget_card

    if not yes:
        click.confirm(f"Erase the card {ident} of {name} for good?", abort=True, err=True)
    with failures(f"cannot write {database}"), study_errors(), changing(database) as conn:
        find_card(conn, find_evaluation(conn, folder, name).name, ident)
        forget_card(conn, ident)
    echo(f"erased: {ident}")


@agents.command(short_help="End an evaluation, reveal its instances, and sign the receipts.")
@argument("name")
@flag("--yes", "Do not ask.")
@flag("--now", "Close it also while an agent is at it.")
@DATABASE_AND_STUDIES
def close(name: str, yes: bool, now: bool, folder: Folder, database: Path) -> None:
    """End an evaluation, reveal its instances, and give every card its receipt.

    Attempts that run are abandoned and count.

    The secret of the study whose terrains were played is revealed too. Receipts and the opening are
    signed by the server's key and are to be had on the evaluation's page; called again, it writes
    them again.
    """
    from humanplay.agents.closing import check_closable, close_evaluation, reveal_study
    from humanplay.agents.evaluation import find_evaluation, looking, published_folder
    from humanplay.agents.receipts import publish

    with failures(f"cannot close {name!r}"), study_errors(), _policy_errors():
        with looking(database) as conn:
            evaluation = find_evaluation(conn, folder, name)
        check_closable(database, evaluation, now)  # where it cannot be signed nothing is closed
    if evaluation.closed_ms is None and not yes:
        click.confirm(
            f"Close the evaluation {name!r} for ever? What agents have not finished counts as it stands",
            abort=True,
        )
    with failures(f"cannot close {name!r}"), study_errors(), _policy_errors():
        close_evaluation(database, folder, name)
        reveal_study(database, folder, evaluation)
        receipts = publish(database, folder, name, progress)
    echo(f"The evaluation {name!r} is closed: {len(receipts)} receipts and the opening")
    echo(f"are in {published_folder(database, name)}")


@agents.command(short_help="Check a receipt, without the server.")
@argument("receipt", type=PATH)
@path_option("--opening", "The evaluation's opening: simulate every episode again.", metavar="FILE")
@KEY
@option("--card", "ident", metavar="ID", help="The card that it must be of.")
@option("--evaluation", "of", metavar="NAME|HASH", help="The evaluation that it must be of.")
def verify(
    receipt: Path, opening: Path | None, key: str | None, ident: str | None, of: str | None
) -> int:
    """Check a receipt's signature and chain; with the opening all that it says.

    With --opening the commitments are checked, and every episode is simulated again. Exit code 1
    where anything differs. A valid signature says who wrote the receipt only as far as the key is
    known: give the fingerprint that the server's operator published with --key.

    \b
    Examples:
      humanplay agents verify 7K3M.json --key 15f592c2...
      humanplay agents verify 7K3M.json --opening opening.json --card 7K3M
    """
    from humanplay.agents import receipts
    from humanplay.db.resimulation import Finding
    from humanplay.release import signing

    with failures("cannot read {file}"):
        content = receipts.read_signed(receipt, receipts.RECEIPT_FORMAT)
        findings = list(receipts.check_receipt(content, ident, of))
        if opening is not None:
            opened = receipts.read_signed(opening, receipts.OPENING_FORMAT)
            findings += receipts.check_opened(content, opened)
        signer = signing.fingerprint(content["public_key"].encode())
        wanted = None if key is None else signing.fingerprint_of(key)
    if wanted is not None and wanted != signer:
        findings.append(Finding("receipt", "the signing key", signer, wanted))
    for finding in findings:
        echo(str(finding))
    if not findings:
        echo(receipts.description(content))
        echo(signing.SignerCheck(signer, "key" if wanted else None).sentence())
    simulated = (
        "every episode simulated again" if opening else "no episode simulated without --opening"
    )
    echo(f"{len(findings) or 'nothing'} wrong; {simulated}")
    return 1 if findings else 0


@contextmanager
def _policy_errors() -> Iterator[None]:
    """Turn a policy that cannot be played into its sentence."""
    from humanplay.task import PolicyError

    try:
        yield
    except PolicyError as error:
        raise ClickException(str(error)) from error


def _status(evaluation: Evaluation) -> str:
    return "open" if evaluation.closed_ms is None else "closed"


def _hashes(evaluation: Evaluation) -> str:
    protocol = evaluation.protocol
    lines = [f"protocol hash  {protocol.hash}", f"commitment     {evaluation.commitment}"]
    if protocol.study is not None:
        lines.append(f"commitment of the study {protocol.study.name}  {protocol.study.commitment}")
    return "\n".join(lines)
