"""Decisions about a foreign ONNX file before it is written as one of ours."""

from __future__ import annotations

from dataclasses import dataclass

import onnx
from onnx import TensorProto

FLOATS = frozenset({TensorProto.FLOAT, TensorProto.DOUBLE, TensorProto.FLOAT16})
"""Types of an input or output that are fractions."""


@dataclass(frozen=True)
class Answers:
    """Answers about a model that its shapes do not give; None or empty if unanswered.

    values        "eq6" or "codes": what a float input holds
    size          (rows, cols) of a flat input
    frames        "oldest" or "newest": which of stacked frames comes first
    padding       "zeros" or "repeat": what stands in for frames before the first
    output        name of the output that chooses the move
    acts          "greedy" or "samples"
    scores        "logits" or "q": what is drawn from
    states        pairs of an input and the output that is its next state
    initial       "zeros": the states at the start of an episode
    start         name of the input that says that an episode starts
    """

    values: str | None = None
    size: tuple[int, int] | None = None
    frames: str | None = None
    padding: str | None = None
    output: str | None = None
    acts: str | None = None
    scores: str | None = None
    states: tuple[tuple[str, str], ...] = ()
    initial: str | None = None
    start: str | None = None


@dataclass
class GraphEnd:
    """An input or output of the author's graph.

    sides  None for an open side
    """

    name: str
    kind: int
    sides: list[int | None]

    @classmethod
    def of(cls, info: onnx.ValueInfoProto) -> GraphEnd:
        """Read an input or output."""
        tensor = info.type.tensor_type
        sides = [
            side.dim_value if side.HasField("dim_value") else None for side in tensor.shape.dim
        ]
        return cls(info.name, tensor.elem_type, sides)

    @property
    def words(self) -> str:
        """Its name, type and shape."""
        kind = TensorProto.DataType.Name(self.kind).lower()
        shape = ", ".join("open" if side is None else str(side) for side in self.sides)
        return f"{self.name} {kind}[{shape}]"

    @property
    def alone(self) -> list[int]:
        """Its shape for one board: what is open is 1."""
        return [1 if side is None else side for side in self.sides]


@dataclass(frozen=True)
class Plan:
    """How the author's graph is used."""

    observation: GraphEnd
    size: tuple[int, int]
    is_codes: bool
    frames: int
    mask: GraphEnd | None
    choice: GraphEnd
    value: GraphEnd | None
    states: tuple[tuple[GraphEnd, GraphEnd], ...]
    start: GraphEnd | None
