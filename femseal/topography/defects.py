"""What a measured map has to lose, found in its heights: its form, spikes and undefined points.

Form: mean, tilt plane or quadratic surface by least squares. u, v = x1, x2 scaled to (−1, 1) across the map,
z ≈ Σ a_ij uⁱ vʲ with i + j <= order.

Spikes: isolated points far above or below their surroundings, an artefact of confocal instruments. m median of z in a
window of 5 × 5 points, s = 1.4826 MAD, the robust standard deviation about m in that window. Source: the Hampel
identifier, Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782, with a test of isolation.

Undefined points: filled by the harmonic surface through their rims, ∇²z = 0, or cropped. Too many of them are an error,
which offers the largest rectangle of the map with few.
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
    """A fitted polynomial surface.

    coefficients : a_ij (3, 3) [m].
    shape, size : of the map it was fitted to, [-] and [m].
    """

    coefficients: NDArray
    shape: Shape
    size: Pair

    @property
    def heights(self) -> NDArray:
        """Form at the pixel centres (n1, n2) [m]."""
        u, v = (np.vander(scaled_centres(n), 3, increasing=True) for n in self.shape)
        return u @ self.coefficients @ v.T

    @property
    def slopes(self) -> Pair:
        """∂z/∂x1, ∂z/∂x2 in the middle of the map [-]."""
        return (
            2 * float(self.coefficients[1, 0]) / self.size[0],
            2 * float(self.coefficients[0, 1]) / self.size[1],
        )

    @property
    def curvatures(self) -> tuple[float, float, float]:
        """∂²z/∂x1², ∂²z/∂x1∂x2, ∂²z/∂x2² [1/m]."""
        a, (l1, l2) = self.coefficients, self.size
        return (
            8 * float(a[2, 0]) / l1**2,
            4 * float(a[1, 1]) / (l1 * l2),
            8 * float(a[0, 2]) / l2**2,
        )


def scaled_centres(n: int) -> NDArray:
    """Pixel centres scaled to (−1, 1)."""
    return (2 * np.arange(n) + 1 - n) / n


def fit_form(heights: NDArray, size: Pair, order: int, tilted: Periodic = (True, True)) -> Form:
    """Least-squares form of `heights` (n1, n2) [m] with NaN for undefined points.

    The normal equations need only the moments Σ uⁱ vʲ and Σ z uⁱ vʲ, which are two matrix products per map:
    no design matrix of the size of the map. Where points do not fix a term (a single row), it is zero (least
    norm). Along an axis that is not `tilted` the form is level.

    Raises InputError: order not 0, 1 or 2; no defined point.
    """
    if order not in (0, 1, 2):
        raise InputError("order", repr(order), ORDERS)
    defined = ~np.isnan(heights)
    if not defined.any():
        raise InputError("heights", "100 % undefined points", "at least one defined point")
    mean = float(heights[defined].mean())
    u, v = (np.vander(scaled_centres(n), 2 * order + 1, increasing=True) for n in heights.shape)
    moments = u.T @ defined.astype(float) @ v
    loads = u.T @ np.where(defined, heights - mean, 0.0) @ v
    terms = [
        (i, j)
        for i in range(order + 1)
        for j in range(order + 1 - i)
        if (tilted[0] or i == 0) and (tilted[1] or j == 0)
    ]
    normal = np.array([[moments[i + k, j + l] for k, l in terms] for i, j in terms])
    solution = np.linalg.lstsq(normal, np.array([loads[t] for t in terms]))[0]
    coefficients = np.zeros((3, 3))
    for term, value in zip(terms, solution, strict=True):
        coefficients[term] = value
    coefficients[0, 0] += mean
    return Form(coefficients, (heights.shape[0], heights.shape[1]), size)


#: A point is far off where |z − m| > SPIKES · s.
SPIKES = 6.0
#: More points than this side by side are no spike but a feature of the face.
MOST_POINTS = 4
_REACH = 2
#: Fraction of the points, and no less than a window of them, that lie at one height where data is quantised.
_COMMON = 1e-3
ALL_NEIGHBOURS = np.ones((3, 3))


def find_spikes(heights: NDArray, threshold: float = SPIKES) -> Flags:
    """Spikes in `heights` (n1, n2) [m], NaN where undefined.

    A spike is a group of at most four points with |z − m| > `threshold` · s, and no neighbour of it deviates, with
    the same sign, half as far as its tip. Ridges, edges and corners of real asperities continue in a neighbour and are
    kept, as is every summit that the instrument resolves. s is no less than its median over the map, nor than a
    step of quantised heights, and grows with the local slope.

    heights : as measured; their form of second order is taken off first.
    threshold : > 0; infinite finds none.

    Raises InputError: threshold not a number > 0.
    """
    if threshold == inf or np.isnan(heights).all():
        return np.zeros(heights.shape, dtype=bool)
    validate.number("spikes", threshold)
    flat = heights - fit_form(heights, (1.0, 1.0), 2).heights
    median, deviation = _window_medians(flat)
    off = flat - median
    scale = np.maximum(
        1.4826 * np.maximum(deviation, np.nanmedian(deviation)), _height_step(heights)
    )
    groups, _ = scipy.ndimage.label(np.abs(off) > threshold * scale, ALL_NEIGHBOURS)
    spikes = np.zeros(heights.shape, dtype=bool)
    for number, place in enumerate(scipy.ndimage.find_objects(groups), start=1):
        around = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in place)
        group = groups[around] == number
        if np.count_nonzero(group) <= MOST_POINTS and _stands_alone(
            group, flat[around], median[around]
        ):
            spikes[around] |= group
    return spikes


def _stands_alone(group: Flags, flat: NDArray, median: NDArray) -> bool:
    """Whether no point around `group` goes half as far from the median at its tip as the tip does."""
    tip = np.unravel_index(np.argmax(np.where(group, np.abs(flat - median), -1.0)), group.shape)
    rim = scipy.ndimage.binary_dilation(group, ALL_NEIGHBOURS) & ~group
    height = flat[tip] - median[tip]
    follows = (flat[rim] - median[tip]) / height > 0.5  # False where undefined
    return not bool(follows.any())


#: Points whose windows are looked at together: all windows at once are 25 maps.
_BLOCK = 2**16


def _window_medians(z: NDArray) -> tuple[NDArray, NDArray]:
    """Median (n1, n2) of the defined points in the window of each point, and of their distances from it."""
    side = 2 * _REACH + 1
    rows = max(1, _BLOCK // z.shape[1])
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(z, _REACH, constant_values=np.nan), (side, side)
    )
    median, deviation = np.empty_like(z), np.empty_like(z)
    for start in range(0, z.shape[0], rows):
        part = np.s_[start : start + rows]
        values = windows[part].reshape(-1, side * side)
        middle = _row_medians(values)
        median[part] = middle.reshape(-1, z.shape[1])
        deviation[part] = _row_medians(np.abs(values - middle[:, None])).reshape(-1, z.shape[1])
    return median, deviation


def _row_medians(values: NDArray) -> NDArray:
    """Median of the numbers in each row; NaN in rows without any."""
    ordered = np.sort(values, axis=1)  # NaN comes last
    count = np.count_nonzero(~np.isnan(ordered), axis=1)
    row = np.arange(len(ordered))
    return (
        ordered[row, np.maximum(count - 1, 0) // 2]
        + ordered[row, np.minimum(count // 2, count.max() - 1)]
    ) / 2


def _height_step(heights: NDArray) -> float:
    """Step between heights that many points have, as in quantised data; no less than rounding [m]."""
    values, count = np.unique(heights[~np.isnan(heights)], return_counts=True)
    steps = np.diff(values[count >= max(_COMMON * count.sum(), 25)])
    return max(float(steps.min()) if steps.size else 0.0, 1e-9 * float(np.abs(values).max()))


class TooManyUndefined(InputError):
    """More points of a map are undefined than may be filled."""


def fill_holes(heights: NDArray, spacing: Pair, periodic: Periodic) -> NDArray:
    """`heights` (n1, n2) [m] with every NaN replaced; at least one point must be defined.

    Five-point Laplacian on the holes, defined neighbours as Dirichlet values, wrapped on periodic axes, no
    flux through the other borders. Exact for a plane in holes that do not touch a border; the filled values
    stay between the extremes of the rim (maximum principle), so a hole adds no new summit.
    """
    hole = np.isnan(heights)
    if not hole.any():
        return heights
    index = np.arange(hole.size).reshape(hole.shape)
    own = np.flatnonzero(hole)
    value_at = scipy.sparse.eye_array(hole.size, format="csr")
    laplacian = 0.0 * value_at[own]
    for axis in (0, 1):
        # the neighbour beyond a border is the point on the other side, or the point itself
        mode: Any = "wrap" if periodic[axis] else "clip"
        for step in (-1, 1):
            beside = np.take(index, np.arange(hole.shape[axis]) + step, axis, mode=mode)[hole]
            difference = value_at[own] - value_at[beside]
            laplacian += (spacing[0] / spacing[axis]) ** 2 * difference
    filled = np.where(hole, 0.0, heights)
    filled[hole] = scipy.sparse.linalg.spsolve(laplacian[:, own], -(laplacian @ filled.ravel()))
    return filled
