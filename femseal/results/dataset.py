"""The studies of a scene gathered into one labelled dataset, and the netCDF file of results, which any tool reads."""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray

from ..base import (
    AnyPath,
    InputError,
    counted,
    free_memory,
    made_folder,
    shortened,
    versions,
    write_bytes,
)
from ..base.fields import FACE, PIECE, STEP, Field, fields_of
from ..base.leak_rates import LeakBasis, leak_classes
from ..base.leak_units import leak_unit
from ..base.machine import machine, peak_memory
from ..budget import VAGUE, ErrorBudget, vague_steps
from ..face.pieces import Cut
from ..fluids import leak_basis
from ..studies import (
    STUDIES,
    BlocksResult,
    FaceResult,
    FluidState,
    OtherLeakage,
    Scene,
    StochasticResult,
    StudyResult,
)
from ..studies.study_registry import contact_fraction_of
from ..topography import Patches
from . import variables
from .results import METHODS, Results, load_names
from .variables import HEIGHT_BLOCKS, add_classes, add_test_fluid, basis_attributes, fluid_text

FILE_NAME = "results.nc"
_OURS = "a file that femseal wrote"
#: Attributes that hold JSON, and what each of them is.
_ATTRIBUTES: dict[str, type] = {
    "case": dict, "surface": dict, "timings": dict, "warnings": list, "failures": list,
    "versions": dict, "machine": dict,
}  # fmt: skip


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run besides its scene and the results of its studies.

    case : the case in SI, of plain values; its "seed", if any, is stored by itself too.
    surface : what was done to the measured face.
    timings : stage to wall time [s].
    quantiles : lower and upper end of the band of realisations.
    warnings : what casts doubt on the case itself; those of the studies come after them.
    leakage_unit : of leakage in tables, pictures and report, see `base.leak_rates`, of the fluid, the test fluid or
        both; a readable one per length of seal unless given.
    budgets : error budgets of the studies, by their keys.
    test : the leakage of a test fluid through the same seals.
    classes : leakage classes to be decided on at every step, by the test fluid where there is one, see
        `base.leak_rates`. nominal_diameter : [m], which some of them need.
    throughput_temperature : at which pressure × volume of a gas is stated [K]; its own unless given.
    valve : volumes of a drop and a bubble and rated capacity, `drop`, `bubble`, `capacity` of `LeakBasis`.
    attributes : further ones of the dataset.

    Raises InputError: quantiles not 0 <= lower < upper <= 1.
    """

    case: Mapping[str, Any] = field(default_factory=dict)
    surface: Mapping[str, Any] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)
    quantiles: tuple[float, float] = (0.05, 0.95)
    warnings: tuple[str, ...] = ()
    leakage_unit: str | None = None
    budgets: Mapping[str, ErrorBudget] = field(default_factory=dict)
    test: OtherLeakage | None = None
    classes: Sequence[str] = ()
    nominal_diameter: float | None = None
    throughput_temperature: float | None = None
    valve: Mapping[str, float] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.quantiles) != 2 or not 0 <= self.quantiles[0] < self.quantiles[1] <= 1:
            raise InputError("quantiles", self.quantiles, "two numbers, 0 <= lower < upper <= 1")


#: Of a run of which nothing is known.
_NOTHING = RunFacts()


def assemble(scene: Scene, *studies: StudyResult, facts: RunFacts = _NOTHING) -> Results:
    """One dataset of all the studies of a scene.

    scene : input of the studies. studies : their results, at least one.

    Returns Results; every variable has `units` and `long_name`. Dimensions: step; realisation; piece1, piece2, pieces
    by their centres [m]; state, state_piece1, state_piece2, states of the face, and the pieces that seals draw; place1,
    place2, blocks of the measured place that leaks most; part, corner, plane, parts of the drawn seal nearest to the
    median; budget_part, sources of error. Attributes hold the case, the surface, versions, machine, wall times, peak
    memory of the main process, numbers of linear systems by solver with the worst imbalance of inlet and outlet flow,
    and of flows through pieces (`solvers`), how the errors were estimated (`error_budget`), warnings and failures.

    Raises InputError: no study, a study of another load programme, a unit or a class that does not exist or is not for
    the fluid.
    """
    if not studies:
        raise InputError("results", "no study", "at least one")
    if any(study.steps != scene.steps for study in studies):
        raise InputError("results", "a study of another load programme", "those of the scene")
    known = {
        STUDIES[method].key: study
        for method in STUDIES
        for study in studies
        if study.method == method
    }
    drawn = known.get("stochastic")
    assert drawn is None or isinstance(drawn, StochasticResult)
    data = xarray.Dataset()
    variables.add_load_steps(data, "step", "", scene.steps)
    _add_studies(data, scene, known, facts.quantiles)
    size = scene.surface.size if drawn is None else drawn.tiles.size
    state = FluidState.of(scene)
    basis = leak_basis(
        scene.fluid,
        float(size[1]),
        facts.throughput_temperature,
        pressure_drop=state.pressure_drop,
        **facts.valve,
    )
    data.attrs = {
        "title": "Leakage of a metal-to-metal seal over a load cycle",
        "Conventions": "CF-1.11",
        "source": f"femseal {versions()['femseal']}",
        "date_created": datetime.now(UTC).isoformat(timespec="seconds"),
        "case": _json(facts.case),
        "surface": _json(facts.surface),
        "timings": _json(facts.timings),
        "versions": _json(versions()),
        "machine": _json(machine()),
        "peak_memory_bytes": peak_memory(),
        "seal": "a strip" if drawn is None else str(scene.layout),
        "seal_size_m": [float(length) for length in size],
        "leakage_unit": _unit_name(facts, basis),
        **_of_studies(known, facts.warnings),
        "fluid": fluid_text(scene.fluid),
        "fluid_effect": scene.fluid_effect,
        "inlet_pressure_Pa": float(scene.inlet_pressure),
        "outlet_pressure_Pa": float(scene.outlet_pressure),
        "contact_modulus_Pa": float(scene.modulus),
        "hardness_Pa": scene.law.mean_hardness,
        "contact_law": str(scene.law),
        **basis_attributes(basis),
        **facts.attributes,
    }
    if drawn is not None:
        data.attrs |= {"tiles": str(drawn.tiles), "tiles_in_place": int(drawn.tiles.in_place)}
    if facts.case.get("seed") is not None:
        data.attrs["seed"] = facts.case["seed"]
    variables.add_budgets(data, facts.budgets)
    results = Results(data, None, scene, known)
    carries_all = np.zeros(len(scene.steps), bool)
    carries_all[[s for s, _ in scene.parted_steps]] = True
    if "contact_fraction" in data:
        carries_all |= data["contact_fraction"].values == 0
    data.attrs["open_steps"] = _json(np.flatnonzero(carries_all & np.isnan(results.leakage.values)))
    variables.add_totals(data, results.leakage, results.leak_basis)
    if facts.test is not None:
        add_test_fluid(data, facts.test, state, facts.throughput_temperature, facts.valve)
    later, upper = [], None
    if (budget := results.budget) is not None:
        upper = budget.upper
        if (vague := vague_steps(budget)).size:
            more = f" and {counted(vague.size - 1, 'more load')}" if vague.size > 1 else ""
            later.append(
                f"the leakage at {load_names(data)[vague[0]]}{more} is not known within a factor of {VAGUE:g}; "
                f"the widest source of error there is: {budget.limiting(vague[0])}"
            )
    wanted = leak_classes(facts.classes)
    best, several = results.class_leakage
    # a load at which the solution of either fluid failed meets no class
    best = np.where(results.has_failed, np.nan, best)
    later += add_classes(
        data, wanted, results.class_basis, facts.nominal_diameter, best, several, upper
    )
    if later:
        data.attrs["warnings"] = _json([*results.warnings, *later])
    return results


def _add_studies(
    data: xarray.Dataset,
    scene: Scene,
    known: Mapping[str, StudyResult],
    quantiles: tuple[float, float],
) -> None:
    """Add the fields of all studies."""
    faces = [study for study in known.values() if isinstance(study, FaceResult)]
    for face in faces:
        study = STUDIES[face.method]
        text = f"leakage per unit seal length, {study.label}"
        made = Field(study.leakage_variable, "m^2/s", text, STEP, study.label)
        variables.add(data, made, face.leakage)
    for face in faces[-1:]:
        variables.add_declared(data, face)
        variables.add_block_means(data, scene, face)
        if face.pieces is not None:
            variables.add_piece_centres(data, "", face.pieces.cut)
            for made, values in fields_of(face.pieces):
                if made.place == PIECE:
                    variables.add(data, made, values)
    breadth = scene.surface.size[0]
    if isinstance(blocks := known.get("blocks"), BlocksResult):
        variables.add_piece_centres(data, "", Cut.of(scene.surface, blocks.pressure.shape[1:]))
        variables.add_declared(data, blocks)
    drawn = known.get("stochastic")
    if isinstance(drawn, StochasticResult):
        variables.add_realisations(data, drawn, quantiles)
        variables.add_states(data, drawn.pieces)
        if (median := drawn.median_seal) is not None:
            variables.add_declared(data, median)
            about = {"realisation": median.realisation, "part": drawn.tiles.part}
            data["drawn_corners"].attrs |= about
        if drawn.row_pressure is not None:
            breadth = drawn.seal.size[0]
    for result in known.values():
        if result.places is not None:
            gap = faces[-1].gap if faces else None
            variables.add_places(data, cast(Patches, scene.surface), result.places, gap)
            break
    if (count := data.sizes.get("row")) is not None:
        rows = (np.arange(count) + 0.5) * (breadth / count)
        variables.add_coordinate(data, "row", "m", "x1 of rows, from the inlet", rows)
    variables.add_blocks(data, ("face1", "face2"), scene.surface, HEIGHT_BLOCKS)
    means = variables.block_means(scene.surface.heights, HEIGHT_BLOCKS)
    text = "height of the face, mean of each block"
    variables.add_new(data, "face_height", "m", text, means, FACE)
    fraction = contact_fraction_of(next(iter(known.values())), scene.steps)
    if not np.isnan(fraction).all():
        text = "fraction of the face in contact"
        made = Field("contact_fraction", "1", text, STEP, "contact [%]")
        variables.add(data, made, fraction)


def _of_studies(known: Mapping[str, StudyResult], warnings: Sequence[str]) -> dict[str, str]:
    """Attributes that count what the studies have solved, with their warnings and failures."""
    solvers = {
        key: vars(study.solvers) | {"systems": dict(study.solvers.systems)}
        for key, study in known.items()
    }
    # each study checks the scene and its own leakage; the last one has the answer
    texts = [*warnings, *list(known.values())[-1].warnings]
    failures = [text for study in known.values() for text in study.failures]
    return {
        "solvers": _json(solvers),
        "warnings": _json([*dict.fromkeys(texts)]),
        "failures": _json([*dict.fromkeys(failures)]),
    }


def _unit_name(facts: RunFacts, basis: LeakBasis) -> str:
    """Name of the unit that is asked for, "" without; InputError where it is for neither fluid."""
    if facts.leakage_unit is None:
        return ""
    unit = leak_unit(facts.leakage_unit)
    if facts.test is None or not leak_basis(facts.test.state.fluid, 1.0).has(unit):
        basis.factor(unit)
    return unit.name


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)


def save(results: Results, folder: AnyPath) -> Path:
    """Write `results.nc` into a folder, which is made if needed; an older file is replaced whole or not at all.

    Raises InputError: the folder cannot be made.
    """
    from xarray.backends import H5NetCDFStore

    folder = made_folder(folder)
    data = results.dataset
    packed = {"zlib": True, "complevel": 4, "shuffle": True}
    encoding: dict[Any, dict[str, Any]] = {
        name: dict(packed) for name, v in data.data_vars.items() if v.ndim and v.dtype.kind in "fiu"
    }
    coords = (name for name, v in data.coords.items() if v.dtype.kind == "f")
    encoding |= {name: {"_FillValue": None} for name in coords}
    # HDF5 ends the process where a disk is full; `to_netcdf` would take a lock from a Dask client where there is one
    content = io.BytesIO()
    store = H5NetCDFStore.open(content, mode="w", lock=False)
    try:
        data.dump_to_store(store, encoding=encoding)
    finally:
        store.close()
    return write_bytes(folder / FILE_NAME, content.getbuffer())


def _refuse_foreign(path: Path) -> None:
    """Results are data: a file that points to other files, or claims more than fits into memory, is not read."""
    import h5py

    size = 0
    with h5py.File(path, "r") as file:
        for name in file:
            item = file[name] if isinstance(file.get(name, getlink=True), h5py.HardLink) else None
            if not isinstance(item, h5py.Dataset) or item.external or item.is_virtual:
                given = f"{path}, whose '{name}' is not held in the file itself"
                raise InputError("results file", given, _OURS)
            size += item.size * item.dtype.itemsize if item.size else 0
    if size > (free := free_memory()):
        given = f"{path}, which unpacks to {size / 1e9:.3g} GB"
        expected = f"what fits into the {free / 1e9:.3g} GB of free memory"
        raise InputError("results file", given, expected)


def open_results(folder: AnyPath) -> Results:
    """Read the results in a folder into memory, without the studies' large fields.

    Raises InputError: no such folder, no `results.nc` in it, or not one that femseal wrote.

    Examples
    --------
    >>> results = open_results("results/seal")  # doctest: +SKIP
    >>> results.unloading(from_="300 MPa").leakage_total, results.failures  # doctest: +SKIP
    """
    path = Path(folder) / FILE_NAME
    if not path.is_file():
        lack = f"no {FILE_NAME} in it" if Path(folder).is_dir() else "no such folder"
        expected = f"a folder with the {FILE_NAME} of a finished run"
        raise InputError("results folder", f"{folder} ({lack})", expected)
    try:
        _refuse_foreign(path)
        with xarray.open_dataset(path, engine="h5netcdf", phony_dims="access") as data:
            data.load()
    except InputError:
        raise
    except Exception as error:  # libraries raise whatever a damaged file leads them to
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("results file", f"{path} ({reason})", "a readable netCDF file") from None
    known = any(name in data for _, name in METHODS)
    if not known or not str(data.attrs.get("source", "")).startswith("femseal"):
        raise InputError("results file", f"{path}, written by another program", _OURS)
    results = Results(data, Path(folder))
    try:
        for name, kind in _ATTRIBUTES.items():
            if not isinstance(json.loads(data.attrs[name]), kind):
                raise TypeError(f"the attribute '{name}' is of another kind")
        results.table()
    except Exception as error:  # also a field of another kind, shape or place
        raise unfit(path, error) from None
    return results


def unfit(path: Path, error: Exception) -> InputError:
    """The error of results that can be read, but whose values do not go together."""
    reason = f"{type(error).__name__}: {shortened(error, 80)}"
    return InputError("results file", f"{path} ({reason})", _OURS)
