"""File formats of height maps: each reader turns a file into the same raw record.

Orientation: the file's x is axis 0, its y axis 1. In a text x runs along a line. Arrays of NumPy are taken as they are.
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

#: Memory that reading takes about, in sizes of the file: of numbers that take as many bytes as they have.
_MEMORY_FACTOR = 3
#: Kinds of arrays of numbers.
_NUMBERS = "bfiu"
#: An array of coordinates has no fewer lines; one of heights may be narrow.
_FEWEST_LINES = 9
#: How the ASCII export of Wyko begins.
_WYKO = b"Wyko ASCII Data File"


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Context in which a file is read: whatever is found in its bytes, an InputError about it names the file.

    One that cannot be read in the free memory is refused: by its size, or when it unpacks to more.
    """
    length, free = path.stat().st_size, free_memory()
    if _MEMORY_FACTOR * length > free:
        allowed = f"one that can be read in the {free / 1e9:.3g} GB of free memory"
        raise bad_file(path, f"a file of {length / 1e9:.3g} GB", allowed)
    try:
        with within_free_memory():
            yield
    except InputError as error:
        raise bad_file(path, error.given, error.expected) from error
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more points than fit into memory", "a smaller file") from None
    except Exception as error:  # a damaged head makes libraries raise errors of any kind
        allowed = f"an intact {path.suffix.lower()} file"
        raise bad_file(path, f"a damaged one ({type(error).__name__}: {error})", allowed) from error


def read_npy(path: Path, said: Reading) -> Raw:
    """A .npy array of heights."""
    return _map_of_array(_numbers(np.load(path, allow_pickle=False)), None, said)


def read_npz(path: Path, said: Reading) -> Raw:
    """A .npz archive: the heights under `array`, or its only map; `spacing` [m] and `mask` if they are there.

    Points where `mask` is not 0 are masked.
    """
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        stored = dict(archive)
    spacing = stored.pop("spacing", None)
    mask = stored.pop("mask", None) if said.array != "mask" else None
    every = ", ".join(sorted(stored)) or "none"
    maps = [name for name, found in stored.items() if found.ndim == 2 or len(stored) == 1]
    names = [name for name in maps if name == said.array] if said.array else maps
    if len(names) != 1:
        given = f"array={said.array!r} of the arrays {every}"
        raise InputError("file", given, "one map, or array= the name of one")
    heights = _numbers(stored[names[0]])
    if mask is not None and (mask.shape != heights.shape or mask.dtype.kind not in _NUMBERS):
        allowed = f"numbers of the shape of the heights, {heights.shape}"
        raise InputError("file", f"an array mask of {mask.dtype} of shape {mask.shape}", allowed)
    if spacing is not None:
        if spacing.shape != (2,) or spacing.dtype.kind not in _NUMBERS:
            raise InputError("file", f"a spacing of shape {spacing.shape}", "two numbers > 0 [m]")
        spacing = float(spacing[0]), float(spacing[1])
    if mask is None:
        return _map_of_array(heights, spacing, said)
    return Raw(heights, spacing=spacing, mask=mask != 0)


def read_x3p(path: Path, said: Reading) -> Raw:
    """A surface of ISO 25178-72, one layer of it; the format knows metres only."""
    import x3pio

    notes: tuple[str, ...] = ()
    try:
        file = x3pio.read(path)
    except x3pio.X3pChecksumError as error:
        if said.verify_checksum:
            given = f"a file that was changed or damaged after it was written ({error})"
            expected = "an intact one, or verify_checksum=False (--no-verify-checksum) to read it all the same"
            raise InputError("file", given, expected) from None
        file = x3pio.read(path, verify=False)
        notes = (
            f"{error}: it was changed or damaged after it was written, and is read all the same",
        )
    if isinstance(file, x3pio.Profile):
        raise profile_error(pick(list(file.layers), said.channel, "layer").z, "of ISO 5436-2")
    if not (isinstance(file, x3pio.Surface) and file.is_regular_grid):
        given = f"a {type(file).__name__} on no regular grid"
        raise InputError("file", given, "a surface on a regular grid")
    layer = pick(list(file.layers), said.channel, "layer")
    spacing = file.header.x.increment, file.header.y.increment
    return Raw(layer.z.T, 1.0, spacing, notes=notes)


def read_sdf(path: Path, said: Reading) -> Raw:
    """A surface of ISO 25178-71; the format knows metres only."""
    import sdfio

    pick([path], said.channel, "layer")
    file = sdfio.read(path)
    return Raw(file.data.T, 1.0, (file.header.x_scale, file.header.y_scale))


def read_any_text(path: Path, said: Reading) -> Raw:
    """A text, see `read_text`; the ASCII export of Wyko, in blocks, through SurfaceTopography."""
    with path.open("rb") as file:
        is_wyko = file.read(len(_WYKO)) == _WYKO
    return read_instrument(path, said, [*READERS]) if is_wyko else read_text(path, said)


def read_file(path: Path, said: Reading) -> Raw:
    """A file by its suffix; one of an unknown kind by SurfaceTopography."""
    suffix = path.suffix.lower()
    if suffix in READERS:
        return READERS[suffix](path, said)
    return read_any_text(path, said) if is_text(path) else read_instrument(path, said, [*READERS])


def _map_of_array(numbers: NDArray, spacing: Pair | None, said: Reading) -> Raw:
    """An array of heights as it is, or one of coordinates (n, 3) or (n, 4) that lie on a regular grid, in metres."""
    may_be_table = numbers.shape[1] in (3, 4) and len(numbers) >= _FEWEST_LINES
    found = grid_of_coordinates(numbers) if may_be_table else None
    if found is None or found.steps is None:
        return Raw(numbers, spacing=spacing)
    if spacing is None and said.height_unit is None:
        spacing = found.steps
    steps = " and ".join(f"{step:.6g}" for step in found.steps)
    return Raw(
        found.heights,
        spacing=spacing,
        unclear=f"coordinates in steps of {steps}, without a unit",
        notes=found.notes,
    )


def _numbers(found: NDArray) -> NDArray:
    if found.dtype.kind not in _NUMBERS or found.ndim != 2 or not found.size:
        given = f"an array of {found.dtype} of shape {found.shape}"
        expected = "a non-empty array of real numbers of shape (n1, n2)"
        if found.ndim == 1 and found.dtype.kind in _NUMBERS:
            expected += "; a single line of heights is a profile, no map"
        raise InputError("file", given, expected)
    with np.errstate(invalid="ignore"):  # bytes of numbers that are none, in single precision
        return found.astype(np.float64, copy=False)


#: Readers by suffix. A reader raises InputError("file", given, expected), which gets the path of the file.
READERS: dict[str, Callable[[Path, Reading], Raw]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    **dict.fromkeys(TEXT, read_any_text),
    ".x3p": read_x3p,
    ".sdf": read_sdf,
}
