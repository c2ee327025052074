"""Compute where in a cell the flow dissipates its energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..base import Array, Pair
from .cell import cell_stencil
from .problem import validated_cell


def pixel_dissipation(
    gap: Array, spacing: Pair, potential: NDArray[np.floating], *, seam: bool = True
) -> Array:
    """Compute the dissipation in each pixel for a flow along x1 through a cell with periodic sides.

    Half of the dissipation in a link between two pixels is assigned to each of the two pixels. A link to the inlet or
    the outlet has only one pixel, and its whole dissipation is assigned to this pixel.

    Parameters
    ----------
    gap : array (n1, n2), gap [m].
    spacing : lengths (Δ1, Δ2) of a pixel [m].
    potential : array (n1, n2), potential at the pixels for a potential of 1 at the inlet and 0 at the outlet; NaN at
        pixels without flow.
    seam : whether fluid flows through the links from the last column to the first column.

    Returns
    -------
    Array (n1, n2), dissipation in each pixel for a unit potential drop, in the unit of the conductance (m³). If
    `potential` is the fluid pressure that `cell_permeability` returns, the sum of the array is the conductance k L2/L1.

    Raises
    ------
    InputError : the gap is negative, undefined or not two-dimensional.
    """
    h, spacing = validated_cell(gap, spacing, 0, "periodic")
    n2 = h.shape[1]
    stencil = cell_stencil(h, spacing, "periodic")
    with_ends = np.concatenate([np.ones((1, n2)), potential, np.zeros((1, n2))])
    along, across = stencil.dissipation(with_ends)
    if not seam:
        across[:, -1] = 0.0
    # links to the inlet and the outlet have one pixel only: doubled here, because the next line halves them
    along[[0, -1]] *= 2
    return (along[:-1] + along[1:] + across + np.roll(across, 1, axis=1)) / 2
