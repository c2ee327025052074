"""Contact of one window along a load programme, with its plastic deformation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array
from ..contact import ContactLaw, HalfSpace, solve_contact
from ..loads import LoadProgramme
from .outcome import Failed, attempt
from .window_fields import ContactValues


@dataclass(frozen=True, eq=False)
class ContactHistory:
    """Contact of one window at every step of a programme; a step that failed is NaN, and `failures` says why.

    gap : deformed gap (steps, n1, n2) [m]; without contact it may be negative until `separate`.
    contact : contact pressure at every step, kept where there is contact.
    contact_fraction, plastic_fraction : fractions of the pixels in contact and at the hardness (steps,).
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
    law: ContactLaw,
    rigid_at_zero: bool,
    rtol: float = 1e-6,
) -> ContactHistory:
    """Solve the contact of a window at every step of a load programme.

    gap0 : undeformed gap (n1, n2) [m], or one for each step (steps, n1, n2) if a global contact shapes it.
    pressures : mean pressure of the window at each step [Pa].
    steps : the programme; an unloading step starts from the plastic deformation of its peak.
    half_space : elastic body and boundary kinds of the window.
    law : what every point of the window can carry.
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
        pressure = min(pressures[s], law.capacity)
        contact = attempt(
            solve_contact,
            undeformed,
            half_space,
            pressure=pressure,
            hardness=law,
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

    standoff : `ContactHistory.standoff` of each window (steps, rows, columns) [m], NaN where unknown.
    load : mean pressure of each window (steps, rows, columns) [Pa].
    lowest : lowest gap of each window (steps, rows, columns) [m], NaN where unknown.
    """
    windows = (1, 2)
    loaded = np.isfinite(standoff)
    weight = np.where(loaded, load, 0.0)
    known = np.where(loaded, standoff, 0.0)
    touch = -np.nanmin(np.where(np.isfinite(lowest), lowest, np.inf), axis=windows)
    any_loaded = loaded.any(axis=windows)
    mean = np.divide(
        (weight * known).sum(axis=windows), weight.sum(axis=windows), out=np.zeros(len(touch)), where=any_loaded
    )
    return np.where(any_loaded, mean, np.where(np.isfinite(touch), touch, 0.0))


def separate(gap: NDArray[np.float32], standoff: float) -> NDArray[np.float32]:
    """Separate a window without pressure (n1, n2) by the standoff of the body; pixels that would overlap touch."""
    rounding = 4 * np.finfo(np.float32).eps * max(float(np.abs(gap).max()), abs(standoff))
    moved = gap + np.float32(standoff)
    moved[moved <= rounding] = 0.0
    return moved
