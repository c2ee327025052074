"""Runs that are ended before they are done: how a test starts and ends them, and compares what they give in the end."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from small_cases import HANG


def assert_same_results(one, two):
    """Datasets have the same bits and attributes, apart from those that say when and how fast a run was."""
    assert set(one.data_vars) == set(two.data_vars)
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, two[name].values, err_msg=name)
    different = {key for key in one.attrs if not np.array_equal(one.attrs[key], two.attrs[key])}
    assert different <= {"timings", "date_created", "peak_memory_bytes"}


def stop_at(stage, item):
    """A progress that stops the run as Ctrl-C does."""

    def progress(name, done, total):
        if name.endswith(stage) and done == item:
            raise KeyboardInterrupt

    return progress


@contextmanager
def run_processes():
    """A function that starts `femseal run` in a process group of its own; all groups are ended at the end."""
    started = []

    def start(case, out, *arguments):
        # a shell starts what runs in its background so that Ctrl-C is ignored, which is inherited
        code = (
            "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "from femseal.cli import main; main()"
        )
        command = [sys.executable, "-c", code, "run", case, "-o", out, *arguments]
        process = subprocess.Popen(
            [*map(str, command)], stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        started.append(process)
        return process

    try:
        yield start
    finally:
        for process in started:
            if processes_of(process.pid):
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def wait_until(condition):
    """Come back once the condition holds; fail where it never does."""
    end = time.monotonic() + HANG
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def processes_of(group):
    """Processes of a group that are not merely waiting to be reaped."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its_group = path.read_text().rsplit(")", 1)[1].split()[:3]
        except OSError:
            continue
        if int(its_group) == group and state != "Z":
            found.append(int(path.parent.name))
    return found
