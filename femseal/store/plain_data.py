"""Convert plain data to bytes and back, without pickle.

Plain data are None, numbers, strings, bytes and arrays of numbers, and also tuples, lists, dictionaries and dataclasses
of femseal that contain plain data.

Plain data are converted to a sequence of three parts: the length of a JSON text, the JSON text, and the content of all
arrays. The JSON text describes how the data are nested. An array is described in the JSON text by its data type, its
shape, its order in memory and the position of its content. Reading plain data calls no constructor and imports no
module, so that a manipulated file cannot run code.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, Literal

import numpy as np

#: Data types of arrays: truth values, integers, real and complex numbers (`numpy.dtype.kind`).
_NUMBERS = "biufc"
#: Number of bytes for the length of the JSON text.
_LENGTH_BYTES = 8
_PACKAGE = __name__.partition(".")[0]
#: Exceptions, in addition to ValueError, that damaged bytes can cause when they are read.
_ERRORS_OF_DAMAGE = (
    TypeError,
    LookupError,
    AttributeError,
    RecursionError,
    OverflowError,
    MemoryError,
)


def packed(value: Any) -> bytes:
    """Convert plain data to bytes.

    Raises
    ------
    TypeError : the value contains something that is not plain data.
    """
    content = bytearray()

    def append(data: bytes) -> int:
        """Append bytes to the content, and return the position of the first appended byte."""
        start = len(content)
        content.extend(data)
        return start

    text = json.dumps(describe(value, append)).encode()
    length = len(text).to_bytes(_LENGTH_BYTES, "little")
    return b"".join([length, text, content])


def unpacked(data: bytes | memoryview) -> Any:
    """Restore a value from the bytes that `packed` returned. Arrays in the restored value are copies.

    Raises
    ------
    ValueError : the bytes are damaged, or contain an object of a class that is not imported.
    """
    view = memoryview(data)
    try:
        length = int.from_bytes(view[:_LENGTH_BYTES], "little")
        text_and_content = view[_LENGTH_BYTES:]
        text = bytes(text_and_content[:length])
        return _restore(json.loads(text), text_and_content[length:])
    except _ERRORS_OF_DAMAGE as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None


def describe(
    value: Any, append: Callable[[bytes], int], substitute: Callable[[Any], Any] | None = None
) -> Any:
    """Describe a value by nested lists of numbers and strings, which can be written as JSON.

    Numbers, strings and None are their own descriptions. The description of any other value is a list, which contains
    the name of its type and the descriptions of its members.

    Parameters
    ----------
    value : the value to be described.
    append : function that stores the bytes of an array, and returns the position of the first byte.
    substitute : function that returns plain data for a value that is not plain data. Without this function, values that
        are not plain data raise a TypeError.

    Raises
    ------
    TypeError : a part of the value is not plain data, and the argument `substitute` is None.
    """

    def describe_member(member: Any) -> Any:
        return describe(member, append, substitute)

    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind in (tuple, list):
        return [kind.__name__, *map(describe_member, value)]
    if kind is dict:
        pairs = ([describe_member(key), describe_member(item)] for key, item in value.items())
        return ["dict", *pairs]
    if kind is bytes:
        return ["bytes", len(value), append(value)]
    if isinstance(value, np.generic) and value.dtype.kind in _NUMBERS:
        return ["number", value.dtype.str, append(value.tobytes())]
    if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS:
        # the order in memory is preserved, because the rounding errors of a sum over an array depend on this order
        order: Literal["C", "F"] = "F" if value.flags.fnc else "C"
        return ["array", value.dtype.str, list(value.shape), order, append(value.tobytes(order))]
    if is_dataclass(kind) and _is_ours(kind.__module__):
        values = [describe_member(getattr(value, field.name)) for field in fields(kind)]
        return [f"{kind.__module__}.{kind.__qualname__}", *values]
    if substitute is None:
        raise TypeError(f"a {kind.__name__} is not plain data")
    return describe_member(substitute(value))


def _restore(description: Any, content: memoryview) -> Any:
    """Restore a value from its description (see `describe`) and from the stored bytes of all arrays."""
    if isinstance(description, dict):
        raise ValueError("no description of a value")
    if not isinstance(description, list):
        return description  # None, a number or a text
    kind, *parts = description
    if kind == "bytes":
        size, start = parts
        return _array_in(content, "u1", (size,), "C", start).tobytes()
    if kind == "number":
        dtype, start = parts
        return _array_in(content, dtype, (), "C", start)[()]
    if kind == "array":
        return _array_in(content, *parts).copy("K")
    if kind == "dict":
        return {_restore(key, content): _restore(item, content) for key, item in parts}
    values = [_restore(part, content) for part in parts]
    if kind == "list":
        return values
    if kind == "tuple":
        return tuple(values)
    return _dataclass(kind, values)


def _array_in(content: memoryview, dtype: str, shape: Any, order: Any, start: int) -> Any:
    """Return the array whose data start at byte `start`; raise TypeError if the content is too short."""
    numbers = np.dtype(dtype)
    if numbers.kind not in _NUMBERS or min((start, *shape)) < 0:
        raise ValueError(f"not an array of numbers: {numbers}, {shape}, {start}")
    size = math.prod(shape) * numbers.itemsize
    data = content[start : start + size] if size else None
    return np.ndarray(shape, numbers, data, order=order)


def _dataclass(name: str, values: list[Any]) -> Any:
    """Make an object of a femseal dataclass from the values of its fields, without calling the constructor.

    name : dotted path of the class, such as "femseal.materials.Solid". The module of the class must already have been
    imported.
    """
    module, _, title = name.rpartition(".")
    kind = vars(sys.modules[module]).get(title) if _is_ours(module) else None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ValueError(f"'{name[:80]}' is not a dataclass of femseal")
    instance = object.__new__(kind)
    names = (field.name for field in fields(kind))
    vars(instance).update(zip(names, values, strict=True))
    return instance


def _is_ours(module: str) -> bool:
    """Return whether a module belongs to femseal."""
    return module.partition(".")[0] == _PACKAGE
