"""Read measured height maps from files of any kind; refuse maps whose unit or pixel size is unknown or implausible.

A mask of undefined points may be given in a separate file, see `masks`.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import (
    FileError,
    Flags,
    InputError,
    Pair,
    as_text,
    to_si,
    to_text,
    validate,
)
from .coordinates import SHORTEST_PROFILE, profile_error
from .formats import read_file, reading
from .instrument_limits import Instrument
from .masks import read_mask
from .no_data import mark_undefined_points
from .plausible_units import implausible_values
from .raw import Raw, Reading, bad_file
from .text_files import TEXT, is_text
from .topography import Topography

log = logging.getLogger("femseal.topography")

#: Pixel size [m] that replaces an unknown pixel size if a map is only inspected.
_ANY_PIXEL = (1e-6, 1e-6)
#: Largest relative difference of units and pixel sizes that count as equal.
_SAME = 1e-4
#: Suffixes of files that may contain a mask.
_MASKED = (".gwy", ".npz")


@dataclass(frozen=True)
class Look:
    """A map for inspection, and the reasons why `read_topography` would refuse it, if there are any.

    Parameters
    ----------
    topography : Topography
        The map.
    errors : tuple of InputError
        Reasons why `read_topography` refuses the map; empty if it accepts the map.
    masked_fraction : float
        Fraction of points that are masked in the file.
    is_known : tuple of two bool
        Whether the pixel size and the unit of height, respectively, are known from the file or from the caller.
    instrument : Instrument
        Limits of the instrument according to the file and the caller.
    has_coordinates : bool
        Whether the file states the coordinates of each point, so that the order of its axes is known.
    notes : tuple of str
        Notes on how the file was interpreted where it is ambiguous.
    """

    topography: Topography
    errors: tuple[InputError, ...]
    masked_fraction: float
    is_known: tuple[bool, bool]
    instrument: Instrument
    has_coordinates: bool
    notes: tuple[str, ...] = ()


def read_topography(path: str | os.PathLike[str], **options: Any) -> Topography:
    """Read a height map from a file.

    The returned map contains the heights as measured, including their tilt. Undefined points are NaN. The suffix
    determines the format:

    - .npy and .npz: heights in metres. The pixel size comes from an array `spacing` in the .npz file or from the
      caller.
    - .csv .asc .txt .xyz .tsv .prn .dat: texts with a matrix of heights, or coordinates x y z on a regular grid, in
      metres unless the header states another unit.
    - .x3p and .sdf.
    - every other format through SurfaceTopography (femseal[surface]).

    The x axis of the file becomes x1; in a text file, the points of a line lie along x. NumPy arrays are not
    transposed. A size, spacing or unit given by the caller overrides the one in the file, because files sometimes
    contain wrong units. Assumptions about the file are logged.

    Parameters
    ----------
    path : path
        The file.
    size, spacing : float or tuple of two float, optional
        Sides of the whole map, or pixel size, along x1 and x2 after `transpose` [m]. If the file does not contain the
        pixel size, the caller must give either `size` or `spacing`.
    height_unit : str, optional
        Unit of the numbers in the file, such as "um".
    delimiter : str, optional
        Separator of the numbers of a text. Default: the separator is recognised (semicolon, tab, comma or blanks).
    array : str, optional
        Name of the heights in an .npz file with several arrays.
    channel : int or str
        Number or name of the layer or channel, for files that contain several layers or channels.
    transpose : bool
        Whether to exchange x and y. The lay should run along x2, which is the direction along the seal.
    mask : path, optional
        File that marks undefined points by values other than 0: an image, a text or a .npy file with the same
        orientation as the file of the heights.
    file_mask : bool
        Whether to treat points as undefined where a mask in the file itself (.gwy, or `mask` in an .npz) marks them. If
        False, masked points have the heights that the file contains.
    no_data : float or "none", optional
        Number that marks points that were not measured, such as -9999. "none" states that every number in the file is a
        height. Default: the number stated in the header of the file. If the header states no number, a number is taken
        as such a mark if programs commonly write it for undefined points and it is far from all other numbers.
    verify_checksum : bool
        Whether to refuse an .x3p file with a wrong checksum.
    crop : tuple of four float, optional
        Part of the map that is returned: start and end along x1, start and end along x2 [m].
    periodic : tuple of two bool
        Whether the returned map is periodic along x1 and x2.
    tip_radius, resolution : float, optional
        Tip radius and lateral resolution of the instrument [m], see `Instrument`. Tip radius and resolution do not
        change the heights.

    Returns
    -------
    Topography
        The map.

    Raises
    ------
    InputError
        The file cannot be read, contains a profile, or contains points that are not on a grid. An InputError is also
        raised if the pixel size or the unit is unknown, if many points have the same number, which is far from all
        other numbers, or if the mask or the crop does not fit the map.

        Implausible maps are also refused: sides outside 1 nm to 1 m (unless the caller gives `size` or `spacing`), an
        Sq above 10 mm (unless the caller gives `height_unit`), and slopes above 10 at half of the points (unless the
        caller gives both the size and the unit).

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
    look = read_measured(path, **options)
    for note in look.notes:
        log.warning("%s: %s", path, note)
    return look.topography


def read_measured(path: str | os.PathLike[str], **options: Any) -> Look:
    """Read a map like `read_topography`; return it together with its instrument and the notes on the file."""
    look = read_for_a_look(path, **options)
    if look.errors:
        raise look.errors[0]
    return look


def read_for_a_look(path: str | os.PathLike[str], **options: Any) -> Look:
    """Read a map even if `read_topography` would refuse it, and return the reasons for refusing it.

    An unknown pixel size is replaced by 1 µm, and an unknown unit of height by metres.

    Raises
    ------
    InputError
        An option is invalid, or the file contains no heights that can be read.
    """
    path = Path(path)
    given = Reading(**options)
    _check_options(path, given)
    with reading(path):
        raw = read_file(path, given)
    defined = mark_undefined_points(path, raw.heights, raw.no_data, given.no_data)
    # the unit of the caller overrides the unit of the file
    height_unit = raw.height_unit
    if given.height_unit is not None:
        height_unit = to_si(f"1 {given.height_unit}", "m", "height_unit")
    notes = (*raw.notes, *defined.notes, *_notes_on_overrides(raw, given, height_unit))
    instrument = _combine_instruments(raw.instrument, given)
    errors = [*_profile_errors(path, raw), *defined.errors]
    file_mask = raw.mask if given.file_mask else None
    masked_fraction = 0.0 if file_mask is None else float(np.mean(file_mask))
    heights = _apply_masks(defined.heights, file_mask, given)
    pixel = _pixel_size(raw.spacing, given, heights.shape)
    unclear, needs_unit, has_coordinates = raw.unclear, raw.needs_unit, raw.has_coordinates
    del raw, defined, file_mask  # so that at most two arrays as large as the map are in memory

    # heights in metres, and a pixel size, even if the file states neither unit nor pixel size
    pixel_errors = _pixel_errors(path, pixel, heights.shape, unclear)
    errors += pixel_errors
    if height_unit is None and needs_unit:
        errors.append(_unknown_unit(path, unclear))
    if height_unit is not None:
        heights = heights * height_unit
    usable_pixel = pixel if pixel and not pixel_errors else _ANY_PIXEL
    try:
        topography = Topography(heights, usable_pixel, given.periodic)
    except InputError as error:
        raise FileError(path, f"{path}: {error.what}", error.given, error.expected) from None
    if not errors:
        errors = [*implausible_values(path, topography, given)]
    if given.crop is not None:
        topography = topography.crop_to(given.crop)
    is_known = pixel is not None, height_unit is not None
    return Look(
        topography, tuple(errors), masked_fraction, is_known, instrument, has_coordinates, notes
    )


def _combine_instruments(file_instrument: Instrument, given: Reading) -> Instrument:
    """Return the limits of the instrument; limits from the caller replace limits from the file."""
    lengths = {}
    for name in ("tip_radius", "resolution"):
        length = getattr(given, name)
        if length is not None:
            lengths[name] = validate.number(name, length, unit="m")
    return replace(file_instrument, **lengths)


def _apply_masks(heights: NDArray, file_mask: Flags | None, given: Reading) -> NDArray:
    """Mark masked points as NaN, and exchange the axes if the option `transpose` is set."""
    if file_mask is not None:
        heights = np.where(file_mask, np.nan, heights)
    if given.mask is not None:
        mask = read_mask(given.mask, (heights.shape[0], heights.shape[1]))
        heights = np.where(mask, np.nan, heights)
    return heights.T if given.transpose else heights


def _pixel_size(file_pixel: Pair | None, given: Reading, shape: tuple[int, ...]) -> Pair | None:
    """Return the pixel size along x1 and x2 [m], from the caller if given and otherwise from the file.

    file_pixel : pixel size along x and y of the file [m].
    shape : number of points of the map along x1 and x2, after `transpose`.
    """
    if given.spacing is not None:
        return validate.lengths("spacing", given.spacing)
    if given.size is not None:
        first, second = validate.lengths("size", given.size)
        return first / shape[0], second / shape[1]
    if file_pixel and given.transpose:
        return file_pixel[1], file_pixel[0]
    return file_pixel


def _notes_on_overrides(raw: Raw, given: Reading, height_unit: float | None) -> Iterator[str]:
    """Yield a note if a unit or size given by the caller differs from the file's or replaces an unreadable one."""
    if given.height_unit is not None and height_unit is not None:
        file_unit = raw.height_unit
        if file_unit is None and raw.unclear and raw.needs_unit:
            yield f"height_unit {given.height_unit} is used; the file has the {raw.unclear}"
        elif file_unit is not None and abs(file_unit / height_unit - 1) > _SAME:
            yield (
                f"height_unit {given.height_unit} overrides the file, which says "
                f"{to_text(file_unit, 'm')} per number"
            )
    if raw.spacing is None or (given.spacing is None and given.size is None):
        return
    n1, n2 = raw.heights.shape
    file_pixel = raw.spacing
    if given.transpose:
        n1, n2 = n2, n1
        file_pixel = file_pixel[1], file_pixel[0]
    # the pixel size that the caller gives, directly or by the sides of the map
    pixel = _pixel_size(None, given, (n1, n2))
    assert pixel is not None
    if any(abs(a / b - 1) > _SAME for a, b in zip(file_pixel, pixel, strict=True)):
        name = "spacing" if given.size is None else "size"
        yield (
            f"{name} overrides the file, which says a pixel of {as_text(file_pixel, 'm')}: it is "
            f"{as_text(pixel, 'm')}"
        )


def _check_options(path: Path, given: Reading) -> None:
    """Raise InputError if the file does not exist, or if an option does not apply to this kind of file."""
    if not path.is_file():
        problem = "a folder" if path.is_dir() else "no such file"
        raise FileError(path, str(path), problem, "a file with heights")
    suffix = path.suffix.lower()
    has_text = is_text(path)
    is_array = suffix in (".npy", ".npz")
    # option, kind of files to which it applies, whether it applies to this file
    applicable = (
        ("array", ".npz files", suffix == ".npz"),
        ("delimiter", f"{', '.join(TEXT)} files", has_text),
        ("file_mask", f"{', '.join(_MASKED)} files", suffix in _MASKED),
        ("channel", "files of instruments", not is_array and not has_text),
        ("verify_checksum", ".x3p files", suffix == ".x3p"),
    )
    for option, files, applies in applicable:
        value = getattr(given, option)
        is_default = value == getattr(Reading, option)
        if not is_default and not applies:
            raise InputError(option, repr(value), f"for {files} only, not {path.name}")
    if given.size is not None and given.spacing is not None:
        raise InputError("size, spacing", "both", "one of the two")


def _profile_errors(path: Path, raw: Raw) -> list[InputError]:
    """Return a list with an error if the map is a single line; otherwise an empty list."""
    if 1 not in raw.heights.shape or raw.heights.size < SHORTEST_PROFILE:
        return []
    error = profile_error(raw.heights.ravel(), "a single line")
    return [bad_file(path, error.given, error.expected)]


def _pixel_errors(
    path: Path, pixel: Pair | None, shape: tuple[int, ...], unclear: str
) -> list[InputError]:
    """Return a list with an error if the pixel size is unknown or not positive; otherwise an empty list.

    unclear : text in the file about the unit that could not be interpreted.
    """
    if pixel is None:
        hint = f"; it says {unclear}" if unclear else ""
        given = f"no pixel size in the file ({as_text(shape)} points{hint})"
        expected = "two lengths in size= or spacing= (--size '1.2 mm' '0.9 mm', --spacing)"
        return [bad_file(path, given, expected)]
    if all(0 < d < inf for d in pixel):
        return []
    given = f"a pixel of {pixel[0]:g} m × {pixel[1]:g} m"
    expected = "two lengths > 0; to correct it, pass spacing= or size= (--spacing, --size)"
    return [bad_file(path, given, expected)]


def _unknown_unit(path: Path, unclear: str) -> InputError:
    """Make the InputError for a file whose unit of height is unknown.

    unclear : text in the file about the unit that could not be interpreted.
    """
    given = "no unit of height in the file"
    if unclear:
        given += f" that can be read ({unclear})"
    return bad_file(path, given, "height_unit= such as 'um' (--height-unit)")
