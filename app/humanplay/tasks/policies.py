"""Policies in processes of their own: `random`, a function, or an ONNX file.

A function is "module:function" and returns an action for an observation. The process has the
environment too: it gets an episode's cause and the moves so far, plays them for itself, and answers
with an action. No observation leaves it. The module that plays is the task's:

    prepare(argument)        argument is JSON, [task, source]
    work(argument, request)  request has config, seed and policy_seed. Yields "ready"; then it is sent
                             the further moves and yields an action as text, or it is sent "play" and
                             yields [all moves, digest]
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from humanplay.task import Configuration, Policy, PolicyError, PolicyOffer, Run
from humanplay.task.registration import environment_of
from humanplay.tasks.base import BasePolicies
from humanplay.tasks.processes import LostError, Preparer, Worker

MEMORY_MB = 2048
"""Resident memory that a policy may take beyond the environment's package."""
Mask = NDArray[np.bool_]
Choose = Callable[[Any, Mask], int]
"""Returns an action for an observation and a mask of the allowed actions."""
MASKS = ("action_masks", "action_mask")
"""What a policy that takes the allowed actions calls them: an argument of a function, an input of an ONNX file."""


class ProcessPolicy:
    """A policy of one configuration (`humanplay.task.Policy`).

    It decides on the cause of an episode so far, instead of an observation.
    """

    def __init__(self, preparer: Preparer, name: str) -> None:
        self.name, self._preparer, self._seed = name, preparer, 0
        self._worker: Worker | None = None
        self._made, self._decided = b"", -1

    def reset(self, seed: int) -> None:
        """Begin an episode; its random numbers follow from `seed`."""
        self._seed, self._made, self._decided = seed, b"", -1
        if self._worker is not None:
            self._worker.close()
        self._worker = None

    def act(self, observation: tuple[Configuration, int, bytes]) -> int:
        """The action after (configuration, seed, moves); PolicyError if there is none."""
        config, seed, moves = observation
        if self._decided >= 0 and moves == self._made:
            return self._decided  # the same question again
        if self._worker is None or not moves.startswith(self._made):
            self._begin(config, seed)
        assert self._worker is not None
        action = self._asked(self._worker.ask, list(moves[len(self._made) :]))
        self._made, self._decided = moves, int(action)
        return self._decided

    def play(self, config: Configuration, seed: int) -> tuple[bytes, str]:
        """Play a whole episode; return its moves and digest. PolicyError if it fails."""
        self._begin(config, seed)
        assert self._worker is not None
        moves, digest = self._asked(self._worker.ask, "play")
        self.reset(self._seed)
        return bytes(moves), digest

    def _begin(self, config: Configuration, seed: int) -> None:
        self.reset(self._seed)
        request = {"config": config.to_dict(), "seed": seed, "policy_seed": self._seed}
        self._worker = self._asked(self._preparer.begin, request)
        self._asked(self._worker.answer)

    def _asked(self, ask: Callable[..., Any], *question: Any) -> Any:
        try:
            return ask(*question)
        except (LostError, ValueError) as error:
            self._worker = None
            raise PolicyError(f"the policy {self.name!r} cannot be played: {error}") from error


class ProcessPolicies(BasePolicies):
    """Policies in processes of their own (`humanplay.task.Policies`).

    Args:
        module: Plays them.
        sources: Of those on offer besides `random`.
        hidden: Files and folders that no policy may read.
        confined: Whether a process may do no more than it needs.
    """

    def __init__(
        self,
        task: str,
        module: str,
        sources: Iterable[str] = (),
        hidden: Sequence[Path] = (),
        confined: bool = True,
    ) -> None:
        self._task, self._module, self._hidden, self._confined = task, module, hidden, confined
        self._preparers: dict[str, Preparer] = {}
        self._sources = {self._name(source): source for source in ("random", *sources)}

    def _name(self, source: str) -> str:
        return source if self.is_rule(source) else self.file_of(source).stem

    def offers(self) -> list[PolicyOffer]:
        """What may be chosen by name."""
        return [
            PolicyOffer(name, _summary(source), source, None, False)
            for name, source in self._sources.items()
        ]

    def load(self, name: str, config: Configuration | None = None) -> ProcessPolicy:
        """A new policy by its name on offer or its source.

        Args:
            config: One that it must be able to play.

        Raises:
            PolicyError: If there is none, or it cannot be played.
        """
        source = self._sources.get(name, name)
        if source not in self._preparers:
            files = [] if self.is_rule(source) else [self.file_of(source).resolve()]
            argument = json.dumps([self._task, *([str(file) for file in files] or [source])])
            self._preparers[source] = Preparer(
                self._module, argument, MEMORY_MB, files, self._hidden, self._confined
            )
        policy = ProcessPolicy(self._preparers[source], self._name(source))
        if config is not None:
            policy.act((config, 0, b""))
        return policy

    def is_rule(self, source: str) -> bool:
        """Whether it is code and no file."""
        return source == "random" or not source.endswith(".onnx")

    def file_of(self, source: str) -> Path:
        """The path of its file; PolicyError if there is none."""
        if not (path := Path(source)).is_file() or self.is_rule(source):
            raise PolicyError(f"expected random, module:function or an ONNX file, got {source!r}")
        return path

    def hash_of(self, source: str) -> str | None:
        """SHA-256 (hex) of its file; None for code."""
        if self.is_rule(source):
            return None
        return hashlib.sha256(self.file_of(source).read_bytes()).hexdigest()

    def play(self, policy: Policy, config: Configuration, seed: int, policy_seed: int) -> Run:
        """Play an episode on the instance of a seed; `policy_seed` resets the policy."""
        if not isinstance(policy, ProcessPolicy):
            raise TypeError(f"expected a policy in a process, got a {type(policy).__name__}")
        policy.reset(policy_seed)
        return environment_of(self._task).run(config, seed, policy.play(config, seed)[0])

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Play an episode of each policy on each instance; PolicyError as `load`."""
        # load all of them before any plays
        policies = [(source, self.load(source, config)) for source in sources]
        for source, policy in policies:
            for seed in seeds:
                policy.reset(seed)
                yield source, seed, *policy.play(config, seed)

    def close(self) -> None:
        """End the processes of all policies."""
        for preparer in self._preparers.values():
            preparer.close()


NO_PROCESS = (
    "the environment is stepped by the program that holds it, and a policy needs one of its own"
)


class NoPolicies(BasePolicies):
    """None at all: no other process has the environment."""

    compared: tuple[str, ...] = ()
    slow: tuple[str, ...] = ()

    def load(self, source: str, config: Configuration | None = None) -> NoReturn:
        """Raise PolicyError."""
        raise PolicyError(NO_PROCESS)

    def is_rule(self, source: str) -> bool:
        """True: there is no file."""
        return True

    def file_of(self, source: str) -> NoReturn:
        """Raise PolicyError."""
        raise PolicyError(NO_PROCESS)

    def play(self, policy: Policy, config: Configuration, seed: int, policy_seed: int) -> NoReturn:
        """Raise PolicyError."""
        raise PolicyError(NO_PROCESS)

    def play_all(
        self, sources: Sequence[str], config: Configuration, seeds: Sequence[int]
    ) -> Iterator[tuple[str, int, bytes, str]]:
        """Raise PolicyError if any policy is asked for."""
        for source in sources:
            self.load(source, config)
        return iter(())


def _summary(source: str) -> str:
    return "a valid action at random" if source == "random" else f"by {source}"


def prepare_source(source: str) -> None:
    """Import what a policy needs; ValueError where there is no such function."""
    if source.endswith(".onnx"):
        import_module("onnxruntime")
    elif source != "random":
        _function(source)


KINDS = {
    "tensor(float)": "f4", "tensor(double)": "f8", "tensor(uint8)": "u1", "tensor(int64)": "i8", "tensor(int32)": "i4",
    "tensor(bool)": "?",
}  # fmt: skip


def chooser(source: str, seed: int, code_of: Callable[[Any], int] = int) -> Choose:
    """What decides, by codes.

    Args:
        seed: Of its random numbers.
        code_of: The code of an environment's own action.
    """
    if source == "random":
        return _random(seed)
    if source.endswith(".onnx"):
        return _network(source, code_of)
    return masked(_function(source), code_of)


def masked(function: Callable[..., object], code_of: Callable[[Any], int]) -> Choose:
    """What a function of the observation, and perhaps of a mask, decides."""
    try:
        parameters = tuple(inspect.signature(function).parameters)
    except ValueError:  # of a function that is written in C
        parameters = ()
    name = next((name for name in MASKS if name in parameters), None)
    if name is None:
        return lambda observation, mask: code_of(function(observation))
    return lambda observation, mask: code_of(function(observation, **{name: mask}))


def _function(source: str) -> Callable[..., object]:
    module, _, name = source.partition(":")
    try:
        function: Callable[..., object] = getattr(import_module(module), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"expected a function as module:function, got {source!r}: {error}"
        ) from error
    return function


def _random(seed: int) -> Choose:
    """Return what draws of the allowed actions."""
    dice = np.random.default_rng((seed, 1))  # not the numbers that the environment draws
    return lambda observation, mask: int(dice.choice(np.flatnonzero(mask)))


def _network(path: str, code_of: Callable[[Any], int]) -> Choose:
    """An ONNX file, as Stable-Baselines3 exports: a batch of one, actions first.

    An input gets the observation, or its entry of that name, in the input's type; a picture has its
    channels first if the input has. An input with a name of MASKS gets which actions are allowed. An
    output of whole numbers is the action; of others the largest one counts.
    """
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def choose(observation: Any, mask: Mask) -> int:
        inputs = {}
        for tensor in session.get_inputs():
            named = observation if isinstance(observation, Mapping) else {}
            part = mask if tensor.name in MASKS else named.get(tensor.name, observation)
            batch = np.asarray(part)[None].astype(KINDS[tensor.type])
            if batch.ndim == 4 and tensor.shape[1] == batch.shape[3] != batch.shape[1]:
                batch = batch.transpose(0, 3, 1, 2)
            inputs[tensor.name] = batch
        out = np.asarray(session.run(None, inputs)[0])[0]
        if out.size == 1:
            return code_of(int(out.item()))
        return code_of(out) if out.dtype.kind in "iu" else int(out.argmax())

    return choose
