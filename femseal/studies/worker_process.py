"""What worker processes load before their first item: the solvers."""

import gc
import os

# before a library starts threads: the processes share the cores
os.environ.update(
    dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

from . import study_registry  # noqa: F401

gc.freeze()  # copies of this process share these objects, as no garbage is looked for among them
