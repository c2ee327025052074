"""Results of a case: what a run has found, with selections, tables, pictures, fields and files."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..base.errors import InputError
from ..base.text import Plotted, room
from ..base.text_table import TextTable
from . import attempts_table, pixel_fields, seal_lengths, selections, summary, tables
from .export import export_field
from .run_data import RunData

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Results(RunData, Plotted):
    """Results of a case, see `RunData`; `dataset` holds every number with its unit."""

    def loading(self) -> xarray.Dataset:
        """Leakage and all other variables over the steps, on loading, over `nominal_pressure` [Pa]."""
        return selections.loading(self.dataset)

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """The same on unloading, beginning with the peak.

        Parameters
        ----------
        from_ : the peak, in Pa or as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError : no unloading from there.
        """
        return selections.unloading(self.dataset, from_)

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the window (i, j) over the steps: permeability, flux, pressure, mean gap, fraction in contact.

        Raises
        ------
        InputError : no such window, or results without a two-scale study.
        """
        return selections.cell(self.dataset, i, j)

    def library_cell(self, number: int) -> xarray.Dataset:
        """Curves of a cell of the library over the library's own steps.

        Raises
        ------
        InputError : no such cell, or results without a stochastic study.
        """
        return selections.library_cell(self.dataset, number)

    def pixels(self, name: str, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """A field over the pixels (x1, x2) at one step in SI, read from the folder where it is not in memory.

        Of the two-scale study where there is one, else of the deterministic.

        Parameters
        ----------
        name : "gap", "contact_pressure", "fluid_pressure", or another that a study has at the pixels.
        step : index of the load step.
        cell : window, between its rows of nodes; the whole face unless given.

        Raises
        ------
        InputError : no such step or window, or a step without the field: `stored_steps` lists those that have fields.
        """
        return pixel_fields.read_pixels(self, name, step, cell)

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

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        field: str = "gap",
        step: int | None = None,
        cell: tuple[int, int] | None = None,
        window: tuple[float, float, float, float] | None = None,
    ) -> list[Path]:
        """Write the gap, the contact or the fluid pressure over the pixels of the face in SI, in the suffix's format.

        An .npz has the arrays `gap` (n1, n2) [m], or a pressure by the name of its field [Pa], `spacing` [m], `origin`
        [m] of its first corner, `step`, `name` and `nominal_pressure` [Pa]; `read_topography` and NumPy read it. A .tif
        is a GeoTIFF in single precision, x1 to the right and x2 up, in a plane of metres without a place on earth. An
        .x3p holds the gap only, in metres; its x is x1. A .vti is for ParaView, as means over blocks from 2048 pixels a
        side on; a `window` has all its pixels.

        Parameters
        ----------
        path : the file; the number of the step is put before the suffix where there are several.
        field : "gap", "contact_pressure", or "fluid_pressure" of a resolved flow, NaN where none flows.
        step : index of the load step; None is all that are stored.
        cell : window of the study, between its rows of nodes; the whole face unless given.
        window : instead, x1 from and to, x2 from and to [m]: the pixels whose centres lie between.

        Returns
        -------
        Paths of the files.

        Raises
        ------
        InputError : another field or format, no such step or window, results without fields, or a file that cannot
            be written.
        """
        return export_field(self, path, field=field, step=step, cell=cell, window=window)

    def rows(self) -> list[dict[str, Any]]:
        """The table as dictionaries in SI, one for each step; the keys carry the units."""
        return tables.rows(self)

    def table(self) -> TextTable:
        """The table for people, to be given to `rich.print`."""
        return tables.leakage_table(self)

    def lengths_table(self) -> TextTable:
        """Median and band by length of seal at a few loads, to be given to `rich.print`.

        Raises
        ------
        InputError : seals of one length only.
        """
        return seal_lengths.lengths_table(self)

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
