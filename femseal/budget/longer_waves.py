"""Waves of a face that are longer than the measured patch: what they may do to the leakage of a broader seal.

Where the spectrum of the patch still rises at its longest waves, its power law is carried on to the breadth of the
seal. Forms are drawn from it, and go through the contact of the seal; tiles are as large as the patch, and leak as the
face does at their pressure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi

import numpy as np

from ..base import Array, Mapper, Pair
from ..contact import LoadState
from ..face.curves import PieceCurves
from ..face.piece_flow import Failed, FlowSettings, attempt, resolved_flow
from ..scene import Scene
from ..seal.form import SealForm
from ..seal.pressure_map import Frame
from ..seal.tiles import PieceSize, SealTiles
from ..studies.seal_contact import RoughLayer, layer_states, seal_contact
from ..topography import Representative

#: Forms that are drawn, and waves of each.
DRAWS, _WAVES = 8, 200
#: Breadth of a seal in sides of the patch from which on it has longer waves.
_BROADER = 1.25
#: Least Hurst exponent by which a spectrum that rises is carried on: two octaves of one patch tell it to ± 0.4.
_LEAST_HURST = 0.5


@dataclass(frozen=True, eq=False)
class DrawnForm:
    """A sum of waves of random directions and phases, alike all over a seal.

    vectors : wave vectors (waves, 2) [rad/m]. phases : (waves,) [rad]. rms_height : [m]. flatness : most from the
    highest to the lowest point [m]; None: any.
    """

    vectors: Array
    phases: Array
    rms_height: float
    flatness: float | None

    @property
    def shortest_wave(self) -> float:
        """Inf: the patch has none of its waves."""
        return np.inf

    def heights(self, points: Array, frame: Frame) -> Array:
        """√(2/waves) of the rms height times the sum of cosines."""
        z = np.cos(points @ self.vectors.T + self.phases).sum(axis=1)
        scale = self.rms_height * (2 / len(self.phases)) ** 0.5
        return z * min(scale, np.inf if self.flatness is None else self.flatness / np.ptp(z))


def longer_waves(
    scene: Scene,
    breadth: float | None,
    length: float | None,
    holds: Representative,
    *,
    flatness: float | None,
    seed: int,
    forms: Sequence[SealForm] = (),
    mapper: Mapper = map,
) -> Array | None:
    """Changes of ln(leakage) by drawn waves between the side of the patch and the breadth of the seal (draws, steps).

    breadth, length : of a strip [m]. holds : what the patch holds of its waves. flatness : of the seal, most from the
    highest to the lowest point [m]; None where it is not known. forms : of the seal, to which the waves come that are
    too short for them. NaN where the seal without the waves is closed, or their contact failed.

    Without a flatness the spectrum is carried on to the breadth; with one to the larger side of the seal, and where it
    does not rise, waves are as high as the flatness. None where a seal is hardly larger than the patch, or the patch
    holds its longest waves and no flatness is given.
    """
    side = min(scene.surface.shortest_patch.size)
    if not holds.rises and flatness is None:
        return None
    piece = PieceSize((side, side), max(1, round(scene.surface.size[0] / side)), length, breadth)
    tiles = attempt(scene.layout.lay_out, piece)
    if isinstance(tiles, Failed):  # narrower than the patch
        return None
    longest = (
        tiles.seal.size[0] if flatness is None else float(np.ptp(tiles.outlines, axis=(0, 1)).max())
    )
    longest = min((longest, *(form.shortest_wave for form in forms)))
    if longest < _BROADER * side:
        return None
    hurst = max(holds.hurst, _LEAST_HURST) if holds.rises else 1.0
    rms = _rms_between(holds, hurst, side, longest) if holds.rises else inf
    dry = scene.dry()
    take = partial(
        _gap_and_permeability, flow=replace(dry.flow, spiral=None), spacing=dry.surface.spacing
    )
    programme, found = layer_states(dry, take, mapper)
    gaps, k = np.array(found).T
    leaks = partial(
        _leakage, dry, tiles, RoughLayer.of_gaps(dry, programme, gaps), PieceCurves(programme, k)
    )
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x10E6,)))
    still = leaks(tuple(forms))
    moved = [
        leaks((*forms, _drawn(rng, hurst, (side, longest), rms, flatness))) for _ in range(DRAWS)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.log(np.where(still > 0, np.array(moved) / still, np.nan))


def _leakage(
    scene: Scene,
    tiles: SealTiles,
    layer: RoughLayer,
    curves: PieceCurves,
    forms: tuple[SealForm, ...],
) -> Array:
    """Leakage of a seal with forms at every step (steps,) [m²/s], its tiles being as the face; NaN where it failed."""
    nominal, steps = scene.steps.pressures[:, None], scene.steps
    k = np.repeat(curves.along(nominal, steps), tiles.count, axis=1)
    if forms:
        contact = attempt(seal_contact, scene, tiles, forms, map, layer)
        if isinstance(contact, Failed):  # such as a form that is too steep
            return np.full(len(steps), np.nan)
        k = curves.along(nominal * contact.fractions, steps) + contact.opened
    found = [attempt(scene.leakage, tiles.seal, tiles.permeability(one, one)) for one in k]
    return np.array([one.per_length for one in found])


def _gap_and_permeability(
    state: LoadState, *, flow: FlowSettings, spacing: Pair
) -> tuple[float, float]:
    """Mean gap [m] of a state and permeability of the face [m³], NaN where its flow failed."""
    found = attempt(resolved_flow, state.contact.gap, spacing, flow)
    return float(state.contact.mean_gap), found.permeability


def _rms_between(holds: Representative, h: float, shortest: float, longest: float) -> float:
    """Rms height of the waves between two wavelengths [m], √((1/2π)∫q C dq) by the power law carried on."""
    bend = 2 * pi / holds.octave
    integral = ((2 * pi / longest) ** (-2 * h) - (2 * pi / shortest) ** (-2 * h)) / (2 * h)
    return float(np.sqrt(holds.density * bend ** (2 + 2 * h) * integral / (2 * pi)))


def _drawn(
    rng: np.random.Generator,
    hurst: float,
    waves: Pair,
    rms: float,
    flatness: float | None,
) -> DrawnForm:
    """Waves between two lengths [m], whose numbers follow q C by the inverse of its integral."""
    low, high = ((2 * pi / wave) ** (-2 * hurst) for wave in waves)
    q = (low + (high - low) * rng.random(_WAVES)) ** (-1 / (2 * hurst))
    angle, phase = rng.uniform(0, 2 * pi, (2, _WAVES))
    return DrawnForm(
        q[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), phase, rms, flatness
    )
