"""Response of one window along a load programme: its contact with plastic deformation, and its permeability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..contact import HalfSpace, solve_contact
from ..flow import DarcyFlow, Permeability, cell_permeability
from ..flow.cell import cell_flow
from ..flow.discretisation import check_discretisation
from ..flow.law import cubic_law
from ..flow.pressure_drop import VISCOUS, PressureDrop
from ..loads import LoadProgramme
from .outcome import Failed, SolveCounts, SolverCounts, attempt
from .window_fields import ContactValues

Array = NDArray[np.float64]
#: Below this ratio of rms gap variation to mean gap parallel plates are exact to 2e-4 whatever the lay.
OPEN_RATIO = 0.005


@dataclass(frozen=True, eq=False)
class ContactHistory:
    """Contact of one window at every step of a programme; a step that failed is NaN, and `failures` says why.

    gap : deformed gap (steps, n1, n2) [m]; without contact it may be negative until `separate`.
    contact : contact pressure at every step, kept where there is contact.
    contact_fraction, plastic_fraction : shares of the pixels in contact and at the hardness (steps,).
    standoff : distance by which the asperities separate the body from the face (steps,) [m]; NaN without pressure.
    """

    gap: NDArray[np.float32]
    contact: tuple[ContactValues, ...]
    contact_fraction: Array
    plastic_fraction: Array
    standoff: Array
    failures: tuple[str, ...] = ()

    @property
    def pressure(self) -> NDArray[np.float32]:
        """Contact pressure (steps, n1, n2) [Pa]."""
        return np.stack([values.dense() for values in self.contact])

    @property
    def mean_gap(self) -> Array:
        """Mean gap at every step [m]."""
        return self.gap.mean(axis=(1, 2), dtype=float)


def contact_history(
    gap0: Array,
    pressures: Sequence[float] | Array,
    steps: LoadProgramme,
    half_space: HalfSpace,
    *,
    hardness: float,
    rigid_at_zero: bool,
    rtol: float = 1e-6,
) -> ContactHistory:
    """Solve the contact of a window at every step of a load programme.

    Parameters
    ----------
    gap0 : undeformed gap (n1, n2) [m], or one for each step (steps, n1, n2) if a global contact shapes it.
    pressures : mean pressure of the window at each step [Pa].
    steps : the programme; an unloading step starts from the plastic deformation of its peak.
    half_space : elastic body and boundary kinds of the window.
    hardness : H [Pa].
    rigid_at_zero : treatment of a window without pressure. True: it keeps the given gap, which may be negative until
        `separate`. False: it is brought to first touch.
    """
    shape, n = half_space.shape, len(steps)
    gap = np.full((n, *shape), np.nan, np.float32)
    contact_fraction, plastic_fraction, standoff = np.full(n, np.nan), np.full(n, np.nan), np.full(n, np.nan)
    unknown, apart = (ContactValues.constant(shape, value) for value in (np.nan, 0.0))
    in_contact = [unknown] * n
    left: dict[float, Array] = {}
    failures = []
    # solved steps from which nothing is left of an earlier load
    before: list[int] = []
    for s, step in enumerate(steps):
        undeformed = gap0[s] if gap0.ndim == 3 else gap0
        deformation = None if step.unloaded_from is None else left.get(step.unloaded_from)
        if step.unloaded_from is not None and deformation is None:
            failures.append(f"{step.name}: the peak of this unloading failed")
            continue
        if pressures[s] <= 0 and rigid_at_zero:
            gap[s] = undeformed if deformation is None else undeformed + deformation
            in_contact[s] = apart
            contact_fraction[s] = plastic_fraction[s] = 0.0
            if step.unloaded_from is None:
                left[step.pressure] = np.zeros(shape)
            continue
        if deformation is None or not deformation.any():
            t = next((t for t in before if steps[t].pressure == step.pressure and pressures[t] == pressures[s]), s)
            if t < s and (gap0.ndim == 2 or np.array_equal(gap0[t], gap0[s])):
                for values in (gap, contact_fraction, plastic_fraction, standoff):
                    values[s] = values[t]
                in_contact[s] = in_contact[t]
                continue
        pressure = min(pressures[s], hardness)
        contact = attempt(
            solve_contact,
            undeformed,
            half_space,
            pressure=pressure,
            hardness=hardness,
            deformation=deformation,
            rtol=rtol,
        )
        if isinstance(contact, Failed):
            failures.append(f"{step.name}: {contact.reason}")
            continue
        gap[s] = contact.gap
        in_contact[s] = ContactValues.of(contact.pressure)
        contact_fraction[s], plastic_fraction[s] = contact.area_fraction, contact.plastic_fraction
        standoff[s] = -contact.approach
        if deformation is None or not deformation.any():
            before.append(s)
        if step.unloaded_from is None:
            left[step.pressure] = contact.plastic_deformation
    return ContactHistory(gap, tuple(in_contact), contact_fraction, plastic_fraction, standoff, tuple(failures))


def body_standoff(standoff: Array, load: Array, lowest: Array) -> Array:
    """Distance by which the asperities of the loaded windows separate the whole body from the face (steps,) [m].

    It is the mean over the windows, weighted with their pressure; if no window has pressure, it is the distance that
    brings the body to first touch. The global contact of the smoothed face does not see the asperities: where nothing
    touches, its gap is too narrow by this distance.

    Parameters
    ----------
    standoff : `ContactHistory.standoff` of each window (steps, rows, columns) [m], NaN where unknown.
    load : mean pressure of each window (steps, rows, columns) [Pa].
    lowest : lowest gap of each window (steps, rows, columns) [m], NaN where unknown.
    """
    windows = (1, 2)
    loaded = np.isfinite(standoff)
    weight = np.where(loaded, load, 0.0)
    held = np.where(loaded, standoff, 0.0)
    touch = -np.nanmin(np.where(np.isfinite(lowest), lowest, np.inf), axis=windows)
    any_loaded = loaded.any(axis=windows)
    mean = np.divide(
        (weight * held).sum(axis=windows), weight.sum(axis=windows), out=np.zeros(len(touch)), where=any_loaded
    )
    return np.where(any_loaded, mean, np.where(np.isfinite(touch), touch, 0.0))


def separate(gap: NDArray[np.float32], standoff: float) -> NDArray[np.float32]:
    """Separate a window without pressure (n1, n2) by the standoff of the body; pixels that would overlap touch."""
    rounding = 4 * np.finfo(np.float32).eps * max(float(np.abs(gap).max()), abs(standoff))
    moved = gap + np.float32(standoff)
    moved[moved <= rounding] = 0.0
    return moved


@dataclass(frozen=True, eq=False)
class FlowHistory:
    """Permeability of one window at the pressures of a drop and at every step (pressures, steps) [m³].

    NaN where there is no gap or the flow failed.
    """

    at_pressures: Array
    counts: SolveCounts
    failures: tuple[str, ...] = ()

    @property
    def permeability(self) -> Array:
        """At the first pressure (steps,) [m³]."""
        return self.at_pressures[0]


@dataclass(frozen=True)
class FlowSettings:
    """How the flow through windows is discretised and solved, see `cell_permeability`, and of what fluid.

    Raises
    ------
    InputError : an unknown solver or discretisation, or two that do not go together.
    """

    solver: str = "auto"
    discretisation: str = "edge"
    drop: PressureDrop = VISCOUS

    def __post_init__(self) -> None:
        check_discretisation(self.discretisation, self.solver)


def flow_history(
    gaps: NDArray[np.floating], spacing: tuple[float, float], axis: int, settings: FlowSettings | None = None
) -> FlowHistory:
    """Permeability along `axis` of a window with closed sides at every step, from its gaps (steps, n1, n2) [m]."""
    settings = settings or FlowSettings()
    k = np.full((settings.drop.pressures.size, len(gaps)), np.nan)
    counts, failures = [], []
    known: dict[bytes, Array] = {}
    for s in np.flatnonzero(np.isfinite(gaps).all(axis=(1, 2))):
        bits = gaps[s].tobytes()
        if bits in known:
            k[:, s] = known[bits]
            counts.append(SolveCounts(equal=1))
            continue
        flow = attempt(window_permeability, np.asarray(gaps[s], float), spacing, axis, settings=settings)
        if isinstance(flow, Failed):
            failures.append(f"step {s}: {flow.reason}")
            continue
        k[:, s] = known[bits] = flow.k
        counts.append(flow.counts)
    return FlowHistory(k, SolveCounts.total(counts), tuple(failures))


@dataclass(frozen=True, eq=False)
class WindowPermeability:
    """Permeability of a window at one step.

    k : the value, or with bounds the value, its lower and its upper bound [m³], each at every pressure of the drop.
    counts : this one flow, counted as solved, closed or open.
    """

    k: Array
    counts: SolveCounts


def window_permeability(
    gap: Array,
    spacing: tuple[float, float],
    axis: int,
    *,
    bounds: bool = False,
    settings: FlowSettings | None = None,
) -> WindowPermeability:
    """Permeability along `axis` of a window (n1, n2) [m] with closed sides.

    Nearly parallel plates have that of their mean gap. `bounds` adds a lower and an upper bound for a gap constant on
    each pixel; for nearly parallel plates they are the harmonic and the arithmetic mean over the pixels.

    Raises
    ------
    NotConverged : the linear solver failed.
    """
    settings = settings or FlowSettings()
    found = []
    for p in settings.drop.pressures:
        found.append(_of_gap(settings.drop.law.equivalent_gap(gap, p), spacing, axis, bounds, settings))
        if not found[0].k.any():  # closed at every pressure
            found *= settings.drop.pressures.size
            break
    # one flow, however many systems were solved for it
    counts = replace(found[0].counts, solvers=SolverCounts.total(one.counts.solvers for one in found))
    return WindowPermeability(np.array([one.k for one in found]).T.ravel(), counts)


def _of_gap(
    gap: Array, spacing: tuple[float, float], axis: int, bounds: bool, settings: FlowSettings
) -> WindowPermeability:
    mean = _between_plates(gap, OPEN_RATIO)
    if mean > 0:
        means = []
        if bounds:
            k = cubic_law(gap)
            means = [1 / float(np.mean(1 / k)), float(np.mean(k))]
        return WindowPermeability(np.array([cubic_law(mean), *means]), SolveCounts(open=1))
    by = settings.discretisation, settings.solver
    if bounds:
        result = cell_permeability(gap, spacing, axis=axis, bounds=True, discretisation=by[0], solver=by[1])
        return _counted(np.array([result.value, result.lower, result.upper]), result)
    cell = cell_flow(gap, spacing, axis=axis, sides="mirror", discretisation=by[0], solver=by[1])
    return _counted(np.array([cell.permeability]), cell.flow)


def _counted(k: Array, flow: Permeability | DarcyFlow) -> WindowPermeability:
    solvers = SolverCounts.of(flow)
    return WindowPermeability(
        k, SolveCounts(solved=1, solvers=solvers) if flow.percolates else SolveCounts(closed=1, solvers=solvers)
    )


@njit(cache=True, nogil=True)
def _between_plates(gap, ratio):
    """Mean of a gap that is open everywhere and whose standard deviation is below this ratio of it, 0 of any other."""
    n1, n2 = gap.shape
    mean = 0.0
    for i in range(n1):
        of_row = 0.0
        for j in range(n2):
            if not gap[i, j] > 0.0:
                return 0.0
            of_row += gap[i, j]
        mean += of_row / (n1 * n2)
    square = 0.0
    for i in range(n1):
        of_row = 0.0
        for j in range(n2):
            of_row += (gap[i, j] - mean) ** 2
        square += of_row
    return mean if np.sqrt(square / (n1 * n2)) < ratio * mean else 0.0
