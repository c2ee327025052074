"""How the grooves of a face run around the seal: rings, or the spiral that a lathe cuts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..base.errors import NotConverged
from ..base.quantities import to_text
from ..case.case import Case
from ..case.faces import FileFace, TurnedFace
from ..flow.law import cubic_law
from ..seal import RectangularSeal
from ..seal.lay import Lay
from ..seal.layouts import AnnularLayout, Layout, RectangularLayout
from ..studies import Scene
from ..topography import Topography

#: Fractions of the variance of the heights that means along x2 keep where grooves run along x2, and of the power of
#: those means near the wave of the grooves where these are equally far apart.
_GROOVED, _EVEN = 0.5, 0.3
#: Waves of grooves that a face has at least.
_LEAST_GROOVES = 3


def wound_layout(case: Case) -> Layout:
    """The shape of the seal. The lead of a spiral goes with the circumference, the length of a drawn strip.

    The grooves of one turned face that is generated wind with its pitch, unless the case says how its lay runs, or asks
    for what cannot follow them: windows that keep their places, elements, another discretisation, a choice of method.
    """
    layout, circumference = case.layout, _circumference(case)
    if not isinstance(layout, RectangularLayout | AnnularLayout):
        return layout
    lay = layout.lay
    pitches = [face.pitch for face in case.face if isinstance(face, TurnedFace) and face.pitch < face.size[0]]
    if len(case.face) == len(pitches) == 1 and circumference is not None and not _asks_otherwise(case):
        lay = Lay(name="spiral", lead=pitches[0])
    if lay.name == "spiral" and isinstance(layout, RectangularLayout) and lay.circumference is None:
        lay = replace(lay, circumference=circumference)
    return replace(layout, lay=lay)


def _asks_otherwise(case: Case) -> bool:
    """Whether a case says how its lay runs, or asks for what cannot follow a spiral."""
    table = case.stochastic if "stochastic" in case.methods else None
    return (
        "lay" in case.seal.model_fields_set
        or "auto" in case.methods
        or case.flow.discretisation != "edge"
        or (case.cells is not None and case.cells.flow == "elements")
        or (table is not None and (table.pressure != "uniform" or table.sampler not in (None, "history")))
    )


def groove_question(case: Case, scene: Scene) -> Iterator[str]:
    """Ask of a measured face with grooves along x2 whether they wind, and say what they would leak."""
    measured = all(isinstance(face, FileFace) for face in case.face)
    circumference = _circumference(case)
    if not measured or "lay" in case.seal.model_fields_set or circumference is None:
        return
    if not isinstance(case.layout, RectangularLayout | AnnularLayout) or (pitch := groove_pitch(scene.surface)) is None:
        return
    # lands are closed where half of the face is in contact, and grooves are about as deep as then
    depth = np.maximum(np.median(scene.surface.heights) - scene.surface.heights.mean(axis=1), 0.0)
    k = float(cubic_law(depth).mean()) * (pitch / circumference) ** 2
    try:
        leakage = scene.leakage(RectangularSeal(scene.surface.size, (1, 1)), k).per_length
    except NotConverged:
        return
    lead = to_text(pitch, "m", 2)
    yield (
        f"the face has grooves along x2, {lead} apart. Where they wind once around the seal, as turned ones do, they "
        f"leak about {leakage:.2g} m²/s per length past closed lands: is the face turned? Then set lay = {{kind = "
        f"'spiral', lead = '{lead}'}} in [seal], or 'x2' where they are rings"
    )


def groove_pitch(surface: Topography) -> float | None:
    """Distance of grooves along x2 [m] that are equally far apart; None where the face has none."""
    z = surface.heights - surface.heights.mean()
    profile = z.mean(axis=1)
    if not profile.var() > _GROOVED * z.var():
        return None
    n = profile.size
    power = np.abs(np.fft.rfft(profile - np.polyval(np.polyfit(np.arange(n), profile, 2), np.arange(n)))) ** 2
    power[:_LEAST_GROOVES] = 0.0
    waves = int(power.argmax())
    around = np.arange(waves - 1, min(waves + 2, power.size))
    near = power[around]
    if not near.sum() > _EVEN * power.sum() > 0:
        return None
    return surface.size[0] * float(near.sum()) / float(near @ around)


def _circumference(case: Case) -> float | None:
    """Length around the seal [m]; None of a face by itself."""
    layout, table = case.layout, case.stochastic
    if isinstance(layout, AnnularLayout):
        return layout.circumference
    return table.lengths[0] if table is not None and table.lengths else None
