"""Find what changes the leakage of a seal, and the pressure that it needs, most: logarithmic slopes at one load.

Two slopes need a further solution: that with respect to hardness, and that with respect to the length of a flow law.
A rarefied gas has such a length, its mean free path, which is proportional to its viscosity, and so has a fluid with
slip, its slip length. All other slopes follow from these two and from the slope of the loading curve, because the
problem has no length and no stress of its own. If heights, hardness and pressure are multiplied by one number, then
every gap is multiplied by it; and contact is unchanged if all stresses are multiplied by one number. The leakage L
therefore obeys

    L(αa, E, αH, αp, αη, αb) = α² L(a, E, H, p, η, b)     L(a, βE, βH, βp, η, b) = L(a, E, H, p, η, b)

with the amplitude a of the roughness, the contact modulus E, the hardness H, the nominal pressure p, the viscosity η of
the flow law (for a continuum, L is proportional to 1/η), and the slip length b. It follows that the slopes s of ln L
obey s_a + s_H + s_p + s_η + s_b = 2 and s_E + s_H + s_p = 0. The leakage of a long seal is inversely proportional to
its breadth (Darcy's law). If another quantity changes, the pressure that keeps the leakage constant changes with the
slope −s/s_p.
"""

from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
import scipy

from ..base import Array
from ..case.case import Case
from ..execution.run import Progress, Run, ordered_map
from ..flow.law import law_of
from ..fluids import FLUIDS
from ..preparation.preparation import Prepared, prepare
from ..refinement.refine_to_accuracy import last_version
from ..results.results import Results
from ..studies import FluidState, Scene
from ..studies.compiling import compile_ahead
from .requirements import Seals

#: Factor by which hardness and the length of a flow law are changed: small enough for a slope, and large enough that
#: the residual of contact does not matter.
_FACTOR = 1.03
#: Relative change of the inlet pressure for its slope.
_INLET_CHANGE = 1e-4


@dataclass(frozen=True)
class Sensitivity:
    """Logarithmic slopes with respect to one quantity x.

    Parameters
    ----------
    quantity : str
        Name of the quantity.
    leakage : float
        d ln L/d ln x of the leakage; NaN if unknown.
    pressure : float
        d ln Qmin/d ln x of the pressure that a leakage class needs; NaN if unknown.
    how : str
        How the slopes were found.
    """

    quantity: str
    leakage: float
    pressure: float
    how: str


@dataclass(frozen=True)
class Variants:
    """The same seals, solved again with one quantity changed.

    Parameters
    ----------
    harder : Seals, optional
        Seals whose hardness is multiplied by `factor`.
    longer : Seals, optional
        Seals whose flow law has a length multiplied by `factor`.
    factor : float
        Factor by which the quantity was changed.
    hardness_counts : bool
        Whether the solids yield.
    hardens : bool
        Whether the hardness changes with plastic deformation.
    law_length : str
        Name of the parameter of the fluid to which the length of the flow law is proportional; "" without a length.
    inlet_slope : float
        d ln L/d ln p_in by the potential of the fluid; NaN if unknown.
    """

    harder: Seals | None = None
    longer: Seals | None = None
    factor: float = 1.1
    hardness_counts: bool = True
    hardens: bool = False
    law_length: str = ""
    inlet_slope: float = np.nan


@dataclass(frozen=True)
class _Slope:
    """d ln L/d ln x of the leakage with respect to one quantity, NaN if unknown, and how it was found."""

    value: float
    how: str


def sensitivities(
    seals: Seals, variants: Variants, pressure: float, fraction: float
) -> tuple[Sensitivity, ...]:
    """Find the slopes of the leakage that a fraction of the realisations does not exceed.

    Parameters
    ----------
    seals : Seals
        Leakages of the realisations.
    variants : Variants
        The same seals with one quantity changed.
    pressure : float
        Nominal pressure on loading at which the slopes are taken [Pa].
    fraction : float
        Fraction of the realisations.

    Returns
    -------
    tuple of Sensitivity
    """

    def solved_slope(variant: Seals | None, quantity: str) -> _Slope:
        if variant is None:
            return _Slope(np.nan, "unknown: takes a solution of the case")
        change = level_at(variant, pressure, fraction) - level_at(seals, pressure, fraction)
        how = f"solved again with {variants.factor:g} times the {quantity}"
        return _Slope(change / np.log(variants.factor), how)

    load = slope_at(seals, pressure, fraction)
    hardness = _Slope(0.0, "elastic: no hardness")
    if variants.hardness_counts:
        hardness = solved_slope(variants.harder, "hardness")
    viscosity = _Slope(-1.0, "flow as a continuum")
    slip_length: dict[str, _Slope] = {}
    if variants.law_length == "viscosity":
        viscosity = solved_slope(variants.longer, "viscosity")
    elif variants.law_length:
        name = variants.law_length.replace("_", " ")
        slip_length[name] = solved_slope(variants.longer, name)
    slope_of_slip = sum(slope.value for slope in slip_length.values())
    amplitude = _Slope(
        2 - hardness.value - load - viscosity.value - slope_of_slip,
        "scaling law of contact and flow, exact",
    )
    if variants.hardens:
        amplitude = _Slope(np.nan, "unknown: hardening depends on the depth of the deformation")
    inlet_how = "potential of the fluid"
    if not np.isfinite(variants.inlet_slope):
        inlet_how = "unknown for a rarefied gas, and without a fluid"
    slopes = {
        "roughness amplitude": amplitude,
        "hardness": hardness,
        "contact modulus": _Slope(-hardness.value - load, "scaling law of contact, exact"),
        "breadth, same pressure": _Slope(-1.0, "Darcy's law over many cells"),
        "breadth, same force": _Slope(
            -1.0 - load,
            "Darcy's law; the pressure follows from the force, and Qmin is meant as a force",
        ),
        "viscosity": viscosity,
        **slip_length,
        "inlet pressure": _Slope(variants.inlet_slope, inlet_how),
    }
    slope_of_load = load if load != 0 else np.nan
    found = [Sensitivity("nominal pressure", load, np.nan, "the loading curve")]
    for quantity, slope in slopes.items():
        found.append(Sensitivity(quantity, slope.value, -slope.value / slope_of_load, slope.how))
    return tuple(found)


def level_at(seals: Seals, pressure: float, fraction: float) -> float:
    """Interpolate ln(leakage) on loading at a nominal pressure [Pa]; NaN if the leakage is unknown or 0 there.

    The leakage is what a fraction of the realisations does not exceed [m²/s].
    """
    log_pressure, log_leakage = _leaking_loads(seals, fraction)
    if not log_pressure.size:
        return np.nan
    return float(np.interp(np.log(pressure), log_pressure, log_leakage, left=np.nan, right=np.nan))


def slope_at(seals: Seals, pressure: float, fraction: float) -> float:
    """Find d ln L/d ln p on loading at a nominal pressure [Pa]; NaN beyond the loads or if there is no leakage.

    The slope is that of a monotone cubic (PCHIP) through the load steps. The slope of the chord between two steps has
    a large error where the curve bends: on the turned face of the examples at 579 MPa it is −2.73, while PCHIP gives
    −3.00 and two solutions near this load give −3.06.
    """
    log_pressure, log_leakage = _leaking_loads(seals, fraction)
    at = np.log(pressure)
    if log_pressure.size < 2 or not log_pressure[0] <= at <= log_pressure[-1]:
        return np.nan
    curve = scipy.interpolate.PchipInterpolator(log_pressure, log_leakage)
    return float(curve(at, 1))


def _leaking_loads(seals: Seals, fraction: float) -> tuple[Array, Array]:
    """Collect ln(pressure) and ln(leakage) of the loads on loading whose leakage is known and not 0, rising."""
    steps = seals.falling()[::-1]
    pressure = seals.steps.pressures[steps]
    leakage = seals.curve_of(fraction)[steps]
    is_leaking = (pressure > 0) & (leakage > 0) & (leakage < np.inf)
    return np.log(pressure[is_leaking]), np.log(leakage[is_leaking])


def solved_variants(
    case: Case, results: Results, workers: int | None, progress: Progress
) -> Variants:
    """Solve the seals of a run again with another hardness, and with another length of the flow law.

    The fluid is the one that decides on leakage classes. Nothing is solved for solids that do not yield or for a flow
    law without a length.

    Parameters
    ----------
    case : Case
        The case.
    results : Results
        Its results, which have the number of realisations and the last version on the way to an accuracy.
    workers : int or None
        Number of processes; one for each core if None.
    progress : callable
        See `run`.

    Returns
    -------
    Variants
    """
    prepared: Prepared = last_version(case, prepare(case), results.attempts)
    if "realisation" in results.dataset.sizes:
        prepared = prepared.with_realisations(results.dataset.sizes["realisation"])
    deciding_fluid = case.output.test_fluid or case.fluid
    scene = deciding_fluid.state.in_scene(prepared.scene)

    def solve(changed: Scene, quantity: str) -> Seals:
        version = replace(prepared, scene=changed)
        with (
            ordered_map(workers, before=compile_ahead) as mapper,
            Run(mapper, progress).timed(f"another {quantity}") as timed_mapper,
        ):
            answer = version.solve(version.answer, timed_mapper)
        return Seals.of(changed.steps, answer.leakage)

    harder = None
    can_yield = not scene.law.is_elastic
    if can_yield:
        harder = solve(replace(scene, hardness=scene.law.times(_FACTOR)), "hardness")
    longer = None
    fluid = cast(Any, scene.fluid)
    law_length = law_of(scene.fluid).length
    if hasattr(fluid, law_length):
        changed_fluid = replace(fluid, **{law_length: _FACTOR * getattr(fluid, law_length)})
        longer = solve(replace(scene, fluid=changed_fluid), law_length.replace("_", " "))
    return Variants(
        harder=harder,
        longer=longer,
        factor=_FACTOR,
        hardness_counts=can_yield,
        hardens=not scene.law.is_perfect,
    )


def state_of_classes(results: Results) -> FluidState | None:
    """Read the fluid that decides on leakage classes from the case of the results.

    Returns
    -------
    FluidState or None
        If the case does not name the fluid, that of the scene of the results, or None if they have no scene.
    """
    try:
        table = results.case.get("output", {}).get("test_fluid") or results.case["fluid"]
        fluid_class = FLUIDS[table["kind"]]
        parameters = {f.name: table[f.name] for f in fields(fluid_class) if f.name in table}
        inlet_pressure = float(table["inlet_pressure"])
        outlet_pressure = float(table["outlet_pressure"])
        return FluidState(fluid_class(**parameters), inlet_pressure, outlet_pressure)
    except (KeyError, TypeError, ValueError, AttributeError):
        return None if results.scene is None else FluidState.of(results.scene)


def inlet_slope(state: FluidState) -> float:
    """Find d ln L/d ln p_in of a fluid whose flow law does not depend on pressure; NaN for a rarefied gas."""
    if state.law.depends_on_pressure:
        return np.nan
    higher = replace(state, inlet_pressure=state.inlet_pressure * (1 + _INLET_CHANGE))
    lower = replace(state, inlet_pressure=state.inlet_pressure * (1 - _INLET_CHANGE))
    change_of_pressure = np.log((1 + _INLET_CHANGE) / (1 - _INLET_CHANGE))
    return float(np.log(higher.drop / lower.drop) / change_of_pressure)
