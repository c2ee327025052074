"""Windows of a surface and the global contact that loads them.

Contact is divided into equal cells. Nodes of the global flow lie on lines near the faces between cells in x1 (rows
0 … m1) and at cell centres in x2. The window of the x1-link (i, j) reaches from line i to line i + 1 over the columns
of cell j; that of the x2-link on line i from half way to the line before to half way to the line after, over the
columns between the centres of cells j and j + 1. On its line a node has one pressure over the width of a cell, which
short-circuits the constrictions there: on a face with ridges the lines lie in valleys.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dctn, idctn
from scipy.ndimage import spline_filter1d
from scipy.sparse import csr_array

from ..base.errors import InputError
from ..base.stage import Mapper
from ..contact import HalfSpace, LoadState, load_states
from ..contact.complement import FieldOverSteps
from ..loads import LoadProgramme, LoadStep
from ..topography import Topography

Array = NDArray[np.float64]
#: Pixels of the global grid for the cut-off wavelength, or the fine grid's if those are fewer.
PIXELS_PER_CUT_OFF = 8
#: How far a line of nodes may lie from its face, in window sides.
LINE_REACH = 0.25
#: Share of the height variance in the profile across the leakage from which on a face has ridges to avoid. Measured:
#: moved lines are better by factors on turned faces and worse by a tenth on self-affine ones.
RIDGE_SHARE = 0.5


@dataclass(frozen=True)
class Partition:
    """(m1, m2) equal cells of (w1, w2) pixels that tile a surface of `shape` pixels, and the nodes between them.

    lines : pixel rows (m1 + 1) of the nodes, from 0 to n1; on the faces between cells unless given.

    Raises
    ------
    InputError : cells that do not divide the surface, cells of fewer than 8 pixels, lines that do not rise.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    cells: tuple[int, int]
    lines: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if any(m < 1 or n % m for n, m in zip(self.shape, self.cells, strict=True)):
            raise InputError.of("cells", self.cells, f"divisors of the surface's {self.shape} pixels")
        if min(self.window) < 8:
            raise InputError.of("cells", self.cells, f"windows of at least 8 pixels, not {self.window}")
        m1, w1 = self.cells[0], self.window[0]
        lines = self.lines or tuple(i * w1 for i in range(m1 + 1))
        ends = len(lines) == m1 + 1 and (lines[0], lines[-1]) == (0, self.shape[0])
        if not ends or any(b <= a for a, b in itertools.pairwise(lines)):
            raise InputError.of("lines", lines, f"{m1 + 1} rising pixel rows from 0 to {self.shape[0]}")
        object.__setattr__(self, "lines", lines)

    @classmethod
    def through_valleys(cls, surface: Topography, cells: tuple[int, int], cut_off: float) -> Partition:
        """The partition of a surface whose lines lie where its waves longer than `cut_off` [m] are deepest on average.

        On a face without ridges across the leakage, lines stay on the faces between cells.
        """
        uniform = cls(surface.shape, surface.spacing, cells)
        smooth = surface.low_pass(cut_off).heights
        profile = smooth.mean(axis=1)
        if profile.var() < RIDGE_SHARE * smooth.var():
            return uniform
        w1 = uniform.window[0]
        reach = int(LINE_REACH * w1)
        inner = [
            line - reach + int(np.argmin(profile[line - reach : line + reach + 1])) for line in uniform.lines[1:-1]
        ]
        return cls(surface.shape, surface.spacing, cells, (0, *inner, surface.shape[0]))

    @property
    def window(self) -> tuple[int, int]:
        """Pixels of a window."""
        return (self.shape[0] // self.cells[0], self.shape[1] // self.cells[1])

    @property
    def window_size(self) -> tuple[float, float]:
        """Size of a window [m]."""
        return (self.window[0] * self.spacing[0], self.window[1] * self.spacing[1])

    def cell(self, fields: NDArray[Any], i: int, j: int) -> NDArray[Any]:
        """The cell (i, j) of fields (…, n1, n2)."""
        w1, w2 = self.window
        return fields[..., i * w1 : (i + 1) * w1, j * w2 : (j + 1) * w2]

    def link(self, fields: NDArray[Any] | FieldOverSteps, i: int, j: int, axis: int, shift: int = 0) -> NDArray[Any]:
        """Window of the link (i, j) along `axis` from fields (…, n1, n2), periodic in x2.

        x2-links are counted from line 1. `shift` moves the window by pixels along x2.
        """
        start, stop = self.rows(axis)[i]
        w2, n2 = self.window[1], self.shape[1]
        first = (j * w2 + shift + (w2 // 2 if axis == 1 else 0)) % n2
        columns = slice(first, first + w2)
        # over the seam there is no view
        return fields[..., start:stop, columns if columns.stop <= n2 else np.arange(first, first + w2) % n2]

    def rows(self, axis: int) -> list[tuple[int, int]]:
        """First pixel row of the windows of each row of links along `axis`, and the row after the last."""
        edges = self.lines
        if axis == 1:
            edges = tuple((a + b) // 2 for a, b in zip(self.lines[:-1], self.lines[1:], strict=True))
        return list(itertools.pairwise(edges))

    @property
    def node_rows(self) -> tuple[float, ...]:
        """x1 of the nodes' lines [m]."""
        return tuple(line * self.spacing[0] for line in self.lines)

    def cell_means(self, fields: NDArray[Any]) -> Array:
        """Means over the cells (…, m1, m2) of fields (…, n1, n2)."""
        (m1, m2), (w1, w2) = self.cells, self.window
        split = fields.reshape(*fields.shape[:-2], m1, w1, m2, w2)
        return split.mean(axis=(-3, -1), dtype=float)

    def means(self, field: NDArray[Any], axis: int = 0) -> Array:
        """Means of a field on any grid that the windows divide, over the windows of the links along `axis`."""
        grid = Partition(field.shape, self.spacing, self.cells) if field.shape != self.shape else self
        rows, columns = self.cells[0] - axis, self.cells[1]
        means = [grid.link(field, i, j, axis).mean() for i in range(rows) for j in range(columns)]
        return np.array(means).reshape(rows, columns)


@dataclass(frozen=True)
class GlobalState:
    """Global contact at a step of a programme.

    pressure : mean pressure of each cell (m1, m2) [Pa]; `pressure_across` of the windows of the x2-links between them,
        with the lines on their faces.
    raw_gap : gap between virgin planes on the fine grid (n1, n2) [m], negative where the low-pass face yielded.
    contact_pressure : of the low-pass face, on the global grid (k1, k2) [Pa].
    """

    step: LoadStep
    pressure: Array
    pressure_across: Array
    raw_gap: Array
    contact_pressure: Array

    def outer_gap(self, partition: Partition, body: HalfSpace) -> NDArray[np.float32]:
        """Raw gap without what the pressure of each cell adds in it (n1, n2) [m].

        A cell's own pressure acts on `body`, the mirrored one of a window. A window that starts from this gap may
        respond to its pressure with all waves: where it finds the global pressure again, it finds the global gap, and
        what it finds else is no response twice.
        """
        coarse = Partition(self.contact_pressure.shape, partition.spacing, partition.cells).window
        size = partition.window_size
        spacing = (size[0] / coarse[0], size[1] / coarse[1])
        symbol = replace(body, shape=coarse, spacing=spacing, plans=()).symbol()
        gap = np.empty(self.raw_gap.shape, np.float32)
        for i in range(partition.cells[0]):
            band = self.contact_pressure[i * coarse[0] : (i + 1) * coarse[0]].reshape(coarse[0], -1, coarse[1])
            waves = dctn(band, axes=(0, 2), norm="forward") * symbol[:, None, :]
            own = idctn(waves, s=partition.window, axes=(0, 2), norm="forward")
            rows = slice(i * partition.window[0], (i + 1) * partition.window[0])
            gap[rows] = self.raw_gap[rows] - own.reshape(partition.window[0], -1)
        return gap


def global_states(
    surface: Topography,
    partition: Partition,
    cut_off: float,
    programme: LoadProgramme,
    *,
    modulus: float,
    hardness: float,
    boundary: tuple[str, str],
    rtol: float = 1e-6,
    take: Callable[[GlobalState], Any] | None = None,
    mapper: Mapper = map,
) -> Iterator[Any]:
    """Contact of the low-pass face on the global grid along a load programme, state after state.

    Waves shorter than `cut_off` [m] are left to the windows. `modulus` and `boundary` are those of a `HalfSpace`, the
    other arguments those of `contact.load_states`.
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
    return load_states(coarse_gap, half_space, programme, hardness=hardness, rtol=rtol, take=solved, mapper=mapper)


def _global_state(
    state: LoadState,
    *,
    partition: Partition,
    fine_gap: Array,
    coarse_gap: Array,
    finer: Refinement,
    take: Callable[[GlobalState], Any] | None,
) -> Any:
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

    As `scipy.ndimage.zoom` does it, in a fraction of its time.
    """

    def __init__(self, shape: tuple[int, int], finer: tuple[int, int], boundary: tuple[str, str]) -> None:
        self._modes = ["grid-wrap" if kind == "periodic" else "grid-mirror" for kind in boundary]
        self._weights = [
            None if n == m else _spline_weights(n, m, mode)
            for n, m, mode in zip(shape, finer, self._modes, strict=True)
        ]

    def __call__(self, samples: Array) -> Array:
        """The samples on the finer grid."""
        rows, columns = self._weights
        if columns is not None:
            samples = (columns @ spline_filter1d(samples, 3, axis=1, mode=self._modes[1]).T).T
        return samples if rows is None else rows @ spline_filter1d(samples, 3, axis=0, mode=self._modes[0])


def _spline_weights(n: int, finer: int, mode: str) -> csr_array:
    """Cubic B-splines on n samples at the centres of finer ones (finer, n)."""
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
