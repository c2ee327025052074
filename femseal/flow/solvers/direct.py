"""Solve flow problems by a sparse factorisation, with corrections if the permeabilities differ by orders of magnitude.

If the permeabilities differ by a factor of 10^n, a factorisation loses about n digits: small conductances between
regions of large conductance are lost in the sums on the diagonal. For a flow between boundaries with prescribed
potentials, conjugate gradients correct the solution. The residuals are computed from differences of the potential. The
potential is stored as a rounded value plus a remainder, which doubles its number of digits. Tests compare the solutions
with closed forms and with eliminations in 60-digit arithmetic, for permeabilities that differ by a factor of up to
1e20.

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


@dataclass(frozen=True)
class LinearSolution:
    """Solution of A x = b.

    Attributes
    ----------
    x : array (n,) or (n, m), solution.
    complement : 1 − x. For a flow with a unit potential drop, the relative error of the complement is small even where
        x is nearly 1.
    iterations : number of iterations of conjugate gradients; 0 for a direct solution.
    residual : estimated relative error in the energy norm ("amg"), or ‖b − Ax‖/‖b‖ ("direct").
    solver : name of the solver that was used, "amg" or "direct"; "none" if there was no unknown.
    remainder : difference between the solution and x (the solution rounded to double precision); 0 if it is not known.
    """

    x: Array
    complement: Array
    iterations: int
    residual: float
    solver: str
    remainder: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Ends:
    """Boundaries with prescribed potentials.

    Attributes
    ----------
    potentials : array (boundaries,), potential of each boundary.
    conductances : array (boundaries, n), conductance between each boundary and each unknown. A conductance must not be
        computed as a difference of large numbers, because small conductances would be inaccurate.
    """

    potentials: Array
    conductances: Array

    @property
    def total_conductance(self) -> Array:
        """Total conductance between each unknown and all boundaries, array (n,)."""
        return np.asarray(self.conductances.sum(axis=0))

    def inflow(self, x: Array, remainder: Array) -> Array:
        """Compute the flow from each boundary to each unknown, array (boundaries, n).

        x, remainder : arrays (n,), whose sum is the potential of the unknowns.
        """
        return self.conductances * ((self.potentials[:, None] - x) - remainder)

    def supplied_energy(self, x: Array, remainder: Array) -> float:
        """Compute the energy that the boundaries supply, which is equal to the energy that the flow dissipates."""
        return float(self.potentials @ self.inflow(x, remainder).sum(axis=1))


def solve_direct(
    matrix: Any, rhs: Array, *, largest_residual: float = 1e-8, ends: Ends | None = None
) -> LinearSolution:
    """Solve A x = b by SuperLU with minimum degree ordering, after A is scaled to unit diagonal.

    Parameters
    ----------
    matrix : sparse matrix A (n, n), symmetric and positive definite.
    rhs : right-hand side b, array (n,). If `ends` is None, arrays (n, m) are also possible.
    largest_residual : largest accepted value of ‖b − Ax‖/‖b‖ for the scaled system.
    ends : boundaries with prescribed potentials, if the system describes a flow between boundaries. For such a system,
        b must be `ends.potentials @ ends.conductances`. Its solution is corrected to full accuracy, even if the
        permeabilities differ by orders of magnitude.

    Raises
    ------
    NotConverged : the factorisation failed, or the residual of the solution is too large.
    """
    a = sp.csc_array(matrix)
    scale = 1 / np.sqrt(a.diagonal())
    # column number of each stored entry; its row number is in `a.indices`
    columns = np.repeat(np.arange(a.shape[0]), np.diff(a.indptr))
    scaled = sp.csc_array(
        (a.data * scale[a.indices] * scale[columns], a.indices, a.indptr), shape=a.shape
    )
    if ends is not None:
        return _BoundaryFlow(a, scaled, scale, columns, ends).solve(rhs, largest_residual)
    b = (rhs.T * scale).T
    y = factorised(scaled).solve(b)
    norm = float(np.linalg.norm(b))
    residual = float(np.linalg.norm(b - scaled @ y)) / norm if norm else 0.0
    if not residual <= largest_residual:
        raise NotConverged(f"flow: the direct solution has a residual of {residual:.1e}", residual)
    x = (y.T * scale).T
    return LinearSolution(x, 1 - x, 0, residual, "direct")


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


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Compute the rounded sum s of two arrays and its rounding error e, so that s + e is the exact sum."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def imbalance_of(r: Array, x: Array) -> float:
    """Compute the imbalance of the flow that a residual r causes: Σr in total, or r·x, whichever is larger."""
    return max(abs(float(r.sum())), abs(float(r @ x)))


@dataclass(frozen=True, eq=False)
class _BoundaryFlow:
    """Linear system of a flow between boundaries with prescribed potentials.

    Attributes
    ----------
    matrix : sparse matrix (n, n).
    scaled : the matrix scaled to unit diagonal.
    scale : array (n,), scaling factors of rows and columns.
    columns : column number of each stored entry of the matrix.
    ends : boundaries.
    """

    matrix: sp.csc_array
    scaled: sp.csc_array
    scale: Array
    columns: Indices
    ends: Ends

    def solve(self, b: Array, largest_residual: float) -> LinearSolution:
        """Solve for the right-hand side b, see `solve_direct`."""
        potentials = self.ends.potentials
        if np.ptp(potentials) == 0 or not b.any():  # nothing flows
            x = np.full(len(b), potentials[0] if b.any() else 0.0)
            return LinearSolution(x, 1 - x, 0, 0.0, "direct", np.zeros_like(x))
        errors = []
        for shift in (0.0, _SHIFT):
            try:
                solution, error = self._solve_and_correct(self._factorise(shift), b)
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

    def _solve_and_correct(self, factor: Any, b: Array) -> tuple[LinearSolution, float]:
        """Solve the system with a factorisation, and correct the solution until corrections no longer reduce the error.

        Returns the solution, and the estimated relative error of the solution in the energy norm.
        """
        x = self._preconditioned(factor, b)
        remainder = np.zeros_like(x)
        norm = np.linalg.norm(self.scale * b)
        previous_error = np.inf
        for correction in range(_MOST_CORRECTIONS + 1):
            r = self._residual(x, remainder)
            error = self._error(factor, r, x, remainder)
            has_stalled = _NO_GAIN * previous_error < error
            is_enough = error <= _SMALL_ERROR or (has_stalled and error <= _LARGEST_ERROR)
            if is_enough or correction == _MOST_CORRECTIONS:
                break
            previous_error = error
            change = self._correction(factor, r, error)
            x, remainder = two_sum(x, remainder + change)
        residual = float(np.linalg.norm(self.scale * r) / norm)
        complement = (1 - x) - remainder
        return LinearSolution(x, complement, 0, residual, "direct", remainder), error

    def _factorise(self, shift: float) -> Any:
        """Factorise the scaled matrix with `shift` added to its diagonal."""
        if not shift:
            return factorised(self.scaled)
        identity = sp.eye_array(self.scaled.shape[0])
        return factorised(sp.csc_array(self.scaled + shift * identity))

    def _preconditioned(self, factor: Any, r: Array) -> Array:
        """Solve the system for the right-hand side r by the factorisation of the scaled matrix, without corrections."""
        return np.asarray(self.scale * factor.solve(self.scale * r))

    def _between_unknowns(self, x: Array) -> Array:
        """Compute the total flow from each unknown to its neighbours, for the potential x.

        The flow is computed from differences of x, to avoid cancellation.
        """
        rows = self.matrix.indices
        flow = self.matrix.data * (x[self.columns] - x[rows])
        return np.asarray(np.bincount(rows, flow, len(x)))

    def _residual(self, x: Array, remainder: Array) -> Array:
        """Compute the residual for the potential x + remainder, that is, the net flow into each unknown."""
        inflow = self.ends.inflow(x, remainder).sum(axis=0)
        return np.asarray(inflow - self._between_unknowns(x) - self._between_unknowns(remainder))

    def _error(self, factor: Any, r: Array, x: Array, remainder: Array) -> float:
        """Estimate the relative error of x in the energy norm from the residual r.

        If inflow and outflow differ too much, the estimated error is infinite.
        """
        energy = self.ends.supplied_energy(x, remainder)
        squared_error = float(r @ self._preconditioned(factor, r))
        if not (energy > 0 and squared_error >= 0):
            return np.inf
        if imbalance_of(r, x) > _LARGEST_IMBALANCE * energy:
            return np.inf
        return float(np.sqrt(squared_error / energy))

    def _correction(self, factor: Any, r: Array, error: float) -> Array:
        """Compute a correction of x by conjugate gradients, preconditioned with the factorisation.

        r : residual of x.
        error : estimated relative error of x, which determines how accurate the correction needs to be.
        """
        to_ends = self.ends.total_conductance
        correction = np.zeros_like(r)
        z = self._preconditioned(factor, r)
        direction = z
        rz = float(r @ z)
        # stop when the remaining error of x is about _LEAST_ERROR
        enough = rz * (_LEAST_ERROR / min(error, 1.0)) ** 2
        for _ in range(_MOST_ITERATIONS):
            applied = to_ends * direction + self._between_unknowns(direction)
            curvature = float(direction @ applied)
            if not (curvature > 0 and rz > 0):
                break
            step = rz / curvature
            correction += step * direction
            r = r - step * applied
            z = self._preconditioned(factor, r)
            previous_rz = rz
            rz = float(r @ z)
            if rz <= enough:
                break
            direction = z + rz / previous_rz * direction
        return correction
