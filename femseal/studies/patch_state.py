"""Describe the contact state of a measured patch at every load step, which determines the width of its interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base import Array
from ..face.cell_flow import attempt
from ..face.cells import MOST_FACTOR
from ..loads import LoadProgramme
from ..scene import Scene
from .cell_states import FaceCells

#: Permeability for which the leakage of an open seal is solved, that of a gap of 1 µm [m³].
_OPEN_PERMEABILITY = 1e-18 / 12


@dataclass(frozen=True, eq=False)
class PatchState:
    """Hold the quantities of a patch that determine the width of its 95 % interval; all are arrays (steps,).

    The quantities of a step depend on its contact state alone, not on the other loads of the programme. For a step on
    unloading, all quantities except `open_leakage` are those of its peak. The unloaded state results from the
    deformation at the peak, so its leakage is as uncertain as that at the peak.

    Parameters
    ----------
    carriers : array (steps,)
        Number of blocks that effectively carry the flow, see `participation_number`. It is NaN in a sealed state.
    contact_fraction : array (steps,)
        Fraction of the patch in contact.
    detours : array (steps,)
        Logarithm of the ratio of the leakage of the patch to that of its grid of cells, from 0 to ln 3. It measures how
        much flows through channels that cross the sides of cells. Cells at random lose these channels. It is NaN in a
        sealed state.
    open_leakage : array (steps,), m²/s
        Leakage of the seal if its gap were everywhere equal to the mean gap of the state.
    """

    carriers: Array
    contact_fraction: Array
    detours: Array
    open_leakage: Array

    @classmethod
    def of(
        cls, steps: LoadProgramme, cells: FaceCells, pressures: Array, open_leakage: Array
    ) -> PatchState:
        """Derive the quantities from the cells of a patch, at the load steps of a seal.

        Parameters
        ----------
        steps : LoadProgramme
            Load steps of the seal.
        cells : FaceCells
            Cells of the patch. If they were solved at other pressures, the quantities are interpolated.
        pressures : array (steps,), Pa
            Nominal pressure of the dry patch at every step of the seal.
        open_leakage : array (steps,), m²/s
            See the class.
        """
        contact = cells.contact_fraction.mean(axis=(1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            detours = np.clip(
                np.log(cells.surface_leakage / cells.cells_leakage), 0.0, np.log(MOST_FACTOR)
            )
        detours = np.where(np.isnan(cells.carriers), np.nan, detours)
        quantities = cells.carriers, contact, detours
        peaks = steps.peak_indices
        if cells.steps == steps:
            at_peaks = [values[peaks] for values in quantities]
        else:
            at_peaks = [
                _interpolate_on_loading(cells.steps, values, pressures[peaks])
                for values in quantities
            ]
        return cls(at_peaks[0], at_peaks[1], at_peaks[2], open_leakage)


def open_leakage_per_permeability(scene: Scene, seal: Any) -> float:
    """Compute the leakage per unit seal length for a uniform permeability of 1 m³, in 1/(m s).

    It is NaN if the flow solver failed.
    """
    return attempt(scene.leakage, seal, _OPEN_PERMEABILITY).per_length / _OPEN_PERMEABILITY


def _interpolate_on_loading(steps: LoadProgramme, values: Array, pressures: Array) -> Array:
    """Interpolate a quantity of the contact states on loading, linearly in the cube root of the pressure.

    The result is NaN at pressures for which the nearest contact state is sealed.
    """
    loading = np.flatnonzero(steps.on_loading)
    values, roots = values[loading], np.cbrt(steps.pressures[loading])
    wanted_roots = np.cbrt(pressures)
    is_known = np.isfinite(values)
    if not is_known.any():
        return np.full(wanted_roots.shape, np.nan)
    interpolated = np.interp(wanted_roots, roots[is_known], values[is_known])
    nearest = np.abs(wanted_roots[:, None] - roots).argmin(axis=1)
    return np.where(is_known[nearest], interpolated, np.nan)
