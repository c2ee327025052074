"""Estimate how waves longer than the measured patch may change the leakage of a wider seal.

If the roughness spectrum of the patch still rises towards the longest measured waves, the power law of the spectrum is
extrapolated to waves as long as the seal is wide. Random waves with the extrapolated spectrum are added to the shape of
the seal, and the contact pressure of each tile is computed. A tile is as large as the patch, and has the permeability
of the patch under the contact pressure of the tile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, pi

import numpy as np

from ..base import Array, Mapper, Pair
from ..contact import LoadState
from ..face.cell_flow import Failed, FlowSettings, attempt, solve_surface_flow
from ..face.curves import CellCurves
from ..scene import Scene
from ..seal.form import SealForm
from ..seal.frame import Frame
from ..seal.tiles import CellSize, SealTiles
from ..studies.rough_layer import RoughLayer, solve_layer_states
from ..studies.seal_contact import solve_seal_contact
from ..topography import Representative

#: Number of random form deviations, and number of waves of each form deviation.
DRAWS, _WAVES = 8, 200
#: Longer waves are only added if the longest wave is at least this many times as long as the side of the patch.
_BROADER = 1.25
#: Smallest Hurst exponent with which a rising spectrum is extrapolated. The exponent is estimated from two octaves of
#: one patch, with an error of ± 0.4.
_LEAST_HURST = 0.5


@dataclass(frozen=True, eq=False)
class DrawnForm:
    """Describe a random form deviation of a seal by a sum of waves with random directions and phases.

    Attributes
    ----------
    vectors : array (waves, 2), rad/m
        Wave vectors.
    phases : array (waves,), rad
        Phases of the waves.
    rms_height : float, m
        Rms height of the form deviation.
    flatness : float, m, optional
        Upper limit of the distance from the lowest to the highest point; None for no limit.
    """

    vectors: Array
    phases: Array
    rms_height: float
    flatness: float | None

    @property
    def shortest_wave(self) -> float:
        """Shortest wave present in both the form deviation and the patch [m]; always inf, because they share none."""
        return np.inf

    def heights(self, points: Array, frame: Frame) -> Array:
        """Compute the heights at points (n, 2) [m].

        Each of the n waves has the amplitude √(2/n) times the rms height, so that their sum has the rms height
        `rms_height`. The amplitude of the waves is reduced if the form deviation would exceed the flatness.
        """
        z = np.cos(points @ self.vectors.T + self.phases).sum(axis=1)  # for an amplitude of 1
        amplitude = self.rms_height * (2 / len(self.phases)) ** 0.5
        largest_amplitude = np.inf
        if self.flatness is not None:
            largest_amplitude = self.flatness / np.ptp(z)
        return z * min(amplitude, largest_amplitude)


def longer_waves(
    scene: Scene,
    breadth: float | None,
    length: float | None,
    waves: Representative,
    *,
    flatness: float | None,
    seed: int,
    forms: Sequence[SealForm] = (),
    mapper: Mapper = map,
) -> Array | None:
    """Compute the changes of ln(leakage) that are caused by random waves longer than the measured patch.

    The shortest random wave is as long as the side of the patch. The longest random wave is as long as the width of the
    seal or, if a flatness is given, as the longer side of the seal. The heights of the random waves follow from the
    extrapolated spectrum of the patch if the spectrum rises towards long waves, and otherwise from the flatness.

    Parameters
    ----------
    scene : input of the studies, with the surface of the patch.
    breadth, length : width (from inlet to outlet) and length of a straight seal [m]; None for other seals.
    waves : spectrum of the longest waves of the patch.
    flatness : distance between the lowest and the highest point of the seal [m]; None if it is not known.
    seed : seed of the random waves.
    forms : known form deviations of the seal. The random waves are shorter than the shortest wave of the known form
        deviations.
    mapper : function like the builtin `map` that computes a stage for many items.

    Returns
    -------
    Changes of ln(leakage), array (random form deviations, steps). A change is NaN if the seal is sealed without the
    random waves, or if the contact with them could not be solved. The function returns None if the seal is hardly wider
    than the patch. The same holds if no flatness is given and the spectrum of the patch does not rise towards long
    waves: the patch then contains the longest waves of the surface.
    """
    side = min(scene.surface.shortest_patch.size)
    if not waves.rises and flatness is None:
        return None
    # the tiles are as large as the patch
    cell = CellSize((side, side), max(1, round(scene.surface.size[0] / side)), length, breadth)
    tiles = attempt(scene.layout.lay_out, cell)
    if isinstance(tiles, Failed):  # the seal is narrower than the patch
        return None
    longest = tiles.seal.size[0]
    if flatness is not None:
        longest = float(np.ptp(tiles.outlines, axis=(0, 1)).max())
    longest = min([longest, *(form.shortest_wave for form in forms)])
    if longest < _BROADER * side:
        return None
    hurst, rms = 1.0, inf
    if waves.rises:
        hurst = max(waves.hurst, _LEAST_HURST)
        rms = _rms_between(waves, hurst, side, longest)
    dry = scene.dry()
    flow = replace(dry.flow, spiral=None)
    take = partial(_gap_and_permeability, flow=flow, spacing=dry.surface.spacing)
    programme, states = solve_layer_states(dry, take, mapper)
    mean_gap, permeability = np.array(states).T  # (load of the programme,) each
    layer = RoughLayer.from_mean_gaps(dry, programme, mean_gap)
    curves = CellCurves(programme, permeability)
    solve = partial(_leakage, dry, tiles, layer, curves)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0x10E6,)))
    without_waves = solve(tuple(forms))
    with_waves = []
    for _ in range(DRAWS):
        random_form = _draw_form(rng, hurst, (side, longest), rms, flatness)
        with_waves.append(solve((*forms, random_form)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(without_waves > 0, np.array(with_waves) / without_waves, np.nan)
        return np.log(ratio)


def _leakage(
    scene: Scene,
    tiles: SealTiles,
    layer: RoughLayer,
    curves: CellCurves,
    forms: tuple[SealForm, ...],
) -> Array:
    """Compute the leakage of a seal with form deviations at every step (steps,) [m²/s]; NaN where a solution failed."""
    steps = scene.steps
    nominal = steps.pressures[:, None]  # (step, 1)
    # without form deviations, every tile is under the nominal pressure
    k = np.repeat(curves.k_on_paths(nominal, steps), tiles.count, axis=1)  # (step, tile)
    if forms:
        # the pressure of each tile, and permeability added by a gap between the macroscopic shapes
        contact = attempt(solve_seal_contact, scene, tiles, forms, map, layer)
        if isinstance(contact, Failed):  # for example because the form is too steep
            return np.full(len(steps), np.nan)
        tile_pressures = nominal * contact.pressure_fractions
        k = curves.k_on_paths(tile_pressures, steps) + contact.added_permeability
    leakage = []
    for k_at_step in k:
        element_k = tiles.permeability(k_at_step, k_at_step)  # isotropic
        leakage.append(attempt(scene.leakage, tiles.seal, element_k).per_length)
    return np.array(leakage)


def _gap_and_permeability(
    state: LoadState, *, flow: FlowSettings, spacing: Pair
) -> tuple[float, float]:
    """Compute the mean gap [m] and the permeability [m³] of a contact state; NaN if the flow could not be solved."""
    solution = attempt(solve_surface_flow, state.contact.gap, spacing, flow)
    return float(state.contact.mean_gap), solution.permeability


def _rms_between(waves: Representative, h: float, shortest: float, longest: float) -> float:
    """Compute the rms height [m] of the waves between the wavelengths `shortest` and `longest` [m].

    The mean square height is (1/2π)∫q C(q) dq over the wave numbers q between 2π/longest and 2π/shortest. The spectral
    density is the power law C(q) = C₀ (q/q₀)^(−2 − 2h), with the Hurst exponent h. Here q₀ and C₀ are the wave number
    and the spectral density of the longest octave of the patch.
    """
    q0 = 2 * pi / waves.octave
    lowest, highest = 2 * pi / longest, 2 * pi / shortest  # wave numbers
    integral = (lowest ** (-2 * h) - highest ** (-2 * h)) / (2 * h)  # ∫ q^(−1 − 2h) dq
    return float(np.sqrt(waves.density * q0 ** (2 + 2 * h) * integral / (2 * pi)))


def _draw_form(
    rng: np.random.Generator,
    hurst: float,
    wavelengths: Pair,
    rms: float,
    flatness: float | None,
) -> DrawnForm:
    """Draw a form deviation that consists of random waves between two wavelengths [m].

    The probability density of a wave number q is proportional to q C(q), where C is the spectral density, and therefore
    to q^(−1 − 2H), where H is the Hurst exponent. The wave numbers are drawn by inverting their cumulative
    distribution, which is a linear function of q^(−2H).
    """
    # values of q^(−2H) at the lowest and at the highest wave number
    low, high = ((2 * pi / wavelength) ** (-2 * hurst) for wavelength in wavelengths)
    q = (low + (high - low) * rng.random(_WAVES)) ** (-1 / (2 * hurst))
    angle, phase = rng.uniform(0, 2 * pi, (2, _WAVES))
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return DrawnForm(q[:, None] * directions, phase, rms, flatness)
