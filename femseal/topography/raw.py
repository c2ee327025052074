"""Define the options for reading a file of heights, and the record of the content of the file."""

import os
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from ..base import FileError, Flags, InputError, Lengths, Pair, Periodic, to_si
from .instrument_limits import UNKNOWN, Instrument

#: Value of `no_data` that says that every number of the file is a height.
NO_VALUE = "none"


@dataclass(frozen=True, eq=False)
class Raw:
    """Content of a file of heights.

    Parameters
    ----------
    heights : array, (n1, n2)
        Numbers as in the file, without conversion of their unit; NaN where undefined.
    height_unit : float, optional
        Unit of the heights [m], for example 1e-6 for micrometres. None if the file does not state the unit.
    spacing : tuple of two float, optional
        Pixel size [m]. None if the file does not state the pixel size.
    needs_unit : bool
        Whether to refuse heights without a unit (True) or take them to be in metres (False).
    mask : array of bool, (n1, n2), optional
        Points that are masked in the file.
    instrument : Instrument
        Limits of the instrument according to the file.
    no_data : tuple of float
        Numbers that mark undefined points according to the header of the file.
    unclear : str
        Text in the file about the unit or the pixel size that could not be interpreted, for messages.
    has_coordinates : bool
        Whether the file states the coordinates of each point, so that the order of its axes is known.
    notes : tuple of str
        Notes on how the file was interpreted where it is ambiguous.
    """

    heights: NDArray
    height_unit: float | None = None
    spacing: Pair | None = None
    needs_unit: bool = False
    mask: Flags | None = None
    instrument: Instrument = UNKNOWN
    no_data: tuple[float, ...] = ()
    unclear: str = ""
    has_coordinates: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reading:
    """Options for reading a file of heights; see `read_topography`."""

    size: Lengths | None = None
    spacing: Lengths | None = None
    height_unit: str | None = None
    delimiter: str | None = None
    array: str | None = None
    channel: int | str = 0
    transpose: bool = False
    mask: str | os.PathLike[str] | None = None
    file_mask: bool = True
    no_data: float | str | None = None
    verify_checksum: bool = True
    crop: tuple[float, float, float, float] | None = None
    periodic: Periodic = (False, False)
    tip_radius: float | None = None
    resolution: float | None = None


def bad_file(path: Path, given: object, allowed: str) -> FileError:
    """Make an error about the content of a file."""
    on_one_line = " ".join(str(given).split())
    return FileError(path, str(path), on_one_line[:200], allowed)


def length_unit(text: str) -> float | None:
    """Convert a unit of length, as it is written in files, to metres; return None if the text is not a unit of length.

    Brackets around the unit and "/pixel" after the unit are ignored. A micro sign may be garbled: "Âµm" was written in
    UTF-8 and read in an older encoding, "æm" comes from DOS.

    Examples
    --------
    >>> length_unit("[µm]"), length_unit("nm/pixel"), length_unit("Âµm"), length_unit("deg")
    (1e-06, 1e-09, 1e-06, None)
    """
    unit = text.strip().strip("[]()<>").strip()
    for suffix in ("/pixel", "/px", "/point", " per pixel"):
        unit = unit.removesuffix(suffix)
    for garbled in ("Âµ", "Î¼", "æ"):
        unit = unit.replace(garbled, "µ")
    if unit == "Å":
        unit = "angstrom"
    if len(unit) > 3:
        # names such as "Microns" are written with or without capitals; symbols such as "Mm" and "mm" differ
        unit = unit.lower()
    if not unit:
        return None
    try:
        return to_si(f"1 {unit}", "m")
    except InputError:
        return None
