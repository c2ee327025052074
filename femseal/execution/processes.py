"""Compute stages in several processes on this machine, with joblib."""

import logging
import os
import pickle
import signal
import threading
import time
import warnings
from collections.abc import Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import cache, lru_cache, partial
from itertools import chain, islice
from pathlib import Path
from shutil import rmtree
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import psutil

from ..base import FemsealError, Mapper, Stage, free_memory
from ..base.shared_arrays import sharing

log = logging.getLogger("femseal.execution.processes")
#: Fraction of the free memory that all concurrent calls of a stage may use together.
FREE_FRACTION = 0.7
#: Time within which processes without work must end by themselves [s].
END_SECONDS = 10.0
#: Interval at which a process checks whether its parent is alive [s].
WATCH_SECONDS = 0.5
#: Name of the thread that checks whether the parent is alive.
WATCHER = "watches the parent"
#: Environment variables of the processes. With the first two variables, the GNU C library retains freed memory up to
#: the given size [byte], because requesting new memory for each result would take as long as sending the result. With
#: the third variable, packages are not searched in the working folder, as for the femseal command itself.
ENVIRONMENT = {
    "MALLOC_TRIM_THRESHOLD_": str(2**25),
    "MALLOC_MMAP_THRESHOLD_": str(2**25),
    "PYTHONSAFEPATH": "1",
}
#: Set if joblib may have started processes.
_has_processes = threading.Event()


@contextmanager
def over_processes(count: int) -> Iterator[Mapper]:
    """Yield a mapper over `count` processes.

    Arrays that `shared_empty` creates inside the `with` block are shared with the worker processes. The worker
    processes remain available for later `with` blocks, and end with this process. If an error is raised inside the
    `with` block, the worker processes are killed at once.
    """
    # joblib replaces a process whose memory has grown by 300 MB, for example by compiling, and warns needlessly
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    try:
        with sharing(), TemporaryDirectory(prefix="femseal-", ignore_cleanup_errors=True) as folder:
            yield partial(_map, count, folder)
    except BaseException:
        kill_processes()
        raise


def _map(count: int, folder: str, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """Yield the results of a stage in the order of its items.

    Each worker process reads the function of the stage from a file when it computes its first item. The items are sent
    by joblib, in batches.

    count : number of processes.
    folder : temporary folder for the file with the stage.
    """
    import joblib

    items = zip(*iterables, strict=False)
    first_items = list(islice(items, count))
    if not first_items:
        return
    with NamedTemporaryFile(suffix=".pickle", dir=folder, delete=False) as file:
        pickle.dump(stage, file, protocol=5)
    limits = _stage_limits(stage, count, len(first_items))
    results = None
    _has_processes.set()  # from here on, `kill_processes` has processes to kill
    try:
        with joblib.parallel_config("loky", inner_max_num_threads=1), starting_processes():
            # max_nbytes=None sends large arrays through pipes, because files would remain if the run is killed
            pool = joblib.Parallel(
                return_as="generator",
                n_jobs=count,
                pre_dispatch=limits.dispatched_items,
                max_nbytes=None,
            )
            call = joblib.delayed(_call_stored)
            results = pool(
                call(os.getpid(), file.name, limits.threads, *item)
                for item in chain(first_items, items)
            )
        for result in results:  # noqa: UP028, as `yield from` would close the generator here
            yield result
    except BrokenProcessPool as error:
        reason = "a process died, perhaps because memory ran out; try fewer workers"
        raise FemsealError(f"workers: {reason} ({str(error).splitlines()[0]})") from error
    finally:
        with warnings.catch_warnings():
            # joblib warns of tasks without a result when a run is stopped
            warnings.filterwarnings("ignore", ".* tasks ")
            if results is not None:
                results.close()
        Path(file.name).unlink(missing_ok=True)


class _StageLimits(NamedTuple):
    """Number of items of a stage that are computed or waiting at the same time, and the threads of each process.

    dispatched_items : number of items that joblib dispatches in advance, as passed to its argument `pre_dispatch`.
    threads : number of threads with which each process computes an item.
    """

    dispatched_items: Any
    threads: int


def _stage_limits(stage: Stage, count: int, item_count: int) -> _StageLimits:
    """Choose limits that fit into the free memory and use all cores.

    stage : the stage, whose `memory` is the memory of a call if memory must be limited.
    count : number of processes.
    item_count : number of items of the stage, at most `count`.
    """
    dispatched_items: Any = "2 * n_jobs"
    concurrent_processes = count
    if stage.memory:
        most_calls = FREE_FRACTION * free_memory() / stage.memory
        dispatched_items = int(np.clip(most_calls, 1, 2 * count))
        concurrent_processes = dispatched_items
    # if fewer items than cores are computed at the same time, each process uses several threads
    threads = max(1, count // min(concurrent_processes, item_count))
    return _StageLimits(dispatched_items, threads)


@contextmanager
def starting_processes() -> Iterator[None]:
    """Start processes inside the `with` block with the variables `ENVIRONMENT`, and with SIGINT and SIGTERM blocked.

    SIGINT and SIGTERM are blocked inside the `with` block, and a new process inherits the blocked signals. A signal
    that arrives inside the `with` block is handled at the end of the block; this process then ends its workers.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as loky_tracker

    added = ENVIRONMENT.keys() - os.environ.keys()
    os.environ.update({name: ENVIRONMENT[name] for name in added})
    previous_mask = None
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        # the resource trackers unblock the signals when they start, so they must be started before
        resource_tracker.ensure_running()
        loky_tracker.ensure_running()
        previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
        if previous_mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


def kill_processes() -> None:
    """Kill the worker processes, without waiting for the items that they compute.

    joblib kills the worker processes. If it does not return within `END_SECONDS`, they are killed one by one.
    """
    from joblib.externals.loky import get_reusable_executor

    if not _has_processes.is_set():
        return
    _has_processes.clear()
    workers = _worker_processes()
    executor = get_reusable_executor(reuse=True)
    killing = threading.Thread(target=executor.shutdown, kwargs={"kill_workers": True}, daemon=True)
    killing.start()
    killing.join(END_SECONDS)
    if not killing.is_alive():
        return
    log.warning("worker processes did not end within %g s: they are killed", END_SECONDS)
    for worker in workers:
        with suppress(psutil.Error):
            worker.kill()
    killing.join(END_SECONDS)


def _worker_processes() -> list[psutil.Process]:
    """List the worker processes that joblib has started for this process."""
    workers = []
    for child in psutil.Process().children():
        with suppress(psutil.Error):
            if any("popen_loky" in word for word in child.cmdline()):
                workers.append(child)
    return workers


def _call_stored(parent: int, path: str, threads: int, *item: Any) -> Any:
    """Compute an item in a worker process.

    Parameters
    ----------
    parent : int
        Identifier of the process that started this one.
    path : str
        File that contains the function of the stage.
    threads : int
        Number of threads that may share the work on an array.
    *item
        The item.
    """
    _folders.add(str(Path(path).parent))
    _end_with(parent)
    # imported here, because only the worker processes need numba
    from ..base.compiled import using_threads

    with using_threads(threads):
        return _load_stage(path)(*item)


@lru_cache(maxsize=1)
def _load_stage(path: str) -> Stage:
    """Load a stage from a file."""
    return pickle.loads(Path(path).read_bytes())


#: Temporary folders that remain if the parent of this process is killed.
_folders: set[str] = set()


@cache
def _end_with(parent: int) -> None:
    """Watch the parent process in a thread; when the parent has ended, remove its folders and end this process.

    The process also ends `END_SECONDS` after its main thread has ended, even if other threads are still running.
    Without this time limit, joblib would wait for the process forever.
    """

    def watch() -> None:
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(parent)
            # `process.wait` would only return after the program that started the parent has read its exit code
            while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                time.sleep(WATCH_SECONDS)
                if not threading.main_thread().is_alive():
                    # this process has finished its work; give its other threads some time to end
                    time.sleep(END_SECONDS)
                    os._exit(0)
        # the parent has ended
        for folder in tuple(_folders):
            rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=watch, name=WATCHER, daemon=True).start()
