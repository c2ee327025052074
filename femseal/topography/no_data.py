"""Find the numbers in a file that mark undefined points.

Some programs write one number, such as −9999, for every point that was not measured. If the file or the caller states
the number, all points with the number are undefined.

If neither states a number, the number is recognised by a property that no measured surface has: many points have
exactly the highest or the lowest number of the map, and this number is far from all others. A recognised number that
programs commonly write for undefined points, such as −9999 or 32767, is treated as undefined, and a note says so. Any
other recognised number, such as 0, may be a real height, for example the height of a flat bottom. Only the user knows
whether the number is a height. The file is then refused, and the error message says how to state whether the number is
a height.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, as_text, counted
from .form_fit import fit_form
from .raw import NO_VALUE, bad_file

#: Numbers that programs write where nothing was measured.
_MARKS = {
    *(sign * (10**n - 1) for sign in (1, -1) for n in (3, 4, 5, 6, 7)),
    *(sign * 2**n - k for sign in (1, -1) for n in (15, 31) for k in (-1, 0, 1)),
    99999.9999, -99999.9999, 65535, 2147483640, 1000001,
}  # fmt: skip
#: A number of this magnitude or more is not a height in any unit.
_NO_HEIGHT = 1e30
#: Smallest number of points, and smallest fraction of all points, that share a suspicious number.
_FEWEST, _FRACTION = 10, 1e-4
#: Smallest distance of a suspicious number from all others, in rms heights of the surface.
_DEVIATIONS = 5.0
#: Smallest distance of a suspicious number from all others, as a fraction of their range.
_PART_OF_RANGE = 0.1
#: About this many rows of a map are examined.
_ROWS = 256
#: Smallest number of different heights of a surface. A map with fewer numbers contains classes or levels.
_DIFFERENT = 10
#: Largest number of different values that mark undefined points in one file.
_MOST = 4


@dataclass(frozen=True, eq=False)
class Defined:
    """Heights of a file in which undefined points are NaN.

    Parameters
    ----------
    heights : array, (n1, n2)
        Heights, NaN where undefined.
    notes : tuple of str
        Notes on the points that were treated as undefined.
    errors : tuple of InputError
        Errors about numbers that may be heights or may mark undefined points; only the user can decide which.
        `read_topography` raises the first of these errors.
    """

    heights: NDArray
    notes: tuple[str, ...] = ()
    errors: tuple[InputError, ...] = ()


def mark_undefined_points(
    path: Path, heights: NDArray, file_marks: Sequence[float], given: float | str | None
) -> Defined:
    """Mark the undefined points of a map as NaN.

    Parameters
    ----------
    path : Path
        The file, for messages.
    heights : array, (n1, n2)
        Numbers in the file.
    file_marks : sequence of float
        Numbers that mark undefined points according to the file itself.
    given : float or str, optional
        Number that, according to the caller, marks undefined points; "none" if every number is a height. If None, the
        numbers in `file_marks` mark undefined points, and the function also searches for further marks.

    Raises
    ------
    InputError
        `given` is neither a number nor "none".
    """
    if given == NO_VALUE or not heights.size:
        return Defined(heights)
    if given is not None:
        heights, notes = _mark_numbers(heights, [_check_number(given)], "no_data says")
        return Defined(heights, tuple(notes))
    heights, notes = _mark_numbers(heights, file_marks, "the file says")
    for _ in range(_MOST):
        value = _find_suspicious_number(heights)
        if value is None:
            break
        has_value = heights == value
        others = heights[~has_value & ~np.isnan(heights)]
        description = (
            f"{_points(has_value)} at exactly {value:g}, far from all others, {others.min():.4g} to "
            f"{others.max():.4g}"
        )
        if not _is_mark(value):
            expected = (
                f"heights. With no_data={value:g} (--no-data {value:g}) such points count as not "
                "measured, with no_data='none' (--no-data none) as heights"
            )
            error = bad_file(path, description, expected)
            return Defined(heights, tuple(notes), (error,))
        heights = np.where(has_value, np.nan, heights)
        notes.append(f"{description}: taken for undefined; no_data = 'none' keeps them as heights")
    return Defined(heights, tuple(notes))


def _mark_numbers(
    heights: NDArray, numbers: Sequence[float], source: str
) -> tuple[NDArray, list[str]]:
    """Replace given numbers by NaN; return the heights and a note for each number that occurs in the map.

    source : source of the claim that the numbers mark undefined points, such as "the file says", for the notes.
    """
    notes = []
    for number in numbers:
        has_number = np.isclose(heights, number, rtol=1e-6, atol=0)
        if has_number.any():
            heights = np.where(has_number, np.nan, heights)
            notes.append(f"{_points(has_number)} at {number:g}: undefined, as {source}")
    return heights, notes


def _check_number(given: float | str) -> float:
    """Convert the option `no_data`, a number or a text, to a number; raise InputError for any other value."""
    try:
        value = float(given)
    except (TypeError, ValueError):
        value = np.nan
    if not np.isfinite(value):
        expected = "a number, or 'none' where every number is a height"
        raise InputError("no_data", repr(given), expected)
    return value


def _points(flags: NDArray) -> str:
    """Format the number and the percentage of points that are True."""
    fraction = as_text(float(flags.mean()), percent=True)
    return f"{counted(np.count_nonzero(flags), 'point')} ({fraction})"


def _is_mark(value: float) -> bool:
    """Return whether programs commonly write a number for undefined points."""
    return abs(value) >= _NO_HEIGHT or any(np.isclose(value, mark, rtol=1e-7) for mark in _MARKS)


def _find_suspicious_number(heights: NDArray) -> float | None:
    """Return the number that probably marks undefined points in a map; None if there is none.

    Only the lowest and the highest number of the map are tested. A number probably marks undefined points if it is far
    from all other numbers in the map and either occurs at many points or is commonly written by programs for this
    purpose.
    """
    lowest = float(np.fmin.reduce(heights, axis=None))
    highest = float(np.fmax.reduce(heights, axis=None))
    for value, sign in ((lowest, 1), (highest, -1)):
        count = int(np.count_nonzero(heights == value))
        is_shared = count >= max(_FEWEST, _FRACTION * heights.size)
        if not is_shared and not _is_mark(value):
            continue
        if _is_far(heights, value, sign, is_shared=is_shared):
            return value
    return None


def _is_far(heights: NDArray, value: float, sign: int, *, is_shared: bool) -> bool:
    """Return whether the lowest number of a map (sign 1), or the highest number (sign -1), is far from all others.

    is_shared : whether many points have this number. If only a few points have the number, its distance to the next
    number must exceed the range of all other numbers.
    """
    # for the highest number the map is turned upside down, so that the number is the lowest in both cases
    upwards = sign * heights
    lowest = sign * value
    nearest = float(np.min(upwards, initial=np.inf, where=upwards > lowest))
    farthest = float(np.fmax.reduce(upwards, axis=None))
    # the distance must be large compared with the range of all other numbers
    distance = nearest - lowest
    range_of_others = farthest - nearest
    least_distance = (_PART_OF_RANGE if is_shared else 1.0) * range_of_others
    if not np.isfinite(distance) or not distance > least_distance:
        return False
    # the other numbers must be heights of a surface, and not a few levels
    sample = upwards[:: max(1, len(heights) // _ROWS)]
    others = np.where(sample == lowest, np.nan, sample)
    different_heights = np.unique(others[~np.isnan(others)]).size
    if different_heights < (_DIFFERENT if is_shared else 2):
        return False
    # the distance must be large compared with the rms height without the tilt
    roughness = others - fit_form(others, (1.0, 1.0), 1).heights
    return bool(distance > _DEVIATIONS * np.nanstd(roughness))
