"""Trained networks: one small net that scores the four moves, read from a file that carries its card.

A policy file is safetensors (never pickle): tensors named and shaped as `Net` has them, and the card, JSON, in its metadata.
Files are checked before a weight is used, and whatever is not as expected is refused with a sentence.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from marsexplorer.files import replace_whole
from marsexplorer.policies.base import Memory, Policy, valid_moves
from marsexplorer.policies.files.card import read_card, refuse
from marsexplorer.policies.guard import LoopGuard
from marsexplorer.policies.network.features import CELLS, NUMBERS, PLANES, Perception

FORMAT = "marsexplorer-network-2"
NEVER = -1e9


class Net(nn.Module):
    """Scores the moves by one head shared among them, over two dense layers' view of the pictures and each move's numbers.

    forward(planes uint8[b, PLANES, CELLS], moves float32[b, 4, NUMBERS])
        -> logits float32[b, 4] (NEVER for invalid moves), value float32[b]
    """

    def __init__(self, wide: int = 384, hidden: int = 128) -> None:
        super().__init__()
        self.gist = nn.Sequential(nn.Linear(PLANES * CELLS, wide), nn.ReLU(), nn.Linear(wide, hidden), nn.ReLU())
        self.judge = nn.Sequential(nn.Linear(hidden + NUMBERS + 4, 64), nn.ReLU(), nn.Linear(64, 1))
        self.worth = nn.Sequential(nn.Linear(hidden + 4 * NUMBERS, 64), nn.ReLU(), nn.Linear(64, 1))
        orthogonal(self)
        nn.init.orthogonal_(self.judge[-1].weight, 0.01)  # type: ignore[arg-type]

    def forward(self, planes: Tensor, moves: Tensor) -> tuple[Tensor, Tensor]:
        gist = self.gist(planes.flatten(1).to(moves.dtype) * (1 / 255))
        batch = len(planes)
        which = torch.eye(4, dtype=moves.dtype, device=moves.device).expand(batch, 4, 4)
        each = torch.cat([gist[:, None].expand(batch, 4, -1), moves, which], dim=2)
        logits = self.judge(each).squeeze(2).float()
        value = self.worth(torch.cat([gist, moves.flatten(1)], dim=1)).squeeze(1).float()
        return logits.masked_fill(moves[:, :, 0] < 0.5, NEVER), value * 5

    def decide(self, planes: NDArray[np.uint8], moves: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return (logits, values) of boards as arrays, on one thread: several wait for one another on a busy machine."""
        if torch.get_num_threads() != 1:
            torch.set_num_threads(1)
        with torch.inference_mode():
            logits, values = self(torch.from_numpy(planes), torch.from_numpy(moves))
        return logits.numpy(), values.numpy()


def orthogonal(net: nn.Module) -> None:
    """Draw every layer's weights orthogonal with gain sqrt 2 and set the biases to zero."""
    for module in net.modules():
        if isinstance(module, (nn.Linear, nn.Conv2d)):
            nn.init.orthogonal_(module.weight, 2**0.5)
            assert module.bias is not None
            nn.init.zeros_(module.bias)


def save_network(net: nn.Module, path: Path, card: dict[str, Any], form: str = FORMAT) -> None:
    """Write a policy file, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    tensors = {name: tensor.detach().contiguous().cpu() for name, tensor in net.state_dict().items()}
    with replace_whole(path) as unfinished:
        save_file(tensors, unfinished, metadata={"card": json.dumps({"format": form, **card}, indent=1)})


def load_net(path: Path) -> Net:
    """Return the network in a policy file; PolicyFileError when the file is none of ours."""
    card = read_card(path)
    if card.get("format") != FORMAT:
        raise refuse(path, f"the format {FORMAT}", repr(card.get("format"))[:60])
    net = Net()
    read_weights(net, path)
    return net.eval()


def read_weights(net: nn.Module, path: Path) -> None:
    """Return with the network's weights those of the file; PolicyFileError when they are not exactly its tensors."""
    expected = {name: tuple(tensor.shape) for name, tensor in net.state_dict().items()}
    try:
        with safe_open(path, "pt") as file:
            names = set(file.keys())
            if names != set(expected):
                raise refuse(path, f"the {len(expected)} tensors of the network", f"{len(names)} others")
            tensors = {name: file.get_tensor(name) for name in expected}
    except (SafetensorError, OSError) as error:
        raise refuse(path, "a whole safetensors file", str(error)[:80]) from error
    for name, tensor in tensors.items():
        if tuple(tensor.shape) != expected[name] or tensor.dtype != torch.float32:
            raise refuse(path, f"{name} float32{list(expected[name])}", f"{tensor.dtype} {list(tensor.shape)}")
        if not bool(torch.isfinite(tensor).all()):
            raise refuse(path, f"finite numbers in {name}", "others")
    net.load_state_dict(tensors)


class NetworkPolicy:
    """Takes the move a network scores highest, with the loop guard; remembers the cells stood on.

    thought()  after `act`: probabilities float32[4] of the moves, and the value, as the network saw the last observation
    """

    def __init__(self, name: str, net: Net, sensor_radius: int) -> None:
        self.name = name
        self.net, self._radius = net, sensor_radius
        self._memory, self._guard = Memory(), LoopGuard(sensor_radius)
        self._eyes: Perception | None = None
        self._thought: tuple[NDArray[np.float32], float] = (np.full(4, 0.25, np.float32), 0.0)

    def reset(self, seed: int) -> None:
        """Forget the episode; nothing is drawn, so the seed has no effect."""
        del seed
        self._memory.forget()
        self._guard.reset()

    def act(self, observation: NDArray[Any]) -> int:
        """Return an action 0..3."""
        scores, values = self.net.decide(*self.see(observation))
        return self.settle(scores[0], float(values[0]))

    def see(self, observation: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Take in an observation and return (planes, moves) of one board; the arrays change with the next."""
        memory = self._memory
        memory.take(observation)
        rows, cols = memory.codes.shape
        if self._eyes is None or self._eyes.size != (rows, cols):
            self._eyes = Perception(1, rows, cols, self._radius)
        place = np.array([memory.position[0] * cols + memory.position[1]])
        visited, heading = memory.visited.reshape(1, -1), np.array([memory.heading])
        return self._eyes(memory.codes[None], place, visited, heading)

    def settle(self, scores: NDArray[np.float32], value: float) -> int:
        """Return the action for what was seen last: the highest of scores float32[4], unless the guard takes over."""
        memory = self._memory
        shares = np.exp(scores - scores.max())
        self._thought = shares / shares.sum(), value
        overruled = self._guard.overrule(memory)
        if overruled is not None:
            return overruled
        move = int(scores.argmax())
        return move if scores[move] > NEVER else next(iter(valid_moves(memory.codes, *memory.position)), 0)

    def thought(self) -> tuple[NDArray[np.float32], float]:
        """Return (probabilities float32[4], value) of the last observation."""
        return self._thought


def load_network(path: Path, sensor_radius: int) -> Policy:
    """Return the policy in a file, named after the file."""
    from marsexplorer.policies.network import paper_model

    if read_card(path).get("format") == paper_model.FORMAT:
        return paper_model.PaperPolicy(path.stem, paper_model.load_paper_net(path))
    return NetworkPolicy(path.stem, _shared_net(path), sensor_radius)


def _shared_net(path: Path) -> Net:
    """Return the file's network: the same object for every board, so that they can be decided together."""
    state = path.stat()
    key = (str(path.resolve()), state.st_mtime_ns, state.st_size)
    net = _NETS.get(key)
    if net is None:
        net = _NETS[key] = load_net(path)
    return net


_NETS: WeakValueDictionary[tuple[str, int, int], Net] = WeakValueDictionary()
