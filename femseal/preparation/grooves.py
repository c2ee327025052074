"""Find grooves of a surface that run around the seal, as closed rings or as the spiral that a lathe cuts."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..base import to_text
from ..case.case import Case
from ..case.faces import FileFace, TurnedFace
from ..seal.lay import Lay
from ..seal.layouts import AnnularLayout, Layout, RectangularLayout
from ..topography import Surface, Topography

#: A surface has grooves along x2 if the mean profile has at least this fraction of the variance of the heights.
_GROOVED = 0.5
#: The grooves are equally spaced if waves near their wavelength have this fraction of the power of the mean profile.
_EVENLY_SPACED = 0.3
#: Smallest number of grooves on a surface.
_LEAST_GROOVES = 3


def layout_with_grooves(case: Case) -> Layout:
    """Return the shape of the seal with the lay of its grooves.

    The grooves of a single turned face that is generated form a spiral with its pitch as lead, unless the case gives
    the lay. On a strip, the circumference of a spiral is the length of the seal unless it is given.
    """
    layout, circumference, face = case.layout, _circumference(case), case.face[0]
    if not isinstance(layout, RectangularLayout | AnnularLayout):
        return layout
    lay = layout.lay
    is_single = len(case.face) == 1
    if is_single and isinstance(face, TurnedFace) and face.pitch < face.size[0]:
        lay_is_given = "lay" in case.seal.model_fields_set
        if circumference is not None and not lay_is_given:
            lay = Lay(name="spiral", lead=face.pitch)
    if lay.name == "spiral" and isinstance(layout, RectangularLayout) and lay.circumference is None:
        lay = replace(lay, circumference=circumference)
    return replace(layout, lay=lay)


def groove_warnings(case: Case, surface: Surface) -> Iterator[str]:
    """Warn that the grooves of a measured surface may be a spiral, unless the case gives the lay."""
    is_measured = all(isinstance(table, FileFace) for table in case.face)
    can_be_spiral = isinstance(case.layout, RectangularLayout | AnnularLayout)
    lay_is_given = "lay" in case.seal.model_fields_set
    if not is_measured or not can_be_spiral or lay_is_given or _circumference(case) is None:
        return
    pitch = groove_pitch(surface)
    if pitch is None:
        return
    lead = to_text(pitch, "m", 2)
    yield (
        f"The seal may leak much more than computed: the face has grooves along x2, {lead} apart, which leak past "
        "closed lands if they are a spiral, as those of turned faces. Is the face turned? Then set lay = "
        f"{{kind = 'spiral', lead = '{lead}'}} in [seal], or 'x2' if the grooves are rings"
    )


def groove_pitch(surface: Surface) -> float | None:
    """Find the distance of equally spaced grooves along x2 [m]; return None if the surface has none.

    With several patches it is the mean of their distances, or None if one of them has no such grooves.
    """
    if not isinstance(surface, Topography):
        pitches = [groove_pitch(patch) for patch in surface.patches]
        known = [pitch for pitch in pitches if pitch is not None]
        return float(np.mean(known)) if len(known) == len(pitches) else None
    profile = surface.heights.mean(axis=1)
    if not profile.var() > _GROOVED * surface.heights.var():
        return None
    n = np.arange(profile.size)
    level = profile - np.polyval(np.polyfit(n, profile, 2), n)
    power = np.abs(np.fft.rfft(level)) ** 2  # the index is the number of waves on the profile
    power[:_LEAST_GROOVES] = 0.0
    strongest = int(power.argmax())
    waves = np.arange(strongest - 1, min(strongest + 2, power.size))
    near = power[waves]
    if not near.sum() > _EVENLY_SPACED * power.sum() > 0:
        return None
    # the weighted mean of neighbouring waves resolves distances that do not divide the size of the surface
    mean_waves = float(near @ waves) / float(near.sum())
    return surface.size[0] / mean_waves


def _circumference(case: Case) -> float | None:
    """Return the length around the seal [m], or None if only the surface itself is solved."""
    if isinstance(case.layout, AnnularLayout):
        return case.layout.circumference
    return None if case.stochastic is None else case.stochastic.length
