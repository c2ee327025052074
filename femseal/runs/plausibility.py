"""What is odd in a case but may be meant: told with its numbers, before a run and with its results."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite
from typing import TYPE_CHECKING

from ..base.quantities import to_text
from ..fluids import IdealGas
from ..studies import Scene
from ..topography import MOST_POINTS, Conditioning, resolving_shape

if TYPE_CHECKING:
    from .case import Case

#: Young's moduli of metals, and of hard coatings, lie between these [Pa].
_YOUNG_LIMITS = (5e9, 1.2e12)
#: Share of the contact pressure from which on the fluid lifts the faces noticeably, which the model leaves out.
_LIFTING_SHARE = 0.5
#: Share of the hardness from which on the nominal pressure flattens most of the face, where hardness is no constant.
_FLATTENING_SHARE = 0.5
#: Largest rms slope for which a face is near to a half-space.
_STEEP = 1.0
#: Share of the rms slope from which on it is told that the low-pass removes it: by itself, and where the grid of a
#: measured face is limited for its cost. Measured: with 49 % of it gone a turned face leaks 10 to 700 times less.
_LOST_SLOPE, _LOST_TO_COST = 0.1, 0.02
#: Share of the rms slope from which on it is told that it is of noise.
_NOISE_SLOPE = 0.25


def oddities(case: Case, scene: Scene, surface: Conditioning) -> tuple[str, ...]:
    """One sentence for each odd thing in a case and the scene made of it."""
    return (*_odd_solids(case), *_odd_pressures(scene), *_odd_surface(scene), *_odd_filter(case, scene, surface))


def _odd_solids(case: Case) -> Iterator[str]:
    low, high = _YOUNG_LIMITS
    for name, solid in zip(("material", "counter_material"), case.solids, strict=True):
        if solid is not None and not low <= solid.young <= high:
            usual = f"{to_text(low, 'Pa')} to {to_text(high, 'Pa')}"
            yield f"{name}.young {to_text(solid.young, 'Pa')} is not that of a metal ({usual}): is its unit right?"


def _odd_pressures(scene: Scene) -> Iterator[str]:
    inlet, steps = scene.inlet_pressure, scene.steps
    lifted = [step for step in steps if step.pressure > 0 and inlet > _LIFTING_SHARE * step.pressure]
    if lifted:
        least = min(step.pressure for step in lifted)
        yield (
            f"the fluid's {to_text(inlet, 'Pa')} at the inlet is {inlet / least:.2g} times the contact pressure of "
            f"{to_text(least, 'Pa')}, and more than {_LIFTING_SHARE:.0%} of it at {len(lifted)} of {len(steps)} load "
            "steps: the model leaves out that the fluid lifts the faces, so that leakage is too small there"
        )
    if isinstance(scene.fluid, IdealGas) and scene.outlet_pressure == 0:
        yield (
            "fluid.outlet_pressure 0 Pa of a gas is absolute, a vacuum: into the surroundings it is 101.3 kPa, and "
            "pressures above those of the surroundings need as much added"
        )
    highest = max(step.pressure for step in steps)
    if isfinite(scene.hardness) and highest > _FLATTENING_SHARE * scene.hardness:
        yield (
            f"the nominal pressure of {to_text(highest, 'Pa')} is {highest / scene.hardness:.0%} of the hardness "
            f"{to_text(scene.hardness, 'Pa')}: most of the face is plastic then, for which the model is not made"
        )


def _odd_surface(scene: Scene) -> Iterator[str]:
    slope = scene.surface.rms_slope
    if slope > _STEEP:
        yield (
            f"the rms slope of the face is {slope:.2g}, and a half-space is for slopes well below 1: check the units "
            "of heights and pixel, or take a longer surface.shortest_wave"
        )


def _odd_filter(case: Case, scene: Scene, surface: Conditioning) -> Iterator[str]:
    measured, kept = (to_text(wave, "m", 3) for wave in (surface.shortest_measured, surface.shortest_wavelength))
    asked = case.surface.shortest_wave is not None or case.surface.points is not None
    points = resolving_shape(scene.surface.size, surface.shortest_measured)
    limited = not asked and surface.shape != surface.shape_before and points[0] * points[1] > MOST_POINTS
    if surface.lost_slope > (_LOST_TO_COST if limited else _LOST_SLOPE):
        remedy = f"set surface.points = {list(points)}"
        if case.surface.shortest_wave is not None:
            keys = "surface.shortest_wave" + (" and surface.points" if case.surface.points is not None else "")
            remedy = f"leave out {keys}"
        elif limited:
            most = " × ".join(map(str, surface.shape))
            remedy += f' (unasked no more than {most} are taken), with method = "two-scale" if that is too dear'
        yield (
            f"the low-pass at {kept} removes {surface.lost_slope:.0%} of the rms slope of the face, whose waves down "
            f"to {measured} stand above noise: leakage may be off by factors; to keep them {remedy}"
        )
    noise = 1 - surface.rms_slope_measured / surface.rms_slope if surface.rms_slope else 0.0
    if noise > _NOISE_SLOPE:
        yield (
            f"{noise:.0%} of the rms slope is of waves from {kept} to {measured}, which are noise or beyond the "
            f"instrument: surface.shortest_wave = '{measured}' removes them"
        )
