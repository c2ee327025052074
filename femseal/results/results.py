"""Results of a case: what a run has found, with selections, tables, pictures, fields and files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.quantities import to_si, to_text
from ..base.text import Plotted, TextTable, room
from . import attempts_table, pixel_fields, seal_lengths, summary, tables
from .export import export_field
from .run_data import RunData
from .selections import Steps, branches_in, window

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Results(RunData, Plotted):
    """Results of a case, see `RunData`; `dataset` holds every number with its unit."""

    export = export_field
    pixels = pixel_fields.read_pixels
    rows = tables.rows
    table = tables.leakage_table
    lengths_table = seal_lengths.lengths_table

    def loading(self) -> xarray.Dataset:
        """Leakage and all other variables over the steps, on loading, over `nominal_pressure` [Pa]."""
        return self._over_pressure(branches_in(self.dataset)[0][1])

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """The same on unloading, beginning with the peak.

        Parameters
        ----------
        from_ : the peak, in Pa or as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError : no unloading from there.
        """
        parts = branches_in(self.dataset)[1:]
        if not parts:
            raise InputError("from_", from_, "nothing: the cycle has no unloading")
        peaks = [float(self.dataset["nominal_pressure"][steps[0]]) for _, steps in parts]
        wanted = max(peaks) if from_ is None else to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
        for peak, (_, steps) in zip(peaks, parts, strict=True):
            if np.isclose(peak, wanted, rtol=1e-9, atol=0):
                return self._over_pressure(steps)
        raise InputError("from_", from_, f"one of {', '.join(to_text(p, 'Pa') for p in sorted(peaks))}")

    def _over_pressure(self, steps: Steps) -> xarray.Dataset:
        names = [name for name, variable in self.dataset.data_vars.items() if "step" in variable.dims]
        return self.dataset[names].isel(step=steps).swap_dims(step="nominal_pressure")

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the window (i, j) over the steps: permeability, flux, pressure, mean gap, fraction in contact.

        Raises
        ------
        InputError : no such window, or results without a two-scale study.
        """
        data, (i, j) = self.dataset, window(self.dataset, i, j)
        names = [name for name, variable in data.data_vars.items() if variable.dims == ("step", "cell1", "cell2")]
        return data[names].isel(cell1=i, cell2=j)

    def library_cell(self, number: int) -> xarray.Dataset:
        """Curves of a cell of the library over the library's own steps.

        Raises
        ------
        InputError : no such cell, or results without a stochastic study.
        """
        data = self.dataset
        if "library_k" not in data:
            raise InputError("cell", number, "none: the results have no library, which a stochastic study has")
        if number not in range(data.sizes["library_cell"]):
            raise InputError("cell", number, f"0 to {data.sizes['library_cell'] - 1}")
        names = [name for name, variable in data.data_vars.items() if "library_cell" in variable.dims]
        return data[names].isel(library_cell=number)

    def gap(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Deformed gap (x1, x2) [m] at one step, see `pixels`."""
        return self.pixels("gap", step, cell)

    def contact_pressure(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Contact pressure (x1, x2) [Pa] at one step, see `pixels`."""
        return self.pixels("contact_pressure", step, cell)

    def fluid_pressure(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Fluid pressure (x1, x2) [Pa] of a resolved flow at one step, NaN where none flows, see `pixels`."""
        return self.pixels("fluid_pressure", step, cell)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose fields over all pixels are in memory or in the folder."""
        return pixel_fields.stored_steps(self)

    def attempts_table(self) -> TextTable:
        """The attempts at the accuracy that the case asks for, to be given to `rich.print`.

        Raises
        ------
        InputError : a case that asks for no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case that asks for no accuracy", "one with the key accuracy")
        return attempts_table.attempts_table(self.attempts)

    def plot_lengths(self) -> Any:
        """Leakage against the length of the seal, see `lengths_figure`."""
        return room("plots").shown(room("plots").lengths_figure(self))

    def plot_cells(self, count: int = 4) -> Any:
        """Permeability of cells along the cycle, see `cells_figure`."""
        return room("plots").shown(room("plots").cells_figure(self, count))

    def plot_seal(self, step: int | None = None) -> Any:
        """Contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").shown(room("plots").seal_figure(self, step))

    def report(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the report, `report.html` in the folder unless `path` is given, see `write_report`."""
        return room("report").write_report(self, path)

    def __repr__(self) -> str:
        return summary.summary_text(self)

    def _repr_html_(self) -> str:
        return summary.summary_html(self)
