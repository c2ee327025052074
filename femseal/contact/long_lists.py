"""The loops of `kernels` and `gradient_kernels` in parts, which several threads share where lists are long.

How a list falls into parts depends on its length only, and sums are taken part by part: any number of threads gives the
same bits.
"""

from collections.abc import Callable
from itertools import accumulate
from types import SimpleNamespace
from typing import Any

from ..base import Shape
from ..base.threads import on_threads, parts
from . import gradient_kernels, kernels
from .kernels import FREE, KD, NEAR, PLACE, Line, Points, Stencil, W, X

#: Points of a grid, and of a list, in a part: the loops over it take a few tenths of a millisecond.
POINTS, LISTED = 2**19, 2**16


#: The kernels as they are, for a grid whose lists are short.
SHORT_LISTS = SimpleNamespace(
    add_gap=kernels.add_gap,
    look=kernels.look,
    project=kernels.project,
    restart=gradient_kernels.restart,
    turn=gradient_kernels.turn,
    step=gradient_kernels.step,
)


class LongLists:
    """The kernels in parts, with the arguments and results of those of the same names."""

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def add_gap(
        self, _: int, end: int, add: bool, n: int, k: int, p: Any, v: Any, *rest: Any
    ) -> Any:
        """As `kernels.add_gap`, on all rows."""
        points, columns = Points(*rest[-1]), p.size // end
        # each part lists its points from the place of its first one on
        found = on_threads(
            self._threads,
            lambda rows: kernels.add_gap(*rows, add, *[rows[0] * columns] * 2, p, v, *rest),
            pieces := rows_in_parts(v, p.size),
        )
        for (first, _), (end_near, end_free, *_) in zip(pieces, found, strict=True):
            start = first * columns
            near, free = slice(start, end_near), slice(start, end_free)
            more, more_free = end_near - start, end_free - start
            points.lists[NEAR, n : n + more] = points.lists[NEAR, near]
            points.near[:, n : n + more] = points.near[:, near]
            points.lists[FREE, k : k + more_free] = points.lists[FREE, free]
            points.lists[PLACE, k : k + more_free] = points.lists[PLACE, free] - (start - n)
            n, k = n + more, k + more_free
        return n, k, *_sums([sums for _, _, *sums in found])

    def look(
        self, n: int, c: float, load: float, loaded: bool, delta: float, line: Any, points: Any
    ) -> Any:
        """As `kernels.look`."""
        line, points, carried = Line(*line), Points(*points), True
        self._each(n, kernels.find_trial, c, points)
        if loaded:
            x, listed = points.near[X], points.lists[NEAR]
            delta, carried = self._root(x, n, line, c, listed, c, load, delta)
        return delta, carried, *_sums(self._each(n, kernels.compare, c, delta, line, points))

    def _root(
        self,
        x: Any,
        n: int,
        line: Line,
        kept: float,
        listed: Any,
        c: float,
        load: float,
        start: float,
    ) -> tuple[float, bool]:
        """As `kernels.root`."""
        of = line, kept, listed
        highest, full, capacity, rise = zip(
            *self._each(n, kernels.capacity, x, *of, load), strict=True
        )
        sums = max(highest), max(full), sum(capacity), sum(rise)
        delta, low, top, carried = kernels.bracket(*sums, c, load, start)
        for _ in range(kernels.ROOT_STEPS):
            if low == top:
                break
            carry = _sums(self._each(n, kernels.carry, x, c * delta, *of))
            delta, low, top = kernels.refine(delta, low, top, *carry, c, load)
        return delta, carried

    def project(
        self, n: int, free: int, c: float, delta: float, load: float, loaded: bool, keep: bool,
        p: Any, line: Any, points: Any,
    ) -> int:  # fmt: skip
        """As `kernels.project`."""
        line, points = Line(*line), Points(*points)
        self._each(free, kernels.clear, points)
        counts = self._each(n, kernels.assign, c, delta, keep, p, line, points)
        places = zip(parts(n, LISTED), [0, *accumulate(k for k, _ in counts)], strict=False)
        on_threads(self._threads, lambda at: kernels.list_free(*at[0], at[1], points), places)
        k, carried = _sums(counts)
        if k > 0 and load - carried > 0.0 and loaded:
            y, listed = points.near[KD], points.lists[FREE]
            uniform, _ = self._root(y, k, line, 0.0, listed, 1.0, load - carried, 0.0)
            self._each(k, kernels.shift, c, uniform, p, line, points)
        return k

    def restart(
        self, free: int, delta: float, loaded: bool, line: Any, points: Any, stencil: Any
    ) -> float:
        """As `gradient_kernels.restart`."""
        line, points, stencil = Line(*line), Points(*points), Stencil(*stencil)
        self._each(free, gradient_kernels.lay_ones, line, points, stencil)
        ones, total = _sums(
            self._each(free, gradient_kernels.first_residual, delta, line, points, stencil)
        )
        self._spread(free, total, loaded, points)
        return ones

    def turn(
        self, free: int, former: float, ones_total: float, loaded: bool, points: Any, stencil: Any
    ) -> float:
        """As `gradient_kernels.turn`."""
        points, stencil = Points(*points), Stencil(*stencil)
        w = points.on_free[W]
        total = sum(self._each(free, gradient_kernels.preconditioned, w, points, stencil))
        factor = total / ones_total if loaded else 0.0
        wr = sum(self._each(free, gradient_kernels.level, factor, points))
        if wr > 0.0:
            self._each(free, gradient_kernels.direct, wr / former, points)
        return wr

    def step(
        self, n: int, free: int, wr: float, loaded: bool, kd: Any, points: Any
    ) -> tuple[float, float, bool]:
        """As `gradient_kernels.step`."""
        points = Points(*points)
        self._each(n, gradient_kernels.gather, kd, points.dense.size // len(kd), points)
        curvature, length, stiff = _sums(self._each(free, gradient_kernels.curvatures, points))
        total = 0.0
        if stiff > 0.0:
            total = sum(self._each(free, gradient_kernels.advance, wr / stiff, points))
            self._each(n, gradient_kernels.advance_gap, wr / stiff, points)
        self._spread(free, total, loaded, points)
        return curvature, length, stiff > 0.0

    def _spread(self, free: int, total: float, loaded: bool, points: Points) -> None:
        mean = total / free if loaded and free > 0 else 0.0
        self._each(free, gradient_kernels.spread_residual, mean, points)

    def _each(self, n: int, kernel: Callable[..., Any], *arguments: Any) -> list[Any]:
        """The values of a kernel on the parts of n listed points."""
        return on_threads(self._threads, lambda part: kernel(*part, *arguments), parts(n, LISTED))


def lists_of(points: int, threads: int) -> Any:
    """The kernels for a grid of so many points."""
    return LongLists(threads) if points > POINTS else SHORT_LISTS


def rows_in_parts(v: Any, points: int) -> list[Shape]:
    """First and last + 1 of the rows of the parts of a grid of so many points."""
    return parts(len(v), POINTS * len(v) / points)


def _sums(rows: list[tuple[Any, ...]]) -> list[Any]:
    return [sum(column) for column in zip(*rows, strict=True)]
