"""Dissipation in the windows of a face whose flow is resolved, which shows where the pressure drops."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base import validate
from ..flow.cell import pixel_dissipation
from .partition import Partition

Array = NDArray[np.float64]


def window_dissipation(gap: Any, partition: Partition) -> Array:
    """Dissipation (m1, m2) [m³] of the flow through a whole face for a unit drop, in the windows of its x1-links.

    These windows tile the face. The sum over them is the conductance k L2/L1, with k of `cell_permeability` on periodic
    sides.

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
    pixels = pixel_dissipation(h, partition.spacing)
    rows = np.add.reduceat(pixels, partition.lines[:-1], axis=0)
    return rows.reshape(*partition.cells, partition.window[1]).sum(axis=2)
