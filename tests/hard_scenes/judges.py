"""What must come out of a hard scene: a text, and a judgement of what came. NaN satisfies no judge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from femseal.base.errors import InputError, NotConverged


class Judge(Protocol):
    """What must come out."""

    @property
    def text(self) -> str:
        """What must come out, in words and numbers."""
        ...

    def holds(self, came: Any) -> bool:
        """Whether what came is that; an error that was raised comes as the error itself."""
        ...


def numbers(came: Any) -> str:
    """A number, several numbers or an error as text.

    >>> numbers((1.0, 0.33333333)), numbers(ValueError("gap"))
    ('1, 0.333333', 'ValueError: gap')
    """
    if isinstance(came, BaseException):
        return f"{type(came).__name__}: {came}"
    return ", ".join(f"{value:.6g}" for value in np.ravel(came))


def _values(came: Any) -> np.ndarray | None:
    if isinstance(came, BaseException):
        return None
    values = np.ravel(np.asarray(came, dtype=float))
    return values if values.size and not np.isnan(values).any() else None


@dataclass(frozen=True)
class Near:
    """Numbers within a relative error, such as those of a closed form."""

    value: Any
    rtol: float
    source: str = ""

    @property
    def text(self) -> str:
        """What must come out."""
        source = f", {self.source}" if self.source else ""
        return f"{numbers(self.value)} within {self.rtol:g}{source}"

    def holds(self, came: Any) -> bool:
        """Every number is within the relative error."""
        values, wanted = _values(came), np.ravel(np.asarray(self.value, dtype=float))
        return (
            values is not None
            and values.shape == wanted.shape
            and bool((np.abs(values - wanted) <= self.rtol * np.abs(wanted)).all())
        )


@dataclass(frozen=True)
class Exactly:
    """Numbers to the last digit."""

    value: Any
    source: str = ""

    @property
    def text(self) -> str:
        """What must come out."""
        return f"exactly {numbers(self.value)}" + (f", {self.source}" if self.source else "")

    def holds(self, came: Any) -> bool:
        """Every number is the same."""
        values = _values(came)
        return values is not None and np.array_equal(
            values, np.ravel(np.asarray(self.value, dtype=float))
        )


@dataclass(frozen=True)
class Between:
    """Numbers between two bounds, both included; `source` says what they are."""

    low: float
    high: float
    source: str

    @property
    def text(self) -> str:
        """What must come out."""
        if self.low == -np.inf:
            return f"at most {self.high:.6g}, {self.source}"
        if self.high == np.inf:
            return f"at least {self.low:.6g}, {self.source}"
        return f"{self.low:.6g} to {self.high:.6g}, {self.source}"

    def holds(self, came: Any) -> bool:
        """Every number is finite and between the bounds."""
        values = _values(came)
        return values is not None and bool(
            (np.isfinite(values) & (self.low <= values) & (values <= self.high)).all()
        )


def at_most(high: float, source: str) -> Between:
    """Numbers of any sign up to a bound, such as the deviation from an invariant."""
    return Between(-np.inf, high, source)


@dataclass(frozen=True)
class Falling:
    """Finite numbers each no larger than the one before; `steeply` excludes equal ones."""

    source: str
    steeply: bool = True

    @property
    def text(self) -> str:
        """What must come out."""
        return f"{'falling' if self.steeply else 'not rising'} numbers, {self.source}"

    def holds(self, came: Any) -> bool:
        """The numbers fall."""
        values = _values(came)
        if values is None or not np.isfinite(values).all() or values.size < 2:
            return False
        steps = np.diff(values)
        return bool((steps < 0).all() if self.steeply else (steps <= 0).all())


@dataclass(frozen=True)
class ZeroAndPositive:
    """First exactly 0 and then a finite number above 0: the two sides of closing."""

    source: str

    @property
    def text(self) -> str:
        """What must come out."""
        return f"exactly 0, then above 0, {self.source}"

    def holds(self, came: Any) -> bool:
        """The first is 0, the second is not."""
        values = _values(came)
        return (
            values is not None
            and values.size == 2
            and bool(values[0] == 0 and 0 < values[1] < np.inf)
        )


@dataclass(frozen=True)
class Refused:
    """An `InputError` whose message has these words."""

    words: tuple[str, ...]

    @property
    def text(self) -> str:
        """What must come out."""
        return f"refused with the words {' … '.join(self.words)}"

    def holds(self, came: Any) -> bool:
        """It was refused, by name."""
        return isinstance(came, InputError) and all(word in str(came) for word in self.words)


@dataclass(frozen=True)
class NotSolved:
    """A `NotConverged` whose message has these words: no number rather than a wrong one."""

    words: tuple[str, ...]

    @property
    def text(self) -> str:
        """What must come out."""
        return f"not solved, with the words {' … '.join(self.words)}"

    def holds(self, came: Any) -> bool:
        """It was not solved, and says why."""
        return isinstance(came, NotConverged) and all(word in str(came) for word in self.words)
