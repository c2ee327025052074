"""Describe the contact state of a measured patch at every load step, from which the width of its interval follows."""

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

#: Permeability for which the leakage of an open seal is solved [m³]: of a gap of 1 µm.
_OPEN_PERMEABILITY = 1e-18 / 12


@dataclass(frozen=True, eq=False)
class PatchState:
    """Quantities of a patch in its contact states; arrays (steps,).

    Each depends on the state alone, not on the other loads of the programme. At the steps of an unloading all but
    `open_leakage` are those of the peak, because one patch shows as little of the unloaded state as of the peak.

    Parameters
    ----------
    carriers : number of blocks that effectively carry the flow, see `participation_number`; NaN of a sealed state.
    contact_fraction : fraction of the patch in contact.
    detours : ln of the leakage of the patch over that of its cells in their own order, from 0 to ln 3. It measures how
        much flows through channels that cross the sides of cells, which cells at random do not have. NaN of a sealed
        state.
    open_leakage : leakage of the seal if the mean gap of the state were the gap everywhere, m²/s.
    """

    carriers: Array
    contact_fraction: Array
    detours: Array
    open_leakage: Array

    @classmethod
    def of(
        cls, steps: LoadProgramme, cells: FaceCells, pressures: Array, open_leakage: Array
    ) -> PatchState:
        """Take the quantities of a patch at the steps of a seal.

        Parameters
        ----------
        steps : load programme of the seal. The cells may have another one, whose states are interpolated.
        cells : cells of the surface.
        pressures : nominal pressure of the dry patch at every step of the seal, array (steps,), Pa.
        open_leakage : see the class.
        """
        contact = cells.contact_fraction.mean(axis=(1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            detours = np.clip(np.log(cells.face / cells.own), 0.0, np.log(MOST_FACTOR))
        detours = np.where(np.isnan(cells.carriers), np.nan, detours)
        quantities = cells.carriers, contact, detours
        peaks = steps.peak_indices
        if cells.steps == steps:
            taken = [values[peaks] for values in quantities]
        else:
            taken = [_on_loading(cells.steps, values, pressures[peaks]) for values in quantities]
        return cls(taken[0], taken[1], taken[2], open_leakage)


def open_leakage_per_permeability(scene: Scene, seal: Any) -> float:
    """Solve the leakage of a seal per length for a uniform permeability of 1 m³ [1/(m s)]; NaN if it failed."""
    return attempt(scene.leakage, seal, _OPEN_PERMEABILITY).per_length / _OPEN_PERMEABILITY


def _on_loading(steps: LoadProgramme, values: Array, pressures: Array) -> Array:
    """Interpolate a quantity of states on loading at other pressures [Pa], linearly in the cube root of the pressure.

    The quantity is NaN where the nearest state is sealed.
    """
    loading = np.flatnonzero(steps.on_loading)
    values, known_at = values[loading], np.cbrt(steps.pressures[loading])
    wanted = np.cbrt(pressures)
    known = np.isfinite(values)
    if not known.any():
        return np.full(wanted.shape, np.nan)
    interpolated = np.interp(wanted, known_at[known], values[known])
    nearest = np.abs(wanted[:, None] - known_at).argmin(axis=1)
    return np.where(known[nearest], interpolated, np.nan)
