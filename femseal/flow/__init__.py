"""Compute the permeability of a cell from its gap: weak form, discrete operators and solvers, also for whole seals."""

from typing import TYPE_CHECKING

from ..base.lazy_package import lazy

if TYPE_CHECKING:
    from .cell import Permeability, cell_permeability
    from .grid import Stencil
    from .law import CubicLaw, FlowLaw, FukuiKaneko, SlipLength
    from .percolation import Constriction, critical_constriction
    from .problem import SOLVERS, DarcyFlow
    from .solvers.choice import solve_flow
    from .spiral import Spiral
    from .tensor import permeability_tensor
else:
    __getattr__, __dir__ = lazy(__name__)

__all__ = [
    "SOLVERS",
    "Constriction",
    "CubicLaw",
    "DarcyFlow",
    "FlowLaw",
    "FukuiKaneko",
    "Permeability",
    "SlipLength",
    "Spiral",
    "Stencil",
    "cell_permeability",
    "critical_constriction",
    "permeability_tensor",
    "solve_flow",
]
