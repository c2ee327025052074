"""Compute how strongly each quantity changes the leakage of a seal and the pressure at which it meets a class.

A sensitivity is a logarithmic slope at one load, d ln L/d ln x. For two slopes, the seal has to be solved again: for
the hardness, and for the length in the flow law. For a rarefied gas, the length in the flow law is the mean free path,
which is proportional to the viscosity of the gas. For a fluid with slip, the length in the flow law is the slip length.
All other slopes follow from these two, the slope of the loading curve, and two scaling laws of the leakage L. First
law: multiplying heights, hardness and pressure by the same number α multiplies all gaps by α. Second law: multiplying
all stresses by the same number β leaves the gaps unchanged. The leakage L therefore obeys

    L(αa, E, αH, αp, αη, αb) = α² L(a, E, H, p, η, b)     L(a, βE, βH, βp, η, b) = L(a, E, H, p, η, b)

with the amplitude a of the roughness, the contact modulus E, the hardness H, the nominal pressure p, the viscosity η
(without slip and rarefaction, L is proportional to 1/η), and the slip length b. Taking logarithms and derivatives with
respect to α and β gives s_a + s_H + s_p + s_η + s_b = 2 and s_E + s_H + s_p = 0, where s_x is d ln L/d ln x. The
leakage of a long seal is inversely proportional to its width (Darcy's law). If a quantity x changes, the leakage
remains the same if the pressure p changes by d ln p/d ln x = −s_x/s_p.
"""

from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import scipy

from ..base import Array
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..execution.run import Progress, Run, ordered_map
from ..flow.law import law_of
from ..preparation.preparation import prepare
from ..refinement.settings import last_version
from ..results.results import Results
from ..studies import FluidState, Scene
from ..studies.compiling import compile_ahead
from .requirements import Seals

#: Factor by which the hardness and the length of a flow law are multiplied. The factor is close enough to 1 for a
#: slope, but large enough that the tolerance of the contact solution does not matter.
_FACTOR = 1.03
#: Relative change of the inlet pressure in the difference quotient for its slope.
_INLET_CHANGE = 1e-4


@dataclass(frozen=True)
class Sensitivity:
    """Logarithmic slopes of leakage L and pressure Qmin with respect to one quantity x.

    Parameters
    ----------
    quantity : str
        Name of the quantity x.
    leakage : float
        Slope d ln L/d ln x of the leakage L with respect to the quantity x; NaN if the slope is unknown.
    pressure : float
        Slope d ln Qmin/d ln x, where Qmin is the lowest pressure in assembly at which a leakage class is met; NaN if
        the slope is unknown.
    how : str
        How the slopes were computed, as a text for tables.
    """

    quantity: str
    leakage: float
    pressure: float
    how: str


@dataclass(frozen=True)
class Variants:
    """Input of the sensitivities: solutions with one quantity changed, and properties of solids and fluid.

    Parameters
    ----------
    harder : Seals, optional
        Solution with the hardness multiplied by `factor`; None if there is no such solution.
    longer_length : Seals, optional
        Solution in which the length in the flow law (mean free path or slip length) is multiplied by `factor`; None
        if there is no such solution.
    factor : float
        Factor by which the changed quantity is multiplied.
    can_yield : bool
        Whether the solids yield.
    hardens : bool
        Whether the hardness increases with plastic deformation.
    length_parameter : str
        Parameter of the fluid that is proportional to the length in its flow law: "viscosity" for a rarefied gas, or
        the slip length; "" if the flow law has no length.
    inlet_slope : float
        Slope d ln L/d ln p_in with respect to the inlet pressure p_in; NaN if the slope is unknown.
    """

    harder: Seals | None = None
    longer_length: Seals | None = None
    factor: float = 1.1
    can_yield: bool = True
    hardens: bool = False
    length_parameter: str = ""
    inlet_slope: float = np.nan


@dataclass(frozen=True)
class _Slope:
    """Slope d ln L/d ln x of the leakage (NaN if unknown) and a text that says how the slope was computed."""

    value: float
    how: str


def sensitivities(
    seals: Seals, variants: Variants, pressure: float, fraction: float
) -> tuple[Sensitivity, ...]:
    """Compute the logarithmic slopes of a leakage quantile with respect to every quantity.

    Parameters
    ----------
    seals : Seals
        Leakages of the realisations.
    variants : Variants
        Solutions of the same seals with one quantity changed.
    pressure : float
        Nominal pressure [Pa] during loading at which the slopes are computed.
    fraction : float
        Fraction of the realisations that do not exceed the quantile of the leakage.

    Returns
    -------
    tuple of Sensitivity
    """

    def solved_slope(variant: Seals | None, quantity: str) -> _Slope:
        """Return the difference quotient (ln L(f x) − ln L(x))/ln f of a variant, with the factor f and the quantity x.

        quantity : name of the quantity x, for the text that explains the slope.
        """
        if variant is None:
            return _Slope(np.nan, "unknown: takes a solution of the case")
        changed = log_leakage_at(variant, pressure, fraction)
        original = log_leakage_at(seals, pressure, fraction)
        change = changed - original
        how = f"solved again with {variants.factor:g} times the {quantity}"
        return _Slope(change / np.log(variants.factor), how)

    load = slope_at(seals, pressure, fraction)  # d ln L/d ln p
    hardness = _Slope(0.0, "elastic: no hardness")
    if variants.can_yield:
        hardness = solved_slope(variants.harder, "hardness")
    viscosity = _Slope(-1.0, "flow as a continuum")
    slip_length: dict[str, _Slope] = {}
    if variants.length_parameter == "viscosity":
        viscosity = solved_slope(variants.longer_length, "viscosity")
    elif variants.length_parameter:
        name = variants.length_parameter.replace("_", " ")
        slip_length[name] = solved_slope(variants.longer_length, name)
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
    rows = [Sensitivity("nominal pressure", load, np.nan, "the loading curve")]
    for quantity, slope in slopes.items():
        slope_of_qmin = -slope.value / slope_of_load
        rows.append(Sensitivity(quantity, slope.value, slope_of_qmin, slope.how))
    return tuple(rows)


def log_leakage_at(seals: Seals, pressure: float, fraction: float) -> float:
    """Interpolate ln L on the loading curve at a nominal pressure [Pa]; L is the leakage per length of seal [m²/s].

    The result is NaN if the leakage at this pressure is unknown or 0.

    fraction : fraction of the realisations whose leakage is at most L.
    """
    log_pressure, log_leakage = _leaking_loads(seals, fraction)
    if not log_pressure.size:
        return np.nan
    return float(np.interp(np.log(pressure), log_pressure, log_leakage, left=np.nan, right=np.nan))


def slope_at(seals: Seals, pressure: float, fraction: float) -> float:
    """Compute the slope d ln L/d ln p of the loading curve at a nominal pressure p [Pa]; L is the leakage.

    The slope is the derivative of a monotone cubic spline (PCHIP) of ln L over ln p through the load steps. Where this
    curve bends, a straight line between two load steps would give a poor slope. For the turned face in the examples,
    solving two loads close to 579 MPa gives a slope of −3.06; the spline gives −3.00, and a straight line only −2.73.
    The slope is NaN if the pressure is outside the range of loads at which the seal leaks.
    """
    log_pressure, log_leakage = _leaking_loads(seals, fraction)
    at = np.log(pressure)
    if log_pressure.size < 2 or not log_pressure[0] <= at <= log_pressure[-1]:
        return np.nan
    curve = scipy.interpolate.PchipInterpolator(log_pressure, log_leakage)
    return float(curve(at, 1))


def _leaking_loads(seals: Seals, fraction: float) -> tuple[Array, Array]:
    """Return ln(pressure) and ln(leakage) of the loading steps at which the seal leaks, by increasing pressure."""
    steps = seals.steps_from_highest()[::-1]
    pressure = seals.steps.pressures[steps]
    leakage = seals.quantile_curve(fraction)[steps]
    is_leaking = (pressure > 0) & (leakage > 0) & (leakage < np.inf)
    return np.log(pressure[is_leaking]), np.log(leakage[is_leaking])


def solved_variants(
    case: Case, results: Results, workers: int | None, progress: Progress
) -> Variants:
    """Solve the seals of a run twice more: first with a higher hardness, then with a larger length in the flow law.

    If the case has a test fluid, the seals are solved with the test fluid. For elastic solids, which have no hardness,
    `harder` is None. If the flow law contains no length, `longer_length` is None.

    Parameters
    ----------
    case : Case
        The case.
    results : Results
        Results of the case. The number of realisations is the same as in these results. If the case requires an
        accuracy, the numerical settings of the last attempt to reach it are used.
    workers : int or None
        Number of processes. None: one for each core.
    progress : callable
        See `run`.

    Returns
    -------
    Variants
    """
    study_input: StudyInput = last_version(case, prepare(case), results.attempts)
    if "realisation" in results.dataset.sizes:
        study_input = study_input.with_realisations(results.dataset.sizes["realisation"])
    fluid_table = case.output.test_fluid or case.fluid
    scene = fluid_table.state.in_scene(study_input.scene)

    def solve(changed: Scene, quantity: str) -> Seals:
        """Solve the seals for a modified scene; `quantity` names the modified quantity in the progress display."""
        version = replace(study_input, scene=changed)
        with (
            ordered_map(workers, before=compile_ahead) as mapper,
            Run(mapper, progress).timed(f"another {quantity}") as timed_mapper,
        ):
            answer = version.solve(version.answer, timed_mapper)
        return Seals.from_leakage(changed.steps, answer.leakage)

    harder = None
    can_yield = not scene.law.is_elastic
    if can_yield:
        harder = solve(replace(scene, hardness=scene.law.times(_FACTOR)), "hardness")
    longer_length = None
    fluid = cast(Any, scene.fluid)
    length_parameter = law_of(scene.fluid).scale_parameter  # "viscosity", "slip_length" or ""
    if length_parameter and hasattr(fluid, length_parameter):
        larger_value = _FACTOR * getattr(fluid, length_parameter)
        changed_fluid = replace(fluid, **{length_parameter: larger_value})
        changed_scene = replace(scene, fluid=changed_fluid)
        longer_length = solve(changed_scene, length_parameter.replace("_", " "))
    return Variants(
        harder=harder,
        longer_length=longer_length,
        factor=_FACTOR,
        can_yield=can_yield,
        hardens=not scene.law.is_perfect,
    )


def inlet_slope(state: FluidState) -> float:
    """Compute the slope d ln L/d ln p_in with respect to the inlet pressure p_in.

    The slope is NaN if the flow law depends on the pressure.
    """
    if state.law.depends_on_pressure:
        return np.nan
    higher = replace(state, inlet_pressure=state.inlet_pressure * (1 + _INLET_CHANGE))
    lower = replace(state, inlet_pressure=state.inlet_pressure * (1 - _INLET_CHANGE))
    change_of_pressure = np.log((1 + _INLET_CHANGE) / (1 - _INLET_CHANGE))
    return float(np.log(higher.drop / lower.drop) / change_of_pressure)
