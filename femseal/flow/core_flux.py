"""Compute the flux in the core of a cell, that is, without its overlaps into neighbouring cells.

A cell is solved together with its overlaps (oversampling), so that fluid can leave the core through the sides and come
back. Only the flux inside the core counts for the permeability. For a uniform gap and for parallel grooves, overlaps do
not change the permeability.
Source: Hou & Wu, J. Comput. Phys. 134, 1997, 169.
"""

from __future__ import annotations

from ..base import Array
from ..base.compiled import compiled
from .error_bound import potential_drop
from .problem import DarcyFlow

#: Share of the flow below which the core of a cell counts as closed. In dead ends, rounding errors leave a flow of
#: about 1e-16 of the flow through the cell.
_LEAST_SHARE = 1e-9


@compiled()
def _core_flux(along, φ, ψ, first, end):
    """Compute the fraction of the mean flux through a cell that passes through the columns `first` to `end` − 1.

    The mean flux is proportional to Σ q l, the sum of flux q times length l over all links along the flow. Links to the
    inlet or the outlet are half as long as links between two pixels.
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
    """Compute the ratio of the mean flux in the core to the mean flux in the whole cell.

    If nothing flows through the core, the ratio is exactly 0.

    Parameters
    ----------
    along : array (n1 + 1, n2), conductances of the links along the flow, see `Stencil`.
    flow : flow through the whole cell.
    core : range (first, last + 1) of the columns of the core.
    """
    first, end = core
    share = _core_flux(along, flow.potential, flow.complement, first, end)
    if not share > _LEAST_SHARE:
        return 0.0
    columns = along.shape[1]
    return float(share * columns / (end - first))
