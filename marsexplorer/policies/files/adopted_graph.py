"""The graph of our policy file around the graph of another library.

Our `observation` becomes the author's input, and the author's output our `logits`. Frames and the
states of a recurrent network are carried from move to move as states of the file.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from marsexplorer.policies.files.adoption import FLOATS, Answers, GraphEnd, Plan

INVALID = -1e9
"""The logit of a move that an author's graph did not choose."""


class _Graph:
    """The author's graph, with the nodes that go before and behind it."""

    def __init__(self, graph: onnx.GraphProto) -> None:
        self.graph = graph
        self._before: list[onnx.NodeProto] = []
        self._behind: list[onnx.NodeProto] = []
        self._count = 0

    def before(self, operator: str, inputs: Sequence[str], out: str = "", **more: Any) -> str:
        """Put a node before the author's; return its output."""
        return self._put(self._before, operator, inputs, out, more)

    def behind(self, operator: str, inputs: Sequence[str], out: str = "", **more: Any) -> str:
        """Put a node behind the author's; return its output."""
        return self._put(self._behind, operator, inputs, out, more)

    def constant(self, array: NDArray[Any]) -> str:
        """Add numbers; return their name."""
        name = self._name()
        self.graph.initializer.append(numpy_helper.from_array(array, name))
        return name

    def shaped(self, name: str, shape: Sequence[int], out: str = "") -> str:
        """Give a tensor another shape, before the author's nodes."""
        return self.before("Reshape", [name, self.constant(np.array(shape, np.int64))], out)

    def finish(self) -> None:
        """Put all nodes into the graph."""
        nodes = [*self._before, *self.graph.node, *self._behind]
        del self.graph.node[:]
        self.graph.node.extend(nodes)

    def _put(
        self,
        nodes: list[onnx.NodeProto],
        operator: str,
        inputs: Sequence[str],
        out: str,
        more: dict[str, Any],
    ) -> str:
        out = out or self._name()
        nodes.append(helper.make_node(operator, list(inputs), [out], **more))
        return out

    def _name(self) -> str:
        self._count += 1
        return f"humanplay_{self._count}"


def write_graph(
    author: onnx.ModelProto, plan: Plan, answers: Answers, card: dict[str, Any]
) -> bytes:
    """The bytes of our policy file, with the author's graph between adapters."""
    model = onnx.ModelProto()
    model.CopyFrom(author)
    _rename_all(model.graph)
    graph = _Graph(model.graph)
    rows, cols = plan.size
    kind = TensorProto.UINT8 if plan.is_codes else TensorProto.FLOAT
    inputs = [helper.make_tensor_value_info("observation", kind, [1, rows, cols])]
    outputs = [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, 4])]
    frames = graph.before("Cast", ["observation"], to=plan.observation.kind)
    if plan.frames > 1:
        frames = _stack(graph, plan, answers, frames, inputs, outputs)
    graph.shaped(frames, plan.observation.alone, _author(plan.observation.name))
    if plan.start is not None or (plan.frames > 1 and answers.padding == "repeat"):
        inputs.append(helper.make_tensor_value_info("start", TensorProto.FLOAT, [1]))
    if plan.start is not None:
        flag = graph.before("Cast", ["start"], to=plan.start.kind)
        graph.shaped(flag, plan.start.alone, _author(plan.start.name))
    if plan.mask is not None:
        inputs.append(helper.make_tensor_value_info("action_mask", TensorProto.BOOL, [1, 4]))
        cast = graph.before("Cast", ["action_mask"], to=plan.mask.kind)
        graph.shaped(cast, plan.mask.alone, _author(plan.mask.name))
    for number, (before, after) in enumerate(plan.states):
        shape = before.alone
        inputs.append(helper.make_tensor_value_info(f"state_{number}", TensorProto.FLOAT, shape))
        outputs.append(
            helper.make_tensor_value_info(f"next_state_{number}", TensorProto.FLOAT, shape)
        )
        graph.before("Cast", [f"state_{number}"], _author(before.name), to=before.kind)
        graph.behind("Cast", [_author(after.name)], f"next_state_{number}", to=TensorProto.FLOAT)
    _score(graph, plan.choice)
    if plan.value is not None:
        value = graph.behind("Cast", [_author(plan.value.name)], to=TensorProto.FLOAT)
        graph.behind("Reshape", [value, graph.constant(np.array([1], np.int64))], "value")
        outputs.append(helper.make_tensor_value_info("value", TensorProto.FLOAT, [1]))
    graph.finish()
    for ends, infos in ((model.graph.input, inputs), (model.graph.output, outputs)):
        del ends[:]
        ends.extend(infos)
    del model.graph.value_info[:], model.metadata_props[:]
    model.metadata_props.add(key="card", value=json.dumps(card, indent=1))
    return bytes(model.SerializeToString())


def _stack(
    graph: _Graph,
    plan: Plan,
    answers: Answers,
    newest: str,
    inputs: list[onnx.ValueInfoProto],
    outputs: list[onnx.ValueInfoProto],
) -> str:
    """Carry the frames before the newest as a state, and return all of them."""
    rows, cols = plan.size
    shape = [plan.frames - 1, rows, cols]
    inputs.append(helper.make_tensor_value_info("state_frames", TensorProto.FLOAT, shape))
    outputs.append(helper.make_tensor_value_info("next_state_frames", TensorProto.FLOAT, shape))
    older = graph.before("Cast", ["state_frames"], to=plan.observation.kind)
    if answers.padding == "repeat":
        is_start = graph.before("Cast", ["start"], to=TensorProto.BOOL)
        again = graph.before("Expand", [newest, graph.constant(np.array(shape, np.int64))])
        older = graph.before("Where", [is_start, again, older])
    is_oldest_first = answers.frames == "oldest"
    frames = graph.before("Concat", [older, newest] if is_oldest_first else [newest, older], axis=0)
    first = 1 if is_oldest_first else 0
    bounds = [
        graph.constant(np.array([number], np.int64))
        for number in (first, first + plan.frames - 1, 0)
    ]
    next_frames = graph.before("Slice", [frames, *bounds])
    graph.before("Cast", [next_frames], "next_state_frames", to=TensorProto.FLOAT)
    return frames


def _score(graph: _Graph, choice: GraphEnd) -> None:
    """Turn the author's scores or move into our logits."""
    name, shape = _author(choice.name), graph.constant(np.array([1, 4], np.int64))
    if choice.kind in FLOATS:
        scores = graph.behind("Cast", [name], to=TensorProto.FLOAT)
        graph.behind("Reshape", [scores, shape], "logits")
        return
    move = graph.behind("Cast", [name], to=TensorProto.INT64)
    move = graph.behind("Reshape", [move, graph.constant(np.array([1, 1], np.int64))])
    is_move = graph.behind("Equal", [move, graph.constant(np.arange(4, dtype=np.int64)[None])])
    best, worst = (graph.constant(np.array([[number]], np.float32)) for number in (0.0, INVALID))
    graph.behind("Where", [is_move, best, worst], "logits")


def _author(name: str) -> str:
    """The name of one of the author's tensors in our graph."""
    return f"author/{name}" if name else ""


def _rename_all(graph: onnx.GraphProto) -> None:
    """Prefix all of the author's tensors, so that no name clashes with ours."""
    for node in graph.node:
        node.input[:] = [_author(name) for name in node.input]
        node.output[:] = [_author(name) for name in node.output]
    for tensor in graph.initializer:
        tensor.name = _author(tensor.name)
