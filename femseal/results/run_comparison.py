"""Compare several runs in one table and one picture, in the same unit of leakage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import femseal  # its packages are loaded when a method uses them

from ..base import (
    AnyPath,
    Array,
    InputError,
    Plotted,
    TextTable,
    comma_separated,
    counted,
    made_folder,
    rows_of,
    shown,
    write_text,
)
from ..base.fields import with_unit
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit, leakage_unit
from ..loads import LoadStep
from .class_loads import class_columns, common_load_text
from .dataset_file import open_results
from .leakage_format import format_interval, leakage_kind
from .ranking import Ranking
from .results import Results
from .tables import leakage_texts

if TYPE_CHECKING:
    import xarray

#: Variables with the lower and upper quantile of the leakage of the realisations.
QUANTILE_VARIABLES = ("leakage_lower", "leakage_upper")

Run = Results | AnyPath


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(Plotted):
    """A comparison of several runs, whose loads, methods and seal lengths may differ.

    Attributes
    ----------
    names : tuple of str
        Name of each run.
    runs : tuple of Results
        Results of each run.
    unit : LeakUnit
        Unit of leakage in the table and the picture.
    keys : tuple of str
        Keys of the case that a sweep has varied; empty if the runs are not from a sweep.
    settings : tuple of tuple of str
        Values of the varied keys as strings; a tuple for each run.
    """

    names: tuple[str, ...]
    runs: tuple[Results, ...]
    unit: LeakUnit
    keys: tuple[str, ...] = ()
    settings: tuple[tuple[str, ...], ...] = field(default=())

    def leakage(self, run: int) -> Array:
        """Return the leakage of a run at its load steps in `unit`, (step,), NaN where the computation failed."""
        results = self.runs[run]
        return np.asarray(results.leakage.values / self._factor(run))

    def band(self, run: int) -> tuple[Array, Array] | None:
        """Return the lower and upper quantiles of the leakage over the realisations of a run.

        Each quantile is an array (step,) in `unit`. The method returns None if the run has no realisations.
        """
        results = self.runs[run]
        data = results.dataset
        has_realisations = results.best_study.has_realisations
        if not has_realisations or any(name not in data for name in QUANTILE_VARIABLES):
            return None
        lower, upper = (data[name].values / self._factor(run) for name in QUANTILE_VARIABLES)
        return lower, upper

    def interval(self, run: int) -> tuple[Array, Array] | None:
        """Return the lower and upper ends of the 95 % interval of the leakage of a run.

        Each end of the interval is an array (step,) in `unit`. The method returns None if the run has no error budget.
        """
        budget = self.runs[run].budget
        if budget is None:
            return None
        return budget.lower / self._factor(run), budget.upper / self._factor(run)

    def _factor(self, run: int) -> float:
        """Return the factor [m²/s] that converts a leakage in `unit` to the leakage per unit seal length of a run."""
        return self.runs[run].leak_basis.factor(self.unit)

    @property
    def common_steps(self) -> tuple[LoadStep, ...]:
        """Load steps that all runs have in common, in the order of the first run."""
        others = [set(results.steps) for results in self.runs[1:]]
        return tuple(step for step in self.runs[0].steps if all(step in steps for steps in others))

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the runs, which are the settings that differ in a sweep, or else the names of the runs."""
        if not self.keys:
            return self.names
        varied = []  # for each key whose values differ, a text for each run
        for key, *values in zip(self.keys, *self.settings, strict=True):
            if len(set(values)) > 1:
                varied.append([f"{key} {value}" for value in values])
        if not varied:
            return self.names
        return tuple(", ".join(texts) for texts in zip(*varied, strict=True))

    @property
    def label(self) -> str:
        """Name of the compared leakage, with its unit."""
        return f"{leakage_kind(self.unit)} [{self.unit.name}]"

    def rows(self) -> list[dict[str, Any]]:
        """Return the comparison as one dictionary for each run and load step.

        Returns
        -------
        list of dict
            Each dictionary contains the name of the run, the settings of a sweep, the load, and the leakage in SI units
            and in `unit`. The keys of a dictionary contain the units of the values. If a run has no interval or no
            quantiles, the corresponding values are NaN.
        """
        rows = []
        for run, results in enumerate(self.runs):
            data = results.dataset
            factor = self._factor(run)
            lower_quantile, upper_quantile = self.band(run) or (np.nan, np.nan)
            lower_end, upper_end = self.interval(run) or (np.nan, np.nan)
            settings = dict(zip(self.keys, self.settings[run], strict=True)) if self.keys else {}
            columns: dict[str, Any] = {
                "run": self.names[run],
                **settings,
                "method": results.method,
                "seal_length_m": results.leak_basis.length,
                "step": data["step"],
                "branch": data["branch"],
                "nominal_pressure_Pa": data["nominal_pressure"],
                "unloaded_from_Pa": data["unloaded_from"],
                "leakage_m2_per_s": results.leakage,
                "leakage_lower_m2_per_s": lower_quantile * factor,
                "leakage_upper_m2_per_s": upper_quantile * factor,
                "interval_lower_m2_per_s": lower_end * factor,
                "interval_upper_m2_per_s": upper_end * factor,
                with_unit("leakage", self.unit.name): self.leakage(run),
            }
            rows += rows_of(columns)
        return rows

    def dataset(self) -> xarray.Dataset:
        """Return the results of all runs at the load steps that they have in common, as one dataset.

        Returns
        -------
        xarray.Dataset
            Every numerical variable that has one value for each load step in all runs. The dimensions are `run` and
            `step`. For a sweep over all combinations of the values of several keys, the dimensions are the keys of the
            sweep and `step`. The values of a key are numbers if all values can be read as numbers, otherwise strings.

        Raises
        ------
        InputError
            The runs have no load step in common.
        """
        import xarray

        steps = self.common_steps
        if not steps:
            raise InputError("runs", "no common load step", "runs with a load step in common")
        datasets = [results.dataset for results in self.runs]
        names = [
            name
            for name, values in datasets[0].data_vars.items()
            if all(name in data and data[name].dims == ("step",) for data in datasets)
            and values.dtype.kind in "biuf"
        ]
        parts = []
        for results, data in zip(self.runs, datasets, strict=True):
            order = [results.steps.index(step) for step in steps]
            parts.append(data[names].isel(step=order).assign_coords(step=np.arange(len(steps))))
        combined = xarray.concat(parts, "run", coords="minimal", compat="override", join="override")
        # the attributes would be those of the first run
        combined.attrs = {}
        combined = combined.assign_coords(run=list(self.names))
        return self._over_keys(combined)

    def _over_keys(self, combined: xarray.Dataset) -> xarray.Dataset:
        """Replace the dimension `run` by the keys of a sweep, if the runs cover all combinations of key values."""
        # values of each key in all runs
        columns = [_numbers_if_possible(texts) for texts in zip(*self.settings, strict=True)]
        n_combinations = prod(len(set(values)) for values in columns)
        has_repeated_run = len(set(self.settings)) < len(self.runs)
        is_complete = n_combinations == len(self.runs) and not has_repeated_run
        if not self.keys or not is_complete:
            return combined
        for key, values in zip(self.keys, columns, strict=True):
            combined = combined.assign_coords({key: ("run", values)})
        if len(self.keys) == 1:
            return combined.swap_dims(run=self.keys[0]).drop_vars("run")
        return combined.drop_vars("run").set_index(run=list(self.keys)).unstack("run")

    def table(self) -> TextTable:
        """Return the comparison as a table that `rich.print` displays.

        Returns
        -------
        TextTable
            Table with one line for each run. The first columns contain the keys of a sweep or, for other runs, the name
            of the run. If the runs differ in their method, a column for the method follows. If the cases have leakage
            classes in common, further columns contain the load that is required to meet each class. The next columns
            contain the leakage, with its 95 % interval in brackets, at a few load steps that all runs have in common,
            or at the highest load of each run. The last column contains the rank, where rank 1 is the run that leaks
            least. If the intervals of several runs overlap, the last column contains the range of possible ranks.
        """
        columns: list[tuple[str, list[str]]] = [("run", list(self.names))]
        if self.keys:
            columns = [(key, texts) for key, *texts in zip(self.keys, *self.settings, strict=True)]
        name_columns = len(columns)
        methods = [results.method for results in self.runs]
        if len(set(methods)) > 1:
            columns.append(("method", methods))
        columns += class_columns(self.runs)
        leakages = [self._leakage_texts(run) for run in range(len(self.runs))]
        for heading, steps in self._compared_steps():
            texts = [leakage[step] for leakage, step in zip(leakages, steps, strict=True)]
            columns.append((heading, texts))
        ranking = self.ranking
        notes: tuple[str, ...] = ()
        if ranking is not None:
            texts = ["–" if rank is None else str(rank) for rank in ranking.ranks()]
            columns.append((f"rank at {ranking.load}", texts))
            notes = tuple(filter(None, [ranking.sentence()]))
        return TextTable.of_columns(self.label, columns, names=name_columns, notes=notes)

    def _leakage_texts(self, run: int) -> list[str]:
        """Return a string for each load step of a run with its leakage, and the 95 % interval if it is known."""
        results, factor = self.runs[run], self._factor(run)
        budget = results.budget
        texts = leakage_texts(results, factor)
        if budget is None:
            return texts
        with_intervals = []
        for step, text in enumerate(texts):
            leakage = budget.leakage[step]
            if np.isfinite(leakage):
                ends = format_interval(budget.lower[step], budget.upper[step], factor, leakage)
                text = f"{text} ({ends})"
            with_intervals.append(text)
        return with_intervals

    def _compared_steps(self) -> list[tuple[str, list[int]]]:
        """Choose the load steps whose leakage is shown in the table.

        Returns
        -------
        One pair per leakage column: its heading, and the index of its load step in every run.
        """
        common = self.common_steps
        if not common:
            return [("highest load of each", [results.peak for results in self.runs])]
        loading = [step for step in common if step.unloaded_from is None]
        # the last step, the load of the ranking, and the first, middle and last common load on loading
        chosen = {common[-1]}
        ranked = self._ranked_step
        if ranked is not None:
            chosen |= {loading[0], loading[len(loading) // 2], loading[-1], ranked}
        load_text = common_load_text(self.runs)
        columns = []
        for step in sorted(chosen, key=common.index):
            loads = [load for load in (step.pressure, step.unloaded_from) if load is not None]
            heading = " from ".join(map(load_text, loads))
            columns.append((heading, [results.steps.index(step) for results in self.runs]))
        return columns

    @property
    def ranking(self) -> Ranking | None:
        """Ranking of the runs by their leakage at a load on loading that all runs have in common.

        The load of the ranking is the highest common load at which at least two runs leak. If there is no such load,
        the runs are ranked at the highest common load. The ranking is None if the runs have no load on loading in
        common.
        """
        step = self._ranked_step
        return None if step is None else self._ranking_at(step)

    @cached_property
    def _ranked_step(self) -> LoadStep | None:
        """Load step at which the runs are ranked, None if the runs have no step on loading in common."""
        loading = [step for step in self.common_steps if step.unloaded_from is None]
        if not loading:
            return None
        highest_first = sorted(loading, key=_pressure, reverse=True)
        for step in highest_first:
            leakage = self._ranking_at(step).leakage  # (run,)
            n_leaking_runs = int((leakage > 0).sum())
            if n_leaking_runs > 1:
                return step
        return highest_first[0]

    def at(self, step: LoadStep) -> tuple[Array, Array, Array]:
        """Return the leakage at a load step that all runs have in common, and the ends of its 95 % interval.

        Each of the three arrays (run,) contains absolute values in `unit`; NaN where unknown.
        """
        values = np.full((3, len(self.runs)), np.nan)
        for run, results in enumerate(self.runs):
            index = results.steps.index(step)
            curves = [self.leakage(run), *(self.interval(run) or ())]
            values[: len(curves), run] = [abs(curve[index]) for curve in curves]
        leakage, lower, upper = values
        return leakage, lower, upper

    def _ranking_at(self, step: LoadStep) -> Ranking:
        """Rank the runs by their leakage at a load step that all runs have in common."""
        leakage, lower, upper = self.at(step)
        has_interval = np.array([results.budget is not None for results in self.runs])
        # an unknown end does not bound the leakage; without an interval, both ends are the leakage
        lower = np.where(has_interval, np.nan_to_num(lower, nan=0.0, posinf=np.inf), leakage)
        upper = np.where(has_interval, np.nan_to_num(upper, nan=np.inf, posinf=np.inf), leakage)
        load = common_load_text(self.runs)(step.pressure)
        return Ranking(load, self.labels, leakage, lower, upper, bool(has_interval.all()))

    def write(
        self, folder: AnyPath, stem: str = "comparison", formats: Sequence[str] = ("png",)
    ) -> list[Path]:
        """Write the table to a .csv file, and the picture to a file in each of the formats.

        Parameters
        ----------
        folder : str or path
            Folder of the files, which is created if needed.
        stem : str
            Name of the files without their suffix.
        formats : sequence of {"png", "svg", "pdf"}
            Formats of the picture.

        Returns
        -------
        list of Path
            Paths of the files.

        Raises
        ------
        InputError
            The folder cannot be created.
        """
        target = made_folder(folder)
        table = write_text(target / f"{stem}.csv", comma_separated(self.rows()))
        figure = femseal.plots.comparison_figure(self)
        return [table, *femseal.plots.write_figure(figure, target, stem, formats)]

    def __repr__(self) -> str:
        names = ", ".join(self.names)
        return f"<femseal.RunComparison of {names}, in {self.unit.name}>"


def compare(runs: Mapping[str, Run] | Sequence[Run], *, unit: str | None = None) -> RunComparison:
    """Compare several finished runs, whose loads, methods, faces and seal lengths may differ.

    Parameters
    ----------
    runs : mapping or sequence
        Results folders, or `Results`. In a mapping, the keys are the names of the runs. In a sequence, the runs are
        named after their folders.
    unit : str, optional
        Unit of the leakage, such as "mL/min". By default, the unit of the cases is used if all cases give the same
        unit. If the cases give different units or no unit, a unit of leakage per unit seal length is chosen so that the
        numbers are easy to read.

    Returns
    -------
    RunComparison
        Comparison, which can be tabulated, plotted and written to files.

    Raises
    ------
    InputError
        There are fewer than two runs; a folder has no results; two runs have the same name; or the unit is unknown or
        unsuitable for the fluid of a run.

    Examples
    --------
    >>> both = compare({"polished": "results/a", "turned": "results/b"}, unit="mL/min")  # doctest: +SKIP
    >>> axes = both.plot()  # doctest: +SKIP
    """
    sources = list(runs.values()) if isinstance(runs, Mapping) else list(runs)
    if len(sources) < 2:
        raise InputError("compare", counted(len(sources), "run"), "two or more")
    opened = tuple(run if isinstance(run, Results) else open_results(run) for run in sources)
    names = tuple(runs) if isinstance(runs, Mapping) else _names_of(opened)
    return compared(names, opened, unit=unit)


def named(arguments: Sequence[str]) -> Mapping[str, Run] | Sequence[Run]:
    """Convert command-line arguments to the argument `runs` of `compare`.

    Each argument has the form DIR or NAME=DIR. If at least one run has a name, the other runs are named after the last
    part of their path.
    """
    pairs = [_name_and_path(text) for text in arguments]
    if not any(name for name, _ in pairs):
        return [path for _, path in pairs]
    names = [name or Path(path).name for name, path in pairs]
    if len(set(names)) < len(names):
        raise InputError("compare", ", ".join(names), "a different name for each run")
    return dict(zip(names, (path for _, path in pairs), strict=True))


def _name_and_path(text: str) -> tuple[str, str]:
    """Split an argument NAME=DIR into name and folder.

    The returned name is empty if the argument has no "=", or if the whole argument is the path of an existing folder.
    """
    if Path(text).is_dir():
        return "", text
    name, _, path = text.partition("=")
    if not path:
        return "", name  # the text has no "=", or nothing after it
    return name, path


def compared(
    names: Sequence[str],
    runs: Sequence[Results],
    *,
    unit: str | None = None,
    keys: tuple[str, ...] = (),
    settings: tuple[tuple[str, ...], ...] = (),
) -> RunComparison:
    """Compare runs that are in memory; the arguments are explained in `compare` and `RunComparison`."""
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        given = f"two runs named {shown(repeated[0])}"
        raise InputError("compare", given, "a different name for each run")
    chosen = _common_unit(runs) if unit is None else leak_unit(unit)
    for results in runs:
        results.leak_basis.factor(chosen)  # raises an InputError if the unit is not for the fluid
    return RunComparison(tuple(names), tuple(runs), chosen, keys, settings)


def _common_unit(runs: Sequence[Results]) -> LeakUnit:
    """Return the leakage unit that all cases give, or a unit per unit seal length that gives readable numbers."""
    unit = runs[0].asked_unit
    is_common = all(results.asked_unit == unit for results in runs)
    if unit is not None and is_common and all(results.leak_basis.has(unit) for results in runs):
        return unit
    leakages = np.concatenate([results.leakage.values for results in runs])
    return LEAK_UNITS[leakage_unit(leakages)[1]]


def _pressure(step: LoadStep) -> float:
    """Return the pressure of a load step, by which load steps are sorted."""
    return step.pressure


def _names_of(runs: Sequence[Results]) -> tuple[str, ...]:
    """Name each run after its folder, or by the path of its folder if two folders have the same name.

    A run without a folder is named by its number, such as "run 2".
    """
    folders = [results.folder for results in runs]
    names = _with_numbers([None if folder is None else folder.name for folder in folders])
    are_different = len(set(names)) == len(names)
    if are_different:
        return names
    return _with_numbers(folders)


def _with_numbers(names: Sequence[str | Path | None]) -> tuple[str, ...]:
    """Convert names to text; a run without a name is named by its number."""
    return tuple(str(name or f"run {number}") for number, name in enumerate(names, start=1))


def _numbers_if_possible(texts: Sequence[str]) -> list[Any]:
    """Convert strings to numbers; if any of them is not a number, return all strings unchanged."""
    try:
        return [float(text) for text in texts]
    except ValueError:
        return list(texts)
