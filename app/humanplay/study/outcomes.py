"""What participants read at each outcome: a code, an address or a sentence.

    NAME/outcomes.json   the text of each outcome; readable by its owner alone

These texts are in no protocol and no export, and they may change while the study runs.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Formatter
from urllib.parse import quote

from humanplay.study.files import locked, read_object, write_object
from humanplay.study.outcome import BEFORE_CONSENT, Outcome
from humanplay.study.platforms import PLATFORMS
from humanplay.study.protocol import Protocol, StudyError
from humanplay.study.protocol_parts import Payment
from humanplay.task.sentences import Sentence

FILE = "outcomes.json"
CODE = "code"
"""The placeholder of the code that is drawn for each person."""


@dataclass(frozen=True)
class Ending:
    """What a participant reads when they finish or leave.

    code      to be typed or copied elsewhere
    address   where a button leads
    """

    outcome: Outcome
    code: str | None = None
    address: str | None = None
    sentence: str | None = None


def read_texts(folder: Path) -> dict[Outcome, str]:
    """Outcome -> its text, from a study's folder; StudyError if the file is damaged."""
    path = folder / FILE
    if not path.exists():
        return {}
    try:
        return {Outcome(outcome): str(text) for outcome, text in read_object(path).items()}
    except ValueError as error:
        raise StudyError(f"{path} is damaged: {error}; restore a backup") from error


def change_texts(
    folder: Path, protocol: Protocol, texts: Mapping[str, str], is_frozen: bool
) -> dict[Outcome, str]:
    """Change the texts of some outcomes, and return all texts.

    Args:
        texts: Outcome -> its new text; an empty one deletes the text.

    Raises:
        StudyError: If a text cannot be shown to participants; nothing changes then.
    """
    if unknown := [outcome for outcome in texts if outcome not in set(Outcome)]:
        raise StudyError(f"expected one of {', '.join(Outcome)} before the =, got {unknown[0]!r}")
    with locked(folder):
        merged = {**read_texts(folder), **{Outcome(name): text for name, text in texts.items()}}
        merged = {
            outcome: _plain_code(protocol, text.strip())
            for outcome, text in merged.items()
            if text.strip()
        }
        check_texts(protocol, merged)
        if is_frozen:
            check_complete(protocol, merged)
        write_object(folder / FILE, merged, private=True)
    return merged


def _plain_code(protocol: Protocol, text: str) -> str:
    """The code alone, if the text is the platform's address with it; else the text."""
    before, _, _ = PLATFORMS[protocol.platform].back.partition("{code}")
    return text.removeprefix(before) if before else text


def delete_texts(folder: Path) -> None:
    """Delete the texts of a study's outcomes from its folder."""
    (folder / FILE).unlink(missing_ok=True)


def check_texts(protocol: Protocol, texts: Mapping[Outcome, str]) -> None:
    """Check the texts of outcomes.

    Raises:
        StudyError: If a text has an unknown placeholder, or does not suit the platform.
    """
    platform = PLATFORMS[protocol.platform]
    fillable = {*protocol.outside_ids, *([CODE] if protocol.platform == "code" else [])}
    for outcome, text in texts.items():
        names = _placeholders(outcome, text)
        if names and outcome in BEFORE_CONSENT:
            raise StudyError(
                f"{outcome} has {{{min(names)}}}, but nothing is stored of whoever did not agree: "
                "write a text without placeholders"
            )
        for name in names - fillable:
            if name == CODE:
                raise StudyError(
                    f"{outcome} has {{code}}, but {platform.title} takes fixed codes and none is drawn: "
                    "write the code that the platform shows you"
                )
            raise StudyError(
                f"{outcome} has {{{name}}}, which nothing fills in: there are "
                f"{', '.join(f'{{{name}}}' for name in sorted(fillable)) or 'no placeholders'}"
            )
    for outcome, text in texts.items():
        for name in platform.ids:
            if re.search(rf"[?&]{name}=(?!{{{name}}})", text):
                raise StudyError(
                    f"{outcome} has the same {name} for everybody: write {name}={{{name}}}, "
                    "which becomes each person's"
                )
    codes = [text for text in texts.values() if kind_of(text) == "code"]
    if repeated := {code for code in codes if codes.count(code) > 1 and "{" not in code}:
        raise StudyError(
            f"two outcomes have the code {min(repeated)}: nobody could tell them apart by it"
        )


def check_complete(protocol: Protocol, texts: Mapping[Outcome, str]) -> None:
    """StudyError if participants who finish have no way back to the platform."""
    platform = PLATFORMS[protocol.platform]
    if protocol.platform == "code" or kind_of(texts.get(Outcome.FINISHED, "")) in WAYS_BACK:
        return
    way_back = "the completion code" if platform.back else "the address that gives credit"
    raise StudyError(
        f"people come from {platform.title}, and nothing leads them back: "
        f"`humanplay study outcomes {protocol.name} finished=...` with {way_back} that it shows you"
    )


WAYS_BACK = ("code", "address")


def kind_of(text: str) -> str:
    """What a text is: an address, a code (one word) or a sentence."""
    if re.match(r"https?://", text):
        return "address"
    return "code" if text and not re.search(r"\s", text) else "sentence"


def ending(
    protocol: Protocol,
    texts: Mapping[Outcome, str],
    outcome: Outcome,
    ids: Mapping[str, str],
    drawn: str | None,
) -> Ending:
    """What a participant reads at an outcome.

    Args:
        ids: Parameter of the link -> the participant's value.
        drawn: The participant's code, if one is drawn for each.
    """
    text = texts.get(outcome, "")
    if not text and protocol.platform == "code" and outcome not in BEFORE_CONSENT:
        text = f"{{{CODE}}}" if drawn else ""
    # without a code for finishers all texts were deleted, when everybody had been paid
    if not text and protocol.platform == "prolific" and Outcome.FINISHED in texts:
        text = _return_it(protocol.payment, outcome)
    values = {**dict.fromkeys(protocol.outside_ids, ""), **ids, CODE: drawn or ""}
    if not text:
        return Ending(outcome)
    if kind_of(text) == "address":
        address = text.format_map({name: quote(value, safe="") for name, value in values.items()})
        return Ending(outcome, code=drawn or None, address=address)
    if kind_of(text) == "sentence":
        is_ours = isinstance(text, Sentence)
        return Ending(outcome, sentence=text if is_ours else text.format_map(values))
    filled = text.format_map(values)
    back = PLATFORMS[protocol.platform].back
    return Ending(outcome, code=filled, address=back.format(code=quote(filled)) if back else None)


def _return_it(payment: Payment | None, outcome: Outcome) -> str:
    """What a participant from Prolific reads at an outcome without a code."""
    amount = 0.0 if payment is None else payment.outcomes.get(outcome, 0.0)
    if payment is not None and amount and payment.is_fixed(outcome):
        whole, hundredths = f"{amount:.2f}".split(".")
        money = _AMOUNT.format(whole=whole, hundredths=hundredths, currency=payment.currency)
        return _RETURN_FOR.format(amount=money)
    return _RETURN


_RETURN = Sentence("outcome.return", "Please return your submission on Prolific.")
_AMOUNT = Sentence("outcome.amount", "{whole}.{hundredths} {currency}")
_RETURN_FOR = Sentence(
    "outcome.return_for",
    "Please return your submission on Prolific. You get {amount} as a bonus.",
)


def _placeholders(outcome: Outcome, text: str) -> set[str]:
    try:
        fields = [field for field in Formatter().parse(text) if field[1] is not None]
    except ValueError as error:
        raise StudyError(
            f"{outcome} has a brace without its pair, got {text!r}: {{{{ and }}}} write braces"
        ) from error
    if any(spec or conversion for _, _, spec, conversion in fields):
        raise StudyError(
            f"{outcome} has more than a name within braces, got {text!r}: write {{NAME}} alone"
        )
    return {name for _, name, _, _ in fields if name is not None}
