"""Draw the leakage of a study or of a run against load."""

from __future__ import annotations

from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from ..base import Array, InputError
from ..base.leak_units import leakage_unit
from ..results.best_leakage import solved_studies
from ..results.leakage_format import class_unit, leakage_kind, leakage_label
from ..results.load_steps import AS_PRESSURES, load_format, pressures_and_peaks
from ..results.needed_pressure import LeakageCurve
from ..results.results import Results
from ..results.verdict import deciding_fluid
from ..studies import StochasticResult, SurfaceResult
from .drawing import LEGEND_LINE, LOADS, Sheet, figure_of, legend_below, shows
from .leakage_panels import COMMON_SCALE, LeakageCurves, leakage_panel, limits_width
from .style import styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INTERVAL = "95 % interval"
#: Height of the axes [inch].
_AXES_HEIGHT = 2.3


def _draw_curves(curves: LeakageCurves, ax: Axes | None, label: str | None) -> Figure:
    """Draw leakage curves into a new figure, or add them to existing axes."""
    if ax is not None:
        # all results in the same axes must have the same unit
        in_common_unit = replace(curves, scale=COMMON_SCALE, loads=AS_PRESSURES, limits={})
        leakage_panel(ax, in_common_unit, f"{label or curves.title}, ")
        ax.legend(framealpha=0.9, edgecolor="none", fontsize="small", handlelength=2.8)
        return figure_of(ax)
    n_entries = len(curves.branches) + len(curves.other_studies) + (curves.band is not None)
    legend_height = LEGEND_LINE * (ceil(n_entries / 2) + 1.1)
    margins = replace(
        LOADS,
        left=LOADS.left + 0.12 * curves.scale[1].count("\n"),
        right=LOADS.right + limits_width(curves.limits),
        bottom=LOADS.bottom + legend_height,
    )
    sheet = Sheet([_AXES_HEIGHT + margins.bottom + margins.top])
    handles = leakage_panel(sheet.panel(0, margins), curves)
    legend_below(sheet.figure, handles, title=label or curves.title)
    return sheet.figure


@shows(SurfaceResult)
def study_figure(study: SurfaceResult, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Draw the leakage of a surface against nominal pressure.

    Parameters
    ----------
    study : SurfaceResult
        Result of a study that solves a surface, such as `FaceResult`.
    ax : Axes, optional
        Axes to draw into; by default, a new figure is made.
    label : str, optional
        Name of the study in the legend.

    Returns
    -------
    Figure
    """
    pressure, peaks = pressures_and_peaks(study.steps)
    scale = _readable_scale(study.leakage)
    curves = LeakageCurves(
        pressure=pressure, peaks=peaks, leakage=study.leakage, title=study.method, scale=scale
    )
    return _draw_curves(curves, ax, label)


@shows(StochasticResult)
def realisations_figure(
    study: StochasticResult, ax: Axes | None = None, label: str | None = None
) -> Figure:
    """Draw the median leakage of the realisations against nominal pressure.

    If the study has enough realisations, the area between the 5 % and the 95 % quantile of their leakages is shaded.

    Parameters
    ----------
    study : StochasticResult
        Result of a stochastic study.
    ax : Axes, optional
        Axes to draw into; by default, a new figure is made.
    label : str, optional
        Name of the study in the legend.

    Returns
    -------
    Figure
    """
    low, high = 0.05, 0.95
    band = None
    if not study.has_too_few_for(low, high):
        band = study.quantile(low), study.quantile(high)
    median = study.quantile(0.5)
    pressure, peaks = pressures_and_peaks(study.steps)
    curves = LeakageCurves(
        pressure=pressure,
        peaks=peaks,
        leakage=median,
        title="median of the realisations",
        band=band,
        band_name=_scatter_name(low, high),
        scale=_readable_scale(median),
    )
    return _draw_curves(curves, ax, label)


@shows(Results)
def leakage_figure(results: Results, ax: Axes | None = None, label: str | None = None) -> Figure:
    """Draw the magnitude of the leakage of a run against load.

    The load axis shows forces if the loads of the case are forces, and nominal pressures otherwise. Loads without
    leakage are marked in a strip at the bottom of the axes. The shaded area is the 95 % interval. If the run has no
    error budget, the shaded area is the scatter between the realisations.

    Parameters
    ----------
    results : Results
        Results of a run.
    ax : Axes, optional
        Axes to draw into, so that several runs can be compared in one figure; the load axis then shows nominal
        pressures. By default, a new figure is made.
    label : str, optional
        Name of the run in the legend.

    Returns
    -------
    Figure
    """
    return _draw_curves(leakage_curves(results), ax, label)


def leakage_curves(results: Results) -> LeakageCurves:
    """Collect the leakages, intervals and class limits that the leakage figure of a run shows."""
    data = results.dataset
    budget = results.budget
    band = None
    band_name = _INTERVAL
    if budget is not None:
        band = budget.lower, budget.upper
    elif "leakage_lower" in data:
        low, high = data["leakage_lower"], data["leakage_upper"]
        band = low.values, high.values
        band_name = _scatter_name(low.attrs["quantile"], high.attrs["quantile"])
    other_studies = [
        (study, data[study.leakage_variable].values)
        for study in solved_studies(data)
        if study is not results.best_study and not study.has_realisations
    ]
    # if there is a test fluid, the limits apply to its leakage, which is not in this picture
    limits = {} if "test_leakage" in data else _class_limits(data)
    return LeakageCurves(
        pressure=data["nominal_pressure"].values,
        peaks=data["unloaded_from"].values,
        leakage=results.leakage.values,
        title=_method_title(results),
        band=band,
        band_name=band_name,
        other_studies=other_studies,
        limits=limits,
        scale=_run_scale(results),
        loads=load_format(data),
    )


@styled
def leak_test_figure(results: Results) -> Figure:
    """Draw the leakage of the test fluid against load, with its 95 % interval and the limits of the leakage classes.

    Parameters
    ----------
    results : Results
        Results of a case with a test fluid.

    Returns
    -------
    Figure

    Raises
    ------
    InputError
        The case has no test fluid.
    """
    data = results.dataset
    if "test_leakage" not in data:
        given = "results without a test fluid"
        raise InputError("leak test figure", given, "results of a case with output.test_fluid")
    curve = LeakageCurve.of_results(results)
    unit = class_unit(results)
    is_known = ~results.has_failed
    band = None
    if curve.has_interval:
        band = curve.lower, np.where(is_known, curve.upper, np.nan)
    axis_name = f"{leakage_kind(unit)} [{unit.name}]\ntest with {deciding_fluid(results)}"
    curves = LeakageCurves(
        pressure=data["nominal_pressure"].values,
        peaks=data["unloaded_from"].values,
        leakage=np.where(is_known, results.class_leakage[0], np.nan),
        title=_method_title(results),
        band=band,
        band_name=_INTERVAL,
        limits=_class_limits(data),
        scale=(results.class_basis.factor(unit), axis_name),
        loads=load_format(data),
    )
    return _draw_curves(curves, None, None)


def _class_limits(data: xarray.Dataset) -> dict[str, float]:
    """Return the limits [m²/s] of the leakage classes of a run, keyed by class name."""
    if "leak_class" not in data.coords:
        return {}
    return dict(zip(data["leak_class"].values, data["class_limit"].values, strict=True))


def _method_title(results: Results) -> str:
    """Return the name of the method used to compute the leakage of the main curve."""
    return results.best_study.title


def _scatter_name(low: float, high: float) -> str:
    """Return a legend text for the area between two quantiles of the leakage of the realisations."""
    return f"scatter between seals,\n{100 * low:g} – {100 * high:g} %"


def _readable_scale(leakage: Array) -> tuple[float, str]:
    """Choose a readable unit for leakages [m²/s]; return the unit in m²/s and the name of the leakage axis."""
    factor, unit = leakage_unit(leakage)
    return factor, f"leakage per length of seal [{unit}]"


def _run_scale(results: Results) -> tuple[float, str]:
    """Return the leakage unit of a run in m²/s and the name of the leakage axis.

    If the leakage is the volume flow rate of a gas, the name of the axis states the pressure to which the volume
    refers. If the fluid flows from the outlet to the inlet, the name of the axis states this direction.
    """
    unit, factor = results.leak_scale
    attrs = results.dataset.attrs
    notes = []
    if results.leak_basis.is_gas and unit.kind == "volume":
        notes.append("gas at 101 325 Pa")
    if attrs["outlet_pressure_Pa"] > attrs["inlet_pressure_Pa"]:
        notes.append("from outlet to inlet")
    name = f"{leakage_label(results).rstrip(',')} [{unit.name}]"
    if notes:
        name += "\n" + ", ".join(notes)
    return factor, name
