"""What worker processes load before their first item: the solvers, and their compiled loops where there are any."""

from __future__ import annotations

import os
from contextlib import suppress

from ..base.lazy_package import loading

# before a library starts threads: the processes share the cores
os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

with loading():
    from . import study_registry  # noqa: F401
    from .compiling import load_compiled

    with suppress(Exception):  # an item would meet it again, and say so
        load_compiled()
