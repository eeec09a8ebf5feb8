"""A policy's episode in a process with the environment (`tasks.policies`)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from humanplay.task.registration import environment_of
from humanplay.tasks.gymnasium.configuration import own_config
from humanplay.tasks.gymnasium.run import GymnasiumRun, draw_once
from humanplay.tasks.policies import chooser, prepare_source
from humanplay.tasks.processes import Work


def prepare(argument: str) -> None:
    """Import the environment and what the policy needs (`humanplay.tasks.processes`)."""
    task, source = json.loads(argument)
    draw_once(own_config(environment_of(task).configuration({})))
    prepare_source(source)


def work(argument: str, request: Mapping[str, Any]) -> Work:
    """Play one episode: yield an action for each list of moves; for "play" all of it."""
    task, source = json.loads(argument)
    config = own_config(environment_of(task).configuration(request["config"]))
    run = GymnasiumRun(config, request["seed"])
    choose = chooser(source, request["policy_seed"], run.code_of)
    question, decided = (yield "ready"), -1
    while True:
        for action in question if question != "play" else ():
            if decided < len(run.actions):
                decided, _ = len(run.actions), run.decide(choose)  # it is to remember what it saw
            run.step(action)
            yield len(run.actions)
        while question == "play" and run.outcome == "running":
            run.step(run.decide(choose))
            yield len(run.actions)
        if question == "play":
            question = yield [list(run.actions), run.digest]
        else:
            decided = len(run.actions)
            question = yield str(run.decide(choose))
