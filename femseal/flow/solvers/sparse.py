"""Solve symmetric positive definite sparse systems from any finite-element assembly, by multigrid or factorisation."""

from __future__ import annotations

from typing import Any

from ...base import Array, NotConverged
from ..problem import PLAIN_SOLVERS, check_solver
from .amg import solve_amg
from .direct import Ends, LinearSolution, solve_direct

#: Number of unknowns up to which a factorisation is faster than multigrid. Times were measured on one core with P1, Q1,
#: P2 and Q2 elements. With 20,000 unknowns, factorisation takes 58 to 75 ms, and multigrid 61 to 90 ms; with 50,000
#: unknowns, 160 to 260 ms and 150 to 220 ms; with 100,000 unknowns, 350 to 650 ms and 280 to 410 ms; with 300,000
#: unknowns, 1.4 to 2.2 s and 0.9 to 1.5 s; with a million unknowns (P1), 34 s and 4.5 s. With 300,000 unknowns,
#: factorisation needs 490 to 560 MB of memory, and multigrid 200 to 320 MB.
DIRECT_UNKNOWNS = 50_000


def solve_sparse(
    matrix: Any,
    rhs: Array,
    rtol: float,
    solver: str = "auto",
    *,
    unit_drop: bool = False,
    largest_residual: float = 1e-8,
    ends: Ends | None = None,
) -> LinearSolution:
    """Solve A x = b by conjugate gradients with algebraic multigrid, or by a sparse factorisation.

    Parameters
    ----------
    matrix, rhs, rtol, unit_drop : as in `solve_amg`.
    solver : "direct", "amg", or "auto", which chooses "amg" for more than 50,000 unknowns. If "amg" fails, the system
        is solved by a factorisation.
    largest_residual, ends : as in `solve_direct`.

    Raises
    ------
    InputError : the solver is unknown.
    NotConverged : as in `solve_direct`.
    """
    check_solver(solver, ("auto", *PLAIN_SOLVERS))
    if solver == "auto":
        solver = "amg" if matrix.shape[0] > DIRECT_UNKNOWNS else "direct"
    if solver == "amg":
        try:
            return solve_amg(matrix, rhs, rtol=rtol, unit_drop=unit_drop)
        except NotConverged:
            pass
    return solve_direct(matrix, rhs, largest_residual=largest_residual, ends=ends)
