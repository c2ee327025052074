"""Solve symmetric positive definite sparse systems from any finite-element assembly, by multigrid or factorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from ...base import Array, Flags, NotConverged
from ..problem import MESH_SOLVERS, check_solver
from .amg import solve_amg
from .direct import solve_direct, solve_direct_between
from .linear_solution import Ends, LinearSolution
from .thresholds import DIRECT_UNKNOWNS


def solve_spd(
    matrix: Any, rhs: Array, rtol: float, solver: str = "auto", *, largest_residual: float = 1e-8
) -> LinearSolution:
    """Solve A x = b by conjugate gradients with algebraic multigrid, or by a sparse factorisation.

    Parameters
    ----------
    matrix : sparse matrix A (n, n), symmetric and positive definite.
    rhs : right-hand sides b, array (n,) or (n, m).
    rtol : largest relative error of x in the energy norm that "amg" may leave.
    solver : "direct", "amg", or "auto", see the table in `femseal.flow.solvers`.
    largest_residual : largest ‖b − Ax‖/‖b‖ that is accepted from "direct".

    Raises
    ------
    InputError : the solver is unknown.
    NotConverged : the solver failed.
    """
    if _uses_multigrid(matrix, solver):
        try:
            return solve_amg(matrix, rhs, rtol=rtol)
        except NotConverged:
            if solver != "auto":
                raise
    return solve_direct(matrix, rhs, largest_residual=largest_residual)


def solve_between_ends(
    matrix: Any, ends: Ends, rtol: float, solver: str = "auto", *, largest_residual: float = 1e-8
) -> LinearSolution:
    """Solve for the potential between an inlet with the potential 1 and an outlet with the potential 0.

    Parameters
    ----------
    matrix : sparse matrix (n, n) of the unknown potentials, symmetric and positive definite.
    ends : conductances between the unknowns and the two ends.
    rtol, solver, largest_residual : as in `solve_spd`.

    Raises
    ------
    InputError, NotConverged : as in `solve_spd`.
    """
    if _uses_multigrid(matrix, solver):
        try:
            return solve_amg(matrix, ends.inlet, rtol=rtol, unit_drop=True)
        except NotConverged:
            if solver != "auto":
                raise
    return solve_direct_between(matrix, ends, largest_residual=largest_residual)


@dataclass(frozen=True, eq=False)
class NetworkFlow:
    """Flow through a network of nodes between an inlet and an outlet, for a unit potential drop.

    Attributes
    ----------
    potential : array (nodes,). The potential is 1 at nodes that are only connected to the inlet, 0 at nodes that are
        only connected to the outlet, and NaN in pockets, which are connected to neither.
    complement : 1 − potential.
    is_through : flags (nodes,) of the nodes that are connected to both inlet and outlet.
    solution : solution of the linear system; None if there is no path from inlet to outlet.
    inflow, outflow : flow from the inlet, and flow to the outlet.
    """

    potential: Array
    complement: Array
    is_through: Flags
    solution: LinearSolution | None = None
    inflow: float = 0.0
    outflow: float = 0.0


def solve_network(
    matrix: sp.csr_array,
    columns: int,
    rtol: float,
    solver: str = "auto",
    *,
    largest_residual: float = 1e-8,
) -> NetworkFlow:
    """Solve for the potential of all nodes of a network; nodes that carry no flow are left out of the linear system.

    Parameters
    ----------
    matrix : symmetric matrix of all nodes, whose rows sum to zero. The first nodes are the inlet, the last nodes the
        outlet.
    columns : number of nodes of the inlet, and number of nodes of the outlet.
    rtol, solver, largest_residual : as in `solve_spd`.

    Raises
    ------
    InputError, NotConverged : as in `solve_spd`.
    """
    nodes = matrix.shape[0]
    inlet = np.arange(columns)
    outlet = np.arange(nodes - columns, nodes)
    _, component = connected_components(matrix, directed=False)
    at_inlet = np.isin(component, component[inlet])
    at_outlet = np.isin(component, component[outlet])
    potential = np.where(at_inlet, 1.0, np.where(at_outlet, 0.0, np.nan))
    potential[outlet] = 0.0
    complement = 1 - potential
    is_through = at_inlet & at_outlet
    is_unknown = is_through.copy()
    is_unknown[inlet] = False
    is_unknown[outlet] = False
    unknown = np.flatnonzero(is_unknown)
    if not unknown.size:
        return NetworkFlow(potential, complement, is_through)
    rows = matrix[unknown]
    ends = Ends(-rows[:, inlet].sum(axis=1), -rows[:, outlet].sum(axis=1))
    solution = solve_between_ends(
        rows[:, unknown], ends, rtol, solver, largest_residual=largest_residual
    )
    potential[unknown] = solution.x
    complement[unknown] = solution.complement
    inflow = float(ends.inlet @ solution.complement)
    outflow = float(ends.outlet @ solution.x)
    return NetworkFlow(potential, complement, is_through, solution, inflow, outflow)


def _uses_multigrid(matrix: Any, solver: str) -> bool:
    """Check the name of the solver, and return whether algebraic multigrid is used, or tried first."""
    check_solver(solver, MESH_SOLVERS)
    return solver == "amg" or (solver == "auto" and matrix.shape[0] > DIRECT_UNKNOWNS)
