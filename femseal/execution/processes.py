"""The mapper over processes of this machine, by joblib."""

import atexit
import logging
import os
import pickle
import signal
import threading
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, lru_cache, partial
from itertools import chain, islice
from pathlib import Path
from shutil import rmtree
from tempfile import NamedTemporaryFile, TemporaryDirectory
from typing import Any

import numpy as np
import psutil

from ..base import FemsealError, Mapper, Stage, free_memory
from ..base.machine import sharing

log = logging.getLogger("femseal.execution.processes")
#: Fraction of the free memory that the concurrent calls of a stage may take together.
FREE_FRACTION = 0.7
#: Time that processes without work get to end [s].
END_SECONDS = 10.0
#: How often a process looks for its parent [s].
WATCH_SECONDS = 0.5
#: Name of the thread that does.
WATCHER = "watches the parent"
#: Environment of processes. The GNU C library keeps freed memory up to this size [byte]: getting new memory for each
#: result takes as long as sending the result. A package is not looked for in the working folder, as the command does.
ENVIRONMENT = {
    "MALLOC_TRIM_THRESHOLD_": str(2**25),
    "MALLOC_MMAP_THRESHOLD_": str(2**25),
    "PYTHONSAFEPATH": "1",
}


@contextmanager
def over_processes(count: int) -> Iterator[Mapper]:
    """Context with a mapper over `count` processes; they end with the context if it ends with an error.

    Else they wait for another context, and end with this process. Within it, arrays of `shared_empty` are shared with
    the processes.
    """
    # joblib replaces a process that keeps 300 MB more than at first, as after compiling; nothing is lost
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    try:
        with sharing(), TemporaryDirectory(prefix="femseal-", ignore_cleanup_errors=True) as folder:
            yield partial(_map, count, folder)
    except BaseException:
        end_processes(kill=True)
        raise


def _map(count: int, folder: str, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """Results of the stage, which each process reads once from a file; joblib sends the items in batches."""
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    items = zip(*iterables, strict=False)
    first = list(islice(items, count))
    if not first:
        return
    with NamedTemporaryFile(suffix=".pickle", dir=folder, delete=False) as file:
        pickle.dump(stage, file, protocol=5)
    under_way: Any = "2 * n_jobs"
    if stage.memory:
        under_way = int(np.clip(FREE_FRACTION * free_memory() / stage.memory, 1, 2 * count))
    # processes without an item leave their cores to the others
    threads = max(1, count // min(under_way if stage.memory else count, len(first)))
    results = None
    try:
        with joblib.parallel_config("loky", inner_max_num_threads=1), starting_processes():
            # large arrays of items go through pipes: files for them would outlive a run that is killed
            pool = joblib.Parallel(
                return_as="generator", n_jobs=count, pre_dispatch=under_way, max_nbytes=None
            )
            call = joblib.delayed(_call_stored)
            results = pool(
                call(os.getpid(), file.name, threads, *args) for args in chain(first, items)
            )
        _end_at_exit()
        for result in results:  # noqa: UP028, as it would close them here
            yield result
    except TerminatedWorkerError as error:
        reason = "a process died, as when memory runs out; try fewer workers"
        raise FemsealError(f"workers: {reason} ({str(error).splitlines()[0]})") from error
    finally:
        with warnings.catch_warnings():
            # a stopped run needs no more results
            warnings.filterwarnings("ignore", ".* tasks ")
            if results is not None:
                results.close()
        Path(file.name).unlink(missing_ok=True)


@contextmanager
def starting_processes() -> Iterator[None]:
    """Context in which new processes have `ENVIRONMENT` and ignore SIGINT and SIGTERM.

    The processes inherit that the signals are blocked; this process receives them when the context ends, and ends the
    others.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as loky_tracker

    added = ENVIRONMENT.keys() - os.environ.keys()
    os.environ.update({name: ENVIRONMENT[name] for name in added})
    heard = None
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        # these unblock the signals when they start
        resource_tracker.ensure_running()
        loky_tracker.ensure_running()
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
        if heard is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)


def end_processes(kill: bool = False) -> None:
    """End the processes: at once, or by force those that do not end by themselves within `END_SECONDS`.

    joblib waits for them without limit, also at the end of this process: one that is stuck would keep it for ever.
    """
    from joblib.externals.loky import reusable_executor

    executor = reusable_executor._executor
    if executor is None:
        return
    numbers, calls = list(executor._processes or ()), executor._call_queue
    ending = threading.Thread(target=executor.shutdown, kwargs={"kill_workers": kill}, daemon=True)
    ending.start()
    ending.join(END_SECONDS)
    if not ending.is_alive():
        return
    log.warning("worker processes did not end within %g s: they are ended by force", END_SECONDS)
    for number in numbers:
        with suppress(psutil.Error):
            psutil.Process(number).kill()
    with suppress(OSError, AttributeError):
        calls._reader.close()  # calls that nobody takes any more would be waited for
    ending.join(END_SECONDS)


@cache
def _end_at_exit() -> None:
    """Have `end_processes` called at the end of this process, before joblib waits for the processes."""
    # as joblib does; the last one that is registered is called first
    getattr(threading, "_register_atexit", atexit.register)(end_processes)


def _call_stored(parent: int, path: str, threads: int, *args: Any) -> Any:
    _folders.add(str(Path(path).parent))
    _end_with(parent)
    from ..base.compiled import using  # numba is not loaded by the process that starts others

    with using(threads):
        return _stored(path)(*args)


@lru_cache(maxsize=1)
def _stored(path: str) -> Stage:
    return pickle.loads(Path(path).read_bytes())


#: Folders that the parent of this process leaves if it is killed.
_folders: set[str] = set()


@cache
def _end_with(parent: int) -> None:
    """End this process soon after its parent, even if the parent is killed, and remove the folders that it leaves."""

    def watch() -> None:
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(parent)
            # `wait` would also wait for who started the parent to ask for its end
            while process.is_running() and process.status() != psutil.STATUS_ZOMBIE:
                time.sleep(WATCH_SECONDS)
        for folder in tuple(_folders):
            rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=watch, name=WATCHER, daemon=True).start()
