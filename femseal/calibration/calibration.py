"""Store the result of a calibration, and show it in tables, files and a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
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
    finite_data,
    made_folder,
    number_text,
    rows_of,
    to_text,
    versions,
    write_text,
    writing,
)
from ..case.case import Case
from ..plots.drawing import LEGEND_LINE, LINES, LOADS, Sheet, add_grid, legend_below, shows
from ..plots.leakage_panels import LeakageCurves, leakage_panel
from ..plots.style import GREY, STYLES, write_figure
from ..results.leakage_format import format_leakage
from ..results.load_steps import AS_PRESSURES, LoadFormat, branch_text, pressures_and_peaks
from .leak_test import BELOW_LIMIT, LeakTest
from .posterior import PROBABILITY, QUANTITY_UNITS, Estimate, Posterior

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RESULT_FILE, CSV_FILE, PICTURE_FILE = "calibration.json", "calibration.csv", "calibration.png"
#: A sample counts as lying at an end of a range if its distance from the end is below this fraction of the length of
#: the range, in logarithms.
_END_OF_RANGE = 0.03
#: The range may be too narrow if more than this fraction of the samples lies at one of its ends.
_MANY_SAMPLES = 0.1
#: The model does not fit if the root mean square of the standardised residuals is above this value.
_LARGE_MISFIT = 2.0
#: Unit of an axis for each SI unit, and the value of this unit in SI.
_AXIS_UNITS = {
    "Pa": ("MPa", 1e6),
    "N": ("kN", 1e3),
    "N/m": ("N/mm", 1e3),
    "m": ("µm", 1e-6),
    "": ("", 1.0),
}
#: Height of the axes of the picture [inch].
_AXES_HEIGHT = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Plotted):
    """Result of a calibration, see `calibrate`.

    Parameters
    ----------
    hardness, shortest_wave, factor : Estimate
        Median and interval of the hardness [Pa], of the shortest wave [m], and of the ratio of measured to computed
        leakage.
    prior : dict of Estimate
        Median and range of the prior of each quantity, by its name.
    correlation : array (3, 3)
        Correlation matrix of ln(hardness), ln(shortest wave) and ln(factor) in the posterior.
    samples : array (n, 3)
        Samples of hardness, shortest wave and factor from the posterior, in SI units.
    density : Posterior
        Posterior density.
    load_unit : str
        SI unit of the loads.
    curve : array (3, rows)
        Calibrated leakage at the load of each row of the test, in the unit of the test, and 0 where the seal is sealed.
        The three rows are the lower end of the interval, the median, and the upper end.
    scenes : array (n, 2)
        Hardness [Pa] and shortest wave [m] of the simulations.
    leakages : array (n, loads)
        Leakages of the simulations in the unit of the test.
    solid : str
        Name of the table of the case that contains the calibrated hardness, "material" or "counter_material".
    notes : tuple of str
        Sentences that warn of an unreliable result, for example if a range is too narrow.
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
    def from_posterior(
        cls, posterior: Posterior, cube: Array, scenes: Array, leakages: Array, case: Case
    ) -> Calibration:
        """Make a calibration from samples of its posterior.

        Parameters
        ----------
        posterior : Posterior
            The posterior.
        cube : array (n, 3)
            Samples of the posterior in the unit cube.
        scenes, leakages : array
            Hardness and shortest wave of the simulations, and leakages of the simulations, see `Calibration`.
        case : Case
            The case, with the loads of the test.
        """
        samples = posterior.quantities(cube)
        estimates = {
            name: Estimate.from_samples(samples[:, n]) for n, name in enumerate(QUANTITY_UNITS)
        }
        # In the unit cube, the prior of each quantity is uniform from 0 to 1, with the median 0.5. The three points of
        # the unit cube are the medians, the lower ends and the upper ends, in the order of the fields of `Estimate`.
        cube_of_prior = np.array([[0.5] * 3, [0.0] * 3, [1.0] * 3])
        median_low_high = posterior.quantities(cube_of_prior)  # (field of `Estimate`, quantity)
        prior = {
            name: Estimate(*map(float, median_low_high[:, n]))
            for n, name in enumerate(QUANTITY_UNITS)
        }
        curve = _calibrated_curve(posterior, cube)
        notes = _notes_on_ranges(cube) + _notes_on_fit(posterior, cube, curve[1])
        return cls(
            **estimates,
            prior=prior,
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
        """Median and interval of hardness, shortest wave and factor in the posterior, by name."""
        return {name: getattr(self, name) for name in QUANTITY_UNITS}

    def rows(self) -> list[dict[str, Any]]:
        """List the load and the measured and calibrated leakage of each row of the test, in the unit of the test."""
        pressures, peaks = pressures_and_peaks(self.test.steps)
        low, median, high = self.curve
        unit = self.test.unit.name
        columns = {
            f"load [{self.load_unit}]": pressures,
            f"unloaded from [{self.load_unit}]": peaks,
            "sealed or below": self.test.sealed,
            f"measured [{unit}]": self.test.leakage,
            f"calibrated [{unit}]": median,
            f"lower [{unit}]": low,
            f"upper [{unit}]": high,
        }
        return rows_of(columns)

    def tables(self) -> list[TextTable]:
        """Make two tables for `rich.print`: the calibrated quantities, and the measured and calibrated leakages."""
        return [self._table_of_quantities(), self._table_of_leakages()]

    def _table_of_quantities(self) -> TextTable:
        """Make the table of priors, posteriors and correlations."""
        posterior = self.posterior
        columns = [
            ("", [_plain_name(name) for name in QUANTITY_UNITS]),
            ("prior", [_interval_text(name, self.prior[name]) for name in QUANTITY_UNITS]),
            ("posterior", [_value_text(name, posterior[name].median) for name in QUANTITY_UNITS]),
            (_interval_name(), [_interval_text(name, posterior[name]) for name in QUANTITY_UNITS]),
        ]
        for name, coefficients in zip(QUANTITY_UNITS, self.correlation, strict=True):
            head = f"correlation with {_plain_name(name)}"
            columns.append((head, [f"{coefficient:+.2f}" for coefficient in coefficients]))
        n_measured = counted(len(self.test.steps), "measured leakage")
        title = f"Calibration by {n_measured} and {counted(len(self.scenes), 'simulation')}"
        notes = tuple(f"note: {note}" for note in self.notes)
        return TextTable.of_columns(title, columns, notes=notes, wrap=16)

    def _table_of_leakages(self) -> TextTable:
        """Make the table of measured and calibrated leakages."""
        load_text = partial(to_text, unit=self.load_unit)
        steps = self.test.steps
        measured = []
        for leakage, is_sealed in zip(self.test.leakage, self.test.sealed, strict=True):
            text = format_leakage(leakage, 1.0)
            measured.append(f"{BELOW_LIMIT} {text}" if is_sealed else text)
        low, median, high = ([format_leakage(q, 1.0) for q in values] for values in self.curve)
        intervals = [f"{start} to {end}" for start, end in zip(low, high, strict=True)]
        columns = [
            ("load", [load_text(step.pressure) for step in steps]),
            ("branch", [branch_text(step.unloaded_from, load_text) for step in steps]),
            ("measured", measured),
            ("calibrated", median),
            (_interval_name(), intervals),
        ]
        return TextTable.of_columns(f"Leakage [{self.test.unit.name}]", columns, names=2)

    def table(self) -> Any:
        """Return an object with the two tables of `tables`, which `rich.print` displays in a terminal."""
        from rich.console import Group

        return Group(*self.tables())

    def __repr__(self) -> str:
        texts = [
            f"{_plain_name(name)} {_value_text(name, estimate.median)}"
            for name, estimate in self.posterior.items()
        ]
        return f"<femseal.Calibration: {', '.join(texts)}, by {counted(len(self.scenes), 'simulation')}>"

    def _repr_html_(self) -> str:
        return "".join(table._repr_html_() for table in self.tables())

    def write(self, folder: AnyPath, formats: Sequence[str] = ("png",)) -> list[Path]:
        """Write `calibration.json`, `calibration.csv` and the picture, `calibration.png`.

        Parameters
        ----------
        folder : path
            Folder to write into, which is created if it does not exist.
        formats : sequence of {"png", "svg", "pdf"}
            Formats of the picture.

        Returns
        -------
        list of Path
            Paths of the written files.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        target = made_folder(folder)
        estimates = {
            name: asdict(estimate) | {"prior": asdict(self.prior[name])}
            for name, estimate in self.posterior.items()
        }
        correlations = {
            f"{first}, {second}": self.correlation[i, j]
            for (i, first), (j, second) in combinations(enumerate(QUANTITY_UNITS), 2)
        }
        content = estimates | {
            "units": {name: unit or "1" for name, unit in QUANTITY_UNITS.items()},
            "probability": PROBABILITY,
            "correlation": correlations,
            "solid": self.solid,
            "error": self.density.error,
            "scenes": len(self.scenes),
            "curve": self.rows(),
            "notes": list(self.notes),
            "versions": versions(),
        }
        text = json.dumps(finite_data(content), indent=1, ensure_ascii=False)
        with writing("output", target, "a folder"):
            written = [write_text(target / CSV_FILE, comma_separated(self.rows()))]
            stem = Path(PICTURE_FILE).stem
            written += write_figure(calibration_figure(self), target, stem, formats)
            # written last, because it marks a finished calibration
            return [write_text(target / RESULT_FILE, text), *written]


def _calibrated_curve(posterior: Posterior, cube: Array) -> Array:
    """Compute the calibrated leakage for each row of the test, with its interval.

    The error of the surrogate is included: for each sample of the posterior, a random leakage is drawn from the
    distribution that the surrogate predicts.

    Returns the lower end of the interval, the median and the upper end, array (3, rows); 0 where the case is sealed.
    """
    prediction = posterior.predict(cube)
    rng = np.random.default_rng(2)
    scores = rng.standard_normal((len(cube), 1))  # the same for all rows of a sample
    leakage = np.exp(prediction.mean + prediction.deviation * scores)
    leakage = np.where(rng.random((len(cube), 1)) < prediction.is_open, leakage, 0.0)
    probabilities = 0.5 - PROBABILITY / 2, 0.5, 0.5 + PROBABILITY / 2
    return np.asarray(np.quantile(leakage, probabilities, axis=0, method="nearest"))


def _notes_on_ranges(cube: Array) -> list[str]:
    """Make a note for each range that may be too narrow because many samples lie at one of its ends.

    cube : samples in the unit cube (n, 3).
    """
    notes = []
    for n, name in enumerate(QUANTITY_UNITS):
        is_at_end = {"lower": cube[:, n] < _END_OF_RANGE, "upper": cube[:, n] > 1 - _END_OF_RANGE}
        for end, is_there in is_at_end.items():
            if is_there.mean() > _MANY_SAMPLES:
                notes.append(
                    f"the {_plain_name(name)} may lie beyond the {end} end of its range, where many samples are: "
                    "give it a wider range"
                )
    return notes


def _notes_on_fit(posterior: Posterior, cube: Array, median: Array) -> list[str]:
    """Make notes if the calibrated leakage does not fit the test, or if the surrogate is too inaccurate.

    cube : samples of the posterior in the unit cube (n, 3).
    median : median of the calibrated leakage (rows,).
    """
    notes = []
    test = posterior.test
    both_leak = ~test.sealed & (median > 0)
    surrogate_error = np.median(posterior.predict(cube).deviation, axis=0)[both_leak]
    residuals = np.log(test.leakage[both_leak] / median[both_leak])
    standardised = residuals / np.hypot(posterior.error, surrogate_error)
    misfit = np.sqrt(np.mean(standardised**2))
    if not misfit < _LARGE_MISFIT:
        notes.append(
            f"the model does not fit the test: the differences are {misfit:.2g} times the error (root mean square)"
        )
    n_sealed = int((~test.sealed & (median == 0)).sum())
    if n_sealed:
        rows = counted(n_sealed, "row")
        notes.append(f"the calibrated case is sealed in {rows} in which the test leaks")
    largest_error = surrogate_error.max(initial=0.0)
    if largest_error > posterior.error:
        notes.append(
            "the interpolation between simulations has an error of "
            f"{number_text(100 * largest_error, 2)} % at some load, more than the test: increase --scenes"
        )
    return notes


def _plain_name(name: str) -> str:
    """Return the name of a quantity with spaces in place of underscores."""
    return name.replace("_", " ")


def _value_text(name: str, value: float) -> str:
    """Return the value of a quantity as text with its unit."""
    return to_text(value, QUANTITY_UNITS[name], 3) if QUANTITY_UNITS[name] else f"{value:.3g}"


def _interval_text(name: str, estimate: Estimate) -> str:
    """Return the interval of a quantity as text, such as "2 GPa to 3 GPa"."""
    return f"{_value_text(name, estimate.lower)} to {_value_text(name, estimate.upper)}"


def _interval_name() -> str:
    """Name the intervals of the posterior, such as "90 % interval"."""
    return f"{100 * PROBABILITY:g} % interval"


# --- the picture ------------------------------------------------------------------------------------------


@shows(Calibration)
def calibration_figure(calibration: Calibration) -> Figure:
    """Plot samples of the posterior, and plot the measured and the calibrated leakage against the load.

    The first two panels show the shortest wave and the factor of the samples as a function of the hardness.
    """
    test = calibration.test
    pressure, peaks = pressures_and_peaks(test.steps)
    unit, unit_in_si = _AXIS_UNITS[calibration.load_unit]
    loads = AS_PRESSURES
    if calibration.load_unit != "Pa":
        loads = LoadFormat(unit, 1 / unit_in_si)
    # the rows on unloading in falling order of the pressure, then the rows on loading in rising order
    order = np.argsort(np.where(np.isnan(peaks), pressure, -pressure))
    low, median, high = calibration.curve[:, order]
    curves = LeakageCurves(
        pressure=pressure[order],
        peaks=peaks[order],
        leakage=median,
        title="",
        band=(low, high),
        band_name=_interval_name(),
        scale=(1.0, f"leakage [{test.unit.name}]"),
        loads=loads,
    )
    # the legend has a line for each branch, for the interval, and for each of two kinds of measured points
    legend_height = LEGEND_LINE * (len(curves.branches) + 3)
    load_margins = replace(LOADS, bottom=LOADS.bottom + legend_height)
    sheet = Sheet(
        [_AXES_HEIGHT + margins.bottom + margins.top for margins in (LINES, LINES, load_margins)]
    )
    _draw_samples(sheet.panel(0, LINES), calibration, "shortest_wave")
    _draw_samples(sheet.panel(1, LINES), calibration, "factor")
    axes = sheet.panel(2, load_margins)
    measured = []
    # the rows of the test, the marker and the label of both kinds of measured points
    kinds = (
        (~test.sealed, "D", "measured"),
        (test.sealed, "v", "measured: sealed, or below this"),
    )
    for rows, marker, label in kinds:
        load = pressure[rows] / unit_in_si
        (points,) = axes.plot(load, test.leakage[rows], marker, color=GREY, label=label)
        measured.append(points)
    handles = leakage_panel(axes, curves, "calibrated, ")
    legend_below(sheet.figure, [*handles, *measured], columns=1)
    return sheet.figure


def _draw_samples(axes: Axes, calibration: Calibration, name: str) -> None:
    """Draw the samples of the posterior, and their median, with the hardness on the horizontal axis.

    `name` is the name of the quantity on the vertical axis. If `name` is "shortest_wave", the hardness and the shortest
    wave of the simulations are drawn as well.
    """
    names = list(QUANTITY_UNITS)
    columns = [names.index("hardness"), names.index(name)]
    hardness_unit, hardness_in_si = _AXIS_UNITS[QUANTITY_UNITS["hardness"]]
    unit, unit_in_si = _AXIS_UNITS[QUANTITY_UNITS[name]]
    units_in_si = (hardness_in_si, unit_in_si)
    samples = calibration.samples[:, columns] / units_in_si
    axes.plot(*samples.T, ".", color=STYLES[0]["color"], ms=1.5, alpha=0.3, zorder=1)
    if name == "shortest_wave":
        scenes = calibration.scenes / units_in_si
        axes.plot(*scenes.T, "+", color=GREY, ms=4, label="simulations")
        axes.legend(loc="upper right")
    axes.plot(*np.median(samples, axis=0), "o", color="black", ms=4)
    axes.set_xlabel(f"hardness [{hardness_unit}]")
    axes.set_ylabel(f"{_plain_name(name)} [{unit}]" if unit else "factor between test and model")
    correlation = calibration.correlation[columns[0], columns[1]]
    text = f"correlation {correlation:+.2f}"
    axes.annotate(text, (0.03, 0.04), xycoords="axes fraction", fontsize=7)
    add_grid(axes)
