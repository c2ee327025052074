"""Results of a case: one labelled dataset, with selections, tables, pictures and fields."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.errors import InputError
from ..base.leak_units import LEAK_UNITS, LeakBasis, LeakUnit, leak_unit, leakage_unit
from ..base.text import Plotted, room
from ..loads import LoadProgramme, LoadStep
from . import error_bands, reached_classes, seal_lengths, select, summary, tables, wanted_accuracy
from . import fields as stitched
from .export import export_field

if TYPE_CHECKING:
    import xarray
    from rich.table import Table

    from ..budget import ErrorBudget
    from ..studies import DeterministicResult, Scene, StochasticResult, TwoScaleResult

#: Methods from the best, each with its leakage in the dataset.
METHODS = (
    ("median", "leakage_median"),
    ("two-scale", "leakage_two_scale"),
    ("deterministic", "leakage_deterministic"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Results(Plotted):
    """Results of a case.

    dataset : every number with its unit, see `assemble`. folder : from which it was read, or to which it was saved.
    scene : the input of the studies; deterministic, two_scale, stochastic : the results of the studies with the fields
        that are
    too large for the dataset. None if not run, or read from a folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    deterministic: DeterministicResult | None = None
    two_scale: TwoScaleResult | None = None
    stochastic: StochasticResult | None = None

    @property
    def method(self) -> str:
        """Source of `leakage`: "median" (of realisations), "two-scale" or "deterministic"."""
        return next(method for method, name in METHODS if name in self.dataset)

    @property
    def leakage(self) -> xarray.DataArray:
        """Best available leakage per length of seal (step,) [m²/s]: median, else two-scale, else deterministic."""
        return self.dataset[dict(METHODS)[self.method]]

    @property
    def leak_basis(self) -> LeakBasis:
        """Length of the seal and reference state of the fluid, which turn the leakage into any unit."""
        return reached_classes.basis_of(self.dataset.attrs)

    @property
    def judged_basis(self) -> LeakBasis:
        """The same of the fluid by which leakage classes are judged: the test fluid where there is one."""
        return reached_classes.basis_of(self.dataset.attrs, "test_" if "test_leakage" in self.dataset else "")

    @property
    def classes(self) -> list[str]:
        """The tightest leakage class that is reached at each step, of each standard asked for; "–" where none is."""
        return reached_classes.tightest(self) if "leak_class" in self.dataset.coords else []

    @property
    def leak_unit(self) -> LeakUnit:
        """The unit in which leakage is told: that of the case, else a readable one per length of seal."""
        return (
            LEAK_UNITS.get(self.dataset.attrs.get("leakage_unit", ""))
            or LEAK_UNITS[leakage_unit(self.leakage.values)[1]]
        )

    def leakage_in(self, unit: str) -> xarray.DataArray:
        """`leakage` (step,) in a unit such as "mL/min", "g/year", "mL/(m·min)"; of gases also "mbar·L/s", "std cm³/s".

        Units that are not per length are of the whole seal. Volumes of gases are at 101 325 Pa and their temperature,
        standard ones at 0 °C; pressure × volume is at the temperature stated in the case, else at that of the gas.

        Raises
        ------
        InputError : no such unit, or a unit of gases for a liquid.
        """
        chosen = leak_unit(unit)
        values = self.leakage / self.leak_basis.factor(chosen)
        return values.assign_attrs(units=chosen.name, long_name=self.leakage.attrs["long_name"])

    @property
    def budgets(self) -> dict[str, ErrorBudget]:
        """Error budgets by method: "deterministic", "two_scale", "stochastic"; empty where none was asked for."""
        return error_bands.budgets_in(self.dataset, self.steps)

    @property
    def budget(self) -> ErrorBudget | None:
        """Error budget of `leakage`; None where none was asked for."""
        return self.budgets.get(error_bands.BUDGETED[self.method])

    @property
    def steps(self) -> LoadProgramme:
        """The load programme."""
        pairs = zip(self.dataset["nominal_pressure"].values, self.dataset["unloaded_from"].values, strict=True)
        return LoadProgramme(LoadStep(float(p), None if np.isnan(peak) else float(peak)) for p, peak in pairs)

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the numbers, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs["warnings"])

    @property
    def failures(self) -> list[str]:
        """Failures, whose numbers are missing or NaN, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs["failures"])

    @property
    def left_out(self) -> list[str]:
        """Files that were not written to the folder, with the reason, one line each; empty if there are none."""
        return json.loads(self.dataset.attrs.get("left_out", "[]"))

    @property
    def case(self) -> dict[str, Any]:
        """The case in SI, as given to `assemble`; tuples have become lists."""
        return json.loads(self.dataset.attrs["case"])

    @property
    def attempts(self) -> dict[str, Any] | None:
        """The attempts at the accuracy that the case asks for, and whether it is reached; None if it asks for none."""
        return wanted_accuracy.told(self)

    def loading(self) -> xarray.Dataset:
        """Leakage and all other variables over the steps, on loading, over `nominal_pressure` [Pa]."""
        return select.loading(self.dataset)

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """The same on unloading, beginning with the peak.

        Parameters
        ----------
        from_ : the peak, in Pa or as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError : no unloading from there.
        """
        return select.unloading(self.dataset, from_)

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the window (i, j) over the steps: permeability, flux, contact pressure, mean gap, contact share.

        Raises
        ------
        InputError : no such window, or results without a two-scale study.
        """
        return select.cell(self.dataset, i, j)

    def library_cell(self, number: int) -> xarray.Dataset:
        """Curves of a cell of the library over the library's own steps.

        Raises
        ------
        InputError : no such cell, or results without a stochastic study.
        """
        return select.library_cell(self.dataset, number)

    def gap(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Deformed gap (x1, x2) [m] at one step, read from the folder where it is not in memory.

        Of the two-scale study where there is one, else of the deterministic.

        Parameters
        ----------
        step : index of the load step.
        cell : window, between its rows of nodes; the whole face unless given.

        Raises
        ------
        InputError : no such step or window, or a step without fields: `stored_steps` lists those that have them.
        """
        return stitched.read_field(self, "gap", step, cell)

    def contact_pressure(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Contact pressure (x1, x2) [Pa] at one step, see `gap`."""
        return stitched.read_field(self, "contact_pressure", step, cell)

    def fluid_pressure(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Fluid pressure (x1, x2) [Pa] of a resolved flow at one step, NaN where none flows, see `gap`."""
        return stitched.read_field(self, "fluid_pressure", step, cell)

    def export(
        self,
        path: str | os.PathLike[str],
        *,
        field: str = "gap",
        step: int | None = None,
        cell: tuple[int, int] | None = None,
    ) -> list[Path]:
        """Write the gap, the contact or the fluid pressure over the pixels of the face in SI, in the suffix's format.

        An .npz has the arrays `gap` (n1, n2) [m], or a pressure by the name of its field [Pa], `spacing` [m], `origin`
        [m] of its first corner, `step`, `name` and `nominal_pressure` [Pa]; `read_topography` and NumPy read it. A .tif
        is a GeoTIFF in single precision, x1 to the right and x2 up, in a plane of metres without a place on earth. An
        .x3p holds the gap only, in metres; its x is x1.

        Parameters
        ----------
        path : the file; the number of the step is put before the suffix where there are several.
        field : "gap", "contact_pressure", or "fluid_pressure" of a resolved flow, NaN where none flows.
        step : index of the load step; None is all that are stored.
        cell : window, between its rows of nodes; the whole face unless given.

        Returns
        -------
        Paths of the files.

        Raises
        ------
        InputError : another field or format, no such step or window, results without fields, or a file that cannot
            be written.
        """
        return export_field(self, path, field=field, step=step, cell=cell)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose fields over all pixels are in memory or in the folder."""
        return stitched.stored_steps(self)

    def rows(self) -> list[dict[str, Any]]:
        """The table as dictionaries in SI, one for each step; the keys carry the units."""
        return tables.rows(self)

    def table(self) -> Table:
        """The table for a terminal, to be given to `rich.print`."""
        return tables.rich_table(self)

    def lengths_table(self) -> Table:
        """Median and band by length of seal at a few loads, to be given to `rich.print`.

        Raises
        ------
        InputError : seals of one length only.
        """
        return seal_lengths.rich_table(self)

    def attempts_table(self) -> Table:
        """The attempts at the accuracy that the case asks for, to be given to `rich.print`.

        Raises
        ------
        InputError : a case that asks for no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case that asks for no accuracy", "one with the key accuracy")
        return wanted_accuracy.rich_table(self.attempts)

    def plot_lengths(self) -> Any:
        """Leakage against the length of the seal, see `lengths_figure`."""
        return room("plots").lengths_figure(self)

    def plot_cells(self, count: int = 4) -> Any:
        """Permeability of cells along the cycle, see `cells_figure`."""
        return room("plots").cells_figure(self, count)

    def plot_seal(self, step: int | None = None) -> Any:
        """Contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").seal_figure(self, step)

    def report(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the report, `report.html` in the folder unless `path` is given, see `write_report`."""
        return room("report").write_report(self, path)

    def __repr__(self) -> str:
        return summary.text(self)

    def _repr_html_(self) -> str:
        return summary.html(self)
