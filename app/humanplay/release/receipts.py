"""The receipts of a closed evaluation of agents, and its opening: written, signed by the server's key, and checked anywhere.

    NAME/opening.json      the protocol and the secrets, from which every instance follows, and the chain of each card
    NAME/receipts/ID.json  what came of a card: every action and outcome, in a chain of hashes
    NAME/policies.json     the moves of policies on the same instances
    NAME/comparison.json   what `humanplay.report.agents` derives from these and from the study of people

A receipt alone proves that the holder of the key wrote it and that nothing in it was changed; with the opening every episode is
simulated again. The release of the study of people holds it all. Receipts are the same bytes whenever they are written again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from humanplay.db.reader import Reader
from humanplay.db.resimulation import Finding
from humanplay.db.series import find_study, participants, study_trials
from humanplay.db.study_rows import Participant
from humanplay.db.trial import Trial
from humanplay.release import signing
from humanplay.release.errors import ReleaseError
from humanplay.report.agents import compare_agents
from humanplay.report.costs import ProgressBar, no_bar
from humanplay.report.making import load_with_folder
from humanplay.series.closing import UNNOTED
from humanplay.series.data import StudyData
from humanplay.series.evaluation import (
    COMPARISON,
    OPENING,
    POLICIES,
    RECEIPTS,
    SEEN_BEFORE,
    CardList,
    IssuedCard,
)  # fmt: skip
from humanplay.series.files import iso, write_object
from humanplay.series.folder import Folder, Study
from humanplay.series.policy_episodes import PolicyEpisode, compared_policies, play_policies
from humanplay.series.protocol import Protocol, StudyError, canonical_json, parse_protocol
from humanplay.series.seeds import commitment, seed
from humanplay.task import counted

EVALUATIONS = "evaluations"
"""The folder of a release that holds those of its study."""
OPENING_FORMAT, RECEIPT_FORMAT = "marsexplorer-opening-1", "marsexplorer-receipt-1"
CAME_TO = ("outcome", "steps", "score", "total", "trajectory_hash")
"""What an episode came to, as a receipt says it and as it is simulated again."""
_DAMAGED = KeyError, TypeError, ValueError, AttributeError, OverflowError, StudyError
"""What a file raises that lacks something or holds something else in its place."""
NOTE = "What the author says of the agent is not checked; what it did is."


@dataclass(frozen=True)
class Published:
    """What a closed evaluation has published, read from its folder or from a release."""

    opening: dict[str, Any]
    receipts: list[dict[str, Any]]
    episodes: tuple[PolicyEpisode, ...]

    @classmethod
    def read(cls, path: Path) -> Published:
        """Return what lies in a folder; ReleaseError where it is not whole."""
        opening = read_signed(path / OPENING, OPENING_FORMAT)
        files = [path / RECEIPTS / f"{each['id']}.json" for each in opening["cards"]]
        rows = json.loads((path / POLICIES).read_bytes())
        episodes = (
            PolicyEpisode(**{**row, "actions": bytes.fromhex(row["actions"])}) for row in rows
        )
        return cls(opening, [read_signed(each, RECEIPT_FORMAT) for each in files], tuple(episodes))

    @property
    def protocol(self) -> Protocol:
        """The evaluation's protocol."""
        return parse_protocol(self.opening["protocol"])

    def write_to(self, path: Path, data: StudyData | None) -> None:
        """Write all of it into a folder, with the comparison with a closed study's people; receipts of erased cards go."""
        for old in (path / RECEIPTS).glob("*.json"):
            old.unlink()
        for each in self.receipts:
            write_object(path / RECEIPTS / f"{each['card']['id']}.json", each)
        rows = [{**asdict(each), "actions": each.actions.hex()} for each in self.episodes]
        write_object(path / POLICIES, rows)
        write_object(path / COMPARISON, self.comparison(data))
        write_object(path / OPENING, self.opening)  # last: where it is, the rest is too

    def comparison(self, data: StudyData | None) -> dict[str, Any]:
        """Return the comparison of its agents with policies, and with people where they are given."""
        return compare_agents(self.protocol, self.receipts, self.episodes, data)


def publish(database: Path, folder: Folder, name: str, bar: ProgressBar = no_bar) -> list[str]:
    """Write all that a closed evaluation publishes into its folder, and return the ids of the cards with a receipt.

    StudyError while it is open, or where its end is not noted in the database; ReleaseError for the key; PolicyError where the
    file of a policy that is compared is lost.
    """
    study = folder.study(name)
    if study.protocol.agents is None or study.is_open:
        what = "no evaluation of agents" if study.protocol.agents is None else "not closed"
        raise StudyError(f"{name!r} is {what}: receipts are written when an evaluation closes")
    key, issued = signing.signing_key(database), CardList(folder).of(name)
    reader = Reader.open(database)
    try:
        with reader.snapshot():
            trials, people = study_trials(reader, name), participants(reader, name)
            if any(each.ended_ms is None for each in trials):
                raise StudyError(UNNOTED.format(name, database))
            seen = _seen_by(reader, study)
            made = []
            for person in people:
                own = [each for each in trials if each.participant == person.id]
                card = issued.get(person.invitation or "")
                if card is not None and own:
                    began = own[0].started_ms
                    others = {each.participant for each in trials if each.started_ms < began}
                    content = _receipt(reader, study, card, person, own)
                    content["seen_by"] = {**seen, "other_cards_before": len(others - {person.id})}
                    made.append(sign(content, key))
            of = study.protocol.agents.study
            data = None
            if of is not None and find_study(reader, of.name) is not None:
                data = load_with_folder(reader, folder, of.name)[0]
    finally:
        reader.close()
    seeds = {index: study.seed("ranked", index) for index in range(study.protocol.ranked)}
    rules, config = study.protocol.rules, study.protocol.env_config
    names = compared_policies(study.protocol)
    with bar("policies on the same instances") as advance:
        episodes = play_policies(names, rules, config, seeds, advance, study.policy_files)
    opening = sign(_opening(study, made), key)
    Published(opening, made, episodes).write_to(folder.path(name), data)
    return [receipt["card"]["id"] for receipt in made]


def published_of(folder: Folder, study: str) -> dict[str, Path]:
    """Return the folders of the closed evaluations of agents that name a study and have published, by name."""
    found = {}
    for each in folder.evaluations():
        of = each.protocol.agents and each.protocol.agents.study
        path = folder.path(each.name)
        if of and of.name == study and (path / OPENING).is_file():
            found[each.name] = path
    return found


def sign(content: dict[str, Any], key: Any) -> dict[str, Any]:
    """Return the content with the public half of a key and its signature over the canonical JSON of both."""
    whole = {**content, "public_key": signing.public_pem(key).decode()}
    return {**whole, "signature": key.sign(canonical_json(whole)).hex()}


def chained(start: str, episodes: Sequence[Mapping[str, Any]]) -> str:
    """Return the head (hex) of the chain of some episodes: each link is SHA-256 over the one before it and the episode."""
    head = hashlib.sha256(start.encode()).hexdigest()
    for each in episodes:
        head = hashlib.sha256(head.encode() + canonical_json(each)).hexdigest()
    return head


def _seen_by(reader: Reader, study: Study) -> dict[str, Any]:
    """Return who could have seen the instances before the agents, and since when."""
    whose = study.paired or study
    begun = [] if study.paired is None else study_trials(reader, whose.name)
    ranked = [each for each in begun if each.phase == "ranked"]
    return {
        "participants": len({each.participant for each in ranked}),
        "participants_since": iso(min(each.started_ms for each in ranked)) if ranked else None,
        "operators": "whoever could read the folder of studies or the database of the server",
        "operators_since": iso(whose.frozen_ms),
    }


def _receipt(
    reader: Reader, study: Study, card: IssuedCard, person: Participant, own: Sequence[Trial]
) -> dict[str, Any]:
    protocol, agents = study.protocol, study.protocol.agents
    assert agents is not None
    assert study.closed_ms is not None
    episodes = [
        {
            "index": each.terrain_index,
            "begun": True,
            "actions": bytes(step["action"] for step in reader.steps(each.id)).hex(),
            **{name: getattr(each, name) for name in CAME_TO},
        }
        for each in sorted(own, key=lambda each: each.trial)
    ]
    for index in sorted(set(range(protocol.ranked)) - {each.terrain_index for each in own}):
        came_to = _simulated(protocol, study.seed("ranked", index), b"")
        episodes.append({"index": index, "begun": False, "actions": "", **came_to})
    start = f"{study.protocol_hash}|{card.id}"
    return {
        "format": RECEIPT_FORMAT, "evaluation": study.name, "title": protocol.title, "task": protocol.task,
        "protocol_hash": study.protocol_hash, "commitment": study.commitment,
        "study": None if agents.study is None else agents.study.model_dump(), "unpaired": agents.unpaired or None,
        "sees": agents.sees,
        "card": {
            "id": card.id, "author": card.author, "number": card.number, "ranks": card.number == 1,
            "note": None if card.number == 1 else f"card {card.number} of this author: it {SEEN_BEFORE}, and does not rank",
        },
        "agent": json.loads(person.settings), "agent_note": NOTE,
        "versions": {"core": protocol.core_version, "software": version("humanplay")},
        "began_at": iso(min(each.started_ms for each in own)), "ended_at": iso(max(each.ended_ms or 0 for each in own)),
        "closed_at": iso(study.closed_ms),
        "episodes": episodes,
        "chain": chained(start, episodes),
    }  # fmt: skip


def _opening(study: Study, receipts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {
        "format": OPENING_FORMAT,
        "evaluation": study.name,
        "protocol": json.loads(study.row().protocol),
        "closed_at": iso(study.closed_ms or 0),
        **_secret_of(study),
        "study": None if study.paired is None else _secret_of(study.paired),
        "cards": [{"id": each["card"]["id"], "chain": each["chain"]} for each in receipts],
    }


def _secret_of(study: Study) -> dict[str, Any]:
    return {
        "protocol_hash": study.protocol_hash, "commitment": study.commitment, "secret": study.secret.hex(),
        "frozen_ms": study.frozen_ms,
    }  # fmt: skip


def _simulated(protocol: Protocol, number: int, actions: bytes) -> dict[str, Any]:
    """Return what an episode on a seed comes to; ValueError or RuntimeError where its actions do not fit."""
    config, rules = protocol.env_config, protocol.rules
    terrain, start = rules.drawn(config, number)
    cause: Any = SimpleNamespace(config=config, seed=number, terrain=terrain, start=start)
    record = rules.replay(cause, actions, True).record()
    return {name: getattr(record, name) for name in CAME_TO}


def read_signed(path: Path, form: str) -> dict[str, Any]:
    """Return a receipt or an opening; ReleaseError where the file is none."""
    try:
        content = json.loads(path.read_bytes())
        if content["format"] != form:
            raise ValueError(f"its format is {content['format']!r}, expected {form!r}")
        if not all(isinstance(content[name], str) for name in ("public_key", "signature")):
            raise ValueError("it is not signed")
        return dict(content)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise ReleaseError(f"cannot read {path}: {why}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ReleaseError(f"{path} is no file of format {form}: {error}") from error


def description(receipt: Mapping[str, Any]) -> str:
    """Return whose receipt it is, and who could have seen its instances."""
    card, seen = receipt["card"], receipt["seen_by"]
    agent = receipt["agent"].get("agent", "an agent without a name")
    whose = f"{agent}, card {card['id']} of {card['author']}, evaluation {receipt['evaluation']}"
    people = f"{counted(seen['participants'], 'participant')} (since {seen['participants_since'] or 'never'})"
    cards, since = seen["other_cards_before"], seen["operators_since"]
    others = f"{counted(cards, 'other card')}, operators (since {since})"
    could = f"who could have seen the instances before: {people}, {others}"
    return "\n".join(filter(None, (whose, card["note"], could)))


def check_receipt(
    receipt: Mapping[str, Any], card: str | None = None, of: str | None = None
) -> Iterator[Finding]:
    """Yield what is wrong with a receipt by itself: its signature, its chain, its instances.

    card, of  the card and the evaluation (its name or its protocol's hash) that it is presented for; None: any
    """
    where = "receipt"
    yield from _check_signature(receipt, where)
    try:
        episodes, own = receipt["episodes"], receipt["card"]
        start = f"{receipt['protocol_hash']}|{own['id']}"
        if (head := chained(start, episodes)) != receipt["chain"]:
            yield Finding(where, "chain", receipt["chain"], head)
        indices = sorted(each["index"] for each in episodes)
        if indices != list(range(len(indices))):
            yield Finding(where, "instances", indices, "each of them once")
        if own["ranks"] != (own["number"] == 1):
            ranks = own["number"] == 1
            yield Finding(where, "ranks", own["ranks"], f"{ranks} of card {own['number']}")
        if card is not None and own["id"] != card:
            yield Finding(where, "card", own["id"], card)
        if of is not None and of not in (receipt["evaluation"], receipt["protocol_hash"]):
            yield Finding(where, "evaluation", receipt["evaluation"], of)
        description(receipt)
    except _DAMAGED as error:
        yield Finding(where, "it", "damaged", repr(error))


def check_opened(receipt: Mapping[str, Any], opening: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what is wrong with a receipt by the opening of its evaluation: every episode is simulated again."""
    yield from _check_signature(opening, "opening")
    try:
        yield from _check_opened(receipt, opening)
    except _DAMAGED as error:
        yield Finding("opening", "it", "damaged", str(error))


def _check_opened(receipt: Mapping[str, Any], opening: Mapping[str, Any]) -> Iterator[Finding]:
    names = ("evaluation", "protocol_hash", "commitment", "public_key")
    if others := [name for name in names if receipt[name] != opening[name]]:
        yield from (Finding("receipt", name, receipt[name], opening[name]) for name in others)
        return
    protocol = parse_protocol(opening["protocol"])
    chains = {each["id"]: each["chain"] for each in opening["cards"]}
    chain = chains.get(receipt["card"]["id"], "no such card")
    if chain != receipt["chain"]:
        yield Finding("receipt", "chain", receipt["chain"], chain)
    yield from check_opening(opening)
    if protocol.core_version != protocol.rules.version:
        install = "install the release that has the other"
        version_here = f"version {protocol.rules.version} of the rules: {install}"
        yield Finding("receipt", "core version", protocol.core_version, version_here)
        return
    for each in receipt["episodes"]:
        try:
            seed = seed_of(opening, each["index"])
            made = _simulated(protocol, seed, bytes.fromhex(each["actions"]))
        except (ValueError, RuntimeError, IndexError) as error:
            yield Finding(f"instance {each['index']}", "actions", "unplayable", str(error))
            continue
        for name, value in made.items():
            if each[name] != value:
                yield Finding(f"instance {each['index']}", name, each[name], value)
    if len(receipt["episodes"]) != protocol.ranked:
        yield Finding("receipt", "instances", len(receipt["episodes"]), protocol.ranked)


def check_opening(opening: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what of an opening does not fit the commitments and the protocol's hash."""
    digest = hashlib.sha256(canonical_json(opening["protocol"])).hexdigest()
    if digest != opening["protocol_hash"]:
        yield Finding("opening", "protocol_hash", opening["protocol_hash"], digest)
    for what in filter(None, (opening, opening["study"])):
        if (bound := commitment(bytes.fromhex(what["secret"]))) != what["commitment"]:
            yield Finding("opening", "commitment", what["commitment"], f"{bound} from the secret")
    named = opening["protocol"]["agents"]
    told, wanted = (
        of and {name: of[name] for name in ("protocol_hash", "commitment")}
        for of in (opening["study"], None if named["unpaired"] else named["study"])
    )
    if told != wanted:
        yield Finding("opening", "the study", told, wanted)


def seed_of(opening: Mapping[str, Any], index: int) -> int:
    """Return the seed of an instance, by the secrets of an opening."""
    of = opening["study"] or opening
    return seed(bytes.fromhex(of["secret"]), of["protocol_hash"], "ranked", index)


def _check_signature(content: Mapping[str, Any], where: str) -> Iterator[Finding]:
    whole = {name: value for name, value in content.items() if name != "signature"}
    pem = str(content["public_key"]).encode()
    try:
        is_good = signing.is_signed(pem, bytes.fromhex(content["signature"]), canonical_json(whole))
    except (ValueError, ReleaseError):
        is_good = False
    if not is_good:
        yield Finding(where, "its signature", "invalid", "one of the key in it over all of it")
