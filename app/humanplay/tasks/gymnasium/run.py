"""A running episode of a Gymnasium environment."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np

from humanplay.board.pictures import jpeg, png
from humanplay.task import AgentObservation, Allowed
from humanplay.tasks.base import EpisodeRecord, frame_text
from humanplay.tasks.gymnasium.codes import ActionCodes, Mask, allowed_in
from humanplay.tasks.gymnasium.configuration import GymnasiumConfig
from humanplay.tasks.gymnasium.description import actions_of
from humanplay.tasks.gymnasium.pictures import pixels_of
from humanplay.tasks.gymnasium.values import bytes_of, finite, plain, reward_of


def draw_once(config: GymnasiumConfig) -> None:
    """Begin an episode and draw it.

    Raises:
        ValueError: If it cannot be played, or something it needs is not installed.
    """
    try:
        run = GymnasiumRun(config, 0)
        run.check_reward()
        run.view()
    except gymnasium.error.DependencyNotInstalled as error:
        # the error names the line that suits the installed Gymnasium
        raise ValueError(f"{config.level} cannot be drawn: {error}") from error


class GymnasiumRun:
    """One running episode (`humanplay.task.Run`) of an environment, reset once.

    An episode succeeds by the rule of the description. Without a rule, one that ends by itself has
    the outcome `ended`.
    """

    is_live = False
    """Whether somebody waits for its pictures: then they are compressed less, but faster."""

    def __init__(
        self, config: GymnasiumConfig, seed: int, env: gymnasium.Env[object, object] | None = None
    ) -> None:
        """Reset a new environment, or `env`."""
        self.config, self.seed = config, seed
        self._described = config.description
        self._env = config.make(seed) if env is None else env
        self._names = actions_of(self._described, self._env)
        self._codes = ActionCodes(self._described.id, self._env.action_space)
        self._observation, self._info = self._described.begin(self._env, seed)
        self._hash = hashlib.sha256(f"{config.hash}|{seed}|".encode())
        self._hash.update(bytes_of(self._observation))
        self.actions, self._rewards, self._scores = bytearray(), list[float](), list[float]()
        self.outcome, self.total = "running", 0.0
        self._scores.append(self._score(0.0))
        self._allowed = list[Allowed]()
        self._look()

    def _look(self) -> None:
        """Ask the environment what may be chosen next, unless the episode has ended."""
        self._mask: Mask | None = None
        if self.outcome == "running":
            self._mask = self._codes.mask_of(self._env, self._observation, self._info)
            self._allowed.append(allowed_in(self._mask))

    def step(self, action: int) -> float:
        """Make one move and return its reward.

        Raises:
            RuntimeError: If the episode has ended.
            ValueError: If there is no such action, or a reward or a score is not finite.
        """
        if self.outcome != "running":
            raise RuntimeError(f"the episode has ended ({self.outcome}); begin another one")
        self._check_code(action)
        step = self._env.step(self._codes.own(action))
        self._observation, env_reward, terminated, truncated, self._info = step
        reward = reward_of(self._described.id, env_reward)
        self.total = finite("return", self.total + reward)
        self.actions.append(action)
        self._rewards.append(reward)
        self._scores.append(self._score(self._scores[-1]))
        if terminated or truncated or len(self.actions) >= self.config.limit:
            self.outcome = self._ending(bool(terminated))
        self._hash.update(f"|{action},{reward!r},{self.outcome}|".encode())
        self._hash.update(bytes_of(self._observation))
        self._look()
        return reward

    def _ending(self, terminated: bool) -> str:
        rule = self._described.success
        if rule.startswith("info."):
            is_success = bool(self._info.get(rule[5:]))
        elif rule:
            _, sign, bound = rule.split()
            is_success = self.total > float(bound) or (sign == ">=" and self.total == float(bound))
        else:
            is_success = False
        if is_success:
            return "succeeded"
        return ("failed" if rule else "ended") if terminated else "timed_out"

    def _score(self, before: float) -> float:
        """The headline metric so far: the return, or the last value in `info`, at first 0."""
        name = self._described.score
        return self.total if name == "return" else finite(name, self._info.get(name[5:], before))

    def check_reward(self) -> None:
        """Raise ValueError if the environment pays several rewards at once."""
        space = getattr(self._env.unwrapped, "reward_space", None)
        reward_of(self._described.id, np.zeros(getattr(space, "shape", ())))

    def scores(self) -> Sequence[float]:
        """The headline metric after 0, 1, 2, ... moves."""
        return self._scores

    def abandon(self) -> None:
        """End the episode as an abandoned one, with the score so far."""
        self.outcome = "abandoned"

    @property
    def ended(self) -> bool:
        """Whether the episode has an outcome."""
        return self.outcome != "running"

    def decide(self, choose: Callable[[Any, Mask], int]) -> int:
        """The action that `choose` returns for the observation and the mask.

        Raises:
            ValueError: If it is no action.
        """
        mask = np.ones(len(self._names), bool) if self._mask is None else self._mask
        action = choose(self.observation(), mask)
        self._check_code(action)
        return action

    def _check_code(self, code: int) -> None:
        if not 0 <= code < self._codes.count:
            raise ValueError(f"expected an action of {self._env.action_space}, got {code}")

    def code_of(self, action: object) -> int:
        """The code of an environment's own action; ValueError if there is none."""
        return self._codes.of_own(action)

    @property
    def newest_observation(self) -> object:
        """The environment's last observation itself."""
        return self._observation

    def observation(self) -> Any:
        """What a policy observes, as a new copy."""
        return deepcopy(self._observation)

    def allowed(self) -> Sequence[Allowed]:
        """What could be chosen before each move, and what may be now."""
        return self._allowed

    @property
    def allowed_names(self) -> tuple[str, ...] | None:
        """Names of the actions that may be chosen; None: all, or the episode has ended."""
        codes = self._allowed[-1] if self.outcome == "running" else None
        return None if codes is None else tuple(self._names[code] for code in codes)

    def view(self) -> GymnasiumView:
        """What may be seen of the run now."""
        shown = self._env.render()
        if isinstance(shown, str):
            return GymnasiumView(self, None, re.sub(r"\x1b\[[0-9;]*m", "", shown))
        pixels = pixels_of(shown)
        packed = jpeg(pixels) if self._described.codec == "jpeg" else png(pixels, self.is_live)
        return GymnasiumView(self, packed, None)

    def agent_observation(self, picture: bool, observation: bool) -> AgentObservation:
        """Picture or text, and the observation as JSON holds it."""
        shown = self.view() if picture else None
        return {
            "picture": None if shown is None else shown.picture,
            "text": None if shown is None else shown.text,
            "observation": plain(self.newest_observation) if observation else None,
            "allowed": self.allowed_names,
        }

    @property
    def digest(self) -> str:
        """SHA-256 (hex) over configuration, seed, moves, rewards and observations."""
        return self._hash.hexdigest()

    def record(self) -> EpisodeRecord:
        """The cause with actions and result."""
        return EpisodeRecord(
            self.config, self.seed, bytes(self.actions), self.outcome, self.total, self._scores[-1], len(self.actions),
            0, self.digest, self._described.versions,
        )  # fmt: skip

    def rewards(self) -> Sequence[float]:
        """The reward of each move."""
        return self._rewards

    def counts(self) -> Sequence[int]:
        """Zeros: nothing is discovered."""
        return [0] * (len(self._rewards) + 1)

    def place(self, step: int) -> Mapping[str, float]:
        """Nothing: an environment need not be a place."""
        return {}


class GymnasiumView:
    """What is seen of a run after some of its moves (`humanplay.task.View`).

    Args:
        picture: A data URL; None for an environment that is shown as text.
    """

    def __init__(self, run: GymnasiumRun, picture: str | None, text: str | None) -> None:
        rewards = run.rewards()
        self.steps, self.outcome, self.discovered = len(run.actions), run.outcome, 0
        self.ended, self.actions = run.outcome != "running", bytes(run.actions)
        self._reward, self._total = rewards[-1] if rewards else 0.0, run.total
        self._config, self._seed, self.picture, self.text = run.config, run.seed, picture, text
        self._scores = run.scores()  # which only grows
        self._score = self._scores[-1]
        self.allowed = None if self.ended else run.allowed()[-1]
        self._allowed_names = run.allowed_names

    def observation(self) -> tuple[GymnasiumConfig, int, bytes]:
        """What a policy's process gets (`policies`): the cause of the episode so far."""
        return self._config, self._seed, self.actions

    def frame(self, episode_id: str, hides_scores: bool = False) -> str:
        """The frame as JSON text, with the picture as a data URL; hidden figures are null."""
        shown = {"picture": self.picture, "text": self.text, "allowed": self._allowed_names}
        figures = self._reward, self._total, self._score
        return frame_text(self, episode_id, shown, figures, hides_scores)

    def history(self, episode_id: str, hides_scores: bool = False) -> str:
        """The headline after 0, 1, 2, ... moves as JSON text; hidden ones are null."""
        count = self.steps + 1
        headlines = [None] * count if hides_scores else self._scores[:count]
        history = {"kind": "history", "episode": episode_id, "headlines": headlines}
        return json.dumps(history, separators=(",", ":"))
