"""Compiled loops: the same results from Python and from compiled code, contained once; threads are those of the caller."""

import gc

import numpy as np
import pytest
from numba import njit
from numba.core import event
from numba.core.errors import TypingError
from own_thread import result_in_thread

from femseal.base import compiled
from femseal.base.compiled import on_threads, thread_count, using_threads


def _square_sum(first, end, values, squares):
    total = 0.0
    for i in range(first, end):
        squares[i] = values[i] ** 2
        total += squares[i]
    return total


def _add_neighbours(first, end, field, sums):
    for i in range(first, end):
        for j in range(field.shape[1]):
            sums[i, j] = field[i - 1, j] + field[i, j] + field[i + 1, j]


@pytest.fixture
def without_cache(monkeypatch):
    """Let each test compile its loops, so that the compilations can be counted."""
    monkeypatch.setitem(compiled._OPTIONS, "cache", False)


def _compiled_functions(call, *arguments):
    """Return the result of a call, and the names of all functions that Numba compiled in this call."""
    with event.install_recorder("numba:compile") as recorder:
        result = call(*arguments)
    starts = [e for _, e in recorder.buffer if e.is_start]
    return result, [e.data["dispatcher"].py_func.__name__ for e in starts]


def test_compiled_code_contains_a_loop_over_items_once(without_cache):
    square_sum = compiled.by_items(compiled.summed)(_square_sum)

    @njit
    def algorithm(values, squares):
        return square_sum(values.size, values, squares)

    values = np.arange(5.0)
    squares = np.zeros(5)
    total, functions = _compiled_functions(algorithm, values, squares)
    assert total == square_sum(5, values, np.zeros(5)) == 30.0
    np.testing.assert_array_equal(squares, values**2)
    # the loop is not compiled for itself
    assert functions.count("_square_sum") == 0
    assert functions.count("run_once") == 1


def test_compiled_code_contains_a_loop_over_rows_once(without_cache):
    add_neighbours = compiled.by_rows()(_add_neighbours)

    @njit
    def algorithm(field, sums):
        add_neighbours(field, sums)

    field = np.arange(12.0).reshape(4, 3)
    from_compiled = np.zeros((4, 3))
    from_python = np.zeros((4, 3))
    _, functions = _compiled_functions(algorithm, field, from_compiled)
    add_neighbours(field, from_python)
    expected = np.zeros((4, 3))
    expected[1:-1] = (
        field[:-2] + field[1:-1] + field[2:]
    )  # the first and the last row are the border
    np.testing.assert_array_equal(from_compiled, expected)
    np.testing.assert_array_equal(from_python, expected)
    assert functions.count("_add_neighbours") == 0
    assert functions.count("run_once") == 1


def test_threads_are_those_of_the_caller():
    with using_threads(2):
        assert (thread_count(), result_in_thread(thread_count)) == (2, 1)
        # a helper of a loop does not share its part again
        assert set(on_threads(2, lambda _: thread_count(), range(8))) <= {1, 2}
        with using_threads(3):
            assert thread_count() == 3
        assert thread_count() == 2
    assert thread_count() == 1


class CollectionLimits(event.Listener):
    """Records the limits of the garbage collection at the beginning and at the end of each compilation."""

    def __init__(self):
        self.limits = []

    def on_start(self, _):
        self.limits.append(gc.get_threshold())

    on_end = on_start


def test_python_looks_for_unreachable_objects_less_often_while_numba_compiles(without_cache):
    @compiled.compiled()
    def double(x):
        return 2 * x

    @compiled.compiled()
    def quadruple(x):
        return double(double(x))

    usual = gc.get_threshold()
    with event.install_listener("numba:compile", CollectionLimits()) as listener:
        assert quadruple(2.0) == 8.0
    limits = listener.limits
    assert len(limits) == 4
    # this listener is called after that of the package, which restores the limits at the end of the outer function
    assert limits[:3] == [compiled._FewerCollections.limits] * 3
    assert limits[3] == gc.get_threshold() == usual


def test_limits_of_collections_are_restored_if_a_function_cannot_be_compiled(without_cache):
    @compiled.compiled()
    def wrong(x):
        return x + None

    usual = gc.get_threshold()
    with pytest.raises(TypingError):
        wrong(1.0)
    assert gc.get_threshold() == usual


def test_a_compiled_division_by_zero_gives_infinity_or_an_undefined_number(without_cache):
    @compiled.compiled()
    def ratio(a, b):
        return a / b

    assert ratio(1.0, 0.0) == np.inf
    assert np.isnan(ratio(0.0, 0.0))


def test_garbage_collection_that_was_switched_off_stays_off(without_cache):
    @compiled.compiled()
    def triple(x):
        return 3 * x

    usual = gc.get_threshold()
    gc.set_threshold(0)
    try:
        with event.install_listener("numba:compile", CollectionLimits()) as listener:
            assert triple(2.0) == 6.0
        assert [first for first, *_others in listener.limits] == [0, 0]
        assert gc.get_threshold()[0] == 0
    finally:
        gc.set_threshold(*usual)
