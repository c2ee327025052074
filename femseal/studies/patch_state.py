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
    """Hold the quantities of a patch that determine the width of its 95 % interval, at every load step.

    The quantities at a load step depend on the contact state of this step alone. At a step on unloading, however, all
    quantities except `open_leakage` are taken from the peak, from which the patch is unloaded. The reason is that the
    deformation at the peak determines the unloaded state, whose leakage is therefore as uncertain as at the peak.

    Parameters
    ----------
    carriers : array (steps,)
        Effective number of blocks that carry the flow, if the patch is divided into blocks as large as one short wave,
        see `face.flow_concentration`. NaN in a sealed state.
    contact_fraction : array (steps,)
        Fraction of the patch in contact.
    detours : array (steps,)
        ln(Q/Q_c), with the leakage Q of the patch and the leakage Q_c of its grid of cells, limited to the range from 0
        to ln 3. It measures how much flows through channels that cross the sides of cells. These channels are lost when
        the cells are put together at random. NaN in a sealed state.
    open_leakage : array (steps,), m²/s
        Leakage of a seal whose gap is uniform and equal to the mean gap of the contact state.
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
            Cells of the patch. If they were not solved at the load steps of the seal, the quantities are interpolated.
        pressures : array (steps,), Pa
            Mean contact pressure of the seal at every load step.
        open_leakage : array (steps,), m²/s
            See the class.
        """
        contact_fraction = cells.contact_fraction.mean(axis=(1, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            leakage_ratio = cells.surface_leakage / cells.cells_leakage
            detours = np.clip(np.log(leakage_ratio), 0.0, np.log(MOST_FACTOR))
        detours = np.where(np.isnan(cells.carriers), np.nan, detours)
        peaks = steps.peak_indices  # for a step on loading, the step itself

        def at_peaks(values: Array) -> Array:
            if cells.steps == steps:
                return values[peaks]
            return _interpolate_on_loading(cells.steps, values, pressures[peaks])

        return cls(
            carriers=at_peaks(cells.carriers),
            contact_fraction=at_peaks(contact_fraction),
            detours=at_peaks(detours),
            open_leakage=open_leakage,
        )


def open_leakage_per_permeability(scene: Scene, seal: Any) -> float:
    """Compute the leakage per unit seal length for a uniform permeability of 1 m³, in 1/(m s).

    It is NaN if the flow solver failed.
    """
    return attempt(scene.leakage, seal, _OPEN_PERMEABILITY).per_length / _OPEN_PERMEABILITY


def _interpolate_on_loading(steps: LoadProgramme, values: Array, pressures: Array) -> Array:
    """Interpolate a quantity of the contact states on loading, linearly in the cube root of the pressure.

    The result is NaN where the quantity is NaN in the nearest contact state, which means that this state is sealed.
    """
    loading = np.flatnonzero(steps.on_loading)
    values = values[loading]
    state_roots = np.cbrt(steps.pressures[loading])
    roots = np.cbrt(pressures)
    is_known = np.isfinite(values)
    if not is_known.any():
        return np.full(roots.shape, np.nan)
    interpolated = np.interp(roots, state_roots[is_known], values[is_known])
    nearest_state = np.abs(roots[:, None] - state_roots).argmin(axis=1)
    return np.where(is_known[nearest_state], interpolated, np.nan)
