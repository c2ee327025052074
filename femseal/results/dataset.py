"""Collect the results of all studies of a run in one dataset, with units and descriptions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, cast

import numpy as np
import xarray

from ..base import InputError, counted, versions
from ..base.fields import CELL, FACE, STEP, Field, fields_of
from ..base.leak_classes import find_leak_classes
from ..base.leak_rates import LeakBasis
from ..base.leak_units import leak_unit
from ..base.machine import machine, peak_memory
from ..budget import VAGUE, ErrorBudget, vague_steps
from ..face.cut import Cut
from ..fluids import leak_basis
from ..seal.layouts import Layout, RectangularLayout
from ..studies import (
    STUDIES,
    FluidState,
    OtherLeakage,
    Scene,
    StochasticResult,
    Study,
    StudyResult,
    study_of_result,
)
from ..topography import Patches
from . import variables
from .best_leakage import (
    basis_attributes,
    best_budget,
    best_leakage,
    best_study,
    leak_basis_of,
)
from .load_steps import load_names
from .met_classes import add_classes
from .results import Results


@dataclass(frozen=True)
class RunFacts:
    """Data of a run that are stored in its dataset, in addition to the input and the results of the studies.

    Attributes
    ----------
    case : mapping
        The case in SI units, as nested dictionaries of plain values. The value of the key "seed" is also stored as an
        attribute of the dataset.
    surface : mapping
        Description of how the measured surface was conditioned.
    timings : mapping
        Wall time of each stage [s].
    quantiles : (float, float)
        Two probabilities; the dataset contains the quantiles of the leakage over the realisations at these
        probabilities.
    warnings : tuple of str
        Warnings about the case, which are stored in the dataset before the warnings of the studies.
    leakage_unit : str or None
        Unit of the leakage in tables, pictures and the report, see `base.leak_rates`. The unit must suit the service
        fluid or the test fluid. By default, a unit of leakage per unit seal length is chosen so that the numbers are
        easy to read.
    budgets : mapping
        Error budget of each study, by the key of the study.
    test : OtherLeakage or None
        Leakage of a test fluid through the same seals.
    classes : sequence of str
        Names of the leakage classes that are checked at every step. The classes are checked for the test fluid or, in a
        run without one, for the service fluid.
    nominal_diameter : float or None
        Nominal diameter of the seat [m], on which the limits of some classes depend.
    throughput_temperature : float or None
        Temperature at which the throughput (pressure × volume per time) of a gas is given [K]; by default the
        temperature of the gas.
    valve : mapping
        Properties of a valve that are needed for some units: `drop_volume`, `bubble_volume` and `capacity`, as in
        `LeakBasis`.
    attributes : mapping
        Further attributes of the dataset.

    Raises
    ------
    InputError
        The quantiles are not 0 <= lower < upper <= 1.
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


_NO_FACTS = RunFacts()


def assemble(scene: Scene, *studies: StudyResult, facts: RunFacts = _NO_FACTS) -> Results:
    """Collect the results of several studies of the same input in one dataset.

    Parameters
    ----------
    scene : Scene
        Input of the studies.
    *studies : StudyResult
        Results of one or more studies.
    facts : RunFacts
        Further data of the run, such as its case and its error budgets.

    Returns
    -------
    Results
        Results with the dataset. Each variable of the dataset has the attributes `units` and `long_name`.

    Raises
    ------
    InputError
        No study is given, or the scene and a study have different load programmes. InputError is also raised if a
        leakage unit or a leakage class is unknown or does not suit the fluid.

    Notes
    -----
    The dataset has the following dimensions:

    - `step`: load steps
    - `realisation`: realisations of the seal
    - `cell1`, `cell2`: cells of the face, whose coordinates are their centres [m]
    - `state`, `state_cell1`, `state_cell2`: contact states of the face, and the cells of the face in each contact state
    - `patch1`, `patch2`: blocks of pixels of the measured patch that leaks most
    - `part`, `corner`, `plane`: tiles of the realisation whose leakage is nearest to the median leakage, corners of a
      tile, and the two axes of the plane of the seal
    - `budget_part`: sources of error

    The attributes of the dataset store the case, the conditioning of the surface, versions, the machine, wall times,
    the peak memory of the main process, warnings and failures. The attribute `solvers` contains the number of linear
    systems that each solver has solved, and the largest imbalance between inlet and outlet flow. The attribute
    `error_budget` says for each error source how its error was estimated.
    """
    if not studies:
        raise InputError("results", "no study", "at least one")
    if any(study.steps != scene.steps for study in studies):
        given = "a study with a different load programme than the scene"
        raise InputError(
            "results", given, "studies that were solved with the load steps of the scene"
        )
    # in the order of `STUDIES`, whatever the order of the arguments
    by_key = {
        registered.key: study
        for name, registered in STUDIES.items()
        for study in studies
        if study.method == name
    }
    data = xarray.Dataset()
    variables.add_load_steps(data, "step", "", scene.steps)
    _add_studies(data, scene, by_key, facts.quantiles)
    data.attrs = _attributes(scene, by_key, facts)
    variables.add_budgets(data, facts.budgets)
    data.attrs["open_steps"] = _json(_open_steps(data, scene))
    variables.add_totals(data, best_study(data), leak_basis_of(data))
    if facts.test is not None:
        service_fluid = FluidState.of(scene)
        temperature = facts.throughput_temperature
        variables.add_test_fluid(data, facts.test, service_fluid, temperature, facts.valve)
    results = Results(data, None, scene, by_key)
    class_warnings = add_classes(data, find_leak_classes(facts.classes), facts.nominal_diameter)
    warnings = [*_vague_leakage(data), *class_warnings]
    if warnings:
        data.attrs["warnings"] = _json([*results.warnings, *warnings])
    return results


# --- variables --------------------------------------------------------------------------------------------------


def _add_studies(
    data: xarray.Dataset,
    scene: Scene,
    by_key: Mapping[str, StudyResult],
    quantiles: tuple[float, float],
) -> None:
    """Add the variables of all studies to a dataset.

    Parameters
    ----------
    data : dataset that is extended.
    scene : input of all studies.
    by_key : result of each study, by the key of the study.
    quantiles : probabilities of the lower and the upper quantile of the leakage over the realisations.
    """
    contained = {study_of_result(result).contained for result in by_key.values()}
    for result in by_key.values():
        study = study_of_result(result)
        if study.has_realisations:
            _add_realisations(data, cast(StochasticResult, result), quantiles)
            continue
        _add_leakage(data, study, result)
        # if a result is contained in the result of another study, its fields are added with the latter
        if study not in contained:
            _add_surface_study(data, scene, study, result)
    # variables of the measured patches, of the rows and of the surface
    patch_results = [result.patches for result in by_key.values() if result.patches is not None]
    if patch_results:
        gaps = [
            cast(Any, result).gap
            for result in by_key.values()
            if study_of_result(result).has_pixel_fields
        ]
        gap = gaps[-1] if gaps else None
        variables.add_patches(data, cast(Patches, scene.surface), patch_results[0], gap)
    if "row" in data.sizes:
        _add_row_coordinate(data, scene, by_key)
    _add_heights(data, scene)
    first_result = next(iter(by_key.values()))
    fraction = first_result.contact_fraction_at(scene.steps)
    if not np.isnan(fraction).all():
        long_name = "fraction of the face in contact"
        contact = Field("contact_fraction", "1", long_name, STEP, "contact [%]")
        variables.add(data, contact, fraction)


def _result_with_realisations(by_key: Mapping[str, StudyResult]) -> StochasticResult | None:
    """Return the result that has realisations of a whole seal; None if there is none."""
    for result in by_key.values():
        if result.realisation_count is not None:
            return cast(StochasticResult, result)
    return None


def _add_row_coordinate(
    data: xarray.Dataset, scene: Scene, by_key: Mapping[str, StudyResult]
) -> None:
    """Add a coordinate with the centres of the rows whose mean contact pressure is stored, from inlet to outlet.

    The rows are those of a whole seal if their pressures are stored, and otherwise those of the surface.
    """
    seals = _result_with_realisations(by_key)
    width = scene.surface.size[0]
    if seals is not None and seals.row_pressure is not None:
        width = seals.seal.size[0]
    count = data.sizes["row"]
    centres = (np.arange(count) + 0.5) * (width / count)
    variables.add_coordinate(data, "row", "m", "x1 of rows, from the inlet", centres)


def _add_leakage(data: xarray.Dataset, study: Study, result: StudyResult) -> None:
    """Add the leakage that a study without realisations predicts."""
    long_name = f"leakage per unit seal length, {study.label}"
    declaration = Field(study.leakage_variable, "m^2/s", long_name, STEP, study.label)
    variables.add(data, declaration, result.predicted_leakage)


def _add_surface_study(
    data: xarray.Dataset, scene: Scene, study: Study, result: StudyResult
) -> None:
    """Add the fields that a study without realisations declares, including the fields of the cells, if any."""
    variables.add_declared(data, result)
    if study.has_pixel_fields:
        variables.add_block_means(data, scene, result)
    if result.cells is None:
        return
    cell_fields = [pair for pair in fields_of(result.cells) if pair[0].dimensions == CELL]
    if not cell_fields:
        return
    _, first_values = cell_fields[0]
    variables.add_cell_centres(data, "", Cut.of(scene.surface, first_values.shape[1:]))
    for declaration, values in cell_fields:
        variables.add(data, declaration, values)


def _add_realisations(
    data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]
) -> None:
    """Add the variables of a study with realisations of a whole seal.

    The variables are the leakages of all realisations, the fields of the cells in each contact state, and the fields of
    the realisation closest to the median leakage.
    """
    variables.add_realisations(data, result, quantiles)
    variables.add_states(data, result.cells)
    median = result.median_seal
    if median is not None:
        variables.add_declared(data, median)
        # "part" is the simulated fraction of the seal length
        attributes = {"realisation": median.realisation, "part": result.tiles.covered_fraction}
        data["drawn_corners"].attrs |= attributes


def _add_heights(data: xarray.Dataset, scene: Scene) -> None:
    """Add the heights of the face, averaged over blocks of pixels."""
    largest_count = variables.HEIGHT_BLOCKS
    variables.add_blocks(data, ("face1", "face2"), scene.surface, largest_count)
    heights = variables.block_means(scene.surface.heights, largest_count)
    long_name = "height of the face, mean of each block"
    variables.add_new(data, "face_height", "m", long_name, heights, FACE)


# --- attributes -------------------------------------------------------------------------------------------------


def _attributes(scene: Scene, by_key: Mapping[str, StudyResult], facts: RunFacts) -> dict[str, Any]:
    """Return the attributes of the dataset."""
    seals = _result_with_realisations(by_key)
    # without realisations of a whole seal, the seal is a strip as large as the face
    size = scene.surface.size
    seal: Layout = RectangularLayout()
    tile_attributes: dict[str, Any] = {}
    if seals is not None:
        tiles = seals.tiles
        size = tiles.size
        seal = scene.layout
        tile_attributes = {"tiles": str(tiles), "tiles_in_order": int(tiles.in_order)}
    basis = leak_basis(
        scene.fluid,
        float(size[1]),
        facts.throughput_temperature,
        pressure_drop=FluidState.of(scene).pressure_drop,
        **facts.valve,
    )
    attributes = {
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
        "seal": str(seal),
        "seal_kind": seal.kind,
        "seal_size_m": [float(length) for length in size],
        "leakage_unit": _unit_name(facts, basis),
        **_solver_attributes(by_key, facts.warnings),
        "fluid": variables.fluid_text(scene.fluid),
        "fluid_effect": scene.fluid_effect,
        "inlet_pressure_Pa": float(scene.inlet_pressure),
        "outlet_pressure_Pa": float(scene.outlet_pressure),
        "contact_modulus_Pa": float(scene.surface_modulus),
        "hardness_Pa": scene.law.mean_hardness,
        "contact_law": str(scene.law),
        **basis_attributes(basis),
        **facts.attributes,
        **tile_attributes,
    }
    if facts.case.get("seed") is not None:
        attributes["seed"] = facts.case["seed"]
    return attributes


def _solver_attributes(
    by_key: Mapping[str, StudyResult], warnings: Sequence[str]
) -> dict[str, str]:
    """Return the attributes with solver statistics, warnings and failures.

    Parameters
    ----------
    by_key : result of each study, by the key of the study; the best method comes last.
    warnings : warnings about the case.
    """
    solvers = {
        key: vars(study.solve_counts) | {"systems": dict(study.solve_counts.systems)}
        for key, study in by_key.items()
    }
    # The warnings of a study concern the input and the leakage that the study computed. The leakage of the last study
    # is the main result of the run, so that only the warnings of the last study are stored.
    last_study = list(by_key.values())[-1]
    all_warnings = [*warnings, *last_study.warnings]
    all_failures = [text for study in by_key.values() for text in study.failures]
    return {
        "solvers": _json(solvers),
        "warnings": _json(list(dict.fromkeys(all_warnings))),
        "failures": _json(list(dict.fromkeys(all_failures))),
    }


def _unit_name(facts: RunFacts, basis: LeakBasis) -> str:
    """Return the name of the leakage unit that the case gives, "" if the case gives no unit.

    Raises
    ------
    InputError : the unit suits neither the fluid nor the test fluid.
    """
    if facts.leakage_unit is None:
        return ""
    unit = leak_unit(facts.leakage_unit)
    suits_test_fluid = facts.test is not None and leak_basis(facts.test.state.fluid, 1.0).has(unit)
    if not suits_test_fluid:
        basis.factor(unit)  # raises an InputError if the unit does not suit the fluid
    return unit.name


def _open_steps(data: xarray.Dataset, scene: Scene) -> list[int]:
    """Return the steps without a computed leakage at which the fluid carries the whole load."""
    carries_all = np.zeros(len(scene.steps), bool)
    carries_all[[step for step, _ in scene.separated_steps]] = True
    if "contact_fraction" in data:
        carries_all |= data["contact_fraction"].values == 0
    steps: list[int] = np.flatnonzero(carries_all & np.isnan(best_leakage(data).values)).tolist()
    return steps


# --- classes and warnings ---------------------------------------------------------------------------------------


def _vague_leakage(data: xarray.Dataset) -> list[str]:
    """Return a warning if the leakage is uncertain by more than a factor of `VAGUE`, else an empty list."""
    budget = best_budget(data)
    if budget is None:
        return []
    steps = vague_steps(budget).tolist()
    if not steps:
        return []
    more = f" and {counted(len(steps) - 1, 'more load')}" if len(steps) > 1 else ""
    return [
        f"the leakage at {load_names(data)[steps[0]]}{more} is not known within a factor of {VAGUE:g}; "
        f"the widest source of error there is: {budget.limiting(steps[0])}"
    ]


def _json(value: Any) -> str:
    """Convert a value to JSON; values that JSON does not know become lists or strings."""
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    """Convert NumPy arrays and numbers to lists and numbers, and all other objects to text."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)
