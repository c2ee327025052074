"""Views of results as VTK's data, before they are written in a format.

The seal is a mesh of quadrilaterals, two to a window, so that both the nodes of the flow and the corners of the windows
are points of it. Coordinates are x = x1, y = x2 in metres. Names of arrays carry the units and have no brackets. There
are no arrays of texts, because meshio cannot read them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..flow import cell_permeability
from ..flow.solution import FIELD_RTOL
from ..topography import Topography

if TYPE_CHECKING:
    import xarray

    from .results import Results

Array = NDArray[np.float64]
Field = Callable[[int], NDArray[Any]]
#: Unit in the dataset, ending of the name of an array in ParaView, and factor.
_UNITS = {"m": ("_um", 1e6), "Pa": ("_MPa", 1e-6), "m^3": ("_m3", 1.0), "m^2/s": ("_m2_per_s", 1.0), "1": ("", 1.0)}
#: Names of window variables in ParaView, distinct from those of the fields over all pixels.
_NAMES = {
    "window_pressure": "nominal_contact_pressure",
    "window_mean_gap": "mean_gap",
    "window_contact_fraction": "contact_share",
    "window_plastic_fraction": "plastic_share",
}


@dataclass(frozen=True)
class LoadSteps:
    """The steps that a view has, by their index in the load programme, and their loads [Pa]."""

    index: NDArray[np.int64]
    nominal_pressure: Array
    unloaded_from: Array

    @classmethod
    def of(cls, data: xarray.Dataset, index: NDArray[np.int64] | None = None) -> LoadSteps:
        """Steps of a dataset; all of them unless `index` says which."""
        chosen = np.arange(data.sizes["step"]) if index is None else index
        return cls(*(data[name].values[chosen] for name in ("step", "nominal_pressure", "unloaded_from")))

    @property
    def fields(self) -> dict[str, Array]:
        """Field data, one value for each step; on loading the peak is NaN."""
        return {
            "nominal_pressure_MPa": self.nominal_pressure / 1e6,
            "unloaded_from_MPa": self.unloaded_from / 1e6,
        }


class View(Protocol):
    """Data written under one name: a pyvista data set for each step, or a single one without steps."""

    @property
    def name(self) -> str:
        """Of the file, without its ending."""
        ...

    @property
    def steps(self) -> LoadSteps | None:
        """The steps, or None."""
        ...

    def at(self, n: int) -> Any:
        """The data set at the n-th step."""
        ...


@dataclass(frozen=True)
class Image:
    """Pixels of a plane at some steps: `cells` gives for the n-th of these a field (n1, n2), in single precision."""

    name: str
    spacing: tuple[float, float]
    origin: tuple[float, float]
    shape: tuple[int, int]
    steps: LoadSteps
    cells: Mapping[str, Field]

    def at(self, n: int) -> Any:
        """Image data whose cells are the pixels; x1 runs fastest in VTK, that is order F of an array (n1, n2)."""
        import pyvista

        (n1, n2), (d1, d2), origin = self.shape, self.spacing, (*self.origin, 0.0)
        image = pyvista.ImageData(dimensions=(n1 + 1, n2 + 1, 1), spacing=(d1, d2, 1.0), origin=origin)
        for name, field in self.cells.items():
            image.cell_data[name] = np.asarray(field(n), np.float32).ravel(order="F")
        return _with_loads(image, self.steps, n)


@dataclass(frozen=True)
class Cells:
    """Triangles or quadrilaterals at all steps: `point_data` (steps, points), `cell_data` (steps, cells[, 3])."""

    name: str
    points: Array
    cells: NDArray[np.int64]
    steps: LoadSteps
    point_data: Mapping[str, NDArray[Any]]
    cell_data: Mapping[str, NDArray[Any]]

    @cached_property
    def _mesh(self) -> Any:
        import meshio
        import pyvista

        kind = {3: "triangle", 4: "quad"}[self.cells.shape[1]]
        return pyvista.from_meshio(meshio.Mesh(self.points, [(kind, self.cells)]))

    def at(self, n: int) -> Any:
        """The mesh, which all steps share, with its data."""
        mesh = self._mesh.copy(deep=False)
        for name, values in self.point_data.items():
            mesh.point_data[name] = values[n]
        for name, values in self.cell_data.items():
            mesh.cell_data[name] = values[n]
        return _with_loads(mesh, self.steps, n)


@dataclass(frozen=True)
class Heights:
    """Heights of the face as points, so that the map can be warped at once."""

    surface: Topography
    name: str = "surface"
    steps: None = None

    def at(self, n: int = 0) -> Any:
        """Image data with `height_um`."""
        import pyvista

        (n1, n2), (d1, d2) = self.surface.shape, self.surface.spacing
        image = pyvista.ImageData(dimensions=(n1, n2, 1), spacing=(d1, d2, 1.0), origin=(d1 / 2, d2 / 2, 0.0))
        image.point_data["height_um"] = (self.surface.heights * 1e6).astype(np.float32).ravel(order="F")
        return image


def _with_loads(mesh: Any, steps: LoadSteps, n: int) -> Any:
    for name, values in steps.fields.items():
        mesh.field_data[name] = values[n : n + 1]
    return mesh


def seal_grid(data: xarray.Dataset) -> Cells:
    """Windows of the whole seal: contact, permeability, fluid pressure and flow."""
    count, m2 = data.sizes["step"], data.sizes["cell2"]
    x, y = np.meshgrid(data["node1"].values, np.arange(2 * m2 + 1) * float(data["cell2"][0]), indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1)
    point_data: dict[str, NDArray[Any]] = {
        "fluid_pressure_Pa": at_points(data["fluid_pressure"].values).reshape(count, -1)
    }
    if "k2" in data:
        k2 = np.pad(data["k2"].values, ((0, 0), (1, 1), (0, 0)), constant_values=np.nan)
        # the link from column j to j + 1 lies at their common corner, half a window beyond the node
        at_corners = np.roll(at_points(k2)[..., :-1], 1, axis=-1)
        point_data["k2_m3"] = np.concatenate([at_corners, at_corners[..., :1]], axis=-1).reshape(count, -1)
    cell_data: dict[str, NDArray[Any]] = {}
    for key, variable in data.data_vars.items():
        # the flux is one vector
        if variable.dims == ("step", "cell1", "cell2") and key != "flux1":
            ending, factor = _UNITS[variable.attrs["units"]]
            values = np.repeat(variable.values * factor, 2, axis=2)
            cell_data[_NAMES.get(str(key), str(key)) + ending] = values.reshape(count, -1)
    cell_data["flux_m2_per_s"] = _flux(data).reshape(count, -1, 3)
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Cells("seal", points, quads.reshape(-1, 4), LoadSteps.of(data), point_data, cell_data)


def at_points(nodes: Array) -> Array:
    """Values (…, rows, m2) at nodes, mid-windows, onto the points (…, rows, 2 m2 + 1); between nodes their mean."""
    points = np.empty((*nodes.shape[:-1], 2 * nodes.shape[-1] + 1))
    points[..., 1::2] = nodes
    points[..., 2::2] = (nodes + np.roll(nodes, -1, axis=-1)) / 2
    points[..., 0] = points[..., -1]
    return points


def _flux(data: xarray.Dataset) -> Array:
    """Flux (steps, m1, 2 m2, 3) of half windows: of their x1-link, and the mean of the x2-links at their corners."""
    flux = np.zeros((data.sizes["step"], data.sizes["cell1"], 2 * data.sizes["cell2"], 3))
    flux[..., 0] = np.repeat(data["flux1"].values, 2, axis=-1)
    if "flux2" in data:
        links = np.pad(data["flux2"].values, ((0, 0), (1, 1), (0, 0)))
        rows = (links[:, :-1] + links[:, 1:]) / 2
        flux[..., 1::2, 1] = rows
        flux[..., 0::2, 1] = np.roll(rows, 1, axis=-1)
    return flux


def window_images(results: Results) -> list[Image]:
    """Gap, contact pressure and fluid pressure in the chosen windows, if the fields of the study are in memory."""
    if results.two_scale is None or results.two_scale.k1 is None:
        return []
    return [_window(results, i, j) for i, j in chosen_windows(results.dataset)]


def chosen_windows(data: xarray.Dataset) -> list[tuple[int, int]]:
    """Windows with the largest, median and smallest k1 > 0 at the highest load at which any window is open."""
    k1, pressure = data["k1"].values, data["nominal_pressure"].values
    open_ = (np.nan_to_num(k1) > 0).any(axis=(1, 2))
    if not open_.any():
        return [(k1.shape[1] // 2, k1.shape[2] // 2)]
    step = int(np.argmax(np.where(open_, pressure, -1.0)))
    k = np.nan_to_num(k1[step]).ravel()
    order = np.flatnonzero(k > 0)[np.argsort(k[k > 0])]
    pick = dict.fromkeys(int(order[n]) for n in (-1, order.size // 2, 0))
    return [(n // k1.shape[2], n % k1.shape[2]) for n in pick]


def _window(results: Results, i: int, j: int) -> Image:
    """The window of the x1-link (i, j), from one row of nodes to the next."""
    study, scene = results.two_scale, results.scene
    assert study is not None
    assert study.fluid_pressure is not None
    assert scene is not None
    partition = study.partition
    (d1, d2), first = partition.spacing, partition.rows(0)[i][0]
    gaps, pressures = (partition.link(values, i, j, 0) for values in (study.gap, study.contact_pressure))
    ends = scene.fluid.potential(study.fluid_pressure[:, i : i + 2, j])

    def fluid_pressure(s: int) -> Array:
        # a window that failed has no gap
        if not np.all(np.isfinite(gaps[s])):
            return np.full(gaps[s].shape, np.nan)
        share = cell_permeability(gaps[s], partition.spacing, field_rtol=FIELD_RTOL).fluid_pressure
        # the pressure of an end in a pocket is undefined and has no effect on the fluid at the other end
        mixed = np.where(share == 1, ends[s, 0], ends[s, 1] + (ends[s, 0] - ends[s, 1]) * share)
        return scene.fluid.pressure(np.where(share == 0, ends[s, 1], mixed))

    fields: dict[str, Field] = {
        "gap_um": lambda s: gaps[s] * np.float32(1e6),
        "contact_pressure_MPa": lambda s: pressures[s] * np.float32(1e-6),
        "fluid_pressure_Pa": fluid_pressure,
    }
    origin = first * d1, j * partition.window[1] * d2
    name = f"window_{i:03d}_{j:03d}"
    return Image(name, partition.spacing, origin, gaps.shape[1:], LoadSteps.of(results.dataset), fields)
