"""A first answer at once: contact fraction and leakage from the spectrum of a face alone, by Persson's theory.

Nothing is solved. It stands beside a run, to show what is not plausible, and beside a case, to forecast it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np

from ..analytic import CLOSING_AREA, critical_junction
from ..base import Array
from ..seal import RectangularSeal
from ..topography import Topography
from .drawn_study import SealTiles
from .scene import Scene

#: Groups of waves into which a spectrum is put together, and the part of the mean square slope that is rounding.
_GROUPS, _ROUNDING = 64, 1e-12
#: Measured on 100 scenes of `tests/benchmarks/first_answer.py`: up to a contact fraction half of the answers are off by
#: up to the first factor, 95 % by up to the second; above it single constrictions decide, and no factor holds.
LIGHT, OFF_BY = 0.3, (2.2, 10.0)
#: Times the second factor by which a run may be off before it is not plausible.
_BEYOND = 10.0


@dataclass(frozen=True, eq=False)
class FirstAnswer:
    """What the spectrum of a face says at some loads, NaN at those that nothing is known of.

    area : contact fraction. gap, mean_gap : of the critical junction, 0 of a sealed face, and on the mean [m].
    leakage : of the seal per length [m²/s]. All (loads,).
    """

    area: Array
    gap: Array
    mean_gap: Array
    leakage: Array

    @property
    def permeability(self) -> Array:
        """Of the face [m³]."""
        return self.gap**3 / 12

    def doubts(self, leakage: Array, names: Sequence[str]) -> list[str]:
        """A warning of the computed leakage [m²/s] that is farthest off, where that is implausible.

        names : of the loads. Nothing is said near closing, where few constrictions decide.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(leakage) / self.leakage
            off = np.where(
                (ratio > 0) & (ratio < inf) & (self.area < LIGHT), np.abs(np.log(ratio)), 0.0
            )
        worst = int(off.argmax())
        if off[worst] <= np.log(_BEYOND * OFF_BY[1]):
            return []
        return [
            f"at {names[worst]} the leakage is {ratio[worst]:.2g} times what the spectrum of the face makes plausible, "
            f"which is right within {OFF_BY[1]:g} times in 95 % of the cases: are the units of heights, pixel, loads "
            "and modulus right?"
        ]

    def __str__(self) -> str:
        found = f"contact {_ends(100 * self.area)} %, narrowest passage {_ends(1e6 * self.gap)} µm"
        if np.isfinite(self.leakage).any():
            found += f", leakage {_ends(self.leakage)} m²/s per length (0: sealed)"
        return (
            f"{found}; leakage by the spectrum alone is right within {OFF_BY[0]:g} times in half of the cases and "
            f"{OFF_BY[1]:g} in 95 % up to {100 * LIGHT:g} % of contact, and unknown beyond"
        )


def _ends(values: Array) -> str:
    """The first and the last known value."""
    known = values[np.isfinite(values)]
    return " to ".join(dict.fromkeys(f"{float(f'{value:.2g}'):g}" for value in known[[0, -1]]))


def first_answer(
    face: Topography, modulus: float, hardness: float, pressures: Sequence[float] | Array
) -> FirstAnswer:
    """Contact fraction and passages of a face without undefined points, see `analytic.critical_junction`.

    modulus, hardness, pressures : E*, H (inf: elastic) and nominal pressures that the contact carries [Pa]. Grooves
    along the seal close at less contact than isotropic roughness and those along the leakage at more: by slopes s
    along x1 and x2 at 2s₂/(s₁ + s₂) times as much. Of several places it is the mean.
    """
    widths = [place.shape[1] for place in face.each]
    found = np.full((len(widths), len(pressures), 3), nan)
    for own, place in zip(found, face.each, strict=True):
        waves, powers = _spectrum(place)
        slopes = place.rms_slopes
        closing = CLOSING_AREA * 2 * slopes[1] / sum(slopes) if waves.size else nan
        for n, p in enumerate(pressures):
            if p > 0 and waves.size:
                own[n] = critical_junction(
                    p, modulus, waves, powers, hardness=hardness, closing=closing
                )
    area, _, mean = np.average(found, axis=0, weights=widths).T
    gap = np.cbrt(np.average(found[..., 1] ** 3, axis=0, weights=widths))
    return FirstAnswer(area, gap, mean, np.full(len(pressures), nan))


def of_scene(scene: Scene, tiles: SealTiles | None = None) -> FirstAnswer:
    """The same at the steps of the loading of a scene, with the leakage.

    tiles : of a drawn seal, evenly pressed; None: the face itself is the seal.
    """
    fluid, steps = scene.acting_fluid, scene.steps
    carried = fluid.carried if fluid is not None and fluid.nominal == "total" else 0.0
    pressures = np.where(steps.on_loading, steps.pressures - carried, nan)
    found = first_answer(scene.surface, scene.modulus, scene.law.mean_hardness, pressures)
    if tiles is None:
        one = scene.leakage(RectangularSeal(scene.surface.size, (1, 1)), 1.0).per_length
    else:
        one = scene.leakage(tiles.seal, tiles.permeability(*np.ones((2, tiles.count)))).per_length
    drop = scene.flow.drop
    ends = [max(p, drop.least_pressure) for p in (drop.inlet, drop.outlet)]
    factor = drop.law.factor(np.maximum(found.gap, 1e-12)[:, None], ends).mean(axis=1)
    return replace(found, leakage=one * found.permeability * factor)


def _spectrum(place: Topography) -> tuple[Array, Array]:
    """Wavenumbers [rad/m] and mean square heights [m²] of groups of waves, with the rms slope of the face."""
    q, density = place.radial_psd()
    first = np.unique(np.geomspace(1, q.size, _GROUPS).astype(int)) - 1
    power, slope2 = (np.add.reduceat(density * q**n, first) for n in (1, 3))
    kept = slope2 > _ROUNDING * slope2.sum()
    power, slope2 = power[kept], slope2[kept]
    return np.sqrt(slope2 / power), power * place.rms_slope**2 / slope2.sum()
