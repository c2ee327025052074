"""Compute the pressure of liquid that is trapped in closed pockets and resists their compression.

The amount of liquid in a pocket is its volume V at the pressure p, converted to the pressure of the surroundings,
V exp(p/B), with the bulk modulus B. A pocket that closes between two loads contains the volume that it has at the later
load. If a pocket divides, its amount is divided in proportion to the volumes. Liquid is lost from a pocket that opens
to the inlet or the outlet, and from a pocket whose pressure lifts its rim.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Indices
from ..contact import HalfSpace, modulus_of_waves


@dataclass(frozen=True, eq=False)
class TrappedLiquid:
    """Liquid in the pockets of a surface.

    Attributes
    ----------
    pocket : array of int, (n1, n2)
        Number of the pocket at each point, beginning with 1; 0 at open points outside of pockets and −1 in contact.
    pressure : array, (pockets,)
        Pressure of each pocket relative to the surroundings [Pa].
    amount : array, (pockets,)
        Amount of liquid in each pocket, as volume at the pressure of the surroundings [m³].
    load : float
        Nominal pressure [Pa].
    step : array, (pockets,)
        Change of the pressure for the next round [Pa]. NaN for a pocket that closes at this load, whose liquid has the
        pressure of the fluid around it.
    error : float
        Sum of the differences between the volumes of pockets and of their liquid, over the volume of all pockets.
    """

    pocket: NDArray[np.int32]
    pressure: Array
    amount: Array
    load: float
    step: Array
    error: float = 0.0

    def on(self, around: Array, step: Array | float | None = None) -> Array:
        """Insert the pressures of the pockets into a field of fluid pressure.

        Parameters
        ----------
        around : array, (n1, n2)
            Fluid pressure outside of pockets, and in pockets without a step [Pa].
        step : array, (pockets,), or float, optional
            Change of the pressures of the pockets [Pa], by default `self.step`.

        Returns
        -------
        array, (n1, n2)
            Fluid pressure [Pa].
        """
        if step is None:
            step = self.step
        pocket_pressure = np.maximum(self.pressure + step, 0.0)
        # entry 0 of the table stands for all points outside of pockets, whose numbers are 0 and −1
        table = np.r_[np.nan, pocket_pressure]
        field = table[np.maximum(self.pocket, 0)]
        return np.where(np.isnan(field), around, field)


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
    """Compute the pressures of trapped liquid, and a Newton step towards the volumes that its amounts need.

    Pockets that were one pocket at the previous load, and pockets that have joined since, form a group with a common
    pressure and amount.

    Parameters
    ----------
    former : TrappedLiquid or None
        Trapped liquid at the previous load; None at the first load.
    half_space : HalfSpace
        Elastic body.
    gap : array, (n1, n2)
        Gap under the fluid pressure `given` [m].
    is_pocket : array of bool, (n1, n2)
        Open points without a connection to the inlet or the outlet.
    given : array, (n1, n2)
        Fluid pressure [Pa].
    around : array, (n1, n2)
        Fluid pressure if no liquid kept its volume [Pa].
    bulk_modulus : float
        Bulk modulus of the liquid [Pa], infinite if it is incompressible.
    most : float
        Largest pressure of trapped liquid [Pa].
    load : float
        Nominal pressure [Pa].
    leaves : bool
        Whether pressures may only fall, because liquid that repeatedly lifts the rim of its pocket is lost.

    Notes
    -----
    The derivative of the volume with respect to pressure is that of a circular area A on a half-space,
    16 A √(A/π)/(3π E*). For coated bodies, E* is taken at the wave number √(π/A).
    """
    pocket, n = label_pockets(is_pocket)
    pixel_area = float(np.prod(half_space.spacing))
    if former is None:
        former_pocket = np.zeros_like(pocket)
        former_amount = np.zeros(0)
    else:
        former_pocket = np.maximum(former.pocket, 0)
        former_amount = former.amount / pixel_area
    # Sums over pixels are heights [m]; the pixel area makes them volumes.
    group, count = _groups(pocket, n, former_pocket, former_amount.size)
    group_at = np.r_[0, group + 1][pocket]  # number of the group at each point from 1, 0 outside
    points = np.bincount(group_at.ravel(), minlength=count + 1)[1:]
    total = _sums(group_at, count, gap) * pixel_area
    area = points * pixel_area
    p = _sums(group_at, count, given) / points
    outside = _sums(group_at, count, around) / points
    # A new pocket contains liquid at the pressure around it. Former pockets keep their amount, and points that were in
    # contact (−1) contain none.
    amount = gap * np.exp(around / bulk_modulus)
    if former is not None:
        volume = _sums(former_pocket, former_amount.size, gap)
        density = np.divide(former_amount, volume, out=np.zeros_like(volume), where=volume > 0)
        amount[former.pocket != 0] = 0.0
        amount += gap * np.r_[0.0, density][former_pocket]
    existed = np.isin(np.arange(1, count + 1), group_at[former_pocket > 0])
    wanted = _sums(group_at, count, amount) * pixel_area
    missing = wanted * np.exp(-p / bulk_modulus) - total  # volume of the liquid less the pocket
    radius = np.sqrt(area / np.pi)
    modulus = modulus_of_waves(half_space.modulus, 1 / radius)
    slope = 16 * area * radius / (3 * np.pi * modulus)
    slope += total / bulk_modulus
    # without tension: vapour fills the part of a pocket that the liquid does not
    least = np.minimum(outside, 0.0)
    new = np.clip(p + missing / slope, least, np.maximum(most, least))
    if leaves:
        new = np.minimum(new, p)
    keeps_liquid = existed & (new < most) & ~((missing > 0) & leaves)
    is_full = keeps_liquid & (new > least)
    error = float(np.abs(missing[is_full]).sum() / total.sum()) if count else 0.0
    group_pressure = np.where(existed, p, outside)
    step = np.where(existed, new - p, np.nan)
    # amount per volume; a group that loses liquid keeps what its volume holds at its pressure
    filling = np.where(keeps_liquid, wanted / total, np.exp(group_pressure / bulk_modulus))
    volumes = _sums(pocket, n, gap) * pixel_area
    return TrappedLiquid(
        pocket=np.where(gap > 0, pocket, np.int32(-1)),
        pressure=group_pressure[group],
        amount=filling[group] * volumes,
        load=load,
        step=step[group],
        error=error,
    )


def _groups(
    pocket: NDArray[np.int32], n: int, former_pocket: NDArray[np.int32], former_n: int
) -> tuple[Indices, int]:
    """Group pockets that have a common pressure because they share points with the same pocket at the previous load.

    Parameters
    ----------
    pocket, former_pocket : arrays of int, (n1, n2)
        Numbers of the pockets at each point, now and at the previous load, beginning with 1; 0 outside.
    n, former_n : int
        Numbers of these pockets.

    Returns
    -------
    group : array of int, (n,)
        Number of the group of each pocket, beginning with 0.
    count : int
        Number of groups.
    """
    # nodes of the graph: the pockets, then the former pockets; an edge joins two that share a point
    both = (pocket > 0) & (former_pocket > 0)
    component = _components(pocket[both] - 1, n + former_pocket[both] - 1, n + former_n)
    numbers, group = np.unique(component[:n], return_inverse=True)
    return group, numbers.size


def label_pockets(is_pocket: Flags) -> tuple[NDArray[np.int32], int]:
    """Number the pockets of a surface that is periodic along x2.

    Returns the number of the pocket at each point (n1, n2), from 1 on and 0 outside, and the number of pockets.
    """
    from scipy.ndimage import label

    labels, n = label(is_pocket)
    # join pockets that meet at the periodic border
    first_column, last_column = labels[:, 0], labels[:, -1]
    meets = (first_column > 0) & (last_column > 0)
    # the outside has the label 0 and therefore stays component 0
    joined = _components(first_column[meets], last_column[meets], n + 1)
    return joined[labels].astype(np.int32), int(joined.max())


def _components(a: NDArray[np.signedinteger], b: NDArray[np.signedinteger], n: int) -> Indices:
    """Return the number of the connected component of each of n nodes, where node a[i] is connected with node b[i]."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(a.size, bool), (a, b)), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _sums(pocket: NDArray[np.int32], n: int, values: Array) -> Array:
    """Sum values (n1, n2) over each pocket (n,), without the points outside of pockets, whose number is 0."""
    sums = np.bincount(pocket.ravel(), np.asarray(values, float).ravel(), minlength=n + 1)
    return np.asarray(sums[1:], float)
