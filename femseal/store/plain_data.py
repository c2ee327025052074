"""Results of stages as bytes and back, as data alone: reading them runs no code and takes memory for what is there.

A text in JSON holds the structure; floats and the numbers of arrays follow it as they are in memory. A value may be
None, a number, a text, bytes, an array of numbers, or a tuple, list, dictionary or dataclass of femseal with such
values.
"""

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

    text = json.dumps(described(value, kept)).encode()
    return b"".join([len(text).to_bytes(_LENGTH, "little"), text, *content])


def described(
    value: Any, kept: Callable[[bytes], int], named: Callable[[Any], Any] | None = None
) -> Any:
    """A value as nested lists, numbers and texts; bytes of arrays go to `kept`, which returns a number for their place.

    named : gives what stands for a value that is no plain data.

    Raises TypeError: something is no plain data, and nothing stands for it.
    """
    kind = type(value)
    if value is None or kind in (bool, int, str):
        return value
    if kind is float:
        return ["float", kept(np.float64(value).tobytes())]
    if kind in (tuple, list):
        return [kind.__name__, *(described(v, kept, named) for v in value)]
    if kind is dict:
        return [
            "dict",
            *([described(k, kept, named), described(v, kept, named)] for k, v in value.items()),
        ]
    if kind is bytes:
        return ["bytes", len(value), kept(value)]
    if isinstance(value, np.generic) and value.dtype.kind in _NUMBERS:
        return ["number", value.dtype.str, kept(value.tobytes())]
    if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS:
        # sums over an array depend on its order in memory
        order: Literal["C", "F"] = (
            "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
        )
        return ["array", value.dtype.str, list(value.shape), order, kept(value.tobytes(order))]
    if is_dataclass(kind) and kind.__module__.partition(".")[0] == _PACKAGE:
        values = (described(getattr(value, f.name), kept, named) for f in fields(kind))
        return [f"{kind.__module__}.{kind.__qualname__}", *values]
    if named is not None:
        return described(named(value), kept, named)
    raise TypeError(f"a {kind.__name__} is no plain data")


def unpacked(data: bytes | memoryview) -> Any:
    """The value of the bytes; arrays are copies. No constructor is called.

    Raises ValueError: the bytes are damaged, or of other classes than those in use.
    """
    try:
        length = int.from_bytes(data[:_LENGTH], "little")
        text, content = (
            bytes(data[_LENGTH : _LENGTH + length]),
            memoryview(data)[_LENGTH + length :],
        )
        return _value(json.loads(text), content)
    except (
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
        OverflowError,
        MemoryError,
    ) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def _value(tree: Any, content: memoryview) -> Any:
    """The value that `described` described."""
    if isinstance(tree, dict):
        raise ValueError("no description of a value")
    if not isinstance(tree, list):
        return tree
    kind, *parts = tree
    if kind == "bytes":
        size, start = parts
        if not 0 <= start <= start + size <= len(content):
            raise ValueError("bytes that are not there")
        return bytes(content[start : start + size])
    if kind == "float":
        return float(_array(content, "f8", (), "C", *parts))
    if kind == "number":
        name, start = parts
        return _array(content, name, (), "C", start)[()]
    if kind == "array":
        return _array(content, *parts).copy("K")
    if kind == "dict":
        return {_value(key, content): _value(value, content) for key, value in parts}
    values = [_value(part, content) for part in parts]
    if kind in ("list", "tuple"):
        return values if kind == "list" else tuple(values)
    return _instance(kind, values)


def _array(content: memoryview, name: str, shape: Any, order: Any, start: int) -> Any:
    """An array of numbers that begin somewhere in the content; TypeError where that is too short."""
    if min((start, *shape)) < 0:
        raise ValueError("a place or a size below 0")
    numbers = _numbers(name)
    size = math.prod(shape) * numbers.itemsize
    return np.ndarray(shape, numbers, content[start : start + size] if size else None, order=order)


def _numbers(name: str) -> np.dtype[Any]:
    if (dtype := np.dtype(name)).kind not in _NUMBERS:
        raise ValueError(f"an array of {dtype}")
    return dtype


def _instance(name: str, values: list[Any]) -> Any:
    """A dataclass of femseal with these fields; only modules that are in use are looked at."""
    module, _, title = name.rpartition(".")
    kind = vars(sys.modules[module]).get(title) if module.partition(".")[0] == _PACKAGE else None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ValueError(f"'{name[:80]}' is no class of data")
    made = object.__new__(kind)
    vars(made).update(zip((field.name for field in fields(kind)), values, strict=True))
    return made
