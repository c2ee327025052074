"""Solve flow problems by a sparse factorisation, with corrections if the permeabilities differ by orders of magnitude.

If the permeabilities differ by a factor of 10^n, a factorisation loses about n digits: small conductances between
regions of large conductance are lost in the sums on the diagonal. For a flow between boundaries with prescribed
potentials, conjugate gradients correct the solution. The residuals are computed from differences of the potential. The
potential is stored as a rounded value plus a remainder, which doubles its number of digits. Tests compare the solutions
with closed forms and with eliminations in 60-digit arithmetic, for permeabilities that differ by a factor of up to
1e20.

Source: Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., SIAM 2002, ch. 12 (iterative refinement).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ...base import Array, Indices, NotConverged
from .linear_solution import Ends, LinearSolution, conjugate_gradients, imbalance_of, two_sum

#: Relative error in the energy norm at which no correction is needed. The relative error of the flow is the square of
#: this number.
_SMALL_ERROR = 1e-10
#: Relative error in the energy norm that is accepted if corrections do not reduce it, which happens with anisotropic
#: tensors.
_LARGEST_ERROR = 1e-6
#: Largest imbalance relative to the flow.
_LARGEST_IMBALANCE = 1e-6
#: No further correction is made if the last correction has left more than this fraction of the error.
_NO_GAIN = 0.1
#: Largest number of corrections, and largest number of iterations for each correction.
_MOST_CORRECTIONS, _MOST_ITERATIONS = 4, 100
#: Relative error in the energy norm at which the iterations of a correction end.
_LEAST_ERROR = 1e-12
#: Number that is added to the unit diagonal if the factorisation fails because of rounding errors. The increased
#: diagonal makes the matrix positive definite, but costs about one more iteration for each region of large conductance.
_SHIFT = 1e-13


def solve_direct(matrix: Any, rhs: Array, *, largest_residual: float = 1e-8) -> LinearSolution:
    """Solve A x = b by SuperLU with minimum degree ordering, after A is scaled to unit diagonal.

    Parameters
    ----------
    matrix : sparse matrix A (n, n), symmetric and positive definite.
    rhs : right-hand sides b, array (n,) or (n, m).
    largest_residual : largest accepted value of ‖b − Ax‖/‖b‖ for the scaled system.

    Raises
    ------
    NotConverged : the factorisation failed, or the residual of the solution is too large.
    """
    system = _ScaledSystem.of_matrix(matrix)
    b = (rhs.T * system.scale).T
    y = factorised(system.scaled).solve(b)
    norm = float(np.linalg.norm(b))
    residual = float(np.linalg.norm(b - system.scaled @ y)) / norm if norm else 0.0
    if not residual <= largest_residual:
        raise NotConverged(f"flow: the direct solution has a residual of {residual:.1e}", residual)
    x = (y.T * system.scale).T
    return LinearSolution(x, 1 - x, 0, residual, "direct")


def solve_direct_between(
    matrix: Any, ends: Ends, *, largest_residual: float = 1e-8
) -> LinearSolution:
    """Solve for the potential between two ends by SuperLU, and correct the solution to full accuracy.

    The solution is accurate even if the permeabilities differ by orders of magnitude.

    Parameters
    ----------
    matrix : sparse matrix A (n, n), symmetric and positive definite.
    ends : conductances between the unknowns and the two ends.
    largest_residual : as in `solve_direct`.

    Raises
    ------
    NotConverged : the factorisation failed, or the error of the solution is too large.
    """
    if not ends.inlet.any():  # nothing flows
        x = np.zeros(ends.inlet.shape)
        return LinearSolution(x, 1 - x, 0, 0.0, "direct", np.zeros_like(x))
    system = _BoundaryFlow(_ScaledSystem.of_matrix(matrix), ends)
    errors = []
    for shift in (0.0, _SHIFT):
        try:
            solution, error = system.solve_and_correct(shift)
        except NotConverged:
            continue
        if solution.residual <= largest_residual and error <= _LARGEST_ERROR:
            return solution
        errors.append(max(solution.residual, error))
    error = min(errors, default=np.inf)
    raise NotConverged(
        f"flow: the direct solution has an error of {error:.1e}; "
        "try a smaller permeability contrast",
        error,
    )


def factorised(matrix: sp.csc_array) -> Any:
    """Factorise a symmetric positive definite matrix, or raise NotConverged if it is singular."""
    try:
        return splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise NotConverged(f"flow: the factorisation failed: {error}", np.inf) from None


class _ScaledSystem(NamedTuple):
    """A matrix, and the same matrix scaled to unit diagonal.

    Attributes
    ----------
    matrix : sparse matrix (n, n).
    scaled : the matrix scaled to unit diagonal.
    scale : array (n,), scaling factors of rows and columns.
    columns : column number of each stored entry of the matrix; the row number is in `matrix.indices`.
    """

    matrix: sp.csc_array
    scaled: sp.csc_array
    scale: Array
    columns: Indices

    @classmethod
    def of_matrix(cls, matrix: Any) -> _ScaledSystem:
        """Scale a sparse matrix to unit diagonal."""
        a = sp.csc_array(matrix)
        scale = 1 / np.sqrt(a.diagonal())
        columns = np.repeat(np.arange(a.shape[0]), np.diff(a.indptr))
        scaled = sp.csc_array(
            (a.data * scale[a.indices] * scale[columns], a.indices, a.indptr), shape=a.shape
        )
        return cls(a, scaled, scale, columns)


@dataclass(frozen=True, eq=False)
class _BoundaryFlow:
    """Linear system of a flow between two ends.

    Attributes
    ----------
    system : matrix of the unknowns.
    ends : conductances between the unknowns and the two ends.
    """

    system: _ScaledSystem
    ends: Ends

    def solve_and_correct(self, shift: float) -> tuple[LinearSolution, float]:
        """Solve the system, and correct the solution until corrections no longer reduce the error.

        shift : number that is added to the diagonal of the scaled matrix before the factorisation.

        Returns the solution, and the estimated relative error of the solution in the energy norm.
        """
        factor = self._factorise(shift)
        b, scale = self.ends.inlet, self.system.scale
        x = self._preconditioned(factor, b)
        remainder = np.zeros_like(x)
        norm = np.linalg.norm(scale * b)
        previous_error = np.inf
        for correction in range(_MOST_CORRECTIONS + 1):
            r = self._residual(x, remainder)
            squared_error = float(r @ self._preconditioned(factor, r))
            error = self._relative_error(squared_error, r, x, remainder)
            has_stalled = _NO_GAIN * previous_error < error
            is_enough = error <= _SMALL_ERROR or (has_stalled and error <= _LARGEST_ERROR)
            if is_enough or correction == _MOST_CORRECTIONS:
                break
            previous_error = error
            # stop the iterations when the remaining error of x is about _LEAST_ERROR
            enough = squared_error * (_LEAST_ERROR / min(error, 1.0)) ** 2
            change = self._correction(factor, r, enough)
            x, remainder = two_sum(x, remainder + change)
        residual = float(np.linalg.norm(scale * r) / norm)
        complement = (1 - x) - remainder
        return LinearSolution(x, complement, 0, residual, "direct", remainder), error

    def _factorise(self, shift: float) -> Any:
        """Factorise the scaled matrix with `shift` added to its diagonal."""
        scaled = self.system.scaled
        if not shift:
            return factorised(scaled)
        identity = sp.eye_array(scaled.shape[0])
        return factorised(sp.csc_array(scaled + shift * identity))

    def _preconditioned(self, factor: Any, r: Array) -> Array:
        """Solve the system for the right-hand side r by the factorisation of the scaled matrix, without corrections."""
        scale = self.system.scale
        return np.asarray(scale * factor.solve(scale * r))

    def _between_unknowns(self, x: Array) -> Array:
        """Compute the total flow from each unknown to its neighbours, for the potential x.

        The flow is computed from differences of x, to avoid cancellation.
        """
        matrix, columns = self.system.matrix, self.system.columns
        flow = matrix.data * (x[columns] - x[matrix.indices])
        return np.asarray(np.bincount(matrix.indices, flow, len(x)))

    def _residual(self, x: Array, remainder: Array) -> Array:
        """Compute the residual for the potential x + remainder, that is, the net flow into each unknown."""
        inflow = self.ends.flow_from_inlet(x, remainder) + self.ends.flow_from_outlet(x, remainder)
        return np.asarray(inflow - self._between_unknowns(x) - self._between_unknowns(remainder))

    def _relative_error(self, squared_error: float, r: Array, x: Array, remainder: Array) -> float:
        """Estimate the relative error of x in the energy norm.

        The error is at least the imbalance relative to the flow. If the imbalance is too large, the estimated error is
        infinite.

        squared_error : product rᵀM⁻¹r of the residual r, which estimates the squared error of x in the energy norm.
        """
        energy = self.ends.supplied_energy(x, remainder)
        if not (energy > 0 and squared_error >= 0):
            return np.inf
        imbalance = imbalance_of(r, x) / energy
        if imbalance > _LARGEST_IMBALANCE:
            return np.inf
        # With a shift, M is too large where a region is linked to the ends by narrow links only. The squared error is
        # then too small, but the imbalance contains the error of the flow into such a region.
        return max(float(np.sqrt(squared_error / energy)), imbalance)

    def _correction(self, factor: Any, r: Array, enough: float) -> Array:
        """Compute a correction of x by conjugate gradients, preconditioned with the factorisation.

        r : residual of x.
        enough : squared error in the energy norm at which the iterations end.
        """
        to_ends = self.ends.total_conductance
        iteration = conjugate_gradients(
            lambda direction: to_ends * direction + self._between_unknowns(direction),
            lambda residual: self._preconditioned(factor, residual),
            r,
            lambda _x, _r, squared_error: squared_error <= enough,
            _MOST_ITERATIONS,
        )
        return iteration.x
