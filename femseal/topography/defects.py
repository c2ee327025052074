"""Find what has to be removed from a measured map: its form, spikes and undefined points.

Form: mean, tilted plane or quadratic surface, fitted by least squares. With u and v, which are x1 and x2 scaled to
(−1, 1) across the map, z ≈ Σ a_ij uⁱ vʲ with i + j <= order.

Spikes: isolated points far above or below their surroundings, an error of confocal instruments. For a window of 5 × 5
points around each point, m is the median of the heights and s = 1.4826 MAD their robust standard deviation. Source: the
Hampel identifier, Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782, with an additional test of isolation.

Undefined points: they are filled by the harmonic surface through the points around them, ∇²z = 0. It is an error if
there are too many of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Flags, InputError, Pair, Periodic, Shape, validate

ORDERS = "0 (mean), 1 (tilt) or 2 (tilt and curvature)"


@dataclass(frozen=True, eq=False)
class Form:
    """Hold a polynomial surface that was fitted to a map.

    Parameters
    ----------
    coefficients : array, (3, 3)
        a_ij [m].
    shape : tuple of two int
        Shape of the map.
    size : tuple of two float
        Sides of the map [m].
    """

    coefficients: NDArray
    shape: Shape
    size: Pair

    @property
    def heights(self) -> NDArray:
        """Heights of the form at the pixel centres (n1, n2) [m]."""
        u, v = (_powers(n, 3) for n in self.shape)
        return u @ self.coefficients @ v.T

    @property
    def slopes(self) -> Pair:
        """Slopes ∂z/∂x1 and ∂z/∂x2 in the middle of the map [-]."""
        return (
            2 * float(self.coefficients[1, 0]) / self.size[0],
            2 * float(self.coefficients[0, 1]) / self.size[1],
        )

    @property
    def curvatures(self) -> tuple[float, float, float]:
        """Second derivatives ∂²z/∂x1², ∂²z/∂x1∂x2 and ∂²z/∂x2² [1/m]."""
        a, (l1, l2) = self.coefficients, self.size
        return (
            8 * float(a[2, 0]) / l1**2,
            4 * float(a[1, 1]) / (l1 * l2),
            8 * float(a[0, 2]) / l2**2,
        )


def scaled_centres(n: int) -> NDArray:
    """Return the pixel centres along an axis (n,), scaled to (−1, 1)."""
    return (2 * np.arange(n) + 1 - n) / n


def _powers(n: int, count: int) -> NDArray:
    """Return the powers 0 to `count` − 1 of the scaled pixel centres along an axis (n, count)."""
    return np.vander(scaled_centres(n), count, increasing=True)


def fit_form(heights: NDArray, size: Pair, order: int, tilted: Periodic = (True, True)) -> Form:
    """Fit a polynomial surface to the defined points of a map by least squares.

    The normal equations need only the moments Σ uⁱ vʲ and Σ z uⁱ vʲ, which are two matrix products, so that no design
    matrix of the size of the map is needed. A term that the points do not determine, as in a map of a single row, is 0
    (solution of least norm).

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights [m], NaN where undefined.
    size : tuple of two float
        Sides of the map [m].
    order : int
        0 (mean), 1 (and tilt) or 2 (and curvature).
    tilted : tuple of two bool
        Whether the form may vary along x1 and x2.

    Raises
    ------
    InputError
        The order is invalid, or no point is defined.
    """
    if order not in (0, 1, 2):
        raise InputError("order", repr(order), ORDERS)
    defined = ~np.isnan(heights)
    if not defined.any():
        raise InputError("heights", "100 % undefined points", "at least one defined point")
    mean = float(heights[defined].mean())
    u, v = (_powers(n, 2 * order + 1) for n in heights.shape)
    moments = u.T @ defined.astype(float) @ v  # Σ uⁱ vʲ at [i, j]
    height_moments = u.T @ np.where(defined, heights - mean, 0.0) @ v  # Σ (z − mean) uⁱ vʲ
    terms = [
        (i, j)
        for i in range(order + 1)
        for j in range(order + 1 - i)
        if (tilted[0] or i == 0) and (tilted[1] or j == 0)
    ]
    matrix = np.array([[moments[i + k, j + l] for k, l in terms] for i, j in terms])
    right_side = np.array([height_moments[term] for term in terms])
    solution = np.linalg.lstsq(matrix, right_side)[0]
    coefficients = np.zeros((3, 3))
    for term, value in zip(terms, solution, strict=True):
        coefficients[term] = value
    coefficients[0, 0] += mean
    return Form(coefficients, (heights.shape[0], heights.shape[1]), size)


#: Default threshold: a point deviates if |z − m| > SPIKES · s.
SPIKES = 6.0
#: Largest number of neighbouring points that form a spike. A larger group is a feature of the surface.
MOST_POINTS = 4
#: Number of points from the middle of a window to its edge.
_REACH = 2
#: Fraction of the points that share one height if the heights are quantised. They are at least as many as a window has.
_COMMON = 1e-3
#: Neighbourhood of a point, including its diagonal neighbours.
ALL_NEIGHBOURS = np.ones((3, 3))


def find_spikes(heights: NDArray, threshold: float = SPIKES) -> Flags:
    """Find the spikes of a map.

    A spike is a group of at most four points with |z − m| > `threshold` · s that stands alone: no point next to it
    deviates with the same sign by more than half as much as its tip. Ridges, edges and corners of real asperities
    continue in a neighbouring point and are not spikes, nor is any summit that the instrument resolves. s is at least
    its median over the map and at least a step of quantised heights, and it grows with the local slope.

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights as measured [m], NaN where undefined. Their form of second order is subtracted first.
    threshold : float
        Deviation in robust standard deviations, > 0. If infinite, there are no spikes.

    Returns
    -------
    array of bool, (n1, n2)
        Whether each point belongs to a spike.

    Raises
    ------
    InputError
        The threshold is not a number > 0.
    """
    is_spike = np.zeros(heights.shape, dtype=bool)
    if threshold == inf or np.isnan(heights).all():
        return is_spike
    validate.number("spikes", threshold)
    flat = heights - fit_form(heights, (1.0, 1.0), 2).heights
    median, absolute_deviation = _window_medians(flat)
    least_deviation = np.nanmedian(absolute_deviation)
    scale = 1.4826 * np.maximum(absolute_deviation, least_deviation)
    scale = np.maximum(scale, _height_step(heights))
    deviates = np.abs(flat - median) > threshold * scale
    labels, _ = scipy.ndimage.label(deviates, ALL_NEIGHBOURS)
    for number, box in enumerate(scipy.ndimage.find_objects(labels), start=1):
        # the bounding box of the group and the points next to it
        window = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in box)
        group = labels[window] == number
        if np.count_nonzero(group) > MOST_POINTS:
            continue
        if _stands_alone(group, flat[window], median[window]):
            is_spike[window] |= group
    return is_spike


def _stands_alone(group: Flags, flat: NDArray, median: NDArray) -> bool:
    """Return whether no point next to a group deviates more than half as much as the tip of the group.

    group : points of the group in a window. flat, median : heights and their medians in this window [m].
    """
    deviation = np.where(group, np.abs(flat - median), -1.0)
    tip = np.unravel_index(np.argmax(deviation), group.shape)
    neighbours = scipy.ndimage.binary_dilation(group, ALL_NEIGHBOURS) & ~group
    tip_height = flat[tip] - median[tip]
    relative_heights = (flat[neighbours] - median[tip]) / tip_height  # NaN where undefined
    return not bool((relative_heights > 0.5).any())


#: Number of points whose windows are treated together. All windows at once would take the memory of 25 maps.
_BLOCK = 2**16


def _window_medians(z: NDArray) -> tuple[NDArray, NDArray]:
    """Return the median in the window of each point, and the median absolute deviation from it, both (n1, n2)."""
    side = 2 * _REACH + 1
    rows = max(1, _BLOCK // z.shape[1])
    padded = np.pad(z, _REACH, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))  # (n1, n2, side, side)
    median = np.empty_like(z)
    deviation = np.empty_like(z)
    for start in range(0, z.shape[0], rows):
        block = np.s_[start : start + rows]
        values = windows[block].reshape(-1, side * side)
        block_median = _row_medians(values)
        block_deviation = _row_medians(np.abs(values - block_median[:, None]))
        median[block] = block_median.reshape(-1, z.shape[1])
        deviation[block] = block_deviation.reshape(-1, z.shape[1])
    return median, deviation


def _row_medians(values: NDArray) -> NDArray:
    """Return the median of the defined numbers in each row; NaN for a row without any."""
    ordered = np.sort(values, axis=1)  # NaN comes last
    count = np.count_nonzero(~np.isnan(ordered), axis=1)
    row = np.arange(len(ordered))
    # for a row without numbers both indices lead to a NaN
    lower = ordered[row, np.maximum(count - 1, 0) // 2]
    upper = ordered[row, np.minimum(count // 2, count.max() - 1)]
    return (lower + upper) / 2


def _height_step(heights: NDArray) -> float:
    """Return the step between the heights of quantised data [m], at least the size of rounding errors."""
    values, count = np.unique(heights[~np.isnan(heights)], return_counts=True)
    is_common = count >= max(_COMMON * count.sum(), 25)
    steps = np.diff(values[is_common])
    smallest_step = float(steps.min()) if steps.size else 0.0
    rounding = 1e-9 * float(np.abs(values).max())
    return max(smallest_step, rounding)


class TooManyUndefined(InputError):
    """Report that more points of a map are undefined than may be filled."""


def fill_holes(heights: NDArray, spacing: Pair, periodic: Periodic) -> NDArray:
    """Fill undefined points by the harmonic surface through the points around them.

    The five-point Laplacian is solved in the holes, with the defined neighbours as Dirichlet values. Periodic axes wrap
    around, and there is no flux through other borders. A plane is reproduced exactly in holes that do not touch a
    border. The filled heights stay between the extremes of the heights around a hole (maximum principle), so that no
    new summit appears.

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights [m], NaN where undefined. At least one point must be defined.
    spacing : tuple of two float
        Pixel size [m].
    periodic : tuple of two bool
        Whether the map is periodic along x1 and x2.

    Returns
    -------
    array, (n1, n2)
        Heights [m] without undefined points.
    """
    hole = np.isnan(heights)
    if not hole.any():
        return heights
    index = np.arange(hole.size).reshape(hole.shape)  # flat index of every point
    hole_index = np.flatnonzero(hole)
    # rows of this matrix select points; the Laplacian has a row for each point of the holes and a column for each point
    select = scipy.sparse.eye_array(hole.size, format="csr")
    laplacian = 0.0 * select[hole_index]
    for axis in (0, 1):
        # the neighbour beyond a border is the point on the other side, or the point itself
        mode: Any = "wrap" if periodic[axis] else "clip"
        weight = (spacing[0] / spacing[axis]) ** 2
        for step in (-1, 1):
            neighbour = np.take(index, np.arange(hole.shape[axis]) + step, axis, mode=mode)[hole]
            laplacian += weight * (select[hole_index] - select[neighbour])
    filled = np.where(hole, 0.0, heights)
    right_side = -(laplacian @ filled.ravel())
    filled[hole] = scipy.sparse.linalg.spsolve(laplacian[:, hole_index], right_side)
    return filled
