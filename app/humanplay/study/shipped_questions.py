"""The shipped blocks of questions, which a protocol names and may change."""

from __future__ import annotations

from collections.abc import Mapping

_LOADS = {
    "Mental demand": "How mentally demanding was the task?",
    "Physical demand": "How physically demanding was the task?",
    "Temporal demand": "How hurried or rushed was the pace of the task?",
    "Performance": "How successful were you in accomplishing what you were asked to do?",
    "Effort": "How hard did you have to work to accomplish your level of performance?",
    "Frustration": "How insecure, discouraged, irritated, stressed and annoyed were you?",
}


def _load(name: str, title: str, low: str, high: str) -> dict[str, object]:
    """A scale of NASA-TLX."""
    question = f"{title}: {_LOADS[title]}"
    return {
        "kind": "scale",
        "name": name,
        "question": question,
        "steps": 21,
        "low": low,
        "high": high,
    }


BLOCKS: dict[str, dict[str, object]] = {
    "demographics": {
        "at": "before",
        "title": "About you",
        "about": "your age, your gender and your education",
        "questions": [
            {
                "kind": "number",
                "name": "age",
                "tells": "demographics",
                "question": "How old are you?",
                "needed": True,
                "minimum": 18,
                "maximum": 110,
                "unit": "years",
            },
            {
                "kind": "choice",
                "name": "gender",
                "tells": "demographics",
                "question": "What is your gender?",
                "needed": True,
                "choices": ["woman", "man", "non-binary", "another one"],
            },
            {
                "kind": "choice",
                "name": "education",
                "tells": "demographics",
                "question": "What is the highest level of education that you have completed?",
                "needed": True,
                "choices": [
                    "none, or primary school",
                    "secondary school",
                    "vocational training",
                    "a bachelor's degree or the like",
                    "a master's degree or the like",
                    "a doctorate",
                ],
            },
        ],
    },
    "experience": {
        "at": "before",
        "title": "Games and you",
        "about": "your experience with games",
        "questions": [
            {
                "kind": "choice",
                "name": "plays_games",
                "tells": "demographics",
                "question": "How often have you played video games in the last twelve months?",
                "needed": True,
                "choices": [
                    "never",
                    "less than once a month",
                    "one to three times a month",
                    "one to six days a week",
                    "every day",
                ],
            },
            {
                "kind": "several",
                "name": "game_kinds",
                "question": "Which kinds of games do you play, at least now and then?",
                "ordered": False,
                "choices": [
                    "puzzles and board games",
                    "action and sports",
                    "strategy and simulation",
                    "adventure and role play",
                    "mazes, maps and exploration",
                ],
            },
            {
                "kind": "likert",
                "name": "skills",
                "question": "How much do you agree?",
                "rows": [
                    "I am good at video games.",
                    "I find my way easily with a map.",
                    "I am quick with a keyboard.",
                ],
                "points": [
                    "strongly disagree",
                    "disagree",
                    "neither",
                    "agree",
                    "strongly agree",
                ],
            },
        ],
    },
    "exposure": {
        "at": "before",
        "title": "Before today",
        "about": "whether you had met this task before",
        "questions": [
            {
                "kind": "choice",
                "name": "seen_before",
                "tells": "exposure",
                "question": "Had you played or seen this task before?",
                "needed": True,
                "choices": [
                    "no",
                    "I had seen or read about it",
                    "I had played it once or twice",
                    "I had played it more often",
                ],
            }
        ],
    },
    "tools": {
        "at": "after",
        "title": "How you went about it",
        "about": "what helped you, and whether you used any tool",
        "questions": [
            {
                "kind": "choice",
                "name": "used_tool",
                "tells": "tools",
                "question": "Did you use anything beside this page, such as pen and paper, another person, a program or an AI?",
                "needed": True,
                "choices": ["no", "yes"],
            },
            {
                "kind": "text",
                "name": "which_tool",
                "tells": "tools",
                "question": "If so: which one, and for what?",
                "max_length": 500,
            },
            {
                "kind": "text",
                "name": "what_helped",
                "tells": "explanations",
                "question": "How did you decide where to go? What helped you?",
                "long": True,
                "max_length": 2000,
            },
        ],
    },
    "nasa-tlx": {
        "at": "after",
        "title": "How demanding it was",
        "about": "how demanding the task was",
        "intro": "Mark on each line how the task was for you, all of it taken together.",
        "questions": [
            _load("mental_demand", "Mental demand", "very low", "very high"),
            _load("physical_demand", "Physical demand", "very low", "very high"),
            _load("temporal_demand", "Temporal demand", "very low", "very high"),
            _load("performance", "Performance", "perfect", "failure"),
            _load("effort", "Effort", "very low", "very high"),
            _load("frustration", "Frustration", "very low", "very high"),
        ],
    },
    "remark": {
        "at": "after",
        "title": "Anything else",
        "about": "any remark of yours",
        "questions": [
            {
                "kind": "text",
                "name": "remark",
                "question": "Is there anything else that you want to say about the study?",
                "long": True,
                "max_length": 2000,
            }
        ],
    },
}
"""Each block by its name. NASA-TLX is that of Hart and Staveland (1988), without weights, from its lowest step 0 to 20."""


def with_shipped(blocks: object) -> object:
    """A protocol's blocks, with shipped ones in place of their names.

    Raises:
        ValueError: For an unknown name.
    """
    if not isinstance(blocks, (list, tuple)):
        return blocks
    return [shipped(block) if isinstance(block, str) else block for block in blocks]


def shipped(name: str) -> Mapping[str, object]:
    """The block that is shipped under a name; ValueError if none is."""
    if name not in BLOCKS:
        raise ValueError(f"no block is shipped as {name!r}: there are {', '.join(BLOCKS)}")
    return {"name": name.replace("-", "_"), **BLOCKS[name]}
