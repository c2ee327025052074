"""Types of arrays: of real numbers, of whole numbers such as indices, and of truth values."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
