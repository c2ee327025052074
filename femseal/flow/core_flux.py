"""Compute the flux in the core of a cell that was solved with overlaps into its neighbours (oversampling).

The solution includes channels that leave the core through its sides and come back, but only the flux inside the core is
counted. For a uniform gap and for parallel grooves, the result is the permeability of the core itself.
Source: Hou & Wu, J. Comput. Phys. 134, 1997, 169.
"""

from __future__ import annotations

from ..base import Array
from ..base.compiled import compiled
from .error_bound import potential_drop
from .problem import DarcyFlow

#: Fraction of the flow through a cell below which its core counts as closed. Rounding errors leave about 1e-16 of the
#: flow in a dead end.
_LEAST_SHARE = 1e-9


@compiled()
def _core_flux(along, φ, ψ, first, end):
    """Compute the fraction of the mean flux that flows in the columns from `first` to `end` − 1.

    The mean flux is the sum of flux times length over all links. Links to the inlet or the outlet are half as long as
    the others.
    """
    core, total = 0.0, 0.0
    for i in range(along.shape[0]):
        length = 0.5 if i == 0 or i == along.shape[0] - 1 else 1.0
        for j in range(along.shape[1]):
            if along[i, j] > 0.0:
                flux = along[i, j] * potential_drop(φ, ψ, i, j, i + 1, j)
                total += flux * length
                if first <= j < end:
                    core += flux * length
    return core / total


def core_ratio(along: Array, flow: DarcyFlow, core: tuple[int, int]) -> float:
    """Compute the ratio of the mean flux in the core to the mean flux in the whole cell; exactly 0 for a closed core.

    Parameters
    ----------
    along : array (n1 + 1, n2), conductances of the links along the flow, see `Stencil`.
    flow : flow through the whole cell.
    core : columns of the core as a half-open range (first, last + 1).
    """
    first, end = core
    share = _core_flux(along, flow.potential, flow.complement, first, end)
    if not share > _LEAST_SHARE:
        return 0.0
    columns = along.shape[1]
    return float(share * columns / (end - first))
