"""The words a new protocol begins with: templates (`app.series.templates`) that a researcher edits before freezing."""

from __future__ import annotations

_DURATION = (
    "It takes about {{minutes}} minutes: a short tutorial, {questions}{{warm_up}} practice rounds and {{ranked}} rounds "
    "that count, with breaks whenever you like."
)
_REST = (
    "We record every move and every key press in the game with its time, whether the page was in view, and your answers to "
    "the questions. We do not record your name, your screen, sound or anything outside this page. If a recruiting site sent "
    "you, the number it gave you is kept apart from your moves and is never published.",
    "The recorded moves will be published under a pseudonym, so that others can check and reuse the results (licence "
    "{licence}). Until then you can have them erased: write to the person who invited you.",
    "Taking part is voluntary. You can stop at any moment without giving a reason. There are no known risks beyond those of "
    "looking at a screen.",
)


def consent(opening: str, with_questions: bool) -> str:
    """Return what a participant agrees to, paragraphs split by blank lines; the task's opening says what is played."""
    duration = _DURATION.format(questions="{questions} questions, " if with_questions else "")
    return "\n\n".join((opening, duration, *_REST))
