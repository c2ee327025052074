"""What one measured patch does not know of a drawn seal: split conformal prediction from scenes solved in full.

`drawn_seals.csv` holds the leakage of drawn seals over that of the whole face, at every step of scenes drawn at random,
with seals in the rows of the face ("in place") and broader ones ("anywhere"). A score is the distance of ln(leakage),
divided by the difficulty of the step, which is known without the truth. The quantile of the scores of a kind times the
difficulty of a new step is the half-width of its band.

Steps of one scene err together, so the scenes are what is exchangeable: every scene has the weight 1/(n + 1), which its
steps share, and what is left is beyond all scores. A band then holds the truth of a step of a new scene of the same
population with at least the coverage, whatever the distribution of the errors.

Sources: Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (a quantile for each kind);
Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (scores over difficulty); Lee, Barber & Willett,
J. R. Stat. Soc. B, 2025 (several steps of a scene).
"""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from ..base import Array, Indices, InputError, validate
from ..face.curves import PieceCurves
from ..seal.tiles import face_tiles
from ..windows import Failed, attempt
from .load_curves import first_known
from .piece_states import FacePieces
from .scene import Scene

#: The calibration set, which `tests/benchmarks/drawn_seals.py` makes.
CALIBRATION = Path(__file__).with_name("drawn_seals.csv")
#: Kinds of drawn seals.
KINDS = ("in place", "anywhere")
#: Redraws of the patch from which its scatter is taken, and the least of ln(leakage) over the median of a closed one.
_REDRAWS, _CLOSED = 24, -6.0


def decades(leakage: Array) -> Array:
    """Decades of the leakage below that of the first known step (steps,), 0 of a sealed one."""
    q = np.abs(np.asarray(leakage, float))
    first = q[first_known(q)]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((q > 0) & (first > 0), np.log10(first / q), 0.0)


def difficulty(leakage: Array, scatter: Array) -> Array:
    """Size of the error to be expected, up to a factor, at every step (steps,).

    leakage : of the median seal [m²/s]. scatter : of redraws as small as the patch, see `patch_scatter`.
    """
    fallen = np.maximum(decades(leakage), 0.0)
    return np.asarray(0.15 + 0.4 * scatter + 0.1 * fallen)


def half_width(kind: str, *, leakage: Array, scatter: Array, coverage: float = 0.95) -> Array:
    """Distance of ln(leakage) to both ends of the band of what one patch does not know (steps,).

    kind : one of `KINDS`. coverage : fraction of new scenes' steps whose truth the band holds.

    Raises InputError: another kind, a coverage for which the calibration set is too small.
    """
    if kind not in KINDS:
        raise InputError("kind", kind, f"one of {', '.join(KINDS)}")
    if not validate.number("coverage", coverage) < 1:
        raise InputError("coverage", coverage, "a fraction below 1")
    return _quantile(kind, coverage) * difficulty(leakage, scatter)


def count_scenes(kind: str) -> int:
    """Number of scenes in the calibration set of a kind."""
    return len(np.unique(_scores()[kind][0]))


@cache
def _quantile(kind: str, coverage: float) -> float:
    """Width over difficulty that holds the truth of a step of a new scene with this probability."""
    scene, score = _scores()[kind]
    n = len(np.unique(scene))
    if 1 - coverage < 1 / (n + 1) - 1e-12:
        raise InputError("coverage", coverage, f"at most {n / (n + 1):.3g} by a calibration of {n} scenes")
    weight = 1.0 / (np.bincount(scene)[scene] * (n + 1))
    order = np.argsort(score, kind="stable")
    reached = int(np.searchsorted(np.cumsum(weight[order]), coverage - 1e-12))
    return float(score[order[min(reached, order.size - 1)]])


@cache
def _scores() -> dict[str, tuple[Indices, Array]]:
    """Number of the scene, and distance of ln(leakage) over difficulty, of every step that leaks, by kind."""
    with CALIBRATION.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    found = {}
    for kind in KINDS:
        of_kind = [row for row in rows if row["kind"] == kind]
        scene = np.unique([row["scene"] for row in of_kind], return_inverse=True)[1]
        error, hard = (np.array([float(row[name]) for row in of_kind]) for name in ("log_ratio", "difficulty"))
        found[kind] = (scene, np.abs(error) / hard)
    return found


def patch_scatter(scene: Scene, pieces: FacePieces, in_place: bool) -> Array:
    """Standard deviation of ln(leakage) of seals as small as the patch, drawn from its pieces (steps,).

    A closed one, and one whose flow fails as nearly all of it is closed, counts as one of e⁻⁶ of the median. 0 where
    most are closed.
    """
    tiles = face_tiles(scene.surface.size, pieces.cut.shape)
    rng = np.random.default_rng(0)
    tiles = tiles if in_place else replace(tiles, in_place=False)
    draws = [tiles.draw(pieces.cut.shape, rng) for _ in range(_REDRAWS)]
    k = pieces.k[0].reshape(2, len(pieces.steps), -1)
    if pieces.steps != scene.steps:
        fluid = scene.acting_fluid
        relief = 0.0 if fluid is None else float(fluid.relief([fluid.mean])[0])
        nominal = np.maximum(scene.steps.pressures[:, None] - relief, 0.0)
        k = np.array(
            [
                [PieceCurves(pieces.steps, of_piece).along(nominal, scene.steps)[:, 0] for of_piece in along.T]
                for along in k
            ]
        ).transpose(0, 2, 1)
    found = np.zeros((_REDRAWS, k.shape[1]))
    for n, piece in enumerate(draws):
        for s in np.flatnonzero(np.isfinite(k).all(axis=(0, 2))):
            drawn = tiles.permeability(k[0, s, piece], k[1, s, piece])
            flow = attempt(tiles.seal.flow, drawn)
            found[n, s] = 0.0 if isinstance(flow, Failed) else flow.conductance
    median = np.median(found, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(found / median)
    return np.where(median > 0, np.maximum(logs, _CLOSED).std(axis=0), 0.0)
