"""Windows of a surface and the global contact that loads them.

Nodes of the global flow lie on the faces between cells in x1 (rows 0 … m1) and at cell centres in x2, so the window
of the x1-link (i, j) is the cell (i, j) itself, and the window of the x2-link (i, j) is centred on the corner common
to the cells (i − 1, j), (i − 1, j + 1), (i, j) and (i, j + 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

from ..contact import HalfSpace, LoadStep, load_cycle
from ..errors import InputError
from ..topography import Topography

Array = NDArray[np.float64]
#: The global grid has this many pixels along a window's side, or the fine grid's if that is fewer.
PIXELS_PER_WINDOW = 16
#: Global cut-off wavelength in window sides. Measured best: a longer one loses the pressure of features within windows.
CUT_OFF_WINDOWS = 0.5


@dataclass(frozen=True)
class Partition:
    """(m1, m2) equal windows of (w1, w2) pixels that tile a surface of `shape` pixels.

    Raises
    ------
    InputError : cells that do not divide the surface, or windows of fewer than 8 pixels.
    """

    shape: tuple[int, int]
    spacing: tuple[float, float]
    cells: tuple[int, int]

    def __post_init__(self) -> None:
        if any(m < 1 or n % m for n, m in zip(self.shape, self.cells, strict=True)):
            raise InputError.of("cells", self.cells, f"divisors of the surface's {self.shape} pixels")
        if min(self.window) < 8:
            raise InputError.of("cells", self.cells, f"windows of at least 8 pixels, not {self.window}")

    @property
    def window(self) -> tuple[int, int]:
        """Pixels of a window."""
        return (self.shape[0] // self.cells[0], self.shape[1] // self.cells[1])

    @property
    def window_size(self) -> tuple[float, float]:
        """Size of a window [m]."""
        return (self.window[0] * self.spacing[0], self.window[1] * self.spacing[1])

    @property
    def cut_off(self) -> float:
        """Wavelength that divides the scales [m]."""
        return CUT_OFF_WINDOWS * min(self.window_size)

    def cut(self, fields: NDArray[Any], i: int, j: int, axis: int = 0) -> NDArray[Any]:
        """Window of the link (i, j) along `axis` from fields (…, n1, n2); x2-links are counted from row 1."""
        w1, w2 = self.window
        rows = np.arange(i * w1, (i + 1) * w1)
        columns = np.arange(j * w2, (j + 1) * w2)
        if axis == 1:
            rows = rows + w1 // 2
            columns = (columns + w2 // 2) % self.shape[1]
        return fields[..., rows[:, None], columns[None, :]]

    def means(self, field: NDArray[Any], axis: int = 0) -> Array:
        """Means of a field on any grid that the windows divide, over the windows of the links along `axis`."""
        grid = Partition(field.shape, self.spacing, self.cells) if field.shape != self.shape else self
        m1, m2 = self.cells
        count = m1 if axis == 0 else m1 - 1
        return np.array([[grid.cut(field, i, j, axis).mean() for j in range(m2)] for i in range(count)])


@dataclass(frozen=True)
class GlobalScale:
    """Global contact at each step of a programme.

    pressure : mean pressure of each window of an x1-link (steps, m1, m2) [Pa]; `pressure_across` of each x2-link's.
    raw_gap : gap between virgin planes on the fine grid (steps, n1, n2) [m], negative where the low-pass face yielded.
    """

    steps: tuple[LoadStep, ...]
    pressure: Array
    pressure_across: Array
    raw_gap: NDArray[np.float32]
    residual: float


def solve_global_scale(
    surface: Topography,
    partition: Partition,
    *,
    modulus: float,
    hardness: float,
    boundary: tuple[str, str],
    loading: Sequence[float],
    unload_from: Sequence[float] = (),
    unloading: Sequence[float] = (),
    rtol: float = 1e-6,
) -> GlobalScale:
    """Contact of the low-pass face on the global grid along a load programme.

    Waves shorter than `partition.cut_off` are left to the windows.
    """
    m1, m2 = partition.cells
    smooth = surface.low_pass(partition.cut_off)
    w1, w2 = partition.window
    coarse_shape = (m1 * min(PIXELS_PER_WINDOW, w1), m2 * min(PIXELS_PER_WINDOW, w2))
    coarse = smooth.resample(coarse_shape) if coarse_shape != surface.shape else smooth
    top = float(surface.heights.max())
    fine_gap, coarse_gap = top - smooth.heights, top - coarse.heights
    half_space = HalfSpace(coarse.shape, coarse.spacing, modulus, boundary)
    states = load_cycle(
        coarse_gap,
        half_space,
        loading=loading,
        unload_from=unload_from,
        unloading=unloading,
        hardness=hardness,
        rtol=rtol,
    )
    raw_gap = np.empty((len(states), *surface.shape), np.float32)
    across = np.array([partition.means(s.contact.pressure, 1) for s in states])
    for s, state in enumerate(states):
        # what the load adds is smoother than the gap itself, so that alone is interpolated
        raw_gap[s] = fine_gap + _refine(state.contact.raw_gap - coarse_gap, surface.shape, boundary)
    return GlobalScale(
        steps=tuple(LoadStep(s.pressure, s.unloaded_from) for s in states),
        pressure=np.array([partition.means(s.contact.pressure, 0) for s in states]),
        pressure_across=across.reshape(len(states), m1 - 1, m2),
        raw_gap=raw_gap,
        residual=max(s.contact.residual for s in states),
    )


def _refine(field: Array, shape: tuple[int, int], boundary: tuple[str, str]) -> Array:
    """Cubic interpolation of cell-centred samples onto a finer grid of the same extent."""
    for axis in (0, 1):
        if field.shape[axis] != shape[axis]:
            factors = [1.0, 1.0]
            factors[axis] = shape[axis] / field.shape[axis]
            mode = "grid-wrap" if boundary[axis] == "periodic" else "grid-mirror"
            field = zoom(field, factors, order=3, mode=mode, grid_mode=True)
    return field
