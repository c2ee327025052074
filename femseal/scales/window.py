"""Response of one window along a load programme: contact with plastic deformation, then permeability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.errors import FemsealError
from ..contact import HalfSpace, solve_deformed_contact
from ..flow import cell_permeability
from ..flow.coefficient import cubic_law
from ..loads import LoadProgramme

Array = NDArray[np.float64]
#: Below this ratio of rms gap variation to mean gap parallel plates are exact to 2e-4 whatever the lay.
OPEN_RATIO = 0.005


@dataclass(frozen=True)
class WindowHistory:
    """One window at every step of a programme; a step that failed is NaN and says why.

    gap_minus_pressure : both fields in one, see `contact.complement`; without contact the gap alone, which may be
        negative until `set_down`.
    standoff : distance that asperities add [m]; NaN without pressure.
    """

    gap_minus_pressure: NDArray[np.float32]
    contact_fraction: Array
    plastic_fraction: Array
    standoff: Array
    failures: tuple[str, ...] = ()

    @property
    def gap(self) -> NDArray[np.float32]:
        """Deformed gap (steps, n1, n2) [m]."""
        lowest = np.where(self.contact_fraction > 0, 0, -np.inf).astype(np.float32)
        return np.maximum(self.gap_minus_pressure, lowest[:, None, None])

    @property
    def pressure(self) -> NDArray[np.float32]:
        """Contact pressure (steps, n1, n2) [Pa]."""
        return self.gap - self.gap_minus_pressure

    @property
    def mean_gap(self) -> Array:
        """Mean gap at every step [m]."""
        return self.gap.mean(axis=(1, 2), dtype=float)


def respond(
    gap0: Array,
    pressures: Sequence[float] | Array,
    steps: LoadProgramme,
    half_space: HalfSpace,
    *,
    hardness: float,
    rigid_at_zero: bool,
    rtol: float = 1e-6,
) -> WindowHistory:
    """Contact of a window at every step.

    Parameters
    ----------
    gap0 : undeformed gap (n1, n2) [m], or one for each step (steps, n1, n2) where a coarser solution shapes it.
    pressures : mean pressure of the window at each step [Pa].
    steps : the programme; an unloading step takes the permanent deformation of its peak's loading step.
    half_space : elastic body and boundary kinds of the window.
    hardness : H [Pa].
    rigid_at_zero : without pressure the window keeps the gap given, which may be negative until `set_down` (True), or
        is brought to first touch (False).
    """
    shape = half_space.shape
    n = len(steps)
    fields = np.full((n, *shape), np.nan, np.float32)
    contact_fraction, plastic_fraction, standoff = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    left: dict[float, Array] = {}
    failures = []
    for s, step in enumerate(steps):
        undeformed = gap0[s] if gap0.ndim == 3 else gap0
        deformation = None if step.unloaded_from is None else left.get(step.unloaded_from)
        if step.unloaded_from is not None and deformation is None:
            failures.append(f"{step.name}: the peak of this unloading failed")
            continue
        if pressures[s] <= 0 and rigid_at_zero:
            fields[s] = undeformed if deformation is None else undeformed + deformation
            contact_fraction[s] = plastic_fraction[s] = 0.0
            if step.unloaded_from is None:
                left[step.pressure] = np.zeros(shape)
            continue
        try:
            pressure = min(pressures[s], hardness)
            contact = solve_deformed_contact(
                undeformed, half_space, deformation, pressure=pressure, hardness=hardness, rtol=rtol
            )
        except FemsealError as error:
            failures.append(f"{step.name}: {error}")
            continue
        fields[s] = contact.gap - contact.pressure
        contact_fraction[s], plastic_fraction[s] = contact.area_fraction, contact.plastic_fraction
        standoff[s] = -contact.approach
        if step.unloaded_from is None:
            left[step.pressure] = contact.plastic_deformation
    return WindowHistory(fields, contact_fraction, plastic_fraction, standoff, tuple(failures))


def body_standoff(standoff: Array, load: Array, lowest: Array) -> Array:
    """How far the asperities of the loaded windows hold the whole body off at every step (steps,) [m].

    The mean over the windows, weighted with their pressure; without any pressure, what brings the body to first touch.
    A global contact of smooth faces does not know of the asperities on them: where nothing touches, its gap is too
    narrow by as much.

    Parameters
    ----------
    standoff, load, lowest : of each window at each step (windows, steps) its `WindowHistory.standoff` [m], mean
        pressure [Pa] and lowest gap [m], NaN where unknown.
    """
    loaded = np.isfinite(standoff)
    weight = np.where(loaded, load, 0.0)
    held = np.where(loaded, standoff, 0.0)
    touch = -np.nanmin(np.where(np.isfinite(lowest), lowest, np.inf), axis=0)
    mean = np.divide(
        (weight * held).sum(axis=0), weight.sum(axis=0), out=np.zeros(len(touch)), where=loaded.any(axis=0)
    )
    return np.where(loaded.any(axis=0), mean, np.where(np.isfinite(touch), touch, 0.0))


def set_down(gap: NDArray[np.float32], standoff: float) -> NDArray[np.float32]:
    """A window without pressure (n1, n2) at the distance that the body has; what would overlap touches."""
    rounding = 4 * np.finfo(np.float32).eps * max(float(np.abs(gap).max()), abs(standoff))
    moved = gap + np.float32(standoff)
    moved[moved <= rounding] = 0.0
    return moved


@dataclass(frozen=True)
class FlowHistory:
    """Permeability of one window at every step (NaN where there is no gap), and how many were solved or skipped."""

    permeability: Array
    solved: int
    closed: int
    open: int
    failures: tuple[str, ...] = ()


def flow_history(gaps: NDArray[np.floating], spacing: tuple[float, float], axis: int) -> FlowHistory:
    """Permeability along `axis` of a window's gaps (steps, n1, n2), sides closed; closed or wide-open ones unsolved."""
    k = np.full(len(gaps), np.nan)
    counts = {"solved": 0, "closed": 0, "open": 0}
    failures = []
    for s, gap in enumerate(gaps):
        h = np.asarray(gap, dtype=float)
        if not np.all(np.isfinite(h)):
            continue
        try:
            (k[s],), kind = window_permeability(h, spacing, axis)
        except FemsealError as error:
            failures.append(f"step {s}: {error}")
            continue
        counts[kind] += 1
    return FlowHistory(k, **counts, failures=tuple(failures))


def window_permeability(
    gap: Array, spacing: tuple[float, float], axis: int, *, bounds: bool = False
) -> tuple[Array, str]:
    """k along `axis` of a window with closed sides [m³], and whether it was "solved", "closed" or "open" (asymptote).

    k is (1,), or with `bounds` (3,): with the lower and the upper bound for a gap constant on each pixel, which of
    plates that are nearly parallel are the harmonic and the arithmetic mean.
    """
    mean = float(gap.mean())
    if gap.min() > 0 and gap.std() < OPEN_RATIO * mean:
        k = cubic_law(gap) if bounds else np.empty(0)
        means = [1 / float(np.mean(1 / k)), float(np.mean(k))] if bounds else []
        return np.array([cubic_law(mean), *means]), "open"
    result = cell_permeability(gap, spacing, axis=axis, sides="mirror", bounds=bounds)
    k = np.array([result.value, result.lower, result.upper] if bounds else [result.value])
    return k, "solved" if result.percolates else "closed"
