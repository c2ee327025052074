"""Find the spikes of a measured map, and fill its undefined points.

Spikes: isolated points far above or below their surroundings, a typical error of confocal instruments. In a window of 5
× 5 points around each point, m denotes the median of the heights, and s = 1.4826 MAD their robust standard deviation
(MAD: median absolute deviation). Source: the Hampel identifier, Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782,
with an additional test that the spike is isolated.

Undefined points: these points are filled by the harmonic surface, ∇²z = 0, through the points around each hole. A map
with too many undefined points is refused.
"""

from __future__ import annotations

from math import ceil, inf
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import Flags, InputError, Pair, Periodic, validate
from .form_fit import fit_form, row_blocks

#: Default threshold: a point deviates if |z − m| > SPIKES · s.
SPIKES = 6.0
#: Largest number of neighbouring points that form a spike. A larger group is a feature of the surface.
MOST_SPIKE_POINTS = 4
#: Number of points from the middle of a window to its edge.
_REACH = 2
#: A height is a level of quantised heights if at least this fraction of the points have it, and at least as many
#: points as a window contains.
_COMMON = 1e-3
#: Neighbourhood of a point, including its diagonal neighbours.
ALL_NEIGHBOURS = np.ones((3, 3))


def find_spikes(heights: NDArray, threshold: float = SPIKES) -> Flags:
    """Find the spikes of a map.

    A spike is a group of at most four neighbouring points with |z − m| > `threshold` · s, where m is the median of the
    heights z in a window around the point, and s the robust standard deviation of the heights in this window. The value
    of s is never smaller than its median over the map or the step of quantised heights. On steep parts of the surface,
    s is large.

    A spike must also be isolated: no point next to the group deviates in the same direction by more than half of the
    largest deviation within the group. Real ridges, edges, corners and resolved summits are not isolated, because their
    neighbouring points deviate as well.

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights as measured [m], NaN where undefined. The function subtracts a quadratic surface before it searches for
        spikes.
    threshold : float
        Smallest deviation of a spike in robust standard deviations, > 0. If the threshold is infinite, no point is a
        spike.

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
    # smallest standard deviation s with which a deviation is compared
    least_scale = _height_step(heights)
    flat = fit_form(heights, (1.0, 1.0), 2).heights
    np.subtract(heights, flat, out=flat)
    # m, and the median absolute deviation MAD, both (n1, n2)
    median, absolute_deviation = _window_medians(flat)
    defined = absolute_deviation[~np.isnan(absolute_deviation)]
    least_scale = max(least_scale, 1.4826 * float(np.median(defined, overwrite_input=True)))
    del defined
    deviates = np.empty(heights.shape, dtype=bool)
    for block in row_blocks(heights.shape):
        # s = 1.4826 MAD in each window
        scale = np.maximum(1.4826 * absolute_deviation[block].astype(float), least_scale)
        deviates[block] = np.abs(flat[block] - median[block]) > threshold * scale
    del absolute_deviation
    labels, _ = scipy.ndimage.label(deviates, ALL_NEIGHBOURS)
    for number, box in enumerate(scipy.ndimage.find_objects(labels), start=1):
        # the bounding box of the group and the points next to it
        window = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in box)
        group = labels[window] == number
        if np.count_nonzero(group) > MOST_SPIKE_POINTS:
            continue
        if _stands_alone(group, flat[window], median[window]):
            is_spike[window] |= group
    return is_spike


def _stands_alone(group: Flags, flat: NDArray, median: NDArray) -> bool:
    """Return whether a group of deviating points is isolated.

    A group is isolated if no point next to the group deviates, in the same direction, by more than half of the largest
    deviation within the group.

    group : whether each point in a rectangular part of the map belongs to the group.
    flat, median : heights of the points in this part of the map, and the median of the heights around each point [m].
    """
    deviation = np.where(group, np.abs(flat - median), -1.0)
    # point of the group with the largest deviation
    tip = np.unravel_index(np.argmax(deviation), group.shape)
    neighbours = scipy.ndimage.binary_dilation(group, ALL_NEIGHBOURS) & ~group
    tip_height = flat[tip] - median[tip]
    # 1 for a neighbour as high as the tip, 0 for a neighbour at the median; NaN where undefined
    relative_heights = (flat[neighbours] - median[tip]) / tip_height
    return not bool((relative_heights > 0.5).any())


def _window_medians(z: NDArray) -> tuple[NDArray, NDArray]:
    """Compute the median and the median absolute deviation in the window around each point, both (n1, n2).

    The median absolute deviation is stored in single precision to save memory. Single precision suffices for a
    comparison with a threshold.
    """
    side = 2 * _REACH + 1
    median = np.empty_like(z)
    deviation = np.empty(z.shape, np.float32)
    for block in row_blocks(z.shape):
        # rows that the windows of the block need beyond the upper and the lower border of the map
        above = max(0, _REACH - block.start)
        below = max(0, block.stop + _REACH - z.shape[0])
        rows = z[max(0, block.start - _REACH) : block.stop + _REACH]
        padded = np.pad(rows, ((above, below), (_REACH, _REACH)), constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, (side, side))
        values = windows.reshape(-1, side * side)  # (point of the block, point of its window)
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
    # The median is the mean of the two middle numbers, which coincide if their count is odd. In a row without numbers,
    # both indices lead to a NaN.
    lower = ordered[row, np.maximum(count - 1, 0) // 2]
    upper = ordered[row, np.minimum(count // 2, count.max() - 1)]
    return (lower + upper) / 2


def _height_step(heights: NDArray) -> float:
    """Return the smallest step between heights [m] if they are quantised, and otherwise the size of rounding errors."""
    ordered = heights[~np.isnan(heights)]
    ordered.sort()
    # a height is a level of the quantisation if at least this number of points have it
    points_of_window = (2 * _REACH + 1) ** 2
    fewest = ceil(max(_COMMON * ordered.size, points_of_window))
    # Equal heights are neighbours in the sorted array. A position begins `fewest` equal heights if the height at the
    # last of these positions is the same.
    begins_level = ordered[: max(ordered.size - fewest + 1, 0)] == ordered[fewest - 1 :]
    # if more points have the same height, several positions in succession begin the level; only the first one counts
    is_first = begins_level.copy()
    is_first[1:] &= ~begins_level[:-1]
    levels = ordered[: is_first.size][is_first]
    steps = np.diff(levels)
    smallest_step = float(steps.min()) if steps.size else 0.0
    rounding = 1e-9 * max(abs(float(ordered[0])), abs(float(ordered[-1])))
    return max(smallest_step, rounding)


class TooManyUndefined(InputError):
    """Report that a map has more undefined points than may be filled."""


def fill_holes(heights: NDArray, spacing: Pair, periodic: Periodic) -> NDArray:
    """Fill undefined points by the harmonic surface through the points around them.

    Laplace's equation is solved by finite differences with the five-point stencil. The unknowns are the heights of the
    undefined points; the heights of defined points next to a hole are Dirichlet values. A periodic axis continues at
    the opposite border. At a border that is not periodic, the derivative normal to the border is 0. If the points
    around a hole lie in a plane, and the hole does not touch a border, the filled points lie in the same plane. The
    filled heights stay between the lowest and the highest height around a hole (maximum principle), so that no new
    summit appears.

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
    # rows and columns of the unknown heights, and their indices in the map, row by row
    position = np.nonzero(hole)
    index = np.ravel_multi_index(position, hole.shape)
    count = index.size
    # Equation of an unknown height z: the sum of weight · (z − z_neighbour) over its four neighbours is 0. The terms of
    # neighbours with a known height are on the right side.
    laplacian = scipy.sparse.csr_array((count, count))
    right_side = np.zeros(count)
    for axis in (0, 1):
        # the neighbour beyond a periodic border is the point at the opposite border; beyond any other border, it is the
        # point itself
        mode: Any = "wrap" if periodic[axis] else "clip"
        weight = (spacing[0] / spacing[axis]) ** 2
        for step in (-1, 1):
            moved = list(position)
            moved[axis] = position[axis] + step
            neighbour = np.ravel_multi_index((moved[0], moved[1]), hole.shape, mode=mode)
            neighbour_height = heights.ravel()[neighbour]
            is_known = ~np.isnan(neighbour_height)
            right_side[is_known] += weight * neighbour_height[is_known]
            (unknown,) = np.nonzero(~is_known)
            # index of the neighbour among the unknowns, which is the column of its coefficient in the matrix
            column = np.searchsorted(index, neighbour[unknown])
            off_diagonal = scipy.sparse.coo_array(
                (np.full(unknown.size, weight), (unknown, column)), shape=(count, count)
            )
            laplacian += scipy.sparse.diags_array(np.full(count, weight)) - off_diagonal
    filled = heights.copy()
    filled[hole] = scipy.sparse.linalg.spsolve(laplacian.tocsc(), right_side)
    return filled
