"""Errors of validators, and how their key is found.

Validators raise `InputError`. pydantic knows the table or the key in which it was raised. An error of a table names a
key inside that table: `InputError("inlet_pressure", …)`, raised in [fluid], concerns `fluid.inlet_pressure`. An error
of a single value has an empty name, and concerns the key of that value.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..base import InputError

#: Fields of a case that are no keys of its file.
INTERNAL = ("folder", "named_warnings")
#: What is expected instead of a value of the wrong type, by the type of pydantic's error, in the words of TOML.
EXPECTED_TYPES = {
    "tuple_type": "a list in square brackets",
    "list_type": "a list in square brackets",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "dict_type": "a table",
    "string_type": "text in quotes",
    "path_type": "text in quotes",
    "float_type": "a number",
    "float_parsing": "a number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "too_short": "a list of at least one",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
}


def unusable(expected: str) -> InputError:
    """Return the error of a single value, or of a whole table, whose key pydantic knows."""
    return InputError("", "", expected)


@contextmanager
def of_value(expected: str = "") -> Iterator[None]:
    """Raise errors of the code inside as errors of a single value.

    Parameters
    ----------
    expected : what is expected; that of the error unless given.
    """
    try:
        yield
    except InputError as error:
        raise unusable(expected or error.expected) from None


@contextmanager
def inside(table: str) -> Iterator[None]:
    """Put the name of a table before the keys that errors of the code inside name."""
    try:
        yield
    except InputError as error:
        raise error.inside(table) from None


def expected_value(error: dict[str, Any]) -> str:
    """Return what an error of pydantic says about the expected value."""
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return cause.expected
    message = str(error["msg"]).removeprefix("Input should be ")
    return EXPECTED_TYPES.get(error["type"], message)
