"""Raise errors in validators of a case, such that the key of each error can be found.

Validators raise an `InputError`, and pydantic records for which table or key. The error of a table names a key in this
table: `InputError("inlet_pressure", …)`, raised while [fluid] is validated, concerns the key `fluid.inlet_pressure`.
The error of a single value has an empty name; it concerns the key with this value.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..base import InputError

#: Fields of a case that are not keys of its file.
INTERNAL = ("folder", "named_warnings")
#: Descriptions of the expected value, in the words of TOML, by pydantic's name for the error.
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
    """Return an error about a single value or a whole table; pydantic knows its key."""
    return InputError("", "", expected)


@contextmanager
def of_value(expected: str = "") -> Iterator[None]:
    """Convert an InputError of the code inside to an error about a single value.

    Parameters
    ----------
    expected : description of the expected value; by default that of the error.
    """
    try:
        yield
    except InputError as error:
        raise unusable(expected or error.expected) from None


@contextmanager
def inside(table: str) -> Iterator[None]:
    """Prepend the key of a table to the key that an InputError of the code inside names."""
    try:
        yield
    except InputError as error:
        raise error.inside(table) from None


def expected_value(error: dict[str, Any]) -> str:
    """Return the description of the expected value in an error of pydantic."""
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, InputError):
        return cause.expected
    message = str(error["msg"]).removeprefix("Input should be ")
    return EXPECTED_TYPES.get(error["type"], message)
