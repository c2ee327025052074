"""The mapper over the workers of a Dask cluster."""

import asyncio
import logging
import sys
import warnings
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from functools import lru_cache, partial
from itertools import islice
from threading import Event
from typing import Any

from ..base import FemsealError, InputError, Mapper, Stage, numerical_versions
from .processes import ENVIRONMENT, starting_processes

log = logging.getLogger("femseal.execution.cluster")
#: Time limit for a cluster to answer, and to accept a client [s].
ANSWER_SECONDS = 5
#: Time limit for a cluster without workers, at the start or after the last one has left [s].
WORKER_SECONDS = 600
#: Tasks sent for each thread of the cluster: one is computed while the next one waits.
UNDER_WAY = 2
#: Tasks sent, with those that are done and wait for an earlier one, for each of these.
MOST_SENT = 8
#: How often a task is sent again after the cluster has lost its data.
RETRIES = 10


@contextmanager
def over_cluster(scheduler: str, count: int) -> Iterator[Mapper]:
    """A mapper over the cluster of a scheduler; "local" starts one with `count` processes, which end with the context.

    Raises InputError: as `run.ordered_map`.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        expected = "one after: pip install 'femseal[cluster]'"
        raise InputError("scheduler", f"'{scheduler}'", expected) from None

    if scheduler != "local":
        with _connected(scheduler) as client:
            yield partial(_map, client)
        return
    prefix = "distributed.nanny.pre-spawn-environ"
    environment = {f"{prefix}.{name}": value for name, value in ENVIRONMENT.items()}
    with ExitStack() as stack:
        with starting_processes(), config.set(environment):
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.ERROR,
            )
            # results that bypass the scheduler take half the time; libraries send their own work to a default client
            client = Client(
                stack.enter_context(cluster), direct_to_workers=True, set_as_default=False
            )
            stack.enter_context(client)
        yield partial(_map, client)


def _connected(scheduler: str) -> Any:
    """A client of a cluster that has a worker, with the versions of this process on all workers."""
    from distributed import Client, Security
    from distributed.comm import connect

    async def greet() -> None:
        arguments = Security().get_connection_args("client")
        await (await connect(scheduler, timeout=ANSWER_SECONDS, **arguments)).close()

    with ExitStack() as stack:
        try:
            # a client would wait forever for a service of another kind
            # in a thread, because the caller may run an event loop
            with ThreadPoolExecutor(1) as thread:
                answer = asyncio.wait_for(greet(), 1.1 * ANSWER_SECONDS)
                thread.submit(asyncio.run, answer).result()
            client = Client(scheduler, timeout=ANSWER_SECONDS, set_as_default=False)
            stack.callback(client.close)
            _await_worker(client)
            there = client.run(numerical_versions)
        except Exception as error:  # any error is possible if another service answers
            reason = str(error) or "no answer"
            expected = (
                f"the address of a running scheduler with workers that have femseal ({reason})"
            )
            raise InputError("scheduler", f"'{scheduler}'", expected) from None
        for worker, found in there.items():
            here = numerical_versions().items()
            if other := [
                f"{n} {found.get(n)} instead of {v}" for n, v in here if found.get(n) != v
            ]:
                given = f"'{scheduler}' whose worker {worker} has {', '.join(other)}"
                expected = "workers with the versions of this process: else results would depend on who computes them"
                raise InputError("scheduler", given, expected)
        stack.pop_all()
    return client


def _map(client: Any, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """Results of the stage, which goes to the workers once; a few items for each thread are under way.

    An item that takes long holds up no others: those after it wait for their turn once they are done.
    """
    items = zip(*iterables, strict=False)
    stage_there = _scattered(client, stage)
    sent: deque[tuple[tuple[Any, ...], Any]] = deque()
    one_is_done = Event()
    while True:
        one_is_done.clear()
        wanted = UNDER_WAY * max(1, _threads(client))
        free = min(
            wanted - sum(not task.done() for _, task in sent), MOST_SENT * wanted - len(sent)
        )
        for item in islice(items, max(free, 0)):
            sent.append((item, _submit(client, stage_there, item)))
            sent[-1][1].add_done_callback(lambda _: one_is_done.set())
        if not sent:
            return
        if not sent[0][1].done():
            if not one_is_done.wait(ANSWER_SECONDS):
                _await_worker(client)
            continue
        item, task = sent.popleft()
        for _ in range(RETRIES):
            try:
                result = _outcome(client, task)
                break
            except CancelledError:
                # all workers that had the stage are gone
                if stage_there.status != "finished":
                    stage_there = _scattered(client, stage)
                task = _submit(client, stage_there, item)
        else:
            raise FemsealError(
                f"scheduler: the workers of a task died {RETRIES} times, as when memory runs out"
            )
        yield result


def _scattered(client: Any, stage: Stage) -> Any:
    _await_worker(client)
    return client.scatter(stage, broadcast=True, hash=False)


def _submit(client: Any, stage: Any, item: tuple[Any, ...]) -> Any:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Sending large graph")  # an item may bring its gaps
        return client.submit(_call, stage, item, pure=False)


def _outcome(client: Any, task: Any) -> Any:
    """The result of an item; workers are awaited where none is left."""
    from distributed import KilledWorker

    while True:
        try:
            return task.result(timeout=ANSWER_SECONDS)
        except KilledWorker as error:
            reason = "several workers died with the same task, as when memory runs out"
            raise FemsealError(f"scheduler: {reason} ({error})") from error
        except TimeoutError:
            if task.status == "error":  # it is the function's own
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


def _call(stage: Stage, item: tuple[Any, ...]) -> Any:
    with _libraries(len(sys.modules)).limit(limits=1):
        return stage(*item)


@lru_cache(maxsize=1)
def _libraries(modules: int) -> Any:
    """The libraries of this process that have threads; they are looked for again where modules were loaded."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
