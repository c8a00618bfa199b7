"""Writes small ONNX files: the package `onnx` needs a protobuf that commonroad-io does not allow in the lock.

Field numbers and types are those of onnx.proto3 (IR version 7). No tests in here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

ELEMENT_TYPES = {"float32": 1, "uint8": 2, "int64": 7}
"""TensorProto.DataType."""
VARINT, BYTES = 0, 2
INT_ATTRIBUTE, INTS_ATTRIBUTE = 2, 7


@dataclass(frozen=True)
class Array:
    """An input or output: name, shape with the batch dimension, dtype; a size that is a name may be any number."""

    name: str
    shape: tuple[int | str, ...]
    dtype: str = "float32"


@dataclass(frozen=True)
class Node:
    """One operation; attributes are whole numbers or several of them."""

    operation: str
    inputs: tuple[str, ...]
    output: str
    attributes: tuple[tuple[str, int | tuple[int, ...]], ...] = ()


def write_model(
    nodes: Sequence[Node],
    constants: dict[str, np.ndarray],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    opset: int = 13,
) -> bytes:
    """Return a ModelProto."""
    graph = b"".join(_block(1, _node(node)) for node in nodes)
    graph += _block(2, b"tiny")
    graph += b"".join(_block(5, _constant(name, value)) for name, value in constants.items())
    graph += b"".join(_block(11, _array(array)) for array in inputs)
    graph += b"".join(_block(12, _array(array)) for array in outputs)
    return _number(1, 7) + _block(7, graph) + _block(8, _block(1, b"") + _number(2, opset))


def _node(node: Node) -> bytes:
    names = b"".join(_block(1, name.encode()) for name in node.inputs)
    attributes = b"".join(_block(5, _block(1, name.encode()) + _value(value)) for name, value in node.attributes)
    return names + _block(2, node.output.encode()) + _block(4, node.operation.encode()) + attributes


def _value(value: int | tuple[int, ...]) -> bytes:
    if isinstance(value, int):
        return _number(3, value) + _number(20, INT_ATTRIBUTE)
    return b"".join(_number(8, one) for one in value) + _number(20, INTS_ATTRIBUTE)


def _constant(name: str, value: np.ndarray) -> bytes:
    dimensions = b"".join(_number(1, size) for size in value.shape)
    kind = _number(2, ELEMENT_TYPES[str(value.dtype)])
    return dimensions + kind + _block(8, name.encode()) + _block(9, value.tobytes())


def _array(array: Array) -> bytes:
    sizes = [_block(2, size.encode()) if isinstance(size, str) else _number(1, size) for size in array.shape]
    shape = b"".join(_block(1, size) for size in sizes)
    tensor = _number(1, ELEMENT_TYPES[array.dtype]) + _block(2, shape)
    return _block(1, array.name.encode()) + _block(2, _block(1, tensor))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3 | VARINT) + _varint(value)


def _block(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | BYTES) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    groups = bytearray()
    while value > 0x7F:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*groups, value))
