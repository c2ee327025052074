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
from functools import lru_cache, partial
from operator import itemgetter, methodcaller
from typing import Any, Literal

import numpy as np

#: Kinds of the numbers in arrays: truth values, whole numbers, real and complex numbers.
_NUMBERS = "biufc"
#: Bytes of the length of the text, which comes first.
_LENGTH = 8
_PACKAGE = __name__.partition(".")[0]
#: Texts of fewer bytes are kept with what they describe.
_KEPT_TEXT = 4096
#: Makes a value of the content behind its text.
_Reader = Callable[[memoryview], Any]


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
        return (_reader if length < _KEPT_TEXT else _reader.__wrapped__)(text)(content)
    except (
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
        OverflowError,
        MemoryError,
    ) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


@lru_cache(maxsize=256)
def _reader(text: bytes) -> _Reader:
    """What makes the value that a text describes; many values of a stage have one text."""
    return _reader_of(json.loads(text))


def _reader_of(tree: Any) -> _Reader:
    """What makes the value that `described` described."""
    if not isinstance(tree, list):
        if isinstance(tree, dict):
            raise ValueError("no description of a value")
        return lambda content: tree
    kind, *parts = tree
    if kind == "bytes":
        size, start = parts
        return partial(_bytes, start, start + size)
    if kind == "float":
        return _array(np.dtype(float), (), "C", parts[0], float)
    if kind == "number":
        return _array(_numbers(parts[0]), (), "C", parts[1], itemgetter(()))
    if kind == "array":
        name, shape, order, start = parts
        return _array(_numbers(name), tuple(shape), order, start, methodcaller("copy", "K"))
    if kind == "dict":
        pairs = [(_reader_of(key), _reader_of(value)) for key, value in parts]
        return lambda content: {key(content): value(content) for key, value in pairs}
    readers = [_reader_of(part) for part in parts]
    if kind == "tuple":
        return lambda content: tuple([reader(content) for reader in readers])
    if kind == "list":
        return lambda content: [reader(content) for reader in readers]
    return _instances(kind, readers)


def _bytes(start: int, stop: int, content: memoryview) -> bytes:
    if not 0 <= start <= stop <= len(content):
        raise ValueError("bytes that are not there")
    return bytes(content[start:stop])


def _array(
    numbers: np.dtype[Any], shape: Any, order: Any, start: int, taken: Callable[[Any], Any]
) -> _Reader:
    """What takes something of an array of numbers that begin somewhere; content that is too short is an error then."""
    if min((start, *shape)) < 0:
        raise ValueError("a place or a size below 0")
    stop = start + math.prod(shape) * numbers.itemsize
    if stop == start:
        return lambda content: taken(np.ndarray(shape, numbers, order=order))
    return lambda content: taken(np.ndarray(shape, numbers, content[start:stop], order=order))


def _numbers(name: str) -> np.dtype[Any]:
    if (dtype := np.dtype(name)).kind not in _NUMBERS:
        raise ValueError(f"an array of {dtype}")
    return dtype


def _instances(name: str, readers: list[_Reader]) -> _Reader:
    """What makes a dataclass of femseal with these fields; only modules that are in use are looked at."""
    module, _, title = name.rpartition(".")
    kind = vars(sys.modules[module]).get(title) if module.partition(".")[0] == _PACKAGE else None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ValueError(f"'{name[:80]}' is no class of data")
    named = [(field.name, reader) for field, reader in zip(fields(kind), readers, strict=True)]

    def made(content: memoryview) -> Any:
        value = object.__new__(kind)
        vars(value).update([(name, reader(content)) for name, reader in named])
        return value

    return made
