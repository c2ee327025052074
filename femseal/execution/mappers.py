"""Mappers that the studies take: in this process, in processes of this machine, or on a Dask cluster.

All of them compute with one thread of BLAS in each process (FFT and compiled loops have one anyway), so that workers do
not compete for cores and results do not depend on where they were computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..base.stage import Mapper


@contextmanager
def ordered_map(
    workers: int | None = None,
    scheduler: str | None = None,
    before: Callable[[Mapper], None] | None = None,
) -> Iterator[Mapper]:
    """Context with a mapper whose results come in the order of the items.

    workers : processes on this machine; None: one for each core.
    scheduler : address of a Dask scheduler to compute on instead, whose first worker is awaited for
    `cluster.WORKER_SECONDS`; "local": a scheduler and `workers` single-threaded processes started here.
    before : called with the mapper over processes of this machine before it is used, such as `compile_ahead`.

    Raises InputError: no scheduler with workers at the address, workers with other versions, or femseal[cluster] is
    not installed.
    FemsealError : workers died again and again; the mapper raises it while results are taken.
    """
    import joblib
    from threadpoolctl import threadpool_limits

    from .cluster import over_cluster
    from .processes import over_processes

    count = workers or joblib.cpu_count()
    with threadpool_limits(1):
        if scheduler is not None:
            with over_cluster(scheduler, count) as mapper:
                yield mapper
        elif count == 1:
            yield map
        else:
            with over_processes(count) as mapper:
                if before is not None:
                    before(mapper)
                yield mapper
