"""One run under way: where its stages are computed, who is informed of progress, how long each took; its log file.

Stages are computed in this process, in processes of this machine, or on a Dask cluster, with one thread of BLAS in each
process (FFT and compiled loops have one anyway), so that workers do not compete for cores and results do not depend on
where they were computed.
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
#: Called as progress(stage, done, total); total is None if it is unknown.
Progress = Callable[[str, int, int | None], None]
#: Time between two log lines on a running stage [s].
LOG_SECONDS = 60.0
#: What is said while loops are compiled.
COMPILING = "compiling, once after an installation"
#: What reports that loops are compiled; empty where nothing does.
_reported: list[Any] = []


def no_progress(stage: str, done: int, total: int | None) -> None:
    """Progress that nobody watches."""


@contextmanager
def reporting_compilation(progress: Progress) -> Iterator[None]:
    """Context in which loops that are compiled are reported, as they take a minute after an installation.

    progress : called as progress(stage, done, total): when the first one begins, when one is done, and at the end; how
        many there will be is not known before. Within another such context that one reports.
    """
    from numba.core import event

    if _reported:
        yield
        return

    class Loops(event.Listener):  # type: ignore[misc]
        begun, done = False, 0

        def on_start(self, _: event.Event) -> None:
            if not self.begun:
                log.info("%s", COMPILING)
                progress(COMPILING, 0, None)
            self.begun = True

        def on_end(self, _: event.Event) -> None:
            self.done += 1
            progress(COMPILING, self.done, None)

    loops = Loops()
    _reported.append(loops)
    try:
        with event.install_listener("numba:compile", loops):
            yield
    finally:
        _reported.clear()
    if loops.done:
        progress(COMPILING, loops.done, loops.done)


@dataclass(eq=False)
class Run:
    """A run under way.

    mapper : computes its stages. progress : is called with their progress, see `Progress`. timings : wall times by
    name [s]: of what `timed` names, and of every stage in it.
    """

    mapper: Mapper = map
    progress: Progress = no_progress
    timings: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timed(self, name: str) -> Iterator[Mapper]:
        """Context of a study or another part of the run; gives its mapper. Work outside of stages counts as one item.

        The times of several parts of one name are summed.
        """
        start = time.perf_counter()
        self.progress(name, 0, 1)
        yield self._watching(name)
        seconds = time.perf_counter() - start
        self.timings[name] = self.timings.get(name, 0.0) + seconds
        self.progress(name, 1, 1)
        log.info("%s: %.1f s", name, seconds)

    def decided(self, name: str, of: Any, value: Any) -> Any:
        """The value, or in a run that goes on the one that it had before: it has to decide as then.

        of : plain data that tell the decision from others of this name.
        """
        (found,) = self.mapper(Stage(name, partial(_same, value), key=("decided", name)), [of])
        return found

    def _watching(self, part: str) -> Mapper:
        """The mapper, but it reports the progress of each stage and sums their wall times."""

        def mapping(stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
            total = min((len(i) for i in iterables if isinstance(i, Sized)), default=None)
            name = f"{part}: {stage.name}"
            self.progress(name, 0, total)
            start = said = time.monotonic()
            done = 0
            for done, item in enumerate(self.mapper(stage, *iterables), start=1):
                self.progress(name, done, total)
                yield item
                if (now := time.monotonic()) - said >= LOG_SECONDS:
                    said, rate = now, done / (now - start)
                    left = "" if total is None else f", {(total - done) / rate:.0f} s left"
                    log.info("%s %d of %s, %.3g/s%s", name, done, total or "?", rate, left)
            seconds = time.monotonic() - start
            self.timings[name] = self.timings.get(name, 0.0) + seconds
            if done:
                log.info("%s %d in %.1f s", name, done, seconds)

        return mapping


def _same(value: Any, of: Any) -> Any:
    return value


class LogFile(logging.FileHandler):
    """Log lines in a file; on a full disk they end, while the run goes on."""

    def close(self) -> None:
        """Close the file as far as that goes."""
        with suppress(OSError):
            super().close()


@contextmanager
def logging_to(*handlers: logging.Handler) -> Iterator[None]:
    """Context in which log lines go to handlers, which are closed at its end."""
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
            yield lambda stage, *items: map(getattr(stage, "function", stage), *items)
        else:
            with over_processes(count) as mapper:
                if before is not None:
                    before(mapper)
                yield mapper
