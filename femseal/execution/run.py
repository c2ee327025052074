"""Compute the stages of a run, and report its progress, its wall times and its log lines.

Stages are computed in this process, in several processes on this machine, or on a Dask cluster. In each process, BLAS,
Fourier transforms and compiled loops use a single thread. With a single thread each, the processes do not compete for
cores, and the results do not depend on the process in which they were computed.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from ..base.stage import Mapper, Stage

log = logging.getLogger("femseal")
#: Function that is called as progress(stage, done, total); the argument `total` is None if the total is unknown.
Progress = Callable[[str, int, int | None], None]
#: Time between two log lines about a running stage [s].
LOG_SECONDS = 60.0
#: Name of the stage in which loops are compiled.
COMPILING = "compiling for one to two minutes, once after an installation"
#: Listener that reports compilation; the list is empty if compilation is not reported.
_active_listeners: list[Any] = []


def no_progress(stage: str, done: int, total: int | None) -> None:
    """Do nothing: a `Progress` function for runs whose progress is not shown."""


@contextmanager
def reporting_compilation(progress: Progress) -> Iterator[None]:
    """Report the compilation of loops inside the `with` block; the first compilation takes about a minute.

    A `with` block inside another block of the same kind does nothing, because the outer block already reports.

    Parameters
    ----------
    progress : callable
        Function that is called when the first compilation begins, whenever a loop has been compiled, and at the end.
        The total number of compiled loops is only known at the end.
    """
    from numba.core import event

    if _active_listeners:
        yield
        return

    class CompilationListener(event.Listener):  # type: ignore[misc]
        has_begun = False
        done = 0

        def on_start(self, _: event.Event) -> None:
            if not self.has_begun:
                log.info("%s", COMPILING)
                progress(COMPILING, 0, None)
            self.has_begun = True

        def on_end(self, _: event.Event) -> None:
            self.done += 1
            progress(COMPILING, self.done, None)

    listener = CompilationListener()
    _active_listeners.append(listener)
    try:
        with event.install_listener("numba:compile", listener):
            yield
    finally:
        _active_listeners.clear()
    if listener.done:
        progress(COMPILING, listener.done, listener.done)


@dataclass(eq=False)
class Run:
    """Compute the stages of a run, and record their wall times.

    Parameters
    ----------
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items.
    progress : callable
        Function that is called with the progress of the stages, see `Progress`.
    timings : dict
        Wall times [s] by name: of the parts of the run, see `timed`, and of every stage in these parts.
    parts : list of str
        Names of the parts of the run in `timings`.
    """

    mapper: Mapper = map
    progress: Progress = no_progress
    timings: dict[str, float] = field(default_factory=dict)
    parts: list[str] = field(default_factory=list)

    @contextmanager
    def timed(self, name: str) -> Iterator[Mapper]:
        """Yield the mapper for a part of the run, such as a study, and measure the wall time of this part.

        If several parts of the run have the same name, their wall times are added.
        """
        start = time.perf_counter()
        self.progress(name, 0, 1)
        yield self._reporting_mapper(name)
        seconds = time.perf_counter() - start
        self._add_time(name, seconds)
        if name not in self.parts:
            self.parts.append(name)
        self.progress(name, 1, 1)
        log.info("%s: %.1f s", name, seconds)

    def decided(self, name: str, identity: Any, value: Any) -> Any:
        """Store a value that the run has chosen. A resumed run uses the value chosen by the stopped run.

        Parameters
        ----------
        name : str
            Name of the chosen value.
        identity : object
            Plain data that distinguish this value from other values with the same name.
        value : object
            The chosen value. If the store already contains a value with this name and identity, the stored value is
            returned instead.
        """
        stage = Stage(name, partial(_return_value, value), key=("decided", name))
        (result,) = self.mapper(stage, [identity])
        return result

    def _add_time(self, name: str, seconds: float) -> None:
        """Add a wall time [s] to the timings."""
        self.timings[name] = self.timings.get(name, 0.0) + seconds

    def _reporting_mapper(self, part: str) -> Mapper:
        """Return a mapper that reports the progress of each stage and records its wall time.

        part : name of the part of the run to which the stages belong, such as "two-scale".
        """

        def map_and_report(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            total = min((len(i) for i in iterables if isinstance(i, Sized)), default=None)
            name = f"{part}: {stage.name}"
            self.progress(name, 0, total)
            start = time.monotonic()
            last_line = start
            done = 0
            for done, item in enumerate(self.mapper(stage, *iterables), start=1):
                self.progress(name, done, total)
                yield item
                now = time.monotonic()
                if now - last_line >= LOG_SECONDS:
                    last_line = now
                    _log_rate(name, done, total, now - start)
            seconds = time.monotonic() - start
            self._add_time(name, seconds)
            if done:
                log.info("%s %d in %.1f s", name, done, seconds)

        return map_and_report


def _log_rate(name: str, done: int, total: int | None, seconds: float) -> None:
    """Log how many items of a stage were computed in `seconds` [s], and how long the remaining items will take."""
    rate = done / seconds
    remaining = "" if total is None else f", {(total - done) / rate:.0f} s left"
    log.info("%s %d of %s, %.3g/s%s", name, done, total or "?", rate, remaining)


def _return_value(value: Any, identity: Any) -> Any:
    """Return the chosen value. The store uses `identity` as a part of the key under which the value is stored."""
    return value


class LogFile(logging.FileHandler):
    """Write log lines to a file. If the disk is full, log lines are lost, but the run continues."""

    def close(self) -> None:
        """Close the log file, even if the last lines cannot be written."""
        with suppress(OSError):
            super().close()


@contextmanager
def logging_to(*handlers: logging.Handler) -> Iterator[None]:
    """Send log lines to handlers inside the `with` block, and close the handlers at the end of the block."""
    level = log.level
    log.setLevel(logging.INFO)
    for handler in handlers:
        handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        log.addHandler(handler)
    try:
        yield
    finally:
        log.setLevel(level)
        for handler in handlers:
            log.removeHandler(handler)
            handler.close()


@contextmanager
def ordered_map(
    workers: int | None = None,
    scheduler: str | None = None,
    before: Callable[[Mapper], None] | None = None,
) -> Iterator[Mapper]:
    """Yield a mapper for a `with` block. The mapper computes stages and returns results in the order of the items.

    Parameters
    ----------
    workers : int, optional
        Number of processes on this machine; by default, one process for each core.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers compute the items. If the scheduler has no worker, the mapper waits
        for a worker, for at most `cluster.WORKER_SECONDS`. "local" starts a scheduler and `workers` processes on this
        machine.
    before : callable, optional
        Function such as `compile_ahead`, which is called with the mapper before it is yielded. The function is
        called only if the run uses several processes on this machine.

    Raises
    ------
    InputError
        The scheduler does not answer or has no workers, the workers have different versions of packages from this
        process, or femseal[cluster] is not installed.
    FemsealError
        Workers died repeatedly while a stage was being computed.
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
            yield _map_here
        else:
            with over_processes(count) as mapper:
                if before is not None:
                    before(mapper)
                yield mapper


def _map_here(stage: Any, *iterables: Iterable[Any]) -> Iterator[Any]:
    """Compute a stage in this process."""
    return map(getattr(stage, "function", stage), *iterables)
