"""Compute stages on the workers of a Dask cluster."""

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
from typing import Any, NamedTuple

from ..base import FemsealError, InputError, Mapper, Stage, numerical_versions
from .processes import ENVIRONMENT, starting_processes

log = logging.getLogger("femseal.execution.cluster")
#: Time limit for a cluster to answer, and to accept a client [s].
ANSWER_SECONDS = 5
#: Time limit for a cluster without workers, at the start or after the last worker has left [s].
WORKER_SECONDS = 600
#: Unfinished tasks for each thread of the cluster: one is computed while the next one waits.
UNDER_WAY = 2
#: Largest number of tasks whose results have not been yielded yet, divided by the desired number of unfinished tasks.
#: Finished tasks that wait for an earlier task count as well.
MOST_SENT = 8
#: Number of times that a task is sent again after the cluster has lost its data.
RETRIES = 10


@contextmanager
def over_cluster(scheduler: str, count: int) -> Iterator[Mapper]:
    """Yield a mapper over the workers of a cluster.

    Parameters
    ----------
    scheduler : str
        Address of a Dask scheduler. "local" starts a cluster on this machine, which is stopped at the end of the `with`
        block.
    count : int
        Number of processes of a local cluster.

    Raises
    ------
    InputError
        See `run.ordered_map`.
    """
    try:
        from dask import config
        from distributed import Client, LocalCluster
    except ImportError:
        expected = "one after: pip install 'femseal[cluster]'"
        raise InputError("scheduler", f"'{scheduler}'", expected) from None

    if scheduler != "local":
        with _connect(scheduler) as client:
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
            stack.enter_context(cluster)
            # Results that do not pass through the scheduler take half the time. The client must not become the default
            # client, because other libraries would send their own work to a default client.
            client = Client(cluster, direct_to_workers=True, set_as_default=False)
            stack.enter_context(client)
        yield partial(_map, client)


def _connect(scheduler: str) -> Any:
    """Connect to a cluster, wait until the cluster has a worker, and return a client.

    An InputError is raised if a worker and this process have different versions of a package.
    """
    from distributed import Client

    with ExitStack() as stack:
        try:
            _check_answer(scheduler)
            client = Client(scheduler, timeout=ANSWER_SECONDS, set_as_default=False)
            stack.callback(client.close)
            _await_worker(client)
            worker_versions = client.run(numerical_versions)
        except Exception as error:
            # a service of another kind at this address may cause any error
            reason = str(error) or "no answer"
            expected = (
                f"the address of a running scheduler with workers that have femseal ({reason})"
            )
            raise InputError("scheduler", f"'{scheduler}'", expected) from None
        for worker, versions in worker_versions.items():
            _check_versions(scheduler, worker, versions)
        stack.pop_all()  # the client stays open
    return client


def _check_answer(scheduler: str) -> None:
    """Raise an error if no Dask scheduler answers at an address.

    If a different kind of service were listening at the address, a client would wait forever for an answer.
    """
    from distributed import Security
    from distributed.comm import connect

    async def greet() -> None:
        arguments = Security().get_connection_args("client")
        connection = await connect(scheduler, timeout=ANSWER_SECONDS, **arguments)
        await connection.close()

    # a separate thread is needed, because the caller may already run an event loop
    with ThreadPoolExecutor(1) as thread:
        answer = asyncio.wait_for(greet(), 1.1 * ANSWER_SECONDS)
        thread.submit(asyncio.run, answer).result()


def _check_versions(scheduler: str, worker: str, versions: dict[str, str]) -> None:
    """Raise InputError if the versions of packages on a worker differ from those of this process."""
    differences = [
        f"{name} {versions.get(name)} instead of {version}"
        for name, version in numerical_versions().items()
        if versions.get(name) != version
    ]
    if differences:
        given = f"'{scheduler}' whose worker {worker} has {', '.join(differences)}"
        expected = (
            "workers with the versions of this process, because otherwise results would depend on where they are "
            "computed"
        )
        raise InputError("scheduler", given, expected)


def _map(client: Any, stage: Stage, *iterables: Iterable[Any]) -> Iterator[Any]:
    """Yield the results of a stage in the order of its items.

    The function of the stage is sent to each worker once. A few items are queued ahead of time for each thread. While a
    slow item is being computed, later items are computed as well. The results of later items are yielded after the
    result of the slow item.
    """
    items = zip(*iterables, strict=False)
    remote_stage = _RemoteStage(client, stage)
    sent: deque[_Sent] = deque()  # in the order of the items
    task_finished = Event()
    while True:
        task_finished.clear()
        for item in islice(items, _number_to_send(client, sent)):
            task = remote_stage.submit(item)
            sent.append(_Sent(item, task))
            task.add_done_callback(lambda _: task_finished.set())
        if not sent:
            return
        if sent[0].task.done():
            yield remote_stage.result(sent.popleft())
        elif not task_finished.wait(ANSWER_SECONDS):
            _await_worker(client)


class _Sent(NamedTuple):
    """An item and the Dask task that computes it."""

    item: tuple[Any, ...]
    task: Any


class _RemoteStage:
    """Send a stage to all workers of a cluster, and compute the items of the stage on the workers."""

    def __init__(self, client: Any, stage: Stage) -> None:
        self._client = client
        self._stage = stage
        #: The stage on the workers.
        self._data = _send_stage(client, stage)

    def submit(self, item: tuple[Any, ...]) -> Any:
        """Send a task that computes one item, and return the task."""
        return _submit(self._client, self._data, item)

    def result(self, sent: _Sent) -> Any:
        """Return the result of a task. If the workers of the task have died, its item is sent again."""
        task = sent.task
        for _ in range(RETRIES):
            try:
                return _wait_for_result(self._client, task)
            except CancelledError:
                # all workers that had the stage are gone
                if self._data.status != "finished":
                    self._data = _send_stage(self._client, self._stage)
                task = self.submit(sent.item)
        raise FemsealError(
            f"scheduler: a task failed because its workers died {RETRIES} times, perhaps for lack of memory"
        )


def _number_to_send(client: Any, sent: deque[_Sent]) -> int:
    """Return how many items should be sent now, to keep all threads of the cluster busy.

    sent : items and tasks that were sent earlier and whose results have not been yielded yet.
    """
    wanted = UNDER_WAY * max(1, _threads(client))  # number of unfinished tasks
    unfinished = sum(not task.done() for _, task in sent)
    return max(0, min(wanted - unfinished, MOST_SENT * wanted - len(sent)))


def _send_stage(client: Any, stage: Stage) -> Any:
    """Send a stage to all workers."""
    for _ in range(RETRIES):
        _await_worker(client)
        try:
            return client.scatter(stage, broadcast=True, hash=False)
        except (KeyError, OSError) as error:
            # if a worker has died meanwhile, the connection ends, or the scheduler does not find the worker's address
            if isinstance(error, KeyError) and "://" not in str(error):
                raise
            log.warning(
                "a worker died while the stage was being sent (%s): sending it again", error
            )
    raise FemsealError(f"scheduler: workers died {RETRIES} times while they received a stage")


def _submit(client: Any, remote_stage: Any, item: tuple[Any, ...]) -> Any:
    """Send a task that computes one item, and return the task."""
    with warnings.catch_warnings():
        # an item may contain large arrays of gaps
        warnings.filterwarnings("ignore", "Sending large graph")
        return client.submit(_call, remote_stage, item, pure=False)


def _wait_for_result(client: Any, task: Any) -> Any:
    """Return the result of a task; if the cluster has no workers, wait for a worker."""
    from distributed import KilledWorker

    while True:
        try:
            return task.result(timeout=ANSWER_SECONDS)
        except KilledWorker as error:
            reason = "several workers died with the same task, perhaps because memory ran out"
            raise FemsealError(f"scheduler: {reason} ({error})") from error
        except TimeoutError:
            if task.status == "error":
                raise  # the function itself has raised a TimeoutError
            _await_worker(client)


def _threads(client: Any) -> int:
    """Return the number of threads of the cluster."""
    try:
        return sum(client.nthreads().values())
    except OSError as error:
        raise FemsealError(f"scheduler: the connection was lost ({error})") from error


def _await_worker(client: Any) -> None:
    """Wait until the cluster has a worker."""
    if _threads(client):
        return
    log.warning("no workers: waiting up to %g s for one", WORKER_SECONDS)
    try:
        client.wait_for_workers(1, timeout=WORKER_SECONDS)
    except TimeoutError:
        raise FemsealError(f"scheduler: no workers for {WORKER_SECONDS:g} s") from None


def _call(stage: Stage, item: tuple[Any, ...]) -> Any:
    """Compute an item on a worker, with a single thread in each library."""
    with _thread_limits(len(sys.modules)).limit(limits=1):
        return stage(*item)


@lru_cache(maxsize=1)
def _thread_limits(modules: int) -> Any:
    """Return an object that limits the threads of the loaded libraries.

    modules : number of modules that Python has loaded. The object is cached. If the number of modules has changed since
    the last call, a new object is created, because a new module may have loaded another library.
    """
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
