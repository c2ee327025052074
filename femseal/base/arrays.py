"""Types: arrays of real and of whole numbers and of truth values; lengths along both axes; paths."""

import os

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
#: Real numbers in single precision, and in any.
Singles = NDArray[np.float32]
Floats = NDArray[np.floating]
#: Of a file or a folder.
AnyPath = str | os.PathLike[str]
#: Along x1 and x2: points, lengths, whether a map repeats itself.
Shape = tuple[int, int]
Pair = tuple[float, float]
Periodic = tuple[bool, bool]
#: Along x1 and x2, or the same along both.
Lengths = float | Pair


def reals(values: ArrayLike) -> Array:
    """Values as an array of real numbers."""
    return np.asarray(values, dtype=np.float64)
