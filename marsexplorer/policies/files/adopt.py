"""Read ONNX files of other libraries, and write each as one policy file of ours.

All that a model's shapes leave open is asked: an answer that is missing is one complaint among all
others, each with its remedy.
"""

from __future__ import annotations

import math
import stat
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, inliner

from marsexplorer.files import replace_whole
from marsexplorer.policies.base import PolicyFileError
from marsexplorer.policies.files.adopted_graph import write_graph
from marsexplorer.policies.files.adoption import FLOATS, Answers, GraphEnd, Plan
from marsexplorer.policies.files.adoption_trial import try_on_boards
from marsexplorer.policies.files.card import FORMAT
from marsexplorer.policies.files.model import LARGEST

CODES, EQ6 = "codes", "eq6"
WHOLE = {TensorProto.INT64, TensorProto.INT32, TensorProto.UINT8}
MASKS = ("action_mask", "action_masks", "mask")

EXPORT = "torch.onnx.export(module, inputs, 'net.onnx', dynamo=True, external_data=False)"


class ComplaintsError(PolicyFileError):
    """All that keeps a file from being read, each with the line that mends it."""

    def __init__(self, path: Path, complaints: Sequence[str]) -> None:
        lines = "".join(f"\n- {complaint}" for complaint in complaints)
        super().__init__(f"{path} cannot be read as a policy:{lines}")
        self.complaints = tuple(complaints)


@dataclass
class _Reading:
    """A model that is being read, with what was decided and what is amiss."""

    path: Path
    model: onnx.ModelProto
    answers: Answers
    complaints: list[str] = field(default_factory=list)
    notes: dict[str, str] = field(default_factory=dict)
    inputs: list[GraphEnd] = field(default_factory=list)
    outputs: list[GraphEnd] = field(default_factory=list)

    def complain(self, amiss: str, remedy: str) -> None:
        """Note what is amiss."""
        self.complaints.append(f"{amiss}; {remedy}")

    def named(self, tensors: Sequence[GraphEnd], name: str) -> GraphEnd | None:
        """The input or output of a name."""
        return next((tensor for tensor in tensors if tensor.name == name), None)


Boards = Iterable[tuple[NDArray[np.uint8], bool]]
"""The codes of boards, and whether an episode begins with them."""


def adopt(
    path: Path, out: Path, answers: Answers, boards_of: Callable[[tuple[int, int]], Boards]
) -> dict[str, str]:
    """Read a foreign ONNX file and write a policy file; return the reading by subject.

    boards_of  the boards of a size that the result is tried on (`evaluation.boards.observations`)

    ComplaintsError if the file cannot be read as it is, PolicyFileError if the result cannot play
    those boards.
    """
    reading = _Reading(path, _read_model(path), answers)
    _put_weights_in(reading)
    reading.inputs, reading.outputs = _ends(reading.model)
    _check_operators(reading)
    plan = _plan(reading)
    if reading.complaints or plan is None:
        raise ComplaintsError(path, reading.complaints)
    card = {
        "format": FORMAT,
        "summary": f"Read from {path.name}, which {reading.model.producer_name or 'another library'} wrote.",
        "acts": reading.notes["acts"],
        "read_as": reading.notes,
    }
    adopted = write_graph(reading.model, plan, answers, card)
    try_on_boards(path, adopted, boards_of(plan.size))
    with replace_whole(out) as unfinished:
        unfinished.write_bytes(adopted)
    return reading.notes


def _read_model(path: Path) -> onnx.ModelProto:
    """Read a model, and put its functions in where they are called."""
    try:
        if path.stat().st_size > LARGEST:
            raise ComplaintsError(
                path, [f"expected at most {LARGEST >> 20} MiB; export a smaller network"]
            )
        model = onnx.load_model_from_string(path.read_bytes())
    except OSError as error:
        raise ComplaintsError(
            path, [f"it cannot be read ({error.strerror}); check the path"]
        ) from error
    except Exception as error:  # protobuf's errors have no common class
        raise ComplaintsError(
            path, [f"expected an ONNX model, got other bytes; write one: {EXPORT}"]
        ) from error
    if not model.graph.node:
        raise ComplaintsError(path, [f"expected an ONNX model, got none; write one: {EXPORT}"])
    return inliner.inline_local_functions(model) if model.functions else model


def _put_weights_in(reading: _Reading) -> None:
    """Put the weights of a second file into the model."""
    outside = [
        tensor
        for tensor in _tensors(reading.model.graph)
        if tensor.data_location == TensorProto.EXTERNAL
    ]
    left = LARGEST - reading.path.stat().st_size
    for tensor in outside:
        described = {entry.key: entry.value for entry in tensor.external_data}
        size = math.prod(tensor.dims) * helper.tensor_dtype_to_np_dtype(tensor.data_type).itemsize
        left -= size
        try:
            if min(tensor.dims, default=0) < 0:
                raise ValueError(f"have the shape {list(tensor.dims)}")
            if left < 0:
                raise ValueError(f"take more than {LARGEST >> 20} MiB")
            tensor.raw_data = _weights_beside(reading.path, described, size)
        except ValueError as error:  # the other weights have the same cause
            reading.complain(f"the weights of {tensor.name} {error}", f"keep them inside: {EXPORT}")
            return
        tensor.ClearField("external_data")
        tensor.data_location = TensorProto.DEFAULT


def _weights_beside(path: Path, described: dict[str, str], size: int) -> bytes:
    """The bytes of a tensor in a file beside a model; ValueError with its fault."""
    name = described.get("location", "")
    if name in ("", ".", "..") or any(sign in name for sign in "/\\\0"):
        raise ValueError(f"lie in {name!r}, expected a file in the same folder")
    file = path.parent / name
    try:
        state = file.lstat()
    except OSError as error:
        raise ValueError(f"lie in {name}, which is not beside it") from error
    if not stat.S_ISREG(state.st_mode):
        raise ValueError(f"lie in {name}, expected a plain file, no link or pipe")
    try:
        offset, length = int(described.get("offset", 0)), int(described.get("length", size))
    except ValueError:
        offset = length = -1
    if offset < 0 or length != size or offset + length > state.st_size:
        raise ValueError(f"lie outside {name}")
    with file.open("rb") as stream:
        stream.seek(offset)
        return stream.read(length)


def _tensors(graph: onnx.GraphProto) -> Iterator[TensorProto]:
    """All tensors of a graph: weights and constants."""
    yield from graph.initializer
    for node in graph.node:
        for attribute in node.attribute:
            if attribute.HasField("t"):
                yield attribute.t
            yield from attribute.tensors


def _ends(model: onnx.ModelProto) -> tuple[list[GraphEnd], list[GraphEnd]]:
    weights = {tensor.name for tensor in model.graph.initializer}
    inputs = [GraphEnd.of(info) for info in model.graph.input if info.name not in weights]
    return inputs, [GraphEnd.of(info) for info in model.graph.output]


def _check_operators(reading: _Reading) -> None:
    """Complain about operators that are not played."""
    custom = {
        f"{node.domain}.{node.op_type}"
        for node in reading.model.graph.node
        if node.domain not in ("", "ai.onnx")
    }
    if custom:
        reading.complain(
            f"expected standard operators, got {', '.join(sorted(custom))}",
            f"export for plain ONNX: {EXPORT}",
        )
    control = {
        node.op_type
        for node in reading.model.graph.node
        for attribute in node.attribute
        if attribute.HasField("g") or attribute.graphs
    }
    if control:
        reading.complain(
            f"expected no control flow, got {', '.join(sorted(control))}",
            "write `torch.where` in place of `if` in the module, and trace it: dynamo=False",
        )
    drawn = {
        "RandomNormal",
        "RandomUniform",
        "RandomNormalLike",
        "RandomUniformLike",
        "Multinomial",
        "Bernoulli",
    }
    draws = drawn & {node.op_type for node in reading.model.graph.node}
    if draws:
        reading.complain(
            f"the graph draws ({', '.join(sorted(draws))}), which no seed fixes",
            "return the logits in place of a drawn action: return "
            "policy.get_distribution(observation).distribution.logits",
        )


def _plan(reading: _Reading) -> Plan | None:
    """Decide how the graph is used; None where something is amiss."""
    states = _states(reading)
    start = _start(reading)
    taken = {tensor.name for pair in states for tensor in pair} | ({start.name} if start else set())
    rest = [tensor for tensor in reading.inputs if tensor.name not in taken]
    mask = next((tensor for tensor in rest if tensor.name in MASKS), None)
    rest = [tensor for tensor in rest if tensor is not mask]
    observation = _observation(reading, rest)
    if mask is not None and (
        math.prod(mask.alone) != 4 or mask.kind not in {TensorProto.BOOL, *FLOATS}
    ):
        reading.complain(
            f"expected a mask of 4 moves, got {mask.words}",
            "export with torch.ones(1, 4, dtype=torch.bool)",
        )
    outputs = [tensor for tensor in reading.outputs if tensor.name not in taken]
    choice = _choice(reading, outputs)
    values = [
        tensor for tensor in outputs if tensor.name in ("value", "values") and tensor.kind in FLOATS
    ]
    value = values[0] if values and math.prod(values[0].alone) == 1 else None
    shape = None if observation is None else _shape(reading, observation)
    if observation is None or shape is None or choice is None or reading.complaints:
        return None
    size, frames = shape
    is_codes = observation.kind in WHOLE or reading.answers.values == CODES
    reading.notes["observation"] = (
        f"{observation.words} holds {'codes' if is_codes else 'eq. 6'}, {size[0]}x{size[1]}"
    )
    if frames > 1:
        order = f"the {reading.answers.frames} first, {reading.answers.padding} before the first"
        reading.notes["frames"] = f"{frames} frames, {order}"
    if mask is not None:
        reading.notes["mask"] = mask.name
    return Plan(observation, size, is_codes, frames, mask, choice, value, states, start)


def _states(reading: _Reading) -> tuple[tuple[GraphEnd, GraphEnd], ...]:
    """The states that are carried from move to move."""
    pairs = []
    for name, following in reading.answers.states:
        before = reading.named(reading.inputs, name)
        after = reading.named(reading.outputs, following)
        if before is None or after is None:
            reading.complain(
                f"--state {name}={following}: the inputs are {_names(reading.inputs)}, the "
                f"outputs {_names(reading.outputs)}",
                "name an input and an output",
            )
        elif before.alone != after.alone or before.kind not in FLOATS:
            reading.complain(
                f"a state keeps its shape, got {before.words} and {after.words}",
                f"export one board: {EXPORT}",
            )
        else:
            pairs.append((before, after))
    if pairs:
        reading.notes["states"] = ", ".join(
            f"{before.name} from {after.name}" for before, after in pairs
        )
        if reading.answers.initial is None:
            reading.complain(
                "what the states are at the start of an episode does not show", "--initial zeros"
            )
    return tuple(pairs)


def _start(reading: _Reading) -> GraphEnd | None:
    """The input that says that an episode starts."""
    name = reading.answers.start
    if name is None:
        return None
    start = reading.named(reading.inputs, name)
    if start is None or math.prod(start.alone) != 1:
        reading.complain(
            f"--episode-start {name}: the inputs are {_names(reading.inputs)}",
            "name the one of one number",
        )
        return None
    reading.notes["episode start"] = name
    return start


def _observation(reading: _Reading, inputs: Sequence[GraphEnd]) -> GraphEnd | None:
    """The input that takes the observation."""
    boards = [tensor for tensor in inputs if math.prod(tensor.alone) >= 25]
    preferred = [tensor for tensor in boards if tensor.name in ("observation", "obs", "input")]
    candidates = boards if len(boards) == 1 else preferred
    if len(candidates) != 1:
        reading.complain(
            f"expected one input for the observation, got {_names(reading.inputs) or 'none'}",
            "name it: input_names=['observation']",
        )
        return None
    for tensor in inputs:
        if tensor is not candidates[0]:
            reading.complain(
                f"the input {tensor.words} is unexplained",
                f"--state {tensor.name}=OUTPUT if it is a state, --episode-start {tensor.name} if "
                "it says that an episode starts, or export without it",
            )
    if candidates[0].kind not in FLOATS | WHOLE:
        reading.complain(
            f"expected numbers as the observation, got {candidates[0].words}",
            "cast it in the module: x.float()",
        )
    elif candidates[0].kind in FLOATS and reading.answers.values is None:
        reading.complain(
            f"whether {candidates[0].words} holds eq. 6 (0, 0.3, 0.6, 1) or codes (0 to 3) does "
            "not show",
            '--values eq6, or --values codes if it was trained with observation="uint8"',
        )
    return candidates[0]


def _shape(reading: _Reading, tensor: GraphEnd) -> tuple[tuple[int, int], int] | None:
    """((rows, cols), frames) of the observation's input."""
    sides = tensor.sides
    answers = reading.answers
    if len(sides) > 2 and sides[0] not in (1, None):
        reading.complain(
            f"expected one board at a time, got {tensor.words}",
            "export with a first side of 1: torch.zeros(1, "
            f"{', '.join(str(side) for side in tensor.alone[1:])})",
        )
    inner = sides if len(sides) == 2 and sides[0] not in (1, None) else sides[1:]
    if any(side is None for side in inner):
        reading.complain(
            f"rows and cols of {tensor.words} are open",
            "leave the batch alone open: dynamic_shapes=({0: 'batch'},)",
        )
        return None
    known_sides = [side for side in inner if side is not None]
    if len(known_sides) == 1:
        if answers.size is None:
            reading.complain(
                f"rows and cols of the flat {tensor.words} do not show",
                "--size ROWSxCOLS, as in --size 21x21",
            )
            return None
        if known_sides[0] % math.prod(answers.size):
            rows, cols = answers.size
            reading.complain(
                f"--size {rows}x{cols} does not divide {tensor.words}",
                "give the size of the boards it was trained on",
            )
            return None
        size, frames = answers.size, known_sides[0] // math.prod(answers.size)
    elif len(known_sides) == 2:
        size, frames = (known_sides[0], known_sides[1]), 1
    elif len(known_sides) == 3:
        size, frames = (known_sides[1], known_sides[2]), known_sides[0]
    else:
        reading.complain(
            f"expected [1, rows, cols] or frames of them, got {tensor.words}",
            "flatten the rest in the module",
        )
        return None
    if answers.size not in (None, size):
        reading.complain(
            f"--size {answers.size[0]}x{answers.size[1]} contradicts {tensor.words}",
            "leave --size out",
        )
    if not all(5 <= side <= 1024 for side in size):
        reading.complain(
            f"expected 5 to 1024 rows and cols, got {tensor.words}",
            "permute to [1, frames, rows, cols] in the module",
        )
        return None
    if frames > 1 and (answers.frames is None or answers.padding is None):
        reading.complain(
            f"{tensor.words} holds {frames} frames, whose order and start do not show",
            "--frames oldest or --frames newest says which comes first, --padding zeros or "
            "--padding repeat what stands before the first (gymnasium's FrameStackObservation: "
            "--frames oldest --padding repeat)",
        )
    return size, frames


def _choice(reading: _Reading, outputs: Sequence[GraphEnd]) -> GraphEnd | None:
    """The output that chooses the move."""
    answers = reading.answers
    scores = [
        tensor for tensor in outputs if tensor.kind in FLOATS and math.prod(tensor.alone) == 4
    ]
    moves = [tensor for tensor in outputs if tensor.kind in WHOLE and math.prod(tensor.alone) == 1]
    if answers.output is not None:
        candidates = [tensor for tensor in scores + moves if tensor.name == answers.output]
    else:
        candidates = scores or moves
        named = [
            tensor
            for tensor in candidates
            if tensor.name in ("logits", "q_values", "action", "actions")
        ]
        candidates = named if len(candidates) > 1 else candidates
    if len(candidates) != 1:
        several = _names(scores + moves)
        reading.complain(
            "expected one output of four scores or of one whole action, got "
            f"{several or _names(outputs) or 'none'}",
            "--output NAME" if several else "return the logits [1, 4], or the action as int64 [1]",
        )
        return None
    choice = candidates[0]
    if choice in moves:
        reading.notes["output"] = f"{choice.words} is the move"
        if answers.acts == "samples":
            reading.complain(
                f"{choice.words} is a move, which nothing is drawn from",
                "--acts greedy, or return the logits",
            )
    else:
        reading.notes["output"] = choice.words
        if answers.acts is None:
            reading.complain(
                f"whether the policy takes the best of {choice.words} or draws does not show",
                "--acts greedy, or --acts samples",
            )
        elif answers.acts == "samples" and answers.scores is None:
            reading.complain(
                f"whether {choice.words} holds logits or Q does not show, and drawing needs logits",
                "--scores logits",
            )
        elif answers.acts == "samples" and answers.scores == "q":
            reading.complain("nothing is drawn from Q", "--acts greedy")
    reading.notes["acts"] = answers.acts or "greedy"
    return choice


def _names(tensors: Sequence[GraphEnd]) -> str:
    return ", ".join(tensor.words for tensor in tensors)
