"""Flow between all points on the sides of windows, by conjugate gradients from the solution between a few nodes.

Interpolation between nodes leaves out what flows between them. Each iteration corrects the potential at every side
point by two parts: one at the nodes, for all windows at once, and one on each side alone. The energy that the
iterations take off shows how far from the least it still is.
Sources: Toselli & Widlund, Domain Decomposition Methods, Springer 2005, ch. 2 and 4 (two-level additive Schwarz);
Strakoš & Tichý, Electron. Trans. Numer. Anal. 13, 2002, 56 (estimates of the error in energy).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Array, Indices
from ..base.compiled import compiled
from ..base.threads import number, on_threads
from ..flow.solvers.elimination import Links, Order, factored
from ..windows.partition import Partition
from .element_mesh import MeshFactors

#: Relative error of the energy at which iterations stop, and how many of them there are at most.
TOLERANCE, MOST_ITERATIONS = 1e-3, 200
#: The error of the energy is estimated by what this number of iterations took off: that of the potential before them.
DELAY = 4
#: Fraction of the energy below which a correction is due to the conductances' single precision.
_ROUNDING = 1e-12


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


class PointLinks(NamedTuple):
    """Conductances between the side points of a window that are open.

    is_open (q,) : numbers of these points in the window. conductances (q (q − 1)/2,) : below the diagonal, in single
    precision over `unit` [m³], the largest.
    """

    is_open: Indices
    conductances: NDArray[np.float32]
    unit: float

    @classmethod
    def of(cls, conductances: Array) -> PointLinks:
        """Those of a window from the conductances (p, p) between all of its side points."""
        return cls(*_below_diagonal(conductances))


@dataclass(frozen=True, eq=False)
class SidePoints:
    """Conductances between the side points of all windows, in single precision, and the sides as blocks.

    Side points are numbered row after row: those on the lines across x1 (m1 + 1, n2), then those before each column of
    windows (n1, m2).

    partition : of the face. windows : of every window the numbers of its side points that are open (q,), and
    conductances and unit of its `PointLinks`.
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

    def add(self, i: int, j: int, links: PointLinks) -> None:
        """Keep the conductances of a window."""
        self.windows.append((self.numbers(i, j)[links.is_open], links.conductances, links.unit))

    def improved(
        self, potential: Array, energy: float, node: Indices, weight: Array, factors: MeshFactors
    ) -> PointFlow:
        """Lessen the energy of a potential (points,) until its error is estimated to be below `TOLERANCE`.

        energy : of the potential [m³].
        node, weight (points, 2) : nodes between which the potential at a side point is interpolated.
        factors : of the system of the nodes.
        """
        n2, lines = self.partition.shape[1], self.partition.cells[0]
        free = np.ones(self.count, bool)
        free[:n2] = free[lines * n2 : (lines + 1) * n2] = False

        def at_nodes(residual: Array) -> Array:
            fractions: Array = weight * residual[:, None]
            sources: Array = np.bincount(node.ravel(), fractions.ravel(), factors.nodes).astype(float)
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
        found = on_threads(
            number(), lambda window: _window_flows(window[1], potential[window[0]], window[2]), self.windows
        )
        for n, (flow, energy[n]) in enumerate(found):
            np.add.at(out, self.windows[n][0], flow)
        return out, energy

    def _on_sides(self, sources: Array) -> Array:
        """Potential (points,) on each side for sources at its points while all other sides have 0."""
        points, starts, fractions, inverse = self._sides
        v = sources[points]
        _solve_sides(starts, fractions, inverse, v)
        x = np.zeros(self.count)
        x[points] = v
        return x

    @cached_property
    def _sides(self) -> tuple[Indices, Indices, NDArray[np.float32], Array]:
        """The open points of all sides between windows, eliminated side by side; all other points have 0.

        Points, where those of each side start and end, see `_side_fractions`, and the inverse sums.
        """
        (m1, m2), (w1, w2) = self.partition.cells, self.partition.window
        blocks: dict[tuple[int, int, int], tuple[Indices, Array]] = {}
        points, starts, inverses = [np.empty(0, np.int64)], [0], [np.empty(0)]
        # no list of parts: joining them would take their memory twice
        fractions = np.empty(m2 * ((m1 - 1) * w2 * (w2 - 1) + m1 * w1 * (w1 - 1)) // 2, np.float32)
        filled = 0
        for place, (own, packed, unit) in enumerate(self.windows):
            i, j = divmod(place, m2)
            before, after, left, right = np.split(self.numbers(i, j), [w2, 2 * w2, 2 * w2 + w1])
            sides = {(0, i, j): before, (0, i + 1, j): after, (1, i, j): left, (1, i, (j + 1) % m2): right}
            for key, numbers in sides.items():
                if key[0] == 0 and key[1] in (0, m1):
                    continue  # inlet and outlet
                if key not in blocks:
                    blocks[key] = numbers, np.zeros((numbers.size, numbers.size + 1))
                point = np.searchsorted(numbers, own) % numbers.size
                _add_side(packed, np.where(numbers[point] == own, point, -1), unit, blocks[key][1])
            if j == m2 - 1:
                for key in [key for key in blocks if key[1] == i]:
                    numbers, block = blocks.pop(key)
                    is_open = block.any(axis=1)
                    numbers, block = numbers[is_open], block[is_open][:, np.append(is_open, True)]
                    points.append(numbers)
                    starts.append(starts[-1] + numbers.size)
                    of_side, inverse = _side_fractions(block)
                    fractions[filled : filled + of_side.size] = of_side
                    filled += of_side.size
                    inverses.append(inverse)
        return np.concatenate(points), np.array(starts), fractions, np.concatenate(inverses)


def _side_fractions(block: Array) -> tuple[NDArray[np.float32], Array]:
    """Eliminate the points of a side from the conductances (n, n + 1) between them and, last column, to all others.

    The fractions that each point has of the later ones, row after row, and the inverse sums [1/m³].
    """
    n = len(block)
    first, later = np.triu_indices(n, 1, n + 1)
    links = Links(np.searchsorted(first, np.arange(n + 1)), later, block[first, later])
    factors = factored(Order(np.arange(n), np.array([0, n]), np.array([1])), links, 1)
    border = int(factors.start[-1])  # 0 or 1: nothing leads to other sides where all is closed
    kept = factors.links.reshape(n, n + border)[np.triu_indices(n, 1, n)]
    rows = np.repeat(factors.inverse, np.arange(n - 1, -1, -1))
    return (kept * rows).astype(np.float32), factors.inverse


@compiled()
def _below_diagonal(conductances):
    """`PointLinks` of conductances (p, p)."""
    p = conductances.shape[0]
    open_points, q, unit = np.empty(p, np.int64), 0, 0.0
    for a in range(p):
        largest = 0.0
        for b in range(p):
            largest = max(largest, conductances[a, b])
        if largest > 0.0:
            open_points[q] = a
            q += 1
            unit = max(unit, largest)
    unit = unit if unit > 0.0 else 1.0
    packed, k = np.empty(q * (q - 1) // 2, np.float32), 0
    for m in range(q):
        a = open_points[m]
        for n in range(m):
            packed[k] = conductances[a, open_points[n]] / unit
            k += 1
    return open_points[:q].copy(), packed, unit


@compiled(error_model="numpy", fastmath={"reassoc", "contract"})
def _solve_sides(starts, fractions, inverse, v):
    """Potentials of the points of all sides in place of sources v, all other points having 0."""
    k = 0
    for s in range(starts.size - 1):
        a, b = starts[s], starts[s + 1]
        for i in range(a, b):
            row, here, later = fractions[k : k + b - 1 - i], v[i], v[i + 1 : b]
            for j in range(row.size):
                later[j] += row[j] * here
            k += row.size
        for i in range(b - 1, a - 1, -1):
            row, later = fractions[k - (b - 1 - i) : k], v[i + 1 : b]
            here = v[i] * inverse[i]
            for j in range(row.size):
                here += row[j] * later[j]
            v[i] = here
            k -= row.size
        k += (b - a) * (b - a - 1) // 2


@compiled()
def _add_side(packed, point, unit, block):
    """Add the conductances of a window between points of a side and, last column, to its other points.

    point : of the side, of each point of the window; −1 where it is on another side.
    """
    k = 0
    for a in range(point.size):
        for b in range(a):
            i, j, c = point[a], point[b], unit * packed[k]
            k += 1
            if i >= 0 and j >= 0:
                if i != j:  # both sides of a window that is a ring of its own are one
                    block[i, j] += c
                    block[j, i] += c
            elif i >= 0:
                block[i, -1] += c
            elif j >= 0:
                block[j, -1] += c


@compiled(error_model="numpy", fastmath={"reassoc", "contract"})
def _window_flows(conductances, potential, unit):
    """Flow out of the points of a window into it, and its energy."""
    q = potential.size
    flow, energy, k = np.zeros(q), 0.0, 0
    for a in range(q):
        here, total = potential[a], 0.0
        row = conductances[k : k + a]
        for b in range(a):
            drop = here - potential[b]
            through = unit * row[b] * drop
            total += through
            flow[b] -= through
            energy += through * drop
        flow[a] += total
        k += a
    return flow, energy
