"""The texts of a study in each of its languages.

They are collected when it is frozen, and put into its protocol when it is read.

    NAME/texts/LANGUAGE.toml   texts of the study's own: of any ID, in place of the software's, and translations of what
                               only this study says, under `protocol.` and where it stands

`humanplay study texts` writes that file with what is missing.
"""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from humanplay.study.protocol import SOURCE_LANGUAGE, Protocol, StudyError, parse_protocol
from humanplay.study.protocol_parts import is_no_answer
from humanplay.study.questions import Part
from humanplay.study.templates import TEXT_FIELDS, TEXT_PARTS, changed_texts, fill
from humanplay.study.wording import (
    UNCHECKED,
    Wording,
    english,
    page_texts,
    shipped_languages,
    texts_of_page,
    translated,
)
from humanplay.task.sentences import Sentence

OWN = "protocol."
"""What the IDs of texts begin with that stand in the protocol itself."""
DRY_RUN = "{title} (dry run)"
"""The title of a dry run; `{title}` is the study's."""
_DECLARED = ("retention", "contact")
"""The declarations that the consent text repeats; whom to write to stands where somebody has left, too."""
NOUNS = {"{round}", "{rounds}", "{Round}", "{thing}", "{things}"}
"""Placeholders of nouns, which a language may need to put otherwise."""
_PLACEHOLDER = re.compile(r"\{\w+\}")
_KEPT = re.compile(r"\{\w+\}|<[^>]*>?")
"""Placeholders and marks, which a translation has, too."""
_FURTHER_PLURAL = re.compile(r"(.+)\.(?:zero|two|few|many)")
"""The ID of a form of the plural that English has not."""
_WITHOUT_NUMBER = (".zero", ".two")
"""Forms of which a language may say the number in the noun itself."""
_LETTER = re.compile(r"[^\W\d_]")


@dataclass
class LanguageTexts:
    """The texts of a study in one language.

    protocol  filled in, in this language
    texts     of the page and of refusals, by their IDs
    missing   English by ID of what nobody has translated
    """

    protocol: Protocol
    texts: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


def path_of(folder: Path, language: str) -> Path:
    """Where a study's own texts in a language stand."""
    return folder / "texts" / f"{language}.toml"


def own_texts(folder: Path, language: str) -> dict[str, str]:
    """A study's own texts in a language, without empty ones.

    Raises:
        StudyError: If the file does not hold.
    """
    path = path_of(folder, language)
    if not path.exists():
        return {}
    try:
        texts = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"{path} is no TOML: {error}") from error
    for ident, text in texts.items():
        if not isinstance(text, str):
            raise StudyError(f'{path}: expected "ID" = "text", got {ident!r} with something else')
    return {ident: text for ident, text in texts.items() if text.strip()}


def environment_texts(protocol: Protocol) -> dict[str, str]:
    """What the environment itself says to participants, by ID."""
    environment = protocol.environment
    about = environment.about
    texts = {
        "task.title": about.title,
        "task.reached": about.words.reached,
        "task.things": environment.texts(protocol.env_config).things,
    }
    # any environment's page has no instructions of its own, and shows what its figures mean without any
    if instructions := about.instructions or about.words.definition * (
        environment.assets == "picture"
    ):
        texts["task.instructions"] = instructions
    texts |= {f"metric.{metric.name}": metric.name for metric in environment.metrics}
    texts |= {f"action.{action}": action.replace("_", " ") for action in environment.actions}
    return texts


def collect(template: Protocol, folder: Path, language: str) -> LanguageTexts:
    """The texts of a draft in one of its languages.

    Raises:
        StudyError: If the study's own texts have an ID, a placeholder or a mark that there is not, or lack one.
    """
    first = template.languages[0]
    ours, is_first = own_texts(folder, language), language == first
    theirs = {} if is_first else own_texts(folder, first)
    missing: dict[str, str] = {}
    wanted = texts_of_page(template, english(), SOURCE_LANGUAGE) | environment_texts(template)
    shipped = texts_of_page(template, page_texts(language), language)
    first_shipped = texts_of_page(template, page_texts(first), first)
    texts: dict[str, str] = {}
    for ident, text in wanted.items():
        # what is shipped translates other words than those that the first language's file replaces
        is_replaced = ident in theirs and (ident in first_shipped or first == SOURCE_LANGUAGE)
        if (
            is_replaced
            and ident not in ours
            and theirs[ident] not in (text, first_shipped.get(ident))
        ):
            missing[ident] = theirs[ident]
        words = ours.get(ident) or shipped.get(ident)
        if words is None:  # of the environment, which speaks English
            words = text if language == SOURCE_LANGUAGE else _translated(language, text, False)
        if words is None and ident != "task.title":
            missing.setdefault(ident, text)
        texts[ident] = words or text
    templates: dict[str, str] = {}

    def translate(path: str, text: str) -> str:
        ident = f"{OWN}{path}"
        templates[ident] = text = theirs.get(ident, text)
        words = ours.get(ident) or _translated(language, text, is_first)
        if words is None:
            missing[ident] = text
        return words or text

    fields = template.model_dump(mode="json", exclude_unset=True)
    for part in TEXT_PARTS:
        if part in fields:
            fields[part] = changed_texts(part, fields[part], translate)
    declared = template.declarations.model_dump()
    for name in _DECLARED:
        if name == "contact" or f"{{{name}}}" in template.consent.text:
            ident = f"{OWN}declarations.{name}"
            text = templates[ident] = theirs.get(ident, declared[name])
            is_asked = name == "retention" or ident in theirs
            if ident not in ours and is_asked and not is_first and text:
                missing[ident] = text
            declared[name] = ours.get(ident, text)
            if ident in ours:
                texts[ident] = ours[ident].rstrip(".")  # it is said within a sentence, too
    _check_own(path_of(folder, language), ours, wanted | templates, is_first)
    texts |= {ident: text for ident, text in ours.items() if ident not in wanted | templates}
    spoken = parse_protocol({**fields, "declarations": declared})
    filled = fill(spoken, Wording(language, texts))
    unchanged = filled.model_copy(update={"declarations": template.declarations})
    return LanguageTexts(unchanged, texts, missing)


def preview(template: Protocol, folder: Path) -> Protocol:
    """A draft as participants would read it in its first language, even if incomplete."""
    return collect(template, folder, template.languages[0]).protocol


def with_texts(template: Protocol, folder: Path) -> Protocol:
    """A draft filled in, with all that participants read in each language.

    Raises:
        StudyError: If a text is missing, or nobody says who translated and who checked.
    """
    collected = {language: collect(template, folder, language) for language in template.languages}
    for language, part in collected.items():
        if part.missing:
            first = ", ".join(list(part.missing)[:3])
            raise StudyError(
                f"{len(part.missing)} texts of the study {template.name!r} have no translation into {language!r}, such as "
                f"{first}: `humanplay study texts {template.name} {language}` writes them into "
                f"{path_of(folder, language)}, where you translate them"
            )
    _check_declared(template)
    protocol = collected[template.languages[0]].protocol
    spoken = protocol_texts(protocol)
    texts = {}
    for language, part in collected.items():
        others = {
            f"{OWN}{path}": text
            for path, text in protocol_texts(part.protocol).items()
            if spoken.get(path) != text
        }
        texts[language] = {**part.texts, **others}
    return protocol.model_copy(update={"texts": texts})


def protocol_texts(protocol: Protocol) -> dict[str, str]:
    """The texts in a protocol that participants read, by where they stand."""
    texts: dict[str, str] = {}

    def note(path: str, text: str) -> str:
        texts[path] = text
        return text

    fields = protocol.model_dump(mode="json", include=set(TEXT_PARTS))
    for part, content in fields.items():
        changed_texts(part, content, note)
    return texts


def own_sentence(path: str, text: str) -> Sentence:
    """A text of a frozen protocol that is said in the language of who reads it.

    Args:
        path: Where it stands, as in `blocks[0].title`.
        text: As it stands there.
    """
    ident = f"{OWN}{path}"
    return Sentence(ident, text)


def localized(protocol: Protocol, language: str) -> Protocol:
    """A frozen protocol with the texts that participants read in a language."""
    texts = {
        ident.removeprefix(OWN): text
        for ident, text in protocol.texts.get(language, {}).items()
        if ident.startswith(OWN)
    }
    if not texts:
        return protocol
    update = {part: _localized(part, getattr(protocol, part), texts) for part in TEXT_PARTS}
    return protocol.model_copy(update=update)


def _localized(path: str, part: object, texts: Mapping[str, str]) -> object:
    if isinstance(part, str):
        return texts.get(path, part)
    if isinstance(part, tuple):
        return tuple(
            _localized(f"{path}[{place}]", inner, texts) for place, inner in enumerate(part)
        )
    if isinstance(part, Part):
        names = [name for name in type(part).model_fields if name in TEXT_FIELDS]
        return part.model_copy(
            update={
                name: _localized(f"{path}.{name}", getattr(part, name), texts) for name in names
            }
        )
    return part


def write_missing(template: Protocol, folder: Path, language: str, with_all: bool) -> list[str]:
    """Write what a language lacks into the study's file, and return its IDs.

    Args:
        with_all: Those that the software has, too: a study may say any of them in its own words.
    """
    path, asked = path_of(folder, language), template.languages
    if language not in asked:
        asked = (*asked, language)
    collected = collect(template.model_copy(update={"languages": asked}), folder, language)
    wanted: dict[str, str] = {}
    if with_all:
        wanted |= texts_of_page(template, english(), SOURCE_LANGUAGE) | environment_texts(template)
        wanted |= {f"{OWN}{spot}": text for spot, text in protocol_texts(template).items()}
    wanted |= collected.missing  # a text that the study says in its own words, in those
    text = path.read_text("utf-8") if path.exists() else ""
    present = tomllib.loads(text)
    added = [ident for ident in wanted if ident not in present]
    lines = [f'\n# {_quoted(wanted[ident])}\n{_quoted(ident)} = ""\n' for ident in added]
    path.parent.mkdir(exist_ok=True)
    path.write_text(text + "".join(lines), "utf-8")
    return added


def _quoted(text: str) -> str:
    """A string as TOML writes it, which is as JSON does."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _translated(language: str, text: str, is_first: bool) -> str | None:
    """A text in a language; None if nobody has translated it.

    Args:
        is_first: It is the study's first language: there a text that is not shipped is in it as it stands.
    """
    if not _LETTER.search(_PLACEHOLDER.sub("", text)):
        return text
    mark = DRY_RUN.removeprefix("{title}")
    if text.endswith(mark):
        title = _translated(language, text.removesuffix(mark), is_first)
        return title and (translated(language, DRY_RUN) or DRY_RUN).replace("{title}", title)
    if language == SOURCE_LANGUAGE:
        is_english = any(translated(other, text) for other in shipped_languages())
        return text if is_first or is_english else None
    return translated(language, text, keeps_rest=is_first) or (text if is_first else None)


def _check_own(
    path: Path, ours: Mapping[str, str], wanted: Mapping[str, str], is_first: bool
) -> None:
    for ident, text in ours.items():
        source = _source(ident, wanted)
        if source is None:
            near = difflib.get_close_matches(ident, wanted, n=1, cutoff=0.5)
            guess = f": did you mean {near[0]!r}?" if near else ""
            raise StudyError(f"{path} has the ID {ident!r}, which is of no text{guess}")
        if ident.startswith(OWN) and is_first:
            continue  # filling it in knows every placeholder
        is_of_page = _source(ident, english()) is not None
        pattern = _KEPT if is_of_page else _PLACEHOLDER
        needed, has = set(pattern.findall(source)), set(pattern.findall(text))
        if ident.endswith(_WITHOUT_NUMBER):
            needed -= {"{n}"}
        lacks, strange = needed - NOUNS - has, has - needed
        if ident.startswith(OWN):
            strange = set()
        if is_of_page and '"' in _KEPT.sub("", text):  # it may stand in an attribute
            raise StudyError(f"{path}: {ident!r} has straight quotation marks: write “ and ”")
        if strange:
            raise StudyError(
                f"{path}: {ident!r} has {min(strange)}, which nothing fills in there: {source!r}"
            )
        if lacks:
            raise StudyError(f"{path}: {ident!r} lacks {min(lacks)}, which stands in {source!r}")


def _source(ident: str, wanted: Mapping[str, str]) -> str | None:
    """The text that an ID of a study's own translates; None if there is none."""
    if further := _FURTHER_PLURAL.fullmatch(ident):
        stem = further[1]
        return wanted.get(f"{stem}.other") if f"{stem}.one" in wanted else wanted.get(ident)
    return wanted.get(ident)


def _check_declared(template: Protocol) -> None:
    if set(template.languages) == {SOURCE_LANGUAGE}:
        return
    declared = {"translated_by": template.translated_by, "checked_by": template.checked_by}
    unanswered = [name for name, text in declared.items() if is_no_answer(text)]
    if unanswered:
        raise StudyError(
            f"the study {template.name!r} is offered in {', '.join(template.languages)}, and does not say who translated "
            f"it and who checked that: write {' and '.join(unanswered)} into the protocol (what is shipped is {UNCHECKED}; "
            '"nobody" is an answer)'
        )
