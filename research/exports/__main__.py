"""Export untrained agents of several libraries, and compare their moves.

As their documentation does; the files are read and played.

    pip install stable-baselines3 sb3-contrib tianshou "ray[rllib]" torch onnxscript
    python -m research.exports

Each agent decides on 200 observations of real episodes, in its own library four boards at a time
and then board by board, and through the file that `marsexplorer policies add` writes. A library
that is not installed is named as such.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from marsexplorer import policies
from marsexplorer.evaluation.boards import observations
from marsexplorer.observation import STATE_VALUES, action_masks, rover_position
from marsexplorer.policies.files.adopt import adopt
from marsexplorer.policies.files.adoption import Answers

SIDE, BOARDS, MOVES = 21, 4, 50


@dataclass(frozen=True)
class Agent:
    """An agent of another library.

    module   what is exported
    inputs   an example of its inputs, by name
    outputs  names of its outputs
    answers  to what its shapes leave open
    moves    (observations float32[boards, rows, cols], masks bool[boards, 4], whether each begins
             an episode) -> moves; where all begin one, nothing is remembered
    """

    module: nn.Module
    inputs: dict[str, Tensor]
    outputs: list[str]
    answers: Answers
    moves: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    dynamo: bool = True


class Documented(nn.Module):
    """The module of Stable-Baselines3's page on exporting."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy: Any = policy

    def forward(self, observation: Tensor) -> Any:
        """Choose a move."""
        return self.policy(observation, deterministic=True)


def sb3(name: str) -> Agent:
    """An algorithm of Stable-Baselines3, exported as its documentation says."""
    import stable_baselines3

    env = _make()
    model = getattr(stable_baselines3, name)("MlpPolicy", env, seed=3, device="cpu")
    outputs = ["action"] if name == "DQN" else ["action", "value", "log_prob"]
    return Agent(
        Documented(model.policy),
        {"input": torch.zeros(1, SIDE, SIDE)},
        outputs,
        Answers(values="eq6"),
        lambda seen, _masks, _starts: model.predict(seen, deterministic=True)[0],
        dynamo=False,
    )


class Masked(nn.Module):
    """The logits of a MaskablePPO."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy: Any = policy

    def forward(self, observation: Tensor, action_mask: Tensor) -> Tensor:
        """The logits of the valid moves."""
        features = self.policy.extract_features(observation, self.policy.pi_features_extractor)
        logits: Tensor = self.policy.action_net(self.policy.mlp_extractor.forward_actor(features))
        return logits.masked_fill(~action_mask, -1e9)


def maskable() -> Agent:
    """MaskablePPO of sb3-contrib."""
    from sb3_contrib import MaskablePPO
    from sb3_contrib.common.wrappers import ActionMasker

    env = ActionMasker(_make(), lambda wrapped: wrapped.unwrapped.action_masks())
    model = MaskablePPO("MlpPolicy", env, seed=3, device="cpu")
    return Agent(
        Masked(model.policy),
        {
            "observation": torch.zeros(1, SIDE, SIDE),
            "action_mask": torch.ones(1, 4, dtype=torch.bool),
        },
        ["logits"],
        Answers(values="eq6", acts="greedy"),
        lambda seen, masks, _starts: model.predict(seen, deterministic=True, action_masks=masks)[0],
    )


class Recurrent(nn.Module):
    """The logits and the states of a RecurrentPPO."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy: Any = policy

    def forward(
        self, observation: Tensor, hidden: Tensor, cell: Tensor, episode_start: Tensor
    ) -> tuple[Tensor, ...]:
        """The logits of a move, and the states for the next."""
        features = self.policy.extract_features(observation, self.policy.pi_features_extractor)
        continues = (1 - episode_start).view(1, -1, 1)
        out, (hidden, cell) = self.policy.lstm_actor(
            features.unsqueeze(0), (continues * hidden, continues * cell)
        )
        return self.policy.action_net(self.policy.mlp_extractor.forward_actor(out[0])), hidden, cell


def recurrent() -> Agent:
    """RecurrentPPO of sb3-contrib."""
    from sb3_contrib import RecurrentPPO

    model = RecurrentPPO("MlpLstmPolicy", _make(), seed=3, device="cpu")
    states: list[Any] = [None]

    def moves(seen: np.ndarray, _masks: np.ndarray, starts: np.ndarray) -> np.ndarray:
        chosen: np.ndarray
        chosen, states[0] = model.predict(
            seen,
            state=None if starts.all() else states[0],
            episode_start=starts,
            deterministic=True,
        )
        return chosen

    zeros = torch.zeros(1, 1, model.policy.lstm_actor.hidden_size)
    return Agent(
        Recurrent(model.policy),
        {
            "observation": torch.zeros(1, SIDE, SIDE),
            "hidden": zeros,
            "cell": zeros.clone(),
            "episode_start": torch.ones(1),
        },
        ["logits", "next_hidden", "next_cell"],
        Answers(
            states=(("hidden", "next_hidden"), ("cell", "next_cell")),
            initial="zeros",
            start="episode_start",
            values="eq6",
            acts="greedy",
        ),
        moves,
    )


def plain() -> Agent:
    """A convolution of plain torch on stacked frames of codes."""
    net = nn.Sequential(
        nn.Conv2d(4, 8, 3, stride=2), nn.ReLU(), nn.Flatten(), nn.Linear(8 * 10 * 10, 4)
    )
    frames: list[np.ndarray | None] = [None]

    def moves(seen: np.ndarray, _masks: np.ndarray, starts: np.ndarray) -> np.ndarray:
        newest = np.round(seen * 3.2).clip(0, 3)[:, None]
        again = np.repeat(newest, 4, axis=1)
        before = again if frames[0] is None or starts.all() else frames[0]
        shifted = np.concatenate([before[:, 1:], newest], axis=1)
        stack = np.where(starts[:, None, None, None], again, shifted).astype(np.float32)
        frames[0] = stack
        return _best(net(torch.as_tensor(stack)))

    return Agent(
        net,
        {"observation": torch.zeros(1, 4, SIDE, SIDE)},
        ["q_values"],
        Answers(values="codes", frames="oldest", padding="repeat", acts="greedy"),
        moves,
    )


def cleanrl() -> Agent:
    """The actor of CleanRL's ppo.py, on flat observations."""
    actor = nn.Sequential(
        nn.Linear(SIDE * SIDE, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, 4)
    )
    return _flat(actor, actor)


def tianshou() -> Agent:
    """A DiscreteActor of Tianshou, on flat observations."""
    from tianshou.utils.net.common import Net
    from tianshou.utils.net.discrete import DiscreteActor

    hidden = Net(state_shape=SIDE * SIDE, hidden_sizes=[64, 64])
    actor = DiscreteActor(preprocess_net=hidden, action_shape=4, softmax_output=False)

    class Logits(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.actor = actor

        def forward(self, observation: Tensor) -> Tensor:
            logits: Tensor = self.actor(observation)[0]
            return logits

    return _flat(Logits(), lambda flat: actor(flat.numpy())[0])


def rllib() -> Agent:
    """PPO's module of RLlib, on flat observations."""
    import gymnasium
    from ray.rllib.algorithms.ppo.ppo_catalog import PPOCatalog
    from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    module = DefaultPPOTorchRLModule(
        observation_space=gymnasium.spaces.Box(0, 1, (SIDE * SIDE,), np.float32),
        action_space=gymnasium.spaces.Discrete(4),
        model_config=DefaultModelConfig(fcnet_hiddens=[64, 64]),
        catalog_class=PPOCatalog,
    )

    class Logits(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.module = module

        def forward(self, observation: Tensor) -> Tensor:
            logits: Tensor = self.module.forward_inference({"obs": observation})[
                "action_dist_inputs"
            ]
            return logits

    return _flat(
        Logits(), lambda flat: module.forward_inference({"obs": flat})["action_dist_inputs"]
    )


AGENTS: dict[str, tuple[str, Callable[[], Agent]]] = {
    "PPO": ("stable-baselines3", lambda: sb3("PPO")),
    "A2C": ("stable-baselines3", lambda: sb3("A2C")),
    "DQN": ("stable-baselines3", lambda: sb3("DQN")),
    "MaskablePPO": ("sb3-contrib", maskable),
    "RecurrentPPO": ("sb3-contrib", recurrent),
    "CleanRL's ppo.py": ("torch", cleanrl),
    "frames of codes": ("torch", plain),
    "DiscreteActor": ("tianshou", tianshou),
    "PPO, RLModule": ("ray", rllib),
}
"""Name of an agent -> the package that it is of, and what makes it."""


def compare(agent: Agent, folder: Path) -> tuple[int, int, int]:
    """Export an agent, read the file, and count (equal batched, equal alone, all)."""
    file, out = folder / "net.onnx", folder / "added.onnx"
    with torch.no_grad():
        torch.onnx.export(
            agent.module.eval(),
            tuple(agent.inputs.values()),
            str(file),
            input_names=list(agent.inputs),
            output_names=agent.outputs,
            dynamo=agent.dynamo,
            verbose=False,
        )
    adopt(file, out, agent.answers, observations)
    boards = [
        list(observations((SIDE, SIDE), (board + 1) * MOVES))[-MOVES:] for board in range(BOARDS)
    ]
    ours = [_moves_of_file(out, board) for board in boards]
    batched = np.transpose(_moves_of_agent(agent, boards))
    alone = [_moves_of_agent(agent, [board])[:, 0] for board in boards]
    return int(np.sum(batched == ours)), int(np.sum(np.equal(alone, ours))), BOARDS * MOVES


Episodes = Sequence[tuple[np.ndarray, bool]]
"""The codes of a board in some episodes, and whether each begins one."""


def _moves_of_file(file: Path, board: Episodes) -> list[int]:
    """The moves of a policy file on a board."""
    policy = policies.load(file)
    moves = []
    for step, (codes, is_start) in enumerate(board):
        if step == 0 or is_start:
            policy.reset(0)
        moves.append(policy.act(codes))
    return moves


def _moves_of_agent(agent: Agent, boards: Sequence[Episodes]) -> np.ndarray:
    """The moves of an agent in its library, boards abreast: int[moves, boards]."""
    moves = []
    for step in range(MOVES):
        codes = np.array([board[step][0] for board in boards])
        starts = np.array([step == 0 or board[step][1] for board in boards])
        masks = action_masks(codes, np.array([rover_position(board) for board in codes]))
        with torch.no_grad():
            moves.append(agent.moves(STATE_VALUES[codes], masks, starts))
    return np.array(moves, int)


def _flat(module: nn.Module, scores: Callable[[Tensor], Tensor]) -> Agent:
    return Agent(
        module,
        {"observation": torch.zeros(1, SIDE * SIDE)},
        ["logits"],
        Answers(values="eq6", acts="greedy", size=(SIDE, SIDE)),
        lambda seen, _masks, _starts: _best(scores(torch.as_tensor(seen.reshape(len(seen), -1)))),
    )


def _best(scores: Tensor) -> np.ndarray:
    return np.asarray(torch.as_tensor(scores).argmax(dim=1))


def _make() -> Any:
    import gymnasium

    return gymnasium.make("marsexplorer:MarsExplorer-v0")


def lines() -> Iterator[str]:
    """The rows of a table, one for each agent."""
    yield "|agent|package|equal moves, batched|alone|"
    yield "|---|---|---|---|"
    for name, (package, make) in AGENTS.items():
        torch.manual_seed(3)
        try:
            agent = make()
        except ModuleNotFoundError as error:
            yield f"|{name}|{package}|not installed: {error.name}||"
            continue
        with tempfile.TemporaryDirectory() as folder:
            batched, alone, count = compare(agent, Path(folder))
        equal = f"{batched} of {count}|{alone} of {count}"
        yield f"|{name}|{package} {version(package)}|{equal}|"


def main() -> None:
    """Print the table; exit with 1 where some moves differ."""
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    differs = False
    for line in lines():
        print(line, flush=True)
        for cell in line.split("|")[3:]:
            equal, of, count = cell.partition(" of ")
            differs |= bool(of) and equal != count
    sys.exit(differs)


if __name__ == "__main__":
    main()
