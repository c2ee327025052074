"""Plan Fourier transforms with FFTW, in the same way in every process.

FFTW plans its transforms with the option FFTW_ESTIMATE and without wisdom. The plans then follow from fixed rules
instead of measured times. All processes therefore use the same plans and give identical results. On 256² to 1024²
points, a contact solution with these plans takes 0.9 to 1.03 times as long as with measured plans if the axes are
periodic, and 0.8 to 0.95 times as long if they are mirrors. On smaller periodic grids, contact solutions take longer
than with measured plans: by 2 % at 48², 8 % at 64², 12 % at 96² and 24 % at 128² points.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

from ..base import Indices

#: A call without arguments that a stage consists of.
Call = Callable[..., Any]
#: A function that plans a transform and its inverse, see `planner`.
Planned = Callable[..., tuple[Call, Call]]
#: Size of a cache line [byte].
LINE = 64
#: Long rows of waves take 8k + 3 cache lines, so that the points of a column do not displace each other in the cache.
_LINES, _MORE_LINES = 8, 3
#: FFTW makes plans in one thread at a time.
_PLANNING = threading.RLock()


class Axis(NamedTuple):
    """Describe an axis of a grid and its transform.

    points : number of points.
    length : length of the transform.
    order : array (points,), grid index of the point at each position in the transform.
    is_mirror : whether the pressure is mirrored beyond the ends of the axis.
    """

    points: int
    length: int
    order: Indices
    is_mirror: bool

    @property
    def is_padded(self) -> bool:
        """Whether zeros are appended to the points of the axis."""
        return self.length > self.points


def row_length(waves: int, itemsize: int) -> int:
    """Compute the stride between successive rows, counted in waves and including unused cache lines."""
    lines = math.ceil(waves * itemsize / LINE)
    if lines <= _LINES:
        return waves
    return (lines + (_MORE_LINES - lines) % _LINES) * LINE // itemsize


@cache
def fftw() -> Any:
    """Import pyfftw without its transforms of Dask arrays, because importing Dask takes longer than a small run."""
    hides_dask = "dask" not in sys.modules
    if hides_dask:
        sys.modules["dask"] = None  # type: ignore[assignment]
    try:
        import pyfftw
    finally:
        if hides_dask:
            del sys.modules["dask"]
    return pyfftw


@contextmanager
def planner() -> Iterator[Planned]:
    """Provide a function that plans a transform and its inverse, for use in a `with` block.

    The transform reads `points` and writes `waves`. The inverse transform overwrites `waves` and writes `target`.

    Which plan FFTW chooses depends on its earlier plans, which FFTW calls wisdom. The wisdom is therefore deleted
    before each plan. It is kept only if the arrays have the same shapes, strides and types as for the previous plan:
    with the wisdom of an identical plan, FFTW plans ten times as fast. At the end of the `with` block, the wisdom that
    existed before the block is restored. Saving and restoring the wisdom takes milliseconds.
    """
    pyfftw = fftw()
    last_problem = None

    def planned(points: Any, waves: Any, target: Any, *, axis: int) -> tuple[Any, Any]:
        """Plan the transform from `points` to `waves` and the inverse transform from `waves` to `target`.

        Returns two functions without arguments that perform the transform and the inverse transform.
        """
        nonlocal last_problem
        problem = [(a.shape, a.strides, a.dtype) for a in (points, waves, target)]
        if problem != last_problem:
            pyfftw.forget_wisdom()
        last_problem = problem
        forward = pyfftw.FFTW(points, waves, (axis,), "FFTW_FORWARD", ("FFTW_ESTIMATE",))
        backward = pyfftw.FFTW(
            waves, target, (axis,), "FFTW_BACKWARD", ("FFTW_ESTIMATE", "FFTW_DESTROY_INPUT")
        )
        return forward.execute, backward.execute

    with _PLANNING:
        wisdom = pyfftw.export_wisdom()
        try:
            yield planned
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(wisdom)
