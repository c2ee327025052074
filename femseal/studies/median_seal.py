"""Links and windows of one drawn seal, and the seal whose leakage is nearest to the median, with its fields."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..base.text import Shown
from ..scales import Failed, attempt, draw_links
from ..scales.sampling import Draw
from ..seal.layouts import SealWindows
from .sampling_options import Sampling
from .scene import Array, Scene, labels
from .sources import Tables

#: Values of one field, parts times load steps, above which no fields are kept.
MOST_VALUES = 4_000_000
#: Leakages below this share of the first one do not choose the median.
_FLOOR = 1e-3


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Fields of the realisation whose leakage is nearest to the median, over the parts of the seal.

    realisation : its number.
    outlines : corners of the parts (parts, corners, 2) [m]. permeability, fluid_pressure : (steps, parts), NaN at steps
        that failed, and the fluid pressure also in pockets.
    """

    realisation: int
    outlines: Array = field(repr=False, metadata=labels("m", "corners of the parts of the seal"))
    permeability: Array = field(metadata=labels("m^3", "permeability, median realisation", "step", "part"))
    fluid_pressure: Array = field(metadata=labels("Pa", "fluid pressure, median realisation", "step", "part"))


def drawn_windows(laid: SealWindows, tables: Tables, sampling: Sampling, realisation: int) -> tuple[Draw, Draw]:
    """Permeabilities that a realisation draws along both axes, as functions of the step."""
    sampler, seed = sampling.chosen_sampler, sampling.seed
    along, across = (
        # windows whose two values belong together are drawn with the same random numbers
        draw_links(t, sampler=sampler, seed=seed, realisation=realisation, axis=0 if laid.together else axis)
        for axis, t in enumerate(tables)
    )
    return along, across


def nearest_to_median(leakage: Array) -> int | None:
    """Realisation whose ln(leakage) (realisations, steps) is nearest to the median of all; None where none leaks."""
    size = np.abs(leakage)
    whole = np.isfinite(size).all(axis=1)
    if not whole.any():
        return None
    median = np.median(size[whole], axis=0)
    chosen = np.asarray(median > _FLOOR * median.max())
    if not chosen.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(size[:, chosen] / median[chosen])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


def median_seal(realisation: int, *, scene: Scene, laid: SealWindows, tables: Tables, sampling: Sampling) -> MedianSeal:
    """Draw a realisation again and solve its flow at every step."""
    along, across = drawn_windows(laid, tables, sampling, realisation)
    outlines = laid.outlines
    k, p = np.full((2, len(scene.steps), len(outlines)), np.nan)
    for s in range(len(scene.steps)):
        permeability = laid.permeability(along(s), across(s))
        found = attempt(scene.leakage, laid.seal, permeability)
        if not isinstance(found, Failed):
            k[s], p[s] = laid.shown(permeability, found.fluid_pressure)
    return MedianSeal(realisation, outlines, k, p)
