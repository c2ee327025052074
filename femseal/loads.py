"""Load programmes: the nominal pressures at which a seal is solved, on loading and on unloading from peaks.

Loads may also be forces on the seal, which its size turns into nominal pressures. Leakage over the load: its slope, and
what counts of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .base import Array, Flags, Indices, InputError, validate

#: Units of loads: a nominal pressure, a force on the whole seal, a force on its length.
LOAD_UNITS = ("Pa", "N", "N/m")
#: Loads at which the reference leaks less than this fraction of its first leakage are not compared.
FLOOR = 1e-3


@dataclass(frozen=True)
class LoadStep:
    """One step of a load programme: nominal pressure [Pa] on loading, or on unloading from a peak."""

    pressure: float
    unloaded_from: float | None = None

    @property
    def branch(self) -> str:
        """ "loading" or "unloading"."""
        return "loading" if self.unloaded_from is None else "unloading"

    @property
    def name(self) -> str:
        """Readable name, such as "unloading 200 MPa from 900 MPa"."""
        end = "" if self.unloaded_from is None else f" from {self.unloaded_from / 1e6:g} MPa"
        return f"{self.branch} {self.pressure / 1e6:g} MPa{end}"


class LoadProgramme(tuple[LoadStep, ...]):
    """Load steps in the order in which they are solved: all of the loading, then each unloading from its peak.

    A tuple of steps, which cannot be changed. `LoadProgramme.of` makes one from lists of pressures, and checks them.

    >>> programme = LoadProgramme.of([1e8, 3e8], unload_from=[2e8], unloading=[1e8])
    >>> [step.name for step in programme]
    ['loading 100 MPa', 'loading 200 MPa', 'loading 300 MPa', 'unloading 100 MPa from 200 MPa']
    >>> programme.peak_indices.tolist(), programme.on_loading.tolist()
    ([0, 1, 2, 1], [True, True, True, False])
    """

    __slots__ = ()

    @classmethod
    def of(
        cls,
        loading: Sequence[float],
        unload_from: Sequence[float] = (),
        unloading: Sequence[float] = (),
    ) -> LoadProgramme:
        """The loading curve with every peak on it, then from each peak the stops below it in falling order.

        loading : rising nominal pressures >= 0 [Pa].
        unload_from : pressures from which the seal is unloaded [Pa]; those not in `loading` are added to it.
        unloading : nominal pressures to stop at on the way down [Pa]; each peak uses those below it.

        Raises InputError: an empty or falling list, negative or non-finite pressures, a peak with nothing below it.
        """
        loading = _pressures("loading", loading)
        unload_from = _pressures("unload_from", unload_from)
        unloading = _pressures("unloading", unloading)
        if not loading:
            raise InputError("loading", "an empty list", "at least one pressure [Pa]")
        if any(b <= a for a, b in pairwise(loading)):
            raise InputError("loading", loading, "rising pressures")
        if unloading and not unload_from:
            allowed = "at least one pressure where `unloading` is given"
            raise InputError("unload_from", "an empty list", allowed)
        steps = [LoadStep(p) for p in sorted({*loading, *unload_from})]
        for peak in sorted(set(unload_from)):
            below = sorted({p for p in unloading if p < peak}, reverse=True)
            if not below:
                allowed = f"at least one pressure below the peak, {peak:g}"
                raise InputError("unloading", unloading, allowed)
            steps += [LoadStep(p, peak) for p in below]
        return cls(steps)

    @property
    def pressures(self) -> Array:
        """Nominal pressure of every step (steps,) [Pa]."""
        return np.array([s.pressure for s in self], dtype=float)

    @property
    def loading(self) -> tuple[float, ...]:
        """Pressures of the loading steps, the peaks among them [Pa]."""
        return tuple(s.pressure for s in self if s.unloaded_from is None)

    @property
    def unload_from(self) -> tuple[float, ...]:
        """Peaks, rising [Pa]."""
        return tuple(sorted({s.unloaded_from for s in self if s.unloaded_from is not None}))

    @property
    def unloading(self) -> tuple[float, ...]:
        """Pressures at which any unloading stops, falling [Pa]."""
        stops = {s.pressure for s in self if s.unloaded_from is not None}
        return tuple(sorted(stops, reverse=True))

    @property
    def on_loading(self) -> Flags:
        """True at the loading steps (steps,)."""
        return np.array([s.unloaded_from is None for s in self], dtype=bool)

    @property
    def peak_indices(self) -> Indices:
        """Index of the loading step from which each step is unloaded (steps,); on loading its own."""
        peaks = (s.pressure if s.unloaded_from is None else s.unloaded_from for s in self)
        return np.array([self.loading.index(peak) for peak in peaks], dtype=np.int64)

    @property
    def branches(self) -> list[Indices]:
        """Indices of the loading steps, then of those on the way down from each peak."""
        peaks = self.peak_indices
        down = [np.flatnonzero((peaks == n) & ~self.on_loading) for n in np.unique(peaks)]
        return [np.flatnonzero(self.on_loading), *(own for own in down if own.size)]


def nominal_pressure(load: float, unit: str, *, area: float, length: float) -> float:
    """Nominal pressure [Pa] of a load in one of `LOAD_UNITS` on a seal of an area [m²] and a length [m].

    Raises InputError: another unit.

    >>> nominal_pressure(10e3, "N", area=1e-4, length=0.1), nominal_pressure(200e3, "N/m", area=1e-4, length=0.1)
    (100000000.0, 200000000.0)
    """
    if unit not in LOAD_UNITS:
        raise InputError("unit", unit, f"one of {', '.join(LOAD_UNITS)}")
    pressure = {"Pa": load, "N": load / area, "N/m": load * (length / area)}[unit]
    return float(f"{pressure:.12g}")  # the same as other loads of the same pressure


def relaxed(pressure: float, relaxation: float) -> float:
    """Service pressure [Pa] of a pressure in assembly [Pa], of which relaxation at constant set-down takes a fraction.

    >>> relaxed(300e6, 0.1)
    270000000.0
    """
    return float(f"{(1 - relaxation) * pressure:.12g}")  # the same as a load that is given


def load_sensitivity(steps: LoadProgramme, leakage: Array) -> Array:
    """|d ln(leakage) / d ln(load)| at every step (steps,), the steeper of both sides on the branch; 0 where unknown."""
    q, p = np.abs(np.asarray(leakage, float)), steps.pressures
    found = np.zeros(len(steps))
    for s, other in neighbouring_steps(steps):
        if all(value > 0 for value in (q[s], q[other], p[s], p[other])):
            slope = abs(np.log(q[s] / q[other]) / np.log(p[s] / p[other]))
            found[[s, other]] = np.maximum(found[[s, other]], slope)
    return found


def neighbouring_steps(steps: LoadProgramme) -> list[tuple[int, int]]:
    """Every step with the one before it on its branch, that of an unloading being its peak."""
    ways = [np.union1d(own, steps.peak_indices[own]).tolist() for own in steps.branches]
    return [(s, before) for way in ways for before, s in pairwise(way)]


def first_known(leakage: Array) -> int:
    """Number of the first load at which a leakage (steps,) is known, 0 without one; the fluid may carry others."""
    return int(np.argmax(np.isfinite(leakage)))


def least_counted(leakage: Array) -> float:
    """Size of a leakage (steps,) below which a load does not count: 1e-3 of the first known one, NaN without one."""
    return float(FLOOR * np.abs(leakage[first_known(leakage)]))


def _pressures(name: str, values: Sequence[float]) -> list[float]:
    try:
        return [validate.number(name, p, unit="Pa", inclusive=True) for p in values]
    except (TypeError, InputError):
        given = values if isinstance(values, str) or not np.iterable(values) else list(values)
        raise InputError(name, given, "a list of finite pressures >= 0 [Pa]") from None
