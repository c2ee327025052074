"""Read masks of undefined points from files: images, texts or arrays with numbers other than 0 at undefined points.

A mask must have the same orientation as the heights in their file. In an image and in a text, the points of a line lie
along the x axis of the file, and the first line of the file has the index 0 along y. NumPy arrays are not transposed.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..base import Flags, InputError, Shape, as_text
from .formats import READERS, reading
from .instruments import unprinted
from .raw import Raw, Reading
from .text_files import TEXT

#: Suffixes that the file of a mask can have: those of lossless image formats, and of arrays.
_IMAGES = (".png", ".tif", ".tiff", ".bmp", ".gif")
_ARRAYS = (".npy", *TEXT)


def read_mask(path: str | os.PathLike[str], shape: Shape) -> Flags:
    """Read a mask of undefined points from a file. Points with a number other than 0 are undefined.

    Parameters
    ----------
    path : path
        An image (.png, .tif, .bmp or .gif) or numbers (.npy, .csv, .asc or .txt). In an image, black points have the
        value 0, and transparency is ignored.
    shape : tuple of two int
        Number of points of the heights in their file along x and y.

    Returns
    -------
    array of bool, (n1, n2)
        Whether each point is undefined.

    Raises
    ------
    InputError
        The file does not exist, cannot be read, or has a different number of points from the heights.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.is_file():
        raise InputError("mask", f"'{path}', no such file", "a file")
    if suffix not in (*_IMAGES, *_ARRAYS):
        raise InputError("mask", f"'{path.name}'", f"a file {', '.join((*_IMAGES, *_ARRAYS))}")
    reader = _read_image if suffix in _IMAGES else READERS[suffix]
    with reading(path):
        values = reader(path, Reading()).heights
    if values.shape != shape:
        hint = "; its transpose would fit" if values.shape == shape[::-1] else ""
        expected = f"{as_text(shape)}, as in the file of the heights, x first{hint}"
        raise InputError("mask", f"{as_text(values.shape)} points in '{path.name}'", expected)
    return values != 0


def _read_image(path: Path, options: Reading) -> Raw:
    """Read an image as an array of numbers, each the largest of a pixel's red, green and blue values."""
    from PIL import Image

    with unprinted(), Image.open(path) as image:
        has_other_channels = image.mode in ("P", "PA", "LA", "RGBA", "CMYK")
        # (y, x), or (y, x, colour)
        pixels = np.asarray(image.convert("RGB") if has_other_channels else image)
    brightest = pixels.max(axis=2) if pixels.ndim == 3 else pixels
    return Raw(brightest.T)
