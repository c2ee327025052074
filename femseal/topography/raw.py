"""What a reader of a file of heights gets from the caller, and what it gives back."""

import os
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from ..base import Flags, InputError, Lengths, Pair, Periodic, to_si
from .conditioning import UNKNOWN, Instrument

#: In place of a number: no value of the file stands for undefined points.
NO_VALUE = "none"


@dataclass(frozen=True, eq=False)
class Raw:
    """What a file holds.

    heights : (n1, n2), numbers as they stand in the file, NaN where undefined.
    height_unit : metres per number, None where the file does not say it.
    needs_unit : whether numbers without a unit are not in metres: files of this kind say it, or it cannot be read.
    spacing : pixel [m], None where the file does not say it.
    mask : points that are masked in the file (n1, n2).
    instrument : what the file says of it.
    no_data : numbers that stand for undefined points by the header of the file.
    unclear : what the file says of its unit or pixel that cannot be read, as text for a message.
    notes : sentences on how the file was understood, where that is not obvious.
    """

    heights: NDArray
    height_unit: float | None = None
    spacing: Pair | None = None
    needs_unit: bool = False
    mask: Flags | None = None
    instrument: Instrument = UNKNOWN
    no_data: tuple[float, ...] = ()
    unclear: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reading:
    """What the caller says about a file of heights, see `read_topography`."""

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


def bad_file(path: Path, given: object, allowed: str) -> InputError:
    """InputError about the content of a file."""
    return InputError(str(path), " ".join(str(given).split())[:200], allowed)


def length_unit(text: str) -> float | None:
    """Metres of a unit of length as files write it; None of any other text.

    Brackets around it and "/pixel" behind it are left out. A micro sign that was written in UTF-8 and read in an
    older encoding, "Âµm", or in that of DOS, "æm", is one.

    >>> length_unit("[µm]"), length_unit("nm/pixel"), length_unit("Âµm"), length_unit("deg")
    (1e-06, 1e-09, 1e-06, None)
    """
    unit = text.strip().strip("[]()<>").strip()
    for end in ("/pixel", "/px", "/point", " per pixel"):
        unit = unit.removesuffix(end)
    for wrong in ("Âµ", "Î¼", "æ"):
        unit = unit.replace(wrong, "µ")
    unit = "angstrom" if unit == "Å" else unit
    if len(unit) > 3:
        unit = unit.lower()  # "Microns"; of short ones capitals count
    try:
        return to_si(f"1 {unit}", "m") if unit else None
    except InputError:
        return None
