"""Several runs side by side: one table, one picture, in one unit of leakage."""

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
from .dataset import open_results
from .results import Results
from .tables import format_error_band, kind_of, leakage_texts

#: Ends of the band of realisations, where a run has them.
BAND = ("leakage_lower", "leakage_upper")


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(Plotted):
    """Runs side by side; their loads, methods and lengths of seal may differ.

    names, runs : the runs, each with a name of its own. unit : of leakage in table and picture.
    settings : of a sweep, the keys that were varied, and the values of each run as texts, one for each key.
    """

    names: tuple[str, ...]
    runs: tuple[Results, ...]
    unit: LeakUnit
    keys: tuple[str, ...] = ()
    settings: tuple[tuple[str, ...], ...] = field(default=())

    def leakage(self, run: int) -> Array:
        """Leakage of a run at its own steps (steps,) in `unit`, NaN where it failed."""
        results = self.runs[run]
        return np.asarray(results.leakage.values / results.leak_basis.factor(self.unit))

    def band(self, run: int) -> tuple[Array, Array] | None:
        """Lower and upper quantile of the realisations of a run (steps,) in `unit`; None without realisations."""
        results = self.runs[run]
        if results.method != "median" or any(name not in results.dataset for name in BAND):
            return None
        low, high = (results.dataset[name].values for name in BAND)
        factor = results.leak_basis.factor(self.unit)
        return low / factor, high / factor

    def interval(self, run: int) -> tuple[Array, Array] | None:
        """Lower and upper end of the 95 % interval of a run (steps,) in `unit`; None without an error budget."""
        results = self.runs[run]
        if (budget := results.budget) is None:
            return None
        factor = results.leak_basis.factor(self.unit)
        return budget.lower / factor, budget.upper / factor

    @property
    def common_steps(self) -> tuple[LoadStep, ...]:
        """Load steps that all runs have, in the order of the first."""
        others = [set(results.steps) for results in self.runs[1:]]
        return tuple(step for step in self.runs[0].steps if all(step in steps for steps in others))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the runs for people: the settings of a sweep that differ, or else their names."""
        columns = zip(self.keys, *self.settings, strict=True)
        varied = [
            [f"{key} {value}" for value in values] for key, *values in columns if len({*values}) > 1
        ]
        return tuple(map(", ".join, zip(*varied, strict=True))) or self.names

    @property
    def label(self) -> str:
        """What is compared, with its unit."""
        return f"{kind_of(self.unit)} [{self.unit.name}]"

    def rows(self) -> list[dict[str, Any]]:
        """One dictionary for each run and load step: the run, the keys of a sweep, the load, the leakage in SI and in
        the unit of the comparison; keys carry the units, missing intervals and quantiles are NaN."""
        column = with_unit("leakage", self.unit.name)
        rows = []
        for n, results in enumerate(self.runs):
            data, basis = results.dataset, results.leak_basis
            low, high = self.band(n) or (np.nan, np.nan)
            lowest, highest = self.interval(n) or (np.nan, np.nan)
            varied = zip(self.keys, self.settings[n], strict=True) if self.keys else ()
            columns: dict[str, Any] = {
                "run": self.names[n],
                **dict(varied),
                "method": results.method,
                "seal_length_m": basis.length,
                "step": data["step"],
                "branch": data["branch"],
                "nominal_pressure_Pa": data["nominal_pressure"],
                "unloaded_from_Pa": data["unloaded_from"],
                "leakage_m2_per_s": results.leakage,
                "leakage_lower_m2_per_s": low * basis.factor(self.unit),
                "leakage_upper_m2_per_s": high * basis.factor(self.unit),
                "interval_lower_m2_per_s": lowest * basis.factor(self.unit),
                "interval_upper_m2_per_s": highest * basis.factor(self.unit),
                column: self.leakage(n),
            }
            rows += rows_of(columns)
        return rows

    def table(self) -> TextTable:
        """The table for people, one line for each run, to be given to `rich.print`.

        The columns are the keys of a sweep, or else the names of the runs; the method where it differs; the leakage at
        a few load steps that all runs have, or else at their own highest one, in brackets its 95 % interval.
        """
        columns: list[tuple[str, list[str]]] = [("run", list(self.names))]
        if self.keys:
            columns = [(key, texts) for key, *texts in zip(self.keys, *self.settings, strict=True)]
        names, methods = len(columns), [results.method for results in self.runs]
        if len({*methods}) > 1:
            columns.append(("method", methods))
        leakages = [self._texts(run) for run in range(len(self.runs))]
        columns += [
            (name, [texts[s] for texts, s in zip(leakages, steps, strict=True)])
            for name, steps in self._columns()
        ]
        return TextTable.of_columns(self.label, columns, names=names)

    def _texts(self, run: int) -> list[str]:
        """Leakage of a run at its own steps as text, with its interval where one is known."""
        results = self.runs[run]
        factor = results.leak_basis.factor(self.unit)
        texts = leakage_texts(results, factor)
        if (budget := results.budget) is None:
            return texts
        ends = zip(texts, budget.lower, budget.upper, budget.leakage, strict=True)
        return [
            f"{text} ({format_error_band(low, high, factor, q)})" if np.isfinite(q) else text
            for text, low, high, q in ends
        ]

    def _columns(self) -> list[tuple[str, list[int]]]:
        """Heading and the step of every run, for each column of leakage."""
        common = self.common_steps
        if not common:
            return [("highest load of each", [results.peak for results in self.runs])]
        loading = [step for step in common if step.unloaded_from is None]
        chosen = [*(loading[n] for n in (0, len(loading) // 2, -1) if loading), common[-1]]
        found = []
        for step in dict.fromkeys(chosen):
            loads = [p for p in (step.pressure, step.unloaded_from) if p is not None]
            text = " from ".join(to_text(p, "Pa", 3) for p in loads)
            found.append((text, [results.steps.index(step) for results in self.runs]))
        return found

    def write(self, folder: AnyPath, stem: str = "comparison") -> list[Path]:
        """Write the table as `stem`.csv and the picture as `stem`.png into a folder, which is made if needed.

        Raises InputError: the folder cannot be made.
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


Run = Results | AnyPath


def compare(runs: Mapping[str, Run] | Sequence[Run], *, unit: str | None = None) -> RunComparison:
    """Several finished runs side by side; their loads, methods, faces and lengths of seal may differ.

    Parameters
    ----------
    runs : results folders, or `Results`; as a mapping with a name for each, otherwise they are named by their folders.
    unit : of leakage, such as "mL/min"; that of the cases if it is the same in all of them, or else a
        readable one per length of seal.

    Raises
    ------
    InputError : fewer than two runs, a folder without results, two runs of one name, or a unit that does not exist or
        is not for the fluid of one of the runs.

    Examples
    --------
    >>> both = compare({"polished": "results/a", "turned": "results/b"}, unit="mL/min")  # doctest: +SKIP
    >>> axes = both.plot()  # doctest: +SKIP
    """
    given = list(runs.values()) if isinstance(runs, Mapping) else list(runs)
    if len(given) < 2:
        raise InputError("compare", counted(len(given), "run"), "two or more")
    opened = tuple(run if isinstance(run, Results) else open_results(run) for run in given)
    names = tuple(runs) if isinstance(runs, Mapping) else _names(opened)
    return compared(names, opened, unit=unit)


def named(arguments: Sequence[str]) -> Mapping[str, Run] | Sequence[Run]:
    """Runs from texts DIR or NAME=DIR; with a name for one of them, the others are named by the last part of theirs."""
    pairs = [("", text) if Path(text).is_dir() else text.partition("=")[::2] for text in arguments]
    pairs = [(name, path) if path else ("", name) for name, path in pairs]
    if not any(name for name, _ in pairs):
        return [path for _, path in pairs]
    names = [name or Path(path).name for name, path in pairs]
    if len({*names}) < len(names):
        raise InputError("compare", ", ".join(names), "a name of its own for each run")
    return dict(zip(names, (path for _, path in pairs), strict=True))


def compared(
    names: Sequence[str],
    runs: Sequence[Results],
    *,
    unit: str | None = None,
    keys: tuple[str, ...] = (),
    settings: tuple[tuple[str, ...], ...] = (),
) -> RunComparison:
    """The comparison of opened runs, see `compare` and `RunComparison`."""
    if twice := sorted({name for name in names if list(names).count(name) > 1}):
        given = f"two runs named {shown(twice[0])}"
        raise InputError("compare", given, "a name of its own for each run")
    chosen = _unit(runs) if unit is None else leak_unit(unit)
    for results in runs:
        results.leak_basis.factor(chosen)  # raises if the unit is not for the fluid
    return RunComparison(tuple(names), tuple(runs), chosen, keys, settings)


def _unit(runs: Sequence[Results]) -> LeakUnit:
    """The unit of the cases if they agree, else a readable one per length of seal for all of them."""
    asked = {results.asked_unit for results in runs}
    unit = asked.pop() if len(asked) == 1 else None
    if unit is not None and all(results.leak_basis.has(unit) for results in runs):
        return unit
    return LEAK_UNITS[leakage_unit(np.concatenate([r.leakage.values for r in runs]))[1]]


def _names(runs: Sequence[Results]) -> tuple[str, ...]:
    """Names of folders, their paths where two have one name; a number where there is none."""
    folders = [results.folder for results in runs]
    for names in ([path and path.name for path in folders], folders):
        found = tuple(str(name or f"run {n}") for n, name in enumerate(names, 1))
        if len({*found}) == len(found):
            break
    return found
