"""Check the plausibility of coatings: their roughness, the depth to which they yield, and their constraint."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite

import numpy as np
from scipy.interpolate import make_interp_spline

from ..base import Array, to_text
from ..materials import HARDNESS_FACTOR, RING_YIELD, Coated, Solid
from ..scene import Scene

#: Ratio of the rms height of a surface to the thickness of a coating above which a warning is given. At this ratio, the
#: heights, which range over about ±3 rms heights, extend over two thicknesses.
_LARGEST_ROUGHNESS = 1 / 3
#: A warning is given if constraint raises the hardness of a coating by at least this factor. At this factor, the
#: leakage in `docs/evidence/coatings.md` is 1.5 to 3.4 times as large.
_LEAST_RISE = 1.2
#: Relative difference up to which two values of the hardness count as equal, because of rounding errors.
_ROUNDING = 1e-9


def roughness_of_coating_warnings(scene: Scene) -> Iterator[str]:
    """Warn if the roughness is not small compared with the thickness of a coating."""
    height = scene.surface.rms_height
    for body in scene.coatings:
        if height > _LARGEST_ROUGHNESS * body.thickness:
            yield (
                "The coating is not the even layer that the model takes it for: the rms height of the surface is "
                f"{to_text(height, 'm', 3)}, and the coating is {to_text(body.thickness, 'm', 3)} thick. Where the "
                "coating follows the roughness of its substrate, the leakage lies between that with the coating and "
                "that of the bare substrate: solve both, or set a thicker coating"
            )


def coating_depth_warnings(scene: Scene, plastic_depth: Array | None) -> Iterator[str]:
    """Warn if the plastic deformation is larger than the thickness of a coating.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its coatings.
    plastic_depth : array (steps,) or None
        Largest plastic deformation [m]. None if the scene has not been solved yet. The function then uses an upper
        bound: all points above a certain height are flattened to that height and carry the load at a pressure equal to
        the hardness.
    """
    if not scene.coatings or not isfinite(scene.law.mean_hardness):
        return
    thickness = min(body.thickness for body in scene.coatings)
    pressures = scene.steps.pressures
    if plastic_depth is None:
        verb = "may yield"
        heights = scene.surface.heights
        # the flattened fraction A of the points carries the load at the hardness: nominal pressure = A · hardness
        flattened_fraction = np.clip(pressures / scene.law.mean_hardness, 0.0, 1.0)
        depths = heights.max() - np.quantile(heights, 1 - flattened_fraction)
    else:
        verb = "yields"
        depths = np.asarray(plastic_depth)
    deepest = int(np.argmax(depths))
    if depths[deepest] <= thickness:
        return
    yield (
        f"The coating {verb} through: at {scene.steps[deepest].name} the surface {verb} to a depth of "
        f"{to_text(float(depths[deepest]), 'm', 3)}; the thinnest coating is {to_text(thickness, 'm', 3)} thick. "
        "Below the coating the hardness is that of the substrate, and the material that is squeezed aside is left out. "
        "Use a thicker coating, a smoother surface or a lower load"
    )


def constrained_hardness_ratio(edge_distance: float, thickness: float) -> float:
    """Estimate an upper bound of the factor by which hard bodies on both sides raise the hardness of a soft coating.

    The coating sticks to both bodies. As the material is squeezed towards the edge of a contact patch, it must overcome
    the shear stress k on both faces, so that the pressure rises by 2k/d per unit length. For a patch of any shape, the
    mean pressure is therefore 2k (1 + δ/d), where δ is the mean distance of the points from the edge, d the thickness
    and 2k = (2/√3) σ_y. For strips of width w, δ = w/4 (slab method; Hosford & Caddell, Metal Forming, section 9.11).
    The ratio is taken relative to the unconstrained hardness 2.8 σ_y, and is at least 1.

    Parameters
    ----------
    edge_distance : float, m
        Mean distance δ of the points that yield from the edge of their contact patch.
    thickness : float, m
        Thickness d of the coating.

    Examples
    --------
    >>> strip_width, thickness = 10.0, 1.0
    >>> round(constrained_hardness_ratio(strip_width / 4, thickness), 2)
    1.44
    """
    mean_pressure = RING_YIELD * (1 + edge_distance / thickness)  # over the yield stress
    return max(1.0, mean_pressure / HARDNESS_FACTOR)


def constraint_warnings(scene: Scene, leakage: Array, edge_distance: Array | None) -> Iterator[str]:
    """Warn if the contact patches are so wide that the bodies on both sides constrain a soft coating.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its coatings.
    leakage : array (steps,)
        Leakage in any unit, NaN where it is unknown.
    edge_distance : array (steps,) or None
        Mean distance [m] between the yielding points and the edge of their contact patch; NaN where it is unknown, and
        inf where the whole surface is in contact. Only load steps on loading are checked.
    """
    thickness, hardness_of_neighbour = _soft_layer(scene)
    if thickness == 0 or edge_distance is None:
        return
    # The equivalent load is only valid on loading. If a surface is closed everywhere, it has no edge, and the distance
    # to the edge is inf.
    is_judged = scene.steps.on_loading & np.isfinite(edge_distance)
    if not is_judged.any():
        return
    step = int(np.argmax(np.where(is_judged, edge_distance, -inf)))
    distance = float(edge_distance[step])
    hardness = float(np.min(scene.law.yield_pressure()))
    # a pressure above the hardness of a neighbouring body would squeeze this body instead of the coating
    rise = min(constrained_hardness_ratio(distance, thickness), hardness_of_neighbour / hardness)
    if rise < _LEAST_RISE:
        return
    load = scene.steps[step]
    yield (
        f"The seal may leak more than computed: at {load.name} it may leak as much as is computed for "
        f"{to_text(load.pressure / rise, 'Pa', 3)}{_leakage_text(scene, leakage, step, rise)}. The coating is thin "
        "compared with the contact patches, and the bodies on both sides hinder its flow to the edges. This raises its "
        f"hardness by a factor of up to {rise:.2g}: the points that yield are {to_text(distance, 'm', 3)} from the "
        f"edge of their patch on average, and the coating is {to_text(thickness, 'm', 3)} thick. To see the effect, "
        f"set its hardness to {to_text(rise * hardness, 'Pa', 3)}; a thicker coating is less constrained"
    )


def _soft_layer(scene: Scene) -> tuple[float, float]:
    """Return the total thickness [m] of the coatings that yield, and the hardness [Pa] of the softer adjacent body.

    A coating yields if its hardness does not exceed the yield pressure of the contact law. The thickness is 0 if no
    coating yields.
    """
    hardness = float(np.min(scene.law.yield_pressure()))
    thickness, hardness_of_neighbour = 0.0, inf
    if isinstance(scene.modulus, float) or not isfinite(hardness):
        return thickness, hardness_of_neighbour
    for body in scene.modulus:
        if not isinstance(body, Coated):
            neighbour = body
        elif _hardness(body.layer) <= hardness * (1 + _ROUNDING):
            thickness += body.thickness
            neighbour = body.substrate
        else:
            neighbour = body.layer
        hardness_of_neighbour = min(hardness_of_neighbour, _hardness(neighbour))
    return thickness, hardness_of_neighbour


def _hardness(solid: Solid | None) -> float:
    """Return the hardness of a solid [Pa]; it is infinite for a rigid body, and for a solid that does not yield."""
    if solid is None or solid.hardness is None:
        return inf
    return solid.hardness


def _leakage_text(scene: Scene, leakage: Array, step: int, rise: float) -> str:
    """Describe how the leakage grows when the load is divided by `rise`, interpolated between loading steps."""
    is_loaded = scene.steps.on_loading & (scene.steps.pressures > 0)
    leaks = is_loaded & (np.abs(leakage) > 0) & np.isfinite(leakage)
    if not leaks[step] or leaks.sum() < 2:
        return ""
    log_loads = np.log(scene.steps.pressures[leaks])
    log_leakage = np.log(np.abs(leakage[leaks]))
    log_load = np.log(scene.steps[step].pressure)
    # below the lowest load, the line through the lowest two loads is extended
    curve = make_interp_spline(log_loads, log_leakage, k=1)
    ratio = float(np.exp(curve(log_load - np.log(rise)) - curve(log_load)))
    return f", {ratio:.2g} times as much" if ratio > 1 else ""
