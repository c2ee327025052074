"""Compute the flow along x1 through a face with spiral grooves, which advance by the lead in each turn of the seal.

After one turn around the seal (of circumference C), a groove has advanced along x1 by the lead, and continues in
another groove of the face. If the face covers a full turn, the pressure p therefore satisfies p(x1, x2 + C) = p(x1 +
lead, x2).

A face may also cover only a part of a turn, L2 < C. The pressure drop along a groove of length L2 is the fraction w =
L2/C of its pressure drop along a full turn. The seam is the line between the last column of the face and the first
column. The pressure drop over a link of the seam is p(x1, L2) − p(x1, 0) + w (P − P₊). P is the mean of the pressure
p(x1, 0) over the rows x1 of a groove. P₊ is the mean of the pressure p(x1, 0) over the rows of the next groove, which
lies one lead further along x1. With this pressure drop over the seam, the matrix remains symmetric. The fraction w of
the flux that leaves a groove over the seam enters the next groove. If the lands between the grooves are closed, the
permeability of the face along x1 is k22 tan²α, where tan α = lead/C and k22 is the permeability along x2. Grooves begin
at the inlet and end at the outlet.

Source: Geoffroy & Prat, J. Fluids Eng. 126, 2004, 48.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ..base import Array, Indices, InputError, Pair, to_text
from .cell import cell_stencil
from .grid import Stencil
from .law import cubic_law
from .problem import checked_imbalance, unit_spacing
from .solvers.sparse import NetworkFlow, solve_network

#: Smallest fraction w for which the flow is solved. For a smaller w, rounding errors would spoil the solution, and the
#: flow is extrapolated: the flow along the grooves is proportional to w².
_LEAST_WEIGHT = 3e-5
#: Relative change of the flow below which the flow along the spiral is neglected.
LEAST_EFFECT = 5e-3
#: Relative error of the potential in the energy norm.
_RTOL = 1e-4
#: Largest relative difference between inflow and outflow. The flow is computed as an energy, whose relative error is
#: about the square of this difference.
_IMBALANCE = 1e-2


class _SeamLink(NamedTuple):
    """A link over the seam, from the last column of a face to the first column.

    conductance : conductance of the link.
    weights : dictionary of the factors w_i; its keys are the node numbers i. The potential drop over the link is the
        sum Σ w_i φ_i over the potentials φ_i of the nodes.
    """

    conductance: float
    weights: dict[int, float]


@dataclass(frozen=True)
class Spiral:
    """Spiral grooves, which run along x2 and advance along x1 by the lead in each turn of the seal.

    Attributes
    ----------
    lead : distance by which a groove advances along x1 in one turn [m], that is, the distance between adjacent grooves
        times the number of starts.
    circumference : circumference of the seal [m]; None if the face covers exactly one turn.
    """

    lead: float
    circumference: float | None = None

    def tangent(self, length: float) -> float:
        """Return tan α, where α is the angle between the grooves and x2.

        length : length of the face along x2 [m], used as the circumference if the face covers exactly one turn.
        """
        return self.lead / (self.circumference or length)

    def seam(self, shape: tuple[int, int], spacing: tuple[float, float]) -> tuple[int, float]:
        """Compute the lead in pixels, and the fraction w of a turn that a face covers.

        The lead is rounded to a whole number of pixels, at least 1. If the face covers less than a turn, w is
        multiplied by the ratio of the exact lead to the rounded lead, which preserves the slope of the grooves.

        shape : numbers of pixels of the face along x1 and x2.
        spacing : lengths of a pixel along x1 and x2 [m].

        Raises
        ------
        InputError : the face is longer than a turn, or its width along x1 is not larger than the lead.
        """
        length = shape[1] * spacing[1]
        width = shape[0] * spacing[0]
        turn = length if self.circumference is None else self.circumference
        if turn < length * (1 - 1e-9):
            given = f"{to_text(turn, 'm', 3)} around a face {to_text(length, 'm', 3)} long"
            raise InputError("lay.circumference", given, "at least the length of the face")
        if self.lead >= width * (1 - 1e-9):
            given = f"{to_text(self.lead, 'm', 3)} on a face {to_text(width, 'm', 3)} wide"
            raise InputError("lay.lead", given, "less than the width of the face")
        pixels = max(1, round(self.lead / spacing[0]))
        if turn <= length * (1 + 1e-9):
            return pixels, length / turn
        return pixels, length / turn * self.lead / (pixels * spacing[0])


def spiral_flow(
    gap: Array, spacing: Pair, spiral: Spiral, potential_without_lead: Array
) -> tuple[float, Array] | None:
    """Compute the permeability along x1 of a face with spiral grooves.

    Parameters
    ----------
    gap : array (n1, n2), gap of a face that is periodic along x2 [m].
    spacing : lengths of a pixel [m].
    spiral : lead of the grooves and circumference of the seal.
    potential_without_lead : array (n1, n2), potential at the pixels, computed for grooves without a lead, that is, for
        closed rings. The potential is 1 at the inlet, 0 at the outlet, and NaN in contact and in pockets.

    Returns
    -------
    Permeability [m³], and potential at the pixels (n1, n2). Pixels that are not connected to both the inlet and the
    outlet have the potential NaN. If the lead changes the flow by less than 0.5 %, the function returns None.

    Raises
    ------
    InputError : see `Spiral.seam`.
    NotConverged : the linear solver failed, or inflow and outflow differ.
    """
    n1, n2 = gap.shape
    shift, fraction = spiral.seam(gap.shape, spacing)
    weight = max(fraction, _LEAST_WEIGHT)  # w in the docstring of this module
    scale = float(gap.max())
    if scale == 0:
        return None
    d1, d2 = unit_spacing(spacing)
    stencil = cell_stencil(gap / scale, (d1, d2), "periodic")
    # cut the face open at its seam, and add the links over the seam with the lead
    across = stencil.across.copy()
    across[:, -1] = 0.0
    cut = replace(stencil, across=across)
    if weight >= 1:
        links = _links_of_full_turn(gap / scale, d1 / d2, shift)
    else:
        links = _links_of_partial_turn(cut, stencil.across[:, -1], shift, weight)
    links = [link for link in links if link.conductance > 0]
    seam_conductances = np.array([link.conductance for link in links])
    nodes = (n1 + 2) * n2
    seam_drops = _drop_matrix(links, nodes)

    # By Dirichlet's principle, the energy of any potential in the network with the lead is an upper bound of the flow.
    # If there are no pockets, which the lead may open, the bound for the potential without the lead may show that the
    # lead has no effect.
    inner_potential = np.nan_to_num(potential_without_lead)
    start = np.concatenate([np.ones((1, n2)), inner_potential, np.zeros((1, n2))])
    energy_without_lead = stencil.energy(start)
    bound_with_lead = cut.energy(start) + seam_conductances @ (seam_drops @ start.ravel()) ** 2
    has_pockets = np.isnan(potential_without_lead[gap > 0]).any()
    if not has_pockets and bound_with_lead <= (1 + LEAST_EFFECT) * energy_without_lead:
        return None

    matrix = cut.to_csr() + seam_drops.T @ sp.diags_array(seam_conductances) @ seam_drops
    network = solve_network(sp.csr_array(matrix), n2, _RTOL, largest_residual=_IMBALANCE)
    _check_balance(network)
    potential = np.nan_to_num(network.potential)
    conductance = 0.0
    if network.is_through.any():
        energy_of_seam = float(seam_conductances @ (seam_drops @ potential) ** 2)
        energy_with_lead = cut.energy(potential.reshape(n1 + 2, n2)) + energy_of_seam
        # If `weight` is larger than the true fraction of a turn, the contribution of the spiral is reduced accordingly;
        # it is proportional to the square of the fraction.
        contribution = energy_with_lead - energy_without_lead
        conductance = energy_without_lead + (fraction / weight) ** 2 * contribution
    pixel_potential = np.where(network.is_through, potential, np.nan).reshape(n1 + 2, n2)[1:-1]
    length = n1 * d1
    width = n2 * d2
    permeability = scale**3 * length / width * conductance
    return permeability, np.where(gap > 0, pixel_potential, np.nan)


def _drop_matrix(links: list[_SeamLink], nodes: int) -> sp.csr_array:
    """Build the matrix (links, nodes) that yields the drop over each link from the potentials of the nodes."""
    link_numbers = []
    node_numbers = []
    values = []
    for number, link in enumerate(links):
        for node, weight in link.weights.items():
            link_numbers.append(number)
            node_numbers.append(node)
            values.append(weight)
    positions = np.array(link_numbers, int), np.array(node_numbers, int)
    return sp.coo_array((np.array(values, float), positions), shape=(len(links), nodes)).tocsr()


def _links_of_full_turn(gap: Array, aspect: float, shift: int) -> list[_SeamLink]:
    """Make the links across the seam of a face that covers a full turn.

    Row i of the last column is linked to row i + shift of the first column, where `shift` is the lead in pixels. The
    first `shift` rows of the first column are linked to the inlet, and the last `shift` rows of the last column to the
    outlet.

    gap : array (n1, n2), gap divided by the largest gap.
    aspect : ratio of the pixel lengths Δ1/Δ2.
    """
    n1, n2 = gap.shape
    # Gaps at the start and at the target of each of the n1 + shift links, (start or target, link). The first `shift`
    # links start at the inlet, and the last `shift` links end at the outlet; inlet and outlet have no gap (NaN).
    no_gap = np.full(shift, np.nan)
    start_gap = np.concatenate([no_gap, gap[:, -1]])
    target_gap = np.concatenate([gap[:, 0], no_gap])
    gaps = np.array([start_gap, target_gap])
    is_closed = (gaps == 0).any(axis=0)
    conductance = np.where(is_closed, 0.0, cubic_law(np.nanmean(gaps, axis=0)) * aspect)
    # rows of nodes: 0 is the inlet, 1 to n1 are the pixels, n1 + 1 is the outlet
    row = np.arange(1 - shift, n1 + 1)
    start = np.maximum(row, 0) * n2 + n2 - 1  # node in the last column
    target = np.minimum(row + shift, n1 + 1) * n2  # node in the first column
    links = zip(conductance.tolist(), start.tolist(), target.tolist(), strict=True)
    # the potential drop over a link is φ(start) − φ(target)
    return [_SeamLink(c, {a: 1.0, b: -1.0}) for c, a, b in links]


def _links_of_partial_turn(
    cut: Stencil, conductance: Array, shift: int, weight: float
) -> list[_SeamLink]:
    """Make the links across the seam of a face that covers less than a full turn.

    cut : network of the face without the links over the seam (from the last column to the first).
    conductance : array (n1,), conductance of the link over the seam in each row, for grooves without a lead.
    shift : lead in pixels.
    weight : fraction w of a turn that the face covers.
    """
    n1 = conductance.size
    n2 = cut.along.shape[1]
    # Node (row, column) has the number row · n2 + column. Row 0 of the nodes is the inlet, so that row i of the pixels
    # is row i + 1 of the nodes.
    links = []
    # The rows of the first lead are also linked to the inlet (node 0), with the drop w (p(x1, 0) − p of the inlet).
    for i in range(min(shift, n1)):
        first_node = (i + 1) * n2  # in the first column
        links.append(_SeamLink(conductance[i], {first_node: weight, 0: -weight}))
    # the links over the seam, with the drop p(x1, L2) − p(x1, 0) + w (P − P₊)
    _, node_label = connected_components(cut.to_csr(), directed=False)
    label = node_label.reshape(n1 + 2, n2)[1:-1]
    for rows in _grooves(conductance, shift):
        # factors of w (P − P₊): for the pressures of the pixels in the first column, and for the outlet
        next_factors = np.zeros(n1 + 1)
        connects_both_sides = label[rows[0], 0] == label[rows[0], -1]
        if connects_both_sides:
            next_factors = weight * _drop_to_next_groove(rows, conductance, label, shift)
        for i in rows:
            # factors of − p(x1, 0) + w (P − P₊)
            factors = next_factors.copy()
            factors[i] -= 1.0
            rows_with_factor = np.flatnonzero(factors)
            nodes = (rows_with_factor + 1) * n2  # in the first column
            weights = dict(zip(nodes.tolist(), factors[rows_with_factor].tolist(), strict=True))
            # p(x1, L2) has the factor 1
            last_node = (i + 1) * n2 + n2 - 1
            links.append(_SeamLink(conductance[i], {last_node: 1.0} | weights))
    return links


def _grooves(conductance: Array, shift: int) -> list[Indices]:
    """Group adjacent rows with an open link over the seam into grooves.

    A group of more than `shift` rows is longer than the lead, and is divided into several grooves.
    """
    open_rows = np.flatnonzero(conductance > 0)
    is_gap_after = np.diff(open_rows) > 1  # whether closed rows follow an open row
    groups = np.split(open_rows, np.flatnonzero(is_gap_after) + 1)
    grooves = []
    for group in groups:
        if group.size:
            parts = ceil(group.size / shift)
            grooves += np.array_split(group, parts)
    return grooves


def _drop_to_next_groove(rows: Indices, conductance: Array, label: Indices, shift: int) -> Array:
    """Compute the factors f_i that give the pressure drop from a groove to the next one, P − P₊ = Σ f_i p_i.

    P and P₊ are means over all rows of a groove, because fluid would circulate between the rows if each row had its own
    pressure drop. The next groove lies one lead further along x1. If the open links over the seam belong to several
    connected components there, the component with the largest conductance is taken. If there is no open link over the
    seam, the groove does not continue, and all factors are 0.

    Parameters
    ----------
    rows : numbers of the rows of the groove.
    conductance : array (n1,), conductance of the link over the seam in each row.
    label : array (n1, n2), number of the connected component of each pixel.
    shift : lead in pixels.

    Returns
    -------
    Array (n1 + 1,): the factors of the pressures in the n1 rows of the first column, followed by the factor of the
    outlet pressure.
    """
    n1 = conductance.size
    factors = np.zeros(n1 + 1)
    # P: mean over the rows of the groove, weighted with the conductances
    factors[rows] = conductance[rows] / conductance[rows].sum()
    # P₊: pressure at the outlet, or mean over the rows of the next groove
    target = rows + shift
    if (target >= n1).mean() > 0.5:  # most of the groove ends at the outlet
        factors[n1] = -1.0
        return factors
    target = target[target < n1]
    target = target[conductance[target] > 0]  # rows with an open link over the seam
    if target.size == 0:
        return np.zeros(n1 + 1)
    component = label[target, 0]

    def total_conductance(number: int) -> float:
        return float(conductance[target[component == number]].sum())

    widest = max(np.unique(component), key=total_conductance)
    next_rows = target[component == widest]
    factors[next_rows] -= conductance[next_rows] / conductance[next_rows].sum()
    return factors


def _check_balance(network: NetworkFlow) -> None:
    """Raise NotConverged if the inflow and the outflow of a network differ too much."""
    if network.solution is None:
        return
    inflow, outflow = network.inflow, network.outflow
    checked_imbalance(
        inflow,
        outflow,
        energy=None,  # it is computed later
        scale=max(abs(inflow), abs(outflow)),
        allowed=_IMBALANCE,
        flow="flow along spiral grooves",
    )
