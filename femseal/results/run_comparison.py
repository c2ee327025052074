"""Several runs side by side: one table and one picture, in one unit of leakage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

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
    to_text,
    write_bytes,
    write_text,
)
from ..base.fields import with_unit
from ..base.leak_units import LEAK_UNITS, LeakUnit, leak_unit, leakage_unit
from ..base.text import room
from ..loads import LoadStep
from .dataset_file import open_results
from .results import Results
from .tables import format_interval, kind_of, leakage_texts

#: Variables with the quantiles of the realisations, if a run has them.
QUANTILES = ("leakage_lower", "leakage_upper")

Run = Results | AnyPath


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(Plotted):
    """Runs side by side; their loads, methods and lengths of seal may differ.

    Attributes
    ----------
    names : tuple of str
        A name for each run.
    runs : tuple of Results
        The runs.
    unit : LeakUnit
        Unit of leakage in table and picture.
    keys : tuple of str
        Of a sweep, the keys of the case that were varied.
    settings : tuple of tuple of str
        Of a sweep, the values of each run as texts, one for each key.
    """

    names: tuple[str, ...]
    runs: tuple[Results, ...]
    unit: LeakUnit
    keys: tuple[str, ...] = ()
    settings: tuple[tuple[str, ...], ...] = field(default=())

    def leakage(self, run: int) -> Array:
        """Return the leakage of a run at its own steps (step,) in `unit`, NaN where it failed."""
        results = self.runs[run]
        return np.asarray(results.leakage.values / self._factor(run))

    def band(self, run: int) -> tuple[Array, Array] | None:
        """Return lower and upper quantile of the realisations of a run (step,) in `unit`; None without realisations."""
        results = self.runs[run]
        data = results.dataset
        if results.method != "median" or any(name not in data for name in QUANTILES):
            return None
        lower, upper = (data[name].values / self._factor(run) for name in QUANTILES)
        return lower, upper

    def interval(self, run: int) -> tuple[Array, Array] | None:
        """Return both ends of the 95 % interval of a run (step,) in `unit`; None without an error budget."""
        budget = self.runs[run].budget
        if budget is None:
            return None
        return budget.lower / self._factor(run), budget.upper / self._factor(run)

    def _factor(self, run: int) -> float:
        """Return the leakage per length of a run [m²/s] that is 1 in `unit`."""
        return self.runs[run].leak_basis.factor(self.unit)

    @property
    def common_steps(self) -> tuple[LoadStep, ...]:
        """Load steps that all runs have, in the order of the first run."""
        others = [set(results.steps) for results in self.runs[1:]]
        return tuple(step for step in self.runs[0].steps if all(step in steps for steps in others))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the runs for people: the settings of a sweep that differ, or else `names`."""
        if not self.keys:
            return self.names
        columns = zip(self.keys, *self.settings, strict=True)
        varied = [
            [f"{key} {value}" for value in values]
            for key, *values in columns
            if len(set(values)) > 1
        ]
        if not varied:
            return self.names
        return tuple(", ".join(texts) for texts in zip(*varied, strict=True))

    @property
    def label(self) -> str:
        """What is compared, with its unit."""
        return f"{kind_of(self.unit)} [{self.unit.name}]"

    def rows(self) -> list[dict[str, Any]]:
        """Return the comparison as dictionaries, one for each run and load step.

        Returns
        -------
        list of dict
            Name of the run, keys of a sweep, load, and leakage in SI and in `unit`. Names of the columns contain the
            units. Intervals and quantiles that a run does not have are NaN.
        """
        rows = []
        for run, results in enumerate(self.runs):
            data, factor = results.dataset, self._factor(run)
            low, high = self.band(run) or (np.nan, np.nan)
            lowest, highest = self.interval(run) or (np.nan, np.nan)
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
                "leakage_lower_m2_per_s": low * factor,
                "leakage_upper_m2_per_s": high * factor,
                "interval_lower_m2_per_s": lowest * factor,
                "interval_upper_m2_per_s": highest * factor,
                with_unit("leakage", self.unit.name): self.leakage(run),
            }
            rows += rows_of(columns)
        return rows

    def table(self) -> TextTable:
        """Return the table for people, to be given to `rich.print`.

        Returns
        -------
        TextTable
            One line for each run. The columns are the keys of a sweep, or else the names of the runs; the method if it
            differs; the leakage, with its 95 % interval in brackets, at a few load steps that all runs have, or else at
            the highest load of each.
        """
        columns: list[tuple[str, list[str]]] = [("run", list(self.names))]
        if self.keys:
            columns = [(key, texts) for key, *texts in zip(self.keys, *self.settings, strict=True)]
        names = len(columns)
        methods = [results.method for results in self.runs]
        if len(set(methods)) > 1:
            columns.append(("method", methods))
        leakages = [self._leakage_texts(run) for run in range(len(self.runs))]
        for heading, steps in self._compared_steps():
            texts = [leakage[step] for leakage, step in zip(leakages, steps, strict=True)]
            columns.append((heading, texts))
        return TextTable.of_columns(self.label, columns, names=names)

    def _leakage_texts(self, run: int) -> list[str]:
        """Return the leakage of a run at its own steps as text, with its 95 % interval if it is known."""
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
        """Return heading, and the number of the step in every run, of each column of leakage."""
        common = self.common_steps
        if not common:
            return [("highest load of each", [results.peak for results in self.runs])]
        loading = [step for step in common if step.unloaded_from is None]
        chosen = [common[-1]]
        if loading:
            chosen = [loading[0], loading[len(loading) // 2], loading[-1], *chosen]
        columns = []
        for step in dict.fromkeys(chosen):
            loads = [load for load in (step.pressure, step.unloaded_from) if load is not None]
            heading = " from ".join(to_text(load, "Pa", 3) for load in loads)
            columns.append((heading, [results.steps.index(step) for results in self.runs]))
        return columns

    def write(self, folder: AnyPath, stem: str = "comparison") -> list[Path]:
        """Write the table as .csv and the picture as .png.

        Parameters
        ----------
        folder : str or path
            Created if needed.
        stem : str
            Name of the files without their suffix.

        Returns
        -------
        list of Path
            The files.

        Raises
        ------
        InputError
            The folder cannot be created.
        """
        target = made_folder(folder)
        picture = room("plots").png(room("plots").comparison_figure(self))
        return [
            write_text(target / f"{stem}.csv", comma_separated(self.rows())),
            write_bytes(target / f"{stem}.png", picture),
        ]

    def __repr__(self) -> str:
        names = ", ".join(self.names)
        return f"<femseal.RunComparison of {names}, in {self.unit.name}>"


def compare(runs: Mapping[str, Run] | Sequence[Run], *, unit: str | None = None) -> RunComparison:
    """Compare several finished runs; their loads, methods, faces and lengths of seal may differ.

    Parameters
    ----------
    runs : mapping or sequence
        Folders of results, or `Results`. The keys of a mapping are their names; otherwise they are named after their
        folders.
    unit : str, optional
        Of leakage, such as "mL/min"; that of the cases if it is the same in all of them, or else a readable one per
        length of seal.

    Returns
    -------
    RunComparison
        With a table, a picture, and files of both.

    Raises
    ------
    InputError
        There are fewer than two runs, a folder has no results, two runs have one name, or the unit does not exist or is
        not for the fluid of one of the runs.

    Examples
    --------
    >>> both = compare({"polished": "results/a", "turned": "results/b"}, unit="mL/min")  # doctest: +SKIP
    >>> axes = both.plot()  # doctest: +SKIP
    """
    given = list(runs.values()) if isinstance(runs, Mapping) else list(runs)
    if len(given) < 2:
        raise InputError("compare", counted(len(given), "run"), "two or more")
    opened = tuple(run if isinstance(run, Results) else open_results(run) for run in given)
    names = tuple(runs) if isinstance(runs, Mapping) else _names_of(opened)
    return compared(names, opened, unit=unit)


def named(arguments: Sequence[str]) -> Mapping[str, Run] | Sequence[Run]:
    """Return the runs that arguments of the command line name, as `compare` takes them.

    An argument is DIR or NAME=DIR. If one of them has a name, the others are named by the last part of their path.
    """
    pairs = [_name_and_path(text) for text in arguments]
    if not any(name for name, _ in pairs):
        return [path for _, path in pairs]
    names = [name or Path(path).name for name, path in pairs]
    if len(set(names)) < len(names):
        raise InputError("compare", ", ".join(names), "a name of its own for each run")
    return dict(zip(names, (path for _, path in pairs), strict=True))


def _name_and_path(text: str) -> tuple[str, str]:
    """Split NAME=DIR; the name is empty without "=", and if the whole text is a folder."""
    name, _, path = text.partition("=")
    if not path or Path(text).is_dir():
        return "", text if Path(text).is_dir() else name
    return name, path


def compared(
    names: Sequence[str],
    runs: Sequence[Results],
    *,
    unit: str | None = None,
    keys: tuple[str, ...] = (),
    settings: tuple[tuple[str, ...], ...] = (),
) -> RunComparison:
    """Return the comparison of runs that are in memory; arguments as of `compare` and `RunComparison`."""
    repeated = sorted({name for name in names if list(names).count(name) > 1})
    if repeated:
        given = f"two runs named {shown(repeated[0])}"
        raise InputError("compare", given, "a name of its own for each run")
    chosen = _common_unit(runs) if unit is None else leak_unit(unit)
    for results in runs:
        results.leak_basis.factor(chosen)  # raises an InputError if the unit is not for the fluid
    return RunComparison(tuple(names), tuple(runs), chosen, keys, settings)


def _common_unit(runs: Sequence[Results]) -> LeakUnit:
    """Return the unit of the cases if they agree, else a readable one per length of seal for all of them."""
    asked = {results.asked_unit for results in runs}
    unit = asked.pop() if len(asked) == 1 else None
    if unit is not None and all(results.leak_basis.has(unit) for results in runs):
        return unit
    leakages = np.concatenate([results.leakage.values for results in runs])
    return LEAK_UNITS[leakage_unit(leakages)[1]]


def _names_of(runs: Sequence[Results]) -> tuple[str, ...]:
    """Return the names of the folders of runs, or their paths if two have one name; a number without a folder."""
    folders = [results.folder for results in runs]
    short = [None if folder is None else folder.name for folder in folders]
    names = _numbered(short)
    return names if len(set(names)) == len(names) else _numbered(folders)


def _numbered(names: Sequence[str | Path | None]) -> tuple[str, ...]:
    return tuple(str(name or f"run {number}") for number, name in enumerate(names, start=1))
