"""Pressures that a seal needs: in assembly for a leakage class, in service to keep it, and to seal at all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, isinf

import numpy as np

from ..base.arrays import Array, Indices
from ..base.quantities import to_text
from ..base.text import Shown
from .seals import Seals, pressure_for

#: Ends of the interval of an uncertainty, and of the band between seals.
ENDS = (0.05, 0.95)


@dataclass(frozen=True, repr=False)
class NeededPressure(Shown):
    """A nominal pressure that is enough for a fraction of the seals.

    value : [Pa]; inf where the loads of the run are not enough, 0 where the lowest of them is. low, high : interval in
    which it lies with 90 %, by seals drawn again from other libraries; NaN for a single seal. seals_low, seals_high :
    what 5 % and 95 % of the seals need. lowest, highest : loads between which it is known.
    """

    value: float = field(metadata={"unit": "Pa", "long_name": "pressure needed"})
    low: float = field(metadata={"unit": "Pa", "long_name": "lower end of its uncertainty"})
    high: float = field(metadata={"unit": "Pa", "long_name": "upper end of its uncertainty"})
    seals_low: float = field(metadata={"unit": "Pa", "long_name": "what 5 % of the seals need"})
    seals_high: float = field(metadata={"unit": "Pa", "long_name": "what 95 % of the seals need"})
    lowest: float = field(metadata={"unit": "Pa", "long_name": "lowest load"})
    highest: float = field(metadata={"unit": "Pa", "long_name": "highest load"})

    @property
    def known(self) -> bool:
        """Whether the value lies within the loads."""
        return 0 < self.value < inf

    @property
    def relation(self) -> str:
        """ "=", or "<=" or ">" where only a bound is known."""
        return "=" if self.known else ">" if isinf(self.value) else "<="

    def bound(self, value: float) -> float:
        """A pressure, or the load that bounds it."""
        return self.highest if isinf(value) else self.lowest if value == 0 else value

    def text(self, with_interval: bool = True) -> str:
        """The value as text, with its uncertainty."""
        value = self._text(self.value, "above ", "at most ")
        if not with_interval or np.isnan(self.low) or not self.known:
            return value
        return f"{value} ({self._text(self.low, '>', '<')} to {self._text(self.high, '>', '<')})"

    def band_text(self) -> str:
        """What 5 % and 95 % of the seals need, as text."""
        ends = [self._text(value, "above ", "at most ") for value in (self.seals_low, self.seals_high)]
        return ends[0] if ends[0] == ends[1] else " to ".join(ends)

    def _text(self, value: float, above: str, below: str) -> str:
        before = above if isinf(value) else below if value == 0 else ""
        return before + to_text(self.bound(value), "Pa", 3)


@dataclass(frozen=True)
class Requirement:
    """What a class of leakage needs.

    name : of the class. limit : its largest leakage per length [m²/s]. assembly : Qmin, the pressure in assembly that
    reaches it. service : QSmin by the pressure in assembly Q_A [Pa]: that to which it may fall after. relaxed : the
    pressure in assembly that still meets it after relaxation; None without.
    """

    name: str
    limit: float
    assembly: NeededPressure
    service: dict[float, NeededPressure]
    relaxed: NeededPressure | None = None


def requirement(seals: Seals, name: str, limit: float, fraction: float, relaxation: float = 0.0) -> Requirement:
    """What a limit of leakage per length [m²/s] needs with a fraction of the seals, whose loads relax by a fraction."""

    def service(peak: float) -> NeededPressure:
        return _needed(seals, lambda some: some.needed_on_unloading(limit, peak), seals.unloading(peak), fraction)

    assembly = _needed(seals, lambda some: some.needed_on_loading(limit), seals.loading(), fraction)
    after = None
    if relaxation and seals.steps.unload_from:
        after = _needed(seals, lambda some: some.needed_with_relaxation(limit, relaxation), seals.peaks(), fraction)
    return Requirement(name, limit, assembly, {peak: service(peak) for peak in seals.steps.unload_from}, after)


def sealing_load(seals: Seals, fraction: float) -> NeededPressure:
    """Pressure in assembly from which on nothing leaks, with a fraction of the seals."""
    return _needed(seals, lambda some: some.needed_on_loading(0.0), seals.loading(), fraction)


def _needed(seals: Seals, of: Callable[[Seals], Array], steps: Indices, fraction: float) -> NeededPressure:
    """The pressure that a fraction of the seals needs, with its interval over seals that are drawn again."""
    each = of(seals)
    again = [pressure_for(of(some), fraction) for _, some in seals.drawn_again()]
    low, high = (pressure_for(np.array(again), end) if again else np.nan for end in ENDS)
    pressure = seals.steps.pressures[steps]
    return NeededPressure(
        value=pressure_for(each, fraction),
        low=low,
        high=high,
        seals_low=pressure_for(each, ENDS[0]),
        seals_high=pressure_for(each, ENDS[1]),
        lowest=float(pressure.min()),
        highest=float(pressure.max()),
    )
