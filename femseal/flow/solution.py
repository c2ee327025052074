"""The solution of a flow problem, on a grid or a mesh."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..base import Array
from ..base.errors import InputError

#: Solvers of the flow through a grid.
SOLVERS = ("auto", "multigrid", "elimination", "amg")
#: Inlet and outlet flow may differ by this fraction before a direct or a precise solution is refused.
MAX_IMBALANCE = 1e-5
#: What to do about elements of the second order.
LINEAR = "with linear elements; mesh with elements of the first order, finer where sides are curved"
#: Error of the potential in the norm of the energy that is allowed where it is shown or written.
FIELD_RTOL = 1e-6


def check_solver(solver: str) -> None:
    """Raise InputError unless this is the name of a solver."""
    if solver not in SOLVERS:
        raise InputError("solver", repr(solver), f"one of {', '.join(SOLVERS)}")


def potential_rtol(rtol: float, field_rtol: float | None = None) -> float:
    """Error allowed to the potential in the norm of the energy, of which the flow has the square."""
    return float(np.sqrt(rtol)) if field_rtol is None else min(float(np.sqrt(rtol)), field_rtol)


@dataclass(frozen=True)
class DarcyFlow:
    """Flow for a unit drop of potential; exactly 0 without an open path from inlet to outlet.

    conductance : equal to the energy that the potential dissipates.
    potential : at the nodes; 1 or 0 where it is connected to one end only, NaN in pockets, connected to neither.
    complement : 1 − potential; elimination computes it with a relative accuracy of its own.
    iterations, residual : 0 for a direct solution; otherwise residual is the estimated error of the potential in the
        norm of the energy, whose square is that of the conductance.
    imbalance : relative difference of inlet and outlet flow.
    solver : that found the solution: "multigrid", "elimination", "amg" or "direct"; "none" if
        there was no unknown.
    lower, upper : bounds of the conductance, NaN if not computed.
    """

    conductance: float = field(
        metadata={"unit": "m^3", "long_name": "flow for a unit drop of potential"}
    )
    potential: Array = field(
        metadata={"unit": "1", "long_name": "potential at the nodes"}, repr=False
    )
    complement: Array = field(metadata={"unit": "1", "long_name": "1 - potential"}, repr=False)
    percolates: bool
    iterations: int = 0
    residual: float = 0.0
    imbalance: float = 0.0
    solver: str = "none"
    lower: float = field(
        default=np.nan, metadata={"unit": "m^3", "long_name": "lower bound of the conductance"}
    )
    upper: float = field(
        default=np.nan, metadata={"unit": "m^3", "long_name": "upper bound of the conductance"}
    )
