"""Check the plausibility of coatings: their roughness, and the depth to which they yield."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

import numpy as np

from ..base import Array, to_text
from ..scene import Scene

#: Ratio of the rms height of a surface to the thickness of a coating above which a warning is given. At this ratio, the
#: heights, which range over about ±3 rms heights, extend over two thicknesses.
_LARGEST_ROUGHNESS = 1 / 3


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
        bound of the depth: all points above a certain height are flattened to this height, and carry the load at a
        pressure equal to the hardness.
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
