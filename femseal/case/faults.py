"""Raise errors in the validators of a case, so that every message can name the key of the case file.

A validator raises an `InputError`, and pydantic records which value or table was validated. The first argument of the
error is a key. The validator of a table passes the name of a key in the table. For example, if the validator of [fluid]
raises `InputError("inlet_pressure", …)`, the message names the key `fluid.inlet_pressure`. The validator of a single
value passes an empty text, because pydantic records the key.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..base import InputError

#: Fields of a case that are not keys of its file.
INTERNAL = ("folder", "named_warnings")
#: Description of the expected value in terms of TOML, for each type of error of pydantic.
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


def invalid_value(expected: str) -> InputError:
    """Return an InputError without a key, because pydantic records the key of the value or table that is validated."""
    return InputError("", "", expected)


@contextmanager
def as_value_error(expected: str = "") -> Iterator[None]:
    """Remove the key from an InputError that is raised in the `with` block, because pydantic records the key.

    Parameters
    ----------
    expected : description of the expected value; by default, the description in the original error.
    """
    try:
        yield
    except InputError as error:
        raise invalid_value(expected or error.expected) from None


@contextmanager
def errors_in_table(table: str) -> Iterator[None]:
    """Prepend the key of a table to the key of any InputError that the `with` block raises."""
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
