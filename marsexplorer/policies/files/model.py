"""An ONNX model's bytes, field by field: its metadata, operators and weights.

Reading a policy needs a few of the format's fields, and the package onnx is as large as all else
that plays. A field that the format does not have is refused, not skipped: the runtime must not find
more in a model than was checked here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marsexplorer.policies.base import PolicyFileError

LARGEST = 64 << 20
"""Bytes of a file; a larger one is refused unread."""
MOST_FIELDS = 100_000
"""Fields that are read of one message."""
ADVICE = "give an ONNX model with the inputs and outputs that docs/policies.md lists, or read it by `marsexplorer policies add`"

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
"""The wire types of protobuf, less its groups, which ONNX does not use."""

MODEL = {
    1: "ir_version", 2: "producer_name", 3: "producer_version", 4: "domain", 5: "model_version", 6: "doc_string",
    7: "graph", 8: "opset_import", 14: "metadata_props", 20: "training_info", 25: "functions", 26: "configuration",
}  # fmt: skip
ENTRY = {1: "key", 2: "value"}
GRAPH = {
    1: "node", 2: "name", 5: "initializer", 10: "doc_string", 11: "input", 12: "output", 13: "value_info",
    14: "quantization_annotation", 15: "sparse_initializer", 16: "metadata_props",
}  # fmt: skip
NODE = {
    1: "input", 2: "output", 3: "name", 4: "op_type", 5: "attribute", 6: "doc_string", 7: "domain", 8: "overload",
    9: "metadata_props", 10: "device_configurations",
}  # fmt: skip
ATTRIBUTE = {
    1: "name", 2: "f", 3: "i", 4: "s", 5: "t", 6: "g", 7: "floats", 8: "ints", 9: "strings", 10: "tensors", 11: "graphs",
    13: "doc_string", 14: "tp", 15: "type_protos", 20: "type", 21: "ref_attr_name", 22: "sparse_tensor", 23: "sparse_tensors",
}  # fmt: skip
TENSOR = {
    1: "dims", 2: "data_type", 3: "segment", 4: "float_data", 5: "int32_data", 6: "string_data", 7: "int64_data", 8: "name",
    9: "raw_data", 10: "double_data", 11: "uint64_data", 12: "doc_string", 13: "external_data", 14: "data_location",
    16: "metadata_props",
}  # fmt: skip
"""Number -> name of the fields of each kind of message in onnx.proto."""

TYPES = {
    1: "<f4", 2: "u1", 3: "i1", 4: "<u2", 5: "<i2", 6: "<i4", 7: "<i8", 9: "?", 10: "<f2", 11: "<f8", 12: "<u4", 13: "<u8",
}  # fmt: skip
"""A tensor's `data_type` -> what NumPy calls it."""
STORES = {1: "float_data", 11: "double_data"}
"""A tensor's `data_type` -> the field that may hold its numbers in place of `raw_data`."""


class MalformedError(ValueError):
    """Bytes that are not a message of the expected kind."""


class Field(NamedTuple):
    """One field of a message.

    value    a number, or the bytes of a text, a message or packed numbers
    encoded  the whole field as it stands in the message
    """

    name: str
    value: int | memoryview
    encoded: memoryview

    @property
    def content(self) -> memoryview:
        """The bytes of a field that has bytes; MalformedError for a number."""
        if isinstance(self.value, int):
            raise MalformedError(f"a number as {self.name}")
        return self.value

    @property
    def text(self) -> str:
        """The text of a field of bytes."""
        return bytes(self.content).decode(errors="replace")


def refuse(path: Path, expected: str, came: str) -> PolicyFileError:
    """The error for a file that is not a policy: expected, came, and what to give."""
    return PolicyFileError(f"{path} is no policy: expected {expected}, got {came}; {ADVICE}")


class Model:
    """An ONNX model in a file; only its outermost fields are checked at first.

    data      the bytes of the file
    metadata  its texts by key

    PolicyFileError if the file is too large, cannot be read or is not a model.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            size = path.stat().st_size
            if size > LARGEST:
                raise refuse(path, f"a file of at most {LARGEST >> 20} MiB", f"{size >> 20} MiB")
            self.data = path.read_bytes()
        except OSError as error:
            came = f"{type(error).__name__}: {error.strerror}"
            raise refuse(path, "a file that can be read", came) from error
        try:
            self._fields = list(read_fields(memoryview(self.data), MODEL))
            self._graphs = [field.content for field in self._fields if field.name == "graph"]
            self.metadata = dict(map(_entry, self._named("metadata_props")))
        except MalformedError as error:
            raise refuse(path, "an ONNX model", f"bytes that are none: {error}") from error
        if not self._graphs:
            raise refuse(path, "an ONNX model", "bytes without a graph")

    def with_metadata(self, key: str, text: str) -> bytes:
        """The model's bytes with one text of its metadata set."""
        others = [
            field.encoded
            for field in self._fields
            if field.name != "metadata_props" or _entry(field)[0] != key
        ]
        metadata_field = _encoded(1, key.encode()) + _encoded(2, text.encode())
        return b"".join([*others, _encoded(14, metadata_field)])

    def check(self) -> None:
        """Refuse a model unless it is one graph of standard operators.

        All weights must be inside the file.
        """
        try:
            self._check()
        except MalformedError as error:
            raise refuse(self.path, "a model that is whole", str(error)) from error

    def weights(self) -> dict[str, NDArray[Any]]:
        """The weights of a checked model by name, except types that NumPy does not have."""
        tensors = (
            Tensor(field.content) for field in self._graph_fields() if field.name == "initializer"
        )
        return {tensor.name: array for tensor in tensors if (array := tensor.array()) is not None}

    def _check(self) -> None:
        forbidden = {"functions", "training_info"} & {field.name for field in self._fields}
        fields = list(self._graph_fields())
        if forbidden or any(field.name == "sparse_initializer" for field in fields):
            raise refuse(
                self.path, "one plain graph", "functions, sparse weights or training of its own"
            )
        for field in fields:
            if field.name == "node":
                self._check_operator(list(read_fields(field.content, NODE)))
            elif field.name == "initializer":
                self._check_tensor(Tensor(field.content))

    def _check_operator(self, node: list[Field]) -> None:
        kind = next((field.text for field in node if field.name == "op_type"), "")
        for field in node:
            if field.name == "domain" and field.text not in ("", "ai.onnx"):
                came = f"the custom operator {field.text}.{kind}"[:90]
                raise refuse(self.path, "standard operators", came)
        attributes = [field.content for field in node if field.name == "attribute"]
        for field in chain.from_iterable(read_fields(part, ATTRIBUTE) for part in attributes):
            if field.name in ("g", "graphs"):
                came = f"the operator {kind}"[:90]
                raise refuse(self.path, "a graph without control flow", came)
            if field.name in ("sparse_tensor", "sparse_tensors"):
                came = f"sparse weights of the operator {kind}"[:90]
                raise refuse(self.path, "one plain graph", came)
            if field.name in ("t", "tensors"):
                self._check_tensor(Tensor(field.content))

    def _check_tensor(self, tensor: Tensor) -> None:
        if tensor.is_outside:
            came = f"{tensor.name or 'one'} in another file"[:90]
            raise refuse(self.path, "all weights inside the file", came)
        tensor.array()

    def _named(self, name: str) -> Iterator[Field]:
        return (field for field in self._fields if field.name == name)

    def _graph_fields(self) -> Iterator[Field]:
        """Yield the fields of the graph, which may be stored in several parts."""
        return chain.from_iterable(read_fields(part, GRAPH) for part in self._graphs)


class Tensor:
    """Numbers in a model.

    is_outside  whether the model claims that they are in another file
    """

    def __init__(self, message: memoryview) -> None:
        fields = list(read_fields(message, TENSOR))
        last = {field.name: field for field in fields}
        self.name = last["name"].text if "name" in last else ""
        self.is_outside = "external_data" in last or any(
            field.name == "data_location" and field.value != 0 for field in fields
        )
        kind = last["data_type"].value if "data_type" in last else 0
        self._type = kind if isinstance(kind, int) else 0
        sides = [_whole_numbers(field) for field in fields if field.name == "dims"]
        self._shape = list(chain.from_iterable(sides))
        self._stored = [field.content for field in fields if field.name == STORES.get(self._type)]
        if "raw_data" in last:
            self._stored = [last["raw_data"].content]

    def array(self) -> NDArray[Any] | None:
        """The numbers, or None if their type or storage is not supported.

        MalformedError if their count does not fit the shape.
        """
        kind = TYPES.get(self._type)
        if kind is None or not self._stored:
            return None
        content = b"".join(self._stored)
        if len(content) != math.prod(self._shape) * np.dtype(kind).itemsize:
            raise MalformedError(f"{len(content)} bytes as {self.name} {self._shape}"[:90])
        return np.frombuffer(content, kind).reshape(self._shape)


def read_fields(message: memoryview, names: Mapping[int, str]) -> Iterator[Field]:
    """Yield the fields of a protobuf message.

    Raises:
        MalformedError: If the bytes are not a message, or have fields beyond those named.
    """
    at = 0
    for _ in range(MOST_FIELDS):
        if at == len(message):
            return
        begin = at
        tag, at = _varint(message, at)
        number, wire = tag >> 3, tag & 7
        if number not in names or wire not in (VARINT, FIXED64, BYTES, FIXED32):
            raise MalformedError(f"an unknown field, {number}")
        content: int | memoryview
        if wire == VARINT:
            content, at = _varint(message, at)
        else:
            length, at = (
                _varint(message, at) if wire == BYTES else ({FIXED64: 8, FIXED32: 4}[wire], at)
            )
            content = message[at : at + length]
            at += length
            if at > len(message):
                raise MalformedError(f"half of the field {names[number]}")
        yield Field(names[number], content, message[begin:at])
    raise MalformedError(f"more than {MOST_FIELDS} fields")


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """The number at a place, and where the next field begins."""
    number = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise MalformedError("half of a number")
        byte = message[at]
        number |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return number, at
    raise MalformedError("a number without an end")


def _whole_numbers(field: Field) -> Iterator[int]:
    """Yield the number of a field, or the numbers that are packed in it."""
    if isinstance(field.value, int):
        yield field.value
        return
    at = 0
    while at < len(field.value):
        number, at = _varint(field.value, at)
        yield number


def _entry(field: Field) -> tuple[str, str]:
    """The key and the text of one metadata field."""
    texts = {part.name: part.text for part in read_fields(field.content, ENTRY)}
    return texts.get("key", ""), texts.get("value", "")


def _encoded(number: int, content: bytes) -> bytes:
    """A field of bytes as it stands in a message."""
    header, length = [number << 3 | BYTES], len(content)
    while length > 0x7F:
        header.append(length & 0x7F | 0x80)
        length >>= 7
    return bytes([*header, length]) + content
