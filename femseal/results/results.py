"""Results of a run: its dataset, with selections, tables, pictures and files."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

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
from ..base.leak_units import LeakUnit, leak_unit
from ..base.text import room
from ..budget import ErrorBudget
from ..loads import LoadProgramme
from ..studies import FaceResult, Scene, StochasticResult, StudyResult
from . import best_leakage, load_steps
from .leakage_classes import tightest_classes

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class Results(Plotted):
    """Results of a run.

    Attributes
    ----------
    dataset : xarray.Dataset
        Every number with its unit and meaning, see `assemble`.
    folder : Path or None
        From which the results were read, or in which they were saved.
    scene : Scene or None
        Input of the studies; None if the results were read from a folder.
    studies : mapping
        Results of the studies by key, with the fields that are too large for the dataset; empty if the results were
        read from a folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    studies: Mapping[str, StudyResult] = field(default_factory=dict)

    # --- studies of this process ----------------------------------------------------------------------------------

    @property
    def deterministic(self) -> FaceResult | None:
        """Result of the deterministic study, if it was computed in this process."""
        return self.studies.get("deterministic")  # type: ignore[return-value]

    @property
    def two_scale(self) -> FaceResult | None:
        """Result of the two-scale study, if it was computed in this process."""
        return self.studies.get("two_scale")  # type: ignore[return-value]

    @property
    def stochastic(self) -> StochasticResult | None:
        """Result of the stochastic study, if it was computed in this process."""
        return self.studies.get("stochastic")  # type: ignore[return-value]

    # --- leakage --------------------------------------------------------------------------------------------------

    @property
    def method(self) -> str:
        """Method of `leakage`: "median" (of realisations), "two-scale", "blocks" or "deterministic"."""
        return best_leakage.best_method(self.dataset)

    @property
    def leakage(self) -> xarray.DataArray:
        """Leakage per length of seal by the best method (step,) [m²/s]."""
        return best_leakage.best_leakage(self.dataset)

    def leakage_in(self, unit: str) -> xarray.DataArray:
        """Return `leakage` in another unit (step,).

        Parameters
        ----------
        unit : str
            For example "mL/min", "g/year" or "mL/(m·min)"; of gases also "mbar·L/s" or "std cm³/s". Units that are not
            per length are of the whole seal. Volumes of gases are at 101 325 Pa and their temperature, standard ones
            at 0 °C; pressure × volume is at the temperature that the case gives, else at that of the gas.

        Raises
        ------
        InputError
            The unit does not exist, or is for gases only.
        """
        chosen = leak_unit(unit)
        values = self.leakage / self.leak_basis.factor(chosen)
        return values.assign_attrs(units=chosen.name, long_name=self.leakage.attrs["long_name"])

    @property
    def leak_basis(self) -> LeakBasis:
        """Length of the seal and reference state of the fluid, with which leakage is converted to any unit."""
        return best_leakage.leak_basis_of(self.dataset)

    @property
    def leak_unit(self) -> LeakUnit:
        """Unit of leakage in tables and pictures: that of the case, else a readable one per length of seal."""
        return best_leakage.unit_of_leakage(self.dataset)

    @property
    def asked_unit(self) -> LeakUnit | None:
        """Unit of leakage that the case gives, for its fluid, its test fluid, or both."""
        return best_leakage.asked_unit(self.dataset)

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """`leak_unit`, and the leakage per length that is 1 in it [m²/s]."""
        return self.leak_unit, self.leak_basis.factor(self.leak_unit)

    @property
    def budgets(self) -> dict[str, ErrorBudget]:
        """Error budgets by method: "deterministic", "two_scale", "stochastic"; empty with output.budget = false."""
        return best_leakage.error_budgets(self.dataset)

    @property
    def budget(self) -> ErrorBudget | None:
        """Error budget of `leakage`; None with output.budget = false."""
        return best_leakage.best_budget(self.dataset)

    # --- leakage classes ------------------------------------------------------------------------------------------

    @property
    def class_basis(self) -> LeakBasis:
        """`leak_basis` of the fluid that decides on leakage classes: the test fluid if there is one."""
        return best_leakage.class_basis_of(self.dataset)

    @property
    def class_leakage(self) -> tuple[Array, Array]:
        """Leakage that decides on classes [m²/s]: (step,), and of each realisation (realisation, step)."""
        leakage = best_leakage.class_leakage_of(self.dataset)
        return leakage, best_leakage.class_leakage_of_realisations(self.dataset)

    @property
    def class_interval(self) -> tuple[Array, Array] | None:
        """95 % interval of that leakage, both ends (step,) [m²/s], NaN if unknown; None without an error budget."""
        return best_leakage.class_interval_of(self.dataset)

    @property
    def has_failed(self) -> Flags:
        """Whether the leakage of the fluid, or of the test fluid, could not be computed (step,)."""
        return best_leakage.failed_steps(self.dataset)

    @property
    def classes(self) -> list[str]:
        """Tightest class of each standard that is met at each step, see `tightest_classes`; [] without classes."""
        return tightest_classes(self.dataset)

    @property
    def verdicts(self) -> tuple[Any, ...]:
        """Whether, and from which load on, each leakage class of the case is met, see `verdict.Verdict`."""
        return tuple(room("results").verdicts_of(self))

    @property
    def verdict_lines(self) -> list[str]:
        """The verdict in words, one text for each paragraph, see `verdict_text.verdict_paragraphs`."""
        return list(room("results").verdict_lines(self))

    # --- load steps -----------------------------------------------------------------------------------------------

    @property
    def steps(self) -> LoadProgramme:
        """The load programme."""
        return load_steps.load_programme(self.dataset)

    @property
    def peak(self) -> int:
        """The first step of the highest load."""
        return int(np.argmax(self.dataset["nominal_pressure"].values))

    @property
    def open_steps(self) -> list[int]:
        """Steps at which the fluid carries all of the load, so that the seal is open and has no leakage."""
        return best_leakage.open_steps(self.dataset)

    def loading(self) -> xarray.Dataset:
        """Return all variables of load steps on loading, over the nominal pressure [Pa]."""
        _, steps = load_steps.branches_in(self.dataset)[0]
        return self._over_pressure(steps)

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """Return all variables of load steps on the unloading from a peak, which comes first.

        Parameters
        ----------
        from_ : float or str, optional
            The peak, in Pa or for example as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError
            The seal is not unloaded from there.
        """
        pressure = self.dataset["nominal_pressure"].values
        unloadings = {
            pressure[steps[0]]: steps for _, steps in load_steps.branches_in(self.dataset)[1:]
        }
        if not unloadings:
            raise InputError("from_", from_, "nothing: the cycle has no unloading")
        wanted = max(unloadings)
        if from_ is not None:
            wanted = to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
        for peak, steps in unloadings.items():
            if np.isclose(peak, wanted, rtol=1e-9, atol=0):
                return self._over_pressure(steps)
        peaks = ", ".join(to_text(peak, "Pa") for peak in sorted(unloadings))
        raise InputError("from_", from_, f"one of {peaks}")

    def _over_pressure(self, steps: Indices) -> xarray.Dataset:
        """Return all variables of some load steps, over the nominal pressure in place of the number of the step."""
        data = self.dataset
        names = [name for name in data.data_vars if "step" in data[name].dims]
        return data[names].isel(step=steps).swap_dims(step="nominal_pressure")

    # --- what is known of the run ---------------------------------------------------------------------------------

    @property
    def case(self) -> dict[str, Any]:
        """The case in SI, as given to `assemble`; tuples have become lists."""
        return self._json("case")

    @property
    def warnings(self) -> list[str]:
        """Reasons why the numbers may be wrong, one line each."""
        return self._json("warnings")

    @property
    def failures(self) -> list[str]:
        """Computations that failed, whose numbers are NaN or missing, one line each."""
        return self._json("failures")

    @property
    def left_out(self) -> list[str]:
        """Files that were not written to the folder, with the reason, one line each."""
        return self._json("left_out", "[]")

    @property
    def attempts(self) -> dict[str, Any] | None:
        """Attempts at the accuracy that the case asks for, and whether it is reached; None if it asks for none."""
        return self._json("accuracy", "null")

    def _json(self, attribute: str, default: str = "") -> Any:
        return json.loads(self.dataset.attrs.get(attribute, default))

    # --- cells and pixels -----------------------------------------------------------------------------------------

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Return the variables of one cell, over the load steps of a two-scale study, else over the states of the face.

        Parameters
        ----------
        i, j : int
            Row and column of the cell, along x1 and x2.

        Raises
        ------
        InputError
            There is no such cell, or the results have no cells.
        """
        data = self.dataset
        prefix = "state_" if "cell1" not in data.dims and "state" in data.dims else ""
        dims = f"{prefix}cell1", f"{prefix}cell2"
        names = [name for name in data.data_vars if dims[0] in data[name].dims]
        row, column = checked_cell(data, i, j, dims)
        return data[names].isel({dims[0]: row, dims[1]: column})

    def piece(self, i: int, j: int) -> xarray.Dataset:
        """Return the variables of one cell; the former name of `cell`."""
        warnings.warn("Results.piece is Results.cell now", DeprecationWarning, stacklevel=2)
        return self.cell(i, j)

    def pixels(self, name: str, step: int, cell: Shape | None = None) -> xarray.DataArray:
        """Return a field over the pixels (x1, x2) at one step in SI, see `pixel_fields.read_pixels`."""
        return room("results").read_pixels(self, name, step, cell)

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
        """Steps whose fields over the pixels are in memory or in the folder."""
        return room("results").stored_steps(self)

    # --- tables, pictures and files -------------------------------------------------------------------------------

    def rows(self) -> list[dict[str, Any]]:
        """Return the table as dictionaries in SI, one for each step, see `tables.rows`."""
        return room("results").rows(self)

    def table(self) -> TextTable:
        """Return the table for people, to be given to `rich.print`, see `tables.leakage_table`."""
        return room("results").leakage_table(self)

    def attempts_table(self) -> TextTable:
        """Return the attempts at the accuracy that the case asks for, to be given to `rich.print`.

        Raises
        ------
        InputError
            The case asks for no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case that asks for no accuracy", "one with it")
        return room("results").attempts_table(self.attempts)

    def plot_cells(self) -> Any:
        """Plot the permeability of the cells over their mean gap and their pressure, see `cells_figure`."""
        return room("plots").shown(room("plots").cells_figure(self))

    def plot_pieces(self) -> Any:
        """Plot the permeability of the cells; the former name of `plot_cells`."""
        warnings.warn("plot_pieces is plot_cells now", DeprecationWarning, stacklevel=2)
        return self.plot_cells()

    def plot_seal(self, step: int | None = None) -> Any:
        """Plot contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").shown(room("plots").seal_figure(self, step))

    def report(self, path: AnyPath | None = None) -> Path:
        """Write the report, `report.html` in the folder unless `path` is given, see `write_report`."""
        return room("report").write_report(self, path)

    def export(self, path: AnyPath, **options: Any) -> list[Path]:
        """Write a field over the pixels for other programs, see `pixel_fields.export_field`."""
        return room("results").export_field(self, path, **options)

    def __repr__(self) -> str:
        return room("results").summary_text(self)

    def _repr_html_(self) -> str:
        return room("results").summary_html(self)


def checked_cell(
    data: xarray.Dataset, i: int, j: int, dims: tuple[str, str] = ("cell1", "cell2")
) -> Shape:
    """Return the row and column of a cell as integers.

    Raises
    ------
    InputError
        There is no such cell, or the dataset has no cells.
    """
    if dims[0] not in data.dims:
        raise InputError("cell", (i, j), "none: the results have no cells")
    rows, columns = (data.sizes[dim] for dim in dims)
    if i not in range(rows) or j not in range(columns):
        expected = f"0 to {rows - 1} along x1 and 0 to {columns - 1} along x2"
        raise InputError("cell", (i, j), expected)
    return int(i), int(j)
