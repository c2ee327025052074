"""Faults in a case as validators raise them."""

from collections.abc import Iterator
from contextlib import contextmanager

from pydantic_core import PydanticCustomError

from ..base import InputError, shortened

#: Longest text of what is expected, in characters; a longer one loses its middle.
_LONGEST = 300
#: Fields of a case that are no keys of its file.
INTERNAL = ("folder", "named_warnings")


def fault(what: str, given: object, expected: str) -> PydanticCustomError:
    """Fault of a case that involves several keys, for validators to raise."""
    context = {"what": what, "given": shortened(given), "expected": shortened(expected, _LONGEST)}
    return PydanticCustomError("input", "{what}: given {given}, expected {expected}", context)


def refusal(expected: str) -> PydanticCustomError:
    """Fault of the value of one key, for validators to raise."""
    return PydanticCustomError("refusal", "{expected}", {"expected": expected})


@contextmanager
def refusals(expected: str = "") -> Iterator[None]:
    """Errors of what is called inside as faults of the value of one key; with what they expect unless given."""
    try:
        yield
    except InputError as error:
        raise refusal(expected or error.expected) from None


@contextmanager
def faults_of(table: str = "") -> Iterator[None]:
    """Errors of what is called inside as faults of a table, of which they name the key; "" if they name it in full."""
    try:
        yield
    except InputError as error:
        raise fault(f"{table}.{error.what}".lstrip("."), error.given, error.expected) from None
