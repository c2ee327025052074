"""Flow along x1 through a face whose grooves wind around the seal: after a turn x2 comes back shifted along x1.

Once around the seal, over its circumference C, a groove comes back as the one a lead further along x1. A face that is
one turn long (n2 pixels) has p(x1, x2 + C) = p(x1 + lead, x2). One that is L2 < C long stands for all of the turn if a
groove drops the fraction w = L2/C of a turn's drop over it: the flux through the seam is that of its conductance under
p(x1, L2) − p(x1, 0) + w (P − P₊), P and P₊ the means of p(·, 0) over the groove and over the one a lead further. So the
energy stays symmetric, w of what leaves a groove comes back in the next one, and along closed lands the permeability is
k22 tan²α with tan α = lead/C. Grooves begin at the inlet and end at the outlet.
Source: Geoffroy & Prat, J. Fluids Eng. 126, 2004, 48.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..base import Array, Indices, InputError, NotConverged, to_text
from .cell import cell_stencil
from .grid import Stencil
from .law import cubic_law
from .problem import unit_spacing
from .solvers.amg import solve_spd

#: Least fraction w that is solved: below it rounding decides, and the flow changes by w².
_LEAST_WEIGHT = 3e-5
#: Relative change of the flow below which the way along the grooves is left out.
LEAST_EFFECT = 5e-3
#: Error allowed to the potential in the norm of the energy.
_RTOL = 1e-4
#: Difference allowed between inflow and outflow; the energy, which is the flow, errs by about its square.
_IMBALANCE = 1e-2


@dataclass(frozen=True)
class Spiral:
    """Grooves along x2 that come back shifted by the lead along x1 after the circumference of the seal.

    lead : from groove to groove times the number of starts [m]. circumference : of the seal [m]; None for a face that
    is one turn long.
    """

    lead: float
    circumference: float | None = None

    def tangent(self, length: float) -> float:
        """Slope tan α of the grooves against x2, of a face that is so long [m]."""
        return self.lead / (self.circumference or length)

    def seam(self, shape: tuple[int, int], spacing: tuple[float, float]) -> tuple[int, float]:
        """Pixels by which the face comes back shifted, and the fraction w of what leaves it that does.

        Raises InputError: a face longer than a turn, or no longer than the lead along x1.
        """
        length, breadth = shape[1] * spacing[1], shape[0] * spacing[0]
        turn = length if self.circumference is None else self.circumference
        if turn < length * (1 - 1e-9):
            given = f"{to_text(turn, 'm', 3)} around a face {to_text(length, 'm', 3)} long"
            raise InputError("lay.circumference", given, "at least the length of the face")
        if self.lead >= breadth:
            given = f"{to_text(self.lead, 'm', 3)} on a face {to_text(breadth, 'm', 3)} broad"
            raise InputError("lay.lead", given, "less than the breadth")
        pixels = max(1, round(self.lead / spacing[0]))
        return pixels, length / turn * (
            self.lead / (pixels * spacing[0]) if turn > length * (1 + 1e-9) else 1.0
        )


def spiral_flow(
    gap: Array, spacing: tuple[float, float], spiral: Spiral, plain: Array
) -> tuple[float, Array] | None:
    """Permeability [m³] along x1 of a face with winding grooves, and its potential; None where the lead hardly matters.

    gap : (n1, n2) [m], periodic along x2.
    plain : potential (n1, n2) of the flow without the lead, NaN in contact and in pockets. Its dissipation with the
    lead is an upper bound (Dirichlet's principle): where that adds less than 0.5 %, the lead is left out, unless
    there are pockets.

    Returns the permeability, and the potential (n1, n2), NaN where no open path leads to both ends.

    Raises InputError: see `Spiral.seam`.
    NotConverged : the linear solver failed, or inflow and outflow differ.
    """
    n1, n2 = gap.shape
    shift, fraction = spiral.seam(gap.shape, spacing)
    weight = max(fraction, _LEAST_WEIGHT)
    scale = float(gap.max())
    if scale == 0:
        return None
    d1, d2 = unit_spacing(spacing)
    stencil = cell_stencil(gap / scale, (d1, d2), "periodic")
    across = stencil.across.copy()
    across[:, -1] = 0.0
    cut = replace(stencil, across=across)
    seam, c = _seam(cut, stencil.across[:, -1], gap / scale, d1 / d2, shift, weight)
    start = np.concatenate([np.ones((1, n2)), np.nan_to_num(plain), np.zeros((1, n2))])
    without = stencil.energy(start)
    with_lead = cut.energy(start) + c @ (seam @ start.ravel()) ** 2
    if not np.isnan(plain[gap > 0]).any() and with_lead <= (1 + LEAST_EFFECT) * without:
        return None
    matrix = cut.to_csr() + seam.T @ sp.diags_array(c) @ seam
    potential, joined = _between_ends(sp.csr_array(matrix), n2)
    conductance = 0.0
    if joined.any():
        conductance = cut.energy(potential.reshape(n1 + 2, n2)) + float(c @ (seam @ potential) ** 2)
        conductance = without + (fraction / weight) ** 2 * (conductance - without)
    shown = np.where(joined, potential, np.nan).reshape(n1 + 2, n2)[1:-1]
    return scale**3 * (n1 * d1) / (n2 * d2) * conductance, np.where(gap > 0, shown, np.nan)


def _seam(
    cut: Stencil, own: Array, gap: Array, aspect: float, shift: int, weight: float
) -> tuple[sp.csr_array, Array]:
    """Drops over the links of the seam (links, nodes) as a matrix, and their conductances.

    own (n1,) : conductances of the seam without a lead.
    """
    n1, n2 = gap.shape
    links = _Links()
    if weight >= 1:
        for i in range(1 - shift, n1 + 1):  # those above the first row begin at the inlet
            ends = ([gap[i - 1, -1]] if i > 0 else []) + (
                [gap[i + shift - 1, 0]] if i + shift <= n1 else []
            )
            if min(ends, default=0.0) > 0:
                here, there = max(i, 0) * n2 + n2 - 1, min(i + shift, n1 + 1) * n2
                links.add(cubic_law(np.mean(ends)) * aspect, {here: 1.0, there: -1.0})
        return links.matrix((n1 + 2) * n2)
    for i in range(1, min(shift, n1) + 1):
        links.add(own[i - 1], {i * n2: weight, 0: -weight})
    label = connected_components(cut.to_csr(), directed=False)[1].reshape(n1 + 2, n2)[1:-1]
    for rows in _grooves(own, shift):
        drop = (
            _drop_to_next(rows, own, label, shift)
            if label[rows[0], 0] == label[rows[0], -1]
            else {}
        )
        for i in rows:
            nodes = {(i + 1) * n2 + n2 - 1: 1.0, (i + 1) * n2: -1.0}
            for row, part in drop.items():
                nodes[(row + 1) * n2] = nodes.get((row + 1) * n2, 0.0) + weight * part
            links.add(own[i], nodes)
    return links.matrix((n1 + 2) * n2)


def _grooves(own: Array, shift: int) -> list[Indices]:
    """Rows beside each other where the seam is open, no more than the shift."""
    is_open = np.flatnonzero(own > 0)
    runs = np.split(is_open, np.flatnonzero(np.diff(is_open) > 1) + 1)
    return [part for run in runs if run.size for part in np.array_split(run, -(-run.size // shift))]


def _drop_to_next(rows: Indices, own: Array, label: Indices, shift: int) -> dict[int, float]:
    """Weights of rows whose sum is the mean drop from a groove to the one that a lead further belongs to.

    All rows of the groove take that drop, or fluid would run around between them. The next one is whatever connected
    gap most of the seam belongs to there; a groove that is closed there goes nowhere.
    """
    n1 = own.size
    drop = dict(zip(rows.tolist(), (own[rows] / own[rows].sum()).tolist(), strict=True))
    target = rows + shift
    beyond, inside = target >= n1, target[target < n1]
    if beyond.mean() > 0.5:
        drop[n1] = -1.0  # the outlet
        return drop
    inside = inside[own[inside] > 0]
    if inside.size == 0:
        return {}
    of = label[inside, 0]
    most = max(np.unique(of), key=lambda one: own[inside[of == one]].sum())
    chosen = inside[of == most]
    for row, part in zip(chosen.tolist(), (own[chosen] / own[chosen].sum()).tolist(), strict=True):
        drop[row] = drop.get(row, 0.0) - part
    return drop


class _Links:
    """Links that are collected one after the other: a conductance, and weights of nodes that make its drop."""

    def __init__(self) -> None:
        self.conductances: list[float] = []
        self.entries: list[tuple[int, int, float]] = []

    def add(self, conductance: float, nodes: dict[int, float]) -> None:
        """Add a link; none where it is closed."""
        if conductance > 0:
            self.entries += [(len(self.conductances), node, part) for node, part in nodes.items()]
            self.conductances.append(conductance)

    def matrix(self, nodes: int) -> tuple[sp.csr_array, Array]:
        """Drops (links, nodes) and conductances (links,)."""
        link, node, part = zip(*self.entries, strict=True) if self.entries else ((), (), ())
        shape = len(self.conductances), nodes
        drops = sp.coo_array(
            (np.array(part, float), (np.array(link, int), np.array(node, int))), shape=shape
        )
        return drops.tocsr(), np.array(self.conductances)


def _between_ends(matrix: sp.csr_array, n2: int) -> tuple[Array, NDArray[np.bool_]]:
    """Potential of all nodes, 1 and 0 in the first and last row of n2 of them and in what only one of these joins.

    Also returned: the nodes that open ways join to both ends; without any the potential dissipates nothing.
    """
    nodes = matrix.shape[0]
    label = connected_components(matrix, directed=False)[1]
    inlet, outlet = np.arange(nodes) < n2, np.arange(nodes) >= nodes - n2
    with_inlet = np.isin(label, label[inlet])
    joined = with_inlet & np.isin(label, label[outlet])
    potential = np.where(with_inlet & ~outlet, 1.0, 0.0)
    unknown = np.flatnonzero(joined & ~inlet & ~outlet)
    if unknown.size:
        rows = matrix[unknown]
        load = -np.asarray(rows[:, inlet].sum(axis=1)).ravel()
        potential[unknown] = solve_spd(
            rows[:, unknown], load, _RTOL, unit_drop=True, largest_residual=_IMBALANCE
        ).x
        into, out = (float((matrix[end] @ potential).sum()) for end in (inlet, outlet))
        imbalance = abs(into + out) / max(abs(into), abs(out))
        if not imbalance <= _IMBALANCE:
            raise NotConverged(
                f"flow along winding grooves: inflow and outflow differ by {imbalance:.1e}",
                imbalance,
            )
    return potential, joined
