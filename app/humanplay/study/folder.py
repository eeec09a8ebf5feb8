"""The folder of studies beside a database; a study is a draft, frozen, or closed.

The studies of lab.db lie in lab.db-studies:

    NAME/protocol.toml   the draft, see `humanplay.study.draft`; nothing reads it once the study is frozen
    NAME/protocol.json   the frozen protocol, in canonical form
    NAME/frozen.json     its hash, the commitment to the secret, the time and the software's version
    NAME/secret          the study's secret (hex): whoever reads it knows every terrain
    NAME/secret_kept.json   when it was closed with its secret kept; absent otherwise
    NAME/closed.json     the secret revealed, and when
    NAME/outcomes.json   see `humanplay.study.outcomes`
    NAME/kept_out.json   see `humanplay.study.kept_out`
    NAME/texts/          see `humanplay.study.translation`
    NAME/policies/       see `humanplay.study.policy_files`
    NAME/invitations.json   see `humanplay.study.invitations`
    played/              see `humanplay.study.terrain_spread`

`frozen.json` is written last, so an interrupted freeze leaves a draft. A running server sees that a
study was frozen or closed when it next uses it.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import count
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Literal

from humanplay.db.file import studies_beside
from humanplay.db.study_rows import SeriesRow
from humanplay.study.draft import FILE as DRAFT
from humanplay.study.draft import draft_text, read_draft
from humanplay.study.files import (
    iso,
    ms_of,
    now_ms,
    read_bytes,
    read_object,
    stamp_of,
    text_of,
    write_bytes,
    write_object,
)
from humanplay.study.kept_out import let_in_again
from humanplay.study.outcomes import check_complete, check_texts, read_texts
from humanplay.study.policy_files import FOLDER, PolicyFiles, record_files
from humanplay.study.protocol import (
    LONGEST_NAME,
    NAME,
    DraftStudyError,
    Protocol,
    StudyError,
    UnknownStudyError,
    canonical,
    parse_protocol,
    protocol_hash,
)
from humanplay.study.questions import NONE
from humanplay.study.seeds import (
    TUTORIAL_SEED,
    SeedLabel,
    balanced_order,
    commitment,
    drawn_arm,
    seed,
)
from humanplay.study.texts import ERASURE
from humanplay.study.translation import localized, with_texts
from humanplay.study.wording import translated
from humanplay.task import PolicyError

__all__ = ["Folder", "Study", "StudyError"]

Status = Literal["draft", "open", "secret kept", "closed"]
"""`secret kept`: nobody can take part any more, and the terrains stay secret until it is closed."""
Advance = Callable[[int, int], None]
"""Is called with how much is done, and of how much."""

SECRET_KEPT = (
    "{0!r} is closed and its secret kept: nothing of its instances is shown, released or exported before "
    "`humanplay study close {0}` reveals it"
)


@dataclass(frozen=True)
class Study:
    """A frozen study.

    closed_ms   milliseconds since 1970; None while it is open
    secret      32 bytes; the operator alone may see it until the study is closed
    policy_files  of the policies that it compares with
    secret_kept_ms  since when nobody can take part while the secret is kept; None where it is not
    examined    what was compared before it was frozen, a sentence; empty if nothing needed to be
    """

    name: str
    protocol: Protocol
    protocol_hash: str
    commitment: str
    frozen_ms: int
    closed_ms: int | None
    secret: bytes = field(repr=False)
    policy_files: PolicyFiles = field(default_factory=PolicyFiles, repr=False, compare=False)
    secret_kept_ms: int | None = None
    examined: str = ""

    @property
    def is_open(self) -> bool:
        """Whether the study is not closed: its terrains are secret."""
        return self.closed_ms is None

    @property
    def is_running(self) -> bool:
        """Whether people can go on."""
        return self.closed_ms is None and self.secret_kept_ms is None

    @property
    def keeps_secret(self) -> bool:
        """Whether nobody can take part any more and its terrains are secret still."""
        return self.is_open and self.secret_kept_ms is not None

    @property
    def status(self) -> Status:
        """How far it is: `open`, `secret kept` or `closed`."""
        if self.is_running:
            return "open"
        return "secret kept" if self.is_open else "closed"

    def row(self) -> SeriesRow:
        """Return what the database keeps of the study."""
        secret = None if self.is_open else self.secret.hex()
        protocol = canonical(self.protocol).decode()
        return SeriesRow(
            self.name,
            protocol,
            self.protocol_hash,
            self.commitment,
            self.frozen_ms,
            closed_ms=self.closed_ms,
            secret=secret,
            secret_kept_ms=self.secret_kept_ms,
        )

    def seed(self, label: SeedLabel, i: int) -> int:
        """Return the seed of a terrain of this study."""
        return seed(self.secret, self.protocol_hash, label, i)

    def balanced_order(self, group: str, number: int) -> list[int]:
        """Return the order of the ranked terrains for participant `number` of a group."""
        return balanced_order(self.secret, self.protocol_hash, group, number, self.protocol.ranked)

    def arm(self, group: str, number: int) -> str:
        """The name of the arm of who is `number` to be assigned in a group."""
        arms = self.protocol.arms
        return arms[drawn_arm(self.secret, self.protocol_hash, group, number, len(arms))].name

    def seeds(self) -> list[int]:
        """Return the seeds of all ranked terrains, then of all warm-up terrains."""
        ranked = [self.seed("ranked", i) for i in range(self.protocol.ranked)]
        return ranked + [self.seed("warm-up", i) for i in range(self.protocol.most_warm_up)]


BEGINNINGS = 20
"""Seeds whose beginnings are compared when a study is frozen."""


def beginnings(protocol: Protocol) -> int:
    """How many different first frames the first BEGINNINGS seeds have.

    If there are few, whoever knows one instance knows others.
    """
    environment, config = protocol.environment, protocol.env_config
    first_frames = set()
    for number in range(BEGINNINGS):
        terrain, start = environment.instance(config, number)
        cause = SimpleNamespace(config=config, seed=number, terrain=terrain, start=start)
        first_frames.add(environment.replay(cause).view().frame(""))
    return len(first_frames)


class Folder:
    """All studies under one root; the root need not exist."""

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root)
        self._studies: dict[str, tuple[object, Study]] = {}
        """Name -> the stamp of its files, and the study as read then."""

    @classmethod
    def beside(cls, database: Path) -> Folder:
        """The studies that are played in a database."""
        return cls(studies_beside(database))

    def path(self, name: str) -> Path:
        """Where a study lies; UnknownStudyError if no study can have this name."""
        if not re.fullmatch(NAME, name):
            raise UnknownStudyError(
                f"a study's name is 1 to 40 small letters, digits and dashes, beginning with a letter or digit; got {name!r}"
            )
        return self.root / name

    def names(self) -> list[str]:
        """The names of all studies, drafts too."""
        if not self.root.is_dir():
            return []
        names = (path.name for path in self.root.iterdir() if _is_study(path))
        return sorted(name for name in names if re.fullmatch(NAME, name))

    def status(self, name: str) -> Status:
        """How far a study is; UnknownStudyError if there is none."""
        path = self._existing(name)
        if not (path / "frozen.json").exists():
            return "draft"
        if (path / "closed.json").exists():
            return "closed"
        return "secret kept" if (path / "secret_kept.json").exists() else "open"

    def draft(self, name: str) -> Protocol:
        """A study's protocol, frozen or not; StudyError if it is not valid."""
        path = self._existing(name)
        is_draft = self.status(name) == "draft"
        fields = read_draft(path / DRAFT) if is_draft else read_object(path / "protocol.json")
        protocol = parse_protocol(fields)
        if protocol.name != name:
            raise StudyError(
                f"the protocol in {path} names the study {protocol.name!r}: rename one of the two"
            )
        return protocol

    def study(self, name: str) -> Study:
        """A frozen study, read again if its files have changed.

        Raises:
            DraftStudyError: If it has not been frozen.
            StudyError: If its files are damaged, or the protocol is not the frozen one.
        """
        path = self._existing(name)
        files = ("protocol.json", "frozen.json", "secret_kept.json", "closed.json", "secret")
        stamp = tuple(stamp_of(path / file) for file in files)
        stored_stamp, stored_study = self._studies.get(name, (None, None))
        if stored_study is not None and stored_stamp == stamp:
            return stored_study
        study = self._load(name, path)
        self._studies[name] = (stamp, study)
        return study

    def check_free(self, name: str) -> None:
        """StudyError if a study has this name, or none can have it."""
        path = self.path(name)
        _check_name(name)
        if _is_study(path):
            raise StudyError(
                f"there is a study {name!r} already: edit {path / DRAFT} or choose another name"
            )

    def create(self, protocol: Protocol) -> Path:
        """Write a new draft and return its path; StudyError if the name is taken."""
        self.check_free(protocol.name)
        path = self.path(protocol.name)
        write_bytes(path / DRAFT, draft_text(protocol).encode())
        return path / DRAFT

    def begin_dry_run(self, name: str) -> Path:
        """Write a draft of a dry run of a study, and return its path."""
        template = parse_protocol(read_draft(self._existing(name) / DRAFT))
        _check_name(name)
        if template.dry_run_of is not None:
            raise StudyError(
                f"{name!r} is a dry run of {template.dry_run_of!r}: begin another one of that"
            )
        marks = (f"-dry-{number}" for number in count(1))
        names = (name[: LONGEST_NAME - len(mark)] + mark for mark in marks)
        dry = next(free for free in names if not self.path(free).exists())
        fields = template.model_dump(mode="json", exclude_unset=True)
        changed = {"name": dry, "dry_run_of": name, "title": f"{template.title} (dry run)"}
        path = self.create(parse_protocol({**fields, **changed}))
        if (self.path(name) / "texts").is_dir():
            shutil.copytree(self.path(name) / "texts", path.parent / "texts")
        return path

    def freeze(
        self,
        name: str,
        advance: Advance = lambda done, total: None,
        draw: Callable[[int], bytes] = secrets.token_bytes,
        planned: Mapping[str, object] = MappingProxyType({}),
        rehearse: Callable[[Protocol], str] | None = None,
    ) -> Study:
        """Freeze a draft and return the study.

        Args:
            advance: Is called with how many terrains are drawn, and of how many.
            draw: Gives so many random bytes for the secret.
            planned: Field of PLANNED -> the assumption, the difference or the power.
            rehearse: Does with one episode what the study will, and describes it in a sentence;
                called only if the environment was examined.

        Raises:
            StudyError: If the draft is not complete, or an instance cannot be solved.
        """
        path = self.path(name)
        protocol = self.filled(name).model_copy(update=dict(planned))
        protocol = parse_protocol(protocol.model_dump(mode="json"))  # every field set
        environment = protocol.environment
        try:
            examined = environment.lock.check_exact(protocol.env_config)
        except ValueError as error:
            raise StudyError(f"the study {name!r} cannot be frozen: {error}") from error
        if examined and rehearse:
            examined = f"{examined}; {rehearse(protocol)}"
        hashes = _record_policies(protocol, path / FOLDER)
        protocol = protocol.model_copy(
            update={"policy_hashes": hashes, "lock": environment.lock.current()}
        )
        secret, now = draw(32), now_ms()
        fixed = protocol_hash(protocol), commitment(secret), now, None, secret
        study = Study(name, protocol, *fixed)
        _check_terrains(study, advance)
        write_object(path / "secret", secret.hex(), private=True)
        write_bytes(path / "protocol.json", canonical(protocol))
        frozen = {
            "protocol_hash": study.protocol_hash,
            "commitment": study.commitment,
            "frozen_at": iso(now),
            "core_version": environment.version,
            "software_version": version("humanplay"),
            "examined": examined,
        }
        write_object(path / "frozen.json", frozen)
        return self.study(name)

    def filled(self, name: str) -> Protocol:
        """The draft as freezing would fix it, before planning; StudyError if incomplete."""
        if self.status(name) != "draft":
            raise StudyError(f"the study {name!r} is frozen already; begin another one for another")
        path = self.path(name)
        protocol = with_texts(self.draft(name), path)  # every field set from now on
        unanswered = protocol.declarations.unanswered()
        if unanswered:
            raise StudyError(
                f"the study {name!r} declares nothing as {', '.join(unanswered)}: write each into declarations of "
                f'{self.path(name) / DRAFT} (an honest "none" is an answer, TODO is not), or begin the study with '
                "`humanplay study new --declarations FILE`"
            )
        if refusal := next(self.refusals(name, protocol), None):
            raise refusal
        return protocol

    def refusals(self, name: str, protocol: Protocol) -> Iterator[StudyError]:
        """Yield why freezing would refuse a draft that declares everything.

        protocol  the draft, with its texts filled in
        """
        texts = read_texts(self.path(name))
        for check in (check_texts, check_complete):
            try:
                check(protocol, texts)
            except StudyError as refusal:
                yield refusal
        if protocol.keep_episodes_when_forgotten and _promises_erasure(protocol):
            yield StudyError(
                f"the consent of the study {name!r} promises that what was played is erased on request, but "
                "keep_episodes_when_forgotten is true: let the consent say what is kept, or set it to false"
            )
        environment = protocol.environment
        if protocol.core_version != environment.version:
            yield StudyError(
                f"the protocol is for core version {protocol.core_version}, this is version {environment.version}: "
                f"write the new one into {DRAFT}, or install the release that has the old one"
            )

    def close(self, name: str, keeps_secret: bool = False) -> Study:
        """Close a study for participants, reveal its secret, and return it.

        Args:
            keeps_secret: Whether the secret stays secret until the study is closed again.
        """
        study = self.check_closable(name, keeps_secret)
        closed_at = iso(now_ms())
        if keeps_secret:
            write_object(self.path(name) / "secret_kept.json", {"closed_at": closed_at})
        else:
            closing = {"secret": study.secret.hex(), "closed_at": closed_at}
            write_object(self.path(name) / "closed.json", closing)
        let_in_again(self.path(name))
        return self.study(name)

    def check_closable(self, name: str, keeps_secret: bool = False) -> Study:
        """The study, if `close` would close it; StudyError otherwise."""
        study = self.study(name)
        if not study.is_open:
            since = iso(study.closed_ms or 0)
            secret = ", and its secret is known" if keeps_secret else ""
            raise StudyError(f"the study {name!r} is closed already, since {since}{secret}")
        if keeps_secret and study.keeps_secret:
            raise StudyError(f"the study {name!r} is closed and its secret kept already")
        return study

    def known_secrets(self) -> dict[str, tuple[int | None, bytes]]:
        """Name of a study -> (closed_ms, its secret); closed_ms is None while it is open.

        Drafts and damaged studies are left out.
        """
        secrets_by_name: dict[str, tuple[int | None, bytes]] = {}
        for name in self.names():
            try:
                study = self.study(name)
            except StudyError:  # `study show` says what is wrong with it
                continue
            secrets_by_name[name] = (study.closed_ms, study.secret)
        return secrets_by_name

    def _existing(self, name: str) -> Path:
        path = self.path(name)
        if not _is_study(path):
            names = ", ".join(self.names()) or "none"
            raise UnknownStudyError(
                f"no study {name!r} in {self.root}; there are: {names} (`humanplay study new` begins one)"
            )
        return path

    def _load(self, name: str, path: Path) -> Study:
        if not (path / "frozen.json").exists():
            raise DraftStudyError(
                f"the study {name!r} is a draft: freeze it first with `humanplay study freeze {name}`"
            )
        frozen, raw = read_object(path / "frozen.json"), read_bytes(path / "protocol.json")
        if hashlib.sha256(raw).hexdigest() != frozen.get("protocol_hash"):
            raise StudyError(
                f"thawed protocol: {path / 'protocol.json'} is not what was frozen at {frozen.get('frozen_at')}; "
                "put the frozen text back, or begin another study"
            )
        closed = read_object(path / "closed.json") if (path / "closed.json").exists() else None
        secret_kept = (
            read_object(path / "secret_kept.json") if (path / "secret_kept.json").exists() else None
        )
        try:
            digits = text_of(closed, "secret") if closed else (path / "secret").read_text().strip()
            secret = bytes.fromhex(digits)
            closed_ms = ms_of(text_of(closed, "closed_at")) if closed else None
            secret_kept_ms = ms_of(text_of(secret_kept, "closed_at")) if secret_kept else None
            frozen_ms = ms_of(text_of(frozen, "frozen_at"))
            stored_commitment = text_of(frozen, "commitment")
            stored_hash = text_of(frozen, "protocol_hash")
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise StudyError(
                f"the files of the study {name!r} are damaged: {error}; restore {path} from a backup"
            ) from error
        if commitment(secret) != stored_commitment:
            raise StudyError(
                f"the secret of the study {name!r} is not the one committed to: restore {path} from a backup"
            )
        protocol = parse_protocol(json.loads(raw))
        files = PolicyFiles.of(protocol, path / FOLDER)
        return Study(
            name,
            protocol,
            stored_hash,
            stored_commitment,
            frozen_ms,
            closed_ms=closed_ms,
            secret=secret,
            secret_kept_ms=secret_kept_ms,
            examined=str(frozen.get("examined", "")),
            policy_files=files,
        )


def _promises_erasure(protocol: Protocol) -> bool:
    """Whether the consent promises erasure (ERASURE), in any language on offer."""
    return any(
        promise in localized(protocol, language).consent.text
        for language in protocol.languages
        for promise in (ERASURE, translated(language, ERASURE) or ERASURE)
    )


def _check_name(name: str) -> None:
    """StudyError for the name NONE, which stands for no value in a draft."""
    if name == NONE:
        raise StudyError(f'a study cannot be called "{NONE}", which stands for no value in a draft')


def _is_study(path: Path) -> bool:
    """Whether a draft or a frozen study lies in a folder."""
    return (path / DRAFT).is_file() or (path / "frozen.json").is_file()


def _record_policies(protocol: Protocol, folder: Path) -> dict[str, str]:
    """Copy the policies' files into a folder, and return policy -> SHA-256 (hex).

    Raises:
        StudyError: If a policy cannot be played, or the draft has another hash for its file.
    """
    environment = protocol.environment
    policies = {*protocol.policies}
    if protocol.debrief_policy is not None:
        policies.add(protocol.debrief_policy)
    for policy in policies:
        try:
            environment.policies.load(policy, protocol.env_config)
        except PolicyError as error:
            raise StudyError(f"the policy {policy!r} cannot be loaded: {error}") from error
    if environment.expert is not None:
        policies.add(environment.expert)
    hashes = record_files(policies, folder, environment.policies)
    for policy, declared_hash in protocol.policy_hashes.items():
        if hashes.get(policy) != declared_hash:
            raise StudyError(
                f"policy_hashes gives {policy!r} the SHA-256 {declared_hash}, its file has {hashes.get(policy, 'none')}: "
                "put that file there, or leave the field empty, and freezing writes it"
            )
    return hashes


def _check_terrains(study: Study, advance: Advance) -> None:
    """Draw every terrain; StudyError if one cannot be solved."""
    environment, config = study.protocol.environment, study.protocol.env_config
    seeds = [TUTORIAL_SEED, *study.seeds()]
    for number, terrain_seed in enumerate(seeds, 1):
        try:
            environment.instance(config, terrain_seed)
        except ValueError as error:
            raise StudyError(
                "the level and size have instances that cannot be solved: choose another level or size"
            ) from error
        advance(number, len(seeds))
