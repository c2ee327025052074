"""Memory that processes share, and limits of the memory."""

import os
import sys
import threading

import numpy as np
import pytest
from own_thread import result_in_thread

from femseal.base.machine import within_free_memory
from femseal.base.shared_arrays import shared_empty, sharing, storing


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="shared files are those of Linux")
def test_arrays_are_shared_by_the_caller_alone():
    def kind():
        return type(shared_empty((4,), np.float64))

    with sharing(), storing(None, 1.0):
        assert kind() is np.memmap
        assert result_in_thread(kind) is np.ndarray
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


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is that of Linux")
def test_memory_is_refused_instead_of_ending_the_process(monkeypatch):
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    monkeypatch.setattr("femseal.base.machine.free_memory", lambda: 5e8)
    with pytest.raises(MemoryError), within_free_memory():
        bytearray(2_000_000_000)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    bytearray(2_000_000_000)
