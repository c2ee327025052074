"""Check the plausibility of a scene and its solution: warn about values that are probably wrong or not modelled."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from ..base import Array, counted, to_text
from ..fluids import leak_basis
from ..materials import HARDNESS_FACTOR, LINE_CONTACT_YIELD, YOUNG_LIMITS
from ..scene import Scene
from .coatings import coating_depth_warnings, constraint_warnings, roughness_of_coating_warnings
from .flow_limits import flow_warnings
from .ideal_gas import gas_warnings
from .quick_estimate import QuickEstimate

#: Nominal pressures above this fraction of the hardness flatten most of the surface.
_FLATTENING_FRACTION = 0.5
#: Largest rms slope for which the half-space approximation is acceptable.
_STEEP = 1.0


def result_warnings(
    scene: Scene,
    leakage: Array,
    mean_gap: Array,
    estimate: QuickEstimate | None,
    plastic_depth: Array | None = None,
    edge_distance: Array | None = None,
) -> tuple[str, ...]:
    """Check a scene and its solution, and return a warning for each implausible value.

    Parameters
    ----------
    scene : Scene
        The scene that was solved.
    leakage : array, (steps,)
        Leakage per length of seal [m²/s], NaN where it is unknown.
    mean_gap : array, (steps,)
        Mean gap through which the fluid passes [m], NaN where it is unknown.
    estimate : QuickEstimate or None
        Quick estimate from the spectrum of the surface, see `estimate_scene`; None if no estimate is possible.
    plastic_depth : array, (steps,), or None
        Largest plastic deformation [m]; estimated from the heights if None.
    edge_distance : array, (steps,), or None
        Mean distance [m] between the yielding points and the edge of their contact patch, see
        `contact.mean_edge_distance`; None or NaN where it is unknown.
    """
    texts = [*scene_warnings(scene)]
    if estimate is not None:
        texts += estimate.leakage_warnings(leakage, [step.name for step in scene.steps])
    texts += flow_warnings(scene, leakage, mean_gap)
    texts += coating_depth_warnings(scene, plastic_depth)
    texts += constraint_warnings(scene, leakage, edge_distance)
    return tuple(texts)


def scene_warnings(scene: Scene) -> tuple[str, ...]:
    """Check a scene before it is solved, and return a warning for each implausible value."""
    outlet, fluid = scene.outlet_pressure, scene.fluid
    return (
        *_modulus_warnings(scene),
        *_separation_warnings(scene),
        *_vacuum_warnings(scene),
        *gas_warnings("fluid", fluid, scene.inlet_pressure, outlet),
        *_load_warnings(scene),
        *_slope_warnings(scene),
        *roughness_of_coating_warnings(scene),
    )


def line_contact_warnings(scene: Scene, row_pressure: Array) -> tuple[str, ...]:
    """Warn if the form of a seal causes a line contact with a pressure at which the bulk of the body yields.

    Parameters
    ----------
    scene : Scene
        The scene that was solved.
    row_pressure : array, (steps, rows)
        Mean contact pressure of each row of pixels [Pa].
    """
    highest = float(row_pressure.max())
    yield_stress = scene.body_yield_stress
    if yield_stress is None:
        yield_stress = scene.law.mean_hardness / HARDNESS_FACTOR
    limit = LINE_CONTACT_YIELD * yield_stress
    if highest <= limit:
        return ()
    return (
        "The band in contact is broader, and its pressure lower, than computed: the form presses with up to "
        f"{to_text(highest, 'Pa', 3)}, and the body below a line contact yields from {to_text(limit, 'Pa', 3)} on "
        f"({LINE_CONTACT_YIELD:g} times its yield stress), which the model does not follow",
    )


def _modulus_warnings(scene: Scene) -> Iterator[str]:
    """Warn if the contact modulus is outside the range of metals."""
    low, high = 0.5 * YOUNG_LIMITS[0], 1.2 * YOUNG_LIMITS[1]
    modulus = scene.surface_modulus
    if not low <= modulus <= high:
        usual = f"{to_text(low, 'Pa')} to {to_text(high, 'Pa')}"
        yield (
            f"The unit of the modulus may be wrong: the contact modulus {to_text(modulus, 'Pa')} is not that of "
            f"metals ({usual})"
        )


def _separation_warnings(scene: Scene) -> Iterator[str]:
    """Warn about load steps at which the fluid between separated surfaces carries the whole load."""
    steps, fluid = scene.steps, scene.acting_fluid
    separated = [steps[s] for s, _ in scene.separated_steps if steps[s].pressure > 0]
    if fluid is None or not separated:
        return
    first, others = separated[0], separated[1:]
    more = f" and {counted(len(others), 'more step')}" if others else ""
    limit = to_text(fluid.mean_if_separated, "Pa", 3)
    yield (
        f"The seal is open at {first.name}{more}, unless its contact holds the fluid back: the fluid carries all of "
        f"{to_text(first.pressure, 'Pa')}, and the surfaces separate below about {limit}. "
        "Raise the load or lower the fluid pressure"
    )


def _vacuum_warnings(scene: Scene) -> Iterator[str]:
    """Warn if a gas leaks into a vacuum, because air is more likely."""
    if leak_basis(scene.fluid, 1.0).is_gas and scene.outlet_pressure == 0:
        yield (
            "The outlet is a vacuum (0 Pa absolute). For leakage into air set fluid.outlet_pressure = '1 atm'; a case "
            "takes gauge pressures as '10 bar(g)'"
        )


def _load_warnings(scene: Scene) -> Iterator[str]:
    """Warn if the highest nominal pressure is so close to the hardness that most of the surface yields."""
    highest = max(step.pressure for step in scene.steps)
    hardness = scene.law.mean_hardness
    if isfinite(hardness) and highest > _FLATTENING_FRACTION * hardness:
        yield (
            "Most of the surface is plastic, for which the model is not made: the nominal pressure of "
            f"{to_text(highest, 'Pa')} is {highest / hardness:.0%} of the hardness {to_text(hardness, 'Pa')}. Judge "
            "these loads by the upper end of the interval, or check the units of loads and hardness"
        )


def _slope_warnings(scene: Scene) -> Iterator[str]:
    """Warn if the surface is too steep for the half-space approximation."""
    slope = scene.surface.rms_slope
    if slope > _STEEP:
        yield (
            f"The surface is too steep for the model: its rms slope is {slope:.2g}, and a half-space is for slopes "
            "well below 1. Check the units of heights and pixel, or set a longer surface.shortest_wave"
        )
