"""Define what all sparse solvers share: the solution, the two ends of a flow, exact sums and conjugate gradients.

Sources: Knuth, The Art of Computer Programming 2, 3rd ed., 1997, sec. 4.2.2 (exact sums); Saad, Iterative Methods for
Sparse Linear Systems, 2nd ed., SIAM 2003, algorithm 9.1 (preconditioned conjugate gradients).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base import Array


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
    """Conductances between the unknowns and the two ends, which are the inlet and the outlet.

    The potential is 1 at the inlet and 0 at the outlet. The right-hand side of the linear system is `inlet`.

    Attributes
    ----------
    inlet, outlet : arrays (n,), conductance between each unknown and the inlet, and between each unknown and the
        outlet. A conductance must not be computed as a difference of large numbers, because small conductances would be
        inaccurate.
    """

    inlet: Array
    outlet: Array

    @property
    def total_conductance(self) -> Array:
        """Total conductance between each unknown and both ends, array (n,)."""
        return self.inlet + self.outlet

    def flow_from_inlet(self, x: Array, remainder: Array) -> Array:
        """Compute the flow from the inlet to each unknown, array (n,).

        x, remainder : arrays (n,), whose sum is the potential of the unknowns.
        """
        return self.inlet * ((1.0 - x) - remainder)

    def flow_from_outlet(self, x: Array, remainder: Array) -> Array:
        """Compute the flow from the outlet to each unknown, array (n,), which is negative; see `flow_from_inlet`."""
        return self.outlet * ((0.0 - x) - remainder)

    def supplied_energy(self, x: Array, remainder: Array) -> float:
        """Compute the energy that the inlet supplies, which is equal to the energy that the flow dissipates."""
        return float(self.flow_from_inlet(x, remainder).sum())


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Compute the rounded sum s of two arrays and its rounding error e, so that s + e is the exact sum."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


def imbalance_of(r: Array, x: Array) -> float:
    """Compute the imbalance of the flow that a residual r causes: Σr in total, or r·x, whichever is larger."""
    return max(abs(float(r.sum())), abs(float(r @ x)))


class Iteration(NamedTuple):
    """Result of `conjugate_gradients`.

    Attributes
    ----------
    x : array (n,), solution.
    number : number of iterations.
    product : product rᵀM⁻¹r of the last residual r, which estimates the squared error in the energy norm.
    converged : whether `is_done` ended the iteration.
    """

    x: Array
    number: int
    product: float
    converged: bool


def conjugate_gradients(
    apply: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    rhs: Array,
    is_done: Callable[[Array, Array, float], bool],
    most_iterations: int,
) -> Iteration:
    """Solve A x = b by preconditioned conjugate gradients, beginning with x = 0.

    Parameters
    ----------
    apply : function that computes A x.
    precondition : function that computes M⁻¹ r for a residual r, where M approximates A.
    rhs : array (n,), right-hand side b.
    is_done : function of x, of the residual r and of rᵀM⁻¹r, which decides after each iteration whether x is accurate
        enough.
    most_iterations : largest number of iterations. The iteration also ends if rounding errors make A or M indefinite.
    """
    x = np.zeros_like(rhs)
    r = rhs
    z = precondition(r)
    direction = z
    rz = float(r @ z)
    iteration = 0
    for iteration in range(1, most_iterations + 1):
        applied = apply(direction)
        curvature = float(direction @ applied)
        if not (curvature > 0 and rz > 0):
            break
        step = rz / curvature
        x += step * direction
        r = r - step * applied
        z = precondition(r)
        previous_rz = rz
        rz = float(r @ z)
        if is_done(x, r, rz):
            return Iteration(x, iteration, rz, True)
        direction = z + rz / previous_rz * direction
    return Iteration(x, iteration, rz, False)
