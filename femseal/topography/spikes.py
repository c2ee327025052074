"""Spikes of a measured map: isolated points far above or below their surroundings, an artefact of confocal instruments.

Symbols: z heights [m], m median of z in a window of 5 × 5 points, s = 1.4826 MAD, the robust standard deviation
about m in that window.
Source: the Hampel identifier, Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782, with a test of isolation.
"""

from __future__ import annotations

from math import inf

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base import validate
from .form import fit_form

#: A point is far off where |z − m| > SPIKES · s.
SPIKES = 6.0
#: More points than this side by side are no spike but a feature of the face.
MOST_POINTS = 4
_REACH = 2
#: Fraction of the points, and no less than a window of them, that lie at one height where data is quantised.
_COMMON = 1e-3
_ALL_NEIGHBOURS = np.ones((3, 3))


def find_spikes(heights: NDArray, threshold: float = SPIKES) -> NDArray[np.bool_]:
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
    scale = np.maximum(1.4826 * np.maximum(deviation, np.nanmedian(deviation)), _height_step(heights))
    groups, _ = scipy.ndimage.label(np.abs(off) > threshold * scale, _ALL_NEIGHBOURS)
    spikes = np.zeros(heights.shape, dtype=bool)
    for number, place in enumerate(scipy.ndimage.find_objects(groups), start=1):
        around = tuple(slice(max(part.start - 1, 0), part.stop + 1) for part in place)
        group = groups[around] == number
        if np.count_nonzero(group) <= MOST_POINTS and _stands_alone(group, flat[around], median[around]):
            spikes[around] |= group
    return spikes


def _stands_alone(group: NDArray[np.bool_], flat: NDArray, median: NDArray) -> bool:
    """Whether no point around `group` goes half as far from the median at its tip as the tip does."""
    tip = np.unravel_index(np.argmax(np.where(group, np.abs(flat - median), -1.0)), group.shape)
    rim = scipy.ndimage.binary_dilation(group, _ALL_NEIGHBOURS) & ~group
    height = flat[tip] - median[tip]
    follows = (flat[rim] - median[tip]) / height > 0.5  # False where undefined
    return not bool(follows.any())


def _window_medians(z: NDArray, rows: int = 64) -> tuple[NDArray, NDArray]:
    """Median (n1, n2) of the defined points in the window of each point, and of their distances from it.

    By blocks of `rows`, since all windows at once are 25 maps.
    """
    side = 2 * _REACH + 1
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(z, _REACH, constant_values=np.nan), (side, side))
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
    return (ordered[row, np.maximum(count - 1, 0) // 2] + ordered[row, np.minimum(count // 2, count.max() - 1)]) / 2


def _height_step(heights: NDArray) -> float:
    """Step between heights that many points have, as in quantised data; no less than rounding [m]."""
    values, count = np.unique(heights[~np.isnan(heights)], return_counts=True)
    steps = np.diff(values[count >= max(_COMMON * count.sum(), 25)])
    return max(float(steps.min()) if steps.size else 0.0, 1e-9 * float(np.abs(values).max()))
