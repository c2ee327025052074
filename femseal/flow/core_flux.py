"""Flux in the core of a cell whose flow was solved with overlaps into its neighbours (oversampling).

Channels that leave the core through its sides and come back are kept in the solution, and only their flux in the core
counts. In a uniform gap and in parallel grooves the permeability is that of the core alone.
Source: Hou & Wu, J. Comput. Phys. 134, 1997, 169.
"""

from __future__ import annotations

from ..base import Array
from ..base.compiled import compiled
from .error_bound import potential_drop
from .problem import DarcyFlow

#: Part of the flow through a cell below which its core counts as closed: in a dead end rounding leaves about 1e-16.
_LEAST_SHARE = 1e-9


@compiled()
def _core_flux(along, φ, ψ, first, end):
    """Return the part of the mean flux that passes the columns from `first` to the one before `end`.

    The mean flux is the sum over all links of their flux times their length; links to an end are half as long.
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
    """Return the mean flux in the core of a cell over that in the whole cell; exactly 0 where nothing flows in it."""
    first, end = core
    share = _core_flux(along, flow.potential, flow.complement, first, end)
    columns = along.shape[1]
    return float(share * columns / (end - first)) if share > _LEAST_SHARE else 0.0
