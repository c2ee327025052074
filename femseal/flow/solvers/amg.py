"""Solve sparse linear systems of flow problems by conjugate gradients with the algebraic multigrid of pyamg.

Ruge–Stüben multigrid is the preconditioner. The interpolation of Ruge–Stüben multigrid preserves constants if the rows
of the matrix sum to zero. The matrix is therefore not scaled to unit diagonal. The rows of the scaled matrix would not
sum to zero, and with strongly varying permeabilities the iteration would take ten times as long or diverge. The
coarsening has a second pass, which is also needed to preserve constants. Some finite elements have positive
off-diagonal entries; only negative off-diagonal entries count as strong couplings.

Sources: Ruge & Stüben, in McCormick (ed.), Multigrid Methods, SIAM 1987, ch. 4; Bell, Olson, Schroder & Southworth,
J. Open Source Softw. 8, 2023, 5495 (pyamg).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...base import Array, NotConverged
from .direct import factorised
from .linear_solution import LinearSolution, conjugate_gradients, imbalance_of, two_sum

#: Largest number of unknowns of the coarsest level, which is factorised.
_COARSEST = 500
_MAX_ITERATIONS = 100
#: Largest number of corrections, each a solution for the remaining residual.
_MAX_CORRECTIONS = 3
#: Largest relative difference between inflow and outflow for a unit potential drop: `_IMBALANCE`, or
#: `_IMBALANCE_BY_TOLERANCE` times the tolerance of the potential, whichever is larger.
_IMBALANCE, _IMBALANCE_BY_TOLERANCE = 1e-6, 3e-3
#: Row sums below this fraction of the diagonal are treated as rounding errors.
_ROUNDING = 16 * np.finfo(float).eps
#: The iteration stops when the estimated error is below `_STOPPING` times the tolerance. The error is then estimated
#: again from the residual of x itself, and must be below `_CONFIRMED` times the tolerance. In random cells the
#: estimates were too small by a factor of up to 4.
_STOPPING, _CONFIRMED = 0.1, 0.3
#: Smallest relative error of the potential in the energy norm that can be resolved.
_LEAST_ERROR = 1e-12


def solve_amg(matrix: Any, rhs: Array, *, rtol: float, unit_drop: bool = False) -> LinearSolution:
    """Solve A x = b by conjugate gradients, preconditioned by algebraic multigrid.

    With the residual r and the preconditioner M, the squared error in the energy norm is estimated as rᵀM⁻¹r. The
    iteration stops when rᵀM⁻¹r is below (rtol/10)² times the energy. For a flow with a unit potential drop, the
    difference between inflow and outflow, Σr, must also be small enough: below 1e-6 or 0.003 rtol times the flow,
    whichever is larger. After the iteration, the residual is computed again from x itself, and both stopping conditions
    are checked again. The residual is computed from differences of x, so that large entries of A do not hide small
    entries. The result is reproducible, because no random numbers are used.

    Parameters
    ----------
    matrix : sparse matrix A (n, n), symmetric and positive semidefinite. A row of A may be zero if the entry of b in
        this row is 0.
    rhs : right-hand sides b, array (n,) or (n, m).
    rtol : largest relative error of x in the energy norm. The relative error of the energy, and of the flow for a unit
        potential drop, is at most rtol².
    unit_drop : whether the system describes a flow for a unit potential drop. If true, x is a potential between 0 and
        1, b contains the conductances to the boundary with the potential 1, and the energy is the flow Σb − b·x. If
        false, the energy is b·x.

    Returns
    -------
    LinearSolution in the shape of b.

    Raises
    ------
    NotConverged : the iteration did not converge, or the second error estimate was too large.
    """
    a = sp.csr_matrix(matrix, copy=True)
    a.sum_duplicates()
    a.eliminate_zeros()
    diagonal = a.diagonal()
    if np.any(rhs[diagonal == 0]):
        raise NotConverged(
            "flow: the right-hand side is not 0 at a node without links; leave such nodes out",
            np.inf,
        )
    # rows with entries beside the diagonal; all other rows are solved by a division
    linked = np.flatnonzero(np.diff(a.indptr) > (diagonal != 0))
    x = np.divide(rhs.T, diagonal, out=np.zeros(rhs.T.shape), where=diagonal != 0).T
    complement = 1 - x
    remainder = np.zeros_like(x)
    iterations = 0
    error = 0.0
    if linked.size:
        system = _System(a if linked.size == len(diagonal) else a[linked][:, linked])
        for column in np.ndindex(rhs.shape[1:]):
            index = (linked, *column)
            solution = system.solve(rhs[index], rtol, unit_drop)
            x[index] = solution.x
            complement[index] = solution.complement
            remainder[index] = solution.remainder
            iterations += solution.iterations
            error = max(error, solution.residual)
    return LinearSolution(x, complement, iterations, error, "amg", remainder)


class _System:
    """A matrix with the hierarchy of its multigrid preconditioner.

    Attributes
    ----------
    matrix : sparse matrix A (n, n).
    levels : levels of pyamg, from the finest to the coarsest.
    coarsest : factorisation of the matrix of the coarsest level.
    rows : row number of each stored entry of A.
    sums : array (n,), sum of each row of A.
    rounding : array (n,), size of the rounding error of each row sum.
    """

    def __init__(self, matrix: sp.csr_matrix) -> None:
        """Build the multigrid levels of a matrix, and factorise the coarsest level."""
        from pyamg import ruge_stuben_solver

        self.matrix = matrix
        self.levels = ruge_stuben_solver(
            matrix,
            strength=("classical", {"theta": 0.5, "norm": "min"}),
            CF=("RS", {"second_pass": True}),
            presmoother=("gauss_seidel", {"sweep": "forward"}),
            postsmoother=("gauss_seidel", {"sweep": "backward"}),
            max_coarse=_COARSEST,
        ).levels
        self.coarsest = factorised(sp.csc_array(self.levels[-1].A))
        self.rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        self.sums = matrix @ np.ones(matrix.shape[0])
        self.rounding = _ROUNDING * matrix.diagonal()

    def precondition(self, r: Array, level: int = 0) -> Array:
        """Apply one V-cycle to the residual r, beginning with zero."""
        grid = self.levels[level]
        if level == len(self.levels) - 1:
            return np.asarray(self.coarsest.solve(r))
        z = np.zeros_like(r)
        grid.presmoother(grid.A, z, r)
        coarse_residual = grid.R @ (r - grid.A @ z)
        z += grid.P @ self.precondition(coarse_residual, level + 1)
        grid.postsmoother(grid.A, z, r)
        return z

    def solve(self, b: Array, rtol: float, unit_drop: bool) -> LinearSolution:
        """Solve for one right-hand side, see `solve_amg`.

        For a unit potential drop, x is stored as the sum of an integer, 0 or 1, and a fraction, so that both x and 1 −
        x can be computed with a small relative error.
        """
        if not b.any():
            return LinearSolution(np.zeros_like(b), np.ones_like(b), 0, 0.0, "amg")
        # The sum of a row is the conductance between its node and the boundaries. If the node is linked to no boundary
        # except the inlet, the exact sum is the entry of b. Sums that differ from b by no more than rounding errors are
        # therefore replaced by b.
        at_inlet = b if unit_drop else np.zeros_like(b)
        sums = np.where(np.abs(self.sums - at_inlet) <= self.rounding, at_inlet, self.sums)
        integer = np.zeros_like(b)
        fraction = np.zeros_like(b)
        r = b
        iterations = 0
        for _ in range(_MAX_CORRECTIONS):
            correction, needed = self._correction(integer + fraction, r, b, rtol, unit_drop)
            fraction = fraction + correction
            iterations += needed
            if unit_drop:
                # x = integer + fraction, with the nearest of 0 and 1 as the integer, so that the fraction is small
                nearest = np.rint(np.clip(integer + fraction, 0, 1))
                fraction += integer - nearest
                integer = nearest
            # residual b − A x
            r = (b - self._apply(sums, integer)) - self._apply(sums, fraction)
            x, remainder = two_sum(integer, fraction)
            complement = (1 - integer) - fraction
            energy = float(b @ complement) if unit_drop else float(b @ x)
            error = np.inf
            if energy > 0:
                error = np.sqrt(max(float(r @ self.precondition(r)), 0.0) / energy)
            allowed_imbalance = 2 * _largest_imbalance(rtol) * energy
            is_balanced = not unit_drop or imbalance_of(r, x) <= allowed_imbalance
            if error <= max(_CONFIRMED * rtol, _LEAST_ERROR) and is_balanced:
                return LinearSolution(x, complement, iterations, float(error), "amg", remainder)
        raise NotConverged(
            f"flow: the potential has an error of {error:.1e}, wanted {rtol:.1e}; "
            "try the solver 'auto' or 'direct'",
            float(error),
        )

    def _apply(self, sums: Array, x: Array) -> Array:
        """Compute A x from the row sums of A and from differences of x."""
        drop = x[self.matrix.indices] - x[self.rows]
        return sums * x + np.bincount(self.rows, self.matrix.data * drop, len(x))

    def _correction(
        self, start: Array, r: Array, b: Array, rtol: float, unit_drop: bool
    ) -> tuple[Array, int]:
        """Solve A y = r by preconditioned conjugate gradients; return y and the number of iterations.

        start : value of x before the correction y is added.
        """
        total = float(b.sum()) if unit_drop else 0.0
        at_start = float(b @ start)

        def is_done(correction: Array, residual: Array, rz: float) -> bool:
            """Return whether the potential is accurate, and whether inflow and outflow agree."""
            energy = abs(total - at_start - float(b @ correction))
            is_accurate = rz <= max(_STOPPING * rtol, _LEAST_ERROR) ** 2 * energy
            if not is_accurate:
                return False
            allowed_imbalance = _largest_imbalance(rtol) * energy
            return not unit_drop or imbalance_of(residual, start + correction) <= allowed_imbalance

        iteration = conjugate_gradients(
            self.matrix.__matmul__, self.precondition, r, is_done, _MAX_ITERATIONS
        )
        if not iteration.converged:
            raise NotConverged(
                f"flow: algebraic multigrid did not converge within {iteration.number} iterations; "
                "try the solver 'auto' or 'direct'",
                iteration.product,
            )
        return iteration.x, iteration.number


def _largest_imbalance(rtol: float) -> float:
    """Return the largest relative imbalance that is accepted for a tolerance `rtol` of the potential."""
    return max(_IMBALANCE, _IMBALANCE_BY_TOLERANCE * rtol)
