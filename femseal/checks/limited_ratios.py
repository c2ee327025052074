"""Warn if a limit on a leakage ratio determines the median leakage of stochastic seals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..base import Array, Flags, counted
from ..face.cells import correction_factors
from ..loads import LoadProgramme, least_counted

#: A ratio also counts as limited if it differs from its limit by at most this relative difference.
_SLACK = 1e-6


def limited_median_warnings(
    steps: LoadProgramme, median: Array, surface_leakage: Array, largest: float
) -> Iterator[str]:
    """Warn about seals with cells in order whose median is limited to a multiple of the leakage of the surface.

    Parameters
    ----------
    steps : LoadProgramme
        The load steps.
    median : array (steps,)
        Median leakage of the realisations [m²/s].
    surface_leakage : array (steps,)
        Leakage of the surface from which the cells were cut [m²/s].
    largest : float
        Largest ratio of the two leakages; the smallest one is 1/`largest`.
    """
    ratio = _ratio(median, surface_leakage)
    is_limited = _is_limited(ratio, largest)
    reason = (
        f"there, the realisations leak more than {largest:g} times, or less than 1/{largest:g} times as much as the "
        "surface itself, and their leakage is set to this limit"
    )
    yield from _warn(steps, median, is_limited, reason)


def limited_factor_warnings(
    steps: LoadProgramme,
    median: Array,
    states: LoadProgramme,
    surface_leakage: Array,
    cells_leakage: Array,
    largest: float,
    contact_pressures: Array,
) -> Iterator[str]:
    """Warn about seals with cells at random whose correction factor is limited.

    Parameters
    ----------
    steps : LoadProgramme
        The load steps of the seal.
    median : array (steps,)
        Median leakage of the realisations [m²/s].
    states : LoadProgramme
        Loads of the contact states, at which the correction factors are known: either the load steps of the seal, or
        tabulated contact pressures. With tabulated pressures, each load step on loading is assigned the state on
        loading whose pressure is nearest; load steps on unloading are not checked.
    surface_leakage, cells_leakage : arrays (states,)
        Leakage of the surface, and of its grid of cells [m²/s].
    largest : float
        Largest correction factor; the smallest one is 1/`largest`.
    contact_pressures : array (steps,)
        Contact pressure of each load step [Pa], to find the nearest tabulated pressure. It is lower than the nominal
        pressure if fluid pressure acts on the surfaces.
    """
    is_limited = _is_limited(
        correction_factors(surface_leakage, cells_leakage, states, largest), largest
    )
    if states != steps:
        loading = np.flatnonzero(states.on_loading)
        distance = np.abs(contact_pressures[:, None] - states.pressures[loading])
        nearest = loading[distance.argmin(axis=1)]  # (steps,)
        is_limited = is_limited[nearest] & steps.on_loading
    reason = (
        f"there, the cells in their original order leak less than 1/{largest:g} times, or more than {largest:g} times "
        "as much as the surface itself, and the correction of their permeability is set to this limit"
    )
    yield from _warn(steps, median, is_limited, reason)


def _ratio(numerator: Array, denominator: Array) -> Array:
    """Divide the magnitudes of two leakages; the ratio is NaN if one of them is 0 or unknown."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(numerator / denominator)
    return np.where((ratio > 0) & np.isfinite(ratio), ratio, np.nan)


def _is_limited(ratio: Array, largest: float) -> Flags:
    """Return where a ratio reaches or passes its upper or lower limit; False where it is NaN."""
    is_limited: Flags = np.abs(np.log(ratio)) >= np.log(largest) * (1 - _SLACK)
    return is_limited


def _warn(steps: LoadProgramme, median: Array, is_limited: Flags, reason: str) -> Iterator[str]:
    """Yield a warning that names the first load at which a limit determines the median.

    Loads whose leakage is too small for comparisons are left out.
    """
    is_counted = np.abs(median) >= least_counted(median)
    limited_steps = np.flatnonzero(is_limited & is_counted)
    if not limited_steps.size:
        return
    loads = steps[int(limited_steps[0])].name
    if limited_steps.size > 1:
        loads += f" and {counted(limited_steps.size - 1, 'more load')}"
    yield (
        f"The median leakage is only a limit at {loads}: {reason}. Single constrictions decide such loads: judge "
        "them by the upper end of the interval, or generate or measure a larger surface"
    )
