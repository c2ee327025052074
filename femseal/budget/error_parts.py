"""The error budget of a leakage: the band of each source of error, and their combination."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..studies.compare import FLOOR
from ..studies.scene import Array


@dataclass(frozen=True)
class ErrorPart:
    """One source of error of a leakage, with the band that holds its truth in about 95 of 100 cases.

    name : "solver", "pixels", "filter", "windows", "two scales", "sampler", "library", or "realisations".
    lower, upper : leakage at every step if only this source erred (steps,) [m²/s]. A lower end of 0: may be sealed; an
        upper end of inf: no bound is known; NaN: unknown.
    note : how it was estimated, a sentence.
    """

    name: str
    lower: Array
    upper: Array
    note: str

    @classmethod
    def of(cls, name: str, leakage: Array, below: Array, above: Array, note: str) -> ErrorPart:
        """A part by its distances of ln(leakage) on both sides (steps,), inf below where it may be sealed.

        A sealed step stays sealed.
        """
        q = np.asarray(leakage, dtype=float)
        with np.errstate(invalid="ignore", over="ignore"):
            ends = (np.where(q == 0, 0.0, q * np.exp(d)) for d in (-np.asarray(below), np.asarray(above)))
            low, high = ends
        return cls(name, np.where(np.isnan(q), np.nan, low), np.where(np.isnan(q), np.nan, high), note)


@dataclass(frozen=True)
class ErrorBudget:
    """The error budget of the leakage of one study of one scene.

    method : "deterministic", "two-scale", or "stochastic". leakage : at every step (steps,) [m²/s]. parts : sources of
    error.
    """

    method: str
    leakage: Array
    parts: tuple[ErrorPart, ...]

    @property
    def lower(self) -> Array:
        """Lower end of the band at every step (steps,) [m²/s]: 0 where it may be sealed, NaN where a part is unknown.

        It is that of the root of the sum of squares of the parts' distances of ln(leakage); 0 of a sealed step.
        """
        low = np.abs(self.leakage) * np.exp(-self._distance("lower"))
        return np.where(np.isnan(self.leakage), np.nan, np.where(self.leakage == 0, 0.0, low))

    @property
    def upper(self) -> Array:
        """Upper end of the band (steps,) [m²/s], see `lower`; of a sealed step the largest of the parts' upper ends."""
        highest = np.max([np.abs(part.upper) for part in self.parts], axis=0, initial=0.0)
        with np.errstate(invalid="ignore", over="ignore"):
            high = np.abs(self.leakage) * np.exp(self._distance("upper"))
        return np.where(np.isnan(self.leakage), np.nan, np.where(self.leakage == 0, highest, high))

    def half_width(self, step: int | None = None) -> Array | float:
        """Larger distance of ln(leakage) to an end of the band: at every step (steps,), or at one.

        It is inf where the band has an end at 0 and the leakage is not 0, or the reverse.
        """
        widths = _width(np.abs(self.leakage), self.lower, self.upper)
        return widths if step is None else float(widths[step])

    def widths(self) -> dict[str, Array]:
        """Half-width of every part at every step (steps,), by its name, see `half_width`."""
        q = np.abs(self.leakage)
        return {part.name: _width(q, np.abs(part.lower), np.abs(part.upper)) for part in self.parts}

    def limiting(self, step: int | None = None) -> str:
        """Name of the widest part at a step; unless given, over all steps that leak more than 1e-3 of the first.

        "" without parts.
        """
        widths = self.widths()
        if not widths:
            return ""
        if step is None:
            q = np.abs(self.leakage)
            chosen = np.flatnonzero(q > FLOOR * q[0])
            chosen = chosen if chosen.size else np.arange(q.size)
        else:
            chosen = np.array([step])
        # an unknown part is wider than any other
        largest = {name: float(np.max(np.nan_to_num(w[chosen], nan=np.inf))) for name, w in widths.items()}
        return max(largest, key=lambda name: largest[name])

    def _distance(self, end: str) -> Array:
        """Root of the sum of squares of the parts' distances of ln(leakage) to an end (steps,)."""
        total = np.zeros(np.shape(self.leakage))
        for part in self.parts:
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = np.abs(getattr(part, end)) / np.abs(self.leakage)
                total += np.where(self.leakage == 0, 0.0, np.log(ratio) ** 2)
        return np.sqrt(total)


def _width(leakage: Array, lower: Array, upper: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.maximum(np.log(leakage / lower), np.log(upper / leakage))
    sealed = np.where(np.isnan(upper), np.nan, np.where(upper > 0, np.inf, 0.0))
    return np.where(np.isnan(leakage), np.nan, np.where(leakage == 0, sealed, width))
