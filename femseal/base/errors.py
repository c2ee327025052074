"""Errors of the package: bad input, and iterations that did not converge."""

from __future__ import annotations


class FemsealError(Exception):
    """Base of every error that femseal raises on purpose."""


class InputError(FemsealError, ValueError):
    """An input cannot be used: the message names it, what was given and what is allowed."""

    @classmethod
    def of(cls, name: str, given: object, allowed: str) -> InputError:
        """Build the one-line message ``name: given …, allowed …``.

        >>> str(InputError.of("pressure", -1.0, "a number >= 0 [Pa]"))
        'pressure: given -1.0, allowed is a number >= 0 [Pa]'
        """
        return cls(f"{name}: given {given}, allowed is {allowed}")


class NotConverged(FemsealError, RuntimeError):
    """An iteration stalled: the message says which residual was reached and what to try."""

    def __init__(self, message: str, residual: float = float("nan")) -> None:
        super().__init__(message)
        self.residual = residual
