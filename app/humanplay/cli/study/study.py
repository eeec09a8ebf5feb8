"""The command `humanplay study`, from a draft to the closing and the payments."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
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
from humanplay.command.options import COUNT, SizeType, flag, path_option, several
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


RECRUITMENT = "recruitment.txt"
"""A text to recruit with, in a study's folder; freezing fills it in."""

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
    help="Another environment, written as for serve; the server needs the same --env.  [default: asks, else MarsExplorer]",
)
@option("--level", help="random, t-m-b from 1-1-1 to 3-2-2, building or cave.  [default: random]")
@option("--size", type=SizeType(), help="21 for a square, 42x84 for rows x columns.  [default: 21]")
@option("--warm-up", default=15, help="Episodes that do not count, before the others.")
@option("--ranked", default=30, help="Episodes that count.")
@option("--players", type=COUNT, help="Participants planned.  [default: asks, else 10]")
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
    help="Where people come from, with recruitment panel; code: no platform, each person gets a code of their own.",
)  # fmt: skip
@several(
    "--ask",
    "blocks",
    f"A shipped block of questions about people; repeatable: {', '.join(BLOCKS)}.",
)
@several(
    "--policy",
    "policies",
    "To compare with people; repeatable.  [default: asks, else the shipped ones]",
)
@path_option(
    "--declarations",
    "declarations_path",
    "TOML file of what only you know, as examples/declarations.toml.  [default: write them into the draft]",
    metavar="FILE",
)
@STUDIES
def new(
    name: str,
    task: str | None,
    level: str | None,
    size: int | tuple[int, int] | None,
    players: int | None,
    policies: tuple[str, ...],
    declarations_path: Path | None,
    folder: Folder,
    **options: object,
) -> None:
    """Write a study's draft, protocol.toml, to read and edit before it is frozen.

    On a terminal it asks what is played, with which policies people are compared and how many people are to finish, unless
    options say so, and prints what so many people can show. The defaults are those of the paper (section 3.2). Consent text,
    questions, exclusion rules and what the power rests on are in the file, with a line on each. Texts name the protocol's
    numbers in braces, such as {ranked}; freezing fills them in. The policies are played on 200 terrains that are not the
    study's, and the difference that the study is to see is one that this many players can see.

    What only you know (population, payment, ethics review ...) is written into the file before the study is frozen, or read
    from --declarations; `study check` lists what is missing. Beside it stand a text to recruit with and a checklist.

    \b
    Examples:
      humanplay study new koutras2021
      humanplay study new pilot
      humanplay study new hard --level 3-2-1 --size 42x42 --warm-up 5 --ranked 20 --players 16
      humanplay study new lake --env FrozenLake-v1
      humanplay study new online --platform prolific --ask demographics --ask nasa-tlx
    """
    from humanplay.cli.study.answers import (
        PLAYERS,
        asked_environment,
        asked_players,
        asked_policies,
    )
    from humanplay.study import texts
    from humanplay.study.draft import toml
    from humanplay.study.files import read_toml
    from humanplay.study.protocol import StudyError, default_protocol, parse_protocol
    from humanplay.study.protocol_parts import Declarations
    from humanplay.study.templates import filled
    from humanplay.task.registration import environment_of

    with study_errors():
        folder.check_free(name)
        if declarations_path is not None:
            answers = read_toml(declarations_path)
            if unknown := sorted(answers.keys() - Declarations.model_fields):
                fields = ", ".join(Declarations.model_fields)
                raise StudyError(
                    f"{declarations_path} declares {unknown[0]!r}, which is none of {fields}"
                )
            options["declarations"] = answers
    is_asked = sys.stdin.isatty()
    if is_asked and (task, level, size) == (None, None, None):
        name_of_task, config = asked_environment()
    else:
        name_of_task = DEFAULT_TASK if task is None else task_name(task)
        config = config_of(name_of_task, level, size)
    options["recruitment"] = options["recruitment"] or (
        "invitation" if options["platform"] == "code" else "panel"
    )
    rest = {field: content for field, content in options.items() if content not in (None, ())}
    if policies:
        rest["policies"] = policies
    elif is_asked:
        rest["policies"] = asked_policies(environment_of(name_of_task), config)

    def planned(protocol: Protocol) -> Protocol:
        fields = protocol.model_dump(mode="json", exclude_unset=True)
        plan = parse_protocol({**fields, **_planned(protocol, folder)})
        _echo_power(_with_power(plan))
        return plan

    with study_errors():
        protocol = default_protocol(name, config, name_of_task, **rest, players=players or PLAYERS)
        asks_players = is_asked and players is None
        protocol = asked_players(protocol, planned) if asks_players else planned(protocol)
        path = folder.create(protocol)
    has_own_links = protocol.recruitment == "invitation" or protocol.panel_links == "signed"
    asks = texts.RECRUITMENT + (texts.ONE_EACH if has_own_links else "")
    write_file(path.with_name(RECRUITMENT), asks.encode())
    write_file(path.with_name("checklist.md"), filled(texts.CHECKLIST, protocol).encode())
    rehearsed = dict.fromkeys(Declarations.model_fields, "none: this is a rehearsal")
    write_file(path.with_name("rehearsal.toml"), toml(rehearsed).encode())
    echo(f"{path.with_name(RECRUITMENT)}: a text to recruit people with")
    echo(f"{path.with_name('checklist.md')}: what to do, from here to the figure")
    echo(
        f"{path}: the protocol to edit. `humanplay study check {name}` lists what is to be written before "
        f"`humanplay study freeze {name}`"
    )


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
    """Fix a study's protocol for good, and draw the secret behind its terrains.

    It prints what participants will read and what to publish. Placeholders in the texts are filled in. The power is
    simulated, printed and fixed with the protocol; a study that would see its planned difference in fewer than half of all
    cases is refused. The file of each network that people are compared with is kept with the study, so that its report
    always plays the same network.

    Publish the hash and the commitment before anybody plays, for example in a preregistration: they prove later that
    neither the protocol nor a terrain was chosen afterwards. Keep a copy of the study's folder. Whoever reads the file
    `secret` knows every terrain.
    """
    from humanplay.report.statistics.planning import AT_FREEZING
    from humanplay.study.cautions import cautions_of
    from humanplay.study.folder import BEGINNINGS, beginnings
    from humanplay.study.kept_out import keep_out
    from humanplay.study.places import cap_in_words
    from humanplay.study.protocol import PLANNED
    from humanplay.study.templates import filled

    _check_database(database)
    with study_errors():
        draft = folder.filled(name)
        idents = [] if excluded is None else _excluded(excluded, draft)
        draft = draft.model_copy(update=_planned(draft, folder))
        asks = None
        recruitment = folder.path(name) / RECRUITMENT
        if recruitment.is_file():
            asks = filled(recruitment.read_text("utf-8"), folder.draft(name))
    protocol = _with_power(draft, AT_FREEZING)
    if not underpowered and protocol.dry_run_of is None:
        _check_power(protocol)
    planned = {field: getattr(protocol, field) for field in PLANNED}
    study = freeze_and_note(name, folder, database, planned)
    protocol = study.protocol
    if asks is not None:
        write_file(recruitment, asks.encode())
    if idents:
        with study_errors():
            count = keep_out(folder.path(name), idents)
        people = counted(count, "person of a pilot is", "people of pilots are")
        echo(f"{people} kept out, by keyed hashes of their IDs, until the study is closed")
    if study.examined:
        echo(f"{study.examined[0].upper()}{study.examined[1:]}")
    echo(f"What participants read and agree to:\n\n{protocol.consent.text}\n")
    _echo_power(protocol)
    for policy, digest in protocol.policy_hashes.items():
        echo(f"The file of the policy {policy} is kept with the study: SHA-256 {digest}")
    if (looks := beginnings(protocol)) <= BEGINNINGS // 2:
        echo(
            f"Caution: of {BEGINNINGS} seeds only {looks} look{'s' * (looks == 1)} different at the start, so that "
            "whoever has played some instances may know the others"
        )
    lowest_score, _ = protocol.environment.bounds(protocol.env_config)
    if math.isinf(lowest_score):
        echo(
            "Caution: no lowest score is declared (`bounds` of the environment's file): there is no mean score of everybody "
            "who began, nobody who gives up is in the per-protocol estimate, and no difference in score is tested"
        )
    if limit := cap_in_words(protocol):
        echo(limit)
    for sentence in cautions_of(protocol):
        echo(f"Caution: {sentence}")
    echo(f"The study {name!r} is frozen. Publish this line before anybody plays:\n{hashes(study)}")
    echo(f"A running server offers it at once, at /study/{name}")
    if protocol.recruitment == "invitation":
        echo(
            f"It is by invitation: `humanplay study invite {name} {protocol.players}` makes the links"
        )
    if protocol.platform != "code":
        query = PLATFORMS[protocol.platform].query
        echo(f"The address to give to the platform ends with /study/{name}{query}")
    if protocol.panel_links == "signed":
        echo(f"Links are signed: `humanplay study invite {name} --ids FILE` makes them")


def _excluded(path: Path, draft: Protocol) -> list[str]:
    """The IDs in a file of people who may not take part.

    Raises:
        UsageError: If a line is no ID.
    """
    from humanplay.study.platforms import fits

    if not draft.outside_ids:
        raise UsageError(
            f"the study {draft.name!r} has no outside_ids, so that nobody is known by an ID: leave --exclude-ids out, or name "
            "the parameter of its links that holds one"
        )
    idents, name = _lines(path), draft.outside_ids[0]
    if wrong := [ident for ident in idents if not fits(draft.platform, name, ident)]:
        raise UsageError(
            f"expected a {name} and nothing else on each line of {path}, got {wrong[0]!r}"
        )
    return idents


def freeze_and_note(
    name: str,
    folder: Folder,
    database: Path,
    planned: Mapping[str, object] = MappingProxyType({}),
) -> Study:
    """Freeze a study, note it in the chain of the database, and return it.

    Args:
        planned: As of `Folder.freeze`.
    """
    from humanplay.release.rehearsal import rehearse

    _check_database(database)
    with study_errors(), progress("drawing the instances") as advance:
        study = folder.freeze(name, advance, planned=planned, rehearse=rehearse)
    if _note_freezing(study, database):
        echo(f"An entry of the chain of {database} says so")
    else:
        echo(
            f"There is no database {database} yet: the server that makes it notes this in its chain"
        )
    return study


def hashes(study: Study) -> str:
    """The line to publish, with the hashes of the protocol and of the secret."""
    return f"{study.name}: protocol {study.protocol_hash}, secret {study.commitment} (SHA-256)"


def _check_database(database: Path) -> None:
    """Refuse a database that is not ours, before a study changes that it must note."""
    from humanplay.db.database import reading

    if database.exists():
        with failures(f"cannot read {database}"), reading(database):
            pass


def _note_freezing(study: Study, database: Path) -> bool:
    """Append the freezing to the database's chain; a server may run.

    Returns:
        Whether there is a database.
    """
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
@flag("--now", "Close it also while somebody is playing.")
@flag("--keep-secret", "Keep the secret behind its instances.")
@DATABASE_AND_STUDIES
def close(
    name: str, yes: bool, now: bool, keep_secret: bool, folder: Folder, database: Path
) -> None:
    """Close a study for participants, and reveal the secret behind its terrains.

    Nobody can join or go on. With --keep-secret, the secret is kept until you close the study again without it. Until
    then debrief, report, costs, replays, exports and release show nothing of its terrains, so that others can play them
    unseen.

    Open episodes are abandoned. If somebody has moved within the last ten minutes, nothing is closed without --now; with
    it, they count as interrupted. There is no way back: whoever knows the secret knows every terrain. A running server
    sees it at once.
    """
    question = f"Close the study {name!r} for ever? Participants on their way cannot finish"
    study = close_and_note(name, None if yes else question, now, keep_secret, folder, database)
    if study.is_open:
        echo(
            f"The study {name!r} is closed, its secret kept; `humanplay study close {name}` reveals it"
        )
    else:
        echo(f"The study {name!r} is closed.\nsecret  {study.secret.hex()}")


def close_and_note(
    name: str, question: str | None, now: bool, keeps_secret: bool, folder: Folder, database: Path
) -> Study:
    """Close a study, note it in the database, and return it.

    Args:
        question: What is asked before an open study is closed; None: nothing.
        now: Whether to close it although somebody plays.
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
    """Ask a question; anything but yes ends the command.

    Args:
        done: What has not been done then, as in `deleted`.
    """
    try:
        click.confirm(question, abort=True)
    except click.Abort:
        if sys.stdin.isatty():
            raise
        raise ClickException(
            f"nothing was {done}: the answer was not yes; --yes does without asking"
        ) from None


def _note_in_database(study: Study, database: Path) -> bool:
    """Note the closing in the database, or let the server that has it open note it.

    Returns:
        Whether it is noted after NOTED_S seconds at most; true without a database.
    """
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
@option("--language", help="In which of its languages.  [default: the first]")
@STUDIES
def show(name: str, language: str | None, folder: Folder) -> None:
    """Print how far a study is, its protocol, and what freezing fixed.

    The texts of a draft are shown as participants would read them, with every placeholder filled in. Of a study in several
    languages, those of one; what a draft lacks in another is counted. The secret of an open study is never shown.

    \b
    Examples:
      humanplay study show pilot
      humanplay study show pilot --language de
    """
    from humanplay.study.translation import collect, localized

    lacking: dict[str, int] = {}
    with study_errors():
        status, protocol = folder.status(name), folder.draft(name)
        languages = protocol.languages
        chosen = language or languages[0]
        if chosen not in languages:
            raise UsageError(f"{name!r} is offered in {', '.join(languages)}, not in {chosen!r}")
        if status == "draft":
            parts = {one: collect(protocol, folder.path(name), one) for one in languages}
            lacking = {one: len(part.missing) for one, part in parts.items()}
            protocol = parts[chosen].protocol
        else:
            protocol = localized(protocol, chosen)
        study = None if status == "draft" else folder.study(name)
    echo(f"{name}: {status}, {folder.path(name)}")
    for other, missing in lacking.items():
        if missing:
            echo(
                f"texts          {counted(missing, 'text')} missing in {other}: `humanplay study texts {name} {other}`"
            )
    if study is not None:
        echo(hashes(study))
        if not study.is_open:
            echo(f"secret         {study.secret.hex()}")
    for frozen, words in protocol.texts.items():
        echo(f"texts          {len(words)} in {frozen}, frozen with the protocol")
    shown = protocol.model_dump(mode="json", exclude={"texts"})
    echo(json.dumps(shown, indent=2, ensure_ascii=False))


@study.command("texts", short_help="Write what is to be translated.")
@argument("name")
@argument("language")
@option(
    "--all",
    "with_all",
    is_flag=True,
    help="List the software's own texts too, so that you can reword them.",
)
@STUDIES
def write_texts(name: str, language: str, with_all: bool, folder: Folder) -> None:
    """Write the texts of a draft that lack a translation into a file.

    The file has the English above each. LANGUAGE is as the web names it, such as de or pt-BR. A text that you leave
    empty counts as not translated; one of the software's own keeps its words.

    \b
    Examples:
      humanplay study texts pilot de
      humanplay study texts pilot fr
      humanplay study texts pilot en --all
    """
    from humanplay.study.protocol import StudyError
    from humanplay.study.translation import path_of, write_missing

    with study_errors():
        if folder.status(name) != "draft":
            raise StudyError(f"the study {name!r} is frozen, and its texts with it")
        added = write_missing(folder.draft(name), folder.path(name), language, with_all)
    echo(f"{path_of(folder.path(name), language)}: {counted(len(added), 'text')} to be translated")


@study.command(short_help="What a study still lacks, and what a reviewer will ask.")
@argument("name")
@STUDIES
def check(name: str, folder: Folder) -> None:
    """List what a draft lacks and what a reviewer will ask, with the lines to write.

    Cautions follow. Of a frozen study, only the cautions are listed.

    \b
    Example:
      humanplay study check pilot
    """
    from humanplay.study.cautions import cautions_of
    from humanplay.study.places import cap_in_words

    with study_errors():
        protocol = folder.draft(name)
        gaps = list(_gaps(name, protocol, folder)) if folder.status(name) == "draft" else []
    if limit := cap_in_words(protocol):
        echo(limit)
    notes = [*gaps, *(f"Caution: {sentence}" for sentence in cautions_of(protocol))]
    for note in notes or [f"No problem was found in {name!r}"]:
        echo(note)


def _gaps(name: str, protocol: Protocol, folder: Folder) -> Iterator[str]:
    """Yield what freezing would refuse of a draft, and what a reviewer will ask."""
    from humanplay.study.draft import FILE
    from humanplay.study.protocol import StudyError
    from humanplay.study.protocol_parts import Declarations
    from humanplay.study.review import open_questions
    from humanplay.study.translation import with_texts

    path = folder.path(name)
    if unanswered := protocol.declarations.unanswered():
        yield f'To write below [declarations] of {path / FILE} before freezing; "none" is an answer:'
        for field in unanswered:
            yield f'  {field} = "..."  # {Declarations.model_fields[field].description}'
    try:
        refusals = list(folder.refusals(name, with_texts(protocol, path)))
    except StudyError as error:
        refusals = [error]
    for refusal in refusals:
        yield f"Freezing would refuse: {refusal}"
    recruitment = path / RECRUITMENT
    if recruitment.is_file() and (count := recruitment.read_text(encoding="utf-8").count("TODO")):
        yield f"{recruitment} has TODO {counted(count, 'time')}"
    if questions := list(open_questions(protocol)):
        yield f"A reviewer will ask this, which {FILE} leaves open; write such a line over that of the field:"
        for question in questions:
            yield f"  {question.question}\n    {question.line}"


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
    """Simulate studies, and print how many detect the protocol's planned difference.

    They follow the protocol's assumptions and are analysed by the report's own functions. Nothing is written: put what
    suits you into protocol.toml.

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
        tests_arms = protocol.primary_family == "arms"
        difference_field = "arm_difference" if tests_arms else "policy_difference"
        options = {"players": players, "ranked": ranked, difference_field: difference}
        changes |= {field: number for field, number in options.items() if number is not None}
        fields = protocol.model_dump(mode="json", exclude_unset=True)
        protocol = parse_protocol({**fields, **changes})
        protocol = protocol.model_copy(update=_planned(protocol, folder))
    _echo_power(_with_power(protocol))
    has_difference = protocol.policy_difference is not None and tested_policies(protocol)
    if has_difference or protocol.primary_family == "arms":
        echo(f"To see more: {'; or '.join(_remedies(protocol))}")


def _assumptions_from(name: str, protocol: Protocol, database: Path) -> dict[str, float]:
    """Field -> assumption about people, by a closed study; UsageError if it has none."""
    from humanplay.report.statistics.planning import assumptions_from
    from humanplay.study.data import load

    with failures(f"cannot read {database}"), study_errors():
        pilot = load(database, name)
    try:
        return assumptions_from(pilot, protocol)
    except ValueError as error:
        raise UsageError(str(error)) from error


def _planned(protocol: Protocol, folder: Folder) -> dict[str, float | None]:
    """The assumptions and the difference that a protocol leaves empty, by field."""
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
    """The protocol with its power, by so many simulated studies.

    It stays without one if nothing is assumed and nothing is tested.
    """
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
    """The design of a protocol; UsageError if an assumption is missing."""
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
@option("--arm", help="Assign everybody who comes with one to this arm, and not by chance.")
@flag("--list", "is_list", "List all invitations with their state instead.")
@path_option(
    "--ids",
    "ids_path",
    "A panel's ids, one a line: print a signed link for each, where panel_links is signed.",
    metavar="FILE",
)
@path_option(
    "--csv",
    "csv_path",
    "Write them to a file, with links: id, state, participant, arm, link.",
    metavar="FILE",
)
@DATABASE_AND_STUDIES
def invite(
    name: str,
    count: int,
    url: str | None,
    arm: str | None,
    is_list: bool,
    ids_path: Path | None,
    csv_path: Path | None,
    database: Path,
    folder: Folder,
) -> None:
    """Print N single-use links to a study whose recruitment is by invitation.

    A link is used up when somebody agrees to the consent text, not when it is opened. Send each person one; whoever has a
    link can take part with it. The study's folder lists the links by their ids, never by their tokens. --list shows ids
    and states, and with --csv the links once more. A running server knows new links at once.

    With --arm, people who come with one of these links are not assigned by chance: the release says "operator" of each,
    and the report says how many they are.

    \b
    Examples:
      humanplay study invite pilot 10 --url https://lab.example.org
      humanplay study invite pilot --list
      humanplay study invite pilot --list --csv links.csv
    """
    from humanplay.study.invitations import Invitations, link_of, state_of
    from humanplay.study.recruitment import panel_link

    if [count > 0, is_list, ids_path is not None].count(True) != 1:
        raise UsageError(
            "expected the number of links to make, such as 10, --list to see all, or --ids FILE"
        )
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
        if ids_path is not None:
            idents = _lines(ids_path)
            rows = [(ident, "signed", "", "") for ident in idents]
            links = [panel_link(study, ident, base) for ident in idents]
        else:
            chosen = (
                list(invitations.of(name).values())
                if is_list
                else invitations.issue(name, count, arm)
            )
    for invitation in chosen:
        use = uses.get(invitation.id)
        label = use.label if use else ""
        rows.append((invitation.id, state_of(invitation, use), label, invitation.arm or ""))
        links.append(link_of(study, invitation.id, base))
    if public_url is None and (csv_path is not None or not is_list):
        echo(
            f"{base} is a guess: give --url, or HUMANPLAY_PUBLIC_URL as for the server, if people reach it elsewhere",
            err=True,
        )
    if not is_list:
        echo("\n".join(links))
    elif not chosen:
        echo(
            f"nobody has been invited to {name}; `humanplay study invite {name} 10` makes ten links"
        )
    else:
        issued = [_day(invitation.issued_ms) for invitation in chosen]
        printed = [(*row, day) for row, day in zip(rows, issued, strict=True)]
        heads = ("id", "state", "participant", "arm", "issued (UTC)")
        print_table(f"Invitations to {name}", heads, printed)
    if csv_path is not None:  # last: the links that were issued are printed even if this fails
        _write_csv(csv_path, [(*row, link) for row, link in zip(rows, links, strict=True)])


@study.command(
    short_help="What people read when they finish or leave: codes, addresses, sentences."
)
@argument("name")
@argument("texts", nargs=-1, metavar="[OUTCOME=TEXT]...")
@DATABASE_AND_STUDIES
def outcomes(name: str, texts: tuple[str, ...], folder: Folder, database: Path) -> None:
    """Print, or change, what people read at each outcome of a study.

    That is a code (one word), an address (http...) or a sentence. These texts lie beside the study's secret, are in no
    protocol, report or release, and may change while the study runs: a running server shows new ones at once, and an
    entry of the chain says that they changed, without the texts. An empty text deletes one. In an address, a parameter of
    the link such as {survey_code} becomes the participant's value; {code} is the code that is drawn for each person if
    the platform is code.

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
        changes = {outcome: text for outcome, _, text in pairs}
        shown = change_texts(path, protocol, changes, is_frozen) if pairs else read_texts(path)
        if pairs and is_frozen:
            _note_act(folder.study(name), database, "outcomes changed")
    rows = [(outcome, words, shown.get(outcome, "")) for outcome, words in OUTCOME_IN_WORDS.items()]
    print_table(f"Outcomes of {name}", ("outcome", "whoever", "reads"), rows)


@study.command(short_help="Whom to pay, and how much.")
@argument("name")
@path_option("--csv", "csv_path", "Write the list to a file.", metavar="FILE")
@path_option("--bulk", "bulk_path", "Write Prolific's lines of bonuses to a file.", metavar="FILE")
@path_option(
    "--against", "export_path", "Compare with the submissions that Prolific or Connect exports.", metavar="EXPORT.csv"
)  # fmt: skip
@DATABASE_AND_STUDIES
def payments(
    name: str,
    csv_path: Path | None,
    bulk_path: Path | None,
    export_path: Path | None,
    folder: Folder,
    database: Path,
) -> None:
    """List everybody who agreed, with what each is paid.

    A row has the identifier, the label, the outcome, its code, the minutes from consent to end, the amount with its
    currency, the share of the ranked episodes that ended, and the arm. People who have not agreed are only counted.

    Amounts are those of the protocol's `payment`. One that depends on how somebody played is listed once the study is
    closed; with bonus_at_once in the protocol it is listed earlier, an entry of the chain says so each time, and the
    report says how often. --bulk writes the bonuses that the platform does not pay itself, without zeros. --against
    names who claims to have finished and has not, who finished without a code, and who timed out; on Connect, which has
    no codes, who finished and did not come back, and who is unknown here. It reads the columns Participant ID, Status
    and, unless people came from Connect, Completion Code, with or without spaces. Files are readable by their owner
    alone.

    \b
    Examples:
      humanplay study payments pilot
      humanplay study payments pilot --csv pay.csv --bulk bulk.csv
      humanplay study payments pilot --against prolific_export.csv
    """
    from humanplay.db.reader import Reader
    from humanplay.study.outcomes import read_texts
    from humanplay.study.payments import COLUMNS, differences_to_export, payments_of

    if not database.exists():
        raise UsageError(f"no database at {database}: give its path with --database")
    text = None if export_path is None else _text(export_path, "with a submission on each line")
    with failures(f"cannot read {database}"), study_errors():
        study = folder.study(name)
        texts = read_texts(folder.path(name))
        with closing(Reader.open(database)) as reader, reader.snapshot():
            payments = payments_of(reader, study, texts)
        bulk_lines = None if bulk_path is None else payments.bulk()
        differences = None if text is None else differences_to_export(payments, text, texts)
    if payments.shows_play and not payments.waits:
        _note_act(study, database, "amounts listed", people=payments.finished)
    if csv_path is None and bulk_path is None and differences is None:
        if rows := payments.table():
            print_table(f"Payments of {name}", COLUMNS, rows)
        else:
            echo("No person has agreed; synthetic participants are not listed")
    if csv_path is not None:
        write_file(csv_path, payments.csv().encode(), "--csv", private=True)
    if bulk_path is not None and bulk_lines is not None:
        write_file(bulk_path, bulk_lines.encode(), "--bulk", private=True)
    for words, idents in differences.items() if differences else ():
        echo(f"{words}: {', '.join(idents) or 'nobody'}")
    echo(f"{counted(payments.without_consent, 'person has', 'people have')} not agreed")
    if pay := payments.effective_pay():
        echo(pay)


@study.command(short_help="Delete the identifiers and codes of a study's people.")
@argument("name")
@flag("--yes", "Do not ask.")
@DATABASE_AND_STUDIES
def unlink(name: str, yes: bool, folder: Folder, database: Path) -> None:
    """Delete the participant IDs and completion codes of a closed study.

    Do it once everybody is paid: afterwards nobody can tell who a participant was. The texts of the study's outcomes are
    deleted too, and invitations that were used get other IDs. An entry of the chain says that it was done. The database
    file is rewritten and its log emptied within a minute, while a server may run. Backups keep what they hold.

    \b
    Example:
      humanplay study unlink pilot
    """
    from humanplay.db import erasure
    from humanplay.study.invitations import Invitations
    from humanplay.study.outcomes import delete_texts

    uses = _uses(database, name)
    with failures(f"cannot write {database}"), study_errors():
        study = folder.study(name)
        if study.is_running:
            raise UsageError(
                f"the study {name!r} is open, and whoever comes back is known by their ID: close it first"
            )
        if not yes:
            _confirm(f"Delete the identifiers and codes of {name!r} for good?", "deleted")
        used = [ident for ident, use in uses.items() if use.state == "used"]
        if study.protocol.recruitment == "invitation":
            Invitations(folder).note_used(name, used)
        people = erasure.unlink(database, study.row())
        delete_texts(folder.path(name))
    echo(f"deleted from {database}: identifiers and codes of {counted(people, 'person', 'people')}")


def _note_act(study: Study, database: Path, act: Act, **details: int) -> None:
    """Append an operator's act to the chain of a database, if there is one.

    A server may run.
    """
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
    """Take invitations back by their ids: nobody can agree with them any more.

    A person who has agreed already goes on; `humanplay forget` erases a participant.

    \b
    Example:
      humanplay study revoke pilot 7K3M 9ABC
    """
    from humanplay.study.invitations import Invitations

    with study_errors():
        revoked = Invitations(folder).revoke(name, ids)
    echo(f"revoked: {', '.join(invitation.id for invitation in revoked)}")


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
        raise UsageError(f"the study {name!r} is closed: nobody can be supervised in it any more")
    now = now_ms()
    echo(f"{code_of(study, now)}\nvalid until {_day(valid_until_ms(now))} UTC")


def _lines(path: Path) -> list[str]:
    """The IDs in a file, one a line; UsageError if it holds no text."""
    return list(filter(None, map(str.strip, _text(path, "with an ID on each line").splitlines())))


def _text(path: Path, layout: str) -> str:
    """The text of a file.

    Args:
        layout: How the text should be, for the message.

    Raises:
        UsageError: If it is no text in UTF-8.
    """
    try:
        with failures(f"cannot read {path}"):
            return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise UsageError(f"cannot read {path}: it is no text in UTF-8, {layout}") from error


def _uses(database: Path, name: str) -> dict[str, Use]:
    """ID of an invitation -> how it was used; empty without a database."""
    if not database.exists():
        return {}
    from humanplay.db.reader import Reader
    from humanplay.study.invitations import uses_of

    with failures(f"cannot read {database}"), closing(Reader.open(database)) as reader:
        return uses_of(reader, name)


def _write_csv(path: Path, rows: list[tuple[str, ...]]) -> None:
    """Write the links for the owner's eyes alone: whoever reads one can take part."""
    from marsexplorer.files import to_cell

    text = io.StringIO()
    lines = [("id", "state", "participant", "arm", "link"), *rows]
    csv.writer(text, lineterminator="\n").writerows(map(to_cell, line) for line in lines)
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
        or (power.deciding_power or 0.0) >= LEAST_POWER
    ):
        return
    remedies = "; or ".join(
        [*_remedies(protocol), "freeze with --underpowered where it is a rehearsal or a pilot"]
    )
    raise UsageError(
        f"{power_in_words(protocol)} Below 50 % a study more likely misses than sees what it is for: {remedies}"
    )


def _remedies(protocol: Protocol) -> list[str]:
    """What would let the study detect a difference more often."""
    from humanplay.report.statistics.planning import (
        MOST_PARTICIPANTS,
        WANTED_POWER,
        fewest_participants,
        reachable_difference,
    )

    if protocol.primary_family == "arms":
        return ["plan more players, or a larger arm_difference"]
    design, difference = _design(protocol), protocol.policy_difference
    remedies = []
    with progress("looking for the fewest players and the least difference"):
        fewest = None if difference is None else fewest_participants(design, difference)
        least, power = reachable_difference(design)
    if fewest is not None:
        remedies.append(f"plan about {counted(fewest, 'player')}, for {100 * WANTED_POWER:.0f} %")
    elif not design.is_tested:
        remedies.append("plan five players and five ranked episodes or more")
    elif difference is None:
        remedies.append("plan more players and more ranked episodes")
    if least is not None:
        remedy = f"write {least:g} or more as policy_difference, for {100 * power:.0f} %"
        if fewest is None:
            remedy += f" ({MOST_PARTICIPANTS} players are too few for this one)"
        remedies.append(remedy)
    return remedies or [f"{MOST_PARTICIPANTS} players are too few"]


def _echo_power(protocol: Protocol) -> None:
    """Print a protocol's power and what it assumes."""
    from humanplay.report.statistics.planning import assumptions_in_words, power_in_words

    if protocol.power is None:
        echo("Power: nothing is assumed of people, and nothing is tested")
        return
    echo(f"Power: {power_in_words(protocol)}")
    echo(
        f"{assumptions_in_words(protocol)} No measurement of people: put better ones into protocol.toml"
    )


@study.command(short_help="Write the preregistration, ready for OSF.")
@argument("name")
@path_option("--out", "Write it to this file.  [default: print it]", metavar="FILE")
@STUDIES
def preregister(name: str, out: Path | None, folder: Folder) -> None:
    """Write a study's preregistration as Markdown.

    Upload it to OSF or elsewhere before anybody plays. It has hypotheses, estimands, sample and recruitment, exclusion,
    the stopping rule, analyses, power, and the hash and the commitment that fix protocol and terrains; and what is not
    preregistered. What only you know is marked TO BE STATED. A draft gives a preview, marked DRAFT, without hash and
    commitment.

    \b
    Examples:
      humanplay study preregister pilot
      humanplay study preregister pilot --out pilot-preregistration.md
    """
    from humanplay.report.preregistration import preregistration
    from humanplay.study.translation import preview

    with study_errors():
        study = None if folder.status(name) == "draft" else folder.study(name)
        draft = folder.draft(name)
        protocol = preview(draft, folder.path(name)) if study is None else study.protocol
        text = preregistration(protocol, study)
    if out is None:
        echo(text, nl=False)
        return
    write_file(out, text.encode(), "--out")
    echo(
        f"{out}: read it, state what is marked TO BE STATED, then register it before anybody plays"
    )
