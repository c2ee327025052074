"""Add variables to the dataset of a run.

Most variables are fields that the result of a study declares. All other variables are computed from the results of
several studies. A variable with a value for each load step is written to a column of the file `table.csv`; if the
variable has a heading, it is also shown in the printed table. A variable with a value for each cell or tile is written
to the files for ParaView.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base.fields import (
    BLOCK,
    CELL,
    CELL_STATE,
    ERROR_SOURCE,
    PATCH_BLOCK,
    PATCH_FACE,
    PIXEL,
    REALISATION,
    STATE,
    STEP,
    Dimensions,
    Field,
    fields_of,
)
from ..base.leak_rates import LeakBasis
from ..base.leak_units import LEAK_UNITS
from ..base.quantities import with_its_unit
from ..base.shared_arrays import one_at_a_time
from ..budget import ErrorBudget
from ..face.cut import Cut
from ..fluids import FLUIDS, Fluid, leak_basis
from ..loads import LoadStep
from ..scene import FluidState
from ..studies import Scene, StochasticResult, Study, StudyResult
from ..studies.cell_states import FaceCells
from ..studies.other_fluid import OtherLeakage, limit_factors
from ..studies.patch_leakage import PatchLeakage
from ..topography import Patches, Surface
from .best_leakage import basis_attributes
from .load_steps import pressures_and_peaks

if TYPE_CHECKING:
    import xarray

#: Largest number of blocks along each side of three kinds of maps: the map of the heights, maps of a measured patch,
#: and maps of fields that change with the load.
HEIGHT_BLOCKS, PATCH_BLOCKS, FIELD_BLOCKS = 512, 256, 128

# --- single variables -------------------------------------------------------------------------------------------


def add(data: xarray.Dataset, declaration: Field, values: Any, **attrs: Any) -> None:
    """Add a declared field to a dataset, unless the dataset already has a variable with this name.

    Parameters
    ----------
    data : dataset that is extended.
    declaration : name, unit, description and dimensions of the field.
    values : values of the field, with one axis for each dimension.
    attrs : further attributes of the variable.
    """
    if declaration.name not in data:
        attributes = declaration.attrs | attrs
        data[declaration.name] = (declaration.dimensions, values, attributes)


def add_new(
    data: xarray.Dataset,
    name: str,
    unit: str,
    long_name: str,
    values: Any,
    dims: Dimensions = STEP,
    **attrs: Any,
) -> None:
    """Add a variable that no study declares as a field; see `Field` and `add` for the arguments."""
    add(data, Field(name, unit, long_name, dims), values, **attrs)


def add_coordinate(
    data: xarray.Dataset, name: str, unit: str, long_name: str, values: Any, dim: str = ""
) -> None:
    """Add a coordinate along the dimension `dim`; by default, the dimension has the name of the coordinate."""
    data.coords[name] = (dim or name, values, {"units": unit, "long_name": long_name})


def add_declared(data: xarray.Dataset, result: Any) -> None:
    """Add all declared fields of a result except the pixel fields, which are too large."""
    for declaration, values in fields_of(result):
        if declaration.dimensions != PIXEL and np.size(values):
            add(data, declaration, values)


# --- load steps, cells and realisations -------------------------------------------------------------------------


def add_load_steps(data: xarray.Dataset, dim: str, prefix: str, steps: Sequence[LoadStep]) -> None:
    """Add the coordinates that describe load steps.

    Parameters
    ----------
    data : dataset that is extended.
    dim : name of the dimension, "step" for load steps or "state" for the contact states of a face.
    prefix : text at the beginning of the names of the coordinates, such as "state_".
    steps : load steps of the run or, for `dim` "state", load step of each contact state.
    """
    pressures, peaks = pressures_and_peaks(steps)
    branch = [step.branch for step in steps]
    names = [step.name for step in steps]
    add_coordinate(data, dim, "1", "index of the load step", np.arange(len(steps)))

    def add_along(name: str, unit: str, long_name: str, values: Any) -> None:
        add_coordinate(data, f"{prefix}{name}", unit, long_name, values, dim)

    add_along("branch", "1", "branch of the load cycle", branch)
    add_along("nominal_pressure", "Pa", "nominal pressure", pressures)
    add_along("unloaded_from", "Pa", "nominal pressure from which the step is unloaded", peaks)
    add_along("name", "1", "name of the load step", names)


def add_cell_centres(data: xarray.Dataset, prefix: str, cut: Cut) -> None:
    """Add two coordinates with the positions of the cell centres; their names begin with `prefix`."""
    x1, x2 = cut.centres
    add_coordinate(data, f"{prefix}cell1", "m", "x1 of the centres of cells, from the inlet", x1)
    add_coordinate(data, f"{prefix}cell2", "m", "x2 of the centres of cells, along the seal", x2)


def add_realisations(
    data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]
) -> None:
    """Add the leakage of every realisation, its mean and its median.

    Parameters
    ----------
    data : dataset that is extended.
    result : result of the stochastic study.
    quantiles : probabilities of the lower and upper quantiles of the leakage. The quantiles are only added if the
        number of realisations is sufficient.
    """
    add_declared(data, result)
    add_coordinate(data, "realisation", "1", "realisation", np.arange(len(result.leakage)))
    levels = {"median": 0.5}
    if not result.has_too_few_for(*quantiles):
        levels["lower"], levels["upper"] = quantiles
    for name, level in levels.items():
        statistic = "median" if name == "median" else f"{name} quantile {level:g}"
        long_name = f"leakage per unit seal length, {statistic} of the realisations"
        values = result.quantile(level)
        add_new(data, f"leakage_{name}", "m^2/s", long_name, values, quantile=level)


def add_states(data: xarray.Dataset, cells: FaceCells) -> None:
    """Add the contact states of the face and, for each state, the fields of the cells of the face.

    In a stochastic study, the loads of contact states and load steps can differ. Fields for contact states are
    renamed from "cell_..." to "state_...", so that they are not mistaken for fields at load steps.
    """
    add_load_steps(data, "state", "state_", cells.steps)
    add_cell_centres(data, "state_", cells.cut)
    for declaration, values in fields_of(cells):
        if declaration.dimensions == CELL:
            name = f"state_{declaration.name.removeprefix('cell_')}"
            long_name = f"{declaration.long_name}, by state"
            declaration = replace(
                declaration, name=name, long_name=long_name, dimensions=CELL_STATE
            )
        is_known = not np.isnan(values).all()
        if declaration.dimensions == STATE or is_known:
            add(data, declaration, values)


def add_patches(
    data: xarray.Dataset, patches: Patches, result: PatchLeakage, gaps: NDArray[Any] | None
) -> None:
    """Add the leakage of each measured patch, the scatter between patches, and maps of the patch that leaks most.

    Parameters
    ----------
    data : dataset that is extended.
    patches : measured patches.
    result : leakages that were computed for the single patches.
    gaps : gap of the surface at every step (step, x1, x2) [m]; None if the gap is unknown. The patches lie side by side
        in the surface.
    """
    numbers = np.arange(1, len(result.alone) + 1)
    add_coordinate(data, "patch", "1", "number of the measured patch", numbers)
    add_declared(data, result)
    ratios = result.relative
    leakiest = int(np.argmax(ratios))
    add_blocks(data, ("patch1", "patch2"), patches.patches[leakiest], PATCH_BLOCKS)
    attributes = {"patch": leakiest + 1, "over_mean": float(ratios[leakiest])}
    heights = block_means(patches.split(patches.heights)[leakiest], PATCH_BLOCKS)
    long_name = "height of the patch that leaks most, mean of each block"
    add_new(data, "patch_height", "m", long_name, heights, PATCH_FACE, **attributes)
    if gaps is not None:
        means = [block_means(patches.split(gap)[leakiest], PATCH_BLOCKS) for gap in gaps]
        long_name = "gap of the patch that leaks most, mean of each block"
        add_new(data, "patch_gap", "m", long_name, np.array(means), PATCH_BLOCK)


# --- maps of blocks of pixels -----------------------------------------------------------------------------------


def add_block_means(data: xarray.Dataset, scene: Scene, study: StudyResult) -> None:
    """Average the pixel fields that a study declares over blocks of pixels, and add the averages to the dataset.

    The fields with all pixels would be too large for the dataset.
    """
    add_blocks(data, ("block1", "block2"), scene.surface, FIELD_BLOCKS)
    for declaration, at_pixels in fields_of(study):
        if declaration.dimensions == PIXEL:
            means = [block_means(values, FIELD_BLOCKS) for values in one_at_a_time(at_pixels)]
            name, unit = f"face_{declaration.name}", declaration.unit
            long_name = f"{declaration.long_name}, mean of each block"
            add_new(data, name, unit, long_name, np.array(means), BLOCK)


def add_blocks(
    data: xarray.Dataset, dims: tuple[str, str], face: Surface, largest_count: int
) -> None:
    """Add two coordinates with the centres of blocks of pixels.

    Parameters
    ----------
    data : dataset that is extended.
    dims : dimensions of the blocks along x1 and x2.
    face : surface that is divided into blocks.
    largest_count : largest number of blocks along each side.
    """
    for axis, dim in enumerate(dims):
        count = min(face.shape[axis], largest_count)
        centres = (np.arange(count) + 0.5) * face.size[axis] / count
        add_coordinate(data, dim, "m", f"x{axis + 1} of block centres", centres)


def block_means(values: NDArray[Any], largest_count: int) -> NDArray[np.float32]:
    """Average the values at the pixels over blocks of pixels.

    Parameters
    ----------
    values : values at the pixels (n1, n2). Pixels with NaN are ignored.
    largest_count : largest number of blocks along each side. If the number of pixels is not a multiple of the number
        of blocks, some blocks are one pixel longer than the others.

    Returns
    -------
    Mean of each block, NaN if all values of the block are NaN.
    """
    # sums and numbers of the known values; at first, each pixel is a block
    count: NDArray[Any] = ~np.isnan(values)
    total = np.where(count, values, 0.0)
    for axis, pixels in enumerate(values.shape):
        blocks = min(pixels, largest_count)
        first_pixels = np.arange(blocks) * pixels // blocks
        # `reduceat` adds the values from the first pixel of each block up to the first pixel of the next block
        total = np.add.reduceat(total, first_pixels, axis, dtype=float)
        count = np.add.reduceat(count, first_pixels, axis, dtype=float)
    with np.errstate(invalid="ignore"):  # 0/0 is NaN
        return (total / count).astype(np.float32)


# --- leakage of the whole seal, and error budgets ---------------------------------------------------------------


def add_totals(data: xarray.Dataset, study: Study, basis: LeakBasis) -> None:
    """Add the leakage of the whole seal as a volume rate, as a mass rate, and in all other suitable units.

    For a gas, the throughput (pressure × volume per time) of the whole seal is also added.

    Parameters
    ----------
    data : dataset that is extended.
    study : study whose leakage is the main result of the run.
    basis : seal length and properties of the fluid that are needed to convert the leakage.
    """
    leakage = data[study.leakage_variable]  # (step,) [m²/s]
    volume_state = ""
    throughput_state = ""
    if basis.temperature is not None:
        volume_state = f" at {basis.temperature:g} K and {basis.pressure:g} Pa"
    if basis.throughput_temperature is not None:
        throughput_state = f" at {basis.throughput_temperature:g} K"

    def add_total(suffix: str, unit_name: str, si_unit: str, measure: str) -> None:
        """Add the variable `leakage_total` + suffix, if the unit suits the fluid."""
        unit = LEAK_UNITS[unit_name]
        if basis.has(unit):
            values = leakage.values / basis.factor(unit)
            long_name = f"leakage of the whole seal, {study.title}, {measure}"
            add_new(data, f"leakage_total{suffix}", si_unit, long_name, values)

    add_total("", "m³/s", "m^3/s", f"by volume{volume_state}")
    add_total("_mass", "kg/s", "kg/s", "by mass")
    add_total("_throughput", "Pa·m³/s", "Pa*m^3/s", f"pressure × volume{throughput_state}")
    # the leakage in every unit that suits the fluid, (unit, step)
    units = basis.units()
    add_coordinate(data, "leak_unit", "1", "unit of leakage", [unit.name for unit in units])
    in_units = np.array([leakage.values / basis.factor(unit) for unit in units])
    long_name = f"leakage in units of leak_unit{throughput_state}"
    add_new(data, "leakage_in_units", "1", long_name, in_units, ("leak_unit", "step"))


def add_budgets(data: xarray.Dataset, budgets: Mapping[str, ErrorBudget]) -> None:
    """Add the 95 % interval of each computed leakage, and the interval that each error source would cause alone.

    Parameters
    ----------
    data : dataset that is extended.
    budgets : error budget of each method, keyed by the name that the method has in variable names, such as "two_scale".
    """
    if not budgets:
        return
    sources = dict.fromkeys(part.name for budget in budgets.values() for part in budget.parts)
    add_coordinate(data, "budget_part", "1", "source of error of the leakage", list(sources))
    notes = {}
    for method, budget in budgets.items():
        _add_budget(data, method, budget, list(sources))
        notes[method] = {part.name: part.note for part in budget.parts}
    data.attrs["error_budget"] = json.dumps(notes, ensure_ascii=False)


def _add_budget(data: xarray.Dataset, method: str, budget: ErrorBudget, sources: list[str]) -> None:
    """Add the 95 % interval of the leakage of a method, and the interval that each error source would cause alone."""
    parts = {part.name: part for part in budget.parts}
    numerical = budget.numerical
    name = f"leakage_{method}_budget"
    for end in ("lower", "upper"):
        meaning = f"{end} end of the 95 % interval of the leakage, {budget.method}"
        add_new(data, f"{name}_{end}", "m^2/s", meaning, getattr(budget, end))
        if len(numerical.parts) < len(parts):
            text = f"{meaning}, from the numerical error sources alone"
            add_new(data, f"{name}_numerical_{end}", "m^2/s", text, getattr(numerical, end))
        # a source that does not apply to the method has an interval of zero width, at the leakage itself
        ends = [getattr(parts.get(source), end, budget.leakage) for source in sources]
        text = f"{meaning}, from each error source alone"
        add_new(data, f"{name}_part_{end}", "m^2/s", text, np.array(ends), ERROR_SOURCE)


# --- fluids -----------------------------------------------------------------------------------------------------


def add_test_fluid(
    data: xarray.Dataset,
    test: OtherLeakage,
    service: FluidState,
    throughput_temperature: float | None,
    valve: Mapping[str, float],
) -> None:
    """Add the leakage of the test fluid, and attributes that describe the fluid and its pressures.

    Parameters
    ----------
    data : dataset that is extended.
    test : leakage of the test fluid.
    service : service fluid with its pressures. The ratio of the test leakage to the service leakage is stored as
        attributes, for viscous flow and for molecular flow.
    throughput_temperature : temperature at which the throughput of a gas is given [K]; None for the temperature of the
        gas itself.
    valve : arguments of `LeakBasis` that describe the valve.
    """
    long_name = "leakage per unit seal length, test fluid"
    add_new(data, "test_leakage", "m^2/s", long_name, test.leakage)
    if test.realisations is not None:
        name = "test_leakage_realisations"
        add_new(data, name, "m^2/s", long_name, test.realisations, REALISATION)
    state = test.state
    factors = limit_factors(state, service)
    drop = state.pressure_drop
    basis = leak_basis(state.fluid, 1.0, throughput_temperature, pressure_drop=drop, **valve)
    data.attrs |= {
        "test_fluid": fluid_text(state.fluid),
        "test_inlet_pressure_Pa": float(state.inlet_pressure),
        "test_outlet_pressure_Pa": float(state.outlet_pressure),
        "test_viscous_factor": factors.viscous,
        "test_molecular_factor": factors.molecular,
        **basis_attributes(basis, "test_"),
    }


def fluid_text(fluid: Fluid) -> str:
    """Describe a fluid by its kind and parameters, or by its `repr` if its class was defined by the user.

    >>> import femseal as fs
    >>> fluid_text(fs.IdealGas(1.8e-5, 0.029, 293.0))
    'ideal-gas, viscosity 18 µPa·s, molar mass 0.029 kg/mol, temperature 293 K, slip'
    """
    kind_by_class = {fluid_class: kind for kind, fluid_class in FLUIDS.items()}
    if type(fluid) not in kind_by_class:
        return repr(fluid)
    texts = [kind_by_class[type(fluid)]]
    for parameter in fields(fluid):  # type: ignore[arg-type]
        name = parameter.name.replace("_", " ")
        value = getattr(fluid, parameter.name)
        if isinstance(value, bool):
            texts.append(name if value else f"no {name}")
        elif isinstance(value, str):
            texts.append(value)
        elif value:
            texts.append(f"{name} {with_its_unit(value, parameter.metadata['unit'])}")
    return ", ".join(texts)
