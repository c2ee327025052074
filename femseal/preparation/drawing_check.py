"""Compare Ra and Rz of a generated surface, measured perpendicular to the machining marks, with the drawing."""

from __future__ import annotations

from collections.abc import Iterator

from ..base import to_text
from ..case.case import Case
from ..case.faces import Face, GeneratedFace, TurnedFace
from ..topography import Surface, Topography
from ..topography.profile_roughness import ProfileRoughness, profile_roughness

#: A warning is given if the relative difference from the value on the drawing is larger than this fraction. By the
#: rules for drawings, 16 % of the measured values may exceed the value on the drawing.
_TOLERANCE = 0.1
#: Relative scatter of the feed from which on a profile counts as irregular. Cases from drawings have 0.03 for turned
#: surfaces and 0.3 for ground ones.
_IRREGULAR = 0.15


def drawing_text(case: Case, surface: Surface) -> str:
    """Return Ra, Rz, Sq and rms slope of a generated surface as text; "" for other surfaces."""
    roughness = _roughness(case, surface)
    if roughness is None:
        return ""
    cut_off = "no long-wave filter"
    if roughness.cut_off > 0:
        cut_off = f"λc {to_text(roughness.cut_off, 'm', 3)}"
    values = {"Ra": roughness.ra, "Rz": roughness.rz, "Rq": roughness.rq}
    heights = ", ".join(f"{name} {to_text(value, 'm', 3)}" for name, value in values.items())
    sq = to_text(surface.rms_height, "m", 3)
    return (
        f"along x1 {heights} ({cut_off}), Sq {sq} with all waves, rms slope {surface.rms_slope:.3g}"
    )


def drawing_warnings(case: Case, surface: Surface) -> Iterator[str]:
    """Warn if the Ra or Rz of a generated surface differs from the Ra or Rz of the drawing in the case."""
    roughness = _roughness(case, surface)
    if roughness is None:
        return
    (face,) = case.face
    assert isinstance(face, GeneratedFace)
    for key, wanted, value in (("ra", face.ra, roughness.ra), ("rz", face.rz, roughness.rz)):
        if wanted is None or abs(value / wanted - 1) <= _TOLERANCE:
            continue
        name = key.capitalize()
        actual = to_text(value, "m", 3)
        stated = to_text(wanted, "m", 3)
        yield (
            f"The roughness of the surface differs from that on the drawing: its {name} is {actual}, the drawing "
            f"states {stated}. Multiply the heights of [face] (depth, roughness, rms_height, rms_slope) by "
            f"{wanted / value:.3g}"
        )


def _roughness(case: Case, surface: Surface) -> ProfileRoughness | None:
    """Return Ra and Rz of a surface with a single generated face that is not flat; None for any other surface."""
    if len(case.face) != 1 or not isinstance(surface, Topography) or not surface.rms_slope:
        return None
    (face,) = case.face
    if not isinstance(face, GeneratedFace):
        return None
    spacing = spacing_of_periodic_marks(face)
    return profile_roughness(surface, spacing, ra=face.ra, rz=face.rz)


def spacing_of_periodic_marks(face: Face) -> float | None:
    """Return the spacing [m] of the machining marks of a face, or None if the profile across the marks is irregular.

    The spacing determines the long-wave filter in the measurement of Ra and Rz. According to the standards, the filter
    for a periodic profile (for example of a turned face) depends on the spacing of the marks. For an irregular profile
    (for example of a ground face), the filter depends on the roughness.
    """
    if isinstance(face, TurnedFace) and face.feed_error < _IRREGULAR:
        return face.pitch
    return None
