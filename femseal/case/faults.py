"""Raise errors in validators of a case in such a way that the key of each error can be determined.

Validators raise an `InputError`, and pydantic records which table or key was validated. If the error concerns a table,
its name is a key in this table: `InputError("inlet_pressure", …)`, raised while [fluid] is validated, concerns the key
`fluid.inlet_pressure`. If the error concerns a single value, its name is empty.
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


def invalid_value(expected: str) -> InputError:
    """Return an error about the value or the table that is validated, whose key pydantic records."""
    return InputError("", "", expected)


@contextmanager
def as_value_error(expected: str = "") -> Iterator[None]:
    """Convert an InputError that is raised within this context to an error about the value that is validated.

    Parameters
    ----------
    expected : description of the expected value; by default the description in the error.
    """
    try:
        yield
    except InputError as error:
        raise invalid_value(expected or error.expected) from None


@contextmanager
def errors_in_table(table: str) -> Iterator[None]:
    """Prepend the key of a table to the key in an InputError that is raised within this context."""
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
