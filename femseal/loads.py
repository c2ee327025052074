"""Define load programmes: the nominal pressures of a load cycle, on loading and on unloading from peak loads.

Loads can also be given as forces on the seal, which are converted to nominal pressures by the size of the seal. The
functions `load_sensitivity`, `first_known` and `least_counted` evaluate the leakage over a load cycle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .base import Array, Flags, Indices, InputError, to_text, validate

#: Units of loads: nominal pressure, force on the whole seal, force per length of seal.
LOAD_UNITS = ("Pa", "N", "N/m")
#: Name of a load in messages, by its unit.
_LOAD_NAMES = {"Pa": "pressure", "N": "force", "N/m": "line load"}
#: Leakages below this fraction of the leakage at the first load are too small for comparisons.
FLOOR = 1e-3


@dataclass(frozen=True)
class LoadStep:
    """One step of a load programme.

    Parameters
    ----------
    pressure : float
        Nominal pressure [Pa].
    unloaded_from : float, optional
        Peak pressure [Pa] from which the seal is unloaded; None if the step belongs to the loading.
    """

    pressure: float
    unloaded_from: float | None = None

    @property
    def branch(self) -> str:
        """The branch of the step, "loading" or "unloading"."""
        return "loading" if self.unloaded_from is None else "unloading"

    @property
    def name(self) -> str:
        """Readable name, such as "unloading 200 MPa from 900 MPa"."""
        name = f"{self.branch} {self.pressure / 1e6:g} MPa"
        if self.unloaded_from is not None:
            name += f" from {self.unloaded_from / 1e6:g} MPa"
        return name


class LoadProgramme(tuple[LoadStep, ...]):
    """Load steps in the order in which they are solved.

    The loading steps come first, followed by the unloading steps from each peak load. A load programme is a tuple of
    steps. `LoadProgramme.of` makes a load programme from lists of pressures, and checks the lists.

    Examples
    --------
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
        *,
        unit: str = "Pa",
    ) -> LoadProgramme:
        """Make a load programme from lists of nominal pressures.

        Parameters
        ----------
        loading : sequence of float
            Rising pressures >= 0 of the loading [Pa].
        unload_from : sequence of float
            Peak pressures from which the seal is unloaded [Pa]. Peak pressures that are missing in `loading` are added
            to the loading.
        unloading : sequence of float
            Pressures of the unloading [Pa]. From each peak, the seal is unloaded in falling order to the pressures in
            `unloading` that are below the peak.
        unit : str
            Unit of the numbers in error messages, one of `LOAD_UNITS`. With "N" or "N/m", the lists contain forces, so
            that forces can be checked before they are converted to pressures.

        Raises
        ------
        InputError
            The unit is unknown, a list is empty or not rising, a pressure is negative or not finite, or a peak has no
            pressure below it.
        """
        _check_unit(unit)
        loading = _check_loads("loading", loading, unit)
        unload_from = _check_loads("unload_from", unload_from, unit)
        unloading = _check_loads("unloading", unloading, unit)
        if not loading:
            raise InputError("loading", "an empty list", f"at least one {_LOAD_NAMES[unit]}")
        if any(b <= a for a, b in pairwise(loading)):
            expected = (
                f"rising {_LOAD_NAMES[unit]}s, the assembly; loads on the way down are `unloading`"
            )
            raise InputError("loading", _loads_text(loading, unit), expected)
        if unloading and not unload_from:
            expected = f"at least one {_LOAD_NAMES[unit]} where `unloading` is given"
            raise InputError("unload_from", "an empty list", expected)
        steps = [LoadStep(pressure) for pressure in sorted({*loading, *unload_from})]
        for peak in sorted(set(unload_from)):
            below = sorted({pressure for pressure in unloading if pressure < peak}, reverse=True)
            if not below:
                expected = f"at least one {_LOAD_NAMES[unit]} below the peak, {to_text(peak, unit)}"
                raise InputError("unloading", _loads_text(unloading, unit), expected)
            steps += [LoadStep(pressure, peak) for pressure in below]
        return cls(steps)

    @property
    def pressures(self) -> Array:
        """Nominal pressure of every step (steps,) [Pa]."""
        return np.array([s.pressure for s in self], dtype=float)

    @property
    def loading(self) -> tuple[float, ...]:
        """Pressures of all loading steps, including the peak pressures [Pa]."""
        return tuple(s.pressure for s in self if s.unloaded_from is None)

    @property
    def unload_from(self) -> tuple[float, ...]:
        """Peak pressures in rising order [Pa]."""
        return tuple(sorted({s.unloaded_from for s in self if s.unloaded_from is not None}))

    @property
    def unloading(self) -> tuple[float, ...]:
        """Pressures of all unloading steps, from any peak pressure, in falling order [Pa]."""
        stops = {s.pressure for s in self if s.unloaded_from is not None}
        return tuple(sorted(stops, reverse=True))

    @property
    def on_loading(self) -> Flags:
        """Whether each step belongs to the loading, (steps,)."""
        return np.array([s.unloaded_from is None for s in self], dtype=bool)

    @property
    def peak_indices(self) -> Indices:
        """Index of the loading step at the peak from which each step is unloaded, (steps,).

        For a loading step, the entry is the index of the step itself.
        """
        peaks = (s.pressure if s.unloaded_from is None else s.unloaded_from for s in self)
        return np.array([self.loading.index(peak) for peak in peaks], dtype=np.int64)

    @property
    def branches(self) -> list[Indices]:
        """Indices of the loading steps, followed by the indices of the unloading steps from each peak load."""
        branches = [np.flatnonzero(self.on_loading)]
        for peak in np.unique(self.peak_indices):
            unloading = np.flatnonzero((self.peak_indices == peak) & ~self.on_loading)
            if unloading.size:
                branches.append(unloading)
        return branches


def nominal_pressure(load: float, unit: str, *, area: float, length: float) -> float:
    """Convert a load on a seal to a nominal pressure.

    Parameters
    ----------
    load : float
        Load in the unit `unit`.
    unit : str
        Unit of the load, one of `LOAD_UNITS`.
    area : float
        Nominal contact area of the seal [m²].
    length : float
        Length of the seal [m].

    Returns
    -------
    float
        Nominal pressure [Pa].

    Raises
    ------
    InputError
        The unit is not one of `LOAD_UNITS`.

    Examples
    --------
    >>> nominal_pressure(10e3, "N", area=1e-4, length=0.1), nominal_pressure(200e3, "N/m", area=1e-4, length=0.1)
    (100000000.0, 200000000.0)
    """
    _check_unit(unit)
    if unit == "Pa":
        pressure = load
    elif unit == "N":
        pressure = load / area
    else:
        pressure = load * (length / area)
    return _rounded(pressure)


def relaxed(pressure: float, relaxation: float) -> float:
    """Return the nominal pressure that remains in service after relaxation.

    Parameters
    ----------
    pressure : float
        Nominal pressure in assembly [Pa].
    relaxation : float
        Fraction of the assembly pressure that is lost.

    Returns
    -------
    float
        Nominal pressure in service [Pa].

    Examples
    --------
    >>> relaxed(300e6, 0.1)
    270000000.0
    """
    return _rounded((1 - relaxation) * pressure)


def _rounded(pressure: float) -> float:
    """Round a pressure to 12 digits, so that a computed pressure can be equal to a pressure given as text."""
    return float(f"{pressure:.12g}")


def load_sensitivity(steps: LoadProgramme, leakage: Array) -> Array:
    """Estimate |d ln(leakage) / d ln(load)| at every load step.

    For each step, the slope of ln(leakage) over ln(load) is computed towards the previous step and towards the next
    step of the same branch of the load cycle. The steeper of the two slopes is the sensitivity.

    Parameters
    ----------
    steps : LoadProgramme
        Load steps.
    leakage : array, (steps,)
        Leakage at the load steps, in any unit.

    Returns
    -------
    array, (steps,)
        Sensitivity, 0 where it is unknown.
    """
    magnitude = np.abs(np.asarray(leakage, float))
    pressure = steps.pressures
    sensitivity = np.zeros(len(steps))
    for step, previous in neighbouring_steps(steps):
        values = (magnitude[step], magnitude[previous], pressure[step], pressure[previous])
        if all(value > 0 for value in values):
            leakage_change = np.log(magnitude[step] / magnitude[previous])
            load_change = np.log(pressure[step] / pressure[previous])
            slope = abs(leakage_change / load_change)
            sensitivity[step] = max(sensitivity[step], slope)
            sensitivity[previous] = max(sensitivity[previous], slope)
    return sensitivity


def neighbouring_steps(steps: LoadProgramme) -> list[tuple[int, int]]:
    """List the index of each step together with the index of the previous step in the same branch of the load cycle.

    The first step of an unloading follows the loading step at the peak load. The first loading step, which has no
    previous step, is not listed.
    """
    pairs = []
    for branch in steps.branches:
        # The peak is added to the steps of an unloading, and comes first, because its index is the lowest. For the
        # loading, nothing is added, because `peak_indices` of a loading step is the step itself.
        path = np.union1d(branch, steps.peak_indices[branch]).tolist()
        pairs += [(step, previous) for previous, step in pairwise(path)]
    return pairs


def first_known(leakage: Array) -> int:
    """Return the index of the first load step at which the leakage is known; 0 if the leakage is unknown at all steps.

    The leakage is unknown, for example, at a load step at which the fluid pressure carries the whole load.

    leakage : array (steps,), leakage at each load step, NaN if it is unknown.
    """
    return int(np.argmax(np.isfinite(leakage)))


def least_counted(leakage: Array) -> float:
    """Return the limit below which a leakage is too small for comparisons.

    The limit is `FLOOR` times the leakage at the first load step with a known leakage. If the leakage is unknown at all
    steps, the limit is NaN.

    leakage : array (steps,), leakage at each load step, in any unit.
    """
    return float(FLOOR * np.abs(leakage[first_known(leakage)]))


def _loads_text(loads: Sequence[float], unit: str) -> str:
    """Format a list of loads with their unit as text for a message; without loads, the text is "an empty list"."""
    return ", ".join(to_text(load, unit) for load in loads) or "an empty list"


def _check_unit(unit: str) -> None:
    """Raise InputError if a unit of loads is not one of `LOAD_UNITS`."""
    if unit not in LOAD_UNITS:
        raise InputError("unit", unit, f"one of {', '.join(LOAD_UNITS)}")


def _check_loads(name: str, values: Sequence[float], unit: str) -> list[float]:
    """Check that `values` is a list of finite loads >= 0 in the unit `unit`, and return it."""
    try:
        return [validate.number(name, load, inclusive=True) for load in values]
    except (TypeError, InputError):
        is_list = np.iterable(values) and not isinstance(values, str)
        given = list(values) if is_list else values
        raise InputError(
            name, given, f"a list of finite {_LOAD_NAMES[unit]}s >= 0 [{unit}]"
        ) from None
