"""The words a new protocol begins with: templates (`app.study.templates`) that a researcher edits before freezing."""

from __future__ import annotations

from typing import Any

_CONSENT = (
    "You are invited to take part in a study of how well people explore unknown terrain with a rover that sees only the "
    "cells around itself. You drive the rover with the keyboard or by touch, in your browser.",
    "It takes about {minutes} minutes: a short tutorial, {questions} questions, {warm_up} practice rounds and {ranked} rounds "
    "that count, with breaks whenever you like.",
    "We record every move and every key press in the game with its time, whether the page was in view, and your answers to "
    "the questions. We do not record your name, your screen, sound or anything outside this page. If a recruiting site sent "
    "you, the number it gave you is kept apart from your moves and is never published.",
    "The recorded moves will be published under a pseudonym, so that others can check and reuse the results (licence "
    "{licence}). Until then you can have them erased: write to the person who invited you.",
    "Taking part is voluntary. You can stop at any moment without giving a reason. There are no known risks beyond those of "
    "looking at a screen.",
)


CONSENT = "\n\n".join(_CONSENT)
"""What a participant agrees to, paragraphs split by blank lines."""


def questions() -> list[dict[str, Any]]:
    """Return three questions about the rules, as `protocol.Question` has them."""
    return [
        {
            "question": "What ends a round at once?",
            "choices": [
                "Driving into an obstacle or off the edge",
                "Waiting for a minute",
                "Crossing my own track",
            ],
            "answer": 0,
            "why": "Not quite: there is no clock, and your own track is free ground. An obstacle or the edge ends a round.",
        },
        {
            "question": "When is a round complete?",
            "choices": [
                "When the rover has driven over every cell",
                "When {coverage} of all cells have been discovered",
                "When the rover is back where it began",
            ],
            "answer": 1,
            "why": "Not quite: the rover need not drive everywhere; {coverage} seen by its lidar are enough.",
        },
        {
            "question": "Which of two complete rounds scores higher?",
            "choices": [
                "The one with more moves",
                "The one with fewer moves",
                "Both score the same",
            ],
            "answer": 1,
            "why": "Not quite: every move costs a little, so of two complete rounds the one with fewer moves scores higher.",
        },
    ]
