"""Variables of the dataset, each declared once with its name, unit, meaning and dimensions.

Fields of the studies' results declare them in their metadata; variables computed from several fields, here. A
variable over the steps is a column of the table, with a heading also of the table for people; one over the windows is
an array of the seal in ParaView.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.leak_units import LEAK_UNITS, LeakBasis
from ..flow import critical_constriction
from ..fluids import capillary_entry_pressure
from ..loads import LoadStep
from ..seal import NARROWEST, RectangularSeal, drop_shares
from ..studies.fluid_load import relief_warning, relieved_leakage

if TYPE_CHECKING:
    import xarray

    from ..library import LibraryTable
    from ..studies import DeterministicResult, Scene, StochasticResult, TwoScaleResult

_SUFFIXES = {
    "m": "m",
    "m^2/s": "m2_per_s",
    "m^3": "m3",
    "Pa": "Pa",
    "1": "",
    "m^3/s": "m3_per_s",
    "kg/s": "kg_per_s",
    "Pa*m^3/s": "Pa_m3_per_s",
}


def name_with_unit(variable: xarray.DataArray, name: str | None = None) -> str:
    """Name of a variable with its SI unit in ASCII letters, such as "leakage_mean_m2_per_s"."""
    return "_".join(filter(None, (name or str(variable.name), _SUFFIXES[variable.attrs["units"]])))


def _labels(unit: str, long_name: str, heading: str = "") -> dict[str, str]:
    return {"units": unit, "long_name": long_name} | ({"heading": heading} if heading else {})


def step_coordinates(dim: str, prefix: str, steps: Sequence[LoadStep]) -> dict[str, Any]:
    """Coordinates that describe the load steps along a dimension; `prefix` is prepended to their names."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    columns = {
        dim: (np.arange(len(steps)), "1", "index of the load step"),
        f"{prefix}branch": ([s.branch for s in steps], "1", "branch of the load cycle"),
        f"{prefix}nominal_pressure": ([float(s.pressure) for s in steps], "Pa", "nominal pressure"),
        f"{prefix}unloaded_from": (peaks, "Pa", "nominal pressure from which the step is unloaded"),
        f"{prefix}name": ([s.name for s in steps], "1", "name of the load step"),
    }
    return {name: (dim, values, _labels(unit, text)) for name, (values, unit, text) in columns.items()}


def add_fields(data: xarray.Dataset, result: Any, prefix: str = "") -> None:
    """Add every field of a result whose metadata names its dimensions, except the large ones over all pixels.

    prefix : of the names.
    """
    for f in fields(result):
        values, dims = getattr(result, f.name), f.metadata.get("dims", ())
        if dims and "x1" not in dims and values is not None and values.size:
            attrs = _labels(f.metadata["unit"], f.metadata["long_name"], f.metadata["heading"])
            data[prefix + (f.metadata["name"] or f.name)] = (dims, values, attrs)


def add_windows(data: xarray.Dataset, scene: Scene, result: TwoScaleResult) -> None:
    """Add fields of the windows and of the nodes, the flux through the links, and the shares of the pressure drop."""
    (m1, m2), (d1, d2) = result.partition.cells, result.partition.window_size
    data.coords["cell1"] = ("cell1", (np.arange(m1) + 0.5) * d1, _labels("m", "x1 of window centres, from the inlet"))
    data.coords["cell2"] = ("cell2", (np.arange(m2) + 0.5) * d2, _labels("m", "x2 of window centres, along the seal"))
    rows = np.array(result.partition.node_rows)
    data.coords["node1"] = ("node1", rows, _labels("m", "x1 of the global nodes"))
    if m1 > 1:
        data.coords["corner1"] = ("corner1", rows[1:-1], _labels("m", "x1 of links along x2"))
    add_fields(data, result)
    if result.k1 is None or result.k2 is None or result.fluid_pressure is None:
        return
    # the fluid pressure in a pocket is undefined, and its flux is 0
    pocket = np.isnan(result.fluid_pressure) & np.isfinite(result.leakage)[:, None, None]
    pressure = np.where(pocket, scene.outlet_pressure, result.fluid_pressure)
    potential = scene.fluid.potential(pressure) / scene.fluid.reference_density
    along = result.k1 * (potential[:, :-1] - potential[:, 1:]) / np.diff(rows)[:, None]
    text = "flow per width through links along"
    data["flux1"] = (("step", "cell1", "cell2"), along, _labels("m^2/s", f"{text} x1"))
    if m1 > 1:
        across = result.k2 * (potential - np.roll(potential, -1, axis=2))[:, 1:-1] / d2
        data["flux2"] = (("step", "corner1", "cell2"), across, _labels("m^2/s", f"{text} x2"))
    seal = RectangularSeal(scene.surface.size, (m1, m2), result.partition.node_rows)
    shares = np.full((len(result.steps), len(NARROWEST)), np.nan)
    for s in np.flatnonzero(np.isfinite(result.fluid_pressure[:, 0]).all(axis=1)):  # NaN where a link failed
        shares[s] = drop_shares(result.k1[s], result.k2[s], seal, potential[s])
    data.coords["narrowest"] = ("narrowest", list(NARROWEST), _labels("1", "number of links that dissipate most"))
    text = "share of the pressure drop over the links that dissipate most, NaN without flow"
    data["drop_fraction"] = (("step", "narrowest"), shares, _labels("1", text))


def add_realisations(data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]) -> None:
    """Add the leakage of every realisation, and its quantiles, mean and spread."""
    add_fields(data, result)
    data.coords["realisation"] = ("realisation", np.arange(len(result.leakage)), _labels("1", "realisation"))
    text = "leakage per unit seal length, {} of the realisations"
    for name, q in (("median", 0.5), ("lower", quantiles[0]), ("upper", quantiles[1])):
        labels = _labels("m^2/s", text.format(name if name == "median" else f"{name} quantile {q:g}"))
        data[f"leakage_{name}"] = ("step", result.quantile(q), labels | {"quantile": q})
        if name != "median" and result.leakage_resampled is not None:
            labels = _labels("m^2/s", labels["long_name"] + " with the error of the finite library")
            data[f"leakage_{name}_together"] = ("step", result.quantile(q, resampled=True), labels | {"quantile": q})
    data["leakage_mean"] = ("step", result.mean, _labels("m^2/s", text.format("mean")))
    spread, error = result.realisation_spread, result.library_error
    data["realisation_spread"] = ("step", spread, _labels("1", "standard deviation of ln(leakage), realisations"))
    if result.leakage_resampled is not None:
        data["library_error"] = ("step", error, _labels("1", "standard deviation of ln(leakage), finite library"))
    if result.cut_error is not None:
        text = "half the distance of ln(leakage) with Dirichlet and with Neumann cuts between runs"
        data["cut_error"] = ("step", result.cut_error, _labels("1", text))
    text = "share of the realisations without leakage"
    data["sealed_fraction"] = ("step", result.sealed_fraction, _labels("1", text, "sealed [%]"))


def add_lengths(data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]) -> None:
    """Add median and bands of the leakage of seals of all lengths that were drawn, if there are several."""
    if not result.other_lengths:
        return
    every = (result, *result.other_lengths)
    lengths = np.array([seals.seal.size[1] for seals in every])
    data.coords["seal_length"] = ("seal_length", lengths, _labels("m", "length of drawn seals"))
    kinds = {"median": (0.5, False)} | {
        f"{name}{end}": (q, resampled)
        for end, resampled in (("", False), ("_together", True))
        for name, q in zip(("lower", "upper"), quantiles, strict=True)
        if not resampled or result.leakage_resampled is not None
    }
    for name, (q, resampled) in kinds.items():
        values = np.array([seals.quantile(q, resampled=resampled) for seals in every])
        text = (
            f"leakage per unit seal length, {name.split('_')[0] if name == 'median' else f'quantile {q:g}'} by length"
        )
        text += " with the error of the finite library" if resampled else ""
        data[f"leakage_of_lengths_{name}"] = (("seal_length", "step"), values, _labels("m^2/s", text) | {"quantile": q})
    sealed = np.array([seals.sealed_fraction for seals in every])
    labels = _labels("1", "share of the realisations without leakage by length")
    data["sealed_fraction_of_lengths"] = (("seal_length", "step"), sealed, labels)


def add_filtered(data: xarray.Dataset, leakage: np.ndarray) -> None:
    """Add the leakage of the face without waves up to twice the shortest one."""
    text = "leakage per unit seal length, of the face without waves up to twice the shortest"
    data["leakage_filtered"] = ("step", leakage, _labels("m^2/s", text, "twice the wave"))


def add_lifted(data: xarray.Dataset, scene: Scene, leakage: xarray.DataArray) -> str:
    """Add an estimate of the leakage with the part of the load that the fluid carries, where that is much; see it."""
    told = relief_warning(scene, leakage.values)
    if told:
        text = "leakage per unit seal length, estimate if the fluid carries its part of the load, NaN below all steps"
        data["leakage_lifted"] = ("step", relieved_leakage(scene, leakage.values), _labels("m^2/s", text))
    return told


def add_entry_pressure(data: xarray.Dataset, scene: Scene, study: DeterministicResult | TwoScaleResult | None) -> None:
    """Add the capillary entry pressure of the critical constriction, of a liquid that does not wet the faces."""
    if study is None or np.isnan(capillary_entry_pressure(scene.fluid, 1.0)):
        return
    spacing = scene.surface.spacing
    found = (critical_constriction(np.maximum(gap, 0.0), spacing, sides="periodic") for gap in study.gap)
    pressures = [capillary_entry_pressure(scene.fluid, 0.0 if c is None else c.gap) for c in found]
    text = "pressure below which the liquid does not enter the critical constriction, inf where it is closed"
    data["capillary_entry_pressure"] = ("step", pressures, _labels("Pa", text))


def add_library(data: xarray.Dataset, curves: LibraryTable) -> None:
    """Add the curves of the cells of the library over the steps of the library."""
    for name, entry in step_coordinates("library_step", "library_", curves.steps).items():
        data.coords[name] = entry
    cells = np.arange(len(curves.k))
    data.coords["library_cell"] = ("library_cell", cells, _labels("1", "number of the library cell"))
    for f in fields(curves):
        if f.name != "steps":
            labels = _labels(f.metadata["unit"], f.metadata["long_name"])
            data[f"library_{f.name}"] = (("library_cell", "library_step"), getattr(curves, f.name), labels)


def add_totals(data: xarray.Dataset, leakage: xarray.DataArray, basis: LeakBasis) -> None:
    """Add the best leakage of the whole seal by volume, mass and, for a gas, pressure × volume; and in more units."""
    whole = f"leakage of the whole seal, {leakage.attrs['long_name'].rpartition(', ')[2]}"
    at = "" if basis.temperature is None else f" at {basis.temperature:g} K"
    stated = "" if basis.stated_temperature is None else f" at {basis.stated_temperature:g} K"
    for name, unit, si, text in (
        ("leakage_total", "m³/s", "m^3/s", f"{whole}, by volume{at and f'{at} and {basis.pressure:g} Pa'}"),
        ("leakage_total_mass", "kg/s", "kg/s", f"{whole}, by mass"),
        ("leakage_total_throughput", "Pa·m³/s", "Pa*m^3/s", f"{whole}, pressure × volume{stated}"),
    ):
        if basis.has(LEAK_UNITS[unit]):
            data[name] = ("step", leakage.values / basis.factor(LEAK_UNITS[unit]), _labels(si, text))
    told = basis.units()
    data.coords["leak_unit"] = ("leak_unit", [unit.name for unit in told], _labels("1", "unit of leakage"))
    values = np.array([leakage.values / basis.factor(unit) for unit in told])
    data["leakage_in_units"] = (("leak_unit", "step"), values, _labels("1", f"leakage in units of leak_unit{stated}"))


def add_contact_share(
    data: xarray.Dataset,
    scene: Scene,
    deterministic: DeterministicResult | None,
    two_scale: TwoScaleResult | None,
    stochastic: StochasticResult | None,
) -> None:
    """Add the share of the face in contact at every step, from the windows, the whole face, or the library."""
    if two_scale is not None:
        share, origin = two_scale.contact_fraction.mean(axis=(1, 2)), "windows"
    elif deterministic is not None:
        share, origin = deterministic.contact_fraction, "deterministic"
    elif stochastic is not None and set(scene.steps) <= set(stochastic.library.curves.steps):
        curves = stochastic.library.curves
        share = np.nanmean(curves.contact_fraction[:, [curves.steps.index(s) for s in scene.steps]], axis=0)
        origin = "library"
    else:
        return
    data["contact_share"] = ("step", share, _labels("1", f"share of the face in contact, {origin}", "contact [%]"))
