"""Algebraic multigrid of pyamg for the sparse matrices of the plain path.

Multigrid is Ruge–Stüben's, as the preconditioner of conjugate gradients. Its interpolation keeps constants where the
rows of the matrix sum to zero, so the matrix is taken as it is: scaled to unit diagonal, whose rows do not, strong
contrasts take ten times the iterations or do not converge. The second pass of the coarsening is needed likewise, and on
elements of which some couplings are positive only negative ones may count as strong.

Sources: Ruge & Stüben, in McCormick (ed.), Multigrid Methods, SIAM 1987, ch. 4; Bell, Olson, Schroder & Southworth,
J. Open Source Softw. 8, 2023, 5495 (pyamg).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...base import Array, NotConverged
from .direct import LinearSolution, factorised, imbalance_of, two_sum

#: Unknowns of the coarsest level, which is factorised.
_COARSEST = 500
_MAX_ITERATIONS = 100
#: Largest number of corrections, each a solution for the remaining residual.
_MAX_CORRECTIONS = 3
#: Relative difference allowed between inflow and outflow for a unit drop, and its fraction of the error allowed to the
#: potential where that is more.
_BALANCE, _SHARE_OF_ERROR = 1e-6, 3e-3
#: Row sums below this fraction of the diagonal are taken for rounding errors.
_ROUNDING = 16 * np.finfo(float).eps
#: Fractions of the error allowed at which the iteration stops, and that the residual of x itself has to confirm; it is
#: an estimate, in random cells from below by up to a factor of 4.
_STOPPED, _CONFIRMED = 0.1, 0.3
#: Smaller errors of the potential in the norm of the energy cannot be resolved.
_LEAST_ERROR = 1e-12


def solve_amg(matrix: Any, rhs: Array, *, rtol: float, unit_drop: bool = False) -> LinearSolution:
    """Solve A x = b by conjugate gradients with algebraic multigrid; no random number is drawn.

    It stops when rᵀM⁻¹r, which estimates the squared error in the norm of the energy, is below (rtol/10)² of the
    energy; for a unit drop also the sum of the residuals, by which inflow and outflow differ, has to be below 1e-6 of
    the flow, or 0.003 rtol where that is more. Both are checked again with the residual of x itself, taken from
    differences of x, in which large entries of A do not hide small ones.

    matrix : (n, n) symmetric positive semidefinite, sparse; rows of zeros only are allowed where b is 0 as well.
    rhs : (n,) or (n, m).
    rtol : error of x in the norm of the energy that is allowed, relative to the energy. The energy itself, and so the
    flow for a unit drop, errs by the square of it.
    unit_drop : x is a potential between 0 and 1 for a unit drop, and b has the conductances with the nodes at 1. The
    energy is then the flow Σb − b·x, and otherwise b·x.

    Raises NotConverged: the iteration stalled, or its error estimate was not confirmed.
    """
    a = sp.csr_matrix(matrix, copy=True)
    a.sum_duplicates()
    a.eliminate_zeros()
    diagonal = a.diagonal()
    if np.any(rhs[diagonal == 0]):
        raise NotConverged(
            "flow: a node without links is given a flow; leave such nodes out", np.inf
        )
    linked = np.flatnonzero(np.diff(a.indptr) > (diagonal != 0))
    x = np.divide(rhs.T, diagonal, out=np.zeros(rhs.T.shape), where=diagonal != 0).T
    complement, remainder = 1 - x, np.zeros_like(x)
    iterations, error = 0, 0.0
    if linked.size:
        system = _System(a if linked.size == len(diagonal) else a[linked][:, linked])
        for column in np.ndindex(rhs.shape[1:]):
            here = (linked, *column)
            found = system.solve(rhs[here], rtol, unit_drop)
            x[here], complement[here], remainder[here] = found.x, found.complement, found.remainder
            iterations, error = iterations + found.iterations, max(error, found.residual)
    return LinearSolution(x, complement, iterations, error, "amg", remainder)


class _System:
    """A matrix with its hierarchy of levels."""

    def __init__(self, matrix: sp.csr_matrix) -> None:
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
        """One V-cycle from zero."""
        here = self.levels[level]
        if level == len(self.levels) - 1:
            return np.asarray(self.coarsest.solve(r))
        z = np.zeros_like(r)
        here.presmoother(here.A, z, r)
        z += here.P @ self.precondition(here.R @ (r - here.A @ z), level + 1)
        here.postsmoother(here.A, z, r)
        return z

    def solve(self, b: Array, rtol: float, unit_drop: bool) -> LinearSolution:
        """Solve for one right-hand side, see `solve_amg`.

        x is the sum of a part that is 0 or 1 and a rest, so that both x and 1 − x keep their relative accuracy.
        """
        if not b.any():
            return LinearSolution(np.zeros_like(b), np.ones_like(b), 0, 0.0, "amg")
        # a row sums to what links its node with the ends, which only for the outlet is not known to all digits
        at_inlet = b if unit_drop else np.zeros_like(b)
        sums = np.where(np.abs(self.sums - at_inlet) <= self.rounding, at_inlet, self.sums)
        whole, rest, r = np.zeros_like(b), np.zeros_like(b), b
        iterations = 0
        for _ in range(_MAX_CORRECTIONS):
            rest, taken = self._corrected(whole + rest, rest, r, b, rtol, unit_drop)
            iterations += taken
            if unit_drop:
                ones = np.rint(np.clip(whole + rest, 0, 1))
                rest += whole - ones
                whole = ones
            r = (b - self._applied(sums, whole)) - self._applied(sums, rest)
            x, remainder = two_sum(whole, rest)
            complement = (1 - whole) - rest
            energy = float(b @ complement) if unit_drop else float(b @ x)
            error = (
                np.sqrt(max(float(r @ self.precondition(r)), 0.0) / energy)
                if energy > 0
                else np.inf
            )
            balanced = not unit_drop or imbalance_of(r, x) <= 2 * _balance(rtol) * energy
            if error <= max(_CONFIRMED * rtol, _LEAST_ERROR) and balanced:
                return LinearSolution(x, complement, iterations, float(error), "amg", remainder)
        raise NotConverged(
            f"flow: the potential has an error of {error:.1e}, wanted is {rtol:.1e}", float(error)
        )

    def _applied(self, sums: Array, x: Array) -> Array:
        """A x from the sums of its rows and from differences of x."""
        drop = x[self.matrix.indices] - x[self.rows]
        return sums * x + np.bincount(self.rows, self.matrix.data * drop, len(x))

    def _corrected(
        self, start: Array, rest: Array, r: Array, b: Array, rtol: float, unit_drop: bool
    ) -> tuple[Array, int]:
        """`rest` with the solution for r added; `start` is where x is."""
        a, correction, r = self.matrix, np.zeros_like(r), r.copy()
        total = float(b.sum()) if unit_drop else 0.0
        at_start = float(b @ start)
        z = self.precondition(r)
        d, rz, iteration = z, float(r @ z), 0
        for iteration in range(1, _MAX_ITERATIONS + 1):
            ad = a @ d
            curvature = float(d @ ad)
            if not (curvature > 0 and rz > 0):
                break
            step = rz / curvature
            correction += step * d
            r -= step * ad
            z = self.precondition(r)
            rz, rz_old = float(r @ z), rz
            energy = abs(total - at_start - float(b @ correction))
            if rz <= max(_STOPPED * rtol, _LEAST_ERROR) ** 2 * energy and (
                not unit_drop or imbalance_of(r, start + correction) <= _balance(rtol) * energy
            ):
                return rest + correction, iteration
            d = z + rz / rz_old * d
        raise NotConverged(
            f"flow: algebraic multigrid did not converge within {iteration} iterations; try a direct solver",
            rz,
        )


def _balance(rtol: float) -> float:
    """Imbalance allowed beside this error of the potential."""
    return max(_BALANCE, _SHARE_OF_ERROR * rtol)
