"""Compute the pressure of liquid that is trapped in closed pockets and resists the compression of the pockets.

The amount of liquid in a pocket is the volume that the liquid has at the pressure of the surroundings. If the liquid
has the volume V at the pressure p, its amount is V exp(p/B), with the bulk modulus B. As long as a pocket stays closed,
its amount of liquid is constant. A pocket that closes between two loads is filled with liquid at the later load. If a
pocket splits, its liquid is divided in proportion to the volumes of the new pockets. Liquid is lost from a pocket that
opens to the inlet or the outlet, and from a pocket whose rim is lifted by the liquid.
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
        Change of the pressure of each pocket for the next round of the iteration [Pa]. For a pocket that first closes
        at this load, the change is NaN, because its liquid has the pressure of the fluid around the pocket.
    error : float
        Relative error of the volumes, Σ|V − V_l|/ΣV, with the volume V of each pocket and the volume V_l of its liquid.
    """

    pocket: NDArray[np.int32]
    pressure: Array
    amount: Array
    load: float
    step: Array
    error: float = 0.0

    def insert_into(self, fluid_pressure: Array, step: Array | float | None = None) -> Array:
        """Replace the fluid pressure in the pockets by the pressure of their liquid.

        Parameters
        ----------
        fluid_pressure : array, (n1, n2)
            Fluid pressure [Pa]. The values outside of pockets, and in pockets whose step is NaN, remain unchanged.
        step : array, (pockets,), or float, optional
            Change that is added to the pressures of the pockets before they are inserted [Pa]; by default `self.step`.

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
    """Compute the amount and the pressure of the liquid in the pockets of a gap.

    In equilibrium, the volume of a pocket is equal to the volume of its liquid. For each pocket, a step of Newton's
    method gives the change of the pressure that would make these two volumes equal. Pockets that were a single pocket
    at the previous load, or that have merged since the previous load, form a group. All pockets of a group have a
    common pressure and a common amount of liquid.

    Parameters
    ----------
    previous : TrappedLiquid or None
        Trapped liquid at the previous load; None at the first load.
    half_space : HalfSpace
        Elastic body and grid.
    gap : array, (n1, n2)
        Gap under the fluid pressure `applied` [m].
    is_pocket : array of bool, (n1, n2)
        Whether each point is open and has no connection to the inlet or the outlet.
    applied : array, (n1, n2)
        Fluid pressure under which the gap was computed [Pa].
    surrounding : array, (n1, n2)
        Pressure of the flowing fluid around the pockets [Pa]. At the points of a pocket, the array contains pressures
        that are interpolated from the flow around the pocket.
    bulk_modulus : float
        Bulk modulus of the liquid [Pa], infinite if it is incompressible.
    highest_pressure : float
        Largest pressure of trapped liquid [Pa].
    load : float
        Nominal pressure [Pa].
    only_falls : bool
        If True, the pressure of a pocket can only decrease, and liquid that would need a higher pressure is lost.

    Notes
    -----
    For the step of Newton's method, the derivative of the volume of a pocket with respect to its pressure is needed.
    The derivative of the volume is approximated by 16 A √(A/π)/(3π E*), the value for a uniform pressure on a circle
    with the same area A as the pocket. For coated bodies, E* is taken at the wave number √(π/A).
    """
    pocket, n = label_pockets(is_pocket)
    pixel_area = float(np.prod(half_space.spacing))
    if previous is None:
        previous_pocket = np.zeros_like(pocket)
        previous_n = 0
    else:
        previous_pocket = np.maximum(previous.pocket, 0)
        previous_n = previous.amount.size
    group, count = _groups(pocket, n, previous_pocket, previous_n)
    # number of the group at each point, beginning with 1; 0 outside of pockets, whose number in `pocket` is 0
    group_at = np.concatenate([[0], group + 1])[pocket]
    # The following arrays have one value for each group, (group,).
    points = np.bincount(group_at.ravel(), minlength=count + 1)[1:]
    volume = _sums(group_at, count, gap) * pixel_area
    area = points * pixel_area
    pressure = _sums(group_at, count, applied) / points
    surrounding_pressure = _sums(group_at, count, surrounding) / points
    existed_before = np.isin(np.arange(1, count + 1), group_at[previous_pocket > 0])
    amount_per_area = _amount_per_area(previous, gap, surrounding, bulk_modulus, pixel_area)
    amount = _sums(group_at, count, amount_per_area) * pixel_area
    liquid_volume = amount * np.exp(-pressure / bulk_modulus)
    excess = liquid_volume - volume

    # Newton step: a higher pressure enlarges the pocket and compresses the liquid, together by the excess
    radius = np.sqrt(area / np.pi)
    modulus = modulus_of_waves(half_space.modulus, 1 / radius)
    compliance = 16 * area * radius / (3 * np.pi * modulus)
    compliance += volume / bulk_modulus
    # liquid bears no tension: vapour fills the part of a pocket that the liquid does not fill
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
    # a group that loses liquid, or that has just closed, contains as much as fits into its volume at its pressure
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
    """Compute the amount of liquid per area [m] at each point of the gap (n1, n2).

    The amount of liquid depends on the state of the point at the previous load. If the point was open and outside of
    pockets, its gap is filled with liquid at the pressure `surrounding`. If the point was in a pocket, the liquid of
    this pocket is distributed over its points in proportion to their gaps. If the point was in contact, it has no
    liquid.

    The parameters are explained in `liquid_in_pockets`; `pixel_area` is the area of a pixel [m²].
    """
    filled = gap * np.exp(surrounding / bulk_modulus)
    if previous is None:
        return filled
    previous_pocket = np.maximum(previous.pocket, 0)  # 0 outside of pockets and in contact
    # sums over the pixels of each previous pocket: heights of the liquid, and gaps [m]
    height_of_liquid = previous.amount / pixel_area
    sum_of_gaps = _sums(previous_pocket, height_of_liquid.size, gap)
    liquid_per_gap = np.divide(
        height_of_liquid, sum_of_gaps, out=np.zeros_like(sum_of_gaps), where=sum_of_gaps > 0
    )
    filled[previous.pocket != 0] = 0.0  # only points that were open and not in a pocket are filled
    # the pocket number 0, of points outside of pockets, selects the 0 at the beginning
    liquid_per_gap_at = np.concatenate([[0.0], liquid_per_gap])[previous_pocket]
    return filled + gap * liquid_per_gap_at


def _groups(
    pocket: NDArray[np.int32], n: int, previous_pocket: NDArray[np.int32], previous_n: int
) -> tuple[Indices, int]:
    """Group pockets that share points with the same pocket of the previous load.

    Parameters
    ----------
    pocket : array of int, (n1, n2)
        Number of the pocket at each point, from 1 on; 0 at points outside of pockets.
    n : int
        Number of pockets.
    previous_pocket : array of int, (n1, n2)
        Number of the pocket at each point at the previous load, from 1 on; 0 at points outside of pockets.
    previous_n : int
        Number of pockets at the previous load.

    Returns
    -------
    group : array of int, (n,)
        Number of the group of each pocket, beginning with 0.
    count : int
        Number of groups.
    """
    # Nodes of a graph: first the n pockets, then the previous pockets. An edge joins a pocket and a previous pocket
    # that share a point. The connected components are the groups.
    both = (pocket > 0) & (previous_pocket > 0)
    component = _components(pocket[both] - 1, n + previous_pocket[both] - 1, n + previous_n)
    component_of_pocket = component[:n]
    # number the components that contain a pocket without gaps
    distinct, group = np.unique(component_of_pocket, return_inverse=True)
    return group, distinct.size


def label_pockets(is_pocket: Flags) -> tuple[NDArray[np.int32], int]:
    """Number the pockets of a surface that is periodic along x2.

    Returns an array (n1, n2) with the number of the pocket at each point, and the number of pockets. Pockets are
    numbered from 1; all points outside of pockets have the number 0.
    """
    from scipy.ndimage import label

    labels, n = label(is_pocket)
    # join pockets that meet at the periodic border
    first_column, last_column = labels[:, 0], labels[:, -1]
    is_pair = (first_column > 0) & (last_column > 0)
    # component 0 consists only of the label 0, which stands for the points outside of pockets
    joined = _components(first_column[is_pair], last_column[is_pair], n + 1)
    return joined[labels].astype(np.int32), int(joined.max())


def _components(a: NDArray[np.signedinteger], b: NDArray[np.signedinteger], n: int) -> Indices:
    """Return the number of the connected component of each node.

    The graph has n nodes. Edge i connects the nodes a[i] and b[i].
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(a.size, bool), (a, b)), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    return component.astype(np.int64)


def _sums(pocket: NDArray[np.int32], n: int, values: Array) -> Array:
    """Sum values (n1, n2) over the points of each pocket.

    pocket : number of the pocket at each point, from 1 to n; 0 at points outside of pockets.

    Returns the sums (n,).
    """
    sums = np.bincount(pocket.ravel(), np.asarray(values, float).ravel(), minlength=n + 1)
    return np.asarray(sums[1:], float)
