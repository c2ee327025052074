"""How loops over the levels of multigrid are compiled."""

from __future__ import annotations

from typing import Any

import numpy as np

COMPILED: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}
#: The finest level, the first row inside the border, and no: numba would compile its functions once more for a constant
#: 0, 1 or False.
FINEST, FIRST, NO = np.int64(0), np.int64(1), np.bool_(False)
