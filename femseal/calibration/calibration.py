"""The result of a calibration: prior and posterior, the measured and the calibrated curve; tables, files, a picture.

One file is the case with the calibrated values, from the tables of its own file.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import (
    AnyPath,
    Array,
    Plotted,
    TextTable,
    comma_separated,
    counted,
    made_folder,
    rows_of,
    to_text,
    versions,
    write_bytes,
    write_text,
    writing,
)
from ..case.case import Case
from ..case.template import as_toml, bare_key
from ..plots.drawing import GREY, LEGEND_LINE, LINES, STYLES, Sheet, legend_below, png, shows
from ..plots.leakage_panels import LeakageCurves, leakage_panel
from ..results.load_steps import branch_text, pressures_and_peaks
from ..results.tables import format_leakage
from .leak_test import BELOW, PROBABILITY, UNITS, Estimate, LeakTest, Posterior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FILE, TABLE, PICTURE = "calibration.json", "calibration.csv", "calibration.png"
#: Part of a range at its end, and part of the samples there from which on the range is said to be too narrow.
_END, _MANY = 0.03, 0.1
#: Root of the mean square of (measured − model)/error from which on the model is said not to fit.
_MISFIT = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Plotted):
    """A calibrated case, see `calibrate`.

    hardness, shortest_wave, factor : posterior [Pa], [m] and between test and model. prior : medians and ends of the
    ranges of the priors, by name. correlation : of their logarithms (3, 3). samples : of the posterior (n, 3).
    density : of the posterior. load_unit : of the loads. curve : lower end, median and upper end of the calibrated
    leakage at the rows of the test (3, rows), in its unit, 0 where sealed. scenes, leakages : hardness and shortest
    wave of what was solved (n, 2), and its leakages (n, loads). solid : table of the case whose hardness it is.
    notes : what to keep in mind.
    """

    hardness: Estimate
    shortest_wave: Estimate
    factor: Estimate
    prior: dict[str, Estimate]
    correlation: Array
    samples: Array
    density: Posterior
    load_unit: str
    curve: Array
    scenes: Array
    leakages: Array
    solid: str
    notes: tuple[str, ...]

    @classmethod
    def of(
        cls, posterior: Posterior, cube: Array, scenes: Array, leakages: Array, case: Case
    ) -> Calibration:
        """From samples of the posterior in the unit cube (n, 3)."""
        samples, test = posterior.quantities(cube), posterior.test
        prior = posterior.quantities(np.repeat([[0.5], [0.0], [1.0]], 3, axis=1))
        estimates = {name: Estimate.of(samples[:, n]) for n, name in enumerate(UNITS)}
        mean, deviation, is_open = posterior.curves(cube)
        rng = np.random.default_rng(2)
        drawn = np.exp(mean + deviation * rng.standard_normal((len(cube), 1)))
        drawn = np.where(rng.random((len(cube), 1)) < is_open, drawn, 0.0)
        ends = 0.5 - PROBABILITY / 2, 0.5, 0.5 + PROBABILITY / 2
        curve = np.quantile(drawn, ends, axis=0, method="nearest")
        notes = [
            f"the posterior of the {name.replace('_', ' ')} runs into the {end} end of its range"
            for n, name in enumerate(UNITS)
            for end, there in (("lower", cube[:, n] < _END), ("upper", cube[:, n] > 1 - _END))
            if there.mean() > _MANY
        ]
        leaks = ~test.sealed & (curve[1] > 0)
        off = np.median(deviation, axis=0)[leaks]
        ratio = np.log(test.leakage[leaks] / curve[1][leaks]) / np.hypot(posterior.error, off)
        if not (misfit := np.sqrt(np.mean(ratio**2))) < _MISFIT:
            notes.append(
                f"the model does not fit: it is {misfit:.2g} times the error off by the root mean square"
            )
        if missed := int((~test.sealed & (curve[1] == 0)).sum()):
            notes.append(f"the calibrated case is sealed where the test leaks, in {missed} rows")
        if (worst := off.max(initial=0.0)) > posterior.error:
            notes.append(
                f"the surrogate is {100 * worst:.2g} % off at some load, more than the test: more --scenes help"
            )
        return cls(
            **estimates,
            prior={name: Estimate(*map(float, prior[:, n])) for n, name in enumerate(UNITS)},
            correlation=np.asarray(np.corrcoef(cube.T)),
            samples=samples,
            density=posterior,
            load_unit=case.load.unit,
            curve=curve,
            scenes=scenes,
            leakages=leakages,
            solid=case.softer,
            notes=tuple(notes),
        )

    @property
    def test(self) -> LeakTest:
        """The leak test."""
        return self.density.test

    @property
    def posterior(self) -> dict[str, Estimate]:
        """The posterior by name."""
        return {name: getattr(self, name) for name in UNITS}

    def rows(self) -> list[dict[str, Any]]:
        """One dictionary for each row of the test: load, measured and calibrated leakage in the unit of the test."""
        loads = zip(("load", "unloaded from"), pressures_and_peaks(self.test.steps), strict=True)
        columns: dict[str, Any] = {f"{name} [{self.load_unit}]": p for name, p in loads}
        columns["sealed or below"] = self.test.sealed
        low, median, high = self.curve
        leakages = {
            "measured": self.test.leakage,
            "calibrated": median,
            "lower": low,
            "upper": high,
        }
        unit = self.test.unit.name
        return rows_of(columns | {f"{name} [{unit}]": q for name, q in leakages.items()})

    def tables(self) -> list[TextTable]:
        """Prior and posterior with correlations; measured and calibrated leakages."""

        def band(name: str, found: Estimate) -> str:
            return f"{_text(name, found.lower)} to {_text(name, found.upper)}"

        known = self.posterior
        columns = [
            ("", [name.replace("_", " ") for name in UNITS]),
            ("prior", [band(name, self.prior[name]) for name in UNITS]),
            ("posterior", [_text(name, known[name].median) for name in UNITS]),
            (f"{100 * PROBABILITY:g} % region", [band(name, known[name]) for name in UNITS]),
        ]
        columns += [
            (f"correlation with {name.replace('_', ' ')}", [f"{value:+.2f}" for value in values])
            for name, values in zip(UNITS, self.correlation, strict=True)
        ]
        count = counted(len(self.test.steps), "measured leakage")
        title = f"Calibration by {count} and {counted(len(self.scenes), 'solved scene')}"
        notes = tuple(f"note: {note}" for note in self.notes)
        first = TextTable.of_columns(title, columns, notes=notes, wrap=16)

        load_text = partial(to_text, unit=self.load_unit)
        measured, low, median, high = (
            [format_leakage(q, 1.0) for q in values] for values in (self.test.leakage, *self.curve)
        )
        steps, sealed = self.test.steps, self.test.sealed
        columns = [
            ("load", [load_text(step.pressure) for step in steps]),
            ("branch", [branch_text(step.unloaded_from, load_text) for step in steps]),
            (
                "measured",
                [f"{BELOW} " * s + q for s, q in zip(sealed.tolist(), measured, strict=True)],
            ),
            ("calibrated", median),
            (
                f"{100 * PROBABILITY:g} % band",
                [f"{a} to {b}" for a, b in zip(low, high, strict=True)],
            ),
        ]
        title = f"Leakage [{self.test.unit.name}]"
        return [first, TextTable.of_columns(title, columns, names=2)]

    def table(self) -> Any:
        """The tables for a terminal, to be given to `rich.print`."""
        from rich.console import Group

        return Group(*self.tables())

    def __repr__(self) -> str:
        texts = [
            f"{name.replace('_', ' ')} {_text(name, one.median)}"
            for name, one in self.posterior.items()
        ]
        return f"<femseal.Calibration: {', '.join(texts)}, by {counted(len(self.scenes), 'scene')}>"

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in self.tables())

    def write(self, folder: AnyPath) -> list[Path]:
        """Write `calibration.json`, `calibration.csv` and `calibration.png` into a folder, which is made if needed.

        Raises InputError: the folder cannot be written.
        """
        target = made_folder(folder)
        pairs = combinations(enumerate(UNITS), 2)
        estimates = {
            name: asdict(one) | {"prior": asdict(self.prior[name])}
            for name, one in self.posterior.items()
        }
        content = estimates | {
            "units": {name: unit or "1" for name, unit in UNITS.items()},
            "probability": PROBABILITY,
            "correlation": {
                f"{one}, {other}": self.correlation[a, b] for (a, one), (b, other) in pairs
            },
            "solid": self.solid,
            "error": self.density.error,
            "scenes": len(self.scenes),
            "curve": self.rows(),
            "notes": list(self.notes),
            "versions": versions(),
        }
        text = json.dumps(content, indent=1, ensure_ascii=False).replace("NaN", "null")
        with writing("output", target, "a folder"):
            picture = write_bytes(target / PICTURE, png(calibration_figure(self)))
            table = write_text(target / TABLE, comma_separated(self.rows()))
            return [write_text(target / FILE, text), table, picture]


def _text(name: str, value: float) -> str:
    return to_text(value, UNITS[name], 3) if UNITS[name] else f"{value:.3g}"


#: Units of the axes, by those in SI, and what is 1 in them.
_SCALES = {
    "Pa": ("MPa", 1e6),
    "N": ("kN", 1e3),
    "N/m": ("N/mm", 1e3),
    "m": ("µm", 1e-6),
    "": ("", 1.0),
}
#: Height of the axes [inch].
_HEIGHT = 3.6


@shows(Calibration)
def calibration_figure(found: Calibration) -> Figure:
    """Hardness against shortest wave and factor, then leakage against load, log scale."""
    test = found.test
    pressure, peaks = pressures_and_peaks(test.steps)
    order = np.argsort(np.where(np.isnan(peaks), pressure, -pressure))
    low, median, high = found.curve[:, order]
    unit, size = _SCALES[found.load_unit]
    curves = LeakageCurves(
        pressure[order],
        peaks[order],
        median,
        "",
        band=(low, high),
        band_name=f"band of {100 * PROBABILITY:g} %",
        scale=(1.0, f"leakage [{test.unit.name}]"),
        force=None if found.load_unit == "Pa" else (unit, 1 / size),
    )
    below = 0.75 + LEGEND_LINE * (len(curves.branches) + 2)
    sheet = Sheet([_HEIGHT, _HEIGHT, _HEIGHT + below])
    axes = sheet.panel(2, replace(LINES, top=0.15, bottom=below))
    kinds = (~test.sealed, "D", "measured"), (test.sealed, "v", "measured: sealed, or below this")
    measured = [
        axes.plot(pressure[rows] / size, test.leakage[rows], marker, color=GREY, label=label)[0]
        for rows, marker, label in kinds
    ]
    handles = leakage_panel(axes, curves, "calibrated, ")
    for row, name in enumerate(("shortest_wave", "factor")):
        _pair(sheet.panel(row, LINES), found, "hardness", name)
    legend_below(sheet.figure, [*handles, *measured])
    return sheet.figure


def _pair(axes: Axes, found: Calibration, across: str, up: str) -> None:
    """Samples of two quantities, with solved scenes where they have both, and the medians."""
    (x, x_size), (y, y_size) = (_SCALES[UNITS[name]] for name in (across, up))
    columns = [list(UNITS).index(name) for name in (across, up)]
    samples = found.samples[:, columns] / (x_size, y_size)
    axes.plot(*samples.T, ".", color=STYLES[0]["color"], ms=1.5, alpha=0.3, zorder=1)
    if up == "shortest_wave":
        scenes = found.scenes / (x_size, y_size)
        axes.plot(*scenes.T, "+", color=GREY, ms=6, label="solved scenes")
        axes.legend(loc="upper right", fontsize=8.5, frameon=False)
    axes.plot(*np.median(samples, axis=0), "o", color="black", ms=6)
    name = f"{up.replace('_', ' ')} [{y}]" if y else "factor between test and model"
    axes.set(xlabel=f"{across} [{x}]", ylabel=name)
    axes.set_title(f"correlation {found.correlation[tuple(columns)]:+.2f}", fontsize=9)
    axes.grid(alpha=0.25, lw=0.6)


def calibrated_text(data: dict[str, Any], base: Path, folder: Path, found: Calibration) -> str:
    """TOML of the tables of a case, whose files are relative to `base`, for a file in `folder`."""
    tables: dict[str, Any] = {name: _moved(value, base, folder) for name, value in data.items()}
    solid = dict(tables[found.solid])
    solid.pop("yield_stress", None)
    tables[found.solid] = solid | {"hardness": f"{found.hardness.median / 1e9:.5g} GPa"}
    tables["surface"] = tables.get("surface", {}) | {
        "shortest_wave": f"{found.shortest_wave.median * 1e6:.5g} um"
    }
    lines = [
        "# Hardness and shortest wave by a calibration with a leak test, medians of the posterior.",
        f"# The test leaked {found.factor.median:.3g} times as much as this case does.",
        *(f"{bare_key(name)} = {as_toml(value)}" for name, value in tables.items()),
    ]
    return "\n".join(lines) + "\n"


def _moved(value: Any, base: Path, folder: Path) -> Any:
    """A value with the names of files that are there, relative to another folder."""
    if isinstance(value, dict):
        return {key: _moved(inner, base, folder) for key, inner in value.items()}
    if isinstance(value, list):
        return [_moved(inner, base, folder) for inner in value]
    if isinstance(value, str):
        # "lay.vtu:name" is a field of a file
        for name in (value, value.rpartition(":")[0]):
            if name and (base / name).is_file():
                path = os.path.relpath(base / name, folder).replace(os.sep, "/")
                return path + value.removeprefix(name)
    return value
