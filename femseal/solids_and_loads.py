"""Solids that touch, ten metals of seals by their name; and load programmes: the nominal pressures that press them.

Symbols: E Young's modulus, ν Poisson's ratio, E* contact modulus, σ_y yield stress, H hardness. A seal is loaded, and
unloaded from peaks. Loads may also be forces on it, which its size turns into nominal pressures. Leakage over the load:
its slope, and what counts of it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import pairwise
from math import inf

import numpy as np

from .base import Array, Flags, Indices, InputError, shown, validate

#: H = HARDNESS_FACTOR · σ_y, full plasticity of an indentation (Johnson, Contact Mechanics, 1985, ch. 6).
HARDNESS_FACTOR = 2.8
#: Peak pressure at which the body below a line contact yields first, over H: 1.79 σ_y by von Mises, ν = 0.3, at a depth
#: of 0.7 of the half-breadth (Johnson 1985, section 6.1).
LINE_CONTACT_YIELD = 1.79 / HARDNESS_FACTOR
#: Young's moduli of metals, and of hard coatings, lie between these [Pa].
YOUNG_LIMITS = (5e9, 1.2e12)


@dataclass(frozen=True)
class Solid:
    """A linear elastic, perfectly plastic solid.

    Parameters
    ----------
    young : Young's modulus E [Pa], > 0.
    poisson : Poisson's ratio ν [-], -1 < ν <= 0.5.
    yield_stress : σ_y [Pa]; the hardness is then 2.8 σ_y.
    hardness : H [Pa], given directly; with neither of the two the solid stays elastic (H = inf).

    Raises
    ------
    InputError : a value out of its range, or both yield_stress and hardness given.

    Examples
    --------
    >>> Solid(young=210e9, poisson=0.3, yield_stress=500e6).hardness
    1400000000.0
    """

    young: float
    poisson: float
    yield_stress: float | None = None
    hardness: float | None = None

    def __post_init__(self) -> None:
        validate.number("young", self.young, unit="Pa")
        if not -1 < self.poisson <= 0.5:
            raise InputError("poisson", self.poisson, "a number in (-1, 0.5]")
        hardness = inf
        if self.yield_stress is not None:
            hardness = HARDNESS_FACTOR * validate.number(
                "yield_stress", self.yield_stress, unit="Pa"
            )
            if self.hardness not in (None, hardness):
                raise InputError("hardness", self.hardness, "yield_stress or hardness, not both")
        elif self.hardness is not None:
            hardness = self.hardness
        if not hardness > 0:
            raise InputError("hardness", hardness, "a number > 0 [Pa]")
        object.__setattr__(self, "hardness", hardness)


def contact_modulus(a: Solid, b: Solid | None = None) -> float:
    """Contact modulus E* [Pa] of two half-spaces, 1/E* = (1−ν1²)/E1 + (1−ν2²)/E2.

    `b` None is a rigid counter-body. Lubrication texts use E′ = 2E*; here it is always E*.
    Source: Johnson, Contact Mechanics, 1985, eq. 4.20.

    >>> steel = Solid(210e9, 0.3)
    >>> round(contact_modulus(steel, steel) / 1e9, 2)
    115.38
    """
    compliance = (1 - a.poisson**2) / a.young
    if b is not None:
        compliance += (1 - b.poisson**2) / b.young
    return 1 / compliance


_ELASTIC = "E, ν: Kaye & Laby, Tables of Physical and Chemical Constants"
_CALLISTER = "Callister, Materials Science and Engineering"
#: Metals of seals at 20 °C by their name, each with its source. Yield strengths are the 0.2 % proof stress of sheet or
#: bar as delivered, the least or a typical one as the source says.
METALS: dict[str, tuple[Solid, str]] = {
    "steel 304/316, annealed": (
        Solid(200e9, 0.3, 205e6),
        "E: EN 10088-1; least yield strength: ASTM A240",
    ),
    "steel 1.4571, annealed": (
        Solid(200e9, 0.3, 200e6),
        "E: EN 10088-1; least yield strength: EN 10088-3",
    ),
    "Inconel 718, aged": (
        Solid(200e9, 0.29, 1034e6),
        "Special Metals SMC-045; least yield strength: AMS 5662",
    ),
    "copper, soft": (
        Solid(117e9, 0.343, 48e6),
        "OFHC, annealed strip, typical: Smithells; ν: Kaye & Laby",
    ),
    "copper, half hard": (
        Solid(117e9, 0.343, 176e6),
        "OFHC strip, typical: Smithells; ν: Kaye & Laby",
    ),
    "aluminium 1050, soft": (
        Solid(69e9, 0.33, 20e6),
        "EN AW-1050A, temper O; least yield strength: EN 485-2",
    ),
    "aluminium 6061-T6": (Solid(69e9, 0.33, 276e6), "typical: ASM Handbook, vol. 2"),
    "nickel 200, annealed": (Solid(204e9, 0.31, 148e6), f"typical: {_CALLISTER}, appendix B"),
    "silver, annealed": (Solid(82.7e9, 0.367, 54e6), f"typical: ASM Handbook, vol. 2; {_ELASTIC}"),
    "soft iron": (
        Solid(211.4e9, 0.293, 130e6),
        f"annealed, typical: {_CALLISTER}, table 6.2; {_ELASTIC}",
    ),
}


def named_solid(name: str) -> Solid:
    """A metal of `METALS` by its name; upper and lower case are the same.

    Raises
    ------
    InputError : an unknown name; the message gives the nearest.

    Examples
    --------
    >>> named_solid("Copper, soft").yield_stress
    48000000.0
    """
    known = {key.casefold(): key for key in METALS}
    text = name.casefold().strip() if isinstance(name, str) else ""
    if text in known:
        return METALS[known[text]][0]
    parts = [part for part in (text, *re.findall(r"\d{3,}", text)) if part]
    near = [key for key in known if any(part in key for part in parts)] or get_close_matches(
        text, known, 1, 0.4
    )
    perhaps = f"; perhaps meant: {known[near[0]]!r}" if near else ""
    raise InputError("name", shown(name), f"one of {', '.join(map(repr, METALS))}{perhaps}")


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
