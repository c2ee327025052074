"""Flow between all points on the sides of windows, by conjugate gradients from the solution between a few nodes.

Interpolation between nodes leaves out what flows between them. Each iteration corrects the potential at every side
point by two parts: one at the nodes, for all windows at once, and one on each side alone. The energy that the
iterations take off tells how far from the least it still is.
Sources: Toselli & Widlund, Domain Decomposition Methods, Springer 2005, ch. 2 and 4 (two-level additive Schwarz);
Strakoš & Tichý, Electron. Trans. Numer. Anal. 13, 2002, 56 (estimates of the error in energy).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ..windows.partition import Partition
from .element_elimination import Factors

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Relative error of the energy at which iterations stop, and how many of them there are at most.
TOLERANCE, MOST_ITERATIONS = 1e-3, 200
#: The error of the energy is estimated by what this number of iterations took off: that of the potential before them.
DELAY = 4
#: Share of the energy below which a correction is due to the couples' single precision.
_ROUNDING = 1e-12

_exact: dict[str, Any] = {"cache": True, "nogil": True}
_fast: dict[str, Any] = {**_exact, "error_model": "numpy", "fastmath": {"reassoc", "contract"}}


@dataclass(frozen=True, eq=False)
class PointFlow:
    """Potential at all side points (points,) and how it was found.

    saved : energy that the iterations took off [m³]. error : estimate of what is left of its error [m³].
    dissipation : energy of each window [m³].
    """

    potential: Array
    saved: float
    error: float
    dissipation: Array


@dataclass(frozen=True, eq=False)
class SidePoints:
    """Couples between the side points of all windows, in single precision, and the sides as blocks.

    Side points are numbered row after row: those on the lines across x1 (m1 + 1, n2), then those before each column of
    windows (n1, m2).

    partition : of the face. windows : of every window the numbers of its side points that are open (q,), its couples
    between them below the diagonal (q (q − 1)/2,), and their unit [m³].
    """

    partition: Partition
    windows: list[tuple[Indices, NDArray[np.float32], float]] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of side points."""
        (n1, n2), (m1, m2) = self.partition.shape, self.partition.cells
        return (m1 + 1) * n2 + n1 * m2

    def numbers(self, i: int, j: int) -> Indices:
        """Numbers of the side points of a window, in the order of its element."""
        n2, (m1, m2), (w1, w2) = self.partition.shape[1], self.partition.cells, self.partition.window
        columns, rows = np.arange(j * w2, (j + 1) * w2), np.arange(i * w1, (i + 1) * w1)
        across = (m1 + 1) * n2 + rows * m2
        return np.concatenate([i * n2 + columns, (i + 1) * n2 + columns, across + j, across + (j + 1) % m2])

    def add(self, i: int, j: int, couples: Array) -> None:
        """Keep the couples (p, p) of a window."""
        is_open = np.flatnonzero(couples.any(axis=1))
        unit = float(couples.max()) or 1.0
        self.windows.append((self.numbers(i, j)[is_open], _packed(couples, is_open, unit), unit))

    def improved(self, potential: Array, energy: float, node: Indices, weight: Array, factors: Factors) -> PointFlow:
        """Lessen the energy of a potential (points,) until its error is estimated to be below `TOLERANCE`.

        Parameters
        ----------
        energy : of the potential [m³].
        node, weight (points, 2) : nodes between which the potential at a side point is interpolated.
        factors : of the system of the nodes.
        """
        n2, lines = self.partition.shape[1], self.partition.cells[0]
        free = np.ones(self.count, bool)
        free[:n2] = free[lines * n2 : (lines + 1) * n2] = False

        def at_nodes(residual: Array) -> Array:
            shares: Array = weight * residual[:, None]
            sources: Array = np.bincount(node.ravel(), shares.ravel(), factors.nodes).astype(float)
            return np.asarray((weight * factors.under(sources)[node]).sum(axis=1))

        x = potential.copy()
        residual, _ = self._flows(x)
        residual = np.where(free, -residual, 0.0)
        direction, product, saved = np.zeros(self.count), 1.0, 0.0
        latest: deque[float] = deque(maxlen=DELAY)
        for n in range(MOST_ITERATIONS):
            correction = self._on_sides(residual) + at_nodes(residual)
            correction[~free] = 0.0
            former, product = product, float(residual @ correction)
            if not product > 0.0:
                break
            direction = correction + (product / former if n else 0.0) * direction
            image, bend = self._flows(direction)
            image[~free] = 0.0
            step = product / float(bend.sum())
            if step * product <= _ROUNDING * energy:
                break
            x += step * direction
            residual -= step * image
            latest.append(step * product)
            saved += step * product
            if len(latest) == DELAY and sum(latest) <= TOLERANCE * (energy - saved):
                break
        if latest:
            # what flows into a window flows out of it again
            correction = np.where(free, at_nodes(residual), 0.0)
            x += correction
            saved += float(residual @ correction)
        _, dissipation = self._flows(x)
        return PointFlow(x, saved, sum(latest), dissipation)

    def _flows(self, potential: Array) -> tuple[Array, Array]:
        """Flow out of every side point (points,), and the energy of every window [m³]."""
        out, energy = np.zeros(self.count), np.zeros(len(self.windows))
        for n, (number, couples, unit) in enumerate(self.windows):
            flow, energy[n] = _window_flows(couples, potential[number], unit)
            np.add.at(out, number, flow)
        return out, energy

    def _on_sides(self, sources: Array) -> Array:
        """Potential (points,) on each side for sources at its points while all other sides are held at 0."""
        x = np.zeros(self.count)
        for number, couples, total in self._sides:
            x[number] = _side_potential(couples, total, sources[number])
        return x

    @cached_property
    def _sides(self) -> list[tuple[Indices, NDArray[np.float32], Array]]:
        """Of every side between windows its points, its eliminated couples and their sums, see `_side_factors`."""
        (m1, m2), (w1, w2) = self.partition.cells, self.partition.window
        blocks: dict[tuple[int, int, int], tuple[Indices, Array, Array]] = {}
        found = []
        for place, (number, couples, unit) in enumerate(self.windows):
            i, j = divmod(place, m2)
            points, next_column = self.numbers(i, j), (j + 1) % m2
            before, after, left, right = np.split(points, [w2, 2 * w2, 2 * w2 + w1])
            sides = {(0, i, j): before, (0, i + 1, j): after, (1, i, j): left, (1, i, next_column): right}
            for key, numbers in sides.items():
                if key[0] == 0 and key[1] in (0, m1):
                    continue  # inlet and outlet
                if key not in blocks:
                    blocks[key] = numbers, np.zeros((numbers.size, numbers.size)), np.zeros(numbers.size)
                point = np.searchsorted(numbers, number) % numbers.size
                _add_side(couples, numbers[point] == number, point, unit, *blocks[key][1:])
            if j == m2 - 1:
                for key in [key for key in blocks if key[1] == i]:
                    numbers, block, ground = blocks.pop(key)
                    found.append((numbers, *_side_factors(block, ground)))
        return found


@njit(**_exact)
def _packed(couples, is_open, unit):
    q = is_open.size
    packed = np.empty(q * (q - 1) // 2, np.float32)
    k = 0
    for a in range(q):
        for b in range(a):
            packed[k] = couples[is_open[a], is_open[b]] / unit
            k += 1
    return packed


@njit(**_fast)
def _window_flows(couples, potential, unit):
    """Flow out of the points of a window into it, and its energy."""
    q = potential.size
    flow, energy, k = np.zeros(q), 0.0, 0
    for a in range(q):
        here, total = potential[a], 0.0
        row = couples[k : k + a]
        for b in range(a):
            drop = here - potential[b]
            through = unit * row[b] * drop
            total += through
            flow[b] -= through
            energy += through * drop
        flow[a] += total
        k += a
    return flow, energy


@njit(**_exact)
def _add_side(couples, on_side, point, unit, block, ground):
    """Add the couples of a window among the points of a side, and the sums of those to all other points."""
    k = 0
    for a in range(on_side.size):
        for b in range(a):
            c = unit * couples[k]
            k += 1
            if on_side[a] and on_side[b]:
                if point[a] != point[b]:
                    block[point[a], point[b]] += c
                    block[point[b], point[a]] += c
            elif on_side[a]:
                ground[point[a]] += c
            elif on_side[b]:
                ground[point[b]] += c


@njit(**_exact)
def _side_factors(block, ground):
    """Eliminate the points of a side in place; shares of later points in the couples of each, and the sums of these."""
    n = ground.size
    total = np.zeros(n)
    packed = np.zeros(n * (n - 1) // 2, np.float32)
    k = 0
    for i in range(n):
        total[i] = ground[i]
        for j in range(i + 1, n):
            total[i] += block[i, j]
        for j in range(i + 1, n):
            share = block[i, j] / total[i] if total[i] > 0.0 else 0.0
            packed[k] = share
            k += 1
            if share > 0.0:
                ground[j] += share * ground[i]
                for m in range(i + 1, n):
                    if m != j:
                        block[j, m] += share * block[i, m]
    return packed, total


@njit(**_exact)
def _side_potential(shares, total, sources):
    """Potential at the points of a side for sources there, with 0 on all other sides."""
    n = total.size
    x = sources.copy()
    k = 0
    for i in range(n):
        for j in range(i + 1, n):
            x[j] += shares[k] * x[i]
            k += 1
    for i in range(n - 1, -1, -1):
        value = x[i] / total[i] if total[i] > 0.0 else 0.0
        for j in range(n - 1, i, -1):
            k -= 1
            value += shares[k] * x[j]
        x[i] = value
    return x
