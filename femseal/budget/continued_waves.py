"""Error of a leakage by waves that nobody measured: phases of those that continue a spectrum, and those beyond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from ..studies import Scene
from ..studies.scene import Array
from .changes import part_of_changes
from .coarse import CoarserSolution, on_all_steps
from .error_parts import ErrorPart
from .estimates import COVERAGE
from .removed_waves import filter_part


def continuation_part(
    scene: Scene, leakage: Array, others: Sequence[CoarserSolution], shorter: CoarserSolution, octaves: float, note: str
) -> ErrorPart:
    """Part of the continued waves: scatter between realisations and trend with the cut-off, as a root of squares.

    The scatter is Student's interval of one more realisation: the face has phases of its own. The trend is the effect
    of the shortest octave, carried on beyond the cut-off.

    Parameters
    ----------
    others : with other phases. shorter : without the shortest octave of waves. octaves : beyond the cut-off that count.
    note : a sentence that goes before how it was estimated.
    """
    steps, n = scene.steps, len(others) + 1
    changes = np.array([on_all_steps(steps, other, leakage) for other in others])
    finite = np.where(np.isinf(changes), 0.0, changes)
    every = np.vstack([np.zeros(len(steps)), finite])
    mean, scatter = every.mean(axis=0), every.std(axis=0, ddof=1)
    interval = stdtrit(n - 1, (1 + COVERAGE) / 2) * np.sqrt(1 + 1 / n) * scatter
    trend = filter_part(scene, leakage, shorter, octaves)
    q = np.abs(leakage)
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = [np.nan_to_num(np.log(pair), nan=0.0) for pair in (q / trend.lower, trend.upper / q)]
    below, above = (np.hypot(np.maximum(interval + s * mean, 0.0), t) for s, t in zip((-1, 1), sides, strict=True))
    below = np.where(np.isneginf(changes).any(axis=0), np.inf, below)
    opened = np.where(np.isposinf(changes).any(axis=0), np.inf, changes.sum(axis=0))
    leakiest = max(others, key=lambda other: float(np.nansum(np.abs(other.leakage))))
    text = f"{note}; {n} realisations by Student's interval, and the last octave carried on over {octaves:.2g} more"
    return part_of_changes("continuation", steps, leakage, below, above, text, change=opened, coarse=leakiest)
