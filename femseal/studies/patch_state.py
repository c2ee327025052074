"""Describe the contact states of a measured patch, from which the width of the 95 % interval is computed."""

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

#: Permeability of a gap of 1 µm [m³], for which the leakage of an open seal is solved.
_OPEN_PERMEABILITY = 1e-18 / 12


@dataclass(frozen=True, eq=False)
class PatchState:
    """Quantities that determine the width of the 95 % interval of a patch, at every load step.

    At a load step on loading, all quantities describe the contact state of this step. At a load step on unloading, all
    quantities except `open_leakage` describe the highest load before the unloading. The contact states on unloading
    depend on the deformation at the highest load, so that their leakages are as uncertain as the leakage at that load.

    Parameters
    ----------
    carriers : array (steps,)
        Effective number of blocks that carry the flow, see `face.flow_concentration`; NaN in a sealed state. The blocks
        are as large as the short waves of the surface.
    contact_fraction : array (steps,)
        Fraction of the patch in contact.
    detours : array (steps,)
        Detour index ln(Q/Q_c), where Q is the leakage of the patch and Q_c the leakage of its grid of cells; limited to
        the range from 0 to ln 3, NaN in a sealed state. The detour index measures how much fluid flows through channels
        that cross the sides of cells. These channels are interrupted in a seal with cells at random.
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
        """Compute the contact states of a patch from its cells, at the load steps of a seal.

        Parameters
        ----------
        steps : LoadProgramme
            Load steps of the seal.
        cells : FaceCells
            Cells of the patch. For cells that were solved at tabulated pressures, all quantities except `open_leakage`
            are interpolated.
        pressures : array (steps,), Pa
            Mean contact pressure of the seal at every load step.
        open_leakage : array (steps,), m²/s
            Leakage of a seal whose gap is uniform and equal to the mean gap of the contact state.
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

    The leakage is NaN if the flow solver failed.
    """
    return attempt(scene.leakage, seal, _OPEN_PERMEABILITY).per_length / _OPEN_PERMEABILITY


def open_leakage_of_state(state: PatchState | None, step_count: int) -> Array:
    """Return the leakage of a uniform gap that is equal to the mean gap (steps,) [m²/s]; NaN if there is no state."""
    if state is None:
        return np.full(step_count, np.nan)
    return np.asarray(state.open_leakage, float)


def _interpolate_on_loading(steps: LoadProgramme, values: Array, pressures: Array) -> Array:
    """Interpolate a quantity between the contact states on loading, linearly in the cube root of the pressure.

    The quantity is NaN in sealed contact states. At a pressure whose nearest contact state is sealed, the interpolated
    value is NaN as well.

    steps : loads of the contact states.
    values : quantity in each contact state (states,).
    pressures : pressures at which the quantity is interpolated [Pa].
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
