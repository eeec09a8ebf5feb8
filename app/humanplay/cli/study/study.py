"""The command `humanplay study`: plan a study, freeze it, preregister it, say who may take part, and close it."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import click
from click import ClickException, UsageError, argument, echo, option

from humanplay.cli.options import DATABASE_AND_STUDIES, STUDIES
from humanplay.cli.settings import config_of, failures, place, study_errors, task_name
from humanplay.command.console import print_table, progress, write_file
from humanplay.command.options import SizeType, flag, path_option, several
from humanplay.study.platforms import PLATFORMS
from humanplay.study.shipped_questions import BLOCKS
from humanplay.task import counted
from humanplay.task.registration import DEFAULT_TASK

if TYPE_CHECKING:
    from humanplay.db.chain import Act
    from humanplay.report.statistics.planning import StudyDesign
    from humanplay.study.folder import Folder, Study
    from humanplay.study.invitations import Use
    from humanplay.study.protocol import Protocol


NOTED_S = 10
"""Seconds that a server may take to note that a study was closed."""


@click.group(short_help="Plan, freeze and close a study of how well people play.")
def study() -> None:
    """Plan a study, freeze its protocol, and close it when everybody has played.

    A frozen protocol cannot change any more: its hash and a commitment to the secret that fixes every terrain are
    published before the first participant joins; closing reveals the secret, so that anybody can check both.
    A study lies in the folder beside its database, of lab.db in lab.db-studies. --database or HUMANPLAY_DATABASE names the
    database; without them it is data/playground.db in a checkout, ./playground.db elsewhere.

    \b
    Examples:
      humanplay study new pilot --players 10
      humanplay study freeze pilot         prints its power and what participants will read
      humanplay study preregister pilot --out pilot.md
      humanplay study invite pilot 10      ten links, each for one person
      humanplay serve
      humanplay study close pilot
    """


@study.command(short_help="Begin a study: write its protocol as a draft.")
@argument("name")
@option("--title", help="What participants read at the top.")
@option(
    "--env",
    "task",
    metavar="ENV",
    help="Another environment, written as for serve; the server needs the same --env.  [default: MarsExplorer]",
)
@option("--level", help="random, t-m-b from 1-1-1 to 3-2-2, building or cave.  [default: random]")
@option("--size", type=SizeType(), help="21 for a square, 42x84 for rows x columns.  [default: 21]")
@option("--warm-up", default=15, help="Episodes that do not count, before the others.")
@option("--ranked", default=30, help="Episodes that count.")
@option("--players", default=10, help="Participants planned.")
@option(
    "--primary-metric",
    type=click.Choice(["steps", "score"]),
    default="steps",
    help="In which policies are tested against people.",
)
@option(
    "--recruitment", type=click.Choice(["invitation", "panel", "open"]),
    help="Who may take part: holders of single-use links, people whom a site sends with an id of theirs, or everybody.  "
    "[default: panel with a platform, else invitation]",
)  # fmt: skip
@option(
    "--panel-links", type=click.Choice(["unsigned", "signed"]), default="unsigned",
    help="Of a panel: signed lets in only whom `study invite --ids` made a link for.",
)  # fmt: skip
@option("--break-every", default=10, help="Ranked episodes after which a break is offered.")
@several(
    "--outside-id",
    "outside_ids",
    "A parameter of the link to keep; the first names the person. Repeatable.  [default: the platform's]",
)
@option(
    "--platform", type=click.Choice(list(PLATFORMS)), default="code",
    help="Where people come from, with recruitment panel; code: from nowhere, each gets a code of their own.",
)  # fmt: skip
@several(
    "--ask",
    "blocks",
    f"A shipped block of questions about people; repeatable: {', '.join(BLOCKS)}.",
)
@several("--policy", "policies", "To compare with people; repeatable.  [default: the shipped ones]")
@path_option(
    "--declarations",
    "declared",
    "JSON object of what only you know, as examples/declarations.json.  [default: asks on a terminal]",
    metavar="FILE",
)
@STUDIES
def new(
    name: str,
    task: str | None,
    level: str | None,
    size: int | tuple[int, int] | None,
    declared: Path | None,
    folder: Folder,
    **options: object,
) -> None:
    """Write a study's protocol.json, a draft to read and edit before it is frozen.

    The defaults are those of the paper (section 3.2). Consent text, questions, exclusion rules and what the power rests on
    are in the file, and docs/study.md explains each. Texts name the protocol's numbers in braces, such
    as {ranked}; freezing fills them in. The policies are played on 200 terrains that are not the study's, and the difference
    that the study is to see is one that this many players can see.

    What only you know (population, payment, ethics review ...) is asked for on a terminal, or read from --declarations; what is
    left empty must be written into the file before the study is frozen. Beside it stand a text to recruit with and a checklist.

    \b
    Examples:
      humanplay study new koutras2021
      humanplay study new pilot
      humanplay study new hard --level 3-2-1 --size 42x42 --warm-up 5 --ranked 20 --players 16
      humanplay study new lake --env FrozenLake-v1
      humanplay study new online --platform prolific --ask demographics --ask nasa-tlx
    """
    from humanplay.study import texts
    from humanplay.study.files import read_object
    from humanplay.study.protocol import Declarations, StudyError, default_protocol, parse_protocol
    from humanplay.study.templates import filled

    name_of_task = DEFAULT_TASK if task is None else task_name(task)
    config = config_of(name_of_task, level, size)
    options["recruitment"] = options["recruitment"] or (
        "invitation" if options["platform"] == "code" else "panel"
    )
    rest = {field: value for field, value in options.items() if value is not None and value != ()}
    with study_errors():
        folder.path(name)
        if declared is not None:
            answers = read_object(declared)
            if unknown := sorted(answers.keys() - Declarations.model_fields):
                fields = ", ".join(Declarations.model_fields)
                raise StudyError(f"{declared} declares {unknown[0]!r}, which is none of {fields}")
            rest["declarations"] = answers
        protocol = default_protocol(name, config, name_of_task, **rest)
        planned = _planned(protocol, folder)
        protocol = parse_protocol(
            {**protocol.model_dump(mode="json", exclude_unset=True), **planned}
        )
        if declared is None and sys.stdin.isatty():
            answers = {"declarations": _asked()}
            set_so_far = protocol.model_dump(mode="json", exclude_unset=True)
            protocol = parse_protocol({**set_so_far, **answers})
        path = folder.create(protocol)
    for file, text in (("recruitment.txt", texts.RECRUITMENT), ("checklist.md", texts.CHECKLIST)):
        write_file(path.with_name(file), filled(text, protocol).encode())
    rehearsed = dict.fromkeys(Declarations.model_fields, "none: this is a rehearsal")
    write_file(path.with_name("rehearsal.json"), json.dumps(rehearsed, indent=1).encode())
    _echo_power(_with_power(protocol))
    if unanswered := protocol.declarations.unanswered():
        echo(f"Freezing needs what only you know, as declarations: {', '.join(unanswered)}")
    echo(f"{path.with_name('recruitment.txt')}: what to ask people with")
    echo(f"{path.with_name('checklist.md')}: what to do, from here to the figure")
    echo(f"{path}: read it, edit it, then `humanplay study freeze {name}`")


@study.command("dry-run", short_help="Begin a dry run of a study, by people.")
@argument("name")
@STUDIES
def dry_run(name: str, folder: Folder) -> None:
    """Write a draft like a study's, marked as a dry run of it.

    Freeze it, and let people play it. It has instances of its own, its figures are seen at once, and it can never be
    released. The study's report says how many dry runs there were in the same database, and with how many people.

    \b
    Example:
      humanplay study dry-run pilot
    """
    with study_errors():
        path = folder.begin_dry_run(name)
    echo(f"{path}: edit it, then `humanplay study freeze {path.parent.name}`")


def _asked() -> dict[str, str]:
    """Ask for each declaration and return what was typed."""
    from humanplay.study.protocol import Declarations

    echo(
        'The report will say what only you know. "none" is an answer; Enter leaves one for later, before freezing.'
    )
    return {
        name: click.prompt(
            f"{name}: {field.description}\n", default="", show_default=False, prompt_suffix="> "
        )
        for name, field in Declarations.model_fields.items()
    }


@study.command(short_help="Fix the protocol and draw the secret.")
@argument("name")
@flag(
    "--underpowered", "Freeze although the planned difference is seen in less than 50 % of studies."
)
@path_option(
    "--exclude-ids",
    "excluded",
    "Participant IDs, one a line, of people of pilots who are not to take part.",
    metavar="FILE",
)
@DATABASE_AND_STUDIES
def freeze(
    name: str, underpowered: bool, excluded: Path | None, folder: Folder, database: Path
) -> None:
    """Fix a study's protocol for good, draw its secret, and print what participants will read and what to publish.

    Placeholders in its texts are filled in. The power is simulated, printed and fixed with the protocol, and a study that
    would see its planned difference in fewer than half of all cases is refused. The file of each network that people are
    compared with is kept with the study, so that its report plays the same network for ever.

    Publish hash and commitment before anybody plays (in a preregistration, say): they prove later that neither the
    protocol nor a terrain was chosen afterwards. Keep a copy of the study's folder; whoever reads the file `secret`
    knows every terrain.
    """
    from humanplay.report.statistics.planning import AT_FREEZING
    from humanplay.study.cautions import cautions_of
    from humanplay.study.folder import BEGINNINGS, beginnings
    from humanplay.study.kept_out import keep_out
    from humanplay.study.places import cap_in_words
    from humanplay.study.protocol import PLANNED

    _check_database(database)
    idents = [] if excluded is None else _lines(excluded)
    with study_errors():
        draft = folder.filled(name)
        if excluded is not None and not draft.outside_ids:
            raise UsageError(
                f"the study {name!r} has no outside_ids, so that nobody is known by an ID: leave --exclude-ids out, or name "
                "the parameter of its links that holds one"
            )
        draft = draft.model_copy(update=_planned(draft, folder))
    protocol = _with_power(draft, AT_FREEZING)
    if not underpowered and protocol.dry_run_of is None:
        _check_power(protocol)
    planned = {field: getattr(protocol, field) for field in PLANNED}
    found = frozen(name, folder, database, planned)
    if idents:
        with study_errors():
            count = keep_out(folder.path(name), idents)
        people = counted(count, "person of a pilot is", "people of pilots are")
        echo(f"{people} kept out, by keyed hashes of their IDs, until the study is closed")
    if found.examined:
        echo(f"{found.examined[0].upper()}{found.examined[1:]}")
    echo(f"What participants read and agree to:\n\n{found.protocol.consent.text}\n")
    _echo_power(found.protocol)
    for policy, digest in found.protocol.policy_hashes.items():
        echo(f"The file of the policy {policy} is kept with the study: SHA-256 {digest}")
    if (looks := beginnings(found.protocol)) <= BEGINNINGS // 2:
        echo(
            f"Caution: of {BEGINNINGS} seeds only {looks} look{'s' * (looks == 1)} different at the start, so that "
            "whoever has played some instances may know the others"
        )
    if math.isinf(found.protocol.environment.bounds(found.protocol.env_config)[0]):
        echo(
            "Caution: no lowest score is declared (`bounds` of the environment's file): there is no mean score of everybody "
            "who began, nobody who gives up is in the per-protocol estimate, and no difference in score is tested"
        )
    if limit := cap_in_words(found.protocol):
        echo(limit)
    for sentence in cautions_of(found.protocol):
        echo(f"Caution: {sentence}")
    echo(f"The study {name!r} is frozen. Publish this line before anybody plays:\n{hashes(found)}")
    echo(f"A running server offers it at once, at /study/{name}")
    if found.protocol.recruitment == "invitation":
        invite = f"humanplay study invite {name} {found.protocol.players}"
        echo(f"It is by invitation: `{invite}` makes the links")
    if query := PLATFORMS[found.protocol.platform].query:
        echo(f"The address to give to the platform ends with /study/{name}{query}")
    if found.protocol.panel_links == "signed":
        echo(f"Links are signed: `humanplay study invite {name} --ids FILE` makes them")


def frozen(
    name: str,
    folder: Folder,
    database: Path,
    planned: Mapping[str, object] = MappingProxyType({}),
) -> Study:
    """Freeze a study, note it in the chain of the database, say so, and return it.

    planned  as of `Folder.freeze`
    """
    from humanplay.release.rehearsal import rehearse

    _check_database(database)
    with study_errors(), progress("drawing the instances") as advance:
        study = folder.freeze(name, advance, planned=planned, rehearse=rehearse)
    said = f"An entry of the chain of {database} says so"
    later = f"There is no database {database} yet: the server that makes it notes this in its chain"
    echo(said if _note_freezing(study, database) else later)
    return study


def hashes(study: Study) -> str:
    """The line to publish, with the hashes of the protocol and of the secret."""
    return f"{study.name}: protocol {study.protocol_hash}, secret {study.commitment} (SHA-256)"


def _check_database(database: Path) -> None:
    """Refuse a database that is not ours before a study is changed that it must note."""
    from humanplay.db.database import reading

    if database.exists():
        with failures(f"cannot read {database}"), reading(database):
            pass


def _note_freezing(study: Study, database: Path) -> bool:
    """Append the freezing to the chain of the database, and return whether there is one; a server may run."""
    from humanplay.db.chain import append_marks, freezing_of
    from humanplay.db.database import writing

    if not database.exists():  # a server notes it when it starts
        return False
    with (
        failures(f"the study {study.name!r} is as asked, but its entry in the chain is missing"),
        writing(database) as conn,
    ):
        append_marks(conn, [freezing_of(study.row())])
    return True


@study.command(short_help="End the study and reveal its secret.")
@argument("name")
@flag("--yes", "Do not ask.")
@flag("--now", "Close it also while somebody is at it.")
@flag("--keep-secret", "Keep the secret behind its instances.")
@DATABASE_AND_STUDIES
def close(
    name: str, yes: bool, now: bool, keep_secret: bool, folder: Folder, database: Path
) -> None:
    """End a study: nobody can join or go on, and the secret behind its terrains is revealed.

    With --keep-secret nobody can join or go on either, and the secret is kept until the study is closed again without it. Till
    then debrief, report, costs, replays, exports and release show nothing of its terrains, so that others can play them unseen.

    Episodes that are open are abandoned. While somebody has moved within the last ten minutes nothing is closed without --now;
    with it they count as interrupted. There is no way back: whoever knows the secret knows every terrain. A running server
    sees it at once.
    """
    question = f"Close the study {name!r} for ever? Participants on their way cannot finish"
    found = closed(name, None if yes else question, now, keep_secret, folder, database)
    if found.is_open:
        echo(
            f"The study {name!r} is closed, its secret kept; `humanplay study close {name}` reveals it"
        )
    else:
        echo(f"The study {name!r} is closed.\nsecret  {found.secret.hex()}")


def closed(
    name: str, question: str | None, now: bool, keeps_secret: bool, folder: Folder, database: Path
) -> Study:
    """Close a study, have it noted in the database, and return it.

    question  what is asked before an open one is closed; None: nothing is
    """
    from humanplay.db.reader import Reader, now_ms
    from humanplay.study.closing import check_nobody_is_at_it, close_study

    with failures(f"cannot close {name!r}"), study_errors(), ExitStack() as stack:
        folder.study(name)
        has_file = database.exists()
        reader = stack.enter_context(closing(Reader.open(database))) if has_file else None
        if folder.status(name) == "open" and question is not None:
            folder.check_closable(name, keeps_secret)
            if not now:
                check_nobody_is_at_it(folder, reader, name, now_ms())
            _confirm(question, "closed")
        study = close_study(folder, reader, name, now_ms(), now, keeps_secret)
    if not _note_in_database(study, database):
        echo(
            f"{database} is in use, and its server has not taken note yet: it does so at its next start at the latest, and "
            "no report or release is made while episodes of the study are open"
        )
    return study


def _confirm(question: str, done: str) -> None:
    """Ask a question; anything but yes ends the command, and where nobody can answer it says how to go without asking."""
    try:
        click.confirm(question, abort=True)
    except click.Abort:
        if sys.stdin.isatty():
            raise
        why = f"nothing was {done}: the answer was not yes; --yes does without asking"
        raise ClickException(why) from None


def _note_in_database(study: Study, database: Path) -> bool:
    """Note the end in the database, and return whether it is there; a server that has it open is given some seconds."""
    if not database.exists():
        return True
    from humanplay.db.reader import Reader
    from humanplay.db.series import find_study
    from humanplay.db.store import Store, StoreError
    from humanplay.study.closing import note_closed, unnoted_ms

    with suppress(StoreError), closing(Store(database)) as store:
        note_closed(store, study)
    for _ in range(NOTED_S * 10):
        with closing(Reader.open(database)) as reader:
            row = find_study(reader, study.name)
        if unnoted_ms(study, row) is None:
            return True
        time.sleep(0.1)
    return False


@study.command(short_help="Show a study's protocol and state.")
@argument("name")
@STUDIES
def show(name: str, folder: Folder) -> None:
    """Print how far a study is, its protocol, and what freezing fixed; never the secret of an open study.

    The texts of a draft are shown as participants would read them, with every placeholder filled in.
    """
    from humanplay.study.templates import fill

    with study_errors():
        status, protocol = folder.status(name), folder.draft(name)
        protocol = fill(protocol) if status == "draft" else protocol
        found = None if status == "draft" else folder.study(name)
    echo(f"{name}: {status}, {folder.path(name)}")
    if found is not None:
        echo(hashes(found))
        if not found.is_open:
            echo(f"secret         {found.secret.hex()}")
    echo(json.dumps(protocol.model_dump(mode="json"), indent=2, ensure_ascii=False))


@study.command(short_help="What a study still lacks, and cautions.")
@argument("name")
@STUDIES
def check(name: str, folder: Folder) -> None:
    """Print what a draft still lacks, how many people may agree, and cautions.

    \b
    Example:
      humanplay study check pilot
    """
    from humanplay.study.cautions import cautions_of
    from humanplay.study.places import cap_in_words

    with study_errors():
        protocol = folder.draft(name)
    notes = [f"Caution: {sentence}" for sentence in cautions_of(protocol)]
    if unanswered := protocol.declarations.unanswered():
        notes.insert(
            0, f"Freezing needs what only you know, as declarations: {', '.join(unanswered)}"
        )
    if limit := cap_in_words(protocol):
        echo(limit)
    for note in notes or [f"Nothing of what is checked speaks against {name!r}"]:
        echo(note)


@study.command("list", short_help="List all studies.")
@STUDIES
def list_(folder: Folder) -> None:
    """Print every study in the folder with its state."""
    rows = []
    for name in folder.names():
        with study_errors():
            protocol = folder.draft(name)
        plan = f"{protocol.players} x ({protocol.warm_up} + {protocol.ranked})"
        rows.append((name, folder.status(name), plan, protocol.title))
    if not rows:
        echo(f"no studies in {folder.root}; `humanplay study new NAME` begins one")
        return
    print_table("Studies", ("name", "status", "players x episodes", "title"), rows)


@study.command(short_help="What a study can see, and with how many players.")
@argument("name")
@option("--players", type=click.IntRange(1), help="In place of the protocol's.")
@option("--ranked", type=click.IntRange(1), help="Ranked episodes, in place of the protocol's.")
@option(
    "--difference",
    type=float,
    help="In place of the protocol's policy_difference, or arm_difference if arms are tested.",
)
@option("--pilot", metavar="STUDY", help="Take the assumptions about people from a closed study.")
@DATABASE_AND_STUDIES
def power(
    name: str,
    players: int | None,
    ranked: int | None,
    difference: float | None,
    pilot: str | None,
    database: Path,
    folder: Folder,
) -> None:
    """Simulate studies by a protocol's assumptions, and print how many see its planned difference.

    The studies are analysed by the report's own functions. Nothing is written: put what suits into protocol.json.

    \b
    Examples:
      humanplay study power pilot
      humanplay study power pilot --players 30 --difference 20
      humanplay study power main --pilot pilot
    """
    from humanplay.study.policy_episodes import tested_policies
    from humanplay.study.protocol import parse_protocol

    with study_errors():
        protocol = folder.draft(name)
        changes: dict[str, float] = {}
        if pilot is not None:
            changes = _assumptions_from(pilot, protocol, database)
        planned = "arm_difference" if protocol.primary_family == "arms" else "policy_difference"
        options = {"players": players, "ranked": ranked, planned: difference}
        changes |= {field: value for field, value in options.items() if value is not None}
        changed = {**protocol.model_dump(mode="json", exclude_unset=True), **changes}
        protocol = parse_protocol(changed)
        protocol = protocol.model_copy(update=_planned(protocol, folder))
    _echo_power(_with_power(protocol))
    has_difference = protocol.policy_difference is not None and tested_policies(protocol)
    if has_difference or protocol.primary_family == "arms":
        echo(f"To see more: {'; or '.join(_ways(protocol))}")


def _assumptions_from(name: str, protocol: Protocol, database: Path) -> dict[str, float]:
    """What a closed study shows of people; UsageError where the database has none that does."""
    from humanplay.report.statistics.planning import assumptions_from
    from humanplay.study.data import load

    with failures(f"cannot read {database}"), study_errors():
        data = load(database, name)
    try:
        return assumptions_from(data, protocol)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _planned(protocol: Protocol, folder: Folder) -> dict[str, float | None]:
    """The assumptions and the difference of a protocol, filled in where it leaves them empty."""
    from humanplay.report.statistics.planning import reachable_difference
    from humanplay.study.policy_episodes import tested_policies
    from humanplay.study.terrain_spread import terrain_sd

    assumed = dict(protocol.environment.assumed(protocol.env_config, protocol.primary_metric))
    fields: dict[str, float | None] = {
        name: number for name, number in assumed.items() if getattr(protocol, name) is None
    }
    if protocol.assumed_terrain_sd is None and tested_policies(protocol):
        with progress("playing the policies on 200 instances that are not the study's") as advance:
            spread = terrain_sd(protocol, folder.root, advance)
        fields["assumed_terrain_sd"] = float(f"{spread:.3g}")
    protocol = protocol.model_copy(update=fields)
    if protocol.policy_difference is None and tested_policies(protocol):
        design = _design(protocol)
        with progress("looking for the difference that so many players see"):
            fields["policy_difference"], _ = reachable_difference(design)
    return fields


def _with_power(protocol: Protocol, studies: int | None = None) -> Protocol:
    """The protocol with its power, by so many simulated studies; without one where nothing is assumed."""
    from humanplay.report.statistics.planning import WHILE_TYPING, power_of
    from humanplay.study.policy_episodes import tested_policies

    tests_something = tested_policies(protocol) or protocol.primary_family == "arms"
    if protocol.assumed_mean is None and not tests_something:
        return protocol
    with progress("simulating studies") as advance:
        _design(protocol)
        power = power_of(protocol, studies or WHILE_TYPING, advance)
    return protocol.model_copy(update={"power": power})


def _design(protocol: Protocol) -> StudyDesign:
    """The design of a protocol; UsageError where an assumption is missing."""
    from humanplay.report.statistics.planning import design_of

    try:
        return design_of(protocol)
    except ValueError as error:
        raise UsageError(str(error)) from error


@study.command(short_help="Print single-use links to a study.")
@argument("name")
@argument("count", type=int, metavar="[N]", default=0)
@option(
    "--url",
    help="The address at which participants reach the server.  [default: HUMANPLAY_PUBLIC_URL, else a guess that says so]",
)
@option("--arm", help="To which whoever comes with one is assigned, in place of by chance.")
@flag("--list", "lists", "List all invitations with their state instead.")
@path_option(
    "--ids",
    "panel",
    "A panel's ids, one a line: print a signed link for each, where panel_links is signed.",
    metavar="FILE",
)
@path_option(
    "--csv",
    "table",
    "Write them to a file, with links: id, state, participant, arm, link.",
    metavar="FILE",
)
@DATABASE_AND_STUDIES
def invite(
    name: str,
    count: int,
    url: str | None,
    arm: str | None,
    lists: bool,
    panel: Path | None,
    table: Path | None,
    database: Path,
    folder: Folder,
) -> None:
    """Print N single-use links to a study whose recruitment is by invitation.

    A link is used up when somebody agrees to the consent text, not when it is opened. Send each person one; whoever has a
    link can take part with it. The links are listed in the study's folder by their ids, never by their tokens; --list shows
    ids and states, and with --csv the links once more. A running server knows new links at once.

    With --arm whoever comes with one of them is not assigned by chance: the release says "operator" of each, and the report
    how many they are.

    \b
    Examples:
      humanplay study invite pilot 10 --url https://lab.example.org
      humanplay study invite pilot --list
      humanplay study invite pilot --list --csv links.csv
    """
    from humanplay.study.invitations import Invitations, link_of, state_of
    from humanplay.study.recruitment import panel_link

    if [count > 0, lists, panel is not None].count(True) != 1:
        wanted = "the number of links to make, such as 10, --list to see all, or --ids FILE"
        raise UsageError(f"expected {wanted}")
    if arm is not None and count == 0:
        raise UsageError("--arm goes with the number of links to make, not with --list or --ids")
    server = place()
    public_url = url or server.public_url
    base = public_url or f"http://{server.host}:{server.port}"
    invitations = Invitations(folder)
    chosen, rows, links = [], [], []
    uses = _uses(database, name)
    with study_errors():
        study = folder.study(name)
        if panel is not None:
            rows = [(value, "signed", "", "") for value in _lines(panel)]
            links = [panel_link(study, value, base) for value, *_ in rows]
        else:
            chosen = (
                list(invitations.of(name).values())
                if lists
                else invitations.issue(name, count, arm)
            )
    for invitation in chosen:
        use = uses.get(invitation.id)
        label = use.label if use else ""
        rows.append((invitation.id, state_of(invitation, use), label, invitation.arm or ""))
        links.append(link_of(study, invitation.id, base))
    if public_url is None and (table is not None or not lists):
        way_out = (
            "give --url, or HUMANPLAY_PUBLIC_URL as for the server, if people reach it elsewhere"
        )
        echo(f"{base} is a guess: {way_out}", err=True)
    if not lists:
        echo("\n".join(links))
    elif not chosen:
        way_out = f"`humanplay study invite {name} 10` makes ten links"
        echo(f"nobody has been invited to {name}; {way_out}")
    else:
        issued = [_day(invitation.issued_ms) for invitation in chosen]
        printed = [(*row, day) for row, day in zip(rows, issued, strict=True)]
        heads = ("id", "state", "participant", "arm", "issued (UTC)")
        print_table(f"Invitations to {name}", heads, printed)
    if table is not None:  # last: links that were issued are told whatever becomes of the file
        _write_csv(table, [(*row, link) for row, link in zip(rows, links, strict=True)])


@study.command(short_help="What people read at their end: codes, addresses, sentences.")
@argument("name")
@argument("texts", nargs=-1, metavar="[OUTCOME=TEXT]...")
@DATABASE_AND_STUDIES
def outcomes(name: str, texts: tuple[str, ...], folder: Folder, database: Path) -> None:
    """Print, or change, what people read at each outcome: a code (one word), an address (http...) or a sentence.

    These texts lie beside the study's secret, are in no protocol, report or release, and may change while people come: a
    running server shows new ones at once, and an entry of the chain says that they changed, without the texts. An empty text
    takes one away. In an address {survey_code}, say, becomes the participant's ID; {code} is the code that is drawn for each
    person where the platform is code.

    \b
    Examples:
      humanplay study outcomes pilot
      humanplay study outcomes pilot finished=C1A2B3C4 "withdrew=Please return your submission on Prolific."
      humanplay study outcomes class "finished=https://school.sona-systems.com/webstudy_credit.aspx?...&survey_code={survey_code}"
    """
    from humanplay.study.outcome import OUTCOME_IN_WORDS
    from humanplay.study.outcomes import change_texts, read_texts

    _check_database(database)
    pairs = [text.partition("=") for text in texts]
    if wrong := [outcome for outcome, sign, _ in pairs if not sign]:
        raise UsageError(f"expected OUTCOME=TEXT, such as finished=C1A2B3C4, got {wrong[0]!r}")
    with study_errors():
        path, protocol = folder.path(name), folder.draft(name)
        is_frozen = folder.status(name) != "draft"
        changed = {outcome: text for outcome, _, text in pairs}
        shown = change_texts(path, protocol, changed, is_frozen) if pairs else read_texts(path)
        if pairs and is_frozen:
            _note_act(folder.study(name), database, "outcomes changed")
    rows = [(outcome, words, shown.get(outcome, "")) for outcome, words in OUTCOME_IN_WORDS.items()]
    print_table(f"Outcomes of {name}", ("outcome", "whoever", "reads"), rows)


@study.command(short_help="Whom to pay, and how much.")
@argument("name")
@path_option("--csv", "table", "Write the list to a file.", metavar="FILE")
@path_option("--bulk", "bulk", "Write Prolific's lines of bonuses to a file.", metavar="FILE")
@path_option(
    "--against", "exported", "Compare with the submissions that Prolific exports.", metavar="EXPORT.csv"
)  # fmt: skip
@DATABASE_AND_STUDIES
def payments(
    name: str,
    table: Path | None,
    bulk: Path | None,
    exported: Path | None,
    folder: Folder,
    database: Path,
) -> None:
    """List everybody who agreed, with what each is paid.

    A row has the identifier, the label, the outcome, its code, the minutes from consent to end, the amount with its
    currency, the share of the ranked episodes that ended, and the arm. People who have not agreed are only counted.
    Amounts are those of the protocol's `payment`; one that follows from how somebody played is listed once the study
    is closed. With bonus_at_once in the protocol it is listed earlier: then an entry of the chain says so each time,
    and the report says how often. --bulk writes the bonuses that the platform does not pay by itself, without zeros;
    --against names who claims to have finished and has not, who finished without a code, and who timed out. Files are
    readable by their owner alone.

    \b
    Examples:
      humanplay study payments pilot
      humanplay study payments pilot --csv pay.csv --bulk bulk.csv
      humanplay study payments pilot --against prolific_export.csv
    """
    from humanplay.db.reader import Reader
    from humanplay.study.outcomes import read_texts
    from humanplay.study.payments import COLUMNS, claims, payments_of

    if not database.exists():
        raise UsageError(f"no database at {database}: give its path with --database")
    text = None if exported is None else _text(exported, "with a submission on each line")
    with failures(f"cannot read {database}"), study_errors():
        found = folder.study(name)
        with closing(Reader.open(database)) as reader, reader.snapshot():
            listed = payments_of(reader, found, read_texts(folder.path(name)))
        lines = None if bulk is None else listed.bulk()
        against = None if text is None else claims(listed, text)
    if listed.shows_play and not listed.waits:
        _note_act(found, database, "amounts listed", people=listed.finished)
    if table is None and bulk is None and against is None:
        print_table(f"Payments of {name}", COLUMNS, listed.table())
    if table is not None:
        write_file(table, listed.csv().encode(), "--csv", private=True)
    if bulk is not None and lines is not None:
        write_file(bulk, lines.encode(), "--bulk", private=True)
    for words, idents in against.in_words() if against else ():
        echo(f"{words}: {', '.join(idents) or 'nobody'}")
    echo(f"{counted(listed.without_consent, 'person has', 'people have')} not agreed")
    if pay := listed.effective_pay():
        echo(pay)


@study.command(short_help="Delete the identifiers and codes of a study's people.")
@argument("name")
@flag("--yes", "Do not ask.")
@DATABASE_AND_STUDIES
def unlink(name: str, yes: bool, folder: Folder, database: Path) -> None:
    """Delete the participant IDs and completion codes of a closed study, and the texts of its outcomes, once everybody is paid.

    Invitations that were used get other IDs. Nobody can tell then who a participant was. An entry of the chain says that it
    was done. The file is written anew and its log emptied, within a minute, while a server may go on. Backups keep what they
    hold.

    \b
    Example:
      humanplay study unlink pilot
    """
    from humanplay.db import erasure
    from humanplay.study.invitations import Invitations
    from humanplay.study.outcomes import delete_texts

    uses = _uses(database, name)
    with failures(f"cannot write {database}"), study_errors():
        found = folder.study(name)
        if found.is_running:
            raise UsageError(
                f"the study {name!r} is open, and whoever comes back is known by their ID: close it first"
            )
        if not yes:
            _confirm(f"Delete the identifiers and codes of {name!r} for good?", "deleted")
        used = [ident for ident, use in uses.items() if use.state == "used"]
        if found.protocol.recruitment == "invitation":
            Invitations(folder).note_used(name, used)
        people = erasure.unlink(database, found.row())
        delete_texts(folder.path(name))
    echo(f"deleted from {database}: identifiers and codes of {counted(people, 'person', 'people')}")


def _note_act(study: Study, database: Path, act: Act, **details: int) -> None:
    """Append an operator's act to the chain of the database, if there is one; a server may run."""
    from humanplay.db.chain import act_of, append_marks
    from humanplay.db.database import writing

    if database.exists():
        with failures(f"cannot note in {database} what was done"), writing(database) as conn:
            append_marks(conn, [act_of(study.row(), act, **details)])


@study.command(short_help="Take invitations back.")
@argument("name")
@argument("ids", nargs=-1, required=True)
@STUDIES
def revoke(name: str, ids: tuple[str, ...], folder: Folder) -> None:
    """Take invitations back by their ids: nobody can agree to take part with them any more.

    Whoever has agreed with one already goes on; `humanplay forget` erases a participant.

    \b
    Example:
      humanplay study revoke pilot 7K3M 9ABC
    """
    from humanplay.study.invitations import Invitations

    with study_errors():
        revoked = Invitations(folder).revoke(name, ids)
    echo(f"revoked: {', '.join(each.id for each in revoked)}")


@study.command(short_help="Print the operator's code for supervised sessions.")
@argument("name")
@STUDIES
def supervise(name: str, folder: Folder) -> None:
    """Print the code that an operator types on a participant's page in the lab.

    Episodes that begin within four hours after it was typed count as supervised. The code is that of this UTC day; it is
    valid until the end of the following one. Whoever knows it can type it anywhere: type it yourself, unseen.
    """
    from humanplay.study.files import now_ms
    from humanplay.study.recruitment import code_of, valid_until_ms

    with study_errors():
        study = folder.study(name)
    if not study.is_running:
        why = "nobody can be supervised in it any more"
        raise UsageError(f"the study {name!r} is closed: {why}")
    now = now_ms()
    echo(f"{code_of(study, now)}\nvalid until {_day(valid_until_ms(now))} UTC")


def _lines(path: Path) -> list[str]:
    """The IDs in a file, one a line; UsageError where it holds no text."""
    return list(filter(None, map(str.strip, _text(path, "with an ID on each line").splitlines())))


def _text(path: Path, wanted: str) -> str:
    """The text of a file; UsageError where it holds none, with how it is wanted."""
    try:
        with failures(f"cannot read {path}"):
            return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(f"cannot read {path}: it is no text in UTF-8, {wanted}") from error


def _uses(database: Path, name: str) -> dict[str, Use]:
    """Return what the database knows of a study's invitations, by id; nothing where there is no database."""
    if not database.exists():
        return {}
    from humanplay.db.reader import Reader
    from humanplay.study.invitations import uses_of

    with failures(f"cannot read {database}"), closing(Reader.open(database)) as reader:
        return uses_of(reader, name)


def _write_csv(path: Path, rows: list[tuple[str, ...]]) -> None:
    """Write the table for its owner alone: whoever reads a link can take part with it."""
    from marsexplorer.files import to_cell

    text = io.StringIO()
    table = [("id", "state", "participant", "arm", "link"), *rows]
    csv.writer(text, lineterminator="\n").writerows(map(to_cell, row) for row in table)
    write_file(path, text.getvalue().encode(), "--csv", private=True)


def _day(ms: int) -> str:
    return datetime.fromtimestamp(ms / 1000, UTC).strftime("%Y-%m-%d %H:%M")


def _check_power(protocol: Protocol) -> None:
    """Refuse a study that sees its planned difference in less than 50 % of cases."""
    from humanplay.report.statistics.planning import LEAST_POWER, power_in_words
    from humanplay.study.policy_episodes import tested_policies

    power, is_of_arms = protocol.power, protocol.primary_family == "arms"
    if (
        not (tested_policies(protocol) or is_of_arms)
        or power is None
        or (power.lower or 0.0) >= LEAST_POWER
    ):
        return
    ways = "; or ".join(
        [*_ways(protocol), "freeze with --underpowered where it is a rehearsal or a pilot"]
    )
    raise UsageError(
        f"{power_in_words(protocol)} Below 50 % a study more likely misses than sees what it is for: {ways}"
    )


def _ways(protocol: Protocol) -> list[str]:
    """How the study would see its difference, or another one, more often."""
    from humanplay.report.statistics.planning import (
        MOST_PARTICIPANTS,
        WANTED_POWER,
        fewest_participants,
        reachable_difference,
    )

    if protocol.primary_family == "arms":
        return ["plan more players, or a larger arm_difference"]
    design, difference, ways = _design(protocol), protocol.policy_difference, []
    with progress("looking for the fewest players and the least difference"):
        fewest = None if difference is None else fewest_participants(design, difference)
        least, power = reachable_difference(design)
    if fewest is not None:
        ways.append(f"plan about {counted(fewest, 'player')}, for {100 * WANTED_POWER:.0f} %")
    elif not design.is_tested:
        ways.append("plan five players and five ranked episodes or more")
    elif difference is None:
        ways.append("plan more players and more ranked episodes")
    if least is not None:
        why = (
            "" if fewest is not None else f" ({MOST_PARTICIPANTS} players are too few for this one)"
        )
        ways.append(f"write {least:g} or more as policy_difference, for {100 * power:.0f} %{why}")
    return ways or [f"{MOST_PARTICIPANTS} players are too few"]


def _echo_power(protocol: Protocol) -> None:
    """Print what a protocol sees and what that rests on."""
    from humanplay.report.statistics.planning import assumptions_in_words, power_in_words

    if protocol.power is None:
        echo("Power: nothing is assumed of people, and nothing is tested")
        return
    echo(f"Power: {power_in_words(protocol)}")
    echo(
        f"{assumptions_in_words(protocol)} No measurement of people: put better ones into protocol.json"
    )


@study.command(short_help="Write the preregistration, ready for OSF.")
@argument("name")
@path_option("--out", "Write it to this file.  [default: print it]", metavar="FILE")
@STUDIES
def preregister(name: str, out: Path | None, folder: Folder) -> None:
    """Write a study's preregistration as Markdown, to be uploaded to OSF or elsewhere before anybody plays.

    Hypotheses, estimands, sample and recruitment, exclusion, the stopping rule, analyses, power, and the
    hash and the commitment that fix protocol and terrains; and what is not preregistered. What only you know is marked
    TO BE STATED. A draft gives a preview, marked DRAFT, without hash and commitment.

    \b
    Examples:
      humanplay study preregister pilot
      humanplay study preregister pilot --out pilot-preregistration.md
    """
    from humanplay.report.preregistration import preregistration
    from humanplay.study.templates import fill

    with study_errors():
        found = None if folder.status(name) == "draft" else folder.study(name)
        protocol = fill(folder.draft(name)) if found is None else found.protocol
        text = preregistration(protocol, found)
    if out is None:
        echo(text, nl=False)
        return
    write_file(out, text.encode(), "--out")
    then = "state what is marked TO BE STATED, then register it before anybody plays"
    echo(f"{out}: read it, {then}")
