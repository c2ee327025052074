"""Error of a leakage by the waves that a low-pass removed from the face.

The effect of an octave of waves has either sign at single loads, and is small where it changes it: what it does to the
load at the other steps of the cycle counts as well.
"""

from __future__ import annotations

import numpy as np

from ..studies import Scene
from ..studies.scene import Array
from .coarse import CoarserSolution, on_all_steps
from .error_parts import ErrorPart
from .pixels import load_sensitivity

#: Effect of an octave of waves on ln(leakage) over that of the next longer one.
DECAY = 0.7
#: Error over the effect of the shortest octave, carried on. Measured on 26 faces that had lost two octaves, at loads
#: that leak more than 1e-3 of the first: 0.78 holds 95 of 100 errors, 0.95 98.
SAFETY = 0.95


def filter_part(scene: Scene, leakage: Array, filtered: CoarserSolution, octaves: float) -> ErrorPart:
    """Part of the removed waves: the effect of the shortest octave that is kept, carried on to those removed.

    Parameters
    ----------
    filtered : without the shortest octave of waves. octaves : of waves that were removed from the face.
    """
    change = on_all_steps(scene.steps, filtered, leakage)
    # as many terms of a geometric series as there are octaves
    terms = DECAY * (1 - DECAY**octaves) / (1 - DECAY)
    slope = np.maximum(load_sensitivity(scene.steps, leakage), 1.0)
    known = [scene.steps.index(step) for step in filtered.steps]
    shifts = np.abs(change / slope)[known]
    typical = float(np.mean(shifts[np.isfinite(shifts)])) if np.isfinite(shifts).any() else 0.0
    distance = SAFETY * terms * np.hypot(change, typical * slope)
    note = (
        "change of ln(leakage) without the shortest octave of waves, at the step and on average over the cycle, "
        f"carried on over {octaves:.2g} removed octaves with a factor of {DECAY:g} for each"
    )
    q = np.abs(np.asarray(leakage, dtype=float))
    part = ErrorPart.of("filter", leakage, distance, distance, note)
    leaks = np.abs(np.asarray(filtered.leakage, dtype=float))
    upper = np.where((q == 0) & np.isposinf(change), np.max(leaks, initial=0.0), part.upper)
    unknown = np.isnan(change)
    lower, upper = (np.where(unknown, np.nan, end) for end in (part.lower, upper))
    return ErrorPart(part.name, lower, upper, note)
