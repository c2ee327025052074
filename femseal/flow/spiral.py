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
from scipy.sparse.csgraph import connected_components

from ..base import Array, Flags, Indices, InputError, NotConverged, Pair, to_text
from .cell import cell_stencil
from .grid import Stencil
from .law import cubic_law
from .problem import unit_spacing
from .solvers.direct import Ends
from .solvers.sparse import solve_sparse

#: A conductance, and weights of nodes that make the drop over it.
_Link = tuple[float, dict[int, float]]
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
        length = shape[1] * spacing[1]
        breadth = shape[0] * spacing[0]
        turn = length if self.circumference is None else self.circumference
        if turn < length * (1 - 1e-9):
            given = f"{to_text(turn, 'm', 3)} around a face {to_text(length, 'm', 3)} long"
            raise InputError("lay.circumference", given, "at least the length of the face")
        if self.lead >= breadth:
            given = f"{to_text(self.lead, 'm', 3)} on a face {to_text(breadth, 'm', 3)} broad"
            raise InputError("lay.lead", given, "less than the breadth")
        pixels = max(1, round(self.lead / spacing[0]))
        if turn <= length * (1 + 1e-9):
            return pixels, length / turn
        return pixels, length / turn * self.lead / (pixels * spacing[0])


def spiral_flow(
    gap: Array, spacing: Pair, spiral: Spiral, plain: Array
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
    start = np.concatenate([np.ones((1, n2)), np.nan_to_num(plain), np.zeros((1, n2))])
    across = stencil.across.copy()
    across[:, -1] = 0.0
    cut = replace(stencil, across=across)
    if weight >= 1:
        links = _around_one_turn(gap / scale, d1 / d2, shift)
    else:
        links = _around_a_part(cut, stencil.across[:, -1], shift, weight)
    links = [(one, nodes) for one, nodes in links if one > 0]
    c = np.array([one for one, _ in links])
    seam = _drops([nodes for _, nodes in links], start.size)
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


def _drops(links: list[dict[int, float]], nodes: int) -> sp.csr_array:
    """Weights of nodes that make the drop over each link, as a matrix (links, nodes)."""
    entries = [(k, *entry) for k, weights in enumerate(links) for entry in weights.items()]
    link, node, part = np.reshape(entries, (-1, 3)).T
    places = link.astype(int), node.astype(int)
    return sp.coo_array((part, places), shape=(len(links), nodes)).tocsr()


def _around_one_turn(gap: Array, aspect: float, shift: int) -> list[_Link]:
    """Links over the seam of a face that is one turn long, from the last column to the first one, `shift` rows on.

    Those above the first row begin at the inlet, and those below the last one end at the outlet.
    """
    n1, n2 = gap.shape
    end = np.full(shift, np.nan)
    ends = np.array([np.concatenate([end, gap[:, -1]]), np.concatenate([gap[:, 0], end])])
    c = np.where((ends == 0).any(axis=0), 0.0, cubic_law(np.nanmean(ends, axis=0)) * aspect)
    row = np.arange(1 - shift, n1 + 1)
    here = np.maximum(row, 0) * n2 + n2 - 1
    there = np.minimum(row + shift, n1 + 1) * n2
    pairs = zip(c.tolist(), here.tolist(), there.tolist(), strict=True)
    return [(one, {a: 1.0, b: -1.0}) for one, a, b in pairs]


def _around_a_part(cut: Stencil, own: Array, shift: int, weight: float) -> list[_Link]:
    """Links over the seam of a face that stands for a turn; own (n1,) : conductances of the seam without a lead."""
    n1, n2 = own.size, cut.along.shape[1]
    links: list[_Link] = [
        (own[i - 1], {i * n2: weight, 0: -weight}) for i in range(1, min(shift, n1) + 1)
    ]
    label = connected_components(cut.to_csr(), directed=False)[1].reshape(n1 + 2, n2)[1:-1]
    for rows in _grooves(own, shift):
        drop = np.zeros(n1 + 1)
        if label[rows[0], 0] == label[rows[0], -1]:
            drop = weight * _drop_to_next(rows, own, label, shift)
        for i in rows:
            of_row = drop.copy()
            of_row[i] -= 1.0
            at = np.flatnonzero(of_row)
            nodes = dict(zip(((at + 1) * n2).tolist(), of_row[at].tolist(), strict=True))
            links.append((own[i], {(i + 1) * n2 + n2 - 1: 1.0} | nodes))
    return links


def _grooves(own: Array, shift: int) -> list[Indices]:
    """Rows beside each other where the seam is open, no more than the shift."""
    is_open = np.flatnonzero(own > 0)
    runs = np.split(is_open, np.flatnonzero(np.diff(is_open) > 1) + 1)
    return [part for run in runs if run.size for part in np.array_split(run, -(-run.size // shift))]


def _drop_to_next(rows: Indices, own: Array, label: Indices, shift: int) -> Array:
    """Weights of rows and outlet whose sum is the mean drop from a groove to the one that a lead further belongs to.

    All rows of the groove take that drop, or fluid would run around between them. The next one is whatever connected
    gap most of the seam belongs to there; a groove that is closed there goes nowhere.
    """
    n1 = own.size
    drop = np.zeros(n1 + 1)
    drop[rows] = own[rows] / own[rows].sum()
    target = rows + shift
    if (target >= n1).mean() > 0.5:
        drop[n1] = -1.0
        return drop
    inside = target[target < n1]
    inside = inside[own[inside] > 0]
    if inside.size == 0:
        return np.zeros(n1 + 1)
    of = label[inside, 0]
    most = max(np.unique(of), key=lambda one: own[inside[of == one]].sum())
    chosen = inside[of == most]
    drop[chosen] -= own[chosen] / own[chosen].sum()
    return drop


def _between_ends(matrix: sp.csr_array, n2: int) -> tuple[Array, Flags]:
    """Potential of all nodes, 1 and 0 in the first and last row of n2 of them and in what only one of these joins.

    Also returned: the nodes that open ways join to both ends; without any the potential dissipates nothing.
    """
    nodes = matrix.shape[0]
    label = connected_components(matrix, directed=False)[1]
    inlet = np.arange(nodes) < n2
    outlet = np.arange(nodes) >= nodes - n2
    with_inlet = np.isin(label, label[inlet])
    joined = with_inlet & np.isin(label, label[outlet])
    potential = np.where(with_inlet & ~outlet, 1.0, 0.0)
    unknown = np.flatnonzero(joined & ~inlet & ~outlet)
    if unknown.size:
        rows = matrix[unknown]
        load = -np.asarray(rows[:, inlet].sum(axis=1)).ravel()
        links = [-np.asarray(rows[:, end].sum(axis=1)).ravel() for end in (inlet, outlet)]
        ends = Ends(np.array([1.0, 0.0]), np.array(links))
        potential[unknown] = solve_sparse(
            rows[:, unknown],
            load,
            _RTOL,
            unit_drop=True,
            largest_residual=_IMBALANCE,
            ends=ends,
        ).x
        into, out = (float((matrix[end] @ potential).sum()) for end in (inlet, outlet))
        imbalance = abs(into + out) / max(abs(into), abs(out))
        if not imbalance <= _IMBALANCE:
            raise NotConverged(
                f"flow along winding grooves: inflow and outflow differ by {imbalance:.1e}",
                imbalance,
            )
    return potential, joined
