"""Variables of the dataset: the declared fields of the studies' results, and those computed from several results.

A field over the load steps becomes a column of the file `table.csv`, and of the printed table if it has a heading. A
field over cells, or over the tiles of a realisation, becomes an array for ParaView.
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
    Field,
    Place,
    fields_of,
)
from ..base.leak_rates import LeakBasis
from ..base.leak_units import LEAK_UNITS
from ..base.machine import one_at_a_time
from ..base.quantities import with_its_unit
from ..budget import ErrorBudget
from ..face.cells import Cut
from ..fluids import FLUIDS, Fluid, leak_basis
from ..loads import LoadStep
from ..scene import FluidState
from ..studies import FaceResult, Scene, StochasticResult
from ..studies.cell_states import FaceCells, PatchLeakage
from ..studies.other_fluid import OtherLeakage, limit_factors
from ..topography import Patches, Surface
from .best_leakage import basis_attributes
from .load_steps import pressures_and_peaks

if TYPE_CHECKING:
    import xarray

#: Largest number of blocks along a side in maps of the heights, and of a field at every step.
HEIGHT_BLOCKS, FIELD_BLOCKS = 256, 128

# --- single variables -------------------------------------------------------------------------------------------


def add(data: xarray.Dataset, declaration: Field, values: Any, **attrs: Any) -> None:
    """Add a declared field, unless the dataset has a variable of this name.

    Parameters
    ----------
    data : dataset that is extended.
    declaration : name, unit, meaning and dimensions.
    values : in the shape of the dimensions.
    attrs : further attributes of the variable.
    """
    if declaration.name not in data:
        attributes = declaration.attrs | attrs
        data[declaration.name] = (declaration.place, values, attributes)


def add_new(
    data: xarray.Dataset,
    name: str,
    unit: str,
    long_name: str,
    values: Any,
    dims: Place = STEP,
    **attrs: Any,
) -> None:
    """Add a field that no result declares; arguments as of `Field` and `add`."""
    add(data, Field(name, unit, long_name, dims), values, **attrs)


def add_coordinate(
    data: xarray.Dataset, name: str, unit: str, long_name: str, values: Any, dim: str = ""
) -> None:
    """Add a coordinate along a dimension, which has its name unless given."""
    data.coords[name] = (dim or name, values, {"units": unit, "long_name": long_name})


def add_declared(data: xarray.Dataset, result: Any) -> None:
    """Add every declared field of a result, except the large ones over all pixels."""
    for declaration, values in fields_of(result):
        if declaration.place != PIXEL and np.size(values):
            add(data, declaration, values)


# --- load steps, cells and realisations -------------------------------------------------------------------------


def add_load_steps(data: xarray.Dataset, dim: str, prefix: str, steps: Sequence[LoadStep]) -> None:
    """Add the coordinates that describe load steps.

    Parameters
    ----------
    data : dataset that is extended.
    dim : dimension of the load steps, or of the states of a face.
    prefix : comes before the names of the coordinates.
    steps : the load steps.
    """
    pressures, peaks = pressures_and_peaks(steps)
    branch = [step.branch for step in steps]
    names = [step.name for step in steps]
    load = "nominal pressure"
    add_coordinate(data, dim, "1", "index of the load step", np.arange(len(steps)))
    for name, unit, long_name, values in (
        ("branch", "1", "branch of the load cycle", branch),
        ("nominal_pressure", "Pa", load, pressures),
        ("unloaded_from", "Pa", f"{load} from which the step is unloaded", peaks),
        ("name", "1", "name of the load step", names),
    ):
        add_coordinate(data, f"{prefix}{name}", unit, long_name, values, dim)


def add_cell_centres(data: xarray.Dataset, prefix: str, cut: Cut) -> None:
    """Add the coordinates of the cells of a face; the prefix comes before their names."""
    x1, x2 = cut.centres
    add_coordinate(data, f"{prefix}cell1", "m", "x1 of the centres of cells, from the inlet", x1)
    add_coordinate(data, f"{prefix}cell2", "m", "x2 of the centres of cells, along the seal", x2)


def add_realisations(
    data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]
) -> None:
    """Add the leakage of every realisation, its mean and median, and the quantiles if there are enough realisations."""
    add_declared(data, result)
    add_coordinate(data, "realisation", "1", "realisation", np.arange(len(result.leakage)))
    levels = {"median": 0.5}
    if not result.too_few(*quantiles):
        levels["lower"], levels["upper"] = quantiles
    for name, level in levels.items():
        statistic = "median" if name == "median" else f"{name} quantile {level:g}"
        long_name = f"leakage per unit seal length, {statistic} of the realisations"
        values = result.quantile(level)
        add_new(data, f"leakage_{name}", "m^2/s", long_name, values, quantile=level)


def add_states(data: xarray.Dataset, cells: FaceCells) -> None:
    """Add the contact states of the face, and its cells in each of them."""
    add_load_steps(data, "state", "state_", cells.steps)
    add_cell_centres(data, "state_", cells.cut)
    for declaration, values in fields_of(cells):
        if declaration.place == CELL:
            declaration = replace(
                declaration,
                name=declaration.name.replace("cell_", "state_"),
                long_name=f"{declaration.long_name}, by state",
                place=CELL_STATE,
            )
        if declaration.place == STATE or not np.isnan(values).all():
            add(data, declaration, values)


def add_patches(
    data: xarray.Dataset, patches: Patches, result: PatchLeakage, gaps: NDArray[Any] | None
) -> None:
    """Add the leakage of each measured patch and its scatter, and a map of the patch that leaks most.

    Parameters
    ----------
    data : dataset that is extended.
    patches : the measured patches.
    result : their leakages.
    gaps : gaps of all patches at every step (step, x1, x2) [m]; None if they are not known.
    """
    numbers = np.arange(1, len(result.alone) + 1)
    add_coordinate(data, "patch", "1", "number of the measured patch", numbers)
    add_declared(data, result)
    ratios = result.relative
    largest = int(np.argmax(ratios))
    add_blocks(data, ("patch1", "patch2"), patches.patches[largest], FIELD_BLOCKS)
    about = {"patch": largest + 1, "over_mean": float(ratios[largest])}
    heights = block_means(patches.divided(patches.heights)[largest], FIELD_BLOCKS)
    long_name = "height of the patch that leaks most, mean of each block"
    add_new(data, "patch_height", "m", long_name, heights, PATCH_FACE, **about)
    if gaps is not None:
        means = [block_means(patches.divided(gap)[largest], FIELD_BLOCKS) for gap in gaps]
        long_name = "gap of the patch that leaks most, mean of each block"
        add_new(data, "patch_gap", "m", long_name, np.array(means), PATCH_BLOCK)


# --- maps of blocks of pixels -----------------------------------------------------------------------------------


def add_block_means(data: xarray.Dataset, scene: Scene, study: FaceResult) -> None:
    """Add the fields over all pixels as means over blocks, as the fields themselves are too large for the dataset."""
    add_blocks(data, ("block1", "block2"), scene.surface, FIELD_BLOCKS)
    for declaration, at_pixels in fields_of(study):
        if declaration.place == PIXEL:
            means = [block_means(values, FIELD_BLOCKS) for values in one_at_a_time(at_pixels)]
            name, unit = f"face_{declaration.name}", declaration.unit
            long_name = f"{declaration.long_name}, mean of each block"
            add_new(data, name, unit, long_name, np.array(means), BLOCK)


def add_blocks(data: xarray.Dataset, dims: tuple[str, str], face: Surface, most: int) -> None:
    """Add the coordinates of the blocks of a face, at most `most` along each side."""
    for axis, dim in enumerate(dims):
        count = min(face.shape[axis], most)
        centres = (np.arange(count) + 0.5) * face.size[axis] / count
        add_coordinate(data, dim, "m", f"x{axis + 1} of block centres", centres)


def block_means(values: NDArray[Any], most: int) -> NDArray[np.float32]:
    """Return means over blocks of pixels.

    Parameters
    ----------
    values : (n1, n2); NaN is left out.
    most : largest number of blocks along each side. If it does not divide the side, blocks differ by a pixel.

    Returns
    -------
    Means of the blocks, NaN where all values are NaN.
    """
    count: NDArray[Any] = ~np.isnan(values)
    total = np.where(count, values, 0.0)
    for axis, pixels in enumerate(values.shape):
        blocks = min(pixels, most)
        starts = np.arange(blocks) * pixels // blocks
        total = np.add.reduceat(total, starts, axis, dtype=float)
        count = np.add.reduceat(count, starts, axis, dtype=float)
    with np.errstate(invalid="ignore"):  # 0/0 is NaN
        return (total / count).astype(np.float32)


# --- leakage of the whole seal, and error budgets ---------------------------------------------------------------


def add_totals(data: xarray.Dataset, leakage: xarray.DataArray, basis: LeakBasis) -> None:
    """Add the leakage of the whole seal by volume, by mass and, for a gas, as pressure × volume; and in more units."""
    statistic = leakage.attrs["long_name"].rpartition(", ")[2]
    at, stated = "", ""
    if basis.temperature is not None:
        at = f" at {basis.temperature:g} K and {basis.pressure:g} Pa"
    if basis.stated_temperature is not None:
        stated = f" at {basis.stated_temperature:g} K"
    for suffix, unit, si_unit, measure in (
        ("", "m³/s", "m^3/s", f"by volume{at}"),
        ("_mass", "kg/s", "kg/s", "by mass"),
        ("_throughput", "Pa·m³/s", "Pa*m^3/s", f"pressure × volume{stated}"),
    ):
        leak_unit = LEAK_UNITS[unit]
        if basis.has(leak_unit):
            values = leakage.values / basis.factor(leak_unit)
            long_name = f"leakage of the whole seal, {statistic}, {measure}"
            add_new(data, f"leakage_total{suffix}", si_unit, long_name, values)
    units = basis.units()
    add_coordinate(data, "leak_unit", "1", "unit of leakage", [unit.name for unit in units])
    in_units = np.array([leakage.values / basis.factor(unit) for unit in units])
    long_name = f"leakage in units of leak_unit{stated}"
    add_new(data, "leakage_in_units", "1", long_name, in_units, ("leak_unit", "step"))


def add_budgets(data: xarray.Dataset, budgets: Mapping[str, ErrorBudget]) -> None:
    """Add the 95 % interval of every leakage, and the interval by each source of error alone.

    Parameters
    ----------
    data : dataset that is extended.
    budgets : by the name of their method in variables.
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
    """Add the interval of one method, and the interval by each of the sources."""
    parts = {part.name: part for part in budget.parts}
    numerical = budget.numerical
    name = f"leakage_{method}_budget"
    for end in ("lower", "upper"):
        meaning = f"{end} end of the 95 % interval of the leakage, {method.replace('_', '-')}"
        add_new(data, f"{name}_{end}", "m^2/s", meaning, getattr(budget, end))
        if len(numerical.parts) < len(parts):
            text = f"{meaning}, of its solution alone"
            add_new(data, f"{name}_numerical_{end}", "m^2/s", text, getattr(numerical, end))
        # a source that does not apply to the method has an interval without width
        ends = [getattr(parts.get(source), end, budget.leakage) for source in sources]
        text = f"{meaning}, of each source"
        add_new(data, f"{name}_part_{end}", "m^2/s", text, np.array(ends), ERROR_SOURCE)


# --- fluids -----------------------------------------------------------------------------------------------------


def add_test_fluid(
    data: xarray.Dataset,
    test: OtherLeakage,
    service: FluidState,
    stated_temperature: float | None,
    valve: Mapping[str, float],
) -> None:
    """Add the leakage of the test fluid, and attributes with its state.

    Parameters
    ----------
    data : dataset that is extended.
    test : leakage of the test fluid.
    service : fluid of the run, for the factors by which leakage would change in viscous and in molecular flow.
    stated_temperature : at which pressure × volume of a gas is given [K]; its own unless given.
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
    basis = leak_basis(state.fluid, 1.0, stated_temperature, pressure_drop=drop, **valve)
    data.attrs |= {
        "test_fluid": fluid_text(state.fluid),
        "test_inlet_pressure_Pa": float(state.inlet_pressure),
        "test_outlet_pressure_Pa": float(state.outlet_pressure),
        "test_viscous_factor": factors.viscous,
        "test_molecular_factor": factors.molecular,
        **basis_attributes(basis, "test_"),
    }


def fluid_text(fluid: Fluid) -> str:
    """Return kind and parameters of a fluid; of a user's own fluid the text that Python shows.

    >>> import femseal as fs
    >>> fluid_text(fs.IdealGas(1.8e-5, 0.029, 293.0))
    'ideal-gas, viscosity 18 µPa·s, molar mass 0.029 kg/mol, temperature 293 K, slip'
    """
    kinds = {cls: kind for kind, cls in FLUIDS.items()}
    if type(fluid) not in kinds:
        return repr(fluid)
    texts = [kinds[type(fluid)]]
    for parameter in fields(fluid):  # type: ignore[arg-type]
        name, value = parameter.name.replace("_", " "), getattr(fluid, parameter.name)
        if isinstance(value, bool):
            texts.append(name if value else f"no {name}")
        elif isinstance(value, str):
            texts.append(value)
        elif value:
            texts.append(f"{name} {with_its_unit(value, parameter.metadata['unit'])}")
    return ", ".join(texts)
