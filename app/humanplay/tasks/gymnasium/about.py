"""What pages, reports and studies say of a Gymnasium environment."""

from __future__ import annotations

from humanplay.task import About, Texts, Words, counted
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig
from humanplay.tasks.gymnasium.description import Description, canonical

STUDY_TITLE = "How well do people play {title}? ({name})"
OPENING = (
    "You are invited to take part in a study of how well people play {title}. You play it with the keyboard or by touch, in "
    "your browser."
)


def about(description: Description, score: str) -> About:
    """What is said of an environment; `score` is what its score is called."""
    return About(
        title=description.title or description.id.rpartition(":")[2],
        words=_words(description, score),
        instructions=description.instructions,
    )


def _words(description: Description, score: str) -> Words:
    total, success = "the sum of all rewards", description.success
    if score != "return":
        total = f"the last {score!r} that the environment told"
    counts = "does not succeed" if success else "does not end by itself"
    definition = (
        f"An episode that {counts} counts max_steps. The score is the {score}, {total}. "
        "Where the environment itself failed, the episode counts as left at that move."
    )
    lowest, _ = description.bounds or (None, None)
    abandoned = (
        "with its score until then" if lowest is None else f"at the lowest score, {lowest:g}"
    )
    if success:
        definition += f" A success is {success}."
        ends = "moves to success", "succeeded", "short of success"
    else:
        ends = "moves to the end", "ended by itself", "without an end"
    return Words(score, *ends, definition, abandoned)


def texts_of(config: GymnasiumConfig, about: About) -> Texts:
    """What is said of a configuration."""
    description, title = config.description, about.title
    setting = config.level if config.arguments == "{}" else f"{config.level} {config.arguments}"
    observations = _observations(config)
    clock = None if description.clock == "turns" else description.clock
    sees = f" {observations}" if observations else ""
    described = "" if config.told == config.level else f" It is described by `{config.told}`."
    time = f" Time runs at {clock} frames a second." if clock else ""
    most = counted(config.limit, "move")
    return Texts(
        setting=setting,
        observations=observations,
        briefing=about.instructions or f"{setting}. {about.words.definition}",
        design=f"`{setting}` with {description.versions}, at most {most} an episode.{time}{sees}{described}",
        # half a second a move, or a frame, and never more than two minutes
        minutes=min(2.0, config.limit / (60 * clock if clock else 120)),
        study_title=STUDY_TITLE,
        opening=OPENING,
        things="rounds",
        placeholders={"title": title},
    )


def _observations(config: GymnasiumConfig) -> str:
    """What people and agents see, if the description says it of these arguments."""
    description = config.description
    people, agents = description.people_see, description.agents_see
    if not (people or agents) or config.arguments != canonical(description.kwargs):
        return ""
    people, agents = people or "its picture", agents or "its observation"
    return f"People see {people}; agents are given {'the same' if people == agents else agents}."
