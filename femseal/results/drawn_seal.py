"""Fields of the drawn seal whose leakage is nearest to the median: in the dataset, and as a mesh for ParaView."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .variables import add_fields
from .views import Cells, LoadSteps

if TYPE_CHECKING:
    import xarray

    from ..studies.median_seal import MedianSeal

#: Places nearer to each other than this share of the seal are one point of the mesh.
_ONE_POINT = 1e-9


def add_drawn(data: xarray.Dataset, seal: MedianSeal) -> None:
    """Add the corners of the parts of the seal, and at every step their permeability, pressures and flux."""
    labels = {"units": "m", "long_name": "corners of the parts of the drawn seal, in its plane"}
    data["drawn_corners"] = (("part", "corner", "plane"), seal.outlines, labels | {"realisation": seal.realisation})
    add_fields(data, seal, "drawn_")


def drawn_cells(data: xarray.Dataset) -> Cells:
    """The seal as triangles or quadrilaterals."""
    corners = data["drawn_corners"].values
    points, cells = _joined(corners)
    fields = {
        "permeability_m3": data["drawn_permeability"].values,
        "fluid_pressure_Pa": data["drawn_fluid_pressure"].values,
        "flux_m2_per_s": np.pad(data["drawn_flux"].values, ((0, 0), (0, 0), (0, 1))),
    }
    if "drawn_window_pressure" in data:
        fields["nominal_contact_pressure_MPa"] = data["drawn_window_pressure"].values / 1e6
    return Cells("drawn", points, cells, LoadSteps.of(data), {}, fields)


def _joined(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (n, 3) and the points of each part, from the corners of the parts, many of which are the same."""
    flat = corners.reshape(-1, 2)
    size = np.ptp(flat, axis=0).max() or 1.0
    _, first, number = np.unique(np.rint(flat / (_ONE_POINT * size)), axis=0, return_index=True, return_inverse=True)
    points = np.column_stack([flat[first], np.zeros(first.size)])
    return points, number.reshape(corners.shape[:2])
