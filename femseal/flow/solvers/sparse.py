"""Solve symmetric positive definite sparse systems, which may come from any assembly: the solvers of the plain path."""

from __future__ import annotations

from typing import Any

from ...base import Array, NotConverged
from ..problem import PLAIN_SOLVERS, check_solver
from .amg import solve_amg
from .direct import Ends, LinearSolution, solve_direct

#: Number of unknowns up to which a factorisation is faster than multigrid. Measured times of factorisation : multigrid
#: in ms on one core, for P1, Q1, P2 and Q2: 20,000 unknowns 74:78, 58:61, 75:90, 61:76; 50,000 260:200, 160:150,
#: 240:220, 170:170; 100,000 650:410, 350:280, 460:400, 375:345; 300,000 2000:1200, 1460:920, 2200:1330, 1420:1470; a
#: million with P1 34,000:4500. Memory at 300,000 unknowns: 560 : 320 MB with Q2, 490 : 200 MB with P1.
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
    """Solve A x = b with a solver of the plain path.

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
