"""Errors of the package: bad input, and iterations that did not converge."""

from __future__ import annotations

from collections.abc import Sequence
from reprlib import Repr
from typing import Any

#: Longest text of a user in a message, in characters; longer ones lose their middle.
_LONGEST = 160
#: Faults in a message.
_MOST_FAULTS = 20
#: What is given where a needed input is not there.
MISSING = "missing"
_REPR = Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 80


class FemsealError(Exception):
    """Base of every error that femseal raises on purpose.

    exit_code : of the command that it ends.
    """

    exit_code = 1


class NotKept(FemsealError):
    """Results cannot be written or read: the run stops, as whatever else it would do could not be resumed."""


class InputError(FemsealError, ValueError):
    """An input cannot be used: `what` it is, what was `given` ("" where that says nothing), and what is `expected`.

    >>> str(InputError("pressure", -1.0, "a number >= 0 [Pa]"))
    'pressure: given -1.0, expected a number >= 0 [Pa]'
    """

    exit_code = 2

    def __init__(self, what: str, given: object, expected: str) -> None:
        self.what, self.given, self.expected = what, given, expected
        super().__init__(what, given, expected)

    def __str__(self) -> str:
        given = shortened(self.given)
        said = {"": "", MISSING: "missing, "}.get(given, f"given {given}, ")
        return f"{shortened(self.what)}: {said}expected {self.expected}"

    def inside(self, place: str) -> InputError:
        """The same error about the input as it is named in a table, such as "load" for "load.map"."""
        return InputError(f"{place}.{self.what}", self.given, self.expected)

    def __reduce__(self) -> tuple[Any, ...]:
        # whatever was given, its text can be sent
        return InputError, (self.what, shortened(self.given), self.expected)


class InputErrors(InputError):
    """Several inputs cannot be used, `faults`; `what`, `given` and `expected` are those of the first."""

    def __init__(self, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        super().__init__(faults[0].what, faults[0].given, faults[0].expected)

    def __str__(self) -> str:
        lines = [str(fault) for fault in self.faults[:_MOST_FAULTS]]
        more = len(self.faults) - len(lines)
        return "\n".join([*lines, f"{more} more fault{'s' * (more > 1)}"] if more else lines)

    def __reduce__(self) -> tuple[Any, ...]:
        return InputErrors, (self.faults,)


def shortened(given: object, longest: int = _LONGEST) -> str:
    """Text of a value for a message: on one line, and without its middle if it is long.

    >>> shortened("a" * 20, 9)
    'aaaa…aaaa'
    """
    text = str(given)
    if not text.isprintable():
        text = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
    if len(text) <= longest:
        return text
    half = (longest - 1) // 2
    return f"{text[:half]}…{text[-half:]}"


def shown(given: object) -> str:
    """Python's text of a value for a message, which stays short for long texts, long lists and deep ones."""
    try:
        return shortened(_REPR.repr(given))
    except ValueError:  # Python writes no whole numbers of thousands of digits
        return "a number of too many digits"


class NotConverged(FemsealError, RuntimeError):
    """An iteration stalled: the message says which residual was reached and what to try."""

    def __init__(self, message: str, residual: float = float("nan")) -> None:
        super().__init__(message)
        self.residual = residual
