"""Recreates a program's environment with a picture, by its spec and its wrappers."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace

import gymnasium
from gymnasium.envs.registration import EnvSpec

from humanplay.cli.pilot.errors import PilotError
from humanplay.cli.pilot.names import importable_name
from humanplay.jobs import held
from humanplay.tasks.gymnasium.codes import ActionCodes, allowed_in
from humanplay.tasks.gymnasium.description import (
    CATALOGUE,
    Description,
    completed,
    described,
    spec_of,
)
from humanplay.tasks.gymnasium.values import bytes_of

Env = gymnasium.Env[object, object]
Wrapped = tuple[type[gymnasium.Wrapper[object, object, object, object]], Mapping[str, object]]
COMPARED = 20
"""Steps on which both must agree."""


class NotRecreatedError(PilotError):
    """An environment that a program holds cannot be made again.

    env     the one that it holds
    reason  why
    line    the call that plays what makes one
    """

    def __init__(self, env: Env, reason: str) -> None:
        self.env, self.reason, self.line = env, reason, line_of(env)
        super().__init__(f"{reason}: {self.line}")


@dataclass(frozen=True)
class Recreation:
    """Makes an environment again.

    spec      of the environment within all wrappers
    wrappers  the author's own, the innermost first, each with its arguments
    """

    spec: EnvSpec
    wrappers: tuple[Wrapped, ...]

    def __call__(self, render_mode: str | None = "rgb_array") -> Env:
        """A new environment."""
        env: Env = gymnasium.make(self.spec, render_mode=render_mode)
        for wrapper, arguments in self.wrappers:
            env = wrapper(env, **arguments)
        return env

    @property
    def told(self) -> str:
        """The description by names that other processes know; empty if a part has none."""
        wrappers = [importable_name(wrapper) for wrapper, _ in self.wrappers]
        name = _name_of(self.spec)
        if not name or not all(wrappers) or any(arguments for _, arguments in self.wrappers):
            return ""
        registered = spec_of(name)
        arguments = {
            argument: value
            for argument, value in self.spec.kwargs.items()
            if argument != "render_mode" and registered.kwargs.get(argument) != value
        }
        fields: dict[str, object] = {"id": name}
        if arguments:
            fields["kwargs"] = arguments
        if wrappers:
            fields["wrappers"] = wrappers
        if self.spec.max_episode_steps not in (None, registered.max_episode_steps):
            fields["max_steps"] = self.spec.max_episode_steps
        try:
            return Description.model_validate(fields).told
        except (TypeError, ValueError):  # of an argument that JSON does not hold
            return ""


def _name_of(spec: EnvSpec) -> str:
    """The id by which other processes make an environment; empty if there is none."""
    if not isinstance(spec.entry_point, str):
        return ""
    module, _, name = spec.entry_point.partition(":")
    top = module.partition(".")[0]
    if top == "gymnasium":
        return spec.id
    registered = f"{top}:{spec.id}"
    is_known = any(registered.startswith(beginning) for beginning in CATALOGUE["known"])
    # the second works whoever has registered it
    name = registered if is_known else f"{module}:{name}"
    try:
        spec_of(name)
    except ValueError:
        return ""
    return name


def recreated(env: Env) -> str:
    """Describe an environment that can be recreated; NotRecreatedError if it cannot."""
    layers = layers_of(env)
    specs = [layer.spec for layer in layers]
    # gymnasium.make made the outermost layer whose spec names no further wrapper
    made_at = next(
        (at for at, spec in enumerate(specs) if spec and not spec.additional_wrappers),
        len(layers) - 1,
    )
    spec = specs[made_at]
    if spec is None:
        raise NotRecreatedError(
            env,
            f"{type(env).__name__} was not made by gymnasium.make, so that nothing says how to make it again",
        )
    wrappers = tuple(
        (type(layer), getattr(layer, "_saved_kwargs", {}))
        for layer in reversed(layers[:made_at])
        if isinstance(layer, gymnasium.Wrapper)
    )
    recreation = Recreation(replace(spec, kwargs=dict(spec.kwargs)), wrappers)
    try:
        other = recreation()
    except (gymnasium.error.Error, ImportError, TypeError, ValueError) as error:
        raise NotRecreatedError(env, f"{spec.id} cannot be made again: {error}") from error
    try:
        with closing(other):
            difference = _difference(env, other)
    except Exception as error:  # whatever the environment raises
        raise NotRecreatedError(
            env, f"{spec.id} was made again, and the two cannot be compared: {error}"
        ) from error
    if difference:
        raise NotRecreatedError(env, f"{spec.id} was made again from its spec, and {difference}")
    return recreation.told or _held(recreation, env)


def _held(recreation: Recreation, env: Env) -> str:
    """Hold a function that recreates an environment, and describe it by the inner one."""
    classes = [wrapper.__name__ for wrapper, _ in reversed(recreation.wrappers)]
    title = " of ".join([*classes, recreation.spec.id])
    fields: dict[str, object] = {
        "id": f"{held.SCHEME}:{held.hold(recreation, title)}",
        "title": title[:100],
    }
    if (inner := _name_of(recreation.spec)) and env.action_space == env.unwrapped.action_space:
        inner_description = completed(described(inner))
        for name in ("actions", "keys", "instructions"):
            if field := getattr(inner_description, name):
                fields[name] = field
    return Description.model_validate(fields).told


def line_of(env: Env) -> str:
    """The call that plays what makes an environment, as far as its classes say how."""
    inner, spec = env.unwrapped, env.unwrapped.spec
    line = f"{type(inner).__name__}(render_mode='rgb_array')"
    if spec is not None:
        line = f"gymnasium.make({spec.id!r}, render_mode='rgb_array')"
    for layer in reversed(layers_of(env)[:-1]):
        if not type(layer).__module__.startswith("gymnasium.wrappers.common"):
            line = f"{type(layer).__name__}({line}, ...)"
    return f"play(lambda: {line})"


def layers_of(env: Env) -> list[Env]:
    """The wrappers of an environment from the outside, and then itself."""
    layers = [env]
    while isinstance(layers[-1], gymnasium.Wrapper):
        layers.append(layers[-1].env)
    return layers


def _difference(one: Env, other: Env) -> str:
    """Say at which of some steps two environments differ; empty if they agree on all."""
    for step, (first, second) in enumerate(zip(_steps(one), _steps(other), strict=True)):
        for part in first:
            if first[part] != second[part]:
                return f"its {part} differs at step {step}"
    return ""


def _steps(env: Env) -> Iterator[dict[str, object]]:
    """Play some allowed steps from fixed seeds, and yield what each leads to."""
    codes = ActionCodes(type(env.unwrapped).__name__, env.action_space)
    dice, seed = random.Random(0), 0
    observation, info = env.reset(seed=seed)
    yield {"observation": bytes_of(observation)}
    for _ in range(COMPARED):
        allowed = allowed_in(codes.mask_of(env, observation, info)) or range(codes.count)
        action = dice.choice(allowed)
        observation, reward, terminated, truncated, info = env.step(codes.own(action))
        end = bool(terminated), bool(truncated)
        yield {
            "action mask": allowed,
            "observation": bytes_of(observation),
            "reward": float(reward),
            "end": end,
        }
        if any(end):
            seed += 1
            observation, info = env.reset(seed=seed)
