"""Where the pressure drops in a face whose flow is resolved: the dissipation in its windows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import validate
from ..flow.cell import cell_permeability, link_conductances
from ..seal.links import link_dissipation
from .partition import Partition

Array = NDArray[np.float64]


def window_dissipation(gap: Any, partition: Partition) -> Array:
    """Dissipation (m1, m2) [m³] of the flow through a whole face for a unit drop, in the windows of its x1-links.

    These tile the face. The sum is the conductance k L2/L1, with k of `cell_permeability` on periodic sides: each link
    between two pixels gives half to both, the half links at inlet and outlet all to their pixel.

    Parameters
    ----------
    gap : (n1, n2) [m].
    partition : of the face.

    Raises
    ------
    InputError : a gap that is negative, undefined or of another shape.
    NotConverged : the linear solver failed.
    """
    h = validate.field("gap", gap, unit="m", shape=partition.shape)
    flow = cell_permeability(h, partition.spacing, sides="periodic")
    c1, c2 = link_conductances(h, partition.spacing, "periodic")
    ends = np.ones((1, h.shape[1])), np.zeros((1, h.shape[1]))
    along, across = link_dissipation(c1, c2, np.concatenate([ends[0], flow.fluid_pressure, ends[1]]))
    along[[0, -1]] *= 2  # halved below
    pixels = (along[:-1] + along[1:] + across + np.roll(across, 1, axis=1)) / 2
    rows = np.add.reduceat(pixels, partition.lines[:-1], axis=0)
    return rows.reshape(*partition.cells, partition.window[1]).sum(axis=2)
