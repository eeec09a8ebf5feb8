"""Whom to pay, for the operator: outcomes' texts, and everybody who consented."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

from humanplay.db.reader import Reader
from humanplay.study.folder import Folder, Study
from humanplay.study.outcome import OUTCOME_IN_WORDS
from humanplay.study.outcomes import change_texts, read_texts
from humanplay.study.payments import COLUMNS, Payments, payments_of
from humanplay.study.protocol import StudyError
from humanplay.web.answers import operator as answers


def show_outcomes(folder: Folder, name: str) -> answers.OutcomeTexts:
    """What people read at each outcome, or what is wrong with the file."""
    try:
        texts = read_texts(folder.path(name))
    except StudyError as error:
        return answers.OutcomeTexts(outcomes=[], outcomes_problem=str(error))
    outcomes = [
        answers.OutcomeText(outcome=outcome, words=words, text=texts.get(outcome, ""))
        for outcome, words in OUTCOME_IN_WORDS.items()
    ]
    return answers.OutcomeTexts(outcomes=outcomes, outcomes_problem="")


def change_outcomes(folder: Folder, study: Study, texts: Mapping[str, str]) -> bool:
    """Change what people read at outcomes, and tell whether anything differs."""
    path = folder.path(study.name)
    before = read_texts(path)
    return before != change_texts(path, study.protocol, texts, is_frozen=True)


def list_payments(folder: Folder, study: Study, database: Path) -> Payments:
    """Everybody to be paid of a study, as of now."""
    with closing(Reader.open(database)) as reader, reader.snapshot():
        return payments_of(reader, study, read_texts(folder.path(study.name)))


def in_answer(listed: Payments) -> answers.Payments:
    """The list as the page gets it, with its files."""
    has_bulk = listed.study.protocol.platform == "prolific" and not listed.waits
    return answers.Payments(
        columns=list(COLUMNS),
        rows=[list(row) for row in listed.table()],
        csv=listed.csv(),
        bulk=listed.bulk() if has_bulk else None,
        effective_pay=listed.effective_pay(),
        without_consent=listed.without_consent,
    )
