"""Store the results of a run, and select, tabulate, plot and export them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import femseal  # packages of femseal that import this module are loaded only when a method uses them

from ..base import (
    AnyPath,
    Array,
    Flags,
    Indices,
    InputError,
    Plotted,
    Shape,
    TextTable,
    to_si,
    to_text,
)
from ..base.leak_rates import LeakBasis
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit, leakage_unit
from ..budget import ErrorBudget
from ..loads import LoadProgramme
from ..studies import FaceResult, Scene, StochasticResult, Study, StudyResult
from ..studies.study_list import DETERMINISTIC, STOCHASTIC, TWO_SCALE
from . import best_leakage, load_steps
from .met_classes import tightest_classes
from .run_pictures import RunPictures

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Results(Plotted):
    """Results of a run, from memory or from a results folder.

    Attributes
    ----------
    dataset : xarray.Dataset
        All results, with units and descriptions, see `assemble`.
    folder : Path or None
        Folder from which the results were read, or to which they were saved.
    scene : Scene or None
        Input of the studies; None if the results were read from a folder.
    studies : mapping
        Result of each study, by the key of the study; empty if the results were read from a folder. The result of a
        study also contains the fields that are too large for the dataset.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    studies: Mapping[str, StudyResult] = field(default_factory=dict)

    # --- studies of this process ----------------------------------------------------------------------------------

    @property
    def deterministic(self) -> FaceResult | None:
        """Result of the deterministic study, if it was computed in this process."""
        return self.studies.get(DETERMINISTIC.key)  # type: ignore[return-value]

    @property
    def two_scale(self) -> FaceResult | None:
        """Result of the two-scale study, if it was computed in this process."""
        return self.studies.get(TWO_SCALE.key)  # type: ignore[return-value]

    @property
    def stochastic(self) -> StochasticResult | None:
        """Result of the stochastic study, if it was computed in this process."""
        return self.studies.get(STOCHASTIC.key)  # type: ignore[return-value]

    # --- leakage --------------------------------------------------------------------------------------------------

    @property
    def best_study(self) -> Study:
        """Study that computed `leakage`."""
        return best_leakage.best_study(self.dataset)

    @property
    def method(self) -> str:
        """Name of the method that computed `leakage`, such as "two-scale", or "median" (of realisations)."""
        return self.best_study.label

    @property
    def leakage(self) -> xarray.DataArray:
        """Leakage per unit seal length computed by the best method of the run, (step,) [m²/s]."""
        return best_leakage.best_leakage(self.dataset)

    def leakage_in(self, unit: str) -> xarray.DataArray:
        """Return the leakage at each load step in a given unit, (step,).

        Parameters
        ----------
        unit : str
            Unit, for example "mL/min", "g/year" or "mL/(m·min)", for gases also "mbar·L/s" or "std cm³/s". With a unit
            that is not per unit length, the leakage of the whole seal is returned. The volume of a gas is given at 101
            325 Pa and at the temperature of the gas. Standard units, such as "std cm³/s", refer to 101 325 Pa and 0 °C.
            A throughput (pressure × volume per time) is given at the temperature that the case states, by default at
            the temperature of the gas.

        Raises
        ------
        InputError
            The unit is unknown, or it is for gases and the fluid is a liquid.
        """
        chosen = leak_unit(unit)
        values = self.leakage / self.leak_basis.factor(chosen)
        return values.assign_attrs(units=chosen.name, long_name=self.leakage.attrs["long_name"])

    @property
    def leak_basis(self) -> LeakBasis:
        """Seal length and fluid properties that are needed to convert a leakage to another unit."""
        return best_leakage.leak_basis_of(self.dataset)

    @property
    def leak_unit(self) -> LeakUnit:
        """Unit in which tables and pictures show the leakage.

        Tables and pictures use the unit of the case, if this unit suits the fluid. If the case gives no suitable unit,
        a unit of leakage per unit seal length is chosen so that the numbers are easy to read.
        """
        asked = self.asked_unit
        if asked is not None and self.leak_basis.has(asked):
            return asked
        return LEAK_UNITS[leakage_unit(self.leakage.values)[1]]

    @property
    def asked_unit(self) -> LeakUnit | None:
        """Leakage unit that is given in the case, None if the case gives no unit.

        The unit of the case may suit only the service fluid or only the test fluid, because units for gases do not suit
        liquids.
        """
        return LEAK_UNITS.get(self.dataset.attrs.get("leakage_unit", ""))

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """The unit `leak_unit`, and the leakage per unit seal length [m²/s] that corresponds to 1 in this unit."""
        return self.leak_unit, self.leak_basis.factor(self.leak_unit)

    @property
    def budgets(self) -> dict[str, ErrorBudget]:
        """Error budgets by the key of their study, such as "two_scale".

        The mapping is empty if the case has output.budget = false.
        """
        return best_leakage.error_budgets(self.dataset)

    @property
    def budget(self) -> ErrorBudget | None:
        """Error budget of `leakage`; None if the case has output.budget = false."""
        return best_leakage.best_budget(self.dataset)

    # --- leakage classes ------------------------------------------------------------------------------------------

    @property
    def class_basis(self) -> LeakBasis:
        """Seal length, and properties of the test fluid or, in a run without one, of the service fluid."""
        return best_leakage.class_basis_of(self.dataset)

    @property
    def class_leakage(self) -> tuple[Array, Array]:
        """Class leakage (step,) and class leakage of each realisation (realisation, step) [m²/s]."""
        leakage = best_leakage.class_leakage_of(self.dataset)
        return leakage, best_leakage.class_leakage_of_realisations(self.dataset)

    @property
    def class_interval(self) -> tuple[Array, Array] | None:
        """Lower and upper ends of the 95 % interval of the class leakage, two arrays (step,) [m²/s].

        The values are NaN where an end of the interval is unknown. The property is None if the run has no error budget.
        """
        return best_leakage.class_interval_of(self.dataset)

    @property
    def has_failed(self) -> Flags:
        """Flag for each step, True if the leakage of the service fluid or the test fluid could not be computed."""
        return best_leakage.failed_steps(self.dataset)

    @property
    def classes(self) -> list[str]:
        """Tightest class of each standard that is met, as a string for each step, see `tightest_classes`."""
        return tightest_classes(self.dataset)

    @property
    def verdicts(self) -> tuple[Any, ...]:
        """Verdicts on the leakage classes of the case, each with the load that the class requires."""
        return tuple(femseal.results.verdicts_of(self))

    @property
    def verdict_lines(self) -> list[str]:
        """Paragraphs of text that state the verdicts, see `verdict_paragraphs`."""
        return list(femseal.results.verdict_lines(self))

    def sealing_indices(
        self,
        classes: Iterable[str] = (),
        *,
        tolerance: float = 0.1,
        nominal_diameter: float | str | None = None,
    ) -> tuple[Any, ...]:
        """Return the exponent n of the sealing index ∫ pⁿ dl, and its required value for each leakage class.

        See `sealing_index.sealing_indices` for the arguments and the returned value.
        """
        return femseal.results.sealing_indices(  # type: ignore[no-any-return]
            self, classes, tolerance=tolerance, nominal_diameter=nominal_diameter
        )

    # --- load steps -----------------------------------------------------------------------------------------------

    @property
    def steps(self) -> LoadProgramme:
        """Load programme of the run."""
        return load_steps.load_programme(self.dataset)

    @property
    def peak(self) -> int:
        """Index of the first load step with the highest nominal pressure."""
        return int(np.argmax(self.dataset["nominal_pressure"].values))

    @property
    def open_steps(self) -> list[int]:
        """Indices of the steps where the surfaces are separated, because the fluid carries the whole load."""
        return best_leakage.open_steps(self.dataset)

    def loading(self) -> xarray.Dataset:
        """Return the variables of the load steps on loading, with the nominal pressure [Pa] as their dimension."""
        _, steps = load_steps.branches_in(self.dataset)[0]
        return self._over_pressure(steps)

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """Return the variables of the load steps on unloading, with the nominal pressure [Pa] as their dimension.

        The first value of each variable belongs to the step on loading from which the seal is unloaded.

        Parameters
        ----------
        from_ : float or str, optional
            Highest load before unloading, in Pa or as text such as "900 MPa"; by default the highest load of the cycle
            from which the seal is unloaded.

        Raises
        ------
        InputError
            The load cycle has no unloading from the given load.
        """
        pressure = self.dataset["nominal_pressure"].values
        _loading, *unloadings = load_steps.branches_in(self.dataset)
        steps_by_peak = {pressure[steps[0]]: steps for _, steps in unloadings}
        if not steps_by_peak:
            raise InputError("from_", from_, "no value, because the cycle has no unloading")
        chosen_peak = max(steps_by_peak)
        if from_ is not None:
            chosen_peak = to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
        for peak, steps in steps_by_peak.items():
            if np.isclose(peak, chosen_peak, rtol=1e-9, atol=0):
                return self._over_pressure(steps)
        peaks = ", ".join(to_text(peak, "Pa") for peak in sorted(steps_by_peak))
        raise InputError("from_", from_, f"one of {peaks}")

    def _over_pressure(self, steps: Indices) -> xarray.Dataset:
        """Return the variables at some load steps, with the nominal pressure as their dimension."""
        data = self.dataset
        names = [name for name in data.data_vars if "step" in data[name].dims]
        return data[names].isel(step=steps).swap_dims(step="nominal_pressure")

    # --- facts of the run -----------------------------------------------------------------------------------------

    @property
    def case(self) -> dict[str, Any]:
        """Case of the run in SI units, with lists in place of tuples."""
        return self._json("case")

    @property
    def warnings(self) -> list[str]:
        """Warnings, each of which gives a reason why the results may be wrong."""
        return self._json("warnings")

    @property
    def failures(self) -> list[str]:
        """Descriptions of failed computations, whose results are NaN or missing."""
        return self._json("failures")

    @property
    def left_out(self) -> list[str]:
        """Files that were not written to the folder, with the reason for each."""
        return self._json("left_out", "[]")

    @property
    def attempts(self) -> dict[str, Any] | None:
        """Attempts to reach the requested accuracy, and their outcome; None if the case requests no accuracy."""
        return self._json("accuracy", "null")

    def _json(self, attribute: str, default: str = "") -> Any:
        """Parse an attribute of the dataset that stores JSON."""
        return json.loads(self.dataset.attrs.get(attribute, default))

    # --- cells and pixels -----------------------------------------------------------------------------------------

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Return the variables of one cell of the face.

        The variables of a two-scale study have a value for every load step. The variables of a stochastic study have a
        value for every contact state.

        Parameters
        ----------
        i, j : int
            Row of the cell along x1, and column of the cell along x2.

        Raises
        ------
        InputError
            There is no such cell, or the results have no cells.
        """
        data = self.dataset
        has_only_states = "cell1" not in data.dims and "state" in data.dims
        prefix = "state_" if has_only_states else ""
        row_dim, column_dim = f"{prefix}cell1", f"{prefix}cell2"
        names = [name for name in data.data_vars if row_dim in data[name].dims]
        row, column = checked_cell(data, i, j, (row_dim, column_dim))
        return data[names].isel({row_dim: row, column_dim: column})

    def piece(self, i: int, j: int) -> xarray.Dataset:
        """Return the variables of a cell of the face (former name of `cell`)."""
        warnings.warn("Results.piece is Results.cell now", DeprecationWarning, stacklevel=2)
        return self.cell(i, j)

    def pixels(self, name: str, step: int, cell: Shape | None = None) -> xarray.DataArray:
        """Return a pixel field (x1, x2) at a load step in SI units, see `pixel_fields.read_pixels`."""
        return femseal.results.read_pixels(self, name, step, cell)

    def gap(self, step: int, cell: Shape | None = None) -> xarray.DataArray:
        """Return the deformed gap (x1, x2) [m] at one step, see `pixels`."""
        return self.pixels("gap", step, cell)

    def contact_pressure(self, step: int, cell: Shape | None = None) -> xarray.DataArray:
        """Return the contact pressure (x1, x2) [Pa] at one step, see `pixels`."""
        return self.pixels("contact_pressure", step, cell)

    def fluid_pressure(self, step: int, cell: Shape | None = None) -> xarray.DataArray:
        """Return the fluid pressure (x1, x2) [Pa] at one step, NaN where nothing flows, see `pixels`."""
        return self.pixels("fluid_pressure", step, cell)

    @property
    def stored_steps(self) -> list[int]:
        """Indices of the steps whose pixel fields are available in memory or in the folder."""
        return femseal.results.stored_steps(self)

    # --- tables, pictures and files -------------------------------------------------------------------------------

    def rows(self) -> list[dict[str, Any]]:
        """Return the results as one dictionary for each load step, in SI units, see `tables.rows`."""
        return femseal.results.rows(self)

    def table(self) -> TextTable:
        """Return the leakage as a table, which `rich.print` can display, see `tables.leakage_table`."""
        return femseal.results.leakage_table(self)

    def attempts_table(self) -> TextTable:
        """Return a table of the attempts to reach the requested accuracy, to be displayed by `rich.print`.

        Raises
        ------
        InputError
            The case requests no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case without `accuracy`", "a case with `accuracy`")
        return femseal.results.attempts_table(self.attempts)

    @property
    def plot(self) -> RunPictures:  # type: ignore[override]
        """Pictures of the run. `plot()` draws the leakage, `plot.cells()` the cells, `plot.seal(step)` the seal."""
        return RunPictures(self)

    def plot_cells(self) -> Any:
        """Plot the permeability of the cells against their mean gap and their contact pressure, see `cells_figure`."""
        return self.plot.cells()

    def plot_pieces(self) -> Any:
        """Plot the permeability of the cells (former name of `plot_cells`)."""
        warnings.warn("plot_pieces is plot_cells now", DeprecationWarning, stacklevel=2)
        return self.plot_cells()

    def plot_seal(self, step: int | None = None) -> Any:
        """Plot contact pressure, gap and fluid pressure over the seal at one step, see `seal_figure`."""
        return self.plot.seal(step)

    def report(self, path: AnyPath | None = None) -> Path:
        """Write the report, by default as `report.html` in the folder of the results, see `write_report`."""
        return femseal.report.write_report(self, path)

    def export(self, path: AnyPath, **options: Any) -> list[Path]:
        """Write a pixel field to files that other programs can read, see `pixel_fields.export_field`."""
        return femseal.results.export_field(self, path, **options)

    def __repr__(self) -> str:
        return femseal.results.summary_text(self)

    def _repr_html_(self) -> str:
        return femseal.results.summary_html(self)


def checked_cell(
    data: xarray.Dataset, i: int, j: int, dims: tuple[str, str] = ("cell1", "cell2")
) -> Shape:
    """Return the row and column of a cell as integers, after a check that the cell exists.

    Parameters
    ----------
    data : xarray.Dataset
        Dataset of a run.
    i, j : int
        Row and column of the cell.
    dims : pair of str
        Dimensions of the rows and columns of cells in the dataset.

    Raises
    ------
    InputError
        There is no such cell, or the dataset has no cells.
    """
    if dims[0] not in data.dims:
        raise InputError("cell", (i, j), "no cell, because the results have no cells")
    rows, columns = (data.sizes[dim] for dim in dims)
    if i not in range(rows) or j not in range(columns):
        expected = f"0 to {rows - 1} along x1 and 0 to {columns - 1} along x2"
        raise InputError("cell", (i, j), expected)
    return int(i), int(j)
