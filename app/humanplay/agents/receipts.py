"""The receipts and the opening of a closed evaluation: written, signed, checked.

    DATABASE-agents/NAME/opening.json      the protocol, the secrets from which every instance
                                           follows, the chains
    DATABASE-agents/NAME/receipts/ID.json  every action and outcome of a card, in a chain of hashes
    DATABASE-agents/NAME/policies.json     the moves of policies on the same instances
    DATABASE-agents/NAME/comparison.json   people, policies and agents (`comparison`)

They are signed by the server's key. A receipt alone proves that the holder of the key wrote it and
that nothing in it was changed; with the opening every episode is simulated again. Receipts are the
same bytes whenever they are written again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from humanplay.agents.comparison import Exposure, Receipt, ReceiptEpisode, compare
from humanplay.agents.evaluation import (
    COMPARISON,
    OPENING,
    POLICIES,
    RECEIPTS,
    Attempt,
    CardRow,
    Evaluation,
    Protocol,
    actions_of,
    attempts_of,
    cards_of,
    find_evaluation,
    looking,
    published_folder,
    simulate_episode,
)
from humanplay.db.reader import Reader
from humanplay.db.resimulation import Finding
from humanplay.db.series import find_study, study_trials
from humanplay.release import signing
from humanplay.release.errors import ReleaseError
from humanplay.report.costs import ProgressBar, no_bar
from humanplay.report.making import load_with_folder
from humanplay.study.data import StudyData
from humanplay.study.files import iso, write_object
from humanplay.study.folder import Folder, Study
from humanplay.study.policy_episodes import play_policies
from humanplay.study.protocol import StudyError, canonical_json
from humanplay.study.seeds import commitment, seed
from humanplay.task import counted

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

OPENING_FORMAT, RECEIPT_FORMAT = "humanplay-opening-1", "humanplay-receipt-1"
NOTE = "What the author says of the agent is not checked; what it did is."
_DAMAGED = KeyError, TypeError, ValueError, AttributeError, OverflowError, StudyError
"""What a file raises that lacks something or holds something else in its place."""


def publish(database: Path, folder: Folder, name: str, bar: ProgressBar = no_bar) -> list[str]:
    """Write all that a closed evaluation publishes.

    Returns:
        The ids of the cards with a receipt.

    Raises:
        ReleaseError: About the key.
        PolicyError: If the file of a policy that is compared is lost.
    """
    key = signing.signing_key(database)
    with looking(database) as conn:
        evaluation = find_evaluation(conn, folder, name)
        played = {card: attempts_of(conn, card.id) for card in cards_of(conn, name)}
        moves = {
            attempt.id: actions_of(conn, attempt.id)
            for attempts in played.values()
            for attempt in attempts
        }
    seen, data = _seen_by(database, evaluation), _people(database, folder, evaluation.study)
    receipts = list[Receipt]()
    for card, attempts in played.items():
        if attempts:
            began = attempts[0].started_ms
            others = [
                other
                for other, theirs in played.items()
                if other != card and theirs and theirs[0].started_ms < began
            ]
            seen_by: Exposure = {**seen, "other_cards_before": len(others)}
            receipt = _receipt(evaluation, card, attempts, moves, seen_by)
            receipt["public_key"], receipt["signature"] = _sign(receipt, key)
            receipts.append(receipt)
    protocol = evaluation.protocol
    seeds = {index: evaluation.seed(index) for index in range(protocol.instances)}
    with bar("policies on the same instances") as advance:
        episodes = play_policies(
            compared_policies(protocol),
            protocol.environment,
            protocol.env_config,
            seeds,
            advance,
            evaluation.policy_files,
        )
    path = published_folder(database, name)
    for old in (path / RECEIPTS).glob("*.json"):  # of cards that were forgotten
        old.unlink()
    for receipt in receipts:
        write_object(path / RECEIPTS / f"{receipt['card']['id']}.json", receipt)
    write_object(
        path / POLICIES,
        [{**asdict(episode), "actions": episode.actions.hex()} for episode in episodes],
    )
    write_object(path / COMPARISON, compare(protocol, receipts, episodes, data))
    # the opening comes last: a reader who finds it finds the rest too
    write_object(path / OPENING, sign(_opening(evaluation, receipts), key))
    return [receipt["card"]["id"] for receipt in receipts]


def compared_policies(protocol: Protocol) -> list[str]:
    """The policies that agents are compared with: the protocol's, and `random` as 0."""
    return list(dict.fromkeys((*protocol.policies, "random")))


def sign(content: Mapping[str, object], key: Ed25519PrivateKey) -> dict[str, object]:
    """Add the public half of a key, and its signature over the canonical JSON of both."""
    public, signature = _sign(content, key)
    return {**content, "public_key": public, "signature": signature}


def _sign(content: Mapping[str, object], key: Ed25519PrivateKey) -> tuple[str, str]:
    """The public half of a key, and its signature over some content with that."""
    public = signing.public_pem(key).decode()
    return public, key.sign(canonical_json({**content, "public_key": public})).hex()


def chain_hash(start: str, episodes: Sequence[Mapping[str, object]]) -> str:
    """The head (hex) of the chain of some episodes.

    Each link is SHA-256 over the one before it and the episode.
    """
    head = hashlib.sha256(start.encode()).hexdigest()
    for episode in episodes:
        head = hashlib.sha256(head.encode() + canonical_json(episode)).hexdigest()
    return head


def _people(database: Path, folder: Folder, study: Study | None) -> StudyData | None:
    """The people of the study whose terrains were played.

    None if nobody has joined it.
    """
    if study is None:
        return None
    with closing(Reader.open(database)) as reader, reader.snapshot():
        if find_study(reader, study.name) is None:
            return None
        return load_with_folder(reader, folder, study.name)[0]


def _seen_by(database: Path, evaluation: Evaluation) -> Exposure:
    """Who could have seen the instances before the agents, and since when."""
    ranked = []
    if evaluation.study is not None:
        with closing(Reader.open(database)) as reader:
            begun = study_trials(reader, evaluation.study.name)
        ranked = [trial for trial in begun if trial.phase == "ranked"]
    since = evaluation.frozen_ms if evaluation.study is None else evaluation.study.frozen_ms
    return {
        "participants": len({trial.participant for trial in ranked}),
        "participants_since": iso(min(trial.started_ms for trial in ranked)) if ranked else None,
        "operators": "whoever could read the database of the server or its folder of studies",
        "operators_since": iso(since),
    }


def _receipt(
    evaluation: Evaluation,
    card: CardRow,
    attempts: Sequence[Attempt],
    moves: Mapping[int, bytes],
    seen_by: Exposure,
) -> Receipt:
    protocol = evaluation.protocol
    episodes = list[ReceiptEpisode]()
    for attempt in attempts:
        assert attempt.came_to is not None  # the evaluation is closed
        actions = moves[attempt.id].hex()
        episodes.append(
            {"index": attempt.instance, "begun": True, "actions": actions, **attempt.came_to}
        )
    begun = {attempt.instance for attempt in attempts}
    for index in sorted(set(range(protocol.instances)) - begun):
        came_to = simulate_episode(protocol, evaluation.seed(index), b"")
        episodes.append({"index": index, "begun": False, "actions": "", **came_to})
    start = f"{protocol.hash}|{card.id}"
    return {
        "format": RECEIPT_FORMAT,
        "evaluation": evaluation.name,
        "task": protocol.task,
        "protocol_hash": protocol.hash,
        "commitment": evaluation.commitment,
        "study": None if protocol.study is None else protocol.study.model_dump(),
        "sees": protocol.sees,
        "card": {
            "id": card.id,
            "author": card.author,
            "number": card.number,
            "ranks": card.number == 1,
            "note": card.note,
        },
        "agent": json.loads(card.description),
        "agent_note": NOTE,
        "versions": {"core": protocol.core_version, "software": version("humanplay")},
        "began_at": iso(min(attempt.started_ms for attempt in attempts)),
        "ended_at": iso(max(attempt.ended_ms or 0 for attempt in attempts)),
        "closed_at": iso(evaluation.closed_ms or 0),
        "episodes": episodes,
        "chain": chain_hash(start, episodes),
        "seen_by": seen_by,
    }


def _opening(evaluation: Evaluation, receipts: Sequence[Receipt]) -> dict[str, object]:
    study = evaluation.study
    return {
        "format": OPENING_FORMAT,
        "evaluation": evaluation.name,
        "protocol": evaluation.protocol.model_dump(mode="json"),
        "protocol_hash": evaluation.protocol.hash,
        "commitment": evaluation.commitment,
        "secret": evaluation.secret.hex(),
        "closed_at": iso(evaluation.closed_ms or 0),
        "study": study
        and {
            "protocol_hash": study.protocol_hash,
            "commitment": study.commitment,
            "secret": study.secret.hex(),
        },
        "cards": [{"id": receipt["card"]["id"], "chain": receipt["chain"]} for receipt in receipts],
    }


def read_signed(path: Path, form: str) -> dict[str, Any]:
    """Read a receipt or an opening; ReleaseError if the file is none."""
    try:
        content = json.loads(path.read_bytes())
        if content["format"] != form:
            raise ValueError(f"its format is {content['format']!r}, expected {form!r}")
        if not all(isinstance(content[name], str) for name in ("public_key", "signature")):
            raise ValueError("it is not signed")
        return dict(content)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ReleaseError(f"cannot read {path}: {reason}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ReleaseError(f"{path} is no file of format {form}: {error}") from error


def description(receipt: Mapping[str, Any]) -> str:
    """Whose receipt it is, and who could have seen its instances."""
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
    """Yield what is wrong with a receipt by itself.

    Checked are its signature, its chain and its instances.
    """
    name = "receipt"
    yield from _check_signature(receipt, name)
    try:
        episodes, of_card = receipt["episodes"], receipt["card"]
        start = f"{receipt['protocol_hash']}|{of_card['id']}"
        if (head := chain_hash(start, episodes)) != receipt["chain"]:
            yield Finding(name, "chain", receipt["chain"], head)
        indices = sorted(episode["index"] for episode in episodes)
        if indices != list(range(len(indices))):
            yield Finding(name, "instances", indices, "each of them once")
        if of_card["ranks"] != (of_card["number"] == 1):
            ranks = of_card["number"] == 1
            yield Finding(name, "ranks", of_card["ranks"], f"{ranks} of card {of_card['number']}")
        if card is not None and of_card["id"] != card:
            yield Finding(name, "card", of_card["id"], card)
        if of is not None and of not in (receipt["evaluation"], receipt["protocol_hash"]):
            yield Finding(name, "evaluation", receipt["evaluation"], of)
        description(receipt)
    except _DAMAGED as error:
        yield Finding(name, "it", "damaged", repr(error))


def check_opened(receipt: Mapping[str, Any], opening: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what is wrong with a receipt by the opening of its evaluation.

    Every episode is simulated again.
    """
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
    protocol = Protocol.model_validate(opening["protocol"])
    chains = {card["id"]: card["chain"] for card in opening["cards"]}
    chain = chains.get(receipt["card"]["id"], "no such card")
    if chain != receipt["chain"]:
        yield Finding("receipt", "chain", receipt["chain"], chain)
    yield from check_opening(opening)
    if protocol.core_version != protocol.environment.version:
        here = protocol.environment.version
        expected = f"version {here} of the rules: install the release that has the other"
        yield Finding("receipt", "core version", protocol.core_version, expected)
        return
    for episode in receipt["episodes"]:
        instance = f"instance {episode['index']}"
        try:
            number = seed_of(opening, episode["index"])
            ending = simulate_episode(protocol, number, bytes.fromhex(episode["actions"]))
        except (ValueError, RuntimeError, IndexError) as error:
            yield Finding(instance, "actions", "unplayable", str(error))
            continue
        for name, again in ending.items():
            if episode[name] != again:
                yield Finding(instance, name, episode[name], again)
    if len(receipt["episodes"]) != protocol.instances:
        yield Finding("receipt", "instances", len(receipt["episodes"]), protocol.instances)


def check_opening(opening: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield what of an opening does not fit the commitments and the protocol's hash."""
    digest = hashlib.sha256(canonical_json(opening["protocol"])).hexdigest()
    if digest != opening["protocol_hash"]:
        yield Finding("opening", "protocol_hash", opening["protocol_hash"], digest)
    study = opening["study"]
    for part in (opening, study) if study else (opening,):
        bound = commitment(bytes.fromhex(part["secret"]))
        if bound != part["commitment"]:
            yield Finding("opening", "commitment", part["commitment"], f"{bound} from the secret")
    named, fixed = opening["protocol"]["study"], ("protocol_hash", "commitment")
    wanted = named and {name: named[name] for name in fixed}
    opened = study and {name: study[name] for name in fixed}
    if opened != wanted:
        yield Finding("opening", "the study", opened, wanted)


def seed_of(opening: Mapping[str, Any], index: int) -> int:
    """The seed of an instance, by the secrets of an opening."""
    whose = opening["study"] or opening
    return seed(bytes.fromhex(whose["secret"]), whose["protocol_hash"], "ranked", index)


def _check_signature(content: Mapping[str, Any], name: str) -> Iterator[Finding]:
    whole = {field: part for field, part in content.items() if field != "signature"}
    pem = str(content["public_key"]).encode()
    try:
        is_good = signing.is_signed(pem, bytes.fromhex(content["signature"]), canonical_json(whole))
    except (ValueError, ReleaseError):
        is_good = False
    if not is_good:
        yield Finding(name, "its signature", "invalid", "one of the key in it over all of it")
