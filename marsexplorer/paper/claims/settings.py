"""The settings of the four algorithms in one table: the paper's appendix, the authors' repository, and what ran here.

`ours` is never the source of a run. The trainers have configurations of their own and write them into the first line of a
trial's log; `differences` compares such a line with the table, so that the table cannot say anything else than what ran.

The repository's values are those of `trainners/runners/{PPO,A2C,DQN}.py` and `trainners/runners_legacy/SAC.py`. What these
scripts leave alone is RLlib 1's default (`rllib/agents/{ppo,a3c,dqn,sac}`), marked so.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

NETWORK = "[[8,[3,3],2],[16,[2,2],2],[512,[6,6],1]]"
"""`config['model']['conv_filters']` of every script: filters, kernel, stride; the last is a dense layer on 21x21."""


class NoValue:
    """What stands in place of a value: `words` say why there is none."""

    def __init__(self, words: str) -> None:
        self.words = words

    def __repr__(self) -> str:
        return self.words


NOT_RUN = NoValue("not yet run")


@dataclass(frozen=True)
class Setting:
    """One row.

    parameter   what it is
    paper       what the appendix prints, None where it says nothing
    repository  what the authors' script or RLlib's default has, None where neither has it
    key         where a trial's `settings` have it, with dots into objects
    ours        its value in the variant "paper"
    tuned       its value in the variant "tuned"
    reason      why ours differs, or where a value comes from that the paper leaves open
    in_works    whether the variant "works" has the value of "tuned", else that of "paper"
    """

    algorithm: str
    parameter: str
    paper: str | None
    repository: str | None
    key: str
    ours: Any = NOT_RUN
    tuned: Any = NOT_RUN
    reason: str = ""
    in_works: bool = False

    @property
    def works(self) -> Any:
        """Its value in the variant "works"."""
        return self.tuned if self.in_works else self.ours


DEFAULT = "RLlib's default, since the paper says nothing"
RECIPE = "tuned: what our recipe `best` has"
LONG_EPISODES = "tuned: at 0.95 a cell that is seen 50 moves later counts for a thirteenth"
LIGHT = "the variant `appendix` has 30 passes of 128 moves; 6 of 500 take an eighth of the time"
NO_END = "tuned: the ends of +-441 swamp the values of new cells"
A3C_STEPS = "paper: A3C's default of RLlib"
HESSEL = "as Hessel et al. 2018 have it; with RLlib's default it would be no Rainbow"
SUPPORT = "it must hold the +-441 of the paper's reward, or the returns of the changed one"
BATCH = "tuned: larger batches, fewer gradient steps"
ENVIRONMENTS = "stepped together"
SAC_WORKERS = "paper: as with the 8 workers of `runnerSAC.py`"
FEATURES = "works: a head over features has a layer of 64 units of its own"
ENTROPY = "works: the default wants nearly the entropy of chance, which a masked policy cannot have, so its weight grows"
MASK = "works: a move that is known to be invalid has no probability"
CELL = "worth of a new cell in moves; 0: eq. 8"
TWO_LAYERS = "two convolutions, one dense layer"
AUTHORS = "paper: the authors' sizes; works: our features instead of the state matrix"


def _changes(algorithm: str) -> tuple[Setting, ...]:
    """Return the rows that the algorithms share: what is changed of the task, not of the algorithm."""
    return (
        Setting(
            algorithm,
            "worth of a new cell in moves; 0: eq. 8",
            "eq. 8",
            "see the claims",
            "reward_per_cell",
            0.0,
            0.18,
            NO_END,
        ),
        Setting(
            algorithm,
            "n and -n at the end",
            "used",
            "400 and -400",
            "has_bonus",
            True,
            False,
            NO_END,
        ),
        Setting(
            algorithm,
            "mask of invalid moves",
            None,
            "none",
            "mask",
            False,
            True,
            MASK,
            in_works=True,
        ),
        Setting(
            algorithm,
            "network",
            TWO_LAYERS,
            f"`{NETWORK}`",
            "network",
            "authors",
            "features",
            AUTHORS,
            in_works=True,
        ),
    )


SETTINGS: tuple[Setting, ...] = (
    Setting("ppo", "discount", "0.95", "0.9", "gamma", 0.95, 0.997, LONG_EPISODES),
    Setting("ppo", "learning rate", "5e-5", "5e-5, default", "learning_rate", 5e-5, 5e-4, RECIPE),
    Setting(
        "ppo",
        "learning rate at the end",
        None,
        "the same, default",
        "final_learning_rate",
        5e-5,
        2e-5,
        RECIPE,
    ),
    Setting(
        "ppo",
        "GAE lambda",
        "0.95",
        "1.0, default; 0.95 in `non-learning/params.json`",
        "gae_lambda",
        0.95,
        0.95,
    ),
    Setting(
        "ppo", "coefficient of the divergence", "0.2", "0.2, default", "kl_coef", 0.2, 0.0, RECIPE
    ),
    Setting("ppo", "wanted divergence", None, "0.01, default", "kl_target", 0.01, 0.01, DEFAULT),
    Setting("ppo", "clip of the ratio", "0.3", "0.3, default", "clip_coef", 0.3, 0.2, RECIPE),
    Setting(
        "ppo",
        "critic: coefficient of the value loss",
        "used",
        "1.0, default",
        "vf_coef",
        1.0,
        0.0125,
        RECIPE,
    ),
    Setting(
        "ppo",
        "clip of the change of the value",
        None,
        "10, default",
        "vf_change_clip",
        10.0,
        None,
        DEFAULT,
    ),
    Setting(
        "ppo",
        "entropy in the loss, nats wanted",
        None,
        "0, default",
        "target_entropy",
        None,
        [0.4, 0.04],
        RECIPE,
    ),
    Setting("ppo", "environments", None, "20 workers", "num_envs", 20, 256, RECIPE),
    Setting(
        "ppo",
        "moves of each between updates",
        None,
        "200, default: 4,000 together",
        "num_steps",
        200,
        64,
        DEFAULT,
    ),
    Setting("ppo", "passes over them", None, "30, default", "update_epochs", 6, 3, LIGHT),
    Setting(
        "ppo", "moves in a gradient step", None, "128, default", "minibatch_size", 500, 2048, LIGHT
    ),
    Setting(
        "ppo",
        "largest norm of the gradient",
        None,
        "none, default",
        "max_grad_norm",
        None,
        1.0,
        DEFAULT,
    ),
    Setting(
        "ppo",
        "updates of the value alone at first",
        None,
        None,
        "value_warmup_updates",
        0,
        6,
        RECIPE,
    ),
    *_changes("ppo"),
    Setting("a2c", "discount", "0.95", "0.9", "gamma", 0.95, 0.99, LONG_EPISODES),
    Setting("a2c", "learning rate", "1e-4", "1e-4, default", "learning_rate", 1e-4, 1e-3, BATCH),
    Setting("a2c", "GAE lambda", "0.99", "1.0, default", "gae_lambda", 0.99, 0.95, LONG_EPISODES),
    Setting(
        "a2c", "critic: coefficient of the value loss", "0.5", "0.5, default", "vf_coef", 0.5, 0.5
    ),
    Setting("a2c", "coefficient of the entropy", "0.01", "0.01, default", "ent_coef", 0.01, 0.01),
    Setting(
        "a2c",
        "largest norm of the gradient of a batch's sum",
        None,
        "40, default",
        "max_grad_norm",
        40.0,
        1024.0,
        BATCH,
    ),
    Setting("a2c", "environments", None, "20 workers", "num_envs", 20, 64, BATCH),
    Setting(
        "a2c",
        "moves of each between updates",
        None,
        "20, default; A3C's is 10",
        "num_steps",
        10,
        16,
        A3C_STEPS,
    ),
    *_changes("a2c"),
    Setting("rainbow", "discount", "0.95", "0.9", "gamma", 0.95, 0.99, LONG_EPISODES),
    Setting("rainbow", "learning rate", "5e-4", "5e-4, default", "learning_rate", 5e-4, 5e-4),
    Setting("rainbow", "1. noisy network", "used", "`noisy` = False", "noisy", True, True),
    Setting(
        "rainbow", "its first sigma", "0.5", "0.5, default, without effect", "noisy_sigma", 0.5, 0.5
    ),
    Setting("rainbow", "2. dueling network", "used", "used, default", "dueling", True, True),
    Setting("rainbow", "3. double Q", "used", "used, default", "double_q", True, True),
    Setting(
        "rainbow",
        "4. prioritized replay",
        "used",
        "used, default",
        "prioritized_replay",
        True,
        True,
    ),
    Setting(
        "rainbow",
        "5. distribution of returns: atoms",
        None,
        "1, default: no distribution",
        "num_atoms",
        51,
        51,
        HESSEL,
    ),
    Setting(
        "rainbow",
        "its support",
        None,
        "-400 to 400, without effect for one atom",
        "support",
        [-461.0, 461.0],
        [-60.0, 40.0],
        SUPPORT,
    ),
    Setting("rainbow", "6. steps of the return", None, "1, default", "n_step", 3, 3, HESSEL),
    Setting(
        "rainbow",
        "epsilon",
        "1.0 to 0.02",
        "the same, default",
        "epsilon",
        [1.0, 0.02],
        [1.0, 0.02],
    ),
    Setting(
        "rainbow",
        "moves until epsilon has fallen",
        None,
        "10,000, default",
        "epsilon_moves",
        10_000,
        10_000,
        DEFAULT,
    ),
    Setting(
        "rainbow",
        "size of the buffer, moves",
        "50,000",
        "50,000, default",
        "buffer_size",
        50_000,
        50_000,
    ),
    Setting(
        "rainbow", "moves in a gradient step", None, "32, default", "batch_size", 32, 128, BATCH
    ),
    Setting(
        "rainbow",
        "moves between gradient steps",
        None,
        "4 of every worker, default",
        "moves_per_update",
        4,
        16,
        BATCH,
    ),
    Setting(
        "rainbow",
        "moves between copies to the target",
        None,
        "500, default",
        "target_update_freq",
        500,
        2000,
        BATCH,
    ),
    Setting(
        "rainbow",
        "largest norm of the gradient",
        None,
        "40, default",
        "max_grad_norm",
        40.0,
        40.0,
        DEFAULT,
    ),
    Setting("rainbow", "environments", None, "20 workers", "num_envs", 16, 16, ENVIRONMENTS),
    *_changes("rainbow"),
    Setting("sac", "discount", "0.95", "0.9", "gamma", 0.95, 0.99, LONG_EPISODES),
    Setting("sac", "learning rate", "3e-4", "3e-4, default", "learning_rate", 3e-4, 3e-4),
    Setting("sac", "twin Q", "used", "used, default", "twin_q", True, True),
    Setting(
        "sac",
        "hidden layers of Q",
        "[256, 256]",
        "the same, default",
        "q_hidden",
        [256, 256],
        [],
        FEATURES,
        in_works=True,
    ),
    Setting(
        "sac",
        "hidden layers of the policy",
        "[256, 256]",
        "the same, default",
        "policy_hidden",
        [256, 256],
        [],
        FEATURES,
        in_works=True,
    ),
    Setting(
        "sac",
        "size of the buffer, moves",
        "1,000,000",
        "500,000; 300,000 in `runnerSAC.py`",
        "buffer_size",
        1_000_000,
        100_000,
        BATCH,
    ),
    Setting("sac", "prioritized replay", "used", "used", "prioritized_replay", True, True),
    Setting("sac", "moves in a gradient step", None, "256, default", "batch_size", 256, 128, BATCH),
    Setting(
        "sac",
        "moves between gradient steps",
        None,
        "1 of every worker, default",
        "moves_per_update",
        8,
        16,
        SAC_WORKERS,
    ),
    Setting(
        "sac",
        "moves before the first",
        None,
        "1,500, default",
        "learning_starts",
        1500,
        1500,
        DEFAULT,
    ),
    Setting(
        "sac", "rate of the target networks", None, "0.005, default", "tau", 0.005, 0.005, DEFAULT
    ),
    Setting(
        "sac",
        "first weight of the entropy",
        None,
        "1.0, default",
        "initial_alpha",
        1.0,
        0.2,
        ENTROPY,
        in_works=True,
    ),
    Setting(
        "sac",
        "wanted entropy, share of log 4",
        None,
        '"auto", default: 0.98',
        "target_entropy",
        0.98,
        0.1,
        ENTROPY,
        in_works=True,
    ),
    Setting(
        "sac", "environments", None, "8 workers in `runnerSAC.py`", "num_envs", 16, 16, ENVIRONMENTS
    ),
    *_changes("sac"),
)
"""The table, in the order of the page."""
COLUMNS = {"paper": "ours", "works": "works", "tuned": "tuned"}
"""Variant -> what has its value in a row."""


def of(algorithm: str) -> Iterator[Setting]:
    """Yield the rows of an algorithm."""
    return (setting for setting in SETTINGS if setting.algorithm == algorithm)


def value_at(settings: dict[str, Any], key: str) -> Any:
    """Return a logged setting by its key, with dots into objects; KeyError, naming the key, when it was not logged."""
    value: Any = settings
    for part in key.split("."):
        if not isinstance(value, dict) or part not in value:
            raise KeyError(key)
        value = value[part]
    return value


def differences(algorithm: str, variant: str, settings: dict[str, Any]) -> list[str]:
    """Return a sentence for each row that a trial's `settings` do not confirm; none for variants that the table has not.

    settings  as the first line of a trial's log has them
    """
    if variant not in COLUMNS:
        return []
    found, settings = [], json.loads(json.dumps(settings))  # as the log has them: tuples are lists
    for row in of(algorithm):
        wanted = getattr(row, COLUMNS[variant])
        if wanted is NOT_RUN:
            continue
        try:
            value = value_at(settings, row.key)
        except KeyError:
            found.append(
                f"{algorithm} {variant}: {row.parameter} is {wanted!r} in the table, and the run logged no {row.key!r}"
            )
            continue
        if value != wanted:
            found.append(
                f"{algorithm} {variant}: {row.parameter} is {wanted!r} in the table and was {value!r} in the run"
            )
    return found


def words(value: Any) -> str:
    """Return a value as a cell of a table."""
    if isinstance(value, bool):
        return "used" if value else "not used"
    if isinstance(value, int):
        return f"{value:,}"
    return "none" if value is None or value == [] else str(value)


def as_table(algorithm: str) -> str:
    """Return the rows of an algorithm as a table in Markdown."""
    lines = [
        "| setting | paper | repository | ours: paper | ours: works | ours: tuned | why |",
        "|---" * 7 + "|",
    ]
    for row in of(algorithm):
        cells = (
            row.parameter,
            row.paper or "",
            row.repository or "",
            *(words(getattr(row, name)) for name in COLUMNS.values()),
            row.reason,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
