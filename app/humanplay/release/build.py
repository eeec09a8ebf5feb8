"""A study written as a citable bundle: verified, under new pseudonyms, signed.

The folder appears whole or not at all.
"""

from __future__ import annotations

import json
import secrets
import sqlite3
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import astuple, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple, TypedDict

from humanplay.db import chain
from humanplay.db.columns import TABLES
from humanplay.db.database import SqlValue, StoreError, reading, rows, transaction, writing
from humanplay.db.erasure import ANSWERS, asks_erasure
from humanplay.db.reader import Reader
from humanplay.db.releases import ReleaseRow, latest_release, note_release
from humanplay.db.series import OF_PEOPLE
from humanplay.db.study_rows import AnswerRow, FreeTextRow, participant_label
from humanplay.db.trial import Trial
from humanplay.release import signing
from humanplay.release.bundle import initials
from humanplay.release.croissant import write_croissant
from humanplay.release.documents import citation, licence_url, write_documents
from humanplay.release.errors import ReleaseError, check_libraries
from humanplay.release.manifest import (
    BUNDLE_DATABASE,
    COUNTED_TABLES,
    ReleaseHeader,
    SupersededRelease,
    write_manifest,
)
from humanplay.release.minari_data import MinariWriter, dataset_id
from humanplay.release.pseudonyms import ReleasedAnswers, count_arrivals, write_pseudonymized
from humanplay.release.tables import QUERIES, released_episodes, write_tables
from humanplay.report.costs import (
    CostRow,
    ProgressBar,
    cost_cache,
    cost_rows,
    costs_of_people,
    judged_trials,
    no_bar,
    reason_not_judged,
    study_estimator,
)
from humanplay.report.making import (
    REPORT_STEMS,
    has_played,
    make_report,
    play_compared,
    report_files,
)
from humanplay.report.statistics.exclusion_sets import lowest_reason, people_of, statuses
from humanplay.report.statistics.formatting import utc
from humanplay.study.answer_counts import AnswerCounts, known_counts, to_json
from humanplay.study.closing import UNNOTED
from humanplay.study.data import Person, StudyData, load
from humanplay.study.files import now_ms
from humanplay.study.folder import SECRET_KEPT, Advance, Folder
from humanplay.study.invitations import Invitation, Invitations
from humanplay.study.policy_episodes import PolicyEpisode, closed_seeds, compared_policies
from humanplay.study.policy_files import FOLDER, PolicyFiles
from humanplay.study.protocol import Protocol, StudyError, parse_protocol
from humanplay.study.verification import verify_moment
from humanplay.task import counted
from marsexplorer.files import replace_whole

FORGOTTEN_REASON = "a participant asked to be forgotten"


@dataclass(frozen=True)
class ReleaseRequest:
    """What to release and where.

    Attributes:
        authors: Named in the citation.
        secrets: Of studies whose end the database has not noted yet: name -> (closed_ms, 32
            bytes); None as closed_ms: still open.
        without_policies: That the report leaves out although the protocol names them.
        invitations: Of the study by id; None where it has none, or its folder is not at hand.
        policy_folder: In which the files of the policies are kept; None where it is not at
            hand.
        with_report: False: a release without the study's report, and without the tables that it
            is made from.
    """

    database: Path
    study: str
    out: Path
    authors: tuple[str, ...] = ()
    url: str | None = None
    secrets: Mapping[str, tuple[int | None, bytes]] | None = None
    without_policies: tuple[str, ...] = ()
    invitations: Mapping[str, Invitation] | None = None
    policy_folder: Path | None = None
    with_report: bool = False
    with_answers: bool = False
    with_free_text: bool = False


def request_of(
    study: str,
    out: Path,
    database: Path,
    folder: Folder,
    authors: tuple[str, ...] = (),
    url: str | None = None,
    without_policies: tuple[str, ...] = (),
    with_answers: bool = False,
    with_free_text: bool = False,
) -> ReleaseRequest:
    """What releases a study with its report, from a database and its folder.

    Raises:
        StudyError: As `Folder`.
    """
    return ReleaseRequest(
        database=database,
        study=study,
        out=out,
        authors=authors,
        url=url,
        secrets=folder.known_secrets(),
        without_policies=without_policies,
        invitations=Invitations(folder).of(study) or None,
        policy_folder=folder.root / study / FOLDER,
        with_report=True,
        with_answers=with_answers,
        with_free_text=with_free_text,
    )


class UniquePeople(NamedTuple):
    """How many people in a release are the only ones with their answers and language.

    Attributes:
        of: Of so many who answered.
        texts: Free texts in the release.
    """

    people: int
    of: int
    texts: int


@dataclass(frozen=True)
class WrittenRelease:
    """A release that was written.

    Attributes:
        manifest_hash: SHA-256 (hex) of its manifest.
        signer: Fingerprint of its key.
    """

    header: ReleaseHeader
    manifest_hash: str
    signer: str
    unique: UniquePeople


def build_release(
    request: ReleaseRequest, advance: Advance = lambda done, total: None, bar: ProgressBar = no_bar
) -> WrittenRelease:
    """Verify a study and write its release to `request.out`.

    Args:
        advance: Called with (episodes verified or written, how many in all).
        bar: Of what the report takes.

    Raises:
        ReleaseError: If the study is unknown or open, an episode fails, the folder is there
            already, or a library is missing.
        PolicyError: If the file of a policy that the report compares is lost.
    """
    check_libraries()
    if request.out.exists() and (not request.out.is_dir() or any(request.out.iterdir())):
        raise ReleaseError(
            f"{request.out} is there already: a release is written into a new folder; choose another --out"
        )
    # all of it is read at one moment, whatever a server writes meanwhile
    with reading(request.database) as source:
        header, closed = _new_header(source, request)
        total = 2 * _count_episodes(source, request.study)
        _verify_study(source, request, advance, total)
        with _whole_folder(request.out) as folder:
            key = secrets.token_bytes(32)
            target, arrivals = folder / BUNDLE_DATABASE, header.arrivals
            answers = _released_answers(source, request, header.protocol)
            left = write_pseudonymized(
                source, request.study, target, key, closed, arrivals, answers
            )
            unique = _unique(target)
            header = _write_report(folder, replace(header, left_out=left), request, bar)
            written = _write_files(folder, header, lambda done: advance(total // 2 + done, total))
            signing_key = signing.signing_key(request.database)
            manifest_hash = write_manifest(folder, *written, signing_key)
    _note_published(request, written[0], manifest_hash)
    signer = signing.fingerprint(signing.public_pem(signing_key))
    return WrittenRelease(written[0], manifest_hash, signer, unique)


def _released_answers(
    source: sqlite3.Connection, request: ReleaseRequest, protocol: Protocol
) -> ReleasedAnswers:
    """What the release holds of answers: their counts, and more on request."""
    study = request.study
    numbers = [AnswerRow(**row) for row in rows(source, OF_PEOPLE.format("answers"), study)]
    texts = [FreeTextRow(**row) for row in rows(source, OF_PEOPLE.format("free_texts"), study)]
    noted = rows(source, "SELECT value FROM meta WHERE name = ?", f"{ANSWERS}|{study}")
    counts = known_counts(protocol.blocks, numbers, texts, noted[0]["value"] if noted else None)
    return ReleasedAnswers(to_json(counts), request.with_answers, request.with_free_text)


def _unique(database: Path) -> UniquePeople:
    """Count the people in a release's database who are unique by what it says of them."""
    people = (
        "SELECT id, json_extract(settings, '$.language') FROM participants WHERE kind = 'human'"
    )
    sql = """SELECT a.* FROM answers a JOIN participants p ON p.id = a.participant_id
        WHERE p.kind = 'human' ORDER BY block, turn, question, part"""
    answers = defaultdict[str, list[tuple[object, ...]]](list)
    with reading(database) as conn:
        languages = dict(conn.execute(people))
        for row in rows(conn, sql):
            answer = AnswerRow(**row)
            content = (answer.block, answer.turn, answer.question, answer.part, answer.answer)
            answers[answer.participant_id].append(content)
        (texts,) = conn.execute("SELECT count(words) FROM free_texts").fetchone()
    alike = Counter((languages[ident], *contents) for ident, contents in answers.items())
    return UniquePeople(sum(count == 1 for count in alike.values()), len(answers), texts)


def _write_report(
    folder: Path, header: ReleaseHeader, request: ReleaseRequest, bar: ProgressBar
) -> ReleaseHeader:
    """Write the report, made from the release's own database.

    The files of the policies go into the release; costs are cached next to the database that it is
    made from.

    Returns:
        The header with what the report adds to it.
    """
    with closing(Reader.open(folder / BUNDLE_DATABASE)) as reader:
        data = load(reader, header.study).with_policies_in(folder / FOLDER)
        played = [synthetic for synthetic in REPORT_STEMS if has_played(data, synthetic)]
        expert = data.protocol.environment.expert
        compared, without = compared_policies(data.protocol), request.without_policies
        names = [name for name in compared if name not in without]
        episodes: tuple[PolicyEpisode, ...] = ()
        costs: list[CostRow] = []
        if request.with_report:
            files = PolicyFiles.of(header.protocol, request.policy_folder)
            files.copy_to(folder / FOLDER, sorted({*names, *([expert] if expert else [])}))
        if request.with_report and played:
            episodes = play_compared(data, closed_seeds(data), names, bar)
        cache = cost_cache(request.database)
        for synthetic in (played or [False]) if request.with_report else ():
            is_judged = False in played and not synthetic
            costs_by_group = costs_of_people(reader, data, bar, cache) if is_judged else {}
            report = make_report(reader, data, episodes, synthetic, bar, costs_by_group)
            for name, content in report_files(report).items():
                (folder / name).write_bytes(content)
        if expert and request.with_report and False in played and reason_not_judged(data) is None:
            estimator = study_estimator(data, cache)
            with bar("cost of each move") as advance:
                costs = list(cost_rows(reader, data, judged_trials(data), estimator, advance))
            header = replace(header, expert_hash=data.policy_files.hashes.get(expert, ""))
    _write_derived(folder / BUNDLE_DATABASE, data, episodes, costs)
    return header


def _new_header(
    conn: sqlite3.Connection, request: ReleaseRequest
) -> tuple[ReleaseHeader, tuple[int | None, str | None]]:
    studies = rows(conn, "SELECT * FROM series WHERE name = ?", request.study)
    if not studies:
        names = [row["name"] for row in rows(conn, "SELECT name FROM series ORDER BY name")]
        raise ReleaseError(
            f"nobody has joined a study {request.study!r} in {request.database}; "
            f"studies in it: {', '.join(names) or 'none'}"
        )
    row = studies[0]
    protocol = _protocol(request.study, row["protocol"])
    if protocol.dry_run_of is not None:
        raise ReleaseError(
            f"the study {request.study!r} is a dry run of {protocol.dry_run_of!r}, whose figures were seen at once: it is "
            "never released; its people are counted in that study's release"
        )
    closed = (row["closed_ms"], row["secret"])
    if closed[0] is None and request.secrets and request.study in request.secrets:
        closed_ms, secret = request.secrets[request.study]
        closed = (closed_ms, secret.hex()) if closed_ms is not None else (None, None)
        running = """SELECT 1 FROM series_episodes x JOIN episodes e ON e.id = x.episode_id
            WHERE x.series = ? AND e.ended_ms IS NULL"""
        if closed_ms is not None and rows(conn, running, request.study):
            raise ReleaseError(UNNOTED.format(request.study, request.database))
    if closed[0] is None and row["secret_kept_ms"] is not None:
        raise ReleaseError(SECRET_KEPT.format(request.study))
    if closed[0] is None or closed[1] is None:
        raise ReleaseError(
            f"the study {request.study!r} is still open and a release would give its instances away: close it first with "
            f"`humanplay study close {request.study}`"
        )
    _check_erased(conn, request.study)
    last = latest_release(conn, request.study)
    entries, head = chain.head(conn)
    return ReleaseHeader(
        study=request.study,
        protocol=protocol,
        protocol_hash=row["protocol_hash"],
        commitment=row["commitment"],
        secret=closed[1],
        version=last.version + 1 if last else 1,
        released=utc(now_ms()),
        software_version=version("humanplay"),
        supersedes=_superseded(last) if last else None,
        authors=request.authors or (f"The operators of the study {request.study}",),
        url=request.url,
        chain_head=head or None,
        chain_entries=entries,
        without_policies=request.without_policies,
        arrivals=count_arrivals(conn, request.study, request.invitations),
    ), closed


def _check_erased(conn: sqlite3.Connection, study: str) -> None:
    """Check that nobody is left who asked to be erased.

    What is published cannot be called back.
    """
    people = rows(conn, "SELECT id FROM participants WHERE study = ? ORDER BY joined_ms", study)
    asking = [participant_label(row["id"]) for row in people if asks_erasure(conn, row["id"])]
    if asking:
        number = counted(len(asking), "participant")
        commands = ", ".join(f"`humanplay forget {label}`" for label in asking)
        raise ReleaseError(f"{number} of {study!r} asked to be erased: run {commands} first")


def _protocol(study: str, text: str) -> Protocol:
    try:
        return parse_protocol(json.loads(text))
    except (ValueError, StudyError) as error:
        raise ReleaseError(
            f"no release: the protocol of the study {study!r} cannot be read: {error}"
        ) from error


def _superseded(last: ReleaseRow) -> SupersededRelease:
    reason = FORGOTTEN_REASON if last.outdated_ms is not None else "a later release"
    return {"version": last.version, "manifest_sha256": last.manifest_hash, "reason": reason}


def _count_episodes(conn: sqlite3.Connection, study: str) -> int:
    sql = """SELECT count(*) FROM episodes e JOIN series_episodes s ON s.episode_id = e.id
        JOIN participants p ON p.id = s.participant_id WHERE p.study = ? AND e.ended_ms IS NOT NULL"""
    return int(conn.execute(sql, [study]).fetchone()[0])


def _verify_study(
    source: sqlite3.Connection, request: ReleaseRequest, advance: Advance, total: int
) -> None:
    known_secrets = {name: secret for name, (_, secret) in (request.secrets or {}).items()}
    verification = verify_moment(
        source, request.database, lambda done, _: advance(done, total), known_secrets, request.study
    )
    if verification.findings:
        more = (
            f" and {len(verification.findings) - 1} more" if len(verification.findings) > 1 else ""
        )
        raise ReleaseError(
            f"no release: {verification.findings[0]}{more}; `humanplay verify` lists everything that is not as it was recorded"
        )


def _write_files(
    folder: Path, header: ReleaseHeader, advance: Callable[[int], None]
) -> tuple[ReleaseHeader, dict[str, int]]:
    """Write everything but the manifest.

    Returns:
        The header with its counts, and the rows by file.
    """
    (folder / QUERIES.name).write_bytes(QUERIES.read_bytes())
    (folder / "minari").mkdir()
    minari = MinariWriter(folder / "minari", header)
    outcomes = Counter[str]()
    with reading(folder / BUNDLE_DATABASE) as conn:
        for done, (row, episode) in enumerate(released_episodes(conn), 1):
            minari.add(row, episode)
            outcomes[row["outcome"]] += 1
            advance(done)
        count = "SELECT count(*) FROM"
        counts = {table: conn.execute(f"{count} {table}").fetchone()[0] for table in COUNTED_TABLES}
        written = write_tables(folder, conn)
        people = _counted_people(conn)
    minari.close()
    header = replace(
        header,
        rows=counts,
        outcomes=dict(outcomes),
        attestation=people["attestation"],
        withdrawn=people["withdrawn"],
        frozen_at=people["frozen_at"],
        first_came_at=people["first_came_at"],
    )
    named = {dataset_id(header, driver): count for driver, count in minari.episodes.items()}
    write_documents(folder, header, named, minari.without_moves)
    write_croissant(folder, header, citation(header), licence_url(header.protocol.data_licence))
    files = {f"minari/{name}/data/main_data.hdf5": count for name, count in named.items()}
    return header, {**written, **files, BUNDLE_DATABASE: sum(counts.values())}


def _write_derived(
    database: Path, data: StudyData, episodes: Sequence[PolicyEpisode], costs: Sequence[CostRow]
) -> None:
    """Write the tables that only a bundle's database has.

    An import leaves them behind, and the next release makes them anew.
    """
    names = list(dict.fromkeys(episode.policy for episode in episodes))
    ended = [trial for trial in data.trials if trial.ended_ms is not None]
    cohort = people_of(data)
    people = {person.id: person for person in cohort.people}
    derived: dict[str, Iterable[tuple[SqlValue, ...]]] = {
        "participant_statuses": list(statuses(data, cohort).items()),
        "input_summaries": [
            (
                trial.id,
                json.dumps(list(trial.labels)),
                _lowest(data, people.get(trial.participant), trial),
                trial.pause_share,
                trial.active_ms,
            )
            for trial in ended
        ],
        "policy_episodes": [
            (names.index(episode.policy), *_policy_row(episode, data.protocol))
            for episode in episodes
        ],
        "move_costs": map(astuple, costs),
        "answer_counts": [(place, *row) for place, row in enumerate(_count_rows(data.answers))],
    }
    with closing(sqlite3.connect(database, isolation_level=None)) as conn, transaction(conn):
        for table in TABLES.values():
            for statement in table.statements("bundle database"):
                conn.execute(statement)
        for name, values in derived.items():
            conn.executemany(TABLES[name].insert("bundle database"), values)


def _count_rows(answers: Sequence[AnswerCounts]) -> Iterator[tuple[str | float | None, ...]]:
    for counts in answers:
        mean_and_sd = counts.mean, counts.sd
        for cell in counts.cells:
            yield (*counts.key, counts.asked, cell.answers, cell.people, *mean_and_sd)
        if counts.people is None:
            yield (*counts.key, counts.asked, None, None, *mean_and_sd)


def _lowest(data: StudyData, person: Person | None, trial: Trial) -> str | None:
    """Why a person's ranked episode counts at the lowest score; None if it does not."""
    if person is None or trial.phase != "ranked":
        return None
    return lowest_reason(data, person, trial)


def _policy_row(episode: PolicyEpisode, protocol: Protocol) -> tuple[str | int | float | None, ...]:
    environment, config = protocol.environment, protocol.env_config
    record, letters = episode.replay(environment, config).record(), initials(environment)
    return (
        episode.policy,
        episode.policy_hash,
        episode.terrain,
        episode.seed,
        record.outcome,
        record.steps,
        record.steps if record.outcome in environment.successes else config.limit,
        record.score,
        "".join(letters[action] for action in episode.actions),
        episode.trajectory_hash,
    )


class _CountedPeople(TypedDict):
    """What the datasheet says of the people in a release, as fields of its header."""

    attestation: dict[str, int]
    withdrawn: int
    frozen_at: str
    first_came_at: str


def _counted_people(conn: sqlite3.Connection) -> _CountedPeople:
    """Count the people in a release."""
    levels = """SELECT coalesce(e.attestation, '') AS level, count(*) AS n FROM episodes e
        JOIN series_episodes s ON s.episode_id = e.id JOIN participants p ON p.id = s.participant_id
        WHERE s.phase = 'ranked' AND p.kind = 'human' GROUP BY 1"""
    sql = """SELECT (SELECT frozen_ms FROM series) AS frozen, (SELECT min(joined_ms) FROM participants) AS came,
        (SELECT count(*) FROM participants WHERE kind = 'human' AND stage = 'withdrawn') AS withdrawn"""
    (counts,) = rows(conn, sql)
    return {
        "attestation": {row["level"]: row["n"] for row in rows(conn, levels)},
        "withdrawn": counts["withdrawn"],
        "frozen_at": utc(counts["frozen"]),
        "first_came_at": "" if counts["came"] is None else utc(counts["came"]),
    }


@contextmanager
def _whole_folder(out: Path) -> Iterator[Path]:
    """Make a folder that gets its name when the block ends well; else it is gone."""
    try:
        with replace_whole(out) as unfinished:
            unfinished.mkdir(parents=True)
            yield unfinished
    except (OSError, sqlite3.Error) as error:
        reason = (error.strerror or str(error)).lower() if isinstance(error, OSError) else error
        raise ReleaseError(f"cannot write {out}: {reason}; choose another --out") from error


def _note_published(request: ReleaseRequest, header: ReleaseHeader, manifest_hash: str) -> None:
    """Record the release in the database, so that the next one knows its number.

    A server may be running.
    """
    row = ReleaseRow(header.study, header.version, manifest_hash, now_ms())
    try:
        with writing(request.database) as conn:
            note_release(conn, row)
    except StoreError as error:
        raise StoreError(
            f"{request.out} is written, but not noted ({error}): the next release will have the same number"
        ) from error
