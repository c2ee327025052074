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
#: The grooves count as equally spaced if waves near the spacing of the grooves have at least this fraction of the power
#: of the mean profile.
_EVENLY_SPACED = 0.3
#: Smallest number of grooves on a surface.
_LEAST_GROOVES = 3


def layout_with_grooves(case: Case) -> Layout:
    """Return the shape of the seal with the lay: the direction of the grooves of the surface on the seal.

    The lay in the case has priority. If the case does not contain the lay, and the only face is a generated turned
    face, the lay is a spiral whose lead is the pitch of the grooves. On a strip, the circumference of the spiral is the
    length of the seal, unless the case contains the circumference.
    """
    layout = case.layout
    if not isinstance(layout, RectangularLayout | AnnularLayout):
        return layout
    lay = layout.lay
    circumference = _circumference(case)
    lay_is_given = "lay" in case.seal.model_fields_set
    pitch = _pitch_of_turned_face(case)
    if pitch is not None and circumference is not None and not lay_is_given:
        lay = Lay(name="spiral", lead=pitch)
    is_strip = isinstance(layout, RectangularLayout)
    if lay.name == "spiral" and is_strip and lay.circumference is None:
        lay = replace(lay, circumference=circumference)
    return replace(layout, lay=lay)


def _pitch_of_turned_face(case: Case) -> float | None:
    """Return the pitch [m] of the grooves if the only face of the case is a generated turned face, otherwise None.

    None is also returned for a turned face that is narrower than one groove.
    """
    face = case.face[0]
    if len(case.face) > 1 or not isinstance(face, TurnedFace) or face.pitch >= face.size[0]:
        return None
    return face.pitch


def groove_warnings(case: Case, surface: Surface) -> Iterator[str]:
    """Warn that the grooves of a measured surface may form a spiral, unless the case gives the lay."""
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
        "closed lands if they are a spiral, as on turned faces. Is the face turned? Then set lay = "
        f"{{kind = 'spiral', lead = '{lead}'}} in [seal], or 'x2' if the grooves are rings"
    )


def groove_pitch(surface: Surface) -> float | None:
    """Return the spacing [m] of the grooves along x2 if the surface has equally spaced grooves, otherwise None.

    For a surface of several patches, the mean spacing is returned if all patches have equally spaced grooves, otherwise
    None.
    """
    if not isinstance(surface, Topography):
        pitches = [groove_pitch(patch) for patch in surface.patches]
        known = [pitch for pitch in pitches if pitch is not None]
        return float(np.mean(known)) if len(known) == len(pitches) else None
    profile = surface.heights.mean(axis=1)  # along x1
    if not profile.var() > _GROOVED * surface.heights.var():
        return None
    n = np.arange(profile.size)
    parabola = np.polyval(np.polyfit(n, profile, 2), n)
    level_profile = profile - parabola
    power = np.abs(np.fft.rfft(level_profile)) ** 2  # the index is the number of waves along x1
    power[:_LEAST_GROOVES] = 0.0
    # the wave number with the highest power, and its two neighbours
    strongest = int(power.argmax())
    period_counts = np.arange(strongest - 1, min(strongest + 2, power.size))
    peak_power = power[period_counts]
    least_peak_power = _EVENLY_SPACED * power.sum()
    is_evenly_spaced = peak_power.sum() > least_peak_power > 0
    if not is_evenly_spaced:
        return None
    # The number of grooves need not be an integer. The number is estimated by the weighted mean of the neighbouring
    # wave numbers.
    groove_count = float(peak_power @ period_counts) / float(peak_power.sum())
    return surface.size[0] / groove_count


def _circumference(case: Case) -> float | None:
    """Return the circumference of the seal [m], or None if the case only describes a surface and not a whole seal."""
    if isinstance(case.layout, AnnularLayout):
        return case.layout.circumference
    return None if case.stochastic is None else case.stochastic.length
