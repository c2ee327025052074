"""The dataset of a run: the results of all studies of a scene, with units and meanings."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, cast

import numpy as np
import xarray

from ..base import InputError, Pair, counted, versions
from ..base.fields import CELL, FACE, STEP, Field, fields_of
from ..base.leak_rates import LeakBasis, leak_classes
from ..base.leak_units import leak_unit
from ..base.machine import machine, peak_memory
from ..budget import VAGUE, ErrorBudget, vague_steps
from ..face.cells import Cut
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
from .best_leakage import (
    basis_attributes,
    best_budget,
    best_leakage,
    class_basis_of,
    class_leakage_of,
    class_leakage_of_realisations,
    failed_steps,
    leak_basis_of,
)
from .leakage_classes import DecidingLeakage, add_classes
from .load_steps import load_names
from .results import Results


@dataclass(frozen=True)
class RunFacts:
    """What is known of a run besides its scene and the results of its studies.

    Attributes
    ----------
    case : mapping
        The case in SI, as plain data. Its "seed", if any, is stored by itself as well.
    surface : mapping
        What was done to the measured surface.
    timings : mapping
        Wall time of each stage [s].
    quantiles : (float, float)
        Lower and upper quantile of the realisations that are stored.
    warnings : tuple of str
        Warnings about the case; those of the studies come after them.
    leakage_unit : str or None
        Unit of leakage in tables, pictures and report, see `base.leak_rates`, for the fluid, the test fluid or both; a
        readable one per length of seal unless given.
    budgets : mapping
        Error budgets of the studies, by their keys.
    test : OtherLeakage or None
        Leakage of a test fluid through the same seals.
    classes : sequence of str
        Leakage classes that are checked at every step, by the leakage of the test fluid if there is one.
    nominal_diameter : float or None
        That some classes need [m].
    throughput_temperature : float or None
        Temperature for pressure × volume of a gas [K]; its own unless given.
    valve : mapping
        Volumes of a drop and a bubble, and rated capacity: `drop`, `bubble`, `capacity` of `LeakBasis`.
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
    """Collect the results of the studies of a scene in one dataset.

    Parameters
    ----------
    scene : Scene
        Input of the studies.
    *studies : StudyResult
        Results of at least one study.
    facts : RunFacts
        What else is known of the run.

    Returns
    -------
    Results
        Every variable of the dataset has the attributes `units` and `long_name`. Its dimensions are: step; realisation;
        cell1, cell2, cells by their centres [m]; state, state_cell1, state_cell2, contact states of the face and
        its cells in them; place1, place2, blocks of the measured patch that leaks most; part, corner, plane, tiles of
        the realisation nearest to the median; budget_part, sources of error. Attributes store the case, the surface,
        versions, machine, wall times, peak memory of the main process, numbers of linear systems by solver with the
        largest imbalance between inlet and outlet (`solvers`), notes on the errors (`error_budget`), warnings and
        failures.

    Raises
    ------
    InputError
        There is no study, a study has another load programme, or a unit or class does not exist or is not for the
        fluid.
    """
    if not studies:
        raise InputError("results", "no study", "at least one")
    if any(study.steps != scene.steps for study in studies):
        raise InputError("results", "a study of another load programme", "those of the scene")
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
    variables.add_totals(data, best_leakage(data), leak_basis_of(data))
    if facts.test is not None:
        service, temperature = FluidState.of(scene), facts.throughput_temperature
        variables.add_test_fluid(data, facts.test, service, temperature, facts.valve)
    results = Results(data, None, scene, by_key)
    warnings = [*_vague_leakage(data), *_add_classes(data, facts)]
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
    """Add the fields of all studies.

    Parameters
    ----------
    data : dataset that is extended.
    scene : input of the studies.
    by_key : results of the studies.
    quantiles : lower and upper quantile of the realisations.
    """
    faces = [study for study in by_key.values() if isinstance(study, FaceResult)]
    for face in faces:
        study = STUDIES[face.method]
        long_name = f"leakage per unit seal length, {study.label}"
        leakage = Field(study.leakage_variable, "m^2/s", long_name, STEP, study.label)
        variables.add(data, leakage, face.leakage)
    if faces:
        # the two-scale study, if there is one, has the fields of the deterministic one too
        _add_face(data, scene, faces[-1])
    blocks = by_key.get("blocks")
    if isinstance(blocks, BlocksResult):
        cut = Cut.of(scene.surface, blocks.pressure.shape[1:])
        variables.add_cell_centres(data, "", cut)
        variables.add_declared(data, blocks)
    stochastic = by_key.get("stochastic")
    breadth = scene.surface.size[0]
    if isinstance(stochastic, StochasticResult):
        _add_stochastic(data, stochastic, quantiles)
        if stochastic.row_pressure is not None:
            breadth = stochastic.seal.size[0]
    of_patches = next(
        (study.patches for study in by_key.values() if study.patches is not None), None
    )
    if of_patches is not None:
        gap = faces[-1].gap if faces else None
        variables.add_patches(data, cast(Patches, scene.surface), of_patches, gap)
    if "row" in data.sizes:
        count = data.sizes["row"]
        rows = (np.arange(count) + 0.5) * (breadth / count)
        variables.add_coordinate(data, "row", "m", "x1 of rows, from the inlet", rows)
    _add_heights(data, scene)
    fraction = contact_fraction_of(next(iter(by_key.values())), scene.steps)
    if not np.isnan(fraction).all():
        long_name = "fraction of the face in contact"
        contact = Field("contact_fraction", "1", long_name, STEP, "contact [%]")
        variables.add(data, contact, fraction)


def _add_face(data: xarray.Dataset, scene: Scene, face: FaceResult) -> None:
    """Add the fields of a study of the whole face, and of its cells if it has any."""
    variables.add_declared(data, face)
    variables.add_block_means(data, scene, face)
    if face.cells is None:
        return
    variables.add_cell_centres(data, "", face.cells.cut)
    for declaration, values in fields_of(face.cells):
        if declaration.place == CELL:
            variables.add(data, declaration, values)


def _add_stochastic(
    data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]
) -> None:
    """Add the realisations, the states of the face, and the realisation nearest to the median."""
    variables.add_realisations(data, result, quantiles)
    variables.add_states(data, result.cells)
    median = result.median_seal
    if median is not None:
        variables.add_declared(data, median)
        about = {"realisation": median.realisation, "part": result.tiles.part}
        data["drawn_corners"].attrs |= about


def _add_heights(data: xarray.Dataset, scene: Scene) -> None:
    """Add the heights of the face as means over blocks."""
    most = variables.HEIGHT_BLOCKS
    variables.add_blocks(data, ("face1", "face2"), scene.surface, most)
    heights = variables.block_means(scene.surface.heights, most)
    long_name = "height of the face, mean of each block"
    variables.add_new(data, "face_height", "m", long_name, heights, FACE)


# --- attributes -------------------------------------------------------------------------------------------------


def _attributes(scene: Scene, by_key: Mapping[str, StudyResult], facts: RunFacts) -> dict[str, Any]:
    """Return the attributes of the dataset."""
    stochastic = by_key.get("stochastic")
    size, seal, about_tiles = scene.surface.size, "a strip", {}
    if isinstance(stochastic, StochasticResult):
        tiles = stochastic.tiles
        size, seal = tiles.size, str(scene.layout)
        about_tiles = {"tiles": str(tiles), "tiles_in_place": int(tiles.in_order)}
    basis = _leak_basis(scene, size, facts)
    seed = facts.case.get("seed")
    return {
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
        "seal": seal,
        "seal_size_m": [float(length) for length in size],
        "leakage_unit": _unit_name(facts, basis),
        **_solver_attributes(by_key, facts.warnings),
        "fluid": variables.fluid_text(scene.fluid),
        "fluid_effect": scene.fluid_effect,
        "inlet_pressure_Pa": float(scene.inlet_pressure),
        "outlet_pressure_Pa": float(scene.outlet_pressure),
        "contact_modulus_Pa": float(scene.modulus),
        "hardness_Pa": scene.law.mean_hardness,
        "contact_law": str(scene.law),
        **basis_attributes(basis),
        **facts.attributes,
        **about_tiles,
        **({} if seed is None else {"seed": seed}),
    }


def _leak_basis(scene: Scene, size: Pair, facts: RunFacts) -> LeakBasis:
    """Return the basis of leakage of the fluid of a scene, for a seal of breadth and length [m]."""
    return leak_basis(
        scene.fluid,
        float(size[1]),
        facts.throughput_temperature,
        pressure_drop=FluidState.of(scene).pressure_drop,
        **facts.valve,
    )


def _solver_attributes(
    by_key: Mapping[str, StudyResult], warnings: Sequence[str]
) -> dict[str, str]:
    """Return the attributes with what the studies have solved, and their warnings and failures."""
    solvers = {
        key: vars(study.solvers) | {"systems": dict(study.solvers.systems)}
        for key, study in by_key.items()
    }
    # every study checks the scene and its own leakage; the results give the leakage of the last one
    last_study = list(by_key.values())[-1]
    all_warnings = [*warnings, *last_study.warnings]
    all_failures = [text for study in by_key.values() for text in study.failures]
    return {
        "solvers": _json(solvers),
        "warnings": _json(list(dict.fromkeys(all_warnings))),
        "failures": _json(list(dict.fromkeys(all_failures))),
    }


def _unit_name(facts: RunFacts, basis: LeakBasis) -> str:
    """Return the name of the unit that is asked for, "" without one; InputError if it is for neither fluid."""
    if facts.leakage_unit is None:
        return ""
    unit = leak_unit(facts.leakage_unit)
    is_for_test = facts.test is not None and leak_basis(facts.test.state.fluid, 1.0).has(unit)
    if not is_for_test:
        basis.factor(unit)  # raises the error
    return unit.name


def _open_steps(data: xarray.Dataset, scene: Scene) -> list[int]:
    """Return the steps without leakage at which the fluid carries all of the load."""
    carries_all = np.zeros(len(scene.steps), bool)
    carries_all[[step for step, _ in scene.separated_steps]] = True
    if "contact_fraction" in data:
        carries_all |= data["contact_fraction"].values == 0
    steps: list[int] = np.flatnonzero(carries_all & np.isnan(best_leakage(data).values)).tolist()
    return steps


# --- classes and warnings ---------------------------------------------------------------------------------------


def _add_classes(data: xarray.Dataset, facts: RunFacts) -> list[str]:
    """Add which leakage classes are met, and return warnings."""
    budget = best_budget(data)
    # a load at which the computation of either fluid failed meets no class
    leakage = np.where(failed_steps(data), np.nan, class_leakage_of(data))
    deciding = DecidingLeakage(
        basis=class_basis_of(data),
        leakage=leakage,
        of_realisations=class_leakage_of_realisations(data),
        upper=None if budget is None else budget.upper,
    )
    return add_classes(data, leak_classes(facts.classes), deciding, facts.nominal_diameter)


def _vague_leakage(data: xarray.Dataset) -> list[str]:
    """Return a warning if the error of the leakage is larger than a factor of `VAGUE`, else an empty list."""
    budget = best_budget(data)
    steps = [] if budget is None else vague_steps(budget).tolist()
    if budget is None or not steps:
        return []
    more = f" and {counted(len(steps) - 1, 'more load')}" if len(steps) > 1 else ""
    return [
        f"the leakage at {load_names(data)[steps[0]]}{more} is not known within a factor of {VAGUE:g}; "
        f"the widest source of error there is: {budget.limiting(steps[0])}"
    ]


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, default=_plain)


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)
