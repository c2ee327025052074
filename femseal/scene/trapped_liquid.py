"""Compute the pressure of liquid that is trapped in closed pockets and resists their compression.

The amount of liquid in a pocket is measured by its volume at the pressure of the surroundings. For a volume V at the
pressure p this is V exp(p/B), with the bulk modulus B. As long as a pocket stays closed, its amount is constant. A
pocket that closes between two loads is filled with liquid at the later load. If a pocket divides, its amount is divided
in proportion to the volumes. Liquid is lost from a pocket that opens to the inlet or the outlet, and from a pocket
whose pressure lifts its rim.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Flags, Indices
from ..contact import HalfSpace, modulus_of_waves


@dataclass(frozen=True, eq=False)
class TrappedLiquid:
    """Liquid in the closed pockets of a surface at one load.

    Attributes
    ----------
    pocket : array of int, (n1, n2)
        Number of the pocket at each point, beginning with 1; 0 at open points outside of pockets and −1 in contact.
    pressure : array, (pockets,)
        Pressure of each pocket relative to the surroundings [Pa].
    amount : array, (pockets,)
        Amount of liquid in each pocket: its volume at the pressure of the surroundings [m³].
    load : float
        Nominal pressure [Pa].
    step : array, (pockets,)
        Change of the pressure of each pocket for the next round of the iteration [Pa]. It is NaN for a pocket that
        closes at this load, because its liquid has the pressure of the fluid around it.
    error : float
        Sum of the differences between the volume of each pocket and the volume of its liquid, divided by the volume of
        all pockets.
    """

    pocket: NDArray[np.int32]
    pressure: Array
    amount: Array
    load: float
    step: Array
    error: float = 0.0

    def insert_into(self, fluid_pressure: Array, step: Array | float | None = None) -> Array:
        """Insert the pressures of the pockets, changed by a step, into a map of the fluid pressure.

        Parameters
        ----------
        fluid_pressure : array, (n1, n2)
            Fluid pressure [Pa]. It is kept outside of pockets, and in pockets whose step is NaN.
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
        # pressure by pocket number; entry 0 stands for all points outside of pockets, whose numbers are 0 and −1
        by_number = np.concatenate([[np.nan], pocket_pressure])
        inserted = by_number[np.maximum(self.pocket, 0)]
        return np.where(np.isnan(inserted), fluid_pressure, inserted)


def liquid_in_pockets(
    previous: TrappedLiquid | None,
    half_space: HalfSpace,
    gap: Array,
    is_pocket: Flags,
    *,
    applied: Array,
    surrounding: Array,
    bulk_modulus: float,
    highest_pressure: float,
    load: float,
    only_falls: bool,
) -> TrappedLiquid:
    """Compute the liquid in the pockets of a gap, with a Newton step of its pressures towards equal volumes.

    The step is chosen so that the volume of each pocket becomes equal to the volume of its liquid. Pockets that were
    one pocket at the previous load, and pockets that have joined since, form a group with a common pressure and amount.

    Parameters
    ----------
    previous : TrappedLiquid or None
        Trapped liquid at the previous load; None at the first load.
    half_space : HalfSpace
        Elastic body.
    gap : array, (n1, n2)
        Gap under the fluid pressure `applied` [m].
    is_pocket : array of bool, (n1, n2)
        Open points without a connection to the inlet or the outlet.
    applied : array, (n1, n2)
        Fluid pressure under which the gap was computed [Pa].
    surrounding : array, (n1, n2)
        Fluid pressure of the flow around the pockets, interpolated at the points of the pockets [Pa].
    bulk_modulus : float
        Bulk modulus of the liquid [Pa], infinite if it is incompressible.
    highest_pressure : float
        Largest pressure of trapped liquid [Pa].
    load : float
        Nominal pressure [Pa].
    only_falls : bool
        Whether the pressures may only fall, because liquid that repeatedly lifts the rim of its pocket is lost.

    Notes
    -----
    The derivative of the volume with respect to pressure is that of a circular area A on a half-space,
    16 A √(A/π)/(3π E*). For coated bodies, E* is taken at the wave number √(π/A).
    """
    pocket, n = label_pockets(is_pocket)
    pixel_area = float(np.prod(half_space.spacing))
    if previous is None:
        previous_pocket = np.zeros_like(pocket)
        previous_n = 0
    else:
        previous_pocket = np.maximum(previous.pocket, 0)
        previous_n = previous.amount.size
    # Arrays of the groups, (group,). Sums over pixels are heights [m]; the pixel area makes them volumes.
    group, count = _groups(pocket, n, previous_pocket, previous_n)
    group_at = np.concatenate([[0], group + 1])[pocket]  # number of the group from 1; 0 outside
    points = np.bincount(group_at.ravel(), minlength=count + 1)[1:]
    volume = _sums(group_at, count, gap) * pixel_area
    area = points * pixel_area
    pressure = _sums(group_at, count, applied) / points
    surrounding_pressure = _sums(group_at, count, surrounding) / points
    existed_before = np.isin(np.arange(1, count + 1), group_at[previous_pocket > 0])
    amount_per_area = _amount_per_area(previous, gap, surrounding, bulk_modulus, pixel_area)
    amount = _sums(group_at, count, amount_per_area) * pixel_area
    excess = amount * np.exp(-pressure / bulk_modulus) - volume  # volume of liquid without room

    # Newton step: the pocket becomes larger, and the liquid smaller, by the excess in total
    radius = np.sqrt(area / np.pi)
    modulus = modulus_of_waves(half_space.modulus, 1 / radius)
    compliance = 16 * area * radius / (3 * np.pi * modulus)
    compliance += volume / bulk_modulus
    # liquid has no tension: vapour fills the part of a pocket that the liquid does not
    lowest = np.minimum(surrounding_pressure, 0.0)
    highest = np.maximum(highest_pressure, lowest)
    new_pressure = np.clip(pressure + excess / compliance, lowest, highest)
    if only_falls:
        new_pressure = np.minimum(new_pressure, pressure)
    is_released = (excess > 0) & only_falls
    keeps_liquid = existed_before & (new_pressure < highest_pressure) & ~is_released
    is_full = keeps_liquid & (new_pressure > lowest)
    error = float(np.abs(excess[is_full]).sum() / volume.sum()) if count else 0.0

    group_pressure = np.where(existed_before, pressure, surrounding_pressure)
    step = np.where(existed_before, new_pressure - pressure, np.nan)
    # a group that loses liquid keeps the amount that its volume holds at its pressure
    amount_per_volume = np.where(
        keeps_liquid, amount / volume, np.exp(group_pressure / bulk_modulus)
    )
    pocket_volume = _sums(pocket, n, gap) * pixel_area
    return TrappedLiquid(
        pocket=np.where(gap > 0, pocket, np.int32(-1)),
        pressure=group_pressure[group],
        amount=amount_per_volume[group] * pocket_volume,
        load=load,
        step=step[group],
        error=error,
    )


def _amount_per_area(
    previous: TrappedLiquid | None,
    gap: Array,
    surrounding: Array,
    bulk_modulus: float,
    pixel_area: float,
) -> Array:
    """Compute the amount of liquid per area [m] that a pocket contains at each point (n1, n2).

    Points that were open at the previous load, outside of pockets, are filled at the pressure around them. Points of
    previous pockets contain the amount of these pockets, distributed in proportion to the gap. Points that were in
    contact (pocket −1) contain no liquid. Parameters are as in `liquid_in_pockets`; the pixel area is in m².
    """
    filled = gap * np.exp(surrounding / bulk_modulus)
    if previous is None:
        return filled
    previous_pocket = np.maximum(previous.pocket, 0)
    previous_amount = previous.amount / pixel_area
    volume = _sums(previous_pocket, previous_amount.size, gap)
    per_gap = np.divide(previous_amount, volume, out=np.zeros_like(volume), where=volume > 0)
    filled[previous.pocket != 0] = 0.0
    return filled + gap * np.concatenate([[0.0], per_gap])[previous_pocket]


def _groups(
    pocket: NDArray[np.int32], n: int, previous_pocket: NDArray[np.int32], previous_n: int
) -> tuple[Indices, int]:
    """Group pockets that have a common pressure because they share points with the same pocket at the previous load.

    Parameters
    ----------
    pocket, previous_pocket : arrays of int, (n1, n2)
        Number of the pocket at each point, now and at the previous load, beginning with 1; 0 outside.
    n, previous_n : int
        How many pockets there are now, and how many there were at the previous load.

    Returns
    -------
    group : array of int, (n,)
        Number of the group of each pocket, beginning with 0.
    count : int
        Number of groups.
    """
    # nodes of the graph: the pockets, then the previous pockets; an edge joins two that share a point
    both = (pocket > 0) & (previous_pocket > 0)
    component = _components(pocket[both] - 1, n + previous_pocket[both] - 1, n + previous_n)
    numbers, group = np.unique(component[:n], return_inverse=True)
    return group, numbers.size


def label_pockets(is_pocket: Flags) -> tuple[NDArray[np.int32], int]:
    """Number the pockets of a surface that is periodic along x2.

    Returns the number of the pocket at each point (n1, n2), beginning with 1 and 0 outside; and how many pockets there
    are.
    """
    from scipy.ndimage import label

    labels, n = label(is_pocket)
    # join pockets that meet at the periodic border
    first_column, last_column = labels[:, 0], labels[:, -1]
    is_pair = (first_column > 0) & (last_column > 0)
    # component 0 consists of the label 0 alone, which stands for the points outside of pockets
    joined = _components(first_column[is_pair], last_column[is_pair], n + 1)
    return joined[labels].astype(np.int32), int(joined.max())


def _components(a: NDArray[np.signedinteger], b: NDArray[np.signedinteger], n: int) -> Indices:
    """Label the connected components of a graph of n nodes with the edges (a[i], b[i]); return each node's label."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(a.size, bool), (a, b)), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    return component.astype(np.int64)


def _sums(pocket: NDArray[np.int32], n: int, values: Array) -> Array:
    """Sum values (n1, n2) over each pocket (n,), without the points outside of pockets, whose number is 0."""
    sums = np.bincount(pocket.ravel(), np.asarray(values, float).ravel(), minlength=n + 1)
    return np.asarray(sums[1:], float)
