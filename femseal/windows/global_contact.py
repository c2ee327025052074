"""Global contact of a face: its long waves, solved on a coarse grid, give the mean pressure of every window."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Any

import numpy as np
import scipy
from scipy.sparse import csr_array

from ..base import Array, Mapper
from ..contact import Contact, ContactLaw, HalfSpace, LoadState, load_states, solve_contact
from ..loads import LoadProgramme, LoadStep
from ..topography import Topography
from .partition import Partition

#: Pixels of the global grid for the cut-off wavelength, or the fine grid's if those are fewer.
PIXELS_PER_CUT_OFF = 8


@dataclass(frozen=True)
class GlobalState:
    """Global contact at one load step.

    pressure : mean pressure of each cell (m1, m2) [Pa].
    pressure_across : mean pressure of the windows of the x2-links (m1 − 1, m2) [Pa], for lines on the faces of cells.
    raw_gap : gap between the undeformed planes on the fine grid (n1, n2) [m], negative where the low-pass face yielded.
    contact_pressure : pressure of the low-pass face on the global grid (k1, k2) [Pa].
    """

    step: LoadStep
    pressure: Array
    pressure_across: Array
    raw_gap: Array
    contact_pressure: Array


def global_states(
    surface: Topography,
    partition: Partition,
    cut_off: float,
    programme: LoadProgramme,
    *,
    modulus: float,
    law: ContactLaw,
    boundary: tuple[str, str],
    rtol: float = 1e-6,
    take: Callable[[GlobalState], Any] | None = None,
    solve: Callable[..., Contact] = solve_contact,
    mapper: Mapper = map,
) -> Iterator[Any]:
    """Contact of the low-pass face on the global grid at every step of a load programme, one step after the other.

    Waves shorter than `cut_off` [m] are left to the windows. `modulus` and `boundary` are those of `HalfSpace`; the
    other arguments are those of `contact.load_states`.
    """
    smooth = surface.low_pass(cut_off)
    wanted = (ceil(PIXELS_PER_CUT_OFF * size / cut_off - 1e-9) for size in partition.window_size)
    per_window = [min(pixels, w) for pixels, w in zip(wanted, partition.window, strict=True)]
    coarse_shape = (partition.cells[0] * per_window[0], partition.cells[1] * per_window[1])
    coarse = smooth.resample(coarse_shape) if coarse_shape != surface.shape else smooth
    top = float(surface.heights.max())
    coarse_gap = top - coarse.heights
    fine_gap = coarse_gap if coarse is smooth else top - smooth.heights
    half_space = HalfSpace(coarse.shape, coarse.spacing, modulus, boundary)
    finer = Refinement(coarse.shape, surface.shape, boundary)
    del smooth, coarse
    solved = partial(
        _global_state, partition=partition, fine_gap=fine_gap, coarse_gap=coarse_gap, finer=finer, take=take
    )
    return load_states(coarse_gap, half_space, programme, law=law, rtol=rtol, take=solved, solve=solve, mapper=mapper)


def _global_state(
    state: LoadState,
    *,
    partition: Partition,
    fine_gap: Array,
    coarse_gap: Array,
    finer: Refinement,
    take: Callable[[GlobalState], Any] | None,
) -> Any:
    """Pressures of the windows and raw gap on the fine grid at one step, from the contact on the global grid."""
    contact = state.contact
    cells = Partition(partition.shape, partition.spacing, partition.cells)
    pressure, across = (cells.means(contact.pressure, axis) for axis in (0, 1))
    # what the load adds is smoother than the gap itself, so that alone is interpolated
    raw_gap = finer(contact.raw_gap - coarse_gap)
    raw_gap += fine_gap
    found = GlobalState(
        step=LoadStep(state.pressure, state.unloaded_from),
        pressure=pressure,
        pressure_across=across,
        raw_gap=raw_gap,
        contact_pressure=contact.pressure,
    )
    return found if take is None else take(found)


class Refinement:
    """Cubic interpolation of cell-centred samples onto a finer grid of the same extent.

    The result is that of `scipy.ndimage.zoom`, in a fraction of its time.
    """

    def __init__(self, shape: tuple[int, int], finer: tuple[int, int], boundary: tuple[str, str]) -> None:
        self._modes = ["grid-wrap" if kind == "periodic" else "grid-mirror" for kind in boundary]
        self._weights = [
            None if n == m else _spline_weights(n, m, mode)
            for n, m, mode in zip(shape, finer, self._modes, strict=True)
        ]

    def __call__(self, samples: Array) -> Array:
        """Interpolate samples onto the finer grid."""
        rows, columns = self._weights
        if columns is not None:
            samples = (columns @ scipy.ndimage.spline_filter1d(samples, 3, axis=1, mode=self._modes[1]).T).T
        return (
            samples if rows is None else rows @ scipy.ndimage.spline_filter1d(samples, 3, axis=0, mode=self._modes[0])
        )


def _spline_weights(n: int, finer: int, mode: str) -> csr_array:
    """Values of the n cubic B-splines at the centres of the finer cells, a sparse matrix (finer, n)."""
    position = (np.arange(finer) + 0.5) * n / finer - 0.5
    first = np.floor(position).astype(int) - 1
    t = position - (first + 1)
    values = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 3 * (1 - t) ** 3 - 6 * (1 - t) ** 2 + 4, t**3]
    columns = first[:, None] + np.arange(4)
    if mode == "grid-wrap":
        columns %= n
    else:
        columns %= 2 * n
        columns = np.minimum(columns, 2 * n - 1 - columns)
    rows = np.repeat(np.arange(finer), 4)
    return csr_array((np.stack(values, axis=1).ravel() / 6, (rows, columns.ravel())), shape=(finer, n))
