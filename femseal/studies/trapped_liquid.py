"""Liquid that stays in pockets: where the faces close around it, its pressure is such that it keeps its volume.

Amount of a pocket: the volume of its liquid at the pressure of the surroundings, V exp(p/B) with the bulk modulus B. A
pocket that closes between two loads has the volume of the later one; one that divides, splits its amount by volume.
What opens towards an end of the face is lost: a pocket whose liquid lifts its rim loses what lifts it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Indices
from ..contact import HalfSpace

#: Fraction of a Newton step that is taken: pockets lift each other's rims. Largest step over the load.
_DAMPING, _LARGEST_STEP = 0.7, 0.3
#: The metal around a pocket flows under a liquid at its hardness. What would need more than this fraction escapes.
_MOST_OF_HARDNESS = 0.9
#: Rounds after which pressures only fall.
_RELEASE_ROUNDS = 25


@dataclass(frozen=True, eq=False)
class TrappedLiquid:
    """Liquid in the pockets of a face.

    pocket : number of the pocket of every point (n1, n2), 0 outside, -1 in contact. pressure : of each, above that of
        the surroundings (pockets,) [Pa].
    amount : of each (pockets,) [m³]. load : nominal pressure [Pa].
    step : by which the pressure of the next round is above (pockets,) [Pa]; NaN of those that close at this load, whose
        liquid has the pressure around.
    error : by how much volumes miss their amount, over the volume of all.
    """

    pocket: NDArray[np.int32]
    pressure: Array
    amount: Array
    load: float
    step: Array
    error: float = 0.0

    def on(self, around: Array, step: Array | float | None = None) -> Array:
        """Fluid pressures (n1, n2) [Pa]: those of the pockets after a step [Pa], `step` unless given; else `around`."""
        own = np.r_[np.nan, np.maximum(self.pressure + (self.step if step is None else step), 0.0)][
            np.maximum(self.pocket, 0)
        ]
        return np.where(np.isnan(own), around, own)


class PocketPressures:
    """Finds the pressures of pockets, round by round, at one load.

    former : liquid that the load before has left. bulk_modulus : B [Pa], inf of an incompressible liquid.
    hardness : the least of the face [Pa]. load : nominal pressure [Pa].
    """

    def __init__(
        self,
        former: TrappedLiquid | None,
        half_space: HalfSpace,
        *,
        bulk_modulus: float,
        hardness: float,
        load: float,
    ):
        self.former, self.half_space, self.bulk_modulus, self.load = (
            former,
            half_space,
            bulk_modulus,
            load,
        )
        self.most = _MOST_OF_HARDNESS * hardness
        self.rounds = 0

    def first(self, around: Array) -> Array:
        """Fluid pressures (n1, n2) [Pa] to begin with: a load moves pockets as if they carried all of it."""
        if self.former is None:
            return around
        return np.minimum(self.former.on(around, self.load - self.former.load), self.most)

    def next(self, gap: Array, is_pocket: Flags, given: Array, around: Array) -> TrappedLiquid:
        """Pressures of pockets, and a step of Newton's method towards their amounts.

        gap : (n1, n2) [m] under the pressure `given` (n1, n2) [Pa]. is_pocket : open points that no end reaches.
        around : pressure that a liquid has which does not keep its volume [Pa].

        Notes
        -----
        Slope of the volume: that of a circle of the same area A in a half-space, 16 A √(A/π) / (3π E*). Parts of a
        pocket that divides have one pressure at this load, and so have pockets that join.
        """
        self.rounds += 1
        pocket, n = label_pockets(is_pocket)
        point = float(np.prod(self.half_space.spacing))
        group, count = self._groups(pocket, n)
        of_point = np.r_[0, group + 1][pocket]
        points = np.bincount(of_point.ravel(), minlength=count + 1)[1:]
        total, area = _sums(of_point, count, gap) * point, points * point
        p, outside = (_sums(of_point, count, field) / points for field in (given, around))
        amount = gap * np.exp(around / self.bulk_modulus)
        known = np.zeros(count, bool)
        if self.former is not None:
            old = np.maximum(self.former.pocket, 0)
            former = self.former.amount / point
            volume = _sums(old, former.size, gap)
            density = np.divide(former, volume, out=np.zeros_like(volume), where=volume > 0)
            amount[self.former.pocket != 0] = 0.0
            amount += gap * np.r_[0.0, density][old]
            both = (pocket > 0) & (old > 0)
            known = np.bincount(of_point[both] - 1, minlength=count) > 0
        wanted = _sums(of_point, count, amount) * point
        miss = wanted * np.exp(-p / self.bulk_modulus) - total
        slope = 16 * area * np.sqrt(area / np.pi) / (3 * np.pi * self.half_space.modulus)
        slope += total / self.bulk_modulus
        largest = _LARGEST_STEP * self.load
        step = np.clip(_DAMPING * miss / slope, -largest, largest)
        # no tension: vapour takes what the liquid does not fill
        least = np.minimum(outside, 0.0)
        new = np.clip(p + step, least, np.maximum(self.most, least))
        late = self.rounds > _RELEASE_ROUNDS
        if late:  # what lifts its rim again and again loses liquid
            new = np.minimum(new, p)
        escapes = (new >= self.most) | ((miss > 0) & late)
        counted = known & ~escapes & (new > least)
        error = float(np.abs(miss[counted]).sum() / total.sum()) if count else 0.0
        left = np.where(
            known & ~escapes,
            wanted / total,
            np.exp(np.where(known, p, outside) / self.bulk_modulus),
        )
        volumes = _sums(pocket, n, gap) * point
        own, step = np.where(known, p, outside), np.where(known, new - p, np.nan)
        pocket = np.where(gap > 0, pocket, np.int32(-1))
        return TrappedLiquid(
            pocket, own[group], left[group] * volumes, self.load, step[group], error
        )

    def _groups(self, pocket: NDArray[np.int32], n: int) -> tuple[Indices, int]:
        """Number of the group of each of n pockets, which has one pressure, and how many groups there are."""
        if self.former is None or n == 0:
            return np.arange(n), n
        both = (pocket > 0) & (self.former.pocket > 0)
        a, b = pocket[both] - 1, n + self.former.pocket[both] - 1
        group = _components(a, b, n + self.former.amount.size)
        numbers, of_pocket = np.unique(group[:n], return_inverse=True)
        return of_pocket, numbers.size


def label_pockets(is_pocket: Flags) -> tuple[NDArray[np.int32], int]:
    """Numbers from 1 of connected points (n1, n2), 0 outside, and how many; the face is periodic along x2."""
    from scipy.ndimage import label

    found, n = label(is_pocket)
    a, b = found[:, 0], found[:, -1]
    seam = (a > 0) & (b > 0)
    joined = _components(a[seam], b[seam], n + 1)  # the outside, number 0, comes first
    return joined[found].astype(np.int32), int(joined.max())


def _components(a: NDArray[np.signedinteger], b: NDArray[np.signedinteger], n: int) -> Indices:
    """Number of the component of each of n nodes, some of which, a and b, are joined."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(a.size, bool), (a, b)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _sums(pocket: NDArray[np.int32], n: int, values: Array) -> Array:
    """Sum of values (n1, n2) over each of n pockets."""
    found = np.bincount(pocket.ravel(), np.asarray(values, float).ravel(), minlength=n + 1)[1:]
    return np.asarray(found, float)
