"""Measured height maps from files of any kind, in metres and with a known pixel, or refused."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..base import validate
from ..base.errors import InputError
from ..base.machine import free_memory
from ..base.quantities import to_si, to_text
from .formats import READERS, TEXT, Options, Raw, bad_file, read_instrument
from .topography import Topography

#: Smallest and largest size of a measured seal face [m]; beyond them the unit in the file is wrong.
_SIZE_LIMITS = (1e-9, 1.0)
_RMS_HEIGHT_LIMIT = 10e-3
#: Memory that reading takes at least, in sizes of the file: its bytes, and its heights as numbers.
_READING_FACTOR = 2
#: Median slope between neighbouring points that no face exceeds.
_SLOPE_LIMIT = 10.0


def read_topography(
    path: str | os.PathLike[str],
    *,
    size: tuple[float, float] | None = None,
    spacing: tuple[float, float] | None = None,
    height_unit: str | None = None,
    delimiter: str | None = None,
    array: str | None = None,
    channel: int = 0,
    transpose: bool = False,
    periodic: tuple[bool, bool] = (False, False),
) -> Topography:
    """Height map of a file, by its suffix; undefined points as NaN, heights as measured (tilt and all).

    .npy and .npz (heights in metres, pixel from `spacing` in the .npz or the caller), .csv .asc .txt (matrix
    of heights in metres, triplets x y z in metres, Esri raster), .x3p, .sdf; every other kind through SurfaceTopography
    (femseal[surface]). The file's x is x1: a line of a text runs along x1. Arrays of NumPy are taken as they are.
    Size, spacing and unit given by the caller override those of the file, because units in files are sometimes wrong.

    Parameters
    ----------
    path : the file.
    size, spacing : sides or pixel [m] along x1 and x2 of the result, one of them; needed if not in the file.
    height_unit : unit of the numbers in the file, such as "um".
    delimiter : between numbers of a text; found among ; tab , and blanks unless given.
    array : name of the heights in an .npz with several arrays.
    channel : number of the layer or channel in files with several.
    transpose : exchange x and y, so that the lay runs along x2, the seal.
    periodic : whether the face continues periodically along x1 and x2 of the result.

    Raises
    ------
    InputError : no such file, not readable, damaged, no such channel or array, no size or unit; size outside
        1 nm to 1 m, or Sq above 10 mm, unless `size` or `spacing`, or `height_unit`, say so; half of the points steeper
        than 10, unless the caller says both.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError.of(str(path), "a folder" if path.is_dir() else "no such file", "a file with heights")
    suffix = path.suffix.lower()
    if array is not None and suffix != ".npz":
        raise InputError.of("array", repr(array), f"for .npz files only, not {path.name}")
    if delimiter is not None and suffix not in TEXT:
        raise InputError.of("delimiter", repr(delimiter), f"for {', '.join(TEXT)} files only, not {path.name}")
    if channel != 0 and suffix in (".npy", ".npz", *TEXT):
        raise InputError.of("channel", channel, f"for files of instruments only, not {path.name}")
    if size is not None and spacing is not None:
        raise InputError.of("size, spacing", "both", "one of the two")
    length, free = path.stat().st_size, free_memory()
    if _READING_FACTOR * length > free:
        allowed = f"one that can be read in the {free / 1e9:.3g} GB of free memory"
        raise bad_file(path, f"a file of {length / 1e9:.3g} GB", allowed)
    unit = None if height_unit is None else to_si(f"1 {height_unit}", "m", "height_unit")
    try:
        raw = READERS.get(suffix, read_instrument)(path, Options(delimiter, array, channel))
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more heights than fit into memory", "a smaller file, or a part of it") from None

    heights, pixel = raw.heights, raw.spacing
    if transpose:
        heights, pixel = heights.T, pixel and pixel[::-1]
    if spacing is not None:
        pixel = validate.lengths("spacing", spacing)
    elif size is not None:
        length1, length2 = validate.lengths("size", size)
        pixel = (length1 / heights.shape[0], length2 / heights.shape[1])
    if pixel is None:
        given = f"no pixel size in the file ({heights.shape[0]} × {heights.shape[1]} points)"
        raise bad_file(path, given, "two lengths in size= or spacing= (--size '1.2 mm' '0.9 mm', --spacing)")
    if not all(np.isfinite(d) and d > 0 for d in pixel):
        given = f"a pixel of {pixel[0]:g} m × {pixel[1]:g} m"
        raise bad_file(path, given, "two lengths > 0; to correct it, pass spacing= or size= (--spacing, --size)")
    metres = unit or _unit_in_file(path, suffix, raw)
    topography = _checked(path, heights * metres, pixel, periodic)
    _refuse_implausible(path, topography, size is None and spacing is None, height_unit is None)
    return topography


def _unit_in_file(path: Path, suffix: str, raw: Raw) -> float:
    if raw.height_unit is None and suffix not in READERS:
        raise bad_file(path, "no unit of height in the file", "height_unit= such as 'um'")
    return raw.height_unit or 1.0


def _checked(path: Path, heights: np.ndarray, pixel: tuple[float, float], periodic: tuple[bool, bool]) -> Topography:
    try:
        return Topography(heights, pixel, periodic)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _refuse_implausible(path: Path, topography: Topography, check_size: bool, check_heights: bool) -> None:
    """Refuse values that only a wrong unit explains, unless the caller has given them."""
    shortest, longest = _SIZE_LIMITS
    if check_size and not all(shortest <= side <= longest for side in topography.size):
        given = " × ".join(to_text(side, "m") for side in topography.size)
        raise bad_file(path, f"a size of {given}", "1 nm to 1 m; if it is right, or to correct it, pass size= (--size)")
    defined = topography.heights[~np.isnan(topography.heights)]
    if check_heights and defined.size and defined.std() > _RMS_HEIGHT_LIMIT:
        given = f"Sq = {to_text(float(defined.std()), 'm')}"
        allowed = "at most 10 mm; if it is right, or to correct it, pass height_unit= such as 'um' (--height-unit)"
        raise bad_file(path, given, allowed)
    if (check_size or check_heights) and (slope := _median_slope(topography)) > _SLOPE_LIMIT:
        allowed = "at most 10; if it is right, or to correct it, pass size= and height_unit= (--size, --height-unit)"
        raise bad_file(path, f"a slope of {slope:.3g} on half of its points", allowed)


def _median_slope(topography: Topography) -> float:
    """Median of the slope between neighbouring points along the steeper axis; spikes and holes do not count."""
    steps = (np.abs(np.diff(topography.heights, axis=axis)) / topography.spacing[axis] for axis in (0, 1))
    return max((float(np.median(s[~np.isnan(s)])) for s in steps if not np.isnan(s).all()), default=0.0)
