"""Training configurations: `best`, from nothing, and `priced`, from priced rules."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

from torch import nn

from marsexplorer.config import EnvConfig
from marsexplorer.training.envs import EncoderFactory, feature_encoder
from marsexplorer.training.network import Net, save_network

FAMILIES = ("random", "1-1-1", "1-2-1", "2-1-1", "2-2-1", "3-1-1", "3-2-1")
"""The levels of `--level all`: t-m-2 has the terrains of t-m-1 and differs only in its rewards."""
LIMITS = "Deterministic; a guard follows the nearest frontier for 8 moves where it would circle."
"""The policies' limits, as their cards state them."""


@dataclass(frozen=True)
class TrainConfig:
    """All settings of a run but its terrains, length and seed; the card lists them.

    name                                its name for `--recipe`
    prior_scale                         factor of the priced rules' logits that the network begins
                                        with; 0: it learns from nothing. At 1 the rules are almost
                                        certain of every move, so that no other is tried
    rule_coef                           coefficient of the network's cross-entropy to the rules, on
                                        21x21, 42x42, 84x84
    reward_per_cell                     rewards in units of moves, a new cell being worth so many;
                                        0: eq. 8 as it is
    has_bonus                           whether eq. 8 pays +-n where an episode ends, on the levels
                                        that have it
    num_envs, num_steps                 environments stepped together; steps of each between updates
    update_epochs, minibatch_size       passes over a rollout; steps in a gradient step
    clip_coef                           clip of the ratio (Schulman et al. 2017, eq. 7)
    learning_rate, final_learning_rate  Adam's, annealed linearly from the one to the other
    target_entropy                      entropy of the policy wanted at the beginning and at the
                                        end, nats; its coefficient in the loss is adapted to it.
                                        None: no entropy in the loss
    kl_coef, kl_target                  coefficient of the divergence from the policy that played,
                                        at first, and the divergence that it is adapted to (Schulman
                                        et al. 2017, section 4); 0: no such term
    kl_of_last_epoch                    whether that divergence is the last pass's, as RLlib 1.0.1
                                        takes it; else of all passes
    vf_coef, vf_clip                    coefficient of the value loss; the largest squared error
                                        that counts
    vf_change_clip                      a value's change since the rollout is clipped at so much,
                                        and the larger one of the two squared errors counts (RLlib
                                        1.0.1's vf_clip_param)
    gamma, gae_lambda                   discount and lambda of generalised advantage estimation
                                        (Schulman et al. 2016)
    value_warmup_updates                updates of the value alone before the policy changes
    max_grad_norm                       gradients are clipped to this norm
    """

    name: str = "best"
    prior_scale: float = 0.0
    rule_coef: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reward_per_cell: float = 0.18
    has_bonus: bool = True
    num_envs: int = 256
    num_steps: int = 64
    update_epochs: int = 3
    minibatch_size: int = 2048
    clip_coef: float = 0.2
    learning_rate: float = 5e-4
    final_learning_rate: float = 2e-5
    target_entropy: tuple[float, float] | None = (0.4, 0.04)
    kl_coef: float = 0.0
    kl_target: float = 0.01
    kl_of_last_epoch: bool = False
    vf_coef: float = 0.0125
    vf_clip: float = float("inf")
    vf_change_clip: float = float("inf")
    gamma: float = 0.997
    gae_lambda: float = 0.95
    value_warmup_updates: int = 6
    max_grad_norm: float = 1.0

    @property
    def batch_size(self) -> int:
        """Steps between two updates: num_envs * num_steps."""
        return self.num_envs * self.num_steps

    @property
    def make_encoder(self) -> EncoderFactory:
        """Makes the encoder that turns an environment's state into the network's input."""
        return feature_encoder

    @property
    def has_critic(self) -> bool:
        """Whether the network's `value` shares nothing with its `logits`.

        Values are then computed once a rollout, for all its steps.
        """
        return False

    def make_network(self, env_configs: Iterable[EnvConfig]) -> nn.Module:
        """A freshly initialised network, which serves all environments."""
        del env_configs
        net = Net()
        net.prior.data *= self.prior_scale
        return net

    def save_policy(self, net: nn.Module, path: Path, card: dict[str, Any]) -> None:
        """Write the policy file of a network that `make_network` returned.

        It is written whole or not at all, with its limits on the card.
        """
        assert isinstance(net, Net)
        save_network(net, path, {"limits": LIMITS, **card})

    def to_dict(self) -> dict[str, Any]:
        """The fields as JSON-ready values (None for no bound)."""
        settings = asdict(self)
        return {
            name: None if setting == float("inf") else setting for name, setting in settings.items()
        }


def with_fields(config: TrainConfig, assignments: Iterable[str]) -> TrainConfig:
    """A configuration with some fields changed.

    Args:
        config: The configuration to change.
        assignments: FIELD=VALUE each; a field of several numbers takes them with commas, `none`
            stands for None and `inf` for no bound.

    Raises:
        ValueError: If an assignment is not of a field, or not of its type.
    """
    names = [setting.name for setting in fields(config) if setting.name != "name"]
    values: dict[str, Any] = {}
    for assignment in assignments:
        name, sign, text = assignment.partition("=")
        if not sign or name not in names:
            raise ValueError(
                f"expected FIELD=VALUE with a field of {', '.join(names)}, got {assignment!r}"
            )
        values[name] = _value(name, getattr(TrainConfig(), name), text)
    return replace(config, **values)


def _value(name: str, like: Any, text: str) -> Any:
    """Read a field's value from its text, of the type of its default."""
    if text == "none" and name == "target_entropy":
        return None
    kind = {bool: "true or false", int: "a whole number above 0", float: "a number"}.get(
        type(like), f"{len(like) if isinstance(like, tuple) else 0} numbers with commas"
    )
    try:
        if isinstance(like, bool):
            return {"true": True, "false": False}[text.lower()]
        if isinstance(like, tuple):
            numbers = tuple(map(float, text.split(",")))
            if len(numbers) != len(like) or not all(map(isfinite, numbers)):
                raise ValueError
            return numbers
        number = type(like)(text)
        least = name != "value_warmup_updates"
        if number != number or (isinstance(like, int) and number < least):
            raise ValueError
    except (KeyError, ValueError):
        raise ValueError(f"{name} takes {kind}, got {text!r}") from None
    return number


RECIPES = {
    "best": TrainConfig(),
    "priced": TrainConfig(
        name="priced",
        prior_scale=0.2,
        rule_coef=(0.02, 0.5, 5.0),  # few of the moves are made on 84x84
        learning_rate=1e-3,
        # adapted to a target, its coefficient grew until the policy had forgotten the rules
        target_entropy=None,
        gamma=0.999,
    ),
}
"""Name, as `--recipe` takes it -> configuration."""
