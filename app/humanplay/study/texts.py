"""The texts of a new study, which the researcher edits before freezing.

They are templates of `humanplay.study.templates`.
"""

from __future__ import annotations

RECRUITMENT = """\
{title}

We are looking for {players} people to take part in a study, in a browser. Nothing has to be installed.

- It takes about {minutes} minutes, with breaks whenever you like.
- Anybody may take part who: TODO, as under recruitment_criteria in protocol.toml
- You get: TODO, as under testing_compensation
- We record your moves and keys in the game, under a pseudonym. You may stop at any time and need give no reason.
- To take part, or to ask: TODO, name and address
"""
"""What people are asked to take part with; freezing fills it in."""

ONE_EACH = "\nEach link is for one person: please do not pass it on.\n"
"""Its end, if links are single-use or signed."""

CHECKLIST = """\
# Operator's checklist: {name}

## Before anybody is asked
- [ ] `humanplay study check {name}` has nothing left to write into `protocol.toml`; consent text read by the ethics board
- [ ] `recruitment.txt`: every TODO replaced; freezing fills in what stands in braces
- [ ] Rehearsal under another name: `humanplay study new rehearsal --declarations FILE`, where FILE is the `rehearsal.toml`
      beside this list, `humanplay study freeze rehearsal`, `humanplay serve`, and beside it
      `humanplay simulate --study rehearsal --participants 3 --speed 200`. It prints the minutes a participant took:
      compare them with those of the consent text. Synthetic players do not stop to think.
- [ ] Walk through it once yourself, on the screen that people will use

## Fix it
- [ ] `humanplay study freeze {name}`
- [ ] `humanplay study preregister {name} --out {name}.md`, and register it: protocol hash and commitment are in it
- [ ] A copy of the study's folder in a safe place: whoever reads `secret` knows every instance

## Let people in
- [ ] Backups run (docs/deploy.md), and one was restored
- [ ] `humanplay serve --admin --public-url https://...`; people get the address that freezing printed or, by invitation,
      links of `humanplay study invite {name}`
- [ ] Every day: `/admin` for deviations and for who is quiet; `humanplay verify`, and write down the head it prints
- [ ] Whoever wants to be erased: `humanplay forget`

## Close it
- [ ] `humanplay study close {name}`, when the last person is through
- [ ] `humanplay report --study {name} --html {name}.html`
- [ ] `humanplay study payments {name}`; once everybody is paid, `humanplay study unlink {name}`
- [ ] `humanplay release --study {name}`, and another machine derives it again with `humanplay reproduce`
"""
"""What an operator does from the draft to the figure, on one page."""

_DURATION = (
    "It takes about {{minutes}} minutes: a short tutorial, {questions}{{warm_up}} practice {things} and {{ranked}} {things} "
    "that count, with breaks whenever you like.{{practice}}"
)
ERASURE = (
    "You then choose: what you have played is kept without your name, or it is erased, with the moves, the keys, your answers "
    "and the number from a recruiting site; that somebody was erased stays noted. You can ask for that later too: write to "
    "the address above, and give the name by which this page calls you."
)
"""What the consent promises, unless the study keeps the episodes of whoever is forgotten."""
LEAVING_KEEPS = (
    "What you have played and answered until then is kept without your name. You can have the number from a recruiting site "
    "deleted: write to the address above, and give the name by which this page calls you."
)
_REST = (
    "We record every move and every key press in the game with its time, whether the page was in view, and your answers to "
    "the questions.{asked} We do not record your name, your screen, sound or anything outside this page. If a recruiting site "
    "sent you, the number it gave you is kept apart from your moves and is never published.",
    "The recorded moves will be published under a pseudonym, so that others can check and reuse the results (licence "
    "{licence}). What is published cannot be called back. How long the rest is stored: {retention}",
    "Responsible for the data, and whom to write to: {contact}",
)
_LEAVING = (
    "Taking part is voluntary. You can stop at any moment without giving a reason, by the button Leave the study. "
    "{leaving} There are no known risks beyond those of looking at a screen."
)


def consent(opening: str, with_questions: bool, things: str, keeps_episodes: bool) -> str:
    """What a participant agrees to, paragraphs split by blank lines.

    Args:
        opening: What is played, in the task's words.
        with_questions: Whether questions are asked.
        things: What is counted: terrains, rounds.
        keeps_episodes: Whether the study keeps the episodes of whoever is forgotten.
    """
    questions = "{questions} questions, " if with_questions else ""
    duration = _DURATION.format(questions=questions, things=things)
    leaving = _LEAVING.format(leaving=LEAVING_KEEPS if keeps_episodes else ERASURE)
    return "\n\n".join((opening, duration, *_REST, leaving))
