"""What is odd in a case but may be meant: what is odd in its scene, and what only its tables tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..base.quantities import to_text
from ..studies import Scene
from ..studies.plausibility import gas_warnings, moduli_warnings, scene_warnings
from ..topography import MOST_POINTS, Conditioning, resolving_shape

if TYPE_CHECKING:
    from ..case.case import Case

#: Fraction of the rms slope from which on a case is warned that the low-pass removes it: by itself, and where the
#: grid of a measured face is limited for its cost. Measured: with 49 % of it gone a turned face leaks 10 to 700 times
#: less.
_LOST_SLOPE, _LOST_TO_COST = 0.1, 0.02
#: Fraction of the rms slope from which on a case is warned that it is of noise.
_NOISE_SLOPE = 0.25


def plausibility_warnings(case: Case, scene: Scene, surface: Conditioning) -> tuple[str, ...]:
    """One sentence for each thing in a case and its scene that is not plausible, but may be meant."""
    solids = zip(("material", "counter_material"), case.solids, strict=True)
    odd = moduli_warnings((f"{name}.young", solid.young) for name, solid in solids if solid is not None)
    tested: tuple[str, ...] = ()
    if (test := case.output.test_fluid) is not None:
        tested = tuple(gas_warnings("output.test_fluid", test.fluid, test.inlet_pressure, test.outlet_pressure))
    return (
        *odd,
        *case.fluid_warnings,
        *case.solid_warnings,
        *scene_warnings(scene),
        *tested,
        *_odd_filter(case, scene, surface),
    )


def _odd_filter(case: Case, scene: Scene, surface: Conditioning) -> Iterator[str]:
    """Warn where the low-pass removes much of the measured slope, and say what keeps it."""
    if case.surface.continue_spectrum is not None:
        return
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
