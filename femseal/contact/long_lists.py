"""The loops of `kernels` and `gradient_kernels` in parts, which several threads share where lists are long.

How a list falls into parts depends on its length only, and sums are taken part by part: any number of threads gives the
same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import Any

from ..base.threads import on_threads, parts
from . import gradient_kernels, kernels

#: Points of a grid, and of a list, in a part: the loops over it take a few tenths of a millisecond.
POINTS, LISTED = 2**19, 2**16


class ShortLists:
    """The kernels as they are, for a grid whose lists are short."""

    add_gap, look, project = map(staticmethod, (kernels.add_gap, kernels.look, kernels.project))
    restart, turn, step = map(staticmethod, (gradient_kernels.restart, gradient_kernels.turn, gradient_kernels.step))


class LongLists:
    """The kernels in parts, with the arguments and results of those of the same names."""

    def __init__(self, threads: int) -> None:
        self._threads = threads

    def add_gap(
        self, _: int, end: int, add: bool, n: int, k: int, p: Any, v: Any, gap0: Any, offset: float, reach: float,
        *arrays: Any,
    ) -> Any:  # fmt: skip
        """As `kernels.add_gap`, on all rows."""
        threads, state = self._threads, arrays[2]
        pieces = rows_in_parts(v, p.size)
        starts = [(0, 0)]
        head = v, gap0, offset, reach
        for n, k in on_threads(threads, lambda part: kernels.count_near(*part, add, *head, state), pieces):
            starts.append((starts[-1][0] + n, starts[-1][1] + k))
        found = on_threads(
            threads,
            lambda at: kernels.add_gap(*at[0], False, *at[1], p, *head, *arrays),
            zip(pieces, starts[:-1], strict=True),
        )
        return *starts[-1], *_sums([sums for _, _, *sums in found])

    def look(
        self, n: int, c: float, load: float, loaded: bool, delta: float, hardness: Any, slope: Any, *arrays: Any
    ) -> Any:
        """As `kernels.look`."""
        if not _is_long(n):
            return kernels.look(n, c, load, loaded, delta, hardness, slope, *arrays)
        (_, lists, near), line, carried = arrays, (hardness, slope), True
        self._each(n, kernels.find_trial, c, near)
        if loaded:
            delta, carried = self._root(near[0], n, *line, c, lists[0], c, load, delta)
        sums = _sums(self._each(n, kernels.compare, c, delta, *line, *arrays))
        return delta, carried, *kernels.residual(*sums)

    def _root(
        self,
        x: Any,
        n: int,
        hardness: Any,
        slope: Any,
        kept: float,
        listed: Any,
        c: float,
        load: float,
        start: float,
    ) -> tuple[float, bool]:
        """As `kernels.root`."""
        if not _is_long(n):
            return kernels.root(x, n, hardness, slope, kept, listed, c, load, start)
        line = hardness, slope, kept, listed
        highest, full, capacity, rise = zip(*self._each(n, kernels.capacity, x, *line, load), strict=True)
        limits = max(highest), max(full), sum(capacity), sum(rise)
        found, carried, d, low, top = kernels.bracket(*limits, c, load, start)
        for _ in range(kernels.ROOT_STEPS):
            if found:
                break
            total, slopes = _sums(self._each(n, kernels.carry, x, c * d, *line))
            found, d, low, top = kernels.refine(total, slopes, c, load, d, low, top)
        return d, carried

    def project(
        self, n: int, free: int, c: float, delta: float, load: float, loaded: bool, keep: bool,
        p: Any, hardness: Any, slope: Any, state: Any, lists: Any, near: Any, dense: Any,
    ) -> int:  # fmt: skip
        """As `kernels.project`."""
        line = hardness, slope
        if not _is_long(n):
            return kernels.project(n, free, c, delta, load, loaded, keep, p, *line, state, lists, near, dense)
        self._each(free, kernels.clear, lists, dense)
        counts = self._each(n, kernels.assign, False, c, delta, keep, p, *line, state, lists, near)
        places = zip(parts(n, LISTED), [0, *accumulate(k for k, _ in counts)], strict=False)
        on_threads(self._threads, lambda at: kernels.list_free(*at[0], at[1], state, lists, near), places)
        k, carried = _sums(counts)
        if k > 0 and load - carried > 0.0 and loaded:
            uniform, _ = self._root(near[3], k, *line, 0.0, lists[1], 1.0, load - carried, 0.0)
            self._each(k, kernels.shift, c, uniform, p, *line, lists, near)
        return k

    def restart(
        self, free: int, delta: float, loaded: bool, hardens: bool, hardness: Any, slope: Any, state: Any,
        lists: Any, near: Any, on_free: Any, dense: Any, *stencil: Any,
    ) -> float:  # fmt: skip
        """As `gradient_kernels.restart`."""
        line, fields, made = (hardness, slope), (on_free, dense), gradient_kernels
        if not _is_long(free):
            return made.restart(free, delta, loaded, hardens, *line, state, lists, near, *fields, *stencil)
        self._each(free, made.lay_ones, hardens, slope, state, lists, *fields, stencil[0])
        sums = self._each(free, made.first_residual, delta, hardens, *line, state, lists, near, *fields, *stencil)
        ones, total = _sums(sums)
        self._each(free, made.spread_residual, total / free if loaded else 0.0, hardens, lists, *fields)
        return ones

    def turn(
        self, free: int, former: float, ones_total: float, loaded: bool, hardens: bool,
        lists: Any, on_free: Any, dense: Any, *stencil: Any,
    ) -> float:  # fmt: skip
        """As `gradient_kernels.turn`."""
        made = gradient_kernels
        if not _is_long(free):
            return made.turn(free, former, ones_total, loaded, hardens, lists, on_free, dense, *stencil)
        total = sum(self._each(free, made.precondition, hardens, lists, on_free, dense, *stencil))
        wr = sum(self._each(free, made.level, total / ones_total if loaded else 0.0, on_free))
        if wr > 0.0:
            self._each(free, made.direct, wr / former, lists, on_free, dense)
        return wr

    def step(
        self, n: int, free: int, wr: float, loaded: bool, hardens: bool,
        kd: Any, lists: Any, near: Any, on_free: Any, dense: Any,
    ) -> tuple[float, float, bool]:  # fmt: skip
        """As `gradient_kernels.step`."""
        made = gradient_kernels
        if not _is_long(n):
            return made.step(n, free, wr, loaded, hardens, kd, lists, near, on_free, dense)
        self._each(n, made.gather, kd, dense.size // len(kd), lists, near)
        curvature, length, stiff = _sums(self._each(free, made.curvatures, hardens, lists, near, on_free))
        total = 0.0
        if stiff > 0.0:
            total = sum(self._each(free, made.advance, wr / stiff, hardens, lists, near, on_free))
            self._each(n, made.advance_gap, wr / stiff, near)
        mean = total / free if loaded and free > 0 else 0.0
        self._each(free, made.spread_residual, mean, hardens, lists, on_free, dense)
        return curvature, length, stiff > 0.0

    def _each(self, n: int, kernel: Callable[..., Any], *arguments: Any) -> list[Any]:
        """The values of a kernel on the parts of n listed points."""
        return on_threads(self._threads, lambda part: kernel(*part, *arguments), parts(n, LISTED))


def lists_of(points: int, threads: int) -> ShortLists | LongLists:
    """The kernels for a grid of so many points."""
    return LongLists(threads) if points > POINTS else ShortLists()


def rows_in_parts(v: Any, points: int) -> list[tuple[int, int]]:
    """First and last + 1 of the rows of the parts of a grid of so many points."""
    return parts(len(v), POINTS * len(v) / points)


def _is_long(n: int) -> bool:
    return len(parts(n, LISTED)) > 1


def _sums(rows: list[tuple[Any, ...]]) -> list[Any]:
    return [sum(column) for column in zip(*rows, strict=True)]
