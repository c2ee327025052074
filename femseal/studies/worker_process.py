"""What worker processes load before their first item: the solvers."""

import os

# before a library starts threads: the processes share the cores
os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

from . import study_registry  # noqa: F401
