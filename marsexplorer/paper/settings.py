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


class NotRun:
    """The value of a setting that no trainer has logged yet."""

    def __repr__(self) -> str:
        return "not yet run"


NOT_RUN = NotRun()


@dataclass(frozen=True)
class Setting:
    """One row.

    parameter   what it is
    paper       what the appendix prints, None where it says nothing
    repository  what the authors' script or RLlib's default has, None where neither has it
    key         where a trial's `settings` have it, with dots into objects
    ours        its value in the variant "paper"
    works       its value in the variant "works"
    reason      why ours differs, or where a value comes from that the paper leaves open
    """

    algorithm: str
    parameter: str
    paper: str | None
    repository: str | None
    key: str
    ours: Any = NOT_RUN
    works: Any = NOT_RUN
    reason: str = ""


DEFAULT = "RLlib's default, since the paper says nothing"
RECIPE = "works: what our recipe `best` has"
LONG_EPISODES = "works: at 0.95 a cell that is seen 50 moves later counts for a thirteenth"
LIGHT = "the variant `appendix` has 30 passes of 128 moves; 6 of 500 take an eighth of the time"
NO_END = "works: the ends of +-441 swamp the values of new cells"
FEATURES = (
    "paper: RLlib's default sizes, 16 and 32 filters of 4x4 and 256 units; works: our features, which know the valid moves"
)

SETTINGS: tuple[Setting, ...] = (
    Setting("ppo", "discount", "0.95", "0.9", "gamma", 0.95, 0.997, LONG_EPISODES),
    Setting("ppo", "learning rate", "5e-5", "5e-5, default", "learning_rate", 5e-5, 5e-4, RECIPE),
    Setting("ppo", "learning rate at the end", None, "the same, default", "final_learning_rate", 5e-5, 2e-5, RECIPE),
    Setting("ppo", "GAE lambda", "0.95", "1.0, default; 0.95 in `non-learning/params.json`", "gae_lambda", 0.95, 0.95),
    Setting("ppo", "coefficient of the divergence", "0.2", "0.2, default", "kl_coef", 0.2, 0.0, RECIPE),
    Setting("ppo", "wanted divergence", None, "0.01, default", "kl_target", 0.01, 0.01, DEFAULT),
    Setting("ppo", "clip of the ratio", "0.3", "0.3, default", "clip_coef", 0.3, 0.2, RECIPE),
    Setting("ppo", "critic: coefficient of the value loss", "used", "1.0, default", "vf_coef", 1.0, 0.0125, RECIPE),
    Setting("ppo", "clip of the change of the value", None, "10, default", "vf_change_clip", 10.0, None, DEFAULT),
    Setting("ppo", "entropy in the loss, nats wanted", None, "0, default", "target_entropy", None, [0.4, 0.04], RECIPE),
    Setting("ppo", "environments", None, "20 workers", "num_envs", 20, 256, RECIPE),
    Setting("ppo", "moves of each between updates", None, "200, default: 4,000 together", "num_steps", 200, 64, DEFAULT),
    Setting("ppo", "passes over them", None, "30, default", "update_epochs", 6, 3, LIGHT),
    Setting("ppo", "moves in a gradient step", None, "128, default", "minibatch_size", 500, 2048, LIGHT),
    Setting("ppo", "largest norm of the gradient", None, "none, default", "max_grad_norm", None, 1.0, DEFAULT),
    Setting("ppo", "updates of the value alone at first", None, None, "value_warmup_updates", 0, 6, RECIPE),
    Setting(
        "ppo",
        "worth of a new cell in moves; 0: eq. 8",
        "eq. 8",
        "see the claims",
        "reward_per_cell",
        0.0,
        0.18,
        NO_END,
    ),
    Setting("ppo", "n and -n at the end", "used", "400 and -400", "has_bonus", True, False, NO_END),
    Setting("ppo", "network", "two convolutions, one dense layer", f"`{NETWORK}`", "network", "paper", "features", FEATURES),
    Setting("a2c", "discount", "0.95", "0.9", "gamma"),
    Setting("a2c", "learning rate", "1e-4", "1e-4, default", "learning_rate"),
    Setting("a2c", "GAE lambda", "0.99", "1.0, default", "gae_lambda"),
    Setting("a2c", "critic: coefficient of the value loss", "0.5", "0.5, default", "vf_coef"),
    Setting("a2c", "coefficient of the entropy", "0.01", "0.01, default", "ent_coef"),
    Setting("a2c", "largest norm of the gradient", None, "40, default", "max_grad_norm"),
    Setting("a2c", "moves of each environment between updates", None, "20, default", "num_steps"),
    Setting("a2c", "network", "two convolutions, one dense layer", f"`{NETWORK}`", "network"),
    Setting("rainbow", "discount", "0.95", "0.9", "gamma"),
    Setting("rainbow", "learning rate", "5e-4", "5e-4, default", "learning_rate"),
    Setting("rainbow", "1. noisy network", "used", "`noisy` = False", "noisy"),
    Setting("rainbow", "its first sigma", "0.5", "0.5, default, without effect", "noisy_sigma"),
    Setting("rainbow", "2. dueling network", "used", "used, default", "dueling"),
    Setting("rainbow", "3. double Q", "used", "used, default", "double_q"),
    Setting("rainbow", "4. prioritized replay", "used", "used, default", "prioritized_replay"),
    Setting("rainbow", "5. distribution of returns: atoms", None, "1, default: no distribution", "num_atoms"),
    Setting("rainbow", "its support", None, "-400 to 400, without effect for one atom", "support"),
    Setting("rainbow", "6. steps of the return", None, "1, default", "n_step"),
    Setting("rainbow", "epsilon", "1.0 to 0.02", "1.0 to 0.02 in 10,000 moves, default", "epsilon"),
    Setting("rainbow", "size of the buffer, moves", "50,000", "50,000, default", "buffer_size"),
    Setting("rainbow", "moves in a gradient step", None, "32, default", "batch_size"),
    Setting("rainbow", "moves between copies to the target network", None, "500, default", "target_update_freq"),
    Setting("rainbow", "network", "two convolutions, one dense layer", f"`{NETWORK}`", "network"),
    Setting("sac", "discount", "0.95", "0.9", "gamma"),
    Setting("sac", "learning rate", "3e-4", "3e-4, default", "learning_rate"),
    Setting("sac", "twin Q", "used", "used, default", "twin_q"),
    Setting("sac", "hidden layers of Q", "[256, 256]", "[256, 256], default", "q_hidden"),
    Setting("sac", "hidden layers of the policy", "[256, 256]", "[256, 256], default", "policy_hidden"),
    Setting("sac", "size of the buffer, moves", "1,000,000", "500,000; 300,000 in `runnerSAC.py`", "buffer_size"),
    Setting("sac", "prioritized replay", "used", "used", "prioritized_replay"),
    Setting("sac", "moves in a gradient step", None, "256, default", "batch_size"),
    Setting("sac", "rate of the target networks", None, "0.005, default", "tau"),
    Setting("sac", "first weight of the entropy", None, "1.0, default", "initial_alpha"),
    Setting("sac", "wanted entropy", None, '"auto", default', "target_entropy"),
    Setting("sac", "network", "two convolutions, one dense layer", f"`{NETWORK}`", "network"),
)
"""The table, in the order of the page."""


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
    if variant not in ("paper", "works"):
        return []
    found, settings = [], json.loads(json.dumps(settings))  # as the log has them: tuples are lists
    for row in of(algorithm):
        wanted = row.ours if variant == "paper" else row.works
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
            found.append(f"{algorithm} {variant}: {row.parameter} is {wanted!r} in the table and was {value!r} in the run")
    return found


def words(value: Any) -> str:
    """Return a value as a cell of a table."""
    if isinstance(value, bool):
        return "used" if value else "not used"
    if isinstance(value, int):
        return f"{value:,}"
    return "none" if value is None else str(value)


def as_table(algorithm: str) -> str:
    """Return the rows of an algorithm as a table in Markdown."""
    lines = ["| setting | paper | repository | ours: paper | ours: works | why |", "|---|---|---|---|---|---|"]
    for row in of(algorithm):
        cells = (row.parameter, row.paper or "", row.repository or "", words(row.ours), words(row.works), row.reason)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
