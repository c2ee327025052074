"""What changes the leakage of a seal, and the pressure that it needs, most: logarithmic slopes at one load.

Two slopes cannot be had without another solution: that against the hardness, and that against the length of a flow law
that has one: the mean free path of a rarefied gas, which goes with its viscosity, or a slip length. The others follow
from them and from the slope against the load, because the problem has no scale of its own: heights, hardness and
pressure multiplied by one number multiply every gap by it, so that leakage L goes with

    L(αa, E, αH, αp, αη, αb) = α² L(a, E, H, p, η, b)     L(a, βE, βH, βp, η, b) = L(a, E, H, p, η, b)

with the amplitude a of the roughness, contact modulus E, hardness H, nominal pressure p, viscosity η (for a gas in its
law; as a continuum L goes with 1/η), slip length b. The slopes s of ln L then obey s_a + s_H + s_p + s_η + s_b = 2 and
s_E + s_H + s_p = 0. Leakage through a long seal goes with one over its breadth (Darcy's law). Where the leakage is to
stay the same, the pressure goes with −s/s_p.

For the two slopes the case is solved again with one thing changed.
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


@dataclass(frozen=True)
class Sensitivity:
    """Slopes d ln L/d ln x and d ln Qmin/d ln x of a quantity x, NaN where unknown, and how they were found."""

    quantity: str
    leakage: float
    pressure: float
    how: str


@dataclass(frozen=True)
class Variants:
    """The same seals solved again with one thing changed; None where that was not done.

    harder : with the hardness multiplied by `factor`. longer : with the length of the flow law multiplied by it.
    hardness_counts : whether the solids yield. hardens : whether they harden or soften as they do.
    law_length : parameter of the fluid with which that length goes, "" of a law without one.
    inlet_slope : d ln L/d ln p_in by the fluid's potential, NaN if unknown.
    """

    harder: Seals | None = None
    longer: Seals | None = None
    factor: float = 1.1
    hardness_counts: bool = True
    hardens: bool = False
    law_length: str = ""
    inlet_slope: float = np.nan


def sensitivities(
    seals: Seals, variants: Variants, pressure: float, fraction: float
) -> tuple[Sensitivity, ...]:
    """Slopes at a nominal pressure on loading, of the leakage that a fraction of the seals does not exceed."""
    load = slope_at(seals, pressure, fraction)

    def solved(variant: Seals | None, quantity: str) -> tuple[float, str]:
        if variant is None:
            return np.nan, "unknown: takes a solution, from a case"
        rise = level_at(variant, pressure, fraction) - level_at(seals, pressure, fraction)
        how = f"solved again with {variants.factor:g} times the {quantity}"
        return rise / np.log(variants.factor), how

    hard, how_hard = 0.0, "elastic: no hardness"
    if variants.hardness_counts:
        hard, how_hard = solved(variants.harder, "hardness")
    thick, how_thick = -1.0, "flow as a continuum"
    slip: list[tuple[str, float, str]] = []
    if variants.law_length == "viscosity":
        thick, how_thick = solved(variants.longer, "viscosity")
    elif variants.law_length:
        name = variants.law_length.replace("_", " ")
        slip = [(name, *solved(variants.longer, name))]
    at_wall = sum(slope for _, slope, _ in slip)
    how_force = "Darcy's law, with the pressure of the force; Qmin: the force"
    how_inlet = "potential of the fluid"
    if not np.isfinite(variants.inlet_slope):
        how_inlet = "unknown for a rarefied gas, and without a fluid"
    rough, how_rough = 2 - hard - load - thick - at_wall, "scaling law of contact and flow, exact"
    if variants.hardens:
        rough, how_rough = np.nan, "unknown: the metal hardens over a depth of its own"
    slopes = [
        ("nominal pressure", load, "the loading curve"),
        ("roughness amplitude", rough, how_rough),
        ("hardness", hard, how_hard),
        ("contact modulus", -hard - load, "scaling law of contact, exact"),
        ("breadth, same pressure", -1.0, "Darcy's law over many pieces"),
        ("breadth, same force", -1.0 - load, how_force),
        ("viscosity", thick, how_thick),
        *slip,
        ("inlet pressure", variants.inlet_slope, how_inlet),
    ]
    # of the load itself, there is nothing to be needed
    steep = load if np.isfinite(load) and load != 0 else np.nan
    return tuple(
        Sensitivity(name, slope, -slope / steep if n else np.nan, how)
        for n, (name, slope, how) in enumerate(slopes)
    )


def level_at(seals: Seals, pressure: float, fraction: float) -> float:
    """ln of the leakage that a fraction of the seals does not exceed, on loading; NaN where it is unknown or 0."""
    x, y = _open_loads(seals, fraction)
    return float(np.interp(np.log(pressure), x, y, left=np.nan, right=np.nan)) if x.size else np.nan


def slope_at(seals: Seals, pressure: float, fraction: float) -> float:
    """d ln L/d ln p on loading; NaN beyond the loads or without leakage.

    Of a monotone cubic through the load steps (PCHIP): chords between steps are off where the curve bends. Measured at
    579 MPa on the turned face of the examples: −2.73 of the chord, −3.00 so, −3.06 of two more solutions.
    """
    x, y = _open_loads(seals, fraction)
    at = np.log(pressure)
    if x.size < 2 or not x[0] <= at <= x[-1]:
        return np.nan
    return float(scipy.interpolate.PchipInterpolator(x, y)(at, 1))


def _open_loads(seals: Seals, fraction: float) -> tuple[Array, Array]:
    """ln of pressure and of leakage at the loads on loading at which the leakage is known and not 0."""
    steps = seals.falling()[::-1]
    pressure, leakage = seals.steps.pressures[steps], seals.curve_of(fraction)[steps]
    known = (pressure > 0) & (leakage > 0) & (leakage < np.inf)
    return np.log(pressure[known]), np.log(leakage[known])


#: Factor of hardness and of the length of a flow law: small enough for a slope, and above the residuals of contact.
_FACTOR = 1.03


def solved_variants(
    case: Case, results: Results, workers: int | None, progress: Progress
) -> Variants:
    """Solve the seals of a run again for the fluid that decides on classes, each time with one thing changed.

    With another hardness, if the solids yield, and another length of the flow law, if it has one.
    """
    prepared: Prepared = last_version(case, prepare(case), results.attempts)
    if "realisation" in results.dataset.sizes:
        prepared = prepared.with_realisations(results.dataset.sizes["realisation"])
    scene = (case.output.test_fluid or case.fluid).state.in_scene(prepared.scene)

    def seals(quantity: str, changed: Scene) -> Seals:
        version = replace(prepared, scene=changed)
        with (
            ordered_map(workers, before=compile_ahead) as mapper,
            Run(mapper, progress).timed(f"another {quantity}") as watched,
        ):
            return Seals.of(changed.steps, version.solve(version.answer, watched).leakage)

    harder = longer = None
    yields = not scene.law.is_elastic
    if yields:
        harder = seals("hardness", replace(scene, hardness=scene.law.times(_FACTOR)))
    name, fluid = law_of(scene.fluid).length, cast(Any, scene.fluid)
    if hasattr(fluid, name):
        other = replace(fluid, **{name: _FACTOR * getattr(fluid, name)})
        longer = seals(name.replace("_", " "), replace(scene, fluid=other))
    return Variants(
        harder, longer, _FACTOR, hardness_counts=yields, hardens=not scene.law.is_perfect
    )


def state_of_classes(results: Results) -> FluidState | None:
    """The fluid that decides on classes, from the case of the results; None if that does not say it."""
    try:
        table = results.case.get("output", {}).get("test_fluid") or results.case["fluid"]
        made = FLUIDS[table["kind"]]
        fluid = made(**{f.name: table[f.name] for f in fields(made) if f.name in table})
        return FluidState(fluid, float(table["inlet_pressure"]), float(table["outlet_pressure"]))
    except (KeyError, TypeError, ValueError, AttributeError):
        return None if results.scene is None else FluidState.of(results.scene)


def inlet_slope(state: FluidState) -> float:
    """d ln L/d ln p_in of a fluid whose law does not depend on the pressure; NaN for a rarefied gas."""
    if state.law.depends_on_pressure:
        return np.nan
    step = 1e-4
    up, down = (
        replace(state, inlet_pressure=state.inlet_pressure * (1 + sign * step)) for sign in (1, -1)
    )
    return float(np.log(up.drop / down.drop) / np.log((1 + step) / (1 - step)))
