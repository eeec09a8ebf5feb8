"""What pages, reports and studies say of MarsExplorer."""

from __future__ import annotations

from humanplay.task import About, Question, Reference, Texts, Words, counted
from marsexplorer.config import EnvConfig
from marsexplorer.evaluation.effort import QUANTILE, SHORTEST

WORDS = Words(
    score="normalized score",
    steps="steps to 99 %",
    reached="reached 99 %",
    short="short of 99 %",
    definition="An episode that ends short of 99 % counts max_steps. The score is (return + r_invalid) / "
    "(r_invalid + r_bonus + cells), never clipped.",
    abandoned="at the price of a collision: r_invalid is taken off its return",
)
PAPER = Reference(
    authors=(
        ("Koutras", "Dimitrios I."),
        ("Kapoutsis", "Athanasios Ch."),
        ("Amanatiadis", "Angelos A."),
        ("Kosmatopoulos", "Elias B."),
    ),
    title="MarsExplorer: Exploration of Unknown Terrains via Deep Reinforcement Learning and "
    "Procedurally Generated Environments",
    year=2021,
    url="https://arxiv.org/abs/2107.09996",
)
ABOUT = About(
    title="MarsExplorer",
    words=WORDS,
    labels={
        "no effort": f"no better explored than by random moves in {QUANTILE:.0%} of cases; "
        f"{SHORTEST:.1%} of the limit or longer"
    },
    references=(PAPER,),
    columns={
        "episodes.level": "random, t-m-b of section 3.3 of the paper, or map",
        "episodes.rows": "cells from north to south",
        "episodes.cols": "cells from west to east",
        "episodes.sensor_radius": "reach of the lidar, cells",
        "episodes.beta": "share of all cells to discover",
        "episodes.start_row": "where the rover began; row 0 is the north edge",
        "episodes.start_col": "where the rover began; column 0 is the west edge",
        "episodes.terrain": "the obstacle map: bits row by row (numpy.packbits), outside "
        "the database x and hexadecimal digits",
        "episodes.terrain_hash": "SHA-256 of the map's shape and bits",
        "episodes.outcome": "explored, collided, out_of_bounds, timed_out or abandoned",
        "episodes.discovered": "cells discovered",
        "episodes.coverage": "share of all cells, 0..1; in exports, on maps and the "
        "levels `building` and `cave`, of those that can be discovered",
        "episodes.return": "sum of the rewards; abandoning costs r_invalid more",
        "episodes.score": "(return + r_invalid) / (r_invalid + r_bonus + cells): 0 for "
        "an invalid first move, at most 1",
        "episodes.steps_to_99": "moves of an explored episode, max_steps of any other",
        "episodes.trajectory_hash": "SHA-256 over configuration, terrain, start and each move's "
        "position, discovered cells and reward",
        "steps.action": "north, east, south or west",
        "steps.row": "where the rover stands after it (replayed)",
        "steps.col": "where the rover stands after it (replayed)",
        "steps.discovered": "cells discovered after it",
        "policy_episodes.actions": "the moves, a letter each: N, E, S or W",
    },
)
OPENING = (
    "You are invited to take part in a study of how well people explore unknown terrain with a rover that sees only the "
    "cells around itself. You drive the rover with the keyboard or by touch, in your browser."
)
QUESTIONS = (
    Question(
        question="What ends an episode at once?",
        choices=(
            "Driving into a rock or off the edge",
            "Waiting for a minute",
            "Crossing my own track",
        ),
        answer=0,
        why="Not quite: there is no clock, and your own track is free ground. A rock or the edge ends an episode.",
    ),
    Question(
        question="When is a terrain complete?",
        choices=(
            "When the rover has driven over every cell",
            "When {coverage} of all cells have been mapped",
            "When the rover is back where it began",
        ),
        answer=1,
        why="Not quite: the rover need not drive everywhere; {coverage} seen by its lidar are enough.",
    ),
    Question(
        question="Two people complete the same terrain, and know equally many cells. Who scores higher?",
        choices=(
            "Whoever made more moves",
            "Whoever made fewer moves",
            "Both score the same",
        ),
        answer=1,
        why="Not quite: every move takes a little off the score, so whoever made fewer scores higher.",
    ),
)


def texts_of(config: EnvConfig) -> Texts:
    """What is said of a configuration."""
    share = f"{100 * config.beta:g} %"
    level = f"Level `{config.level}` at {config.rows}x{config.cols}"
    return Texts(
        setting=f"level {config.level}, {config.rows} x {config.cols}",
        observations="People and policies are given the same: the cells that were discovered.",
        briefing=_briefing(config, share),
        design=f"{level}, lidar radius {config.sensor_radius},\ncomplete at {share} of the cells.",
        minutes=config.n / 441 * 0.75,  # three quarters of a minute on 441 cells
        study_title="How well do people explore Mars? ({name})",
        opening=OPENING,
        things="terrains",
        questions=QUESTIONS,
        placeholders={
            "coverage": share,
            "lidar_radius": config.sensor_radius,
            "rows": config.rows,
            "cols": config.cols,
        },
    )


def _briefing(config: EnvConfig, share: str) -> str:
    """What the rover sees, how it moves, and how an attempt ends."""
    cells = "of what can be seen" if config.discoverable_only else "of all cells"
    return (
        f"A rover explores {config.rows} x {config.cols} cells that it does not know. It sees the free cells and the rock "
        f"in its line of sight, up to {config.sensor_radius} cells away. A move takes it one cell north, east, south or "
        f"west; a move into rock or off the map ends the attempt. The attempt is complete at {share} "
        f"{cells}, and over after {counted(config.limit, 'move')}. Map as much as you can in as few moves as you can."
    )
