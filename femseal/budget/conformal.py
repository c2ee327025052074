"""Model error of drawn seals, from scenes that were also solved in full: split conformal prediction.

`calibration.csv` holds the leakage by each method over the deterministic one, at every step of scenes drawn at random.
A score is the distance of ln(leakage) that the other parts of the budget leave over, divided by the difficulty of the
step, which is known without the truth (`DIFFICULTIES`). The quantile of the scores of a kind of method times the
difficulty of a new step is its width.

Steps of one scene err together, so the scenes are what is exchangeable: every scene has the weight 1/(n + 1), which its
steps share, and what is left is beyond all scores. A band then holds the truth of a step of a new scene of the same
population with at least the coverage, whatever the distribution of the errors.

A step that is sealed by the method has no distance of ln(leakage), see `changes.sealed_upper`.

Sources: Vovk, Gammerman & Shafer, Algorithmic Learning in a Random World, 2005 (a quantile for each kind of method);
Papadopoulos, Gammerman & Vovk, Neural conformal prediction, 2008 (scores over difficulty); Lee, Barber & Willett,
J. R. Stat. Soc. B, 2025 (several steps of a scene).
"""

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from ..base import InputError, validate
from ..studies.load_curves import first_known
from ..studies.scene import Array

#: The calibration set, which `tests/benchmarks/calibration.py` makes.
CALIBRATION = Path(__file__).with_name("calibration.csv")
Features = Mapping[str, Array]


def _drawn(least: float) -> Callable[[Features], Array]:
    """Seals whose windows scatter have channels that a face as short as theirs may miss."""
    return lambda f: (least + f["scatter"] ** 2) * (1.0 + np.maximum(f["decades"], 0.0) ** 2)


#: Difficulty of a step by the kind of method: the size of the error to be expected, up to a factor, from what is known
#: without the truth. decades : below the leakage of the first load. scatter : standard deviation of ln(leakage) of
#: drawn seals by library and realisations.
DIFFICULTIES: dict[str, Callable[[Features], Array]] = {
    "runs": _drawn(0.03),
    "block": _drawn(0.1),
    "global": _drawn(0.3),
    "uniform": _drawn(0.1),
}


def decades(leakage: Array) -> Array:
    """Decades of the leakage below that of the first known step (steps,), 0 of a sealed one."""
    q = np.abs(np.asarray(leakage, float))
    first = q[first_known(q)]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((q > 0) & (first > 0), np.log10(first / q), 0.0)


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of one kind of method, of every step of the calibration set that leaks by the method.

    scene : number of its scene (steps,). value : |ln(leakage/truth)| that the other parts leave over, in difficulties.
    """

    scene: Array
    value: Array

    @property
    def scenes(self) -> int:
        """Number of scenes, which are what is exchangeable."""
        return len(np.unique(self.scene))

    def quantile(self, coverage: float) -> float:
        """Width over difficulty that holds the truth of a step of a new scene with this probability.

        Raises InputError: too few scenes for the coverage.
        """
        n = self.scenes
        if 1 - coverage < 1 / (n + 1) - 1e-12:
            raise InputError("coverage", coverage, f"at most {n / (n + 1):.3g} by a calibration of {n} scenes")
        of_scene = np.unique(self.scene, return_inverse=True)[1]
        weight = 1.0 / (np.bincount(of_scene)[of_scene] * (n + 1))
        order = np.argsort(self.value, kind="stable")
        reached = int(np.searchsorted(np.cumsum(weight[order]), coverage - 1e-12))
        return float(self.value[order[min(reached, order.size - 1)]])


def model_error(kind: str, *, coverage: float = 0.95, **features: Array) -> Array:
    """Distance of ln(leakage) to both ends of the band of a model error (steps,).

    kind : of method, one of `DIFFICULTIES`. coverage : fraction of new scenes' steps whose truth the band holds.
    features : what the difficulty of the kind is made of, at every step (steps,), see `DIFFICULTIES`.

    Raises InputError: another kind, a feature that is missing, a coverage for which the calibration set is too small.
    """
    validate.number("coverage", coverage)
    if not coverage < 1 or kind not in DIFFICULTIES:
        if kind in DIFFICULTIES:
            raise InputError("coverage", coverage, "a fraction below 1")
        raise InputError("kind", kind, f"one of {', '.join(DIFFICULTIES)}")
    difficulty = _difficulty(kind, features)
    return calibration()[kind].quantile(coverage) * difficulty


@cache
def calibration(path: Path = CALIBRATION) -> dict[str, Scores]:
    """Scores of every kind of method in a calibration set.

    What the error exceeds the band of the other parts `own` by is the root of the difference of squares, as bands are
    combined by the root of the sum of squares.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    found = {}
    for kind in dict.fromkeys(row["method"] for row in rows):
        of_kind = [row for row in rows if row["method"] == kind]
        columns = {
            name: np.array([float(row[name] or "nan") for row in of_kind])
            for name in of_kind[0]
            if name not in ("method", "surface", "scene")
        }
        ratio, own = columns["log_ratio"], np.nan_to_num(columns["own"])
        left = np.sqrt(np.maximum(ratio**2 - own**2, 0.0))
        # a step that the method has sealed has no distance of ln(leakage)
        open_ = ratio > -np.inf
        names = {row["scene"]: n for n, row in enumerate(of_kind)}
        scene = np.array([names[row["scene"]] for row in of_kind])
        value = left[open_] / _difficulty(kind, columns)[open_]
        found[kind] = Scores(scene[open_], np.where(np.isnan(value), np.inf, value))
    return found


def _difficulty(kind: str, features: Features) -> Array:
    try:
        return np.asarray(DIFFICULTIES[kind](features), dtype=float)
    except KeyError as missing:
        given = ", ".join(sorted(features)) or "none"
        raise InputError(f"features of {kind}", given, f"also {missing.args[0]}") from None
