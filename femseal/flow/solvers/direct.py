"""Sparse factorisation of a flow, corrected where the contrast of the permeability takes its digits.

A factorisation loses as many digits as the contrast has: what a region that conducts well passes on through elements
that conduct little is lost in the sums on the diagonal. Between boundaries of given potentials its solution is
therefore corrected by conjugate gradients, with residuals from differences of the potential, and kept as a sum of two
numbers.
Tests have flows in closed form, and eliminated in 60 digits, with contrasts up to 1e20.

Sources: Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., SIAM 2002, ch. 12 (iterative refinement);
Knuth, The Art of Computer Programming 2, 3rd ed., 1997, sec. 4.2.2 (exact sums).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ...base import Array, Indices, NotConverged

#: Relative error in the norm of the energy at which a direct solution needs no correction, the largest that it may have
#: where corrections make it no smaller, as at anisotropic tensors, and its imbalance over the flow. The flow itself
#: errs by the square.
_SMALL_ERROR, _LARGEST_ERROR, _LARGEST_IMBALANCE = 1e-10, 1e-6, 1e-6
#: A correction that leaves more than this part of the error is the last.
_NO_GAIN = 0.1
#: Most corrections, and most iterations of each, which ends at this error in the norm of the energy.
_MOST_CORRECTIONS, _MOST_ITERATIONS, _LEAST_ERROR = 4, 100, 1e-12
#: What is added to the unit diagonal where the factorisation itself fails by rounding errors: it keeps the matrix
#: positive definite, and each region that conducts well takes about one more iteration.
_SHIFT = 1e-13


@dataclass(frozen=True)
class LinearSolution:
    """A solution of A x = b, with its solver and residual.

    complement : 1 − x; for a unit drop it keeps its own relative accuracy where x is nearly 1.
    iterations : of conjugate gradients, 0 for a direct solution.
    residual : the estimated relative error in the norm of the energy ("amg"), or ‖b − Ax‖/‖b‖ ("direct").
    solver : "amg" or "direct", whichever gave x.
    remainder : what x lacks of the solution by the rounding of its numbers; 0 where that is not known.
    """

    x: Array
    complement: Array
    iterations: int
    residual: float
    solver: str
    remainder: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Ends:
    """Boundaries of given potentials.

    levels : potential of each boundary (boundaries,).
    links : conductance that joins each boundary to each unknown (boundaries, n), without rounding errors of sums.
    """

    levels: Array
    links: Array

    @property
    def total(self) -> Array:
        """Conductance that joins each unknown to all boundaries (n,)."""
        return np.asarray(self.links.sum(axis=0))

    def inflow(self, x: Array, remainder: Array) -> Array:
        """Flow from each boundary to each unknown (boundaries, n) at the potential x + remainder."""
        return self.links * ((self.levels[:, None] - x) - remainder)

    def power(self, x: Array, remainder: Array) -> float:
        """Power that the boundaries supply: what the flow dissipates."""
        return float(self.levels @ self.inflow(x, remainder).sum(axis=1))


def solve_direct(
    matrix: Any, rhs: Array, *, largest_residual: float = 1e-8, ends: Ends | None = None
) -> LinearSolution:
    """Solve A x = b by SuperLU with minimum degree ordering, A scaled to unit diagonal against its contrast.

    matrix : (n, n) symmetric positive definite, sparse.
    rhs : (n,), or (n, m) without `ends`.
    largest_residual : ‖b − Ax‖/‖b‖ of the scaled system that is allowed.
    ends : boundaries of a flow, of which b is the sum of links times levels. With them the solution is corrected until
        it has all digits, whatever the contrast of the permeability.

    Raises NotConverged: the factorisation failed, or its residual is too large.
    """
    a = sp.csc_array(matrix)
    scale = 1 / np.sqrt(a.diagonal())
    columns = np.repeat(np.arange(a.shape[0]), np.diff(a.indptr))
    scaled = sp.csc_array(
        (a.data * scale[a.indices] * scale[columns], a.indices, a.indptr), shape=a.shape
    )
    if ends is not None:
        return _Flow(a, scaled, scale, columns, ends).solve(rhs, largest_residual)
    b = (rhs.T * scale).T
    y = factorised(scaled).solve(b)
    norm = float(np.linalg.norm(b))
    residual = float(np.linalg.norm(b - scaled @ y)) / norm if norm else 0.0
    if not residual <= largest_residual:
        raise NotConverged(f"flow: the direct solution has a residual of {residual:.1e}", residual)
    x = (y.T * scale).T
    return LinearSolution(x, 1 - x, 0, residual, "direct")


def factorised(matrix: sp.csc_array) -> Any:
    """Factorise a symmetric positive definite matrix; raises NotConverged where it is singular."""
    try:
        return splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise NotConverged(f"flow: the factorisation failed: {error}", np.inf) from None


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the rounded sum of two arrays, and what it lacks, exactly."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def imbalance_of(r: Array, x: Array) -> float:
    """Return the imbalance that the residual r leaves at the outlet and at both ends together."""
    return max(abs(float(r.sum())), abs(float(r @ x)))


@dataclass(frozen=True, eq=False)
class _Flow:
    """The system of a flow between boundaries.

    matrix, scaled : with its own diagonal, and scaled to unit diagonal. scale : of its rows and columns (n,).
    columns : of its entries. ends : boundaries.
    """

    matrix: sp.csc_array
    scaled: sp.csc_array
    scale: Array
    columns: Indices
    ends: Ends

    def solve(self, b: Array, largest_residual: float) -> LinearSolution:
        """Solve for the levels of the boundaries, see `solve_direct`."""
        levels = self.ends.levels
        if np.ptp(levels) == 0 or not b.any():  # nothing flows
            x = np.full(len(b), levels[0] if b.any() else 0.0)
            return LinearSolution(x, 1 - x, 0, 0.0, "direct", np.zeros_like(x))
        errors = []
        for shift in (0.0, _SHIFT):
            try:
                solution, error = self._solved(self._factor(shift), b)
            except NotConverged:
                continue
            if solution.residual <= largest_residual and error <= _LARGEST_ERROR:
                return solution
            errors.append(max(solution.residual, error))
        error = min(errors, default=np.inf)
        raise NotConverged(
            f"flow: the direct solution has an error of {error:.1e}; "
            "try a smaller contrast of the permeability",
            error,
        )

    def _solved(self, factor: Any, b: Array) -> tuple[LinearSolution, float]:
        """Return the solution with a factorisation, corrected as long as that helps, and its error."""
        x = self._preconditioned(factor, b)
        remainder = np.zeros_like(x)
        norm = np.linalg.norm(self.scale * b)
        former = np.inf
        for correction in range(_MOST_CORRECTIONS + 1):
            r = self._residual(x, remainder)
            error = self._error(factor, r, x, remainder)
            is_enough = error <= _SMALL_ERROR or (_NO_GAIN * former < error <= _LARGEST_ERROR)
            if is_enough or correction == _MOST_CORRECTIONS:
                break
            former = error
            change = self._correction(factor, r, error)
            x, remainder = two_sum(x, remainder + change)
        residual = float(np.linalg.norm(self.scale * r) / norm)
        complement = (1 - x) - remainder
        return LinearSolution(x, complement, 0, residual, "direct", remainder), error

    def _factor(self, shift: float) -> Any:
        if not shift:
            return factorised(self.scaled)
        return factorised(sp.csc_array(self.scaled + shift * sp.eye_array(self.scaled.shape[0])))

    def _preconditioned(self, factor: Any, r: Array) -> Array:
        return np.asarray(self.scale * factor.solve(self.scale * r))

    def _between_unknowns(self, x: Array) -> Array:
        """Flow out of each unknown to its neighbours, from differences, in which large numbers hide no small ones."""
        rows = self.matrix.indices
        flow = self.matrix.data * (x[self.columns] - x[rows])
        return np.asarray(np.bincount(rows, flow, len(x)))

    def _residual(self, x: Array, remainder: Array) -> Array:
        inflow = self.ends.inflow(x, remainder).sum(axis=0)
        return np.asarray(inflow - self._between_unknowns(x) - self._between_unknowns(remainder))

    def _error(self, factor: Any, r: Array, x: Array, remainder: Array) -> float:
        """Relative error of x in the norm of the energy, by its residual r; inf where the flow does not balance."""
        power = self.ends.power(x, remainder)
        squared = float(r @ self._preconditioned(factor, r))
        if not (power > 0 and squared >= 0):
            return np.inf
        if imbalance_of(r, x) > _LARGEST_IMBALANCE * power:
            return np.inf
        return float(np.sqrt(squared / power))

    def _correction(self, factor: Any, r: Array, error: float) -> Array:
        """Return what is to be added to x with the residual r, by conjugate gradients with the factorisation."""
        links = self.ends.total
        correction = np.zeros_like(r)
        z = self._preconditioned(factor, r)
        direction = z
        rz = float(r @ z)
        # no further than the error that counts, whatever it is relative to
        enough = rz * (_LEAST_ERROR / min(error, 1.0)) ** 2
        for _ in range(_MOST_ITERATIONS):
            applied = links * direction + self._between_unknowns(direction)
            curvature = float(direction @ applied)
            if not (curvature > 0 and rz > 0):
                break
            step = rz / curvature
            correction += step * direction
            r = r - step * applied
            z = self._preconditioned(factor, r)
            former = rz
            rz = float(r @ z)
            if rz <= enough:
                break
            direction = z + rz / former * direction
        return correction
