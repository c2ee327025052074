"""Compute the pressure of liquid in closed pockets, which keeps its volume when the bodies close around it.

The amount of a pocket is the volume of its liquid at the pressure of the surroundings, V exp(p/B), with the bulk
modulus B. A pocket that closes between two loads has the volume at the later load. A pocket that divides splits its
amount by volume. Liquid of a pocket that opens towards an end of the surface is lost, and so is the liquid that lifts
the rim of its pocket.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Indices
from ..contact import HalfSpace, modulus_of_waves


@dataclass(frozen=True, eq=False)
class TrappedLiquid:
    """Liquid in the pockets of a surface.

    Parameters
    ----------
    pocket : number of the pocket of every point, array (n1, n2), 0 outside and −1 in contact.
    pressure : of each pocket above that of the surroundings, array (pockets,), Pa.
    amount : of each pocket, array (pockets,), m³.
    load : nominal pressure, Pa.
    step : change of the pressure for the next round, array (pockets,), Pa; NaN of pockets that close at this load,
        whose liquid has the pressure around them.
    error : by how much the volumes differ from their amounts, over the volume of all pockets.
    """

    pocket: NDArray[np.int32]
    pressure: Array
    amount: Array
    load: float
    step: Array
    error: float = 0.0

    def on(self, around: Array, step: Array | float | None = None) -> Array:
        """Return the fluid pressure (n1, n2) [Pa]: in pockets their pressure after a step, elsewhere `around`.

        step : change of the pressure of the pockets [Pa]; None is their own.
        """
        after = np.maximum(self.pressure + (self.step if step is None else step), 0.0)
        in_pockets = np.r_[np.nan, after][np.maximum(self.pocket, 0)]
        return np.where(np.isnan(in_pockets), around, in_pockets)


def liquid_in_pockets(
    former: TrappedLiquid | None,
    half_space: HalfSpace,
    gap: Array,
    is_pocket: Flags,
    *,
    given: Array,
    around: Array,
    bulk_modulus: float,
    most: float,
    load: float,
    leaves: bool,
) -> TrappedLiquid:
    """Compute the pressures of pockets, and a step of Newton's method towards their amounts.

    Parameters
    ----------
    former : liquid that the load before has left; None at the first load.
    half_space : elastic body.
    gap : under the pressure `given`, array (n1, n2), m.
    is_pocket : open points that no end of the surface reaches, array (n1, n2).
    given : fluid pressure, array (n1, n2), Pa.
    around : pressure of a liquid that does not keep its volume, array (n1, n2), Pa.
    bulk_modulus : of the liquid, Pa; inf of an incompressible one.
    most : largest pressure, Pa.
    load : nominal pressure, Pa.
    leaves : whether pressures only fall, because liquid that lifts its rim again and again is lost.

    Notes
    -----
    The slope of the volume is that of a circle of the same area A in a half-space, 16 A √(A/π)/(3π E*), with E* at the
    wave number √(π/A) of coated bodies. The parts of a
    pocket that divides have one pressure at this load, and so have pockets that join.
    """
    pocket, n = label_pockets(is_pocket)
    point = float(np.prod(half_space.spacing))
    old = np.zeros_like(pocket) if former is None else np.maximum(former.pocket, 0)
    old_amount = np.zeros(0) if former is None else former.amount / point
    group, count = _groups(pocket, n, old, old_amount.size)
    of_point = np.r_[0, group + 1][pocket]
    points = np.bincount(of_point.ravel(), minlength=count + 1)[1:]
    total, area = _sums(of_point, count, gap) * point, points * point
    p, outside = (_sums(of_point, count, field) / points for field in (given, around))
    amount = gap * np.exp(around / bulk_modulus)
    if former is not None:
        volume = _sums(old, old_amount.size, gap)
        density = np.divide(old_amount, volume, out=np.zeros_like(volume), where=volume > 0)
        amount[former.pocket != 0] = 0.0
        amount += gap * np.r_[0.0, density][old]
    known = np.isin(np.arange(1, count + 1), of_point[old > 0])
    wanted = _sums(of_point, count, amount) * point
    miss = wanted * np.exp(-p / bulk_modulus) - total
    radius = np.sqrt(area / np.pi)
    modulus = modulus_of_waves(half_space.modulus, 1 / radius)
    slope = 16 * area * radius / (3 * np.pi * modulus)
    slope += total / bulk_modulus
    # no tension: vapour takes what the liquid does not fill
    least = np.minimum(outside, 0.0)
    new = np.clip(p + miss / slope, least, np.maximum(most, least))
    if leaves:
        new = np.minimum(new, p)
    stays = known & (new < most) & ~((miss > 0) & leaves)
    counted = stays & (new > least)
    error = float(np.abs(miss[counted]).sum() / total.sum()) if count else 0.0
    group_pressure = np.where(known, p, outside)
    step = np.where(known, new - p, np.nan)
    left = np.where(stays, wanted / total, np.exp(group_pressure / bulk_modulus))
    volumes = _sums(pocket, n, gap) * point
    pocket = np.where(gap > 0, pocket, np.int32(-1))
    return TrappedLiquid(
        pocket, group_pressure[group], left[group] * volumes, load, step[group], error
    )


def _groups(
    pocket: NDArray[np.int32], n: int, old: NDArray[np.int32], former: int
) -> tuple[Indices, int]:
    """Group the pockets that have one pressure, because they were one pocket at the load before.

    Parameters
    ----------
    pocket : number of the pocket of every point, array (n1, n2).
    n : number of pockets.
    old : numbers of the pockets of the load before, array (n1, n2).
    former : how many of these there were.

    Returns the group number of each pocket (n,), and the number of groups.
    """
    both = (pocket > 0) & (old > 0)
    group = _components(pocket[both] - 1, n + old[both] - 1, n + former)
    numbers, of_pocket = np.unique(group[:n], return_inverse=True)
    return of_pocket, numbers.size


def label_pockets(is_pocket: Flags) -> tuple[NDArray[np.int32], int]:
    """Number the connected points (n1, n2) from 1, 0 outside, and count them; the surface is periodic along x2."""
    from scipy.ndimage import label

    found, n = label(is_pocket)
    a, b = found[:, 0], found[:, -1]
    seam = (a > 0) & (b > 0)
    joined = _components(a[seam], b[seam], n + 1)  # the outside, number 0, comes first
    return joined[found].astype(np.int32), int(joined.max())


def _components(a: NDArray[np.signedinteger], b: NDArray[np.signedinteger], n: int) -> Indices:
    """Return the component of each of n nodes, where the nodes a and b are connected."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(a.size, bool), (a, b)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _sums(pocket: NDArray[np.int32], n: int, values: Array) -> Array:
    """Sum values (n1, n2) over each of n pockets."""
    found = np.bincount(pocket.ravel(), np.asarray(values, float).ravel(), minlength=n + 1)[1:]
    return np.asarray(found, float)
