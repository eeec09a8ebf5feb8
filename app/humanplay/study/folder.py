"""The folder of studies, DATABASE-studies beside a database: a draft that can be edited, frozen for good, closed at the end.

    NAME/protocol.json   the protocol; what freezing fixed may not change any more
    NAME/draft.json      the protocol as it was before freezing filled its texts in
    NAME/frozen.json     its hash, the commitment to the secret, when and by what it was frozen
    NAME/secret          the study's secret (hex): whoever reads it knows every terrain
    NAME/secret_kept.json   since when nobody can take part while the secret is kept; only where it was closed so
    NAME/closed.json     the secret revealed, and when
    NAME/outcomes.json   see `humanplay.study.outcomes`
    NAME/kept_out.json   see `humanplay.study.kept_out`
    NAME/policies/       see `humanplay.study.policy_files`
    NAME/invitations.json   see `humanplay.study.invitations`
    played/              see `humanplay.study.terrain_spread`

`frozen.json` is written last, so a freeze cut short leaves a draft. A server sees a freeze or a close at the next use.
"""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import count
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Literal

from humanplay.db.file import studies_beside
from humanplay.db.study_rows import SeriesRow
from humanplay.study.files import iso, ms_of, now_ms, read_object, stamp_of, text_of, write_object
from humanplay.study.kept_out import let_in_again
from humanplay.study.outcomes import check_complete, check_texts, read_texts
from humanplay.study.policy_files import FOLDER, PolicyFiles, record_files
from humanplay.study.protocol import (
    LONGEST_NAME,
    NAME,
    PLANNED,
    DraftStudyError,
    Protocol,
    StudyError,
    UnknownStudyError,
    canonical,
    canonical_json,
    parse_protocol,
    protocol_hash,
)
from humanplay.study.seeds import (
    TUTORIAL_SEED,
    SeedLabel,
    balanced_order,
    commitment,
    drawn_arm,
    seed,
)
from humanplay.study.templates import fill
from humanplay.study.texts import ERASURE
from humanplay.task import PolicyError

__all__ = ["Folder", "Study", "StudyError"]

Status = Literal["draft", "open", "secret kept", "closed"]
"""Of a study whose secret is kept nobody can take part any more, and its terrains stay secret until it is closed again."""
Advance = Callable[[int, int], None]


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
    """Return how many different first frames BEGINNINGS seeds have: few, where who knows one instance knows others."""
    environment, config = protocol.environment, protocol.env_config
    found = set()
    for drawn in range(BEGINNINGS):
        terrain, start = environment.instance(config, drawn)
        cause = SimpleNamespace(config=config, seed=drawn, terrain=terrain, start=start)
        found.add(environment.replay(cause).view().frame(""))
    return len(found)


class Folder:
    """All studies under one root; the root need not exist."""

    def __init__(self, root: Path | str) -> None:
        self.root = Path(root)
        self._known: dict[str, tuple[object, Study]] = {}

    @classmethod
    def beside(cls, database: Path) -> Folder:
        """The studies that are played in a database."""
        return cls(studies_beside(database))

    def path(self, name: str) -> Path:
        """Return where a study lies; StudyError when no study can be called so."""
        if not re.fullmatch(NAME, name):
            raise UnknownStudyError(
                f"a study's name is 1 to 40 small letters, digits and dashes, beginning with a letter or digit; got {name!r}"
            )
        return self.root / name

    def names(self) -> list[str]:
        """Return the names of all studies, drafts too."""
        if not self.root.is_dir():
            return []
        found = (path.name for path in self.root.iterdir() if (path / "protocol.json").is_file())
        return sorted(name for name in found if re.fullmatch(NAME, name))

    def status(self, name: str) -> Status:
        """Return how far a study is; StudyError when there is none."""
        path = self._existing(name)
        if not (path / "frozen.json").exists():
            return "draft"
        if (path / "closed.json").exists():
            return "closed"
        return "secret kept" if (path / "secret_kept.json").exists() else "open"

    def draft(self, name: str) -> Protocol:
        """Return a study's protocol as its file stands, frozen or not; StudyError when it does not hold."""
        raw = read_object(self._existing(name) / "protocol.json")
        protocol = parse_protocol(raw)
        if protocol.name != name:
            what = f"the protocol in {self.path(name)} names the study {protocol.name!r}"
            raise StudyError(f"{what}: rename one of the two")
        return protocol

    def study(self, name: str) -> Study:
        """Return a frozen study, read again when its files have changed; StudyError for a draft or a thawed protocol."""
        path = self._existing(name)
        files = [f"{each}.json" for each in ("protocol", "frozen", "secret_kept", "closed")]
        stamp = tuple(stamp_of(path / each) for each in (*files, "secret"))
        known = self._known.get(name)
        if known is not None and known[0] == stamp:
            return known[1]
        study = self._load(name, path)
        self._known[name] = (stamp, study)
        return study

    def create(self, protocol: Protocol) -> Path:
        """Write a new draft and return the path of its protocol.json; StudyError when there is a study of that name."""
        path = self.path(protocol.name)
        if (path / "protocol.json").exists():
            raise StudyError(
                f"there is a study {protocol.name!r} already: edit {path / 'protocol.json'} or choose another name"
            )
        write_object(path / "protocol.json", protocol.model_dump(mode="json"))
        return path / "protocol.json"

    def begin_dry_run(self, name: str) -> Path:
        """Write a draft of a dry run of a study, and return its path."""
        template = self._template(name)
        if template.dry_run_of is not None:
            raise StudyError(
                f"{name!r} is a dry run of {template.dry_run_of!r}: begin another one of that"
            )
        marks = (f"-dry-{number}" for number in count(1))
        names = (name[: LONGEST_NAME - len(mark)] + mark for mark in marks)
        dry = next(free for free in names if not self.path(free).exists())
        fields = template.model_dump(mode="json", exclude_unset=True)
        changed = {"name": dry, "dry_run_of": name, "title": f"{template.title} (dry run)"}
        return self.create(parse_protocol({**fields, **changed}))

    def freeze(
        self,
        name: str,
        advance: Advance = lambda done, total: None,
        draw: Callable[[int], bytes] = secrets.token_bytes,
        planned: Mapping[str, object] = MappingProxyType({}),
        rehearse: Callable[[Protocol], str] | None = None,
    ) -> Study:
        """Freeze a study and return it: fill its texts, hash the protocol, draw the secret, check that terrains are solvable.

        advance  called with (terrains drawn, of how many)
        draw     gives so many random bytes for the secret
        planned  assumptions and power, by the protocol's fields (PLANNED)
        rehearse  does with an episode what the study will, and says so; of an environment that was examined
        """
        path, template = self.path(name), self._template(name)
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
        write_object(path / "draft.json", template.model_dump(mode="json", exclude_unset=True))
        write_object(path / "protocol.json", protocol.model_dump(mode="json"))
        frozen = {
            "protocol_hash": study.protocol_hash, "commitment": study.commitment, "frozen_at": iso(now),
            "core_version": environment.version, "software_version": version("humanplay"),
            "examined": examined,
        }  # fmt: skip
        write_object(path / "frozen.json", frozen)
        return self.study(name)

    def filled(self, name: str) -> Protocol:
        """The draft as freezing would fix it, before it is planned; StudyError where something is missing."""
        if self.status(name) != "draft":
            raise StudyError(f"the study {name!r} is frozen already; begin another one for another")
        path = self.path(name)
        protocol = fill(self._template(name))  # every field set from now on
        unanswered = protocol.declarations.unanswered()
        if unanswered:
            raise StudyError(
                f"the study {name!r} declares nothing as {', '.join(unanswered)}: write each into declarations of "
                f'{path / "protocol.json"} (an honest "none" is an answer, TODO is not), or begin the study with '
                "`humanplay study new --declarations FILE`"
            )
        texts = read_texts(path)
        check_texts(protocol, texts)
        check_complete(protocol, texts)
        if protocol.keep_episodes_when_forgotten and ERASURE in protocol.consent.text:
            raise StudyError(
                f"the consent of the study {name!r} promises that what was played is erased on request, but "
                "keep_episodes_when_forgotten is true: let the consent say what is kept, or set it to false"
            )
        environment = protocol.environment
        if protocol.core_version != environment.version:
            raise StudyError(
                f"the protocol is for core version {protocol.core_version}, this is version {environment.version}: "
                "write the new one into protocol.json, or install the release that has the old one"
            )
        return protocol

    def close(self, name: str, keeps_secret: bool = False) -> Study:
        """Close a study and return it: nobody can join or go on, and its secret is revealed.

        keeps_secret  until it is closed again without it
        """
        study = self.check_closable(name, keeps_secret)
        closed_at = iso(now_ms())
        if keeps_secret:
            write_object(self.path(name) / "secret_kept.json", {"closed_at": closed_at})
        else:
            told = {"secret": study.secret.hex(), "closed_at": closed_at}
            write_object(self.path(name) / "closed.json", told)
        let_in_again(self.path(name))
        return self.study(name)

    def check_closable(self, name: str, keeps_secret: bool = False) -> Study:
        """Return a study that `close` would close; StudyError for any other."""
        study = self.study(name)
        if not study.is_open:
            why = ", and its secret is known" if keeps_secret else ""
            since = iso(study.closed_ms or 0)
            raise StudyError(f"the study {name!r} is closed already, since {since}{why}")
        if keeps_secret and study.keeps_secret:
            raise StudyError(f"the study {name!r} is closed and its secret kept already")
        return study

    def known_secrets(self) -> dict[str, tuple[int | None, bytes]]:
        """Return (closed_ms or None while open, secret) by study; drafts and damaged studies are left out."""
        found: dict[str, tuple[int | None, bytes]] = {}
        for name in self.names():
            try:
                study = self.study(name)
            except StudyError:  # `study show` says what is wrong with it
                continue
            found[name] = (study.closed_ms, study.secret)
        return found

    def _template(self, name: str) -> Protocol:
        """Return a draft with its placeholders, also where a freeze was cut short after it had filled them in."""
        draft, kept = self.draft(name), self.path(name) / "draft.json"
        if kept.is_file():
            template = parse_protocol(read_object(kept))
            written = {field: getattr(template, field) for field in ("policy_hashes", *PLANNED)}
            if fill(template) == draft.model_copy(update=written):
                return template
        return draft

    def _existing(self, name: str) -> Path:
        path = self.path(name)
        if not (path / "protocol.json").is_file():
            known = ", ".join(self.names()) or "none"
            raise UnknownStudyError(
                f"no study {name!r} in {self.root}; there are: {known} (`humanplay study new` begins one)"
            )
        return path

    def _load(self, name: str, path: Path) -> Study:
        if not (path / "frozen.json").exists():
            way_out = f"freeze it first with `humanplay study freeze {name}`"
            raise DraftStudyError(f"the study {name!r} is a draft: {way_out}")
        frozen, raw = read_object(path / "frozen.json"), read_object(path / "protocol.json")
        if hashlib.sha256(canonical_json(raw)).hexdigest() != frozen.get("protocol_hash"):
            raise StudyError(
                f"thawed protocol: {path / 'protocol.json'} is not what was frozen at {frozen.get('frozen_at')}; "
                "put the frozen text back, or begin another study"
            )
        closed = read_object(path / "closed.json") if (path / "closed.json").exists() else None
        kept_secret = (
            read_object(path / "secret_kept.json") if (path / "secret_kept.json").exists() else None
        )
        try:
            digits = text_of(closed, "secret") if closed else (path / "secret").read_text().strip()
            secret = bytes.fromhex(digits)
            closed_ms = ms_of(text_of(closed, "closed_at")) if closed else None
            secret_kept_ms = ms_of(text_of(kept_secret, "closed_at")) if kept_secret else None
            frozen_ms = ms_of(text_of(frozen, "frozen_at"))
            committed = text_of(frozen, "commitment")
            hash_ = text_of(frozen, "protocol_hash")
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise StudyError(
                f"the files of the study {name!r} are damaged: {error}; restore {path} from a backup"
            ) from error
        if commitment(secret) != committed:
            raise StudyError(
                f"the secret of the study {name!r} is not the one committed to: restore {path} from a backup"
            )
        protocol = parse_protocol(raw)
        files = PolicyFiles.of(protocol, path / FOLDER)
        return Study(
            name,
            protocol,
            hash_,
            committed,
            frozen_ms,
            closed_ms=closed_ms,
            secret=secret,
            secret_kept_ms=secret_kept_ms,
            examined=str(frozen.get("examined", "")),
            policy_files=files,
        )


def _record_policies(protocol: Protocol, folder: Path) -> dict[str, str]:
    """Keep the files of a protocol's policies in a folder and return their hashes; StudyError when one cannot be played.

    A hash that the draft gives already must be that of the file.
    """
    shown, environment = protocol.debrief_policy, protocol.environment
    named = {*protocol.policies, *([shown] if shown is not None else [])}
    for policy in named:
        try:
            environment.policies.load(policy, protocol.env_config)
        except PolicyError as error:
            raise StudyError(f"the policy {policy!r} cannot be loaded: {error}") from error
    kept = named if environment.expert is None else {*named, environment.expert}
    found = record_files(kept, folder, environment.policies)
    for policy, given in protocol.policy_hashes.items():
        if found.get(policy) != given:
            raise StudyError(
                f"policy_hashes gives {policy!r} the SHA-256 {given}, its file has {found.get(policy, 'none')}: "
                "put that file there, or leave the field empty, and freezing writes it"
            )
    return found


def _check_terrains(study: Study, advance: Advance) -> None:
    """Draw every terrain; StudyError when one cannot be solved."""
    seeds = [TUTORIAL_SEED, *study.seeds()]
    for number, each in enumerate(seeds, 1):
        try:
            study.protocol.environment.instance(study.protocol.env_config, each)
        except ValueError as error:
            raise StudyError(
                "the level and size have instances that cannot be solved: choose another level or size"
            ) from error
        advance(number, len(seeds))
