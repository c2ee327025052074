"""The studies of a scene gathered into one labelled dataset, and its netCDF file, which any tool reads."""

import json
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ..base import InputError, counted, free_memory, made_folder, shortened, versions
from ..base.fields import STEP, Field
from ..base.files import replacing_hdf5
from ..base.leak_rates import leak_classes, leak_unit
from ..base.machine import machine, peak_memory
from ..budget import VAGUE, ErrorBudget, vague_steps
from ..fluids import leak_basis
from ..studies import STUDIES, FaceResult, FluidState, OtherLeakage, Scene, StochasticResult
from ..topography import Places
from . import variables
from .results import Results
from .run_data import METHODS, add_classes, add_test_fluid, basis_attributes

#: An attribute of an HDF5 file holds at most 64 kB.
_ATTRIBUTE_BYTES = 50_000


def assemble(
    scene: Scene,
    *,
    deterministic: FaceResult | None = None,
    two_scale: FaceResult | None = None,
    stochastic: StochasticResult | None = None,
    case: dict[str, Any] | None = None,
    surface_report: dict[str, Any] | None = None,
    timings: dict[str, float] | None = None,
    quantiles: tuple[float, float] = (0.05, 0.95),
    warnings: tuple[str, ...] = (),
    leakage_unit: str | None = None,
    budgets: Mapping[str, ErrorBudget] | None = None,
    test: OtherLeakage | None = None,
    classes: Sequence[str] = (),
    nominal_diameter: float | None = None,
    throughput_temperature: float | None = None,
    valve: Mapping[str, float] | None = None,
) -> Results:
    """One dataset of all the studies of a scene.

    scene : input of the studies.
    deterministic, two_scale, stochastic : results of studies, at least one.
    case : the case in SI, of plain values; its "seed", if any, is stored by itself too.
    surface_report : what was done to the measured face.
    timings : stage to wall time [s].
    quantiles : lower and upper end of the band of realisations.
    warnings : what casts doubt on the case itself; those of the studies come after them.
    leakage_unit : of leakage in tables, pictures and report, see `base.leak_rates`, of the fluid, the test fluid or
        both; a readable one per length of seal unless given.
    budgets : error budgets of the studies, by their names here.
    test : the leakage of a test fluid through the same seals.
    classes : leakage classes to be decided on at every step, by the test fluid where there is one, see
    `base.leak_rates`. nominal_diameter : [m], which some of them need.
    throughput_temperature : at which pressure × volume of a gas is stated [K]; its own unless given.
    valve : volumes of a drop and a bubble and rated capacity, `drop`, `bubble`, `capacity` of `LeakBasis`.

    Returns Results; every variable has `units` and `long_name`. Dimensions: step; realisation; piece1, piece2, pieces
    by their centres [m]; state, state_piece1, state_piece2, states of the face, and the pieces that seals draw; place1,
    place2, blocks of the measured place that leaks most; part, corner, plane, parts of the drawn seal nearest to the
    median; budget_part, sources of error. Attributes hold the case, the surface, versions, machine, wall times, peak
    memory of the main process, numbers of flows solved or known without solving (`counts`), number of linear systems by
    solver with the worst imbalance of inlet and outlet flow (`solvers`), how the errors were estimated
    (`error_budget`), warnings and failures.

    Raises InputError: no study, a study of another load programme, quantiles not 0 <= lower < upper <= 1, a unit or a
    class that does not exist or is not for the fluid.
    """
    import xarray

    named = {"deterministic": deterministic, "two_scale": two_scale, "stochastic": stochastic}
    known: dict[str, Any] = {name: study for name, study in named.items() if study is not None}
    studies = list(known.values())
    if not studies:
        raise InputError("results", "no study", "at least one of deterministic, two_scale, stochastic")
    if any(s.steps != scene.steps for s in studies):
        raise InputError("results", "a study of another load programme", "studies of the scene's own steps")
    if len(quantiles) != 2 or not 0 <= quantiles[0] < quantiles[1] <= 1:
        raise InputError("quantiles", quantiles, "two numbers, 0 <= lower < upper <= 1")
    data = xarray.Dataset(coords=variables.step_coordinates("step", "", scene.steps))
    for study in STUDIES.values():
        if isinstance(result := known.get(study.key), FaceResult):
            text = f"leakage per unit seal length, {study.label}"
            variables.add(data, Field(study.leakage_variable, "m^2/s", text, STEP, study.label), result.leakage)
    if (face := two_scale or deterministic) is not None:
        variables.add_declared(data, face)
        variables.add_block_means(data, scene, face)
    if two_scale is not None and two_scale.pieces is not None:
        variables.add_pieces(data, two_scale.pieces)
    if stochastic is not None:
        variables.add_realisations(data, stochastic, quantiles)
        variables.add_states(data, stochastic.pieces)
        if (drawn := stochastic.median_seal) is not None:
            variables.add_declared(data, drawn)
            data["drawn_corners"].attrs |= {"realisation": drawn.realisation, "part": stochastic.tiles.part}
    if (by_place := next((study.places for study in studies if study.places is not None), None)) is not None:
        gap = None if face is None else face.gap
        variables.add_places(data, cast(Places, scene.surface), by_place, gap)
    if "row" in data.dims:
        own = None if stochastic is None or stochastic.row_pressure is None else stochastic.seal
        breadth = scene.surface.size[0] if own is None else own.size[0]
        rows = (np.arange(data.sizes["row"]) + 0.5) * (breadth / data.sizes["row"])
        variables.add_coordinate(data, "row", "m", "x1 of rows, from the inlet", rows)
    variables.add_heights(data, scene)
    variables.add_contact_fraction(data, scene.steps, known)
    counts = {name: pieces.counts.by_kind() for name, study in known.items() if (pieces := study.pieces) is not None}
    solvers = {
        name: {"systems": study.solvers.by_solver(), "worst_imbalance": study.solvers.worst_imbalance}
        for name, study in known.items()
    }
    of_studies = (text for study in studies for text in study.warnings)
    seal_size = stochastic.tiles.size if stochastic is not None else scene.surface.size
    state, valve = FluidState.of(scene), valve or {}
    length = float(seal_size[1])
    basis = leak_basis(scene.fluid, length, throughput_temperature, pressure_drop=state.pressure_drop, **valve)
    if leakage_unit is not None:
        unit = leak_unit(leakage_unit)
        if test is None or not leak_basis(test.state.fluid, 1.0).has(unit):
            basis.factor(unit)  # raises if the unit is not for the fluid
        leakage_unit = unit.name
    data.attrs = {
        "title": "Leakage of a metal-to-metal seal over a load cycle",
        "Conventions": "CF-1.11",
        "source": f"femseal {versions()['femseal']}",
        "date_created": datetime.now(UTC).isoformat(timespec="seconds"),
        "case": _json(case or {}),
        "surface": _json(surface_report or {}),
        "timings": _json(timings or {}),
        "counts": _json(counts),
        "solvers": _json(solvers),
        # every study warns of what is odd in the scene
        "warnings": _shortened(list(dict.fromkeys([*warnings, *of_studies]))),
        "failures": _shortened(list(dict.fromkeys(text for study in studies for text in study.failures))),
        "versions": _json(versions()),
        "machine": _json(machine()),
        "peak_memory_bytes": peak_memory(),
        "fluid": repr(scene.fluid),
        "fluid_effect": scene.fluid_effect,
        "inlet_pressure_Pa": float(scene.inlet_pressure),
        "outlet_pressure_Pa": float(scene.outlet_pressure),
        "contact_modulus_Pa": float(scene.modulus),
        "hardness_Pa": scene.law.mean_hardness,
        "contact_law": str(scene.law),
        "seal": str(scene.layout) if stochastic is not None else "a strip",
        "seal_size_m": [float(length) for length in seal_size],
        "leakage_unit": leakage_unit or "",
        **basis_attributes(basis),
    }
    if stochastic is not None:
        data.attrs |= {"tiles": str(stochastic.tiles), "tiles_in_place": int(stochastic.tiles.in_place)}
    variables.add_budgets(data, budgets or {})
    if case and case.get("seed") is not None:
        data.attrs["seed"] = case["seed"]
    results = Results(data, None, scene, deterministic, two_scale, stochastic)
    variables.add_totals(data, results.leakage, results.leak_basis)
    later = []
    if test is not None:
        add_test_fluid(data, test, state, throughput_temperature, valve)
    wanted = leak_classes(classes)
    upper = None
    if (budget := results.budget) is not None:
        upper = np.asarray(budget.upper)
        later += _band_doubts(budget, data["name"].values)
    later += add_classes(data, wanted, results.class_basis, nominal_diameter, *results.class_leakage, upper)
    if later:
        data.attrs["warnings"] = _shortened([*results.warnings, *later])
    return results


def _band_doubts(budget: ErrorBudget, names: NDArray[Any]) -> list[str]:
    """Warn of a band that says nothing: at which load, and by what part of the budget."""
    if not (vague := vague_steps(budget)).size:
        return []
    first = int(vague[0])
    more = f" and {counted(vague.size - 1, 'more load')}" if vague.size > 1 else ""
    return [
        f"the leakage at {names[first]}{more} is not known within a factor of {VAGUE:g}; "
        f"the widest source of error there is: {budget.limiting(first)}"
    ]


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)


def _shortened(texts: list[str]) -> str:
    """The texts as JSON, as many as fit in an attribute; a last line then gives the number left out."""
    kept, size = [], 0
    for n, text in enumerate(texts):
        size += len(_json(text).encode()) + 2
        if size > _ATTRIBUTE_BYTES:
            kept.append(f"… and {len(texts) - n} more")
            break
        kept.append(text)
    return _json(kept)


FILE_NAME = "results.nc"
#: Attributes that hold JSON, and what each of them is.
_ATTRIBUTES: dict[str, type] = {
    "case": dict, "surface": dict, "timings": dict, "counts": dict, "warnings": list, "failures": list,
    "versions": dict, "machine": dict,
}  # fmt: skip


def save(results: Results, folder: str | os.PathLike[str]) -> Path:
    """Write `results.nc` into a folder, which is made if needed; an older file is replaced whole or not at all.

    Raises InputError: the folder cannot be made.
    """
    from xarray.backends import H5NetCDFStore

    path = made_folder(folder) / FILE_NAME
    data = results.dataset
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {
        name: dict(packed) for name, v in data.data_vars.items() if v.ndim and v.dtype.kind in "fiu"
    }
    encoding |= {name: {"_FillValue": None} for name, v in data.coords.items() if v.dtype.kind == "f"}
    with replacing_hdf5(path) as target:
        # `to_netcdf` would take a lock from a Dask client where there is one, and send it the open file as its name
        store = H5NetCDFStore.open(target, mode="w", lock=False)
        try:
            data.dump_to_store(store, encoding=encoding)
        finally:
            store.close()
    return path


def _refuse_foreign(path: Path) -> None:
    """Results are data: a file that points to other files, or claims more than fits into memory, is not read."""
    import h5py

    allowed = "a file that femseal wrote"
    size = 0
    with h5py.File(path, "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise InputError("results file", f"{path}, whose '{name}' is a link", allowed)
            item = file[name]
            if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
                raise InputError("results file", f"{path}, whose '{name}' is not held in the file itself", allowed)
            size += item.size * item.dtype.itemsize if item.size else 0
    if size > (free := free_memory()):
        given = f"{path}, which unpacks to {size / 1e9:.3g} GB"
        raise InputError("results file", given, f"what fits into the {free / 1e9:.3g} GB of free memory")


def open_results(folder: str | os.PathLike[str]) -> Results:
    """Read the results in a folder into memory, without the studies' large fields.

    Raises InputError: no such folder, no `results.nc` in it, or not one that femseal wrote.
    """
    path = Path(folder) / FILE_NAME
    if not path.is_file():
        given = f"{folder} (no such folder)" if not Path(folder).is_dir() else f"{folder} (no {FILE_NAME} in it)"
        raise InputError("results folder", given, f"a folder with the {FILE_NAME} of a finished run")
    import xarray

    try:
        _refuse_foreign(path)
        with xarray.open_dataset(path, engine="h5netcdf", phony_dims="access") as data:
            data.load()
    except InputError:
        raise
    except Exception as error:  # libraries raise whatever a damaged file leads them to
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("results file", f"{path} ({reason})", "a readable netCDF file") from None
    if not str(data.attrs.get("source", "")).startswith("femseal") or not any(name in data for _, name in METHODS):
        raise InputError("results file", f"{path}, written by another program", "a file that femseal wrote")
    for name, kind in _ATTRIBUTES.items():
        try:
            fits = isinstance(json.loads(data.attrs.get(name, "")), kind)
        except (TypeError, ValueError, RecursionError):
            fits = False
        if not fits:
            given = f"{path} with the attribute '{name}' missing or of another kind"
            raise InputError("results file", given, "a file that femseal wrote")
    results = Results(data, Path(folder))
    try:
        results.table()
    except Exception as error:  # a field of another kind, shape or place
        raise unfit(path, error) from None
    return results


def unfit(path: Path, error: Exception) -> InputError:
    """The error of results that can be read, but whose values do not go together."""
    reason = f"{type(error).__name__}: {shortened(error, 80)}"
    return InputError("results file", f"{path} ({reason})", "a file that femseal wrote")
