"""A mask of a height map from a file of its own: an image, a text or an array whose points other than 0 are undefined.

Orientation: that of the heights in their file. A line of an image or a text runs along the file's x, the first one at
the first y; arrays of NumPy are taken as they are.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from .formats import TEXT, Options, bad_file, read_text, within_memory_of

#: Suffixes of images, which keep every point as it was drawn.
_IMAGES = (".png", ".tif", ".tiff", ".bmp", ".gif")
_ARRAYS = (".npy", *TEXT)


def read_mask(path: str | os.PathLike[str], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Undefined points (n1, n2) of a map, true where the file is not 0.

    path : .png .tif .bmp .gif (any colour but black is not 0; transparency is left out), .npy, .csv .asc .txt.
    shape : of the heights as they lie in their file, x first.

    Raises InputError: no such file, another kind, not readable, or not of the shape.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError("mask", f"'{path}', {'a folder' if path.is_dir() else 'no such file'}", "a file")
    if suffix not in (*_IMAGES, *_ARRAYS):
        raise InputError("mask", f"'{path.name}'", f"a file {', '.join((*_IMAGES, *_ARRAYS))}")
    try:
        with within_memory_of(path):
            found = _read_image(path) if suffix in _IMAGES else _read_array(path)
    except OSError as error:
        raise bad_file(path, error.strerror or error, "a file that can be read") from None
    except MemoryError:
        raise bad_file(path, "more points than fit into memory", "a mask of the map's size") from None
    if found.shape != shape:
        turned = "; turned by its diagonal it would fit" if found.shape == shape[::-1] else ""
        given = f"{found.shape[0]} × {found.shape[1]} points in '{path.name}'"
        raise InputError("mask", given, f"{shape[0]} × {shape[1]}, as in the file of the heights, x first{turned}")
    return found


def _read_array(path: Path) -> NDArray[np.bool_]:
    if path.suffix.lower() != ".npy":
        return read_text(path, Options()).heights != 0
    try:
        array = np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise bad_file(path, error, "an array of numbers saved by numpy.save") from None
    if array.dtype.kind not in "bfiu" or array.ndim != 2:
        raise bad_file(path, f"an array of {array.dtype} of shape {array.shape}", "numbers or truth values (n1, n2)")
    return array != 0


def _read_image(path: Path) -> NDArray[np.bool_]:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            pixels = np.asarray(image.convert("RGB") if image.mode in ("P", "PA", "LA", "RGBA", "CMYK") else image)
    except (UnidentifiedImageError, Image.DecompressionBombError, ValueError, SyntaxError, EOFError) as error:
        raise bad_file(path, error, "an image of the map's size") from None
    marked = pixels != 0
    return (marked.any(axis=2) if marked.ndim == 3 else marked).T
