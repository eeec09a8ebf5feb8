"""The columns of a release's tables, from which Parquet types, Croissant fields and the dictionary are made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

ColumnType = Literal["text", "integer", "real", "boolean"]


@dataclass(frozen=True)
class Column:
    """A column: its type, what it means (with its unit), and whether it may be absent."""

    name: str
    type: ColumnType
    meaning: str
    optional: bool = False


def _columns(text: str) -> tuple[Column, ...]:
    found = []
    for line in filter(None, text.splitlines()):
        name, kind, meaning = (part.strip() for part in line.split("|", 2))
        found.append(Column(name, kind.rstrip("?"), meaning, kind.endswith("?")))  # type: ignore[arg-type]
    return tuple(found)


_WHO = """
participant   | text     | pseudonym of the participant, drawn anew for each release
kind          | text     | human, or script: a synthetic player, never part of a human figure
phase         | text     | tutorial, warm_up (does not count) or ranked
trial         | integer  | 0, 1, ... in the order played within the phase
terrain_index | integer  | which of the phase's terrains, the same for everybody: i of the seed's formula
episode       | text     | id of the episode; joins the tables
"""

PARTICIPANT_TABLE = _columns(
    """
participant   | text     | pseudonym, drawn anew for each release
kind          | text     | human, or script: a synthetic player, never part of a human figure
script        | text?    | what played, for kind script
recruitment   | text     | of the study: open (one link), invitation (single-use links) or panel (outside ids required)
invited       | boolean  | an invitation brought them
supervised    | boolean  | the operator's code was typed for them
consent_version | text   | version of the consent text that they agreed to
stage         | text     | the last one: instructions, tutorial, questions, warm_up, ranked, debrief, complete or withdrawn
joined_ms     | integer  | server time, milliseconds since 1970 (UTC)
completed_ms  | integer? | when the last ranked episode ended; absent before
modality      | text?    | of the last move: keyboard, touch
palette       | text?    | colours chosen on the page
attempts      | integer  | how often the understanding questions were answered
answers       | text     | each attempt's choices, JSON: a list of lists of indices
deviations    | integer  | deviations from the protocol that the server noted
ranked_episodes | integer | ranked episodes finished
ranked_by_human | integer | of these, with driver human
ranked_unattested | integer | of these, unattested
ranked_declared | integer | of these, declared
ranked_attested | integer | of these, attested
ranked_supervised | integer | of these, supervised
ranked_labelled | integer | of these, with a label of implausible input
labels        | text?    | which labels, "; " between them; absent without one
max_pause_share | real?  | largest pause_share of a ranked episode; absent without one
mean_pause_share | real? | their mean
"""
)

EPISODE_TABLE = _columns(
    _WHO
    + """
driver        | text     | human when the page called every move a key or touch of the participant, else script
attestation   | text?    | unattested, declared, attested or supervised (docs/study.md); absent for scripts
attestation_reason | text? | why it is not attested
script        | text?    | what played, for kind script
level         | text     | random, or t-m-b of section 3.3 of the paper
rows          | integer  | cells from north to south
cols          | integer  | cells from west to east
sensor_radius | integer  | reach of the lidar, cells
beta          | real     | share of all cells to discover
max_steps     | integer  | moves after which an episode times out
config_hash   | text     | SHA-256 of the configuration's canonical JSON
seed          | integer? | draws the terrain under this core_version
start_row     | integer  | where the rover began; row 0 is the north edge
start_col     | integer  | where the rover began; column 0 is the west edge
terrain       | text     | the obstacle map: bits row by row, hexadecimal (numpy.packbits)
core_version  | text     | version of the rules it was played under
started_ms    | integer  | server time, milliseconds since 1970 (UTC)
ended_ms      | integer  | server time, milliseconds since 1970 (UTC)
outcome       | text     | explored, collided, out_of_bounds, timed_out or abandoned
steps         | integer  | moves made
discovered    | integer  | cells discovered
coverage      | real     | share of all cells, 0..1
return        | real     | sum of the rewards; abandoning costs r_invalid more
score         | real     | (return + r_invalid) / (r_invalid + r_bonus + cells): 0 for an invalid first move, at most 1
steps_to_99   | integer  | moves of an explored episode, max_steps of any other
labels        | text?    | labels of implausible input, "; " between them; absent without one
pause_share   | real     | share of the time between first and last move, 0..1, that was paused or out of sight
trajectory_hash | text   | SHA-256 over configuration, terrain, start and each move's position, discovered cells and reward
"""
)

STEP_TABLE = _columns(
    """
participant   | text     | pseudonym, as in episodes
episode       | text     | id of the episode
step          | integer  | moves made before this one, from 0
action        | text     | north, east, south or west
row           | integer  | where the rover stands after it (replayed)
col           | integer  | where the rover stands after it (replayed)
discovered    | integer  | cells discovered after it
coverage      | real     | their share of all cells, 0..1
reward        | real     | what it paid
server_ms     | integer  | when the server made it, milliseconds since 1970 (UTC)
client_ms     | real?    | when the page sent it, milliseconds of the page's own clock
key_down_ms   | real?    | when the key went down, same clock
key_up_ms     | real?    | when the key went up, same clock
input         | text?    | key or touch; absent when it came from elsewhere
driver        | text     | who made this move: human or script
"""
)

INPUT_EVENT_TABLE = _columns(
    """
participant   | text     | pseudonym, as in episodes
episode       | text     | id of the episode
number        | integer  | 0, 1, ... in the order received
event         | text     | keydown, keyup, touchdown, touchup, focus, blur, visible, hidden, pause or resume
code          | text?    | the key by its place on the keyboard (KeyboardEvent.code)
repeat        | boolean? | the key was held and repeated itself
trusted       | boolean? | the browser says a person's device made it (isTrusted)
client_ms     | real     | milliseconds of the page's own monotonic clock
step          | integer? | moves made in the frame that was on screen
round_trip_ms | real?    | last measured round trip between page and server, milliseconds
server_ms     | integer  | when the server received it, milliseconds since 1970 (UTC)
"""
)

POLICY_EPISODE_TABLE = _columns(
    """
policy        | text     | name or path in the protocol; random is the zero of the human-normalized score
policy_hash   | text?    | SHA-256 of the policy's file; absent for a rule, which is code
terrain_index | integer  | which of the ranked terrains, as in episodes
seed          | integer  | draws the terrain under the protocol's core_version
outcome       | text     | explored, collided, out_of_bounds or timed_out
steps         | integer  | moves made
steps_to_99   | integer  | moves of an explored episode, max_steps of any other
score         | real     | normalized, as in episodes
actions       | text     | the moves, a letter each: N, E, S or W
trajectory_hash | text   | as in episodes
"""
)

MOVE_REGRET_TABLE = _columns(
    """
participant   | text     | pseudonym, as in episodes
episode       | text     | id of the episode, a ranked one
step          | integer  | which move, as in steps
action        | text     | made: north, east, south or west
regret        | integer  | moves that the best action would have saved, ppo going on (docs/evaluation.md)
best_action   | text     | the one made where none is better, else the first best one
kind          | text?    | of loss; absent where the regret is 0
"""
)

MOVE_AGREEMENT_TABLE = _columns(
    """
participant   | text     | pseudonym, as in episodes
episode       | text     | id of the episode, a ranked one
policy        | text     | name or path in the protocol
moves         | integer  | of the episode
agreed        | integer  | how many of them the policy, shown what the rover saw, would have made too
"""
)

SCORE_TABLE = tuple(
    column
    for column in EPISODE_TABLE
    if column.name
    in {
        *(
            "participant",
            "kind",
            "phase",
            "trial",
            "terrain_index",
            "episode",
            "driver",
            "attestation",
            "seed",
            "started_ms",
        ),
        *(
            "ended_ms",
            "outcome",
            "steps",
            "discovered",
            "coverage",
            "return",
            "score",
            "steps_to_99",
        ),
    }
)

BUNDLE_COLUMNS: dict[str, tuple[Column, ...]] = {
    "participants": PARTICIPANT_TABLE,
    "episodes": EPISODE_TABLE,
    "steps": STEP_TABLE,
    "input_events": INPUT_EVENT_TABLE,
    "policy_episodes": POLICY_EPISODE_TABLE,
    "move_regrets": MOVE_REGRET_TABLE,
    "move_agreements": MOVE_AGREEMENT_TABLE,
    "scores": SCORE_TABLE,
}
SUMMARIES = {
    "participants": "one row a participant: how they came, how far they got, what is to be said of their input",
    "episodes": "one row an episode: who, what was played, what it came to",
    "steps": "one row a move",
    "input_events": "one row a key, touch, focus, visibility or pause event of the page",
    "policy_episodes": "one row an episode of a policy on a ranked terrain; the report's comparisons come from these",
    "move_regrets": "one row a move of a ranked episode: what it cost; the report's regret comes from these",
    "move_agreements": "one row a ranked episode and policy; the report's likeness to policies comes from these",
    "scores": "one row an episode, for a spreadsheet: who, which terrain, what it came to",
}
PRIMARY_KEYS: dict[str, tuple[str, ...]] = {
    "participants": ("participant",),
    "episodes": ("episode",),
    "steps": ("episode", "step"),
    "input_events": ("episode", "number"),
    "policy_episodes": ("policy", "terrain_index"),
    "move_regrets": ("episode", "step"),
    "move_agreements": ("episode", "policy"),
    "scores": ("episode",),
}
"""Table -> the columns that together name a row."""

FOREIGN_KEYS: dict[str, dict[str, str]] = {
    "episodes": {"participant": "participants"},
    "steps": {"participant": "participants", "episode": "episodes"},
    "input_events": {"participant": "participants", "episode": "episodes"},
    "move_regrets": {"participant": "participants", "episode": "episodes"},
    "move_agreements": {"participant": "participants", "episode": "episodes"},
    "scores": {"participant": "participants", "episode": "episodes"},
}
"""Table -> column -> the table whose column of that name, its primary key, holds the same values."""


def dictionary() -> dict[str, Any]:
    """Return the column dictionary, JSON-ready: table -> its columns with type, meaning, optional."""
    return {
        table: {
            "summary": SUMMARIES[table],
            "columns": [
                {
                    "name": column.name,
                    "type": column.type,
                    "meaning": column.meaning,
                    "optional": column.optional,
                }
                for column in columns
            ],
        }
        for table, columns in BUNDLE_COLUMNS.items()
    }


def markdown(table: str) -> str:
    """Return a table's columns as Markdown, as docs/release.md and the datasheet print them."""
    lines = ["| column | type | meaning |", "|---|---|---|"]
    for column in BUNDLE_COLUMNS[table]:
        kind = f"{column.type}, may be absent" if column.optional else column.type
        lines.append(f"| `{column.name}` | {kind} | {column.meaning} |")
    return "\n".join(lines)
