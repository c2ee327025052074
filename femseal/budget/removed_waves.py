"""Error of a leakage by the waves that a low-pass removed from the face."""

from __future__ import annotations

import numpy as np

from ..studies import Scene
from ..studies.scene import Array
from .coarse import CoarserSolution, on_all_steps
from .error_parts import ErrorPart

#: Effect of an octave of waves on ln(leakage) over that of the next longer one.
DECAY = 0.7
#: Safety factor.
SAFETY = 1.25


def filter_part(scene: Scene, leakage: Array, filtered: CoarserSolution, octaves: float) -> ErrorPart:
    """Part of the removed waves: the effect of the shortest octave that is kept, carried on to those removed.

    Parameters
    ----------
    filtered : without the shortest octave of waves. octaves : of waves that were removed from the face.
    """
    change = on_all_steps(scene.steps, filtered, leakage)
    # as many terms of a geometric series as there are octaves
    terms = DECAY * (1 - DECAY**octaves) / (1 - DECAY)
    distance = SAFETY * terms * np.abs(change)
    note = (
        f"change of ln(leakage) without the shortest octave of waves, carried on over {octaves:.2g} removed octaves "
        f"with a factor of {DECAY:g} for each"
    )
    q = np.abs(np.asarray(leakage, dtype=float))
    part = ErrorPart.of("filter", leakage, distance, distance, note)
    leaks = np.abs(np.asarray(filtered.leakage, dtype=float))
    upper = np.where((q == 0) & np.isposinf(change), np.max(leaks, initial=0.0), part.upper)
    unknown = np.isnan(change)
    lower, upper = (np.where(unknown, np.nan, end) for end in (part.lower, upper))
    return ErrorPart(part.name, lower, upper, note)
