"""Results of a case: one labelled dataset, saved as netCDF and read again by any tool that reads netCDF."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.files import made_folder, replacing_hdf5
from ..base.machine import machine, peak_memory
from ..base.provenance import versions
from ..base.text import Plotted, room
from ..loads import LoadProgramme, LoadStep
from ..seal import NARROWEST, RectangularSeal, drop_shares
from . import fields as stitched
from . import select, summary, tables

if TYPE_CHECKING:
    import xarray
    from rich.table import Table

    from ..scales import LibraryTable
    from ..studies import DeterministicResult, Scene, StochasticResult, TwoScaleResult

Array = NDArray[np.float64]
FILE_NAME = "results.nc"
#: An attribute of an HDF5 file holds at most 64 kB.
_ATTRIBUTE_BYTES = 50_000
#: Names in the dataset of the results' fields; the stitched fields (step, x1, x2) are left out, being large.
_TWO_SCALE = {
    "leakage": "leakage_two_scale",
    "k1": "k1",
    "k2": "k2",
    "pressure": "window_pressure",
    "mean_gap": "window_mean_gap",
    "contact_fraction": "window_contact_fraction",
    "plastic_fraction": "window_plastic_fraction",
    "fluid_pressure": "fluid_pressure",
}
_DETERMINISTIC = {
    "leakage": "leakage_deterministic",
    "contact_fraction": "contact_fraction_deterministic",
    "plastic_fraction": "plastic_fraction_deterministic",
    "mean_gap": "mean_gap_deterministic",
}
#: Best first: method, its leakage in the dataset.
_METHODS = (
    ("median", "leakage_median"),
    ("two-scale", "leakage_two_scale"),
    ("deterministic", "leakage_deterministic"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Results(Plotted):
    """What came out of a case.

    dataset : every number with its unit, see `assemble`. folder : where it was read from or saved to.
    scene : what was studied; deterministic, two_scale, stochastic : the results of the studies with the fields that are
    too large for the dataset. None if not run, or read from a folder.
    """

    dataset: xarray.Dataset
    folder: Path | None = None
    scene: Scene | None = None
    deterministic: DeterministicResult | None = None
    two_scale: TwoScaleResult | None = None
    stochastic: StochasticResult | None = None

    @property
    def method(self) -> str:
        """Where `leakage` comes from: "median" (of realisations), "two-scale" or "deterministic"."""
        return next(method for method, name in _METHODS if name in self.dataset)

    @property
    def leakage(self) -> xarray.DataArray:
        """Best leakage per length of seal at hand (step,) [m²/s]: median, else two-scale, else deterministic."""
        return self.dataset[dict(_METHODS)[self.method]]

    @property
    def steps(self) -> LoadProgramme:
        """The load programme."""
        pairs = zip(self.dataset["nominal_pressure"].values, self.dataset["unloaded_from"].values, strict=True)
        return LoadProgramme(LoadStep(float(p), None if np.isnan(peak) else float(peak)) for p, peak in pairs)

    @property
    def warnings(self) -> list[str]:
        """What failed on the way, one line each; empty if nothing did."""
        return json.loads(self.dataset.attrs["warnings"])

    @property
    def left_out(self) -> list[str]:
        """What was not written to the folder and why, one line each; empty if everything was."""
        return json.loads(self.dataset.attrs.get("left_out", "[]"))

    @property
    def case(self) -> dict[str, Any]:
        """The case in SI, as given to `assemble`; tuples have become lists."""
        return json.loads(self.dataset.attrs["case"])

    def loading(self) -> xarray.Dataset:
        """Leakage, and all else that depends on the step, on loading over `nominal_pressure` [Pa]."""
        return select.loading(self.dataset)

    def unloading(self, from_: float | str | None = None) -> xarray.Dataset:
        """The same on unloading, from the peak on.

        Parameters
        ----------
        from_ : the peak, in Pa or as "900 MPa"; the highest one unless given.

        Raises
        ------
        InputError : no unloading from there.
        """
        return select.unloading(self.dataset, from_)

    def cell(self, i: int, j: int) -> xarray.Dataset:
        """Curves of the window (i, j) over the steps: permeability, flux, contact pressure, mean gap, contact share.

        Raises
        ------
        InputError : no such window, or results without a two-scale study.
        """
        return select.cell(self.dataset, i, j)

    def library_cell(self, number: int) -> xarray.Dataset:
        """Curves of a cell of the library over the library's own steps.

        Raises
        ------
        InputError : no such cell, or results without a stochastic study.
        """
        return select.library_cell(self.dataset, number)

    def gap(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Deformed gap (x1, x2) [m] at one step, read from the folder where it is not in memory.

        Of the two-scale study where there is one, else of the deterministic.

        Parameters
        ----------
        step : index of the load step.
        cell : window, between its rows of nodes; the whole face unless given.

        Raises
        ------
        InputError : no such step or window, or none of its fields at hand: `stored_steps` are those there are.
        """
        return stitched.read_field(self, "gap", step, cell)

    def contact_pressure(self, step: int, cell: tuple[int, int] | None = None) -> xarray.DataArray:
        """Contact pressure (x1, x2) [Pa] of the two-scale study at one step, see `gap`."""
        return stitched.read_field(self, "contact_pressure", step, cell)

    @property
    def stored_steps(self) -> list[int]:
        """Steps whose gap and contact pressure are at hand, in memory or in the folder."""
        return stitched.stored_steps(self)

    def rows(self) -> list[dict[str, Any]]:
        """The table as dictionaries in SI, one for each step; the keys carry the units."""
        return tables.rows(self)

    def table(self) -> Table:
        """The table for a terminal, to be given to `rich.print`."""
        return tables.rich_table(self)

    def plot_cells(self, count: int = 4) -> Any:
        """Permeability of cells along the cycle, see `cells_figure`."""
        return room("plots").cells_figure(self, count)

    def plot_seal(self, step: int | None = None) -> Any:
        """Contact, fluid pressure and permeability over the seal at one step, see `seal_figure`."""
        return room("plots").seal_figure(self, step)

    def report(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the page that shows it all, `report.html` in the folder unless given, see `write_report`."""
        return room("report").write_report(self, path)

    def __repr__(self) -> str:
        return summary.text(self)

    def _repr_html_(self) -> str:
        return summary.html(self)


def assemble(
    scene: Scene,
    *,
    deterministic: DeterministicResult | None = None,
    two_scale: TwoScaleResult | None = None,
    stochastic: StochasticResult | None = None,
    case: dict[str, Any] | None = None,
    surface_report: dict[str, Any] | None = None,
    timings: dict[str, float] | None = None,
    quantiles: tuple[float, float] = (0.05, 0.95),
) -> Results:
    """One dataset of all the studies of a scene.

    Parameters
    ----------
    scene : what the studies were run on.
    deterministic, two_scale, stochastic : results of studies, at least one.
    case : the case in SI, of plain values; its "seed", if any, is stored by itself too.
    surface_report : what was done to the measured face.
    timings : stage to wall time [s].
    quantiles : lower and upper end of the band of realisations.

    Returns
    -------
    Results; every variable has `units` and `long_name`. Dimensions: step; realisation; cell1, cell2, windows by their
    centres [m]; node1, corner1, rows of nodes and of x2-links along x1 [m] (the x2-link of column j runs from cell2 j
    to j + 1); narrowest, numbers of links; library_cell, library_step. Fluxes are volume rates per width at the
    fluid's reference density. Attributes tell the case, the surface, versions, machine, wall times, peak memory of the
    main process, and how many flows were solved or known without (`counts`).

    Raises
    ------
    InputError : no study, a study of another load programme, quantiles not 0 <= lower < upper <= 1.
    """
    import xarray

    studies = [s for s in (deterministic, two_scale, stochastic) if s is not None]
    if not studies:
        raise InputError.of("results", "no study", "at least one of deterministic, two_scale, stochastic")
    if any(s.steps != scene.steps for s in studies):
        raise InputError.of("results", "a study of another load programme", "studies of the scene's own steps")
    if len(quantiles) != 2 or not 0 <= quantiles[0] < quantiles[1] <= 1:
        raise InputError.of("quantiles", quantiles, "two numbers, 0 <= lower < upper <= 1")
    data = xarray.Dataset(coords=_step_coordinates("step", "", scene.steps))
    if deterministic is not None:
        _add_fields(data, deterministic, _DETERMINISTIC)
    if two_scale is not None:
        _add_windows(data, scene, two_scale)
    if stochastic is not None:
        _add_realisations(data, stochastic, quantiles)
        _add_library(data, stochastic.library.curves)
    _add_contact_share(data, scene, deterministic, two_scale, stochastic)
    counts = {"two_scale": two_scale.counts} if two_scale is not None else {}
    counts |= {"library": stochastic.library.counts} if stochastic is not None else {}
    few = [text] if stochastic is not None and (text := stochastic.too_few(*quantiles)) else []
    seal_size = stochastic.seal.size if stochastic is not None else scene.surface.size
    data.attrs = {
        "title": "Leakage of a metal-to-metal seal over a load cycle",
        "Conventions": "CF-1.11",
        "source": f"femseal {versions()['femseal']}",
        "date_created": datetime.now(UTC).isoformat(timespec="seconds"),
        "case": _json(case or {}),
        "surface": _json(surface_report or {}),
        "timings": _json(timings or {}),
        "counts": _json(counts),
        "warnings": _shortened([*(text for study in studies for text in study.failures), *few]),
        "versions": _json(versions()),
        "machine": _json(machine()),
        "fluid": repr(scene.fluid),
        "inlet_pressure_Pa": float(scene.inlet_pressure),
        "outlet_pressure_Pa": float(scene.outlet_pressure),
        "contact_modulus_Pa": float(scene.modulus),
        "hardness_Pa": float(scene.hardness),
        "seal_size_m": [float(length) for length in seal_size],
    }
    if (peak := peak_memory()) is not None:
        data.attrs["peak_memory_bytes"] = peak
    if case and case.get("seed") is not None:
        data.attrs["seed"] = case["seed"]
    return Results(data, scene=scene, deterministic=deterministic, two_scale=two_scale, stochastic=stochastic)


def save(results: Results, folder: str | os.PathLike[str]) -> Path:
    """Write `results.nc` into a folder, which is made if needed; an older file is replaced whole or not at all.

    Raises
    ------
    InputError : the folder cannot be made.
    """
    path = made_folder(folder) / FILE_NAME
    data = results.dataset
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {
        name: dict(packed) for name, v in data.data_vars.items() if v.ndim and v.dtype.kind in "fiu"
    }
    encoding |= {name: {"_FillValue": None} for name, v in data.coords.items() if v.dtype.kind == "f"}
    with replacing_hdf5(path) as target:
        data.to_netcdf(target, engine="h5netcdf", encoding=encoding)
    return path


def open_results(folder: str | os.PathLike[str]) -> Results:
    """Results saved in a folder, read into memory; the studies' own large fields are not among them.

    Raises
    ------
    InputError : no such folder, no `results.nc` in it, or not one that femseal wrote.
    """
    import xarray

    path = Path(folder) / FILE_NAME
    if not path.is_file():
        given = f"{folder} (no such folder)" if not Path(folder).is_dir() else f"{folder} (no {FILE_NAME} in it)"
        raise InputError.of("results folder", given, f"a folder with the {FILE_NAME} of a finished run")
    try:
        with xarray.open_dataset(path, engine="h5netcdf") as data:
            data.load()
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError.of("results file", f"{path} ({reason})", "a readable netCDF file") from None
    if not str(data.attrs.get("source", "")).startswith("femseal") or not any(name in data for _, name in _METHODS):
        raise InputError.of("results file", f"{path}, written by another program", "a file that femseal wrote")
    return Results(data, Path(folder))


def _step_coordinates(dim: str, prefix: str, steps: LoadProgramme) -> dict[str, Any]:
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    columns = {
        dim: (np.arange(len(steps)), "1", "index of the load step"),
        f"{prefix}branch": ([s.branch for s in steps], "1", "branch of the load cycle"),
        f"{prefix}nominal_pressure": ([float(s.pressure) for s in steps], "Pa", "nominal pressure"),
        f"{prefix}unloaded_from": (peaks, "Pa", "nominal pressure from which the step is unloaded"),
        f"{prefix}name": ([s.name for s in steps], "1", "name of the load step"),
    }
    return {name: (dim, values, _labels(unit, text)) for name, (values, unit, text) in columns.items()}


def _labels(unit: str, long_name: str) -> dict[str, str]:
    return {"units": unit, "long_name": long_name}


def _add_fields(data: xarray.Dataset, result: Any, names: dict[str, str]) -> None:
    for f in fields(result):
        values = getattr(result, f.name) if f.name in names else None
        if values is not None and values.size:
            labels = _labels(f.metadata["unit"], f.metadata["long_name"])
            data[names[f.name]] = (f.metadata["dims"], values, labels)


def _add_windows(data: xarray.Dataset, scene: Scene, result: TwoScaleResult) -> None:
    (m1, m2), (d1, d2) = result.partition.cells, result.partition.window_size
    data.coords["cell1"] = ("cell1", (np.arange(m1) + 0.5) * d1, _labels("m", "x1 of window centres, from the inlet"))
    data.coords["cell2"] = ("cell2", (np.arange(m2) + 0.5) * d2, _labels("m", "x2 of window centres, along the seal"))
    rows = np.array(result.partition.node_rows)
    data.coords["node1"] = ("node1", rows, _labels("m", "x1 of the global nodes"))
    if m1 > 1:
        data.coords["corner1"] = ("corner1", rows[1:-1], _labels("m", "x1 of links along x2"))
    _add_fields(data, result, _TWO_SCALE)
    # the fluid of a pocket has no pressure to speak of, and does not flow
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
    data["drop_share"] = (("step", "narrowest"), shares, _labels("1", text))


def _add_realisations(data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]) -> None:
    every = ("leakage", "leakage_resampled", "leakage_lower_bound", "leakage_upper_bound")
    _add_fields(data, result, {name: name for name in every})
    data.coords["realisation"] = ("realisation", np.arange(len(result.leakage)), _labels("1", "realisation"))
    text = "leakage per unit seal length, {} of the realisations"
    for name, q in (("median", 0.5), ("lower", quantiles[0]), ("upper", quantiles[1])):
        labels = _labels("m^2/s", text.format(name if name == "median" else f"{name} quantile {q:g}"))
        data[f"leakage_{name}"] = ("step", result.quantile(q), labels | {"quantile": q})
        if name != "median":
            labels = _labels("m^2/s", labels["long_name"] + " with the error of the finite library")
            data[f"leakage_{name}_together"] = ("step", result.quantile(q, resampled=True), labels | {"quantile": q})
    data["leakage_mean"] = ("step", result.mean, _labels("m^2/s", text.format("mean")))
    spread, error = result.realisation_spread, result.library_error
    data["realisation_spread"] = ("step", spread, _labels("1", "standard deviation of ln(leakage), realisations"))
    data["library_error"] = ("step", error, _labels("1", "standard deviation of ln(leakage), finite library"))
    data["sealed_share"] = ("step", result.sealed_share, _labels("1", "share of the realisations without leakage"))


def _add_library(data: xarray.Dataset, curves: LibraryTable) -> None:
    for name, entry in _step_coordinates("library_step", "library_", curves.steps).items():
        data.coords[name] = entry
    cells = np.arange(len(curves.k))
    data.coords["library_cell"] = ("library_cell", cells, _labels("1", "number of the library cell"))
    for f in fields(curves):
        if f.name != "steps":
            labels = _labels(f.metadata["unit"], f.metadata["long_name"])
            data[f"library_{f.name}"] = (("library_cell", "library_step"), getattr(curves, f.name), labels)


def _add_contact_share(
    data: xarray.Dataset,
    scene: Scene,
    deterministic: DeterministicResult | None,
    two_scale: TwoScaleResult | None,
    stochastic: StochasticResult | None,
) -> None:
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
    data["contact_share"] = ("step", share, _labels("1", f"share of the face in contact, {origin}"))


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)


def _shortened(texts: list[str]) -> str:
    """The texts as JSON, as many as an attribute holds; the last one then says how many are left out."""
    kept, size = [], 0
    for n, text in enumerate(texts):
        size += len(_json(text).encode()) + 2
        if size > _ATTRIBUTE_BYTES:
            kept.append(f"… and {len(texts) - n} more")
            break
        kept.append(text)
    return _json(kept)
