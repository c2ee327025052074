"""Error of a leakage by the waves that a low-pass removed from the face."""

from __future__ import annotations

import numpy as np

from ..studies import Scene
from ..studies.scene import Array
from .changes import load_sensitivity, part_of_changes
from .coarse import CoarserSolution, on_all_steps
from .error_parts import ErrorPart

#: Effect of an octave of waves on ln(leakage) over that of the next longer one.
DECAY = 0.4
#: Error by one removed octave over the change without the next longer one and its mean shift of the load: where the
#: change goes on in its direction, and against it. Measured on 26 self-affine faces that had lost two octaves, at the
#: loads that leak more than 1e-3 of the first: 0.66 and 0.33 hold 95 of 100 errors, 0.76 and 0.38 hold 97; it is more
#: for so few faces. Waves that are put back mostly raise the leakage.
ALONG, AGAINST = 1.1, 0.5
#: Least slope of ln(leakage) over ln(load) that the shift is counted with.
_LEAST_SLOPE = 1.0


def filter_part(scene: Scene, leakage: Array, filtered: CoarserSolution, octaves: float) -> ErrorPart:
    """Part of the removed waves: the effect of the shortest octave that is kept, carried on to those removed.

    Parameters
    ----------
    filtered : without the shortest octave of waves. octaves : of waves that were removed from the face.
    """
    steps = scene.steps
    change = on_all_steps(steps, filtered, leakage)
    slope = np.maximum(load_sensitivity(steps, leakage), _LEAST_SLOPE)
    known = [steps.index(step) for step in filtered.steps]
    finite = [s for s in known if np.isfinite(change[s])]
    # as many terms of a geometric series as there are octaves, and parts of one
    terms = (1 - DECAY**octaves) / (1 - DECAY)
    shift = float(np.mean(np.abs(change[finite] / slope[finite]))) if finite else 0.0
    scale = terms * np.hypot(change, shift * slope)
    lowers = np.isneginf(change[known]).any() or float(np.sum(change[finite] / slope[finite])) <= 0
    below, above = (AGAINST * scale, ALONG * scale) if lowers else (ALONG * scale, AGAINST * scale)
    below = np.where(np.isposinf(change), np.inf, below)
    note = (
        f"change of ln(leakage) without the shortest octave of waves, carried on over {octaves:.2g} removed octaves "
        f"with a factor of {DECAY:g} for each; its {'rise' if lowers else 'fall'} is the likelier"
    )
    return part_of_changes("filter", steps, leakage, below, above, note, change=change, coarse=filtered)
