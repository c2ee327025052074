"""Compute the flow through a cell with standard functions of scikit-fem: the readable reference implementation.

The module `flow.plain` defines the discrete problem of the flow through a cell. `flow.cell` and `flow.grid` compute the
same operator faster, without a mesh. Tests assert that the reference implementation and the fast implementation give
the same permeability.

The unknowns are the pressures at the pixel centres. The corners of each bilinear element (Q1) are four pixel centres.
The elements at the inlet and the outlet, where the pressure is prescribed, have only half the length of a pixel. The
elements at mirrored sides have only half the width of a pixel. The weak form is integrated at the midpoints of the
element edges: K11 is given on the edges along x1, and K22 on the edges along x2. `gap_on_links` interpolates the gap at
the midpoints of the edges.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from skfem import Basis, ElementQuad1, MeshQuad

from ..base import Array, Pair
from . import forms
from .grid import gap_on_links
from .law import cubic_law
from .problem import MAX_IMBALANCE, DarcyFlow, checked_imbalance, potential_rtol
from .solvers.sparse import solve_network


def assemble_cell(gap: Array, spacing: Pair, sides: str) -> sp.csr_array:
    """Assemble the operator of the flow along the first axis of a cell.

    The nodes of the mesh are the pixel centres, and points on the inlet, on the outlet and on mirrored sides. The weak
    form is integrated at the midpoints of the element edges, where the gap is interpolated between two pixels. The
    function builds the mesh, computes the permeability at the midpoints of the edges, and joins the nodes that share an
    unknown.

    Parameters
    ----------
    gap : array (n1, n2), gap h >= 0 at the pixel centres; h = 0 is contact.
    spacing : lengths of a pixel along x1 and x2.
    sides : "periodic" or "mirror": how the gap continues beyond the sides of the cell.

    Returns
    -------
    Symmetric matrix with (n1 + 2) n2 rows. The unknowns are the n2 pressures at the inlet, the pressures at the pixel
    centres row by row, and the n2 pressures at the outlet.
    """
    # Step 1: the mesh. x1 and x2 are the coordinates of the lines of nodes. `column` is the column of pixels whose
    # pressure each line of nodes along x1 has.
    (n1, n2), (d1, d2) = gap.shape, spacing
    x1 = np.concatenate([[0.0], (np.arange(n1) + 0.5) * d1, [n1 * d1]])
    if sides == "periodic":  # the last line of nodes is the first line again
        x2 = (np.arange(n2 + 1) + 0.5) * d2
        column = np.arange(n2 + 1) % n2
    else:  # the lines at the sides have the pressure of the pixel centres beside them
        x2 = np.concatenate([[0.0], (np.arange(n2) + 0.5) * d2, [n2 * d2]])
        column = np.clip(np.arange(-1, n2 + 1), 0, n2 - 1)
    mesh = MeshQuad.init_tensor(x1, x2)
    basis = Basis(mesh, ElementQuad1(), quadrature=forms.EDGE_MIDPOINTS)

    # Step 2: K at the midpoints of the edges. The tables of K11 and K22 have a grid that is twice as fine as the grid
    # of nodes: nodes have two even indices, and the midpoint of an edge has one odd index.
    gap1, gap2 = gap_on_links(gap, ring1=False, ring2=sides == "periodic")
    if sides == "mirror":
        gap2 = np.pad(gap2, ((0, 0), (1, 1)))  # no pressure drops from a pixel centre to its side
    k11, k22 = np.zeros((2, 2 * x1.size - 1, 2 * x2.size - 1))
    k11[1::2, ::2] = cubic_law(gap1)[:, column]
    k22[2:-2:2, 1::2] = cubic_law(gap2)
    x = np.asarray(basis.global_coordinates())  # (axis, element, edge)
    # indices of the midpoint of each edge in the fine grid; np.interp converts a coordinate to the number of a line
    i = np.rint(2 * np.interp(x[0], x1, np.arange(x1.size))).astype(int)
    j = np.rint(2 * np.interp(x[1], x2, np.arange(x2.size))).astype(int)
    k = np.zeros((2, 2, *i.shape))
    k[0, 0] = k11[i, j]
    k[1, 1] = k22[i, j]
    # Edges along x2 at the ends have K22 = 0, so that the elements there take only half of K22 of the pixel centres.
    # Doubling K22 there makes up for the missing half.
    at_end = (i.min(axis=1) == 0) | (i.max(axis=1) == 2 * n1 + 2)
    k[1, 1, at_end] *= 2
    matrix = forms.darcy_flow.assemble(basis, k=k)

    # Step 3: nodes that have the same pressure, because of periodicity or mirroring, share an unknown.
    row = np.searchsorted(x1, mesh.p[0])
    unknown = row * n2 + column[np.searchsorted(x2, mesh.p[1])]
    join = sp.csr_array((np.ones(unknown.size), (unknown, np.arange(unknown.size))))
    return sp.csr_array(join @ matrix @ join.T)


def solve_plain(
    gap: Array,
    spacing: Pair,
    sides: str,
    *,
    rtol: float = 1e-6,
    field_rtol: float | None = None,
    solver: str = "amg",
) -> DarcyFlow:
    """Solve the flow along the first axis of a cell for a unit drop of the pressure.

    Parameters
    ----------
    gap, spacing, sides : as in `assemble_cell`.
    rtol : largest relative error of the conductance.
    field_rtol : largest relative error of the pressure in the energy norm; None for √rtol.
    solver : "amg" (pyamg) or "direct" (factorisation).

    Returns
    -------
    DarcyFlow. The array `potential` (n1 + 2, n2) contains the pressures at the inlet (first row), at the pixel centres
    (the next n1 rows) and at the outlet (last row).

    Raises
    ------
    NotConverged : the linear solver failed.
    """
    matrix = assemble_cell(gap, spacing, sides)
    matrix.eliminate_zeros()
    wanted = potential_rtol(rtol, field_rtol)
    n1, n2 = gap.shape
    network = solve_network(matrix, n2, wanted, solver)
    pressure = network.potential.reshape(n1 + 2, n2)
    complement = network.complement.reshape(n1 + 2, n2)
    solution = network.solution
    if solution is None:
        return DarcyFlow(0.0, pressure, complement, percolates=False)

    # The conductance is equal to the energy. Computed from pressure differences it does not suffer from cancellation.
    link = sp.triu(matrix, k=1).tocoo()
    drop = np.nan_to_num(network.potential[link.row] - network.potential[link.col])
    conductance = float(-link.data @ drop**2)
    imbalance = checked_imbalance(
        network.inflow,
        network.outflow,
        conductance,
        scale=conductance,
        allowed=max(MAX_IMBALANCE, 0.01 * wanted),
        advice="try the solver 'elimination'",
    )
    return DarcyFlow(
        conductance,
        pressure,
        complement,
        percolates=True,
        iterations=solution.iterations,
        residual=solution.residual,
        imbalance=imbalance,
        solver=solution.solver,
    )
