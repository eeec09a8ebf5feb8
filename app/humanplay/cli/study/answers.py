"""The three things that `study new` asks on a terminal, if no option says them."""

from __future__ import annotations

from collections.abc import Callable

import click
from click import UsageError

from humanplay.cli.settings import config_of, task_name
from humanplay.command.options import SizeType
from humanplay.study.protocol import Protocol
from humanplay.study.questions import NONE
from humanplay.task import Configuration, Environment, PolicyError
from humanplay.task.registration import DEFAULT_TASK

PLAYERS = 10
"""Participants planned if nothing else is said."""


def asked_environment() -> tuple[str, Configuration]:
    """The task and the configuration that are played."""
    answer: tuple[str, Configuration] = click.prompt(
        "What is played? A level and a size of MarsExplorer, or another environment "
        "(an id or a file, as for serve)",
        default="random 21",
        value_proc=_environment,
    )
    return answer


def _environment(answer: str) -> tuple[str, Configuration]:
    level, _, size = answer.strip().partition(" ")
    try:
        side = SizeType().convert(size, None, None) if size else None
        return DEFAULT_TASK, config_of(DEFAULT_TASK, level, side)
    except UsageError:
        task = task_name(answer.strip())
        return task, config_of(task)


def asked_policies(environment: Environment, config: Configuration) -> tuple[str, ...]:
    """The policies that people are compared with."""

    def policies(answer: str) -> tuple[str, ...]:
        names = tuple(filter(None, map(str.strip, answer.split(","))))
        if names == (NONE,):
            return ()
        for name in names:
            try:
                environment.policies.load(name, config)
            except PolicyError as error:
                raise UsageError(f"the policy {name!r} cannot be loaded: {error}") from error
        return names

    answer: tuple[str, ...] = click.prompt(
        "With which policies are people compared?",
        default=", ".join(environment.policies.compared) or NONE,
        value_proc=policies,
    )
    return answer


def asked_players(protocol: Protocol, planned: Callable[[Protocol], Protocol]) -> Protocol:
    """A protocol for as many people as are wanted.

    Args:
        protocol: Without assumptions.
        planned: Fills them in, and prints the power.
    """
    number = click.IntRange(1, 100_000)
    players = click.prompt("How many people are to finish?", type=number, default=PLAYERS)
    while True:
        plan = planned(protocol.model_copy(update={"players": players}))
        answer = click.prompt(
            "Enter to plan with them, or another number", type=number, default=players
        )
        if answer == players:
            return plan
        players = answer
