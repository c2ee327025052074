"""Variables of the dataset: the declared fields of the studies' results, and those that are computed from several.

A field over the load steps is a column of the tables, with a heading also of the table for people; one over pieces, or
over parts of the drawn seal, is an array in ParaView. Last come the leakage classes that a seal meets at each load
step, by the leakage of its test fluid.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..base import Array, to_text
from ..base.fields import (
    BLOCK,
    ERROR_SOURCE,
    LEAK_CLASS,
    PIECE,
    PIECE_STATE,
    PIXEL,
    PLACE_BLOCK,
    PLACE_FACE,
    REALISATION,
    STATE,
    STEP,
    Field,
    fields_of,
)
from ..base.leak_rates import LeakBasis, LeakClass, leak_classes, within
from ..base.leak_units import LEAK_UNITS
from ..base.machine import one_at_a_time
from ..base.quantities import with_its_unit
from ..budget import ErrorBudget, ErrorPart
from ..face.pieces import Cut
from ..fluids import FLUIDS, Fluid, leak_basis
from ..loads import LoadProgramme, LoadStep
from ..studies import FaceResult, Scene, StochasticResult
from ..studies.other_fluid import OtherLeakage, limit_factors
from ..studies.piece_states import FacePieces, PlaceLeakage
from ..studies.scene import FluidState
from ..topography import Patches, Surface

if TYPE_CHECKING:
    import xarray

#: Most blocks along a side of the maps, of the heights and of a field at every step.
HEIGHT_BLOCKS, FIELD_BLOCKS = 256, 128
#: Ratio of the length of a seal to the circumference of its nominal diameter beyond which a warning says so.
_ODD_LENGTH = 1.5
#: Attributes of a dataset by the part of the basis of its leakage that they hold.
_BASIS = {
    "density": "reference_density_kg_per_m3",
    "pressure": "reference_pressure_Pa",
    "temperature": "reference_temperature_K",
    "molar_mass": "molar_mass_kg_per_mol",
    "stated": "stated_temperature_K",
    "drop": "drop_volume_m3",
    "bubble": "bubble_volume_m3",
    "pressure_drop": "pressure_drop_Pa",
    "capacity": "rated_capacity_m3_per_s",
}


def add(data: xarray.Dataset, made: Field, values: Any, **attrs: Any) -> None:
    """Add a field; one of this name that is there stays."""
    if made.name not in data:
        data[made.name] = (made.place, values, made.attrs | attrs)


def add_new(
    data: xarray.Dataset,
    name: str,
    unit: str,
    long_name: str,
    values: Any,
    where: tuple[str, ...] = STEP,
    **attrs: Any,
) -> None:
    """Add a field that no result declares, over the load steps unless it has another place."""
    add(data, Field(name, unit, long_name, where), values, **attrs)


def add_coordinate(
    data: xarray.Dataset, name: str, unit: str, long_name: str, values: Any, dim: str = ""
) -> None:
    """Add a coordinate, that of its own dimension unless another one is named."""
    data.coords[name] = (dim or name, values, {"units": unit, "long_name": long_name})


def add_declared(data: xarray.Dataset, result: Any) -> None:
    """Add every declared field of a result, except the large ones over all pixels."""
    for made, values in fields_of(result):
        if made.place != PIXEL and np.size(values):
            add(data, made, values)


def pressures_and_peaks(steps: Sequence[Any]) -> tuple[Array, Array]:
    """Nominal pressures and peaks of load steps as `branches` takes them [Pa]."""
    peaks = [np.nan if s.unloaded_from is None else s.unloaded_from for s in steps]
    return np.array([s.pressure for s in steps], dtype=float), np.array(peaks, dtype=float)


def add_load_steps(data: xarray.Dataset, dim: str, prefix: str, steps: Sequence[LoadStep]) -> None:
    """Add the coordinates that describe load steps along a dimension; `prefix` is prepended to their names."""
    pressures, peaks = pressures_and_peaks(steps)
    load = "nominal pressure"
    add_coordinate(data, dim, "1", "index of the load step", np.arange(len(steps)))
    for name, unit, text, values in (
        ("branch", "1", "branch of the load cycle", [step.branch for step in steps]),
        ("nominal_pressure", "Pa", load, pressures),
        ("unloaded_from", "Pa", f"{load} from which the step is unloaded", peaks),
        ("name", "1", "name of the load step", [step.name for step in steps]),
    ):
        add_coordinate(data, f"{prefix}{name}", unit, text, values, dim)


def add_piece_centres(data: xarray.Dataset, prefix: str, cut: Cut) -> None:
    """Add the coordinates of pieces, of two scales or with a prefix of states."""
    x1, x2 = cut.centres
    add_coordinate(data, f"{prefix}piece1", "m", "x1 of the centres of pieces, from the inlet", x1)
    add_coordinate(data, f"{prefix}piece2", "m", "x2 of the centres of pieces, along the seal", x2)


def add_realisations(
    data: xarray.Dataset, result: StochasticResult, quantiles: tuple[float, float]
) -> None:
    """Add the leakage of every realisation, its median and mean, and the quantiles for which there are enough."""
    add_declared(data, result)
    add_coordinate(data, "realisation", "1", "realisation", np.arange(len(result.leakage)))
    ends = {"median": 0.5}
    if not result.too_few(*quantiles):
        ends |= dict(zip(("lower", "upper"), quantiles, strict=True))
    for name, q in ends.items():
        of = "median" if name == "median" else f"{name} quantile {q:g}"
        text = f"leakage per unit seal length, {of} of the realisations"
        add_new(data, f"leakage_{name}", "m^2/s", text, result.quantile(q), quantile=q)


def add_states(data: xarray.Dataset, pieces: FacePieces) -> None:
    """Add the states of the face and its pieces in each of them."""
    add_load_steps(data, "state", "state_", pieces.steps)
    add_piece_centres(data, "state_", pieces.cut)
    for made, values in fields_of(pieces):
        if made.place == PIECE:
            name = made.name.replace("piece_", "state_")
            text = f"{made.long_name}, by state"
            made = replace(made, name=name, long_name=text, place=PIECE_STATE)
        if not np.isnan(values).all() or made.place == STATE:
            add(data, made, values)


def add_places(
    data: xarray.Dataset, places: Patches, result: PlaceLeakage, gap: NDArray[Any] | None
) -> None:
    """Add the leakage of each measured place and its scatter; heights of the one that leaks most, and its gap if known.

    gap : of all places at every step (steps, n1, n2) [m].
    """
    numbers = np.arange(1, len(result.alone) + 1)
    add_coordinate(data, "place", "1", "number of the measured place", numbers)
    add_declared(data, result)
    relative = result.relative
    most = int(np.argmax(relative))
    add_blocks(data, ("place1", "place2"), places.patches[most], FIELD_BLOCKS)
    text = "{} of the place that leaks most, mean of each block"
    about = {"place": most + 1, "over_mean": float(relative[most])}
    heights = block_means(places.divided(places.heights)[most], FIELD_BLOCKS)
    add_new(data, "place_height", "m", text.format("height"), heights, PLACE_FACE, **about)
    if gap is not None:
        gaps = np.array([block_means(places.divided(of)[most], FIELD_BLOCKS) for of in gap])
        add_new(data, "place_gap", "m", text.format("gap"), gaps, PLACE_BLOCK)


def add_block_means(data: xarray.Dataset, scene: Scene, study: FaceResult) -> None:
    """Add the fields over all pixels of a study of the whole face, as means over blocks at every step.

    The fields themselves are too large for the dataset. Blocks without a number are NaN.
    """
    add_blocks(data, ("block1", "block2"), scene.surface, FIELD_BLOCKS)
    for made, at_pixels in fields_of(study):
        if made.place == PIXEL:
            means = [block_means(values, FIELD_BLOCKS) for values in one_at_a_time(at_pixels)]
            text = f"{made.long_name}, mean of each block"
            add_new(data, f"face_{made.name}", made.unit, text, np.array(means), BLOCK)


def add_blocks(data: xarray.Dataset, dims: tuple[str, str], face: Surface, most: int) -> None:
    """Add the coordinates of blocks of a face, at most so many along a side."""
    for n, dim, count, length in zip((1, 2), dims, face.shape, face.size, strict=True):
        blocks = min(count, most)
        centres = (np.arange(blocks) + 0.5) * length / blocks
        add_coordinate(data, dim, "m", f"x{n} of block centres", centres)


def block_means(values: NDArray[Any], most: int) -> NDArray[np.float32]:
    """Means of the values (n1, n2) over at most `most` blocks along each side, without NaN; NaN where all are.

    Where the sides are no multiples of the blocks, blocks differ by a pixel.
    """
    count: NDArray[Any] = ~np.isnan(values)
    total = np.where(count, values, 0.0)
    for axis, n in enumerate(values.shape):
        starts = np.arange(min(n, most)) * n // min(n, most)
        total, count = (np.add.reduceat(of, starts, axis, dtype=float) for of in (total, count))
    with np.errstate(invalid="ignore"):
        return (total / count).astype(np.float32)


def add_totals(data: xarray.Dataset, leakage: xarray.DataArray, basis: LeakBasis) -> None:
    """Add the best leakage of the whole seal by volume, mass and, for a gas, pressure × volume; and in more units."""
    whole = f"leakage of the whole seal, {leakage.attrs['long_name'].rpartition(', ')[2]}"
    at = "" if basis.temperature is None else f" at {basis.temperature:g} K"
    stated = "" if basis.stated_temperature is None else f" at {basis.stated_temperature:g} K"
    for name, unit, si, text in (
        ("", "m³/s", "m^3/s", f"by volume{at and f'{at} and {basis.pressure:g} Pa'}"),
        ("_mass", "kg/s", "kg/s", "by mass"),
        ("_throughput", "Pa·m³/s", "Pa*m^3/s", f"pressure × volume{stated}"),
    ):
        if basis.has(one := LEAK_UNITS[unit]):
            values = leakage.values / basis.factor(one)
            add_new(data, f"leakage_total{name}", si, f"{whole}, {text}", values)
    units = basis.units()
    add_coordinate(data, "leak_unit", "1", "unit of leakage", [unit.name for unit in units])
    values = np.array([leakage.values / basis.factor(unit) for unit in units])
    text = f"leakage in units of leak_unit{stated}"
    add_new(data, "leakage_in_units", "1", text, values, ("leak_unit", "step"))


def add_budgets(data: xarray.Dataset, budgets: Mapping[str, ErrorBudget]) -> None:
    """Add the band of error of every leakage, and that of each source, by the name of the method in variables."""
    if not budgets:
        return
    names = list(dict.fromkeys(part.name for budget in budgets.values() for part in budget.parts))
    add_coordinate(data, "budget_part", "1", "source of error of the leakage", names)
    notes = {}
    for method, budget in budgets.items():
        parts = {part.name: part for part in budget.parts}
        for end in ("lower", "upper"):
            text = f"{end} end of the band of error of the leakage, {method.replace('_', '-')}"
            name = f"leakage_{method}_budget"
            add_new(data, f"{name}_{end}", "m^2/s", text, getattr(budget, end))
            if len((alone := budget.numerical).parts) < len(budget.parts):
                of_it = f"{text}, of its solution alone"
                add_new(data, f"{name}_numerical_{end}", "m^2/s", of_it, getattr(alone, end))
            # a source that the method does not have moves nothing
            ends = [getattr(parts.get(name), end, budget.leakage) for name in names]
            text += ", of each source"
            add_new(data, f"{name}_part_{end}", "m^2/s", text, np.array(ends), ERROR_SOURCE)
        notes[method] = {name: parts[name].note for name in names if name in parts}
    data.attrs["error_budget"] = json.dumps(notes, ensure_ascii=False)


def budgets_in(data: xarray.Dataset, steps: LoadProgramme) -> dict[str, ErrorBudget]:
    """The budgets of a dataset by the name of their method in variables; empty if there are none."""
    notes: dict[str, dict[str, str]] = json.loads(data.attrs.get("error_budget", "{}"))
    found = {}
    for method, parts in notes.items():
        lower, upper = (data[f"leakage_{method}_budget_part_{end}"] for end in ("lower", "upper"))
        made = []
        for name, note in parts.items():
            low, high = (end.sel(budget_part=name).values for end in (lower, upper))
            made.append(ErrorPart(name, low, high, note))
        leakage = data["leakage_median" if method == "stochastic" else f"leakage_{method}"].values
        found[method] = ErrorBudget(method.replace("_", "-"), leakage, tuple(made), steps)
    return found


def add_test_fluid(
    data: xarray.Dataset,
    test: OtherLeakage,
    service: FluidState,
    stated: float | None,
    valve: Mapping[str, float],
) -> None:
    """Add the leakage of the test fluid, and attributes with its state and what both limits of flow would give."""
    text = "leakage per unit seal length, test fluid"
    add_new(data, "test_leakage", "m^2/s", text, test.leakage)
    if (several := test.realisations) is not None:
        add_new(data, "test_leakage_realisations", "m^2/s", text, several, REALISATION)
    state, factors = test.state, limit_factors(test.state, service)
    basis = leak_basis(state.fluid, 1.0, stated, pressure_drop=state.pressure_drop, **valve)
    data.attrs |= {
        "test_fluid": fluid_text(test.state.fluid),
        "test_inlet_pressure_Pa": float(test.state.inlet_pressure),
        "test_outlet_pressure_Pa": float(test.state.outlet_pressure),
        "test_viscous_factor": factors.viscous,
        "test_molecular_factor": factors.molecular,
        **basis_attributes(basis, "test_"),
    }


def fluid_text(fluid: Fluid) -> str:
    """Kind and parameters of a fluid; one that is made in Python is as Python shows it.

    >>> import femseal as fs
    >>> fluid_text(fs.IdealGas(1.8e-5, 0.029, 293.0))
    'ideal-gas, viscosity 18 µPa·s, molar mass 0.029 kg/mol, temperature 293 K, slip'
    """
    kind = next((kind for kind, known in FLUIDS.items() if type(fluid) is known), None)
    if kind is None:
        return repr(fluid)
    found = [kind]
    for one in fields(FLUIDS[kind]):
        name, value = one.name.replace("_", " "), getattr(fluid, one.name)
        if isinstance(value, bool):
            found.append(name if value else f"no {name}")
        elif isinstance(value, str):
            found.append(value)
        elif value:
            found.append(f"{name} {with_its_unit(value, one.metadata['unit'])}")
    return ", ".join(found)


def basis_attributes(basis: LeakBasis, prefix: str = "") -> dict[str, float]:
    """What `basis_of` reads back, without the length."""
    return {
        prefix + attribute: float(value)
        for name, attribute in _BASIS.items()
        if (value := getattr(basis, name)) is not None
    }


def basis_of(attrs: dict[str, Any], prefix: str = "") -> LeakBasis:
    """Length of the seal and reference state of a fluid, from the attributes of a dataset."""
    known = {
        name: float(attrs[prefix + attribute])
        for name, attribute in _BASIS.items()
        if prefix + attribute in attrs
    }
    return LeakBasis(**{"length": float(attrs["seal_size_m"][1]), "density": np.nan} | known)


def add_classes(
    data: xarray.Dataset,
    classes: Sequence[LeakClass],
    basis: LeakBasis,
    diameter: float | None,
    leakage: Array,
    realisations: Array,
    upper: Array | None = None,
) -> list[str]:
    """Add which classes are met at each step, and by which fraction of the realisations; returns warnings.

    basis, leakage, realisations : of the fluid that decides [m²/s]: (steps,) and (realisations, steps).
    diameter : nominal diameter [m], which some classes need. upper : upper end of the band of error (steps,) [m²/s]: a
    class of a sealed step without a known one is open, neither met nor not.

    Raises InputError: a class that needs a diameter without one, or one that is not for the fluid.
    """
    if diameter is not None:
        data.attrs["nominal_diameter_m"] = float(diameter)
    if not classes:
        return []
    limits = np.array([c.limit(basis, diameter) for c in classes])
    known = np.isfinite(realisations)
    count = np.maximum(known.sum(axis=0), 1)
    fraction = np.sum([within(realisations, limit) & known for limit in limits], axis=1) / count
    fraction[:, ~known.any(axis=0)] = np.nan
    add_coordinate(data, "leak_class", "1", "leakage class", [c.name for c in classes])
    text = "largest leakage per unit seal length in the class, of the fluid that decides on it"
    add_new(data, "class_limit", "m^2/s", text, limits, ("leak_class",))
    met = np.array([within(leakage, limit) for limit in limits]).astype(float)
    if upper is not None:
        met[:, (leakage == 0) & ~np.isfinite(upper)] = np.nan
        fraction[:, (realisations == 0).any(axis=0) & ~np.isfinite(upper)] = np.nan
    fraction[:, np.isnan(leakage)] = np.nan
    text = "1 where the leakage given meets the class, 0 where not or failed, NaN: open"
    add_new(data, "class_met", "1", text, met, LEAK_CLASS)
    text = "fraction of the realisations that meet the class, NaN: open or failed"
    add_new(data, "class_fraction", "1", text, fraction, LEAK_CLASS)
    return _doubts(classes, basis.length, diameter)


def _doubts(classes: Sequence[LeakClass], length: float, diameter: float | None) -> list[str]:
    """Warnings of limits at second hand, and of a nominal diameter that does not go with the length of the seal."""
    found, second = [], ", ".join(f"{c.name} ({c.edition})" for c in classes if c.second_hand)
    if second:
        found.append(f"limits of {second} are from tables of others, not the standard's own text")
    if diameter is None or not any(c.per_diameter for c in classes):
        return found
    round_ = np.pi * diameter
    if not 1 / _ODD_LENGTH <= length / round_ <= _ODD_LENGTH:
        sizes = to_text(length, "m", 3), to_text(diameter, "m", 3), to_text(round_, "m", 3)
        found.append(
            f"leakage classes by nominal diameter are of the whole seal: it is {sizes[0]} long, but a seat of "
            f"{sizes[1]} is about {sizes[2]} long"
        )
    return found


def tightest_classes(data: xarray.Dataset) -> list[str]:
    """The tightest class of each family that is met, at every step; "none", "open" or "failed"; [] without classes.

    Open is a step that is computed as sealed, and may leak any amount by its error budget.
    """
    if "leak_class" not in data.coords:
        return []
    classes = leak_classes(data["leak_class"].values.tolist())
    # the tightest of a family last
    order = np.argsort(data["class_limit"].values, kind="stable")[::-1]
    lines = []
    for met, fraction in zip(
        data["class_met"].values.T, data["class_fraction"].values.T, strict=True
    ):
        best = {classes[n].family or classes[n].name: classes[n].name for n in order if met[n]}
        if np.isnan(met).any():
            lines.append("open")
        elif np.isnan(fraction).all():
            lines.append("failed")
        else:
            lines.append(", ".join(best.values()) or "none")
    return lines
