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

#: A surface has grooves along x2 if its mean profile along x1 has at least this fraction of the variance of the
#: heights.
_GROOVED = 0.5
#: The grooves are equally spaced if waves near their wavelength have at least this fraction of the power of this
#: profile.
_EVENLY_SPACED = 0.3
#: Smallest number of grooves on a surface.
_LEAST_GROOVES = 3


def layout_with_grooves(case: Case) -> Layout:
    """Return the shape of the seal, with the lay of the grooves of its surface.

    The grooves of a generated turned face form a spiral, whose lead is the pitch of the grooves. This does not apply if
    the case gives the lay or has two faces. The circumference of a spiral on a strip is the length of the seal, unless
    the case gives it.
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

    With several patches it is the mean over the patches, or None if one of them has no such grooves.
    """
    if not isinstance(surface, Topography):
        pitches = [groove_pitch(patch) for patch in surface.patches]
        known = [pitch for pitch in pitches if pitch is not None]
        return float(np.mean(known)) if len(known) == len(pitches) else None
    profile = surface.heights.mean(axis=1)  # along x1
    if not profile.var() > _GROOVED * surface.heights.var():
        return None
    n = np.arange(profile.size)
    level_profile = profile - np.polyval(np.polyfit(n, profile, 2), n)
    power = np.abs(np.fft.rfft(level_profile)) ** 2  # the index is the number of waves along x1
    power[:_LEAST_GROOVES] = 0.0
    strongest = int(power.argmax())
    wave_numbers = np.arange(strongest - 1, min(strongest + 2, power.size))
    peak_power = power[wave_numbers]
    if not peak_power.sum() > _EVENLY_SPACED * power.sum() > 0:
        return None
    # The number of grooves need not be an integer. The weighted mean of the neighbouring wave numbers estimates it.
    groove_count = float(peak_power @ wave_numbers) / float(peak_power.sum())
    return surface.size[0] / groove_count


def _circumference(case: Case) -> float | None:
    """Return the length around the seal [m], or None if only the surface itself is solved."""
    if isinstance(case.layout, AnnularLayout):
        return case.layout.circumference
    return None if case.stochastic is None else case.stochastic.length
