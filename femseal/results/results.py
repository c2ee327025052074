"""Results of a case: what a run has found, with selections, tables, pictures, files, and a summary in a few lines."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
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
    counted,
    to_si,
    to_text,
)
from ..base.leak_rates import LeakBasis
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit, leakage_unit
from ..base.text import room
from ..budget import ErrorBudget
from ..loads import LoadProgramme, LoadStep
from ..studies import STUDIES, FaceResult, Scene, StochasticResult, StudyResult
from .variables import basis_of, budgets_in, tightest_classes

if TYPE_CHECKING:
    import xarray

#: Methods from the best, each with its leakage in the dataset, and its name in the variables of its budget.
METHODS = tuple((study.label, study.leakage_variable) for study in reversed(STUDIES.values()))
BUDGETED = {study.label: study.key for study in STUDIES.values()}


@dataclass(frozen=True, eq=False, repr=False)
class Results(Plotted):
    """What a run has found.

    dataset : every number with its unit, see `assemble`. folder : from which it was read, or to which it was saved.
    scene : the input of the studies. studies : their results by key, with the fields that are too large for the
    dataset. None, and none, of results that were read from a folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    studies: Mapping[str, StudyResult] = field(default_factory=dict)

    @property
    def deterministic(self) -> FaceResult | None:
        """Result of the deterministic study in this process."""
        return self.studies.get("deterministic")  # type: ignore[return-value]

    @property
    def two_scale(self) -> FaceResult | None:
        """Result of the two-scale study in this process."""
        return self.studies.get("two_scale")  # type: ignore[return-value]

    @property
    def stochastic(self) -> StochasticResult | None:
        """Result of the stochastic study in this process."""
        return self.studies.get("stochastic")  # type: ignore[return-value]

    @property
    def method(self) -> str:
        """Source of `leakage`: "median" (of realisations), "two-scale" or "deterministic"."""
        return next(method for method, name in METHODS if name in self.dataset)

    @property
    def leakage(self) -> xarray.DataArray:
        """Best available leakage per length of seal (step,) [m²/s]: median, else two-scale, else deterministic."""
        return self.dataset[dict(METHODS)[self.method]]

    @property
    def per_length(self) -> xarray.DataArray:
        """`leakage` by its name in `Leakage` [m²/s]."""
        return self.leakage

    @property
    def volume_rate(self) -> xarray.DataArray:
        """Best available leakage of the whole seal (step,) [m³/s], as in `Leakage`."""
        return self.dataset["leakage_total"]

    @property
    def mass_rate(self) -> xarray.DataArray:
        """The same by mass (step,) [kg/s].

        Raises InputError: the density of the fluid is unknown.
        """
        return self.leakage_in("kg/s")

    @property
    def leak_basis(self) -> LeakBasis:
        """Length of the seal and reference state of the fluid, which turn the leakage into any unit."""
        return basis_of(self.dataset.attrs)

    @property
    def class_basis(self) -> LeakBasis:
        """The same of the fluid that decides on leakage classes: the test fluid where there is one."""
        return basis_of(self.dataset.attrs, "test_" if "test_leakage" in self.dataset else "")

    @property
    def class_leakage(self) -> tuple[Array, Array]:
        """Leakage that decides on classes [m²/s]: the one that is given (step,), and that of each realisation."""
        data, tested = self.dataset, "test_leakage" in self.dataset
        best = data["test_leakage"].values if tested else self.leakage.values
        name = "test_leakage_realisations" if tested else "leakage"
        several = data[name].values if name in data and self.method == "median" else best[None]
        return best, several

    @property
    def has_failed(self) -> Flags:
        """Whether the leakage of the fluid, or of the test fluid, was not found at a step (step,)."""
        failed = np.isnan(self.leakage.values) | np.isnan(self.class_leakage[0])
        failed[self.open_steps] = False
        return failed

    @property
    def class_interval(self) -> tuple[Array, Array] | None:
        """Lower and upper end of the 95 % interval of that leakage (step,) [m²/s], NaN where one is not known.

        It is that of the fluid of the run, and reaches as far, as a factor, for a test fluid. Where nothing leaks, the
        factor is the largest of all steps. None without an error budget.
        """
        budget = self.budget
        if budget is None:
            return None
        own, best = np.abs(budget.leakage), np.abs(self.class_leakage[0])
        leaks = (own > 0) & (best > 0)
        ratio = np.divide(best, own, out=np.zeros_like(best), where=leaks)
        largest = ratio.max(initial=0.0) or 1.0
        factor = np.where(leaks, ratio, largest)
        return factor * budget.lower, factor * budget.upper

    @property
    def class_upper(self) -> Array:
        """Upper end of that interval (step,) [m²/s]: inf where it is not known."""
        if (interval := self.class_interval) is None:
            return np.full(len(self.steps), np.inf)
        return np.nan_to_num(interval[1], nan=np.inf)

    @property
    def verdicts(self) -> tuple[Any, ...]:
        """Whether the leakage classes of the case are met and from which load on, see `verdict.Verdict`."""
        return tuple(room("results").verdicts_of(self))

    @property
    def verdict_texts(self) -> list[str]:
        """The verdicts in words, a text for each class; [] without classes."""
        shown = loads_as_given(self.dataset, 3)
        sentences = room("results").verdicts_in_words(self.verdicts, shown)
        return [" ".join(one) for one in sentences]

    @property
    def classes(self) -> list[str]:
        """The tightest leakage class that is met at each step, of each standard asked for; "none" where none is."""
        return tightest_classes(self.dataset)

    @property
    def leak_unit(self) -> LeakUnit:
        """The unit of leakage in tables and pictures: that of the case, else a readable one per length of seal."""
        if (asked := self.asked_unit) is not None and self.leak_basis.has(asked):
            return asked
        return LEAK_UNITS[leakage_unit(self.leakage.values)[1]]

    @property
    def asked_unit(self) -> LeakUnit | None:
        """The unit of leakage that the case gives, for its fluid, for its test fluid, or for both."""
        return LEAK_UNITS.get(self.dataset.attrs.get("leakage_unit", ""))

    @property
    def leak_scale(self) -> tuple[LeakUnit, float]:
        """`leak_unit`, and the leakage per length that is 1 in it [m²/s]."""
        return self.leak_unit, self.leak_basis.factor(self.leak_unit)

    def leakage_in(self, unit: str) -> xarray.DataArray:
        """`leakage` (step,) in a unit such as "mL/min", "g/year", "mL/(m·min)"; of gases also "mbar·L/s", "std cm³/s".

        Units that are not per length are of the whole seal. Volumes of gases are at 101 325 Pa and their temperature,
        standard ones at 0 °C; pressure × volume is at the temperature stated in the case, else at that of the gas.

        Raises InputError: no such unit, or a unit of gases for a liquid.
        """
        chosen = leak_unit(unit)
        values = self.leakage / self.leak_basis.factor(chosen)
        return values.assign_attrs(units=chosen.name, long_name=self.leakage.attrs["long_name"])

    @property
    def budgets(self) -> dict[str, ErrorBudget]:
        """Error budgets by method: "deterministic", "two_scale", "stochastic"; empty where none was asked for."""
        return budgets_in(self.dataset, self.steps)

    @property
    def budget(self) -> ErrorBudget | None:
        """Error budget of `leakage`; None where none was asked for."""
        return self.budgets.get(BUDGETED[self.method])

    @property
    def steps(self) -> LoadProgramme:
        """The load programme."""
        data = self.dataset
        loads = zip(
            data["nominal_pressure"].values.tolist(),
            data["unloaded_from"].values.tolist(),
            strict=True,
        )
        return LoadProgramme(LoadStep(p, None if np.isnan(peak) else peak) for p, peak in loads)

    @property
    def peak(self) -> int:
        """The first step of the highest load."""
        return int(np.argmax(self.dataset["nominal_pressure"].values))

    @property
    def warnings(self) -> list[str]:
        """Reasons to doubt the numbers, one line each; empty if there are none."""
        return self._parsed("warnings")

    @property
    def failures(self) -> list[str]:
        """Failures, whose numbers are missing or NaN, one line each; empty if there are none."""
        return self._parsed("failures")

    @property
    def open_steps(self) -> list[int]:
        """Numbers of the steps without leakage at which the fluid carries all of the load, so that the seal is open."""
        return self._parsed("open_steps", "[]")

    @property
    def left_out(self) -> list[str]:
        """Files that were not written to the folder, with the reason, one line each; empty if there are none."""
        return self._parsed("left_out", "[]")

    @property
    def case(self) -> dict[str, Any]:
        """The case in SI, as given to `assemble`; tuples have become lists."""
        return self._parsed("case")

    @property
    def attempts(self) -> dict[str, Any] | None:
        """The attempts at the accuracy that the case asks for, and whether it is met; None if it asks for none."""
        return self._parsed("accuracy", "null")

    def _parsed(self, attribute: str, default: str = "") -> Any:
        return json.loads(self.dataset.attrs.get(attribute, default))

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
        pressure = self.dataset["nominal_pressure"].values
        parts = {pressure[steps[0]]: steps for _, steps in branches_in(self.dataset)[1:]}
        if not parts:
            raise InputError("from_", from_, "nothing: the cycle has no unloading")
        given = to_si(from_, "Pa", "from_") if isinstance(from_, str) else from_
        wanted = max(parts) if given is None else given
        for peak, steps in parts.items():
            if np.isclose(peak, wanted, rtol=1e-9, atol=0):
                return self._over_pressure(steps)
        peaks = ", ".join(to_text(peak, "Pa") for peak in sorted(parts))
        raise InputError("from_", from_, f"one of {peaks}")

    def _over_pressure(self, steps: Indices) -> xarray.Dataset:
        data = self.dataset
        names = [name for name in data.data_vars if "step" in data[name].dims]
        return data[names].isel(step=steps).swap_dims(step="nominal_pressure")

    def piece(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the piece (i, j) over the steps of a two-scale study, else over the states that seals draw from.

        Raises InputError: no such piece, or results without pieces.
        """
        data = self.dataset
        prefix = "" if "piece1" in data.dims or "state" not in data.dims else "state_"
        dims = f"{prefix}piece1", f"{prefix}piece2"
        names = [name for name in data.data_vars if dims[0] in data[name].dims]
        return data[names].isel(dict(zip(dims, piece(data, i, j, dims), strict=True)))

    def gap(self, step: int, piece: Shape | None = None) -> xarray.DataArray:
        """Deformed gap (x1, x2) [m] at one step, see `pixels`."""
        return self.pixels("gap", step, piece)

    def contact_pressure(self, step: int, piece: Shape | None = None) -> xarray.DataArray:
        """Contact pressure (x1, x2) [Pa] at one step, see `pixels`."""
        return self.pixels("contact_pressure", step, piece)

    def fluid_pressure(self, step: int, piece: Shape | None = None) -> xarray.DataArray:
        """Fluid pressure (x1, x2) [Pa] at one step, NaN where none flows, see `pixels`."""
        return self.pixels("fluid_pressure", step, piece)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose fields over all pixels are in memory or in the folder."""
        return room("results").stored_steps(self)

    def attempts_table(self) -> TextTable:
        """The attempts at the accuracy that the case asks for, to be given to `rich.print`.

        Raises InputError: a case that asks for no accuracy.
        """
        if self.attempts is None:
            raise InputError("attempts", "a case that asks for no accuracy", "one with it")
        return room("results").attempts_table(self.attempts)

    def plot_pieces(self) -> Any:
        """Permeability of pieces over their mean gap and their pressure, see `pieces_figure`."""
        return room("plots").shown(room("plots").pieces_figure(self))

    def plot_seal(self, step: int | None = None) -> Any:
        """Contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").shown(room("plots").seal_figure(self, step))

    def report(self, path: AnyPath | None = None) -> Path:
        """Write the report, `report.html` in the folder unless `path` is given, see `write_report`."""
        return room("report").write_report(self, path)

    def rows(self) -> list[dict[str, Any]]:
        """The table as dictionaries in SI, one for each step, see `tables.rows`."""
        return room("results").rows(self)

    def table(self) -> TextTable:
        """The table for people, for `rich.print`, see `tables.leakage_table`."""
        return room("results").leakage_table(self)

    def pixels(self, name: str, step: int, piece: Shape | None = None) -> xarray.DataArray:
        """A field over the pixels (x1, x2) at one step in SI, see `pixel_fields.read_pixels`."""
        return room("results").read_pixels(self, name, step, piece)

    def export(self, path: AnyPath, **options: Any) -> list[Path]:
        """Write a field over the pixels for other programs, see `pixel_fields.export_field`."""
        return room("results").export_field(self, path, **options)

    def __repr__(self) -> str:
        return room("results").summary_text(self)

    def _repr_html_(self) -> str:
        return room("results").summary_html(self)


def cycle_text(steps: LoadProgramme) -> str:
    """How many steps a load programme has on loading, and how many on unloading from what peaks."""
    up, down = len(steps.loading), ""
    if steps.unload_from:
        peaks = " and ".join(to_text(p, "Pa", 3) for p in steps.unload_from)
        down = f", {len(steps) - up} unloading from {peaks}"
    return f"{counted(len(steps), 'step')}: {up} loading{down}"


def branch_text(
    unloaded_from: float | None, text: Callable[[float], str] = lambda p: to_text(p, "Pa")
) -> str:
    """Name of a branch: "loading", or "unloading from 900 MPa"; `unloaded_from` [Pa], NaN or None on loading."""
    if unloaded_from is None or np.isnan(unloaded_from):
        return "loading"
    return f"unloading from {text(unloaded_from)}"


def force_scale(data: xarray.Dataset) -> tuple[str, float] | None:
    """Unit of the forces of a case for people, and the force in it at a nominal pressure of 1 Pa; None of pressures."""
    table = json.loads(data.attrs.get("case", "{}")).get("load", {})
    given = [*(table.get("loading") or ()), *(table.get("unload_from") or ())]
    loads = [str(load).split() for load in given]
    if not loads or len(loads[0]) < 2:
        return None
    highest = max(float(number) for number, _ in loads)
    unit, factor = "N", 1.0
    if loads[0][1] == "N/m":
        unit, factor = "N/mm", 1e-3
    elif highest >= 1e3:
        unit, factor = "kN", 1e-3
    return unit, factor * highest / data["nominal_pressure"].values.max()


def loads_as_given(data: xarray.Dataset, digits: int = 4) -> Callable[[float], str]:
    """Nominal pressures [Pa] as text for people; forces of a case stand before them."""
    force = force_scale(data)

    def text(p: float) -> str:
        nominal = to_text(p, "Pa", digits)
        return f"{force[1] * p:.{digits}g} {force[0]} ({nominal})" if force else nominal

    return text


def load_names(data: xarray.Dataset) -> list[str]:
    """Branch and load of every step for people, see `loads_as_given`."""
    text = loads_as_given(data)
    return [
        f"loading {text(p)}" if np.isnan(peak) else f"unloading {text(p)} from {text(peak)}"
        for p, peak in zip(
            data["nominal_pressure"].values, data["unloaded_from"].values, strict=True
        )
    ]


def branches(pressure: Array, peaks: Array) -> list[tuple[str, Indices]]:
    """Name and steps of the loading and of each unloading, which begins at its peak on the loading.

    pressure, peaks : nominal pressure of each step, and the one it is unloaded from, NaN on loading [Pa].
    """
    loading = np.flatnonzero(np.isnan(peaks))
    found = [("loading", loading)]
    for peak in np.unique(peaks[~np.isnan(peaks)])[::-1]:
        start = loading[pressure[loading] == peak]
        found.append((branch_text(peak), np.r_[start, np.flatnonzero(peaks == peak)]))
    return found


def branches_in(data: xarray.Dataset) -> list[tuple[str, Indices]]:
    """The branches of a dataset, see `branches`."""
    return branches(data["nominal_pressure"].values, data["unloaded_from"].values)


def piece(
    data: xarray.Dataset, i: int, j: int, dims: tuple[str, str] = ("piece1", "piece2")
) -> Shape:
    """Index of a piece along two dimensions, checked."""
    if dims[0] not in data.dims:
        raise InputError("piece", (i, j), "none: the results have no pieces")
    m1, m2 = (data.sizes[dim] for dim in dims)
    if i not in range(m1) or j not in range(m2):
        raise InputError("piece", (i, j), f"0 to {m1 - 1} along x1 and 0 to {m2 - 1} along x2")
    return int(i), int(j)
