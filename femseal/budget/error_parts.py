"""Combine the error sources of a leakage into one 95 % interval.

The class `ErrorPart` holds one error source, and the class `ErrorBudget` combines all error sources.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np

from ..base import Array, counted
from ..loads import LoadProgramme, least_counted
from .load_order import within_others

#: Order of convergence of the leakage with decreasing pixel size. Measured on 320 surfaces of 64² to 256² points: the
#: median is 1.9.
ORDER = 2.0


@dataclass(frozen=True)
class ErrorPart:
    """One error source, with the 95 % interval that the leakage would have without any other error.

    Parameters
    ----------
    name : name of the error source: a name in `sources.SOURCES`, or "patches" or "blocks" in place of "patch".
    lower, upper : lower and upper ends of the 95 % interval of the leakage, arrays (steps,), m²/s. A lower end of 0
        means that the seal may be sealed. An upper end of inf means that no upper bound is known. NaN means that the
        error of the source is unknown.
    note : a sentence that says how the interval was estimated.
    of_model : whether the error is one of the model or of its input. All other errors are numerical.
    """

    name: str
    lower: Array
    upper: Array
    note: str
    of_model: bool = False

    @classmethod
    def from_distances(
        cls, name: str, leakage: Array, below: Array, above: Array, note: str
    ) -> ErrorPart:
        """Make an error source from the distances between ln(leakage) and both ends of its interval.

        Parameters
        ----------
        name : str
            Name of the error source: a name in `sources.SOURCES`, or "patches" or "blocks" in place of "patch".
        leakage : array (steps,), m²/s
            Leakage. At steps where the leakage is 0, the lower and upper ends of the interval are 0.
        below, above : array (steps,)
            Distances from ln(leakage) to the lower and to the upper end of its interval. If `below` is inf, the seal
            may be sealed.
        note : str
            Sentence that says how the interval was estimated.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):
            lower = np.where(q == 0, 0.0, q * np.exp(-np.asarray(below)))
            upper = np.where(q == 0, 0.0, q * np.exp(np.asarray(above)))
        return cls(name, lower, upper, note)

    def widened(self, leakage: Array, factor: Array) -> ErrorPart:
        """Widen the interval by a factor for each step (steps,), except at sealed steps.

        The factor multiplies the distances from ln(leakage) to the lower and to the upper end.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # a power of end/q multiplies the distance ln(end/q)
            lower, upper = (
                np.where(q == 0, end, q * (end / q) ** factor) for end in (self.lower, self.upper)
            )
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True, repr=False)
class ErrorBudget:
    """Error budget of the leakage that a study computed: its error sources and its 95 % interval.

    Parameters
    ----------
    method : str
        Name of the study.
    leakage : array (steps,), m²/s
        Leakage per unit seal length.
    parts : tuple of ErrorPart
        Error sources.
    steps : LoadProgramme, optional
        Load steps. If load steps are given, the intervals are made consistent with the rule that a seal never leaks
        more under a higher load, see `within_others`. Without load steps, the interval of each step is not changed.
    separated : tuple of int
        Indices of the steps where the fluid carries the whole load, so that the faces are separated and the leakage
        is unknown.
    """

    method: str
    leakage: Array
    parts: tuple[ErrorPart, ...]
    steps: LoadProgramme | None = None
    separated: tuple[int, ...] = ()

    def __repr__(self) -> str:
        parts = ", ".join(part.name for part in self.parts)
        return f"<femseal.ErrorBudget of the {self.method} leakage at {counted(len(self.leakage), 'load')}: {parts}>"

    @property
    def numerical(self) -> ErrorBudget:
        """Error budget that contains only the numerical error sources, without the errors of the model."""
        return replace(self, parts=tuple(part for part in self.parts if not part.of_model))

    @property
    def lower(self) -> Array:
        """Lower end of the 95 % interval (steps,) [m²/s].

        The lower end is 0 where the seal may be sealed, and NaN where an error source is unknown. The distance from
        ln(leakage) to the logarithm of the lower end is √Σd², where d is the distance due to one error source.
        """
        return self._ends[0]

    @property
    def upper(self) -> Array:
        """Upper end of the 95 % interval (steps,) [m²/s].

        The distance from ln(leakage) to the logarithm of the upper end is √Σd², where d is the distance due to one
        error source. At a sealed step, ln(leakage) does not exist, and the upper end of the budget is the largest upper
        end of all error sources.
        """
        return self._ends[1]

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Lower and upper ends of the 95 % interval, arrays (steps,)."""
        q = np.abs(self.leakage)
        highest = np.max([np.abs(part.upper) for part in self.parts], axis=0, initial=0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            low = np.where(q == 0, 0.0, q * np.exp(-self._distance("lower")))
            high = np.where(q == 0, highest, q * np.exp(self._distance("upper")))
        if self.steps is None:
            return low, high
        return within_others(self.steps, q, low, high)

    def half_width(self, step: int | None = None) -> Array | float:
        """Return the larger of the two distances from ln(leakage) to the ends of its interval.

        The half-width is an array (steps,), or a number if a step is given. A value of inf means that it is unknown
        whether the seal leaks: either the computed leakage is above 0 but the lower end is 0, or the computed leakage
        is 0 but the upper end is above 0.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Return the half-width (steps,) of the interval of each error source, by the name of the source."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Return the name of the error source with the widest interval, or "" if the budget has none.

        If a step is given, the intervals of the error sources are compared at this step. By default, the intervals are
        compared at all steps whose leakage is more than 1e-3 of the leakage at the first step.
        """
        widths = self.widths()
        if not widths:
            return ""
        q = np.abs(self.leakage)
        if step is None:
            is_compared = q > least_counted(q)
        else:
            is_compared = np.arange(q.size) == step
        if not is_compared.any():
            is_compared[:] = True
        return max(widths, key=lambda name: largest_half_width(widths[name][is_compared]))

    def _distance(self, end: str) -> Array:
        """Compute the distance (steps,) from ln(leakage) to the "lower" or "upper" end of the combined interval.

        The distance is √Σd², where d is the distance from ln(leakage) to the same end of the interval of one error
        source.
        """
        total = np.zeros(np.shape(self.leakage))
        for part in self.parts:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.abs(getattr(part, end)) / np.abs(self.leakage)
                total += np.where(self.leakage == 0, 0.0, np.log(ratio) ** 2)
        return np.sqrt(total)


def _width(leakage: Array, lower: Array, upper: Array) -> Array:
    """Compute the half-width (steps,), which is the larger distance from ln(leakage) to an end of its interval.

    The half-width is inf at a sealed step that may leak (upper end above 0).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(leakage == 0, sealed, width)


def largest_half_width(widths: Array) -> float:
    """Return the largest of several half-widths; inf if one of the half-widths is unknown."""
    return float(np.max(np.nan_to_num(widths, nan=inf, posinf=inf), initial=0.0))
