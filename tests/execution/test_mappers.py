"""Maps over processes and clusters: order, threads, small items sent together, workers that die or come late."""

import ast
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from ended_runs import assert_same_results, run_processes, stop_at, wait_until
from numpy.testing import assert_array_equal
from small_cases import CASE, HANG

import femseal as fs
from femseal.base import Stage, compiled
from femseal.base.shared_arrays import shared_empty
from femseal.execution import cluster as cluster_map
from femseal.execution import processes
from femseal.execution.run import ordered_map

distributed = pytest.importorskip("distributed")
dask = pytest.importorskip("dask")


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE)
    return path


@pytest.fixture
def cluster(monkeypatch):
    """Two threads of this process, which may be slow to answer."""
    monkeypatch.setattr(cluster_map, "ANSWER_SECONDS", HANG)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
    ) as it:
        yield it


@pytest.fixture
def start_run():
    """A function that starts `femseal run` in a process group of its own; the groups end with the test at the latest."""
    with run_processes() as start:
        yield start


@contextmanager
def real_cluster():
    """A scheduler process on loopback, and a function that starts a worker process there."""
    with ExitStack() as stack:

        def start(name, *arguments):
            command = [sys.executable, "-m", f"distributed.cli.dask_{name}", *arguments]
            command.append("--no-dashboard")
            process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            stack.callback(process.wait)
            stack.callback(process.kill)
            threading.Thread(target=lambda: lines.extend(process.stderr), daemon=True).start()
            return process

        lines = []
        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0")
        found = re.compile(r"Scheduler at:\s+(tcp://\S+)").search
        wait_until(lambda: found("".join(lines)) or scheduler.poll() is not None)
        assert scheduler.poll() is None, "".join(lines)
        address = found("".join(lines))[1]
        yield address, lambda: start("worker", address, "--nthreads", "1", "--no-nanny")


def test_each_worker_has_one_thread(cluster):
    import threadpoolctl

    for arguments in ({"workers": 1}, {"workers": 2}, {"scheduler": cluster.scheduler_address}):
        with ordered_map(**arguments) as mapping:
            given = [threadpoolctl.threadpool_info] * 2, [np.ones(2)] * 2
            for libraries in mapping(Stage("trial", _libraries), *given):
                assert {library["num_threads"] for library in libraries} == {1}


def _libraries(info, _):
    return info()


def test_processes_return_results_in_order_and_end_with_a_reason():
    with ordered_map(workers=2) as mapping:
        pairs = mapping(Stage("trial", divmod), (n for n in range(100)), [7] * 100)
        assert list(pairs) == [divmod(n, 7) for n in range(100)]
        assert list(mapping(Stage("trial", divmod), [], [])) == []
        with pytest.raises(ZeroDivisionError):
            list(mapping(Stage("trial", divmod), [1], [0]))
        with pytest.raises(fs.FemsealError, match="a process died"):
            list(mapping(Stage("trial", os._exit), [3]))
        assert list(mapping(Stage("trial", abs), [-1, 2])) == [1, 2]


def test_results_of_a_cluster_are_returned_in_order(cluster):
    """Whether their number is known or not."""
    with ordered_map(scheduler=cluster.scheduler_address) as mapping:
        for numbers in (range(100), iter(range(100))):
            assert list(mapping(Stage("trial", abs), numbers)) == [*range(100)]


OUTSIDE = """
import os

def environment(_):
    return os.environ["OMP_NUM_THREADS"], os.environ["PYTHONSAFEPATH"]

if __name__ == "__main__":
    import outside
    from femseal.base.errors import FemsealError
    from femseal.base.stage import Stage
    from femseal.execution.run import ordered_map

    with ordered_map(workers=2) as mapping:
        print(*{*mapping(Stage("trial", outside.environment), range(8))})
        try:
            list(mapping(Stage("trial", os._exit), [3]))
        except FemsealError as error:
            print(error)
"""


def test_processes_do_not_import_packages_from_the_working_folder(tmp_path):
    for folder in ("scripts", "femseal"):
        (tmp_path / folder).mkdir()
    (script := tmp_path / "scripts" / "outside.py").write_text(OUTSIDE)
    (tmp_path / "femseal" / "__init__.py").write_text("raise RuntimeError('of the working folder')")
    command = [sys.executable, script]
    given = {"capture_output": True, "text": True, "check": True, "timeout": HANG}
    run = subprocess.run(command, cwd=tmp_path, **given)
    states, error = run.stdout.splitlines()
    assert states == "('1', '1')"
    assert "a process died" in error
    assert not run.stderr


def deaf(n):
    os.kill(os.getpid(), signal.SIGINT)
    return n


# where it is stopped at once, loky's own thread ends with an error
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be blocked")
@pytest.mark.parametrize(
    "backend", [{}, pytest.param({"scheduler": "local"}, marks=pytest.mark.slow)]
)
def test_only_the_main_process_receives_ctrl_c_even_while_processes_start(backend):
    def stopped_while_sent():
        yield from range(3)
        os.kill(os.getpid(), signal.SIGINT)
        yield from range(1000)

    with ExitStack() as stack:
        # a process of the background is started deaf to it
        heard = signal.signal(signal.SIGINT, signal.default_int_handler)
        stack.callback(signal.signal, signal.SIGINT, heard)
        mapping = stack.enter_context(ordered_map(workers=2, **backend))
        assert list(mapping(Stage("trial", deaf), range(8))) == list(range(8))
        with pytest.raises(KeyboardInterrupt):
            list(mapping(Stage("trial", abs), stopped_while_sent()))


others, enough = [], threading.Event()


def waits_for_others(n):
    if n:
        others.append(n)
    if len(others) > 5 * cluster_map.UNDER_WAY:
        enough.set()
    return n > 0 or enough.wait(HANG)


def test_a_slow_item_does_not_hold_up_others(cluster):
    """More of them than are under way at once."""
    with ordered_map(scheduler=cluster.scheduler_address) as mapping:
        assert all(mapping(Stage("trial", waits_for_others), range(100)))


@pytest.mark.parametrize("default", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_run_on_a_cluster_writes_its_folder_and_goes_on_there(
    case, tmp_path, monkeypatch, default
):
    """Also where the process has a default client of its own, as a notebook does."""
    case.write_text(CASE + '[output]\npictures = false\nreport = false\nparaview = "none"\n')
    one = fs.run(case, workers=1)
    out = tmp_path / "out"
    monkeypatch.setattr(cluster_map, "ANSWER_SECONDS", HANG)
    # what goes to its scheduler is pickled, unlike within a process
    given = {"n_workers": 1, "processes": False, "protocol": "tcp://", "dashboard_address": None}
    it = distributed.LocalCluster(**given)
    with it, distributed.Client(it, set_as_default=default):
        address, stop = it.scheduler_address, stop_at("two-scale: cells of the face", 3)
        with pytest.raises(KeyboardInterrupt):
            fs.run(case, out, scheduler=address, progress=stop)
        assert (out / ".checkpoint").exists()
        fs.run(case, out, resume=True, scheduler=address)
        assert_same_results(one.dataset, fs.open_results(out).dataset)


@pytest.mark.slow
@pytest.mark.parametrize("scheduler", ["local", "address"])
def test_the_command_writes_its_folder_on_a_cluster_also_after_a_kill(
    case,
    start_run,
    tmp_path,
    scheduler,
):
    one = fs.run(case, workers=1)
    out = tmp_path / "out"
    with ExitStack() as stack:
        if scheduler == "address":
            scheduler, start_worker = stack.enter_context(real_cluster())
            start_worker()
        arguments = ["--workers", 1, "--scheduler", scheduler]
        process = start_run(case, out, *arguments)
        wait_until(lambda: list(out.glob(".checkpoint/*.results")) or process.poll() is not None)
        assert process.poll() is None, process.stderr.read()
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        process = start_run(case, out, "--resume", *arguments)
        assert process.wait() == 0, process.stderr.read()
    assert_same_results(one.dataset, fs.open_results(out).dataset)
    assert not (out / ".checkpoint").exists()


def held():
    """The files in memory alone that this process has open."""
    found = set()
    for path in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # other threads close theirs
            if os.readlink(path).startswith("/memfd:"):
                found.add(path.stat().st_ino)
    return found


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="memory is shared on Linux")
def test_values_that_a_process_writes_into_shared_memory_appear_here():
    before = held()
    with ordered_map(workers=2) as mapping:
        whole = shared_empty((3, 40, 50), np.float32)
        own = held() - before
        assert len(own) == 1
        whole[:] = 1
        views = [whole[:, 10 * n : 10 * (n + 1), 5:] for n in range(4)]
        for view in mapping(Stage("trial", add_one), views):
            assert_array_equal(view, 2)
        assert_array_equal(whole[..., 5:], 2)
        assert_array_equal(whole[..., :5], 1)
    # it is there after the map, until the last view is gone, and its pickle is one of values
    copy = pickle.loads(pickle.dumps(whole))
    whole[:] = 3
    assert_array_equal(copy[..., 5:], 2)
    del whole, view, views
    assert not own & held()


def test_views_are_sent_by_value_on_systems_without_shared_memory(monkeypatch):
    monkeypatch.delattr(os, "memfd_create", raising=False)
    with ordered_map(workers=2) as mapping:
        whole = shared_empty((4, 10), float)
        whole[:] = 1
        assert_array_equal(list(mapping(Stage("trial", add_one), whole)), np.full((4, 10), 2))
        assert_array_equal(whole, 1)


@pytest.mark.slow
def test_a_scheduler_of_its_own_gives_the_same_bits(case):
    one = fs.run(case, workers=1)
    assert_same_results(one.dataset, fs.run(case, workers=2, scheduler="local").dataset)
    assert not distributed.client._get_global_client()


@pytest.mark.slow
def test_killed_workers_do_not_change_the_results(case):
    """One of two workers in the middle; later all that are left, so that what was sent to them is lost."""
    case.write_text(CASE.replace("realisations = 24", "realisations = 2000"))
    one = fs.run(case, workers=1)
    with real_cluster() as (address, start_worker):
        workers = [start_worker(), start_worker()]
        killed = []

        def progress(stage, done, total):
            for place, count in ((200, 1), (1000, 2)):
                if stage == "stochastic: realisations" and done == place:
                    for worker in workers[:count]:
                        worker.send_signal(signal.SIGKILL)
                        worker.wait()
                        killed.append(worker.pid)
                    workers[:count] = [start_worker()]

        there = fs.run(case, scheduler=address, progress=progress)
        assert len(set(killed)) == 3
    assert_same_results(one.dataset, there.dataset)


@pytest.mark.slow
def test_a_task_that_kills_its_workers_is_given_up_with_a_reason():
    with ordered_map(workers=2, scheduler="local") as mapping:
        with pytest.raises(fs.FemsealError, match=r"workers .*died"):
            list(mapping(Stage("trial", os._exit), [3]))
        assert list(mapping(Stage("trial", abs), [-1, 2])) == [1, 2]


class LosingClient:
    """A client of Dask, the first workers of which die while they receive a stage."""

    def __init__(self, errors):
        self.errors = iter(errors)

    def nthreads(self):
        return {"tcp://127.0.0.1:2": 1}

    def scatter(self, stage, **_):
        for error in self.errors:
            raise error
        return stage


def test_a_stage_is_sent_again_if_a_worker_dies_meanwhile():
    lost = KeyError("tcp://127.0.0.1:1")
    assert cluster_map._send_stage(LosingClient([lost, OSError("closed")]), "stage") == "stage"
    with pytest.raises(fs.FemsealError, match="workers died"):
        cluster_map._send_stage(LosingClient([lost] * 100), "stage")
    with pytest.raises(KeyError, match="missing"):
        cluster_map._send_stage(LosingClient([KeyError("missing")]), "stage")


@pytest.mark.slow
def test_a_lost_scheduler_is_reported():
    with real_cluster() as (address, start_worker):
        start_worker()
        with ordered_map(scheduler=address) as mapping:
            results = iter(mapping(Stage("trial", time.sleep), [0.5] * 100))
            next(results)
            with distributed.Client(address) as client:
                client.shutdown()
            with pytest.raises(fs.FemsealError, match="scheduler"):
                list(results)


def add_one(part):
    part += 1
    return part


def running_at_once(folder, expected):
    """How many of these calls run while this one does; until so many have met, the others are awaited."""
    mark, met = folder / "running" / f"{os.getpid()}-{time.monotonic_ns()}", folder / "met"
    mark.touch()
    most = 0

    def seen():
        nonlocal most
        most = max(most, len(list(mark.parent.iterdir())))
        if most >= expected:
            met.touch()
        return met.exists()

    wait_until(seen)
    time.sleep(0.05)  # more of them would be seen
    seen()
    mark.unlink()
    return most


@pytest.mark.parametrize(("memory", "most"), [(0.0, 2), (1.0, 2), (6e8, 1), (1e15, 1)])
def test_no_more_heavy_tasks_run_at_once_than_fit_into_memory(tmp_path, monkeypatch, memory, most):
    monkeypatch.setattr(processes, "free_memory", lambda: 1e9)
    (tmp_path / "running").mkdir()
    with ordered_map(workers=2) as mapping:
        list(mapping(Stage("trial", abs), range(4)))
        seen = list(mapping(Stage("trial", running_at_once, memory), [tmp_path] * 6, [most] * 6))
    assert max(seen) == most


@pytest.mark.parametrize("layout", ["Fortran", "four bytes off", "read only"])
def test_results_do_not_depend_on_how_arrays_reach_a_process(layout):
    """Dask lays the arrays that it sends anywhere in its messages, and numpy sums them in another order there."""
    rng = np.random.default_rng(0)
    body = fs.HalfSpace((66, 132), (1e-6, 1e-6), 2.3e11, ("free", "periodic"))
    memory = np.empty(8 * 66 * 132 + 4, np.uint8)
    moved = memory[4:].view(float).reshape(66, 132)
    for _ in range(8):
        gap0 = 1e-6 * rng.random((66, 132))
        moved[...] = gap0
        other = np.asfortranarray(gap0) if layout == "Fortran" else moved
        other.flags.writeable = layout != "read only"
        one, two = (
            fs.solve_contact(gap, body, pressure=1e9, hardness=3e9, rtol=1e-4)
            for gap in (gap0, other)
        )
        assert_array_equal(two.gap, one.gap)
        one, two = (fs.cell_permeability(gap, (1e-6, 1e-6)).value for gap in (gap0, other))
        assert two == one
        moved.flags.writeable = True


#: A run whose workers cannot end: in each a thread goes on.
STUCK = """
import sys, threading, time
from femseal.base.stage import Stage
from femseal.execution import processes
from femseal.execution.run import ordered_map
from test_mappers import stay

processes.END_SECONDS = 1.0
with ordered_map(workers=2) as mapping:
    print(*mapping(Stage("trial", stay), range(4)))
    if sys.argv[1] == "error":
        raise ValueError("stopped")
"""


def stay(n):
    threading.Thread(target=time.sleep, args=(600,)).start()
    return n


@pytest.mark.parametrize("end", [pytest.param("done", marks=pytest.mark.slow), "error"])
def test_processes_that_hang_do_not_keep_the_run_alive(end):
    """joblib would wait for them until the threads are through."""
    folder = Path(__file__).parent
    path = os.pathsep.join([str(folder), str(folder.parent), os.environ.get("PYTHONPATH", "")])
    given = {"cwd": folder, "env": os.environ | {"PYTHONPATH": path}, "timeout": 180}
    done = subprocess.run([sys.executable, "-c", STUCK, end], capture_output=True, **given)
    assert done.stdout.split() == [b"0", b"1", b"2", b"3"]
    assert done.returncode == (end == "error"), done.stderr


def _threads(item):
    return compiled.thread_count()


def test_idle_processes_leave_their_cores_to_the_others():
    with processes.over_processes(2) as mapper:
        alone = list(mapper(Stage("one state", _threads), [1]))
        many = list(mapper(Stage("states", _threads), [1, 2, 3]))
        large = list(mapper(Stage("large states", _threads, memory=1e15), [1, 2, 3]))
    assert (alone, many, large) == ([2], [1, 1, 1], [2, 2, 2])
    assert compiled.thread_count() == 1


def test_no_private_attributes_of_other_packages_are_used():
    """joblib and threading change them without notice; `os._exit` is public in spite of its name."""
    own = ("self", "cls", "os")
    private = [
        f"{path.name}: {ast.unparse(node)}"
        for path in Path(processes.__file__).parent.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and ast.unparse(node.value) not in own
    ]
    assert private == []
