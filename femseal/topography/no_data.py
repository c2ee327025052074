"""Numbers of a file that stand for undefined points.

Some programs write one number for every point that was not measured, such as −9999. Where the file names it, or the
caller does, it is undefined. Otherwise it is recognised by what no measured face has: many points at exactly the
highest or lowest number of the map, far from all others. A number by which programs mark such points, such as −9999
or 32767, is taken for undefined, and a sentence says so. Any other number, such as 0, may be a stop, a flat bottom or
an upper edge, and only the user knows: it is an error that says how to decide.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, as_text, counted
from .defects import fit_form
from .raw import NO_VALUE, bad_file

#: Numbers that programs write where nothing was measured.
_MARKS = {
    *(sign * (10**n - 1) for sign in (1, -1) for n in (3, 4, 5, 6, 7)),
    *(sign * 2**n - k for sign in (1, -1) for n in (15, 31) for k in (-1, 0, 1)),
    99999.9999, -99999.9999, 65535, 2147483640, 1000001,
}  # fmt: skip
#: From this magnitude on a number is no height in any unit.
_NO_HEIGHT = 1e30
#: Fewest points, and fraction of all, that share a number which is not one of those.
_FEWEST, _FRACTION = 10, 1e-4
#: The number lies farther from all others than this many rms heights of the face, and this fraction of its range.
_DEVIATIONS, _PART_OF_RANGE = 5.0, 0.1
#: Rows that are looked at, different heights that a face has at least, and numbers that may stand for undefined ones.
_ROWS, _DIFFERENT, _MOST = 256, 10, 4


@dataclass(frozen=True, eq=False)
class Defined:
    """Heights with NaN where undefined, with sentences on that, and what the user has to decide."""

    heights: NDArray
    notes: tuple[str, ...] = ()
    doubts: tuple[InputError, ...] = ()


def without_no_data(
    path: Path, heights: NDArray, named: Sequence[float], given: float | str | None
) -> Defined:
    """Heights whose undefined points are NaN.

    Parameters
    ----------
    path : of the file, for messages.
    heights : numbers of the file (n1, n2).
    named : numbers that the file says are undefined points.
    given : number that the caller says is; "none" if every number is a height; None to look for it.

    Raises InputError: `given` is neither.
    """
    if given == NO_VALUE or not heights.size:
        return Defined(heights)
    if given is not None:
        named = (_checked(given),)
    notes = []
    for number in named:
        is_value = np.isclose(heights, number, rtol=1e-6, atol=0)
        if is_value.any():
            heights = np.where(is_value, np.nan, heights)
            source = "no_data says" if given is not None else "the file says"
            notes.append(f"{_points(is_value)} at {number:g}: undefined, as {source}")
    if given is not None:
        return Defined(heights, tuple(notes))
    for _ in range(_MOST):
        value = _stray(heights)
        if value is None:
            break
        is_value = heights == value
        rest = heights[~is_value & ~np.isnan(heights)]
        found = f"{_points(is_value)} at exactly {value:g}, far from all others, {rest.min():.4g} to {rest.max():.4g}"
        if not _is_mark(value):
            expected = (
                f"heights: no_data={value:g} (--no-data {value:g}) takes such points for not measured, "
                "no_data='none' (--no-data none) for part of the face"
            )
            return Defined(heights, tuple(notes), (bad_file(path, found, expected),))
        heights = np.where(is_value, np.nan, heights)
        notes.append(f"{found}: taken for undefined; no_data = 'none' keeps them as heights")
    return Defined(heights, tuple(notes))


def _checked(given: float | str) -> float:
    """The number that a caller gives, also as text."""
    try:
        value = float(given)
    except (TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value):
        raise InputError(
            "no_data", repr(given), "a number, or 'none' where every number is a height"
        )
    return value


def _points(flags: NDArray) -> str:
    """A number of points with their fraction."""
    return f"{counted(np.count_nonzero(flags), 'point')} ({as_text(float(flags.mean()), percent=True)})"


def _is_mark(value: float) -> bool:
    return abs(value) >= _NO_HEIGHT or any(np.isclose(value, mark, rtol=1e-7) for mark in _MARKS)


def _stray(heights: NDArray) -> float | None:
    """The lowest or highest number of a map if points share it and it is far from all others; else None."""
    lowest, highest = np.fmin.reduce(heights, axis=None), np.fmax.reduce(heights, axis=None)
    for value, sign in ((float(lowest), 1), (float(highest), -1)):
        count = int(np.count_nonzero(heights == value))
        is_shared = count >= max(_FEWEST, _FRACTION * heights.size)
        if (is_shared or _is_mark(value)) and _is_far(heights, value, sign, is_shared=is_shared):
            return value
    return None


def _is_far(heights: NDArray, value: float, sign: int, *, is_shared: bool) -> bool:
    """Whether the lowest number of a map (`sign` 1), or the highest (-1), is far from all others.

    is_shared : by many points; the number of a few is farther away than all others are from each other.
    """
    upwards = sign * heights
    nearest = float(np.min(upwards, initial=np.inf, where=upwards > sign * value))
    farthest = float(np.fmax.reduce(upwards, axis=None))
    gap, extent = nearest - sign * value, farthest - nearest
    if not gap > (_PART_OF_RANGE if is_shared else 1.0) * extent or not np.isfinite(gap):
        return False
    sample = upwards[:: max(1, len(heights) // _ROWS)]
    rest = np.where(sample == sign * value, np.nan, sample)
    if np.unique(rest[~np.isnan(rest)]).size < (_DIFFERENT if is_shared else 2):
        return False  # a map of a few levels
    return bool(gap > _DEVIATIONS * np.nanstd(rest - fit_form(rest, (1.0, 1.0), 1).heights))
