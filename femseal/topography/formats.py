"""Read height maps from files of several formats.

The reader of each format returns a `Raw` record.

Axis 0 of the heights is the x axis of the file, and axis 1 is the y axis of the file. In a text file, the points of a
line lie along x. NumPy arrays are not transposed.

Sources: ISO 25178-71 (.sdf), ISO 25178-72 (.x3p), the text export of Gwyddion.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, Pair, free_memory
from ..base.machine import within_free_memory
from .coordinates import grid_of_coordinates, profile_error
from .instruments import pick, read_instrument
from .raw import Raw, Reading, bad_file
from .text_files import TEXT, is_text, read_text

#: Ratio of the memory needed for reading to the size of the file.
_MEMORY_FACTOR = 3
#: Kinds of arrays that hold numbers, see `numpy.dtype.kind`.
_NUMBERS = "bfiu"
#: Smallest number of lines of an array of coordinates. A shorter array is treated as a narrow map.
_FEWEST_LINES = 9
#: First bytes of the ASCII export of Wyko.
_WYKO = b"Wyko ASCII Data File"


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn any error raised while reading a file into an InputError that names the file.

    A file that needs more than the free memory also raises an InputError: the size of the file is checked before
    reading, and the memory is limited while the file is read.
    """
    length, free = path.stat().st_size, free_memory()
    if _MEMORY_FACTOR * length > free:
        expected = f"one that can be read in the {free / 1e9:.3g} GB of free memory"
        raise bad_file(path, f"a file of {length / 1e9:.3g} GB", expected)
    try:
        with within_free_memory():
            yield
    except InputError as error:
        raise bad_file(path, error.given, error.expected) from error
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more points than fit into memory", "a smaller file") from None
    except Exception as error:
        # libraries raise errors of any kind when a header is damaged
        expected = f"an intact {path.suffix.lower()} file"
        given = f"a damaged one ({type(error).__name__}: {error})"
        raise bad_file(path, given, expected) from error


def read_npy(path: Path, options: Reading) -> Raw:
    """Read heights from a .npy file."""
    numbers = _check_map(np.load(path, allow_pickle=False))
    return _map_of_array(numbers, None, options)


def read_npz(path: Path, options: Reading) -> Raw:
    """Read heights from a .npz archive.

    The heights are the array named `options.array`, or the only map in the archive. An array named `spacing` in the
    archive contains the pixel size [m]. An array named `mask` marks undefined points by numbers other than 0.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = dict(archive)
    spacing = _check_spacing(arrays.pop("spacing", None))
    # with array="mask", the user reads the array `mask` as heights
    mask = arrays.pop("mask", None) if options.array != "mask" else None
    heights = _check_map(_select_map(arrays, options.array))
    if mask is None:
        return _map_of_array(heights, spacing, options)
    if mask.shape != heights.shape or mask.dtype.kind not in _NUMBERS:
        expected = f"numbers of the shape of the heights, {heights.shape}"
        raise InputError("file", f"an array mask of {mask.dtype} of shape {mask.shape}", expected)
    return Raw(heights, spacing=spacing, mask=mask != 0)


def _select_map(arrays: dict[str, NDArray], name: str | None) -> NDArray:
    """Return the map with the given name, or the only map of an archive if no name is given.

    Raises InputError if the archive does not contain exactly one such map.
    """
    # a single array is returned whatever its shape, so that `_check_map` can explain what is wrong with it
    maps = [key for key, array in arrays.items() if array.ndim == 2 or len(arrays) == 1]
    selected = [key for key in maps if key == name] if name else maps
    if len(selected) != 1:
        names = ", ".join(sorted(arrays)) or "none"
        given = f"array={name!r} of the arrays {names}"
        raise InputError("file", given, "a file with one map, or the name of the map in array=")
    return arrays[selected[0]]


def _check_spacing(spacing: NDArray | None) -> Pair | None:
    """Check the pixel size of an archive and return it [m]; return None if the archive has none."""
    if spacing is None:
        return None
    if spacing.shape != (2,) or spacing.dtype.kind not in _NUMBERS:
        raise InputError("file", f"a spacing of shape {spacing.shape}", "two numbers > 0 [m]")
    return float(spacing[0]), float(spacing[1])


def read_x3p(path: Path, options: Reading) -> Raw:
    """Read one layer of a surface in the format of ISO 25178-72, whose lengths are in metres."""
    import x3pio

    notes: tuple[str, ...] = ()
    try:
        file = x3pio.read(path)
    except x3pio.X3pChecksumError as error:
        if options.verify_checksum:
            given = f"a file that was changed or damaged after it was written ({error})"
            expected = "an intact one, or verify_checksum=False (--no-verify-checksum) to read it nevertheless"
            raise InputError("file", given, expected) from None
        file = x3pio.read(path, verify=False)
        notes = (
            f"{error}: the file was changed or damaged after it was written, and is read nevertheless",
        )
    if isinstance(file, x3pio.Profile):
        profile = pick(list(file.layers), options.channel, "layer")
        raise profile_error(profile.z, "of ISO 5436-2")
    if not isinstance(file, x3pio.Surface) or not file.is_regular_grid:
        given = f"a {type(file).__name__} that is not on a regular grid"
        raise InputError("file", given, "a surface on a regular grid")
    layer = pick(list(file.layers), options.channel, "layer")
    spacing = file.header.x.increment, file.header.y.increment
    return Raw(layer.z.T, 1.0, spacing, notes=notes)


def read_sdf(path: Path, options: Reading) -> Raw:
    """Read a surface in the format of ISO 25178-71, whose lengths are in metres."""
    import sdfio

    pick([path], options.channel, "layer")  # the format has a single layer
    file = sdfio.read(path)
    return Raw(file.data.T, 1.0, (file.header.x_scale, file.header.y_scale))


def read_any_text(path: Path, options: Reading) -> Raw:
    """Read heights from a text file, see `read_text`.

    An ASCII export of Wyko, which consists of several blocks, is read by SurfaceTopography.
    """
    with path.open("rb") as file:
        is_wyko = file.read(len(_WYKO)) == _WYKO
    if is_wyko:
        return read_instrument(path, options, [*READERS])
    return read_text(path, options)


def read_file(path: Path, options: Reading) -> Raw:
    """Read a file of heights with the reader for its suffix, or with SurfaceTopography if the suffix is unknown."""
    suffix = path.suffix.lower()
    if suffix in READERS:
        return READERS[suffix](path, options)
    if is_text(path):
        return read_any_text(path, options)
    return read_instrument(path, options, [*READERS])


def _map_of_array(numbers: NDArray, spacing: Pair | None, options: Reading) -> Raw:
    """Make a `Raw` record from an array: a map of heights, or a table of coordinates on a regular grid.

    numbers : heights (n1, n2), or coordinates (points, 3 or 4).
    spacing : pixel size [m], if it is known.
    """
    may_be_coordinates = numbers.shape[1] in (3, 4) and len(numbers) >= _FEWEST_LINES
    grid = grid_of_coordinates(numbers) if may_be_coordinates else None
    if grid is None or grid.steps is None:
        return Raw(numbers, spacing=spacing)
    if spacing is None and options.height_unit is None:
        spacing = grid.steps  # the coordinates, like the heights, are in metres
    steps = " and ".join(f"{step:.6g}" for step in grid.steps)
    return Raw(
        grid.heights,
        spacing=spacing,
        unclear=f"coordinates in steps of {steps}, without a unit",
        has_coordinates=True,
        notes=grid.notes,
    )


def _check_map(array: NDArray) -> NDArray:
    """Check that an array is a map of real numbers (n1, n2), and return it in double precision."""
    has_numbers = array.dtype.kind in _NUMBERS
    if not has_numbers or array.ndim != 2 or not array.size:
        given = f"an array of {array.dtype} of shape {array.shape}"
        expected = "a non-empty array of real numbers of shape (n1, n2)"
        if array.ndim == 1 and has_numbers:
            expected += "; a single line of heights is a profile, not a map"
        raise InputError("file", given, expected)
    with np.errstate(invalid="ignore"):  # the bytes of a damaged file may not represent a number
        return array.astype(np.float64, copy=False)


#: Readers by suffix. A reader raises InputError("file", given, expected); `reading` adds the path of the file.
READERS: dict[str, Callable[[Path, Reading], Raw]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys(TEXT, read_any_text),
    ".x3p": read_x3p,
    ".sdf": read_sdf,
}
