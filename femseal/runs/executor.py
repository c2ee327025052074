"""Ordered maps that the studies take: in this process, over processes of this machine, or on a Dask cluster.

All of them compute with one thread of BLAS for each process (FFT and compiled loops have one anyway), so that workers
do not fight for cores and results do not depend on where they were computed.
"""

from __future__ import annotations

import asyncio
import logging
import os
import pickle
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, lru_cache, partial
from itertools import chain, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import psutil

from ..base.errors import FemsealError, InputError
from ..base.machine import free_memory
from ..base.provenance import numerical_versions
from ..base.shared_array import sharing
from ..base.stage import Mapper, Stage

log = logging.getLogger("femseal.runs.executor")
#: For each of these a cluster has so long [s]: to answer, to accept a client.
ANSWER_SECONDS = 5
#: So long a cluster may be without any worker, before the first one or after the last [s].
WORKER_SECONDS = 600
#: Small items are sent together, about so much work at a time [s].
TASK_SECONDS = 0.25
#: Share of the free memory that heavy tasks may take together.
FREE_SHARE = 0.7
#: Tasks under way for each thread of a cluster: one computed, one ready.
UNDER_WAY = 2
#: Memory that processes of this machine keep when it is freed [bytes]: to get each result's anew costs as much as to
#: send it. For the GNU C library.
KEPT_MEMORY = {"MALLOC_TRIM_THRESHOLD_": str(2**25), "MALLOC_MMAP_THRESHOLD_": str(2**25)}
#: How often a task is sent again when the cluster loses what it needs.
RETRIES = 10


@contextmanager
def ordered_map(workers: int | None = None, scheduler: str | None = None) -> Iterator[Mapper]:
    """A map whose results come in the order of its arguments, whoever computes them.

    Parameters
    ----------
    workers : processes on this machine; None: one for each core.
    scheduler : address of a Dask scheduler to compute on instead, whose first worker is awaited for `WORKER_SECONDS`;
        "local": a scheduler and `workers` single-threaded processes of its own.

    Raises
    ------
    InputError : no scheduler with workers at the address, workers with other versions, or femseal[cluster] is not
        installed.
    FemsealError : from the map, where workers died again and again.
    """
    import joblib
    from threadpoolctl import threadpool_limits

    count = workers or joblib.cpu_count()
    with threadpool_limits(1):
        if scheduler is not None:
            with _client(scheduler, count) as client:
                yield partial(_on_cluster, client)
        elif count == 1:
            yield map
        else:
            try:
                with sharing():
                    yield partial(_over_processes, count)
            except BaseException:
                _end_processes(count)
                raise


def _over_processes(count: int, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """The stage goes to the processes through a file that each reads once, the items in batches."""
    import joblib
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    items = zip(*iterables, strict=False)
    first = list(islice(items, 1))
    if not first:
        return
    with TemporaryDirectory(prefix="femseal-") as folder:
        path = Path(folder, "stage.pickle")
        path.write_bytes(pickle.dumps(stage, protocol=5))
        under_way: Any = "2 * n_jobs"
        if stage.memory:
            under_way = int(np.clip(FREE_SHARE * free_memory() / stage.memory, 1, 2 * count))
        results = None
        try:
            with joblib.parallel_config("loky", inner_max_num_threads=1), _children():
                pool = joblib.Parallel(return_as="generator", n_jobs=count, pre_dispatch=under_way)
                call = joblib.delayed(_call_stored)
                results = pool(call(os.getpid(), str(path), *args) for args in chain(first, items))
            for result in results:  # noqa: UP028, as it would close them here
                yield result
        except TerminatedWorkerError as error:
            reason = "a process died, as when memory runs out; try fewer workers"
            raise FemsealError(f"workers: {reason} ({str(error).splitlines()[0]})") from error
        finally:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", ".* tasks ")  # where the run was stopped, the rest is not wanted
                if results is not None:
                    results.close()


@contextmanager
def _children() -> Iterator[None]:
    """Processes started meanwhile keep freed memory, and never hear SIGINT and SIGTERM: this process ends them.

    The signals are blocked, which processes inherit; this process hears them when the context ends.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as loky_tracker

    added = KEPT_MEMORY.keys() - os.environ.keys()
    os.environ.update({name: KEPT_MEMORY[name] for name in added})
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


def _end_processes(count: int) -> None:
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor(max_workers=count, reuse=True).shutdown(wait=True, kill_workers=True)


def _call_stored(parent: int, path: str, *args: Any) -> Any:
    _end_with(parent)
    return _stored(path)(*args)


@lru_cache(maxsize=1)
def _stored(path: str) -> Callable[..., Any]:
    return pickle.loads(Path(path).read_bytes())


@cache
def _end_with(parent: int) -> None:
    """End this process soon after its parent, which may be killed before it can say so."""

    def watch() -> None:
        with suppress(psutil.NoSuchProcess):
            psutil.Process(parent).wait()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _client(scheduler: str, count: int) -> Iterator[Any]:
    """A client of the cluster, closed at the end together with a cluster of its own."""
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError.of("scheduler", f"'{scheduler}'", "none without femseal[cluster]") from None

    if scheduler != "local":
        with _connected(scheduler) as client:
            yield client
        return
    with ExitStack() as stack:
        # Dask's own settings give memory back at once, and look at what the worker does all the time
        environment = {f"distributed.nanny.pre-spawn-environ.{name}": value for name, value in KEPT_MEMORY.items()}
        with _children(), config.set({**environment, "distributed.worker.profile.enabled": False}):
            one_each: dict[str, Any] = {"n_workers": count, "threads_per_worker": 1, "processes": True}
            cluster = LocalCluster(**one_each, dashboard_address="127.0.0.1:0", silence_logs=logging.ERROR)
            # past the scheduler, results cost half as much
            client = stack.enter_context(Client(stack.enter_context(cluster), direct_to_workers=True))
        yield client


def _connected(scheduler: str) -> Any:
    """A client of a cluster that has a worker, with the versions of this process on all of them."""
    from distributed import Client, Security
    from distributed.comm import connect

    async def greet() -> None:
        arguments = Security().get_connection_args("client")
        await (await connect(scheduler, timeout=ANSWER_SECONDS, **arguments)).close()

    client = None
    try:
        # a client waits without end for another kind of service; a thread, as the caller may run an event loop
        with ThreadPoolExecutor(1) as thread:
            thread.submit(lambda: asyncio.run(asyncio.wait_for(greet(), 1.1 * ANSWER_SECONDS))).result()
        client = Client(scheduler, timeout=ANSWER_SECONDS)
        _await_worker(client)
        there = client.run(numerical_versions)
    except Exception as error:  # of any kind, where another service answers
        if client is not None:
            client.close()
        allowed = f"the address of a running scheduler with workers that have femseal ({str(error) or 'no answer'})"
        raise InputError.of("scheduler", f"'{scheduler}'", allowed) from None
    except BaseException:
        if client is not None:
            client.close()
        raise
    here = numerical_versions()
    for worker, found in there.items():
        if found != here:
            client.close()
            other = ", ".join(f"{n} {found.get(n)} instead of {v}" for n, v in here.items() if found.get(n) != v)
            allowed = "workers with the versions of this process: else results would depend on who computes them"
            raise InputError.of("scheduler", f"'{scheduler}' whose worker {worker} has {other}", allowed)
    return client


def _on_cluster(client: Any, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """The stage goes to the workers once; a few batches of items for each thread are under way at a time."""
    items = zip(*iterables, strict=False)
    stage_there = _scattered(client, stage)
    under_way: deque[tuple[list[Any], Any]] = deque()
    size = 1
    while True:
        wanted = UNDER_WAY * max(1, _threads(client))
        while len(under_way) < wanted and (batch := list(islice(items, size))):
            under_way.append((batch, _submit(client, stage_there, batch)))
        if not under_way:
            return
        batch, task = under_way.popleft()
        for _ in range(RETRIES):
            try:
                results, seconds = _outcome(client, task)
                break
            except CancelledError:
                # all workers that had the function are gone
                if stage_there.status != "finished":
                    stage_there = _scattered(client, stage)
                task = _submit(client, stage_there, batch)
        else:
            raise FemsealError(f"scheduler: the workers of a task died {RETRIES} times, as when memory runs out")
        size = min(2 * size, max(1, round(TASK_SECONDS * len(batch) / max(seconds, 1e-6))))
        yield from results


def _scattered(client: Any, function: Callable[..., Any]) -> Any:
    _await_worker(client)
    return client.scatter(function, broadcast=True, hash=False)


def _submit(client: Any, function: Any, batch: list[Any]) -> Any:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sending large graph")  # each window brings its own gaps
        return client.submit(_call_batch, function, batch, pure=False)


def _outcome(client: Any, task: Any) -> tuple[list[Any], float]:
    """Result of a task, for which workers are awaited if there are none left."""
    from distributed import KilledWorker

    while True:
        try:
            return task.result(timeout=ANSWER_SECONDS)
        except KilledWorker as error:
            reason = "several workers died with the same task, as when memory runs out"
            raise FemsealError(f"scheduler: {reason} ({error})") from error
        except TimeoutError:
            if task.done():  # the error is the function's own
                raise
            _await_worker(client)


def _threads(client: Any) -> int:
    try:
        return sum(client.nthreads().values())
    except OSError as error:
        raise FemsealError(f"scheduler: the connection is lost ({error})") from error


def _await_worker(client: Any) -> None:
    if not _threads(client):
        log.warning("no workers: waiting up to %g s for one", WORKER_SECONDS)
        try:
            client.wait_for_workers(1, timeout=WORKER_SECONDS)
        except TimeoutError:
            raise FemsealError(f"scheduler: no workers for {WORKER_SECONDS:g} s") from None


def _call_batch(function: Callable[..., Any], batch: list[Any]) -> tuple[list[Any], float]:
    from threadpoolctl import threadpool_limits

    start = time.perf_counter()
    with threadpool_limits(1):
        results = [function(*args) for args in batch]
    return results, time.perf_counter() - start
