"""Results of stages as bytes and back, as data alone: reading them runs no code and takes memory for what is there.

A text in JSON holds the structure; the numbers of arrays follow it as they are in memory. A value may be None, a
number, a text, bytes, an array of numbers, or a tuple, list, dictionary or dataclass of femseal with such values.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, Literal

import numpy as np

#: Kinds of the numbers in arrays: truth values, whole numbers, real and complex numbers.
_NUMBERS = "biufc"
#: Bytes of the length of the text, which comes first.
_LENGTH = 8
_PACKAGE = __name__.partition(".")[0]


def packed(value: Any) -> bytes:
    """The bytes of a value.

    Raises TypeError: something in the value is not plain data.
    """
    content: list[bytes] = []
    size = 0

    def kept(data: bytes) -> int:
        nonlocal size
        content.append(data)
        size += len(data)
        return size - len(data)

    text = json.dumps(_described(value, kept)).encode()
    return b"".join([len(text).to_bytes(_LENGTH, "little"), text, *content])


def _described(value: Any, kept: Callable[[bytes], int]) -> Any:
    """A value as nested lists, numbers and texts; bytes of arrays go to `kept`, which returns where they begin."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind in (tuple, list):
        return [kind.__name__, *(_described(v, kept) for v in value)]
    if kind is dict:
        return ["dict", *([_described(k, kept), _described(v, kept)] for k, v in value.items())]
    if kind is bytes:
        return ["bytes", len(value), kept(value)]
    if isinstance(value, np.generic) and value.dtype.kind in _NUMBERS:
        return ["number", value.dtype.str, kept(value.tobytes())]
    if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS:
        # sums over an array depend on its order in memory
        order: Literal["C", "F"] = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        return ["array", value.dtype.str, list(value.shape), order, kept(value.tobytes(order))]
    if is_dataclass(kind) and kind.__module__.partition(".")[0] == _PACKAGE:
        values = (_described(getattr(value, f.name), kept) for f in fields(kind))
        return [f"{kind.__module__}.{kind.__qualname__}", *values]
    raise TypeError(f"a {kind.__name__} is no plain data")


def unpacked(data: bytes | memoryview) -> Any:
    """The value of the bytes; arrays are copies. No constructor is called.

    Raises ValueError: the bytes are damaged, or of other classes than those in use.
    """
    try:
        length = int.from_bytes(data[:_LENGTH], "little")
        text, content = data[_LENGTH : _LENGTH + length], memoryview(data)[_LENGTH + length :]
        return _made(json.loads(bytes(text)), content)
    except (TypeError, LookupError, AttributeError, RecursionError, OverflowError, MemoryError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def _made(tree: Any, content: memoryview) -> Any:
    """The value that `_described` described."""
    if not isinstance(tree, list):
        if isinstance(tree, dict):
            raise ValueError("no description of a value")
        return tree
    kind, *parts = tree
    if kind == "tuple":
        return tuple(_made(part, content) for part in parts)
    if kind == "list":
        return [_made(part, content) for part in parts]
    if kind == "dict":
        return {_made(key, content): _made(value, content) for key, value in parts}
    if kind == "bytes":
        size, start = parts
        return bytes(_part(content, start, size))
    if kind == "number":
        dtype, start = parts
        return _numbers(content, dtype, [], start)[()]
    if kind == "array":
        dtype, shape, order, start = parts
        return _numbers(content, dtype, shape, start).reshape(shape, order=order).copy(order="K")
    return _instance(kind, [_made(part, content) for part in parts])


def _part(content: memoryview, start: int, size: int) -> memoryview:
    if not 0 <= start <= start + size <= len(content):
        raise ValueError("numbers that are not there")
    return content[start : start + size]


def _numbers(content: memoryview, name: str, shape: list[int], start: int) -> Any:
    dtype = np.dtype(name)
    if dtype.kind not in _NUMBERS or any(n < 0 for n in shape):
        raise ValueError(f"an array of {dtype}")
    count = math.prod(shape)
    flat = np.frombuffer(_part(content, start, count * dtype.itemsize), dtype, count) if count else np.empty(0, dtype)
    return flat if shape else flat.reshape(())


def _instance(name: str, values: list[Any]) -> Any:
    """A dataclass of femseal with these fields; only modules that are in use are looked at."""
    module, _, title = name.rpartition(".")
    kind = vars(sys.modules[module]).get(title) if module.partition(".")[0] == _PACKAGE else None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ValueError(f"'{name[:80]}' is no class of data")
    made = object.__new__(kind)
    for field, value in zip(fields(kind), values, strict=True):
        object.__setattr__(made, field.name, value)
    return made
