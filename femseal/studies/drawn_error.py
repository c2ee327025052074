"""What one measured patch does not know of a drawn seal, and what blocks do to a face: split conformal prediction.

`drawn_seals.csv` holds the leakage of drawn seals over that of the whole face, at every step of scenes drawn at random,
with seals in the rows of the face ("in place"), broader ones ("anywhere"), and broader ones whose form is known at
points ("with form"); and that of faces solved by blocks ("by blocks"). A score is the distance of ln(leakage),
divided by the difficulty of the step, which is known without the truth. The quantile of the scores of a kind, so
many decades down, times the difficulty of a new step is the half-width of its band.

Steps of one scene err together, so the scenes are what is exchangeable: every scene has the weight 1/(n + 1), which its
steps share, and what is left is beyond all scores. A band then holds the truth of a step of a new scene of the same
population with at least the coverage, whatever the distribution of the errors.

Sources: Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (a quantile for each kind);
Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (scores over difficulty); Lee, Barber & Willett,
J. R. Stat. Soc. B, 2025 (several steps of a scene).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from ..base import Array
from ..loads import LoadProgramme, first_known, load_sensitivity, neighbouring_steps

#: The calibration set, which `drawn_seals.py` and `patch_and_form.py` of `tests/benchmarks` make.
CALIBRATION = Path(__file__).with_name("drawn_seals.csv")
#: Kinds of drawn seals, and blocks.
KINDS = ("in place", "anywhere", "with form", "by blocks")
#: Fraction of the cases that a band holds.
COVERAGE = 0.95
#: Decades of the leakage below the first at which the quantiles change: near closing errors are of another kind.
_EDGES = (1.0, 3.0)
#: Decades of the leakage below the first, by kind, from which on a truth is not told from a sealed seal: a band whose
#: lower end is below has none.
FLOOR_DECADES = {"in place": 6.0, "anywhere": 3.5, "with form": 3.5, "by blocks": 3.5}
#: Slope that counts beside a sealed step, and the largest.
_BESIDE_SEALED, _STEEPEST = 10.0, 20.0


def decades(leakage: Array) -> Array:
    """Decades of the leakage below that of the first known step (steps,), 0 of a sealed one."""
    q = np.abs(np.asarray(leakage, float))
    first = q[first_known(q)]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((q > 0) & (first > 0), np.log10(first / q), 0.0)


def difficulty(steps: LoadProgramme, leakage: Array) -> Array:
    """Size of the error to be expected, up to a factor, at every step (steps,).

    It rises with the slope of ln(leakage) over ln(load), and with the decades below a tenth of the first leakage.

    leakage : of the median seal (steps,) [m²/s].
    """
    slope = load_sensitivity(steps, leakage)
    for s, other in neighbouring_steps(steps):
        if (leakage[s] == 0) != (leakage[other] == 0):
            slope[[s, other]] = np.maximum(slope[[s, other]], _BESIDE_SEALED)
    fallen = np.maximum(decades(leakage) - 1.0, 0.0)
    return (0.5 + 0.1 * np.minimum(slope, _STEEPEST)) * (1.0 + fallen)


def half_width(kind: str, steps: LoadProgramme, leakage: Array) -> Array:
    """Distance of ln(leakage) to both ends of the band of what one patch does not know (steps,).

    kind : one of `KINDS`. leakage : of the median seal (steps,) [m²/s].
    """
    _, widths = _calibrated(kind)
    return widths[np.digitize(decades(leakage), _EDGES)] * difficulty(steps, leakage)


def count_scenes(kind: str) -> int:
    """Number of scenes in the calibration set of a kind."""
    return _calibrated(kind)[0]


@cache
def _calibrated(kind: str) -> tuple[int, Array]:
    """Number of scenes of a kind, and the width over difficulty that holds the truth of a step of a new one (groups,).

    Groups are of steps so many decades down; one of too few scenes takes the steps of those with more leakage too.
    """
    rows = np.loadtxt(CALIBRATION, str, delimiter=",", skiprows=1, quotechar='"', encoding="utf-8")
    rows = rows[rows[:, 0] == kind]
    error, fallen, hard = rows[:, 4:].T.astype(float)
    scene, score, of_group = rows[:, 2], np.abs(error) / hard, np.digitize(fallen, _EDGES)
    widths = []
    for group in range(len(_EDGES) + 1):
        n, first = 0, group + 1
        while first > 0 and 1 / (n + 1) > 1 - COVERAGE + 1e-12:
            first -= 1
            chosen = (of_group >= first) & (of_group <= group)
            names, number = np.unique(scene[chosen], return_inverse=True)
            n = names.size
        weight = 1.0 / (np.bincount(number)[number] * (n + 1))
        order = np.argsort(score[chosen], kind="stable")
        reached = int(np.searchsorted(np.cumsum(weight[order]), COVERAGE - 1e-12))
        widths.append(score[chosen][order[min(reached, order.size - 1)]])
    return np.unique(scene).size, np.array(widths)
