"""Ordered maps that the studies take: in this process, over processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import asyncio
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

from .errors import InputError

Map = Callable[..., Iterable[Any]]
#: For each of these a cluster has so long [s]: to answer, to accept a client, to have a worker.
ANSWER_SECONDS = 5


@contextmanager
def ordered_map(workers: int | None = None, scheduler: str | None = None) -> Iterator[Map]:
    """A map whose results come in the order of its arguments, whoever computes them.

    Parameters
    ----------
    workers : processes; None: one for each core.
    scheduler : address of a Dask scheduler to compute on instead.

    Raises
    ------
    InputError : no scheduler with workers at the address, or femseal[cluster] is not installed.
    """
    import joblib

    if scheduler is not None:
        with _connected(scheduler) as client:
            yield partial(_on_cluster, client)
        return
    count = workers or joblib.cpu_count()
    yield map if count == 1 else partial(_over_processes, count)


def _over_processes(count: int, function: Callable[..., Any], *iterables: Iterable[Any]) -> Iterable[Any]:
    import joblib

    pool = joblib.Parallel(return_as="generator", n_jobs=count)
    return pool(joblib.delayed(function)(*args) for args in zip(*iterables, strict=False))


def _connected(scheduler: str) -> Any:
    """A client of the cluster."""
    try:
        from distributed import Client, Security
        from distributed.comm import connect
    except ImportError:
        raise InputError.of("scheduler", f"'{scheduler}'", "none without femseal[cluster]") from None

    async def greet() -> None:
        arguments = Security().get_connection_args("client")
        await (await connect(scheduler, timeout=ANSWER_SECONDS, **arguments)).close()

    client = None
    try:
        # a client waits without end for another kind of service; a thread, as the caller may run an event loop
        with ThreadPoolExecutor(1) as thread:
            thread.submit(lambda: asyncio.run(asyncio.wait_for(greet(), 1.1 * ANSWER_SECONDS))).result()
        client = Client(scheduler, timeout=ANSWER_SECONDS)
        client.wait_for_workers(1, timeout=ANSWER_SECONDS)
    except Exception as error:  # of any kind, where another service answers
        if client is not None:
            client.close()
        allowed = f"the address of a running scheduler with workers ({str(error) or 'no answer'})"
        raise InputError.of("scheduler", f"'{scheduler}'", allowed) from None
    return client


def _on_cluster(client: Any, function: Callable[..., Any], *iterables: Iterable[Any]) -> Iterator[Any]:
    """A few tasks for each thread of the cluster are under way at a time."""
    shared = client.scatter(function, broadcast=True, hash=False)
    pending: deque[Any] = deque()
    for args in zip(*iterables, strict=False):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # each window brings its own gaps
            pending.append(client.submit(_call, shared, *args, pure=False))
        if len(pending) > 4 * sum(client.nthreads().values()):
            yield pending.popleft().result()
    while pending:
        yield pending.popleft().result()


def _call(function: Callable[..., Any], *args: Any) -> Any:
    return function(*args)
