"""Choose the pressures at which the contact of the cells is tabulated, and interpolate between them."""

from __future__ import annotations

import numpy as np

from ..base import Array
from ..face.curves import CellCurves, local_peaks
from ..loads import LoadProgramme, LoadStep
from .cell_states import FaceCells

#: Spacing of the cube roots of tabulated pressures, as a fraction of the cube root of the highest one. ln k is nearly a
#: linear function of the cube root of the pressure. Four surfaces were solved under pressure maps of ± 40 % and with
#: fluid pressure. Down to a hundredth of the leakage at the first load, the interpolated leakage on loading was within
#: 1.2 % of states that were solved at the exact pressures; with a spacing of 1/16 it was within 2.5 %.
_SPACING = 1 / 20
#: Tabulated pressures on unloading, as fractions of the peak.
_UNLOADING_FRACTIONS = (0.8, 0.6, 0.4, 0.25, 0.12, 0.04, 0.0)
#: Spacing of the cube roots of neighbouring peaks, as a fraction of the cube root of the highest peak, and largest
#: number of peaks. On the same surfaces, the error of the leakage on unloading was below 0.7 % for peaks at which the
#: seal is open. For peaks near closing it was 1.2 % in the median and at most 15 %, whatever the number of peaks.
_PEAK_SPACING, _MOST_PEAKS = 1 / 12, 6
#: Smallest relative distance of a tabulated pressure from a peak pressure, and from the lowest and the highest
#: pressure. Between states that are closer to each other, the slope would be dominated by numerical errors.
_NEAR = 0.02
#: If the lowest or the highest pressure is within this relative distance of a peak pressure, no additional state is
#: computed.
_SAME = 1e-3


def choose_tabulated_pressures(
    paths: Array, steps: LoadProgramme, elastic: bool, spacing_factor: int = 1
) -> LoadProgramme:
    """Choose the tabulated pressures at which the contact of the cells is solved.

    Between the tabulated pressures, the permeabilities of the cells are interpolated. The tabulated pressures on
    loading range from the lowest to the highest pressure of all pressure paths, and their cube roots are evenly spaced.
    The peak pressure of a path is the pressure from which the path is unloaded. If the paths have many peak pressures,
    a few representative peak pressures are chosen. The chosen peak pressures are tabulated on loading as well, and
    unloading is tabulated from each of them.

    Parameters
    ----------
    paths : array (steps, paths), Pa
        Contact pressure on each pressure path at every load step.
    steps : LoadProgramme
        Load programme of the pressure paths.
    elastic : bool
        True if nothing yields, so that the contact states on unloading are the same as on loading.
    spacing_factor : int
        Factor by which the default spacing of tabulated pressures and peak pressures is multiplied.
    """
    peak = local_peaks(paths, steps)  # peak pressure of each path up to each step (step, path)
    unloads = (paths < peak) & (not elastic)  # whether the path is unloaded at this step
    highest = float(paths.max())
    lowest = max(float(paths.min()), 0.0)
    peaks = _choose_peaks(peak[unloads], spacing_factor)
    # pressures that must be solved on loading: the peak pressures, and the lowest and the highest pressure unless a
    # peak pressure is close
    required = np.array(peaks)
    for end in (lowest, highest):
        if (np.abs(end - required) > _SAME * required).all():
            required = np.append(required, end)
    # pressures with evenly spaced cube roots, without those that are too close to a required pressure; the cube roots
    # are divided by the cube root of the highest pressure
    first_root = np.cbrt(lowest / highest) if highest > 0 else 0.0
    count = int(np.ceil((1 - first_root) / (spacing_factor * _SPACING))) + 1
    evenly_spaced = highest * np.linspace(first_root, 1.0, count)[:-1, None] ** 3  # (pressure, 1)
    is_apart = (np.abs(evenly_spaced - required) > _NEAR * required).all(axis=1)
    loading = np.union1d(evenly_spaced[is_apart], required).tolist()
    # on unloading, the fractions end with the first fraction that is not above the deepest unloading of a path
    deepest = (paths[unloads] / peak[unloads]).min(initial=1.0)
    above_deepest = sum(fraction > deepest for fraction in _UNLOADING_FRACTIONS)
    fractions = _UNLOADING_FRACTIONS[: above_deepest + 1]
    unloading = [LoadStep(fraction * peak, peak) for peak in peaks for fraction in fractions]
    return LoadProgramme([*map(LoadStep, loading), *unloading])


def _choose_peaks(peaks: Array, spacing_factor: int) -> list[float]:
    """Choose a few of many peak pressures, so that their cube roots are about evenly spaced.

    The chosen peak pressures are returned in increasing order.
    """
    distinct: list[
        float
    ] = []  # without peak pressures that are almost equal to a higher peak pressure
    for peak in np.unique(peaks)[::-1].tolist():  # from the highest to the lowest
        if not distinct or peak * (1 + _NEAR) < distinct[-1]:
            distinct.append(peak)
    if len(distinct) < 2:
        return distinct
    values = np.array(distinct[::-1])  # in increasing order
    roots = np.cbrt(values / values[-1])  # divided by the cube root of the highest peak pressure
    count = int(np.ceil((1 - roots[0]) / (spacing_factor * _PEAK_SPACING))) + 1
    count = min(count, _MOST_PEAKS // spacing_factor)
    even_roots = np.linspace(roots[0], 1.0, count)
    # for each evenly spaced cube root, the index of the nearest peak pressure; a peak may be nearest to several of them
    nearest_peak = np.abs(roots - even_roots[:, None]).argmin(axis=1)
    return np.unique(values[nearest_peak]).tolist()


def interpolate_along_paths(cells: FaceCells, paths: Array, steps: LoadProgramme) -> Array:
    """Interpolate the permeability of every cell along every pressure path, with the correction factors.

    A pressure path is the sequence of the pressures of a tile at all load steps.

    Parameters
    ----------
    cells : FaceCells
        Cells whose permeabilities are known at tabulated pressures.
    paths : array (steps, paths), Pa
        Contact pressures along the pressure paths.
    steps : LoadProgramme
        Load steps of the pressure paths.

    Returns
    -------
    array (fluid pressures, 2, steps, paths, cells), m³
        Interpolated permeability of every cell along x1 and x2.
    """
    k = cells.corrected_k.reshape(*cells.k.shape[:3], -1)  # (fluid pressure, axis, step, cell)
    k_on_paths = np.empty((*k.shape[:2], *paths.shape, k.shape[-1]))
    for pressure_and_axis in np.ndindex(*k.shape[:2]):
        for cell in range(k.shape[-1]):
            curves = CellCurves(cells.steps, k[*pressure_and_axis, :, cell])
            k_on_paths[*pressure_and_axis, :, :, cell] = curves.k_on_paths(paths, steps)
    return k_on_paths
