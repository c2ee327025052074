"""Settings of a call hold for its thread alone, and are gone afterwards."""

import logging
import os
import sys
import threading

import numpy as np
import pytest

from femseal.base.compiled import on_threads, thread_count, using_threads
from femseal.base.files import write_text
from femseal.base.machine import shared_empty, sharing, storing, within_free_memory
from femseal.flow.rectangles import Rectangles


def in_thread(function):
    """What a function returns in a thread of its own."""
    results = []
    thread = threading.Thread(target=lambda: results.append(function()))
    thread.start()
    thread.join()
    return results[0]


def test_threads_are_those_of_the_caller():
    with using_threads(2):
        assert (thread_count(), in_thread(thread_count)) == (2, 1)
        # a helper of a loop does not share its part again
        assert set(on_threads(2, lambda _: thread_count(), range(8))) <= {1, 2}
        with using_threads(3):
            assert thread_count() == 3
        assert thread_count() == 2
    assert thread_count() == 1


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="shared files are those of Linux")
def test_arrays_are_shared_by_the_caller_alone():
    def kind():
        return type(shared_empty((4,), np.float64))

    with sharing(), storing(None, 1.0):
        assert kind() is np.memmap
        assert in_thread(kind) is np.ndarray
    assert kind() is np.ndarray


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory")
def test_the_memory_is_not_limited_after_two_threads_have_read_files():
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    is_inside, may_end = threading.Event(), threading.Event()

    def read_first():
        with within_free_memory():
            is_inside.set()
            may_end.wait(10)

    def read_second():
        with within_free_memory():
            first.join(10)

    first = threading.Thread(target=read_first)
    first.start()
    is_inside.wait(10)
    second = threading.Thread(target=read_second)
    second.start()
    second.join(0.2)
    may_end.set()
    first.join()
    second.join()
    assert resource.getrlimit(resource.RLIMIT_AS) == before


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no umask")
@pytest.mark.parametrize("mask", [0o022, 0o077])
def test_a_file_has_the_usual_permissions(tmp_path, monkeypatch, mask):
    """The mask of the process is not touched: another thread may be making a file."""
    before = os.umask(mask)
    try:
        with monkeypatch.context() as patch:
            patch.delattr(os, "umask")
            path = write_text(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_other_meshes_still_warn_of_copies(caplog):
    """scikit-fem warns of a copy; a seal makes one on purpose, without a change of the logging of others."""
    log = logging.getLogger("skfem.mesh.mesh")
    lines = np.linspace(0.0, 1.0, 41)
    with caplog.at_level(logging.WARNING):
        Rectangles(lines, columns=40, period=1.0).mesh  # noqa: B018
        assert not caplog.records
        log.warning("Transforming over 1000 vertices to C_CONTIGUOUS.")
        assert len(caplog.records) == 1
