"""What must come out of a hard scene: a text, and a judgement of what came. NaN satisfies no judge."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from femseal import InputError


@dataclass(frozen=True)
class Judge:
    """What must come out, in words and numbers, and whether some numbers, or an error that was raised, are that."""

    text: str
    test: Callable
    errors: bool = False

    def holds(self, came):
        """Whether what came is what must come."""
        if isinstance(came, BaseException) or self.errors:
            return self.errors and self.test(came)
        values = np.ravel(np.asarray(came, dtype=float))
        return bool(values.size and not np.isnan(values).any() and np.all(self.test(values)))


def numbers(came):
    """A number, several numbers or an error as text.

    >>> numbers((1.0, 0.33333333)), numbers(ValueError("gap"))
    ('1, 0.333333', 'ValueError: gap')
    """
    if isinstance(came, BaseException):
        return f"{type(came).__name__}: {came}"
    return ", ".join(f"{value:.6g}" for value in np.ravel(came))


def near(value, rtol, source=""):
    """Numbers within a relative error, such as those of a closed form; 0 of them: to the last digit."""
    wanted = np.ravel(np.asarray(value, dtype=float))

    def test(came):
        return came.shape == wanted.shape and np.abs(came - wanted) <= rtol * np.abs(wanted)

    return Judge(f"{numbers(value)} within {rtol:g}, {source}", test)


def exactly(value, source=""):
    """Numbers to the last digit."""
    return near(value, 0.0, source)


def between(low, high, source):
    """Finite numbers between two bounds, both included; `source` says what they are."""
    text = f"{low:.6g} to {high:.6g}, {source}"
    return Judge(text, lambda came: np.isfinite(came) & (low <= came) & (came <= high))


def falling(source, steeply=True):
    """Finite numbers each no larger than the one before; `steeply` excludes equal ones."""

    def test(came):
        steps = np.diff(came)
        return steps.size and (steps < 0 if steeply else steps <= 0).all() and np.isfinite(came)

    return Judge(f"{'falling' if steeply else 'not rising'} numbers, {source}", test)


def zero_and_positive(source):
    """First exactly 0 and then a finite number above 0: the two sides of closing."""
    return Judge(
        f"exactly 0, then above 0, {source}",
        lambda came: came.size == 2 and came[0] == 0 and 0 < came[1] < np.inf,
    )


def refused(*words):
    """An error of bad input whose message has these words."""

    def test(came):
        return isinstance(came, InputError) and all(word in str(came) for word in words)

    return Judge(f"InputError with the words {' … '.join(words)}", test, errors=True)
