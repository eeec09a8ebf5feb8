"""`python -m research.lookahead.distillation`: a network learns from lookahead.

A round plays episodes of level `random` with the network so far. Where `lookahead` would look
ahead, its goals are tried on terrains that agree with what is known, and each first move other than
the network's own gives a label: the mean difference of moves, weighted by 1 / (SE^2 + 1). A label
counts as a pair of actions does in `research.refinement` (its loss, its network, its optimiser);
everywhere else, earlier in the episode and on other levels and sizes, the network is held to what
it was. The next round plays with what the last one learnt.

Moves are those of the network alone, paired by terrain with the network that it began with: a point
of the curve on terrains that are looked at as often as liked, so that the best point may be chosen,
the last table on terrains that are opened once.
"""

from __future__ import annotations

import json
import time
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch
from numpy.typing import NDArray

from humanplay.command.console import print_table, progress
from humanplay.command.options import PATH
from humanplay.jobs import Jobs, cores
from marsexplorer.config import UNKNOWN, EnvConfig
from marsexplorer.evaluation.episodes import play_episode
from marsexplorer.evaluation.table import ratio_interval
from marsexplorer.policies.base import Memory
from marsexplorer.policies.files.card import read_card, shipped
from marsexplorer.policies.kernels.rollouts import BLOCK
from marsexplorer.policies.lookahead import Lookahead
from marsexplorer.policies.network.policy import NetworkPolicy
from marsexplorer.training.network import Net, load_net, save_network
from research.refinement.refine import (
    MAX_COST,
    ActionPairs,
    EpisodeTask,
    RefineConfig,
    RefineRun,
    SampledObservations,
    play_greedily,
    play_task,
)

TRAINING_SEED, CURVE_SEED, LAST_SEED = 8_000_000_000, 8_500_000_000, 9_100_000_000
"""First terrains: that labels come from, of the curve, and of the last table."""
TERRAINS = {21: 2000, 42: 500, 84: 60}
"""Terrains of a point, and of a row of the table, by side."""
BEGINS, DROP = 0.5, 3.0
"""A state is labelled from this share of known cells on; candidates are dropped later than in
play.
"""
CHUNK = 20
"""Episodes of a task."""
KEPT = 0.1
"""Share of the moves before that whose observations hold the network to what it was."""
CONFIG = RefineConfig(
    sizes=(), logit_scale=1.0, cost_scale=1.0, gradient_steps=200, first_round_steps=1,
    first_round_learning_rate=5e-4, anchor_sizes=((84, 3), (42, 32), (42, 32), (21, 64)),
    anchor_levels=("random", "1-2-1", "3-2-2"),
)  # fmt: skip


class Scorer(Net):
    """The network, which remembers what it was shown last."""

    seen: tuple[NDArray[np.uint8], NDArray[np.float32]]

    def rules_that_count(self, rows: int, cols: int) -> None:
        """Return None: what is learnt from has the numbers of all rules."""

    def infer(
        self, planes: NDArray[np.uint8], moves: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits float32[num, 4], values float32[num])."""
        self.seen = planes, moves
        with torch.inference_mode():
            logits, values = self(torch.from_numpy(planes), torch.from_numpy(moves))
        return logits.numpy(), values.numpy()


class Labeller(Lookahead):
    """`lookahead` whose moves are its base's and whose comparisons become labels.

    pairs         planes, moves, own action, other action, weighted cost
    observations  planes and moves of some states before
    """

    def __init__(self, net: Scorer, rng: np.random.Generator) -> None:
        super().__init__(NetworkPolicy("ppo", net, 6))
        self._net, self._rng = net, rng
        self.pairs: list[tuple[Any, ...]] = []
        self.observations: list[tuple[Any, ...]] = []

    def _look_ahead(self, memory: Memory, action: int) -> None:
        if self._arrays is not None:
            settings = self._arrays.settings
            self._arrays.settings = replace(settings, begins=BEGINS, margin=0.0, drop=DROP)
            self._arrays.costs[:] = np.nan
        super()._look_ahead(memory, action)
        known_cells = np.count_nonzero(memory.codes != UNKNOWN)
        planes, moves = (array[0].copy() for array in self._net.seen)
        if self.compared:
            self.pairs += [(planes, moves, action, *pair) for pair in self._labels(memory)]
        elif known_cells < BEGINS * memory.codes.size and self._rng.random() < KEPT:
            self.observations.append((planes, moves))
        self.compared = 0

    def _labels(self, memory: Memory) -> list[tuple[int, float]]:
        """The other first moves, and the weighted mean of what each costs more."""
        assert self._arrays is not None
        cols = memory.codes.shape[1]
        num, _ = self._compared_ways
        costs, first = self._arrays.costs[:num], self._arrays.ways[:num, 0]
        tried, labels = (~np.isnan(costs)).sum(1), []

        def best(cell: int) -> int:
            """The candidate that begins with a cell, was tried longest and is cheapest."""
            mine = np.flatnonzero(first == cell)
            longest = mine[tried[mine] == tried[mine].max()]
            return int(longest[np.nanmean(costs[longest], axis=1).argmin()])

        base, here = best(int(first[0])), memory.position[0] * cols + memory.position[1]
        for cell in np.unique(first[first != first[0]]).tolist():
            other = best(cell)
            count = min(int(tried[base]), int(tried[other]))
            if count >= BLOCK:
                more = costs[other, :count] - costs[base, :count]
                weight = 1 / (more.var(ddof=1) / count + 1)
                cost = float(np.clip(more.mean(), -MAX_COST, MAX_COST) * weight)
                labels.append(((-cols, 1, cols, -1).index(cell - here), cost))
        return labels


def label(job: tuple[dict[str, NDArray[np.float32]], int, int]) -> tuple[Any, Any]:
    """(ActionPairs, SampledObservations) of CHUNK episodes.

    job  (weights by name, side, first seed)
    """
    weights, side, first_seed = job
    torch.set_num_threads(1)
    net = Scorer().eval()
    net.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    labeller = Labeller(net, np.random.default_rng(first_seed))
    config = EnvConfig.of("random", side)
    steps = [play_episode(labeller, config, first_seed + number).steps for number in range(CHUNK)]
    planes, moves, actions, other, cost = (
        np.array(column) for column in zip(*labeller.pairs, strict=True)
    )
    early_planes, early_moves = (
        np.array(column) for column in zip(*labeller.observations, strict=True)
    )
    counted = np.array(steps)
    pairs = ActionPairs(planes, moves, actions, other, cost.astype(np.float32), counted)
    return pairs, SampledObservations(early_planes, early_moves, counted)


class Distillation(RefineRun):
    """Rounds of labels and gradient steps; `net` is the network that plays."""

    def add(self, pool: Jobs, side: int, labels: int) -> dict[str, float]:
        """Play and store at least so many labels, and anchors elsewhere; return metrics."""
        weights = {name: tensor.numpy() for name, tensor in self.net.state_dict().items()}
        began = time.monotonic()
        tasks: list[EpisodeTask] = self.make_tasks() if self.rounds_done == 0 else []
        anchors = list(
            pool.map(play_task, [(weights, task) for task in tasks if not task.pairs_per_episode])
        )
        pairs: list[ActionPairs] = []
        count = 0
        first = TRAINING_SEED + 10_000_000 * self.rounds_done
        with progress("labels") as advance:
            while count < labels:
                seeds = range(first, first + CHUNK * 2 * cores(), CHUNK)
                first = seeds.stop
                for found_pairs, observed in pool.map(
                    label, [(weights, side, seed) for seed in seeds]
                ):
                    pairs.append(found_pairs)
                    anchors.append(observed)
                    count += len(found_pairs.cost)
                advance(min(count, labels), labels)
        self._store(
            pairs, [anchor for anchor in anchors if isinstance(anchor, SampledObservations)]
        )
        self.num_pairs += count
        better = float(np.mean(np.concatenate([labelled.cost for labelled in pairs]) < 0))
        return {"labels": count, "better": better, "seconds": time.monotonic() - began}

    def learn(self) -> float:
        """Make the gradient steps between two points of the curve; return the mean loss."""
        return self._optimize(lambda done: None)

    def begin_round_with(self, weights: dict[str, torch.Tensor]) -> None:
        """Go on from these weights, by name."""
        self.rounds_done += 1
        for net in (self.net, self._learner):
            net.load_state_dict(weights)


def moves_of(net: Net, side: int, first_seed: int) -> NDArray[np.float64]:
    """The moves to 99 % of the network on the terrains of a line.

    An episode is followed to 0.57 moves a cell.
    """
    scorer = Scorer().eval()
    scorer.load_state_dict(net.state_dict())
    steps = np.zeros(TERRAINS[side], np.int64)
    for _ in play_greedily(EnvConfig.of("random", side), scorer, first_seed, steps):
        pass
    return steps.astype(np.float64)


@click.command(context_settings={"show_default": True})
@click.option(
    "--size", type=click.Choice(["21", "42"]), default="21", help="Where labels are made."
)
@click.option("--labels", type=click.IntRange(min=1), default=100_000, help="Of a round, at least.")
@click.option("--rounds", type=click.IntRange(min=1), default=2, help="Of labels.")
@click.option("--points", type=click.IntRange(min=1), default=6, help="Of the curve, a round.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes.  [default: all cores]")
@click.option("--out", type=PATH, default=Path("runs/distillation"), help="Results' folder.")
def main(size: str, labels: int, rounds: int, points: int, workers: int | None, out: Path) -> None:
    """Teach `ppo` what `lookahead` finds, and print the ratio of moves as it learns.

    On level `random`; a ratio of the moves to 99 % after each 200 gradient steps.

    \b
    Examples:
      nice -n 19 python -m research.lookahead.distillation
      python -m research.lookahead.distillation --labels 2000 --rounds 1 --points 1

    The file curve.jsonl gets a line for each point, labels.pt what has been played, and
    distilled.onnx the network of the best point, from which each round begins. A run that was
    stopped goes on after the last labels, or after their points.
    """
    out.mkdir(parents=True, exist_ok=True)
    net, side, stored = load_net(shipped()["ppo"]), int(size), out / "labels.pt"
    run, before = Distillation(net, 0, CONFIG), moves_of(net, side, CURVE_SEED)
    progress_so_far: dict[str, Any] = {
        "round": 1,
        "figures": None,
        "ratio": 1.0,
        "best": net.state_dict(),
    }
    if stored.exists():
        progress_so_far = torch.load(stored, weights_only=True)
        run.load_state_dict(progress_so_far["run"])
    with Jobs(workers or cores()) as pool, (out / "curve.jsonl").open("a") as file:
        for number in range(progress_so_far["round"], rounds + 1):
            if progress_so_far["figures"] is None:
                progress_so_far["figures"] = run.add(pool, side, labels)
                torch.save(progress_so_far | {"run": run.state_dict()}, stored)
            for point in range(1, points + 1):
                line = {
                    "round": number,
                    "steps": CONFIG.gradient_steps * point,
                    "loss": run.learn(),
                }
                moves = moves_of(run.net, side, CURVE_SEED)
                ratio, line["low"], line["high"] = ratio_interval(moves, before)
                file.write(json.dumps(line | {"ratio": ratio} | progress_so_far["figures"]) + "\n")
                file.flush()
                ratio_text = f"{ratio:.4f} ({line['low']:.4f} to {line['high']:.4f})"
                click.echo(f"round {number}, {line['steps']} steps: {ratio_text}")
                if ratio < progress_so_far["ratio"]:
                    progress_so_far |= {"ratio": ratio, "best": deepcopy(run.net.state_dict())}
            run.begin_round_with(progress_so_far["best"])
            progress_so_far |= {"round": number + 1, "figures": None}
            torch.save(progress_so_far | {"run": run.state_dict()}, stored)
    card = read_card(shipped()["ppo"])
    save_network(
        run.net, out / "distilled.onnx", {**card, "command": "research.lookahead.distillation"}
    )
    rows = []
    for last_side, terrains in TERRAINS.items():
        ratios = ratio_interval(
            moves_of(run.net, last_side, LAST_SEED), moves_of(net, last_side, LAST_SEED)
        )
        rows.append(
            (
                f"{last_side}x{last_side}",
                str(terrains),
                "{:.4f} ({:.4f} to {:.4f})".format(*ratios),
            )
        )
    print_table("moves of the network to those before", ("size", "terrains", "ratio"), rows)


if __name__ == "__main__":
    from research.lookahead import distillation  # a worker finds `label` there

    distillation.main(prog_name="python -m research.lookahead.distillation")
