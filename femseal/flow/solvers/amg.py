"""Solution of the symmetric positive definite systems of flow.

SuperLU with minimum degree ordering (3, 27, 190 and 1260 ms at 48², 128², 256² and 512² unknowns on one core of a
2-core machine) wherever its memory is bearable; above, conjugate gradients on pyamg's hierarchy, checked.
Networks of links have a direct solver of their own, see `elimination`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from ...base.errors import NotConverged

Array = NDArray[np.float64]
#: Unknowns up to which the direct solver is taken (about 2 GB at the limit).
DIRECT_UNKNOWNS = 1_000_000
_MAX_ITERATIONS = 1000


@dataclass(frozen=True)
class LinearSolution:
    """x, and how it was reached: iterations are 0 for a direct solution; residual is ‖b − Ax‖/‖b‖."""

    x: Array
    iterations: int
    residual: float
    solver: str = "direct"


def solve_spd(
    a: sp.csc_array, b: Array, rtol: float, method: str = "auto", largest_residual: float = 1e-8
) -> LinearSolution:
    """Solve A x = b, scaled to unit diagonal so that any contrast of the coefficients is bearable.

    Parameters
    ----------
    a : (n, n) symmetric positive definite, csc.
    b : (n,) or (n, m).
    rtol : relative error of the energy bᵀx to reach iteratively.
    method : "auto" by size, "direct" or "amg".
    largest_residual : allowed to a direct solution.

    Raises
    ------
    NotConverged : the iteration stalled, the factorisation failed, or its residual is too large.
    """
    a = sp.csc_array(a)
    scale = 1 / np.sqrt(a.diagonal())
    columns = np.repeat(np.arange(a.shape[0]), np.diff(a.indptr))
    scaled = sp.csc_array((a.data * scale[a.indices] * scale[columns], a.indices, a.indptr), shape=a.shape)
    rhs = (b.T * scale).T
    direct = method == "direct" or (method == "auto" and a.shape[0] <= DIRECT_UNKNOWNS)
    if direct:
        options = {"SymmetricMode": True}
        try:
            factor = splu(scaled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        except RuntimeError as error:
            raise NotConverged(f"flow: the factorisation failed: {error}", np.inf) from None
        y, iterations = factor.solve(rhs), 0
    else:
        y, iterations = _conjugate_gradients(scaled.tocsr(), rhs, rtol)
    norm = float(np.linalg.norm(rhs))
    residual = float(np.linalg.norm(rhs - scaled @ y)) / norm if norm else 0.0
    if direct and not residual <= largest_residual:
        raise NotConverged(f"flow: the direct solution has a residual of {residual:.1e}", residual)
    return LinearSolution((y.T * scale).T, iterations, residual)


def _conjugate_gradients(a: sp.csr_array, b: Array, rtol: float) -> tuple[Array, int]:
    """CG preconditioned by smoothed aggregation; stops when rᵀM⁻¹r, an estimate of the energy error, is small."""
    from pyamg import smoothed_aggregation_solver

    hierarchy = smoothed_aggregation_solver(sp.csr_matrix(a), max_coarse=500).aspreconditioner()
    x, r = np.zeros_like(b), b.copy()
    z = hierarchy @ r
    d, rz = z, float(r @ z)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        ad = a @ d
        step = rz / float(d @ ad)
        x += step * d
        r -= step * ad
        z = hierarchy @ r
        rz, rz_old = float(r @ z), rz
        # flows at the ends are as good as the potential, whose error is the root of the energy's
        if rz <= (0.1 * rtol) ** 2 * float(b @ x):
            return x, iteration
        d = z + rz / rz_old * d
    raise NotConverged(
        f"flow: energy error {rz / float(b @ x):.1e} after {_MAX_ITERATIONS} iterations, wanted {rtol:.1e}; "
        "try fewer unknowns so that the direct solver is taken",
        rz / float(b @ x),
    )


def solve_direct(matrix, rhs, largest_residual=1e-8):
    """Factorise and solve A x = b."""
    x = solve_spd(sp.csc_array(matrix), rhs, 1e-12, "direct", largest_residual)
    return LinearSolution(x.x, 0, x.residual, "direct")


def solve_amg(matrix, rhs, *, rtol):
    """Solve A x = b by conjugate gradients on the hierarchy of pyamg."""
    x = solve_spd(sp.csc_array(matrix), rhs, rtol, "amg")
    return LinearSolution(x.x, x.iterations, x.residual, "amg")
