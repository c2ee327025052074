"""What worker processes load before their first item: the solvers, and their compiled loops where there are any."""

from __future__ import annotations

import gc
import os
from contextlib import suppress

# before a library starts threads: the processes share the cores
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
gc.disable()  # loading makes hundreds of thousands of objects, and no garbage

from . import study_registry  # noqa: E402, F401
from .compiling import load_compiled  # noqa: E402

with suppress(Exception):  # an item would meet it again, and say so
    load_compiled()
gc.freeze()
gc.enable()
