"""Errors of the package: bad input, and iterations that did not converge."""

from __future__ import annotations

from reprlib import Repr

#: Longest text of a user in a message, in characters; longer ones lose their middle.
_LONGEST = 160
_REPR = Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 80


class FemsealError(Exception):
    """Base of every error that femseal raises on purpose."""


class NotKept(FemsealError):
    """Results cannot be written or read: the run stops, as whatever else it would do could not be resumed."""


class InputError(FemsealError, ValueError):
    """An input cannot be used: the message names it, what was given and what is allowed."""

    @classmethod
    def of(cls, name: str, given: object, allowed: str) -> InputError:
        """Build the one-line message ``name: given …, allowed …``.

        >>> str(InputError.of("pressure", -1.0, "a number >= 0 [Pa]"))
        'pressure: given -1.0, allowed is a number >= 0 [Pa]'
        """
        return cls(f"{shortened(name)}: given {shortened(given)}, allowed is {allowed}")


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
