"""Measured height maps from files of any kind, in metres and with a known pixel, or refused.

A mask may lie in a file of its own, an image, a text or an array whose points other than 0 are undefined. It lies as
the heights in their file: a line of an image or a text runs along the file's x, the first one at the first y; arrays of
NumPy are taken as they are.
"""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from ..base import Flags, InputError, Pair, Periodic, Shape, as_text, to_si, to_text, validate
from .conditioning import Instrument
from .coordinates import profile_error
from .formats import READERS, read_file, reading
from .instruments import unprinted
from .no_data import without_no_data
from .raw import Raw, Reading, bad_file
from .text_files import TEXT, is_text
from .topography import Topography

log = logging.getLogger("femseal.topography")

#: Smallest and largest size of a measured seal face [m]; beyond them the unit in the file is wrong.
_SIZE_LIMITS = (1e-9, 1.0)
_RMS_HEIGHT_LIMIT = 10e-3
#: Median slope between neighbouring points that no face exceeds.
_SLOPE_LIMIT = 10.0
#: Rows of a map, or a few more, that are looked at.
_ROWS = 256
#: Pixel [m] of a map that is only looked at where nothing says its pixel.
_ANY_PIXEL = (1e-6, 1e-6)
#: Relative difference of units and pixels that are the same.
_SAME = 1e-4
#: Points of a single line that are no profile.
_SHORTEST_PROFILE = 2
#: Files that may hold a mask drawn by a user, besides points that were not measured.
_MASKED = (".gwy", ".npz")


@dataclass(frozen=True)
class Look:
    """A map that is looked at, why `read_topography` refuses it, and the fraction of points masked in the file.

    said : which of pixel and unit of height the file or the caller says.
    notes : sentences on how the file was understood, where that is not obvious.
    """

    topography: Topography
    doubts: tuple[InputError, ...]
    masked_fraction: float
    said: Periodic
    instrument: Instrument
    notes: tuple[str, ...] = ()


def read_topography(path: str | os.PathLike[str], **said: Any) -> Topography:
    """Height map of a file, by its suffix; undefined points as NaN, heights as measured (tilt and all).

    .npy and .npz (heights in metres, pixel from `spacing` in the .npz or the caller); texts .csv .asc .txt .xyz .tsv
    .prn .dat (a matrix of heights, or coordinates x y z on a regular grid, in metres unless their header says another
    unit); .x3p, .sdf; every other kind through SurfaceTopography (femseal[surface]). The file's x is x1: a line of a
    text runs along x1. Arrays of NumPy are taken as they are.
    Size, spacing and unit given by the caller override those of the file, because units in files are sometimes wrong.
    What is assumed of a file is logged.

    Parameters
    ----------
    path : the file.
    size, spacing : sides or pixel [m] along x1 and x2 of the whole map, after `transpose`, one of them; needed if not
        in the file.
    height_unit : unit of the numbers in the file, such as "um".
    delimiter : between numbers of a text; found among ; tab , and blanks unless given.
    array : name of the heights in an .npz with several arrays.
    channel : number or name of the layer or channel in files with several.
    transpose : exchange x and y, so that the lay runs along x2, the seal.
    mask : file whose points other than 0 are undefined, lying as the heights in their file: an image (a line along the
        file's x), a text or a .npy.
    file_mask : whether points under a mask that the file itself holds (.gwy, or `mask` in an .npz) are undefined, or
        have the heights that are stored there.
    no_data : number that stands for points that were not measured, such as -9999; "none": every number is a height.
        Unless given it is what the header says, or a number that is used for that and lies far from all others.
    verify_checksum : whether an .x3p whose checksum is wrong is refused.
    crop : part of the map that is kept: x1 from, x1 to, x2 from, x2 to [m].
    periodic : whether the face continues periodically along x1 and x2 of the result.
    tip_radius, resolution : of the instrument [m], see `Instrument`; the map is read all the same.

    Raises
    ------
    InputError : no such file, not readable, damaged, a profile, points on no grid, no such channel or array, no size or
        unit, many points at one number far from all others, a mask of another size, a part beyond the map; size outside
        1 nm to 1 m, or Sq above 10 mm, unless `size` or `spacing`, or `height_unit`, say so; half of the points steeper
        than 10, unless the caller says both.

    Examples
    --------
    >>> import os, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = os.path.join(folder, "face.npy")
    ...     np.save(path, np.zeros((4, 8)))
    ...     face = read_topography(path, spacing=(1e-6, 2e-6))
    >>> face.shape, face.spacing
    ((4, 8), (1e-06, 2e-06))
    """
    look = read_measured(path, **said)
    for note in look.notes:
        log.warning("%s: %s", path, note)
    return look.topography


def read_measured(path: str | os.PathLike[str], **said: Any) -> Look:
    """The map as of `read_topography`, with what the caller or the file says of its instrument, and notes on it."""
    look = read_for_a_look(path, **said)
    if look.doubts:
        raise look.doubts[0]
    return look


def read_for_a_look(path: str | os.PathLike[str], **said: Any) -> Look:
    """The map, and why `read_topography` refuses it: a pixel of 1 µm and heights in metres where nothing says them.

    Raises InputError: an argument, or a file without heights that can be read.
    """
    path, given = Path(path), Reading(**said)
    _check_options(path, given)
    with reading(path):
        raw = read_file(path, given)
    defined = without_no_data(path, raw.heights, raw.no_data, given.no_data)
    heights, file_mask = defined.heights, raw.mask if given.file_mask else None
    pixel = raw.spacing[::-1] if raw.spacing and given.transpose else raw.spacing
    unit, unclear, needs_unit = raw.height_unit, raw.unclear, raw.needs_unit
    if given.height_unit is not None:
        unit = to_si(f"1 {given.height_unit}", "m", "height_unit")
    notes = (*raw.notes, *defined.notes, *_overridden(raw, given, unit))
    known = {
        name: validate.number(name, limit, unit="m")
        for name in ("tip_radius", "resolution")
        if (limit := getattr(given, name)) is not None
    }
    instrument_of_map = replace(raw.instrument, **known)
    doubts = [*_profile_doubts(path, raw), *defined.doubts]
    del raw, defined  # no more than two maps at once
    if file_mask is not None:
        heights = np.where(file_mask, np.nan, heights)
    if given.mask is not None:
        mask = read_mask(given.mask, (heights.shape[0], heights.shape[1]))
        heights = np.where(mask, np.nan, heights)
    heights = heights.T if given.transpose else heights
    if given.spacing is not None:
        pixel = validate.lengths("spacing", given.spacing)
    elif given.size is not None:
        first, second = validate.lengths("size", given.size)
        pixel = first / heights.shape[0], second / heights.shape[1]
    of_pixel = _pixel_doubts(path, pixel, heights.shape, unclear)
    usable = pixel if pixel and not of_pixel else _ANY_PIXEL
    doubts += of_pixel
    if unit is None and needs_unit:
        found = "no unit of height in the file" + (
            f" that can be read ({unclear})" if unclear else ""
        )
        doubts.append(bad_file(path, found, "height_unit= such as 'um' (--height-unit)"))
    heights = heights if unit is None else heights * unit
    try:
        whole = Topography(heights, usable, given.periodic)  # type: ignore[arg-type]
    except InputError as error:
        raise InputError(f"{path}: {error.what}", error.given, error.expected) from None
    doubts = doubts or [*_implausible(path, whole, given)]
    kept = whole if given.crop is None else whole.crop_to(given.crop)
    masked_fraction = 0.0 if file_mask is None else float(np.mean(file_mask))
    is_said = pixel is not None, unit is not None
    return Look(kept, tuple(doubts), masked_fraction, is_said, instrument_of_map, notes)


def _overridden(raw: Raw, given: Reading, unit: float | None) -> Iterator[str]:
    """Sentences on units and sizes of the caller that differ from those of a file, or stand for unclear ones."""
    found = raw.height_unit
    if given.height_unit is not None and unit is not None:
        if found is None and raw.unclear and raw.needs_unit:
            yield f"height_unit {given.height_unit} is taken; the file has the {raw.unclear}"
        elif found is not None and abs(found / unit - 1) > _SAME:
            yield f"height_unit {given.height_unit} is taken; the file says {to_text(found, 'm')} per number"
    if raw.spacing is None or (given.spacing is None and given.size is None):
        return
    n1, n2 = raw.heights.shape
    there = raw.spacing[::-1] if given.transpose else raw.spacing
    if given.transpose:
        n1, n2 = n2, n1
    here = given.spacing
    if given.size is not None:
        first, second = validate.lengths("size", given.size)
        here = first / n1, second / n2
    chosen = validate.lengths("spacing", here)
    if any(abs(a / b - 1) > _SAME for a, b in zip(there, chosen, strict=True)):
        name = "spacing" if given.size is None else "size"
        yield f"{name} is taken, a pixel of {as_text(chosen, 'm')}; the file says {as_text(there, 'm')}"


def _check_options(path: Path, given: Reading) -> None:
    """Raise InputError if there is no such file, or if it is of a kind that an option is not for."""
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise InputError(str(path), found, "a file with heights")
    suffix, has_text = path.suffix.lower(), is_text(path)
    for name, kinds, fits in (
        ("array", ".npz files", suffix == ".npz"),
        ("delimiter", f"{', '.join(TEXT)} files", has_text),
        ("file_mask", f"{', '.join(_MASKED)} files", suffix in _MASKED),
        ("channel", "files of instruments", suffix not in (".npy", ".npz") and not has_text),
        ("verify_checksum", ".x3p files", suffix == ".x3p"),
    ):
        value = getattr(given, name)
        if value != getattr(Reading, name) and not fits:
            raise InputError(name, repr(value), f"for {kinds} only, not {path.name}")
    if given.size is not None and given.spacing is not None:
        raise InputError("size, spacing", "both", "one of the two")


def _profile_doubts(path: Path, raw: Raw) -> list[InputError]:
    """What is wrong with a map of a single line."""
    if 1 not in raw.heights.shape or raw.heights.size <= _SHORTEST_PROFILE:
        return []
    error = profile_error(raw.heights.ravel(), "a single line")
    return [bad_file(path, error.given, error.expected)]


def _pixel_doubts(
    path: Path, pixel: Pair | None, shape: tuple[int, ...], unclear: str
) -> list[InputError]:
    """What is wrong with the pixel of a map; `unclear` is what the file says that cannot be read."""
    if pixel is None:
        says = f"; it says {unclear}" if unclear else ""
        found = f"no pixel size in the file ({as_text(shape)} points{says})"
        allowed = "two lengths in size= or spacing= (--size '1.2 mm' '0.9 mm', --spacing)"
    elif all(0 < d < inf for d in pixel):
        return []
    else:
        found = f"a pixel of {pixel[0]:g} m × {pixel[1]:g} m"
        allowed = "two lengths > 0; to correct it, pass spacing= or size= (--spacing, --size)"
    return [bad_file(path, found, allowed)]


def _implausible(path: Path, topography: Topography, given: Reading) -> Iterator[InputError]:
    """Values that only a wrong unit explains, unless the caller has given them: the slope where the others suit."""
    open_size = given.size is None and given.spacing is None
    open_unit = given.height_unit is None
    correct, (shortest, longest) = "if it is right, or to correct it, pass", _SIZE_LIMITS
    fine = True
    if open_size and not all(shortest <= side <= longest for side in topography.size):
        allowed = f"1 nm to 1 m; {correct} size= (--size)"
        yield bad_file(path, f"a size of {as_text(topography.size, 'm')}", allowed)
        fine = False
    z = topography.heights[:: max(1, topography.shape[0] // _ROWS)]
    defined = z[~np.isnan(z)]
    with np.errstate(over="ignore"):
        deviation = float(defined.std()) if defined.size else 0.0
    if open_unit and deviation > _RMS_HEIGHT_LIMIT:
        allowed = f"at most 10 mm; {correct} height_unit= such as 'um' (--height-unit)"
        yield bad_file(path, f"Sq = {to_text(deviation, 'm')}", allowed)
        fine = False
    if fine and (open_size or open_unit) and (slope := _median_slope(topography)) > _SLOPE_LIMIT:
        allowed = f"at most 10; {correct} size= and height_unit= (--size, --height-unit)"
        yield bad_file(path, f"a slope of {slope:.3g} on half of its points", allowed)


def _median_slope(topography: Topography) -> float:
    """Median of the slope between neighbouring points along the steeper axis; spikes and holes do not count."""
    found = [0.0]
    maps = topography.heights.T, topography.heights
    for z, spacing in zip(maps, topography.spacing, strict=True):
        slopes = np.abs(np.diff(z[:: max(1, len(z) // _ROWS)], axis=1)) / spacing
        defined = slopes[~np.isnan(slopes)]
        if defined.size:
            found.append(float(np.median(defined)))
    return max(found)


#: Suffixes of images, which keep every point as it was drawn.
_IMAGES = (".png", ".tif", ".tiff", ".bmp", ".gif")
_ARRAYS = (".npy", *TEXT)


def read_mask(path: str | os.PathLike[str], shape: Shape) -> Flags:
    """Undefined points (n1, n2) of a map, true where the file is not 0.

    path : .png .tif .bmp .gif (any colour but black is not 0; transparency is left out), .npy, .csv .asc .txt.
    shape : of the heights as they lie in their file, x first.

    Raises InputError: no such file, another kind, not readable, or not of the shape.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError("mask", f"'{path}', no such file", "a file")
    if suffix not in (*_IMAGES, *_ARRAYS):
        raise InputError("mask", f"'{path.name}'", f"a file {', '.join((*_IMAGES, *_ARRAYS))}")
    with reading(path):
        found = (_read_image if suffix in _IMAGES else READERS[suffix])(path, Reading()).heights
    if found.shape != shape:
        turned = "; turned by its diagonal it would fit" if found.shape == shape[::-1] else ""
        allowed = f"{as_text(shape)}, as in the file of the heights, x first{turned}"
        raise InputError("mask", f"{as_text(found.shape)} points in '{path.name}'", allowed)
    return found != 0


def _read_image(path: Path, said: Reading) -> Raw:
    """The brightest colour of each point."""
    from PIL import Image

    with unprinted(), Image.open(path) as image:
        has_colours = image.mode in ("P", "PA", "LA", "RGBA", "CMYK")
        pixels = np.asarray(image.convert("RGB") if has_colours else image)
    return Raw((pixels.max(axis=2) if pixels.ndim == 3 else pixels).T)
