"""Write a case from the values of a drawing: roughness, machining marks, diameters, material, force and fluid.

The heights of the generated surface are scaled, so that the surface has the Ra or Rz of the drawing. The surface is as
wide as the seal. With equal widths, the cells of the seal have the same order as on the surface. The length of the
surface is at least 24 times the spacing of the machining marks. docs/evidence/drawing.md shows that longer surfaces
have nearly the same leakage.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import scipy.fft

from ..base import number_text, to_text
from ..base.leak_classes import find_leak_classes
from ..base.leak_units import LEAK_UNITS
from ..case.case import Case
from ..case.reading import parse_case
from ..case.template import as_toml
from ..materials import VICKERS_PRESSURE, named_solid
from ..studies.study_list import STOCHASTIC
from ..topography.profile_roughness import profile_roughness
from .drawing_check import spacing_of_periodic_marks
from .drawing_values import Drawing, Plating
from .surface import condition_surface

#: Ratio Rz/Ra from which the heights of the surface are estimated before they are scaled.
_RZ_OVER_RA = 5.0
#: Largest width of a generated surface, as a multiple of the spacing of the machining marks. Up to this width, the
#: surface is as wide as the seal. For a wider seal, a surface with half the largest width is generated.
MOST_ACROSS = 32
#: Smallest length of the surface, as a multiple of the spacing of the marks. The surface is also at least as long as
#: its width.
LEAST_ALONG = 24
#: Total number of points of the surface for the first result.
_FIRST_POINTS = 2e5
#: Largest and smallest number of points per spacing of the marks.
_MOST_PER_SPACING, _FEWEST_PER_SPACING = 32, 16
#: Forces of assembly and of unloading, as fractions of the highest force.
_LOADING = (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.65, 0.8, 1.0)
_UNLOADING = (0.6, 0.3)


class _SurfaceSize(NamedTuple):
    """Size of a generated surface and its numbers of points.

    Attributes
    ----------
    points, better_points : (int, int)
        Numbers of points along x1 and x2: `points` for a quick first result, `better_points` for a more accurate
        result.
    size : (float, float)
        Lengths along x1 and x2 [m].
    breadth : float or None
        Width of the seal [m]; None if the surface is as wide as the seal.
    """

    points: tuple[int, int]
    better_points: tuple[int, int]
    size: tuple[float, float]
    breadth: float | None


def _surface_size(drawing: Drawing) -> _SurfaceSize:
    """Choose the size of the generated surface and its numbers of points along x1 and x2."""
    # width (along x1) and length (along x2) of the surface, in spacings of the machining marks
    spacings_x1 = drawing.breadth / drawing.pitch
    breadth = None
    if spacings_x1 > MOST_ACROSS:
        spacings_x1 = float(MOST_ACROSS // 2)
        breadth = drawing.breadth
    spacings_x2 = max(LEAST_ALONG, round(spacings_x1))
    # number of points per spacing along each axis, so that the surface has about `_FIRST_POINTS` points
    per_spacing = sqrt(_FIRST_POINTS / (spacings_x1 * spacings_x2))
    per_spacing = min(max(per_spacing, _FEWEST_PER_SPACING), _MOST_PER_SPACING)

    def points(per_spacing: float) -> tuple[int, int]:
        """Return the numbers of points along x1 and x2 for a number of points per spacing."""
        return _fast_length(spacings_x1 * per_spacing), _fast_length(spacings_x2 * per_spacing)

    size = (spacings_x1 * drawing.pitch, spacings_x2 * drawing.pitch)
    return _SurfaceSize(
        points=points(per_spacing),
        better_points=points(2 * per_spacing),
        size=size,
        breadth=breadth,
    )


def _fast_length(points: float) -> int:
    """Return an even number, about equal to `points` or a little larger, for which Fourier transforms are fast."""
    return 2 * int(scipy.fft.next_fast_len(round(points / 2), real=True))


def _face_keys(drawing: Drawing, scale: float) -> dict[str, Any]:
    """Return the keys of [face] that describe the heights of the surface.

    The returned heights are in proportions typical of the machining process. All heights are roughly estimated from the
    Ra or Rz of the drawing, and then multiplied by `scale`. The function `case_of_drawing` chooses `scale` so that the
    surface has the Ra or Rz of the drawing.
    """
    # estimate of Rz; the factors below are typical ratios of each height to Rz for the machining process
    height = drawing.rz or _RZ_OVER_RA * (drawing.ra or 0.0)

    def length(value: float) -> str:
        return to_text(value, "m", 4)

    if drawing.process in ("turned", "ground"):
        is_turned = drawing.process == "turned"
        return {
            "kind": "turned",
            "pitch": length(drawing.pitch),
            "depth": length(0.7 * height * scale),
            "feed_error": 0.03 if is_turned else 0.3,
            "depth_error": 0.1 if is_turned else 0.5,
            "roughness": length(0.1 * height * scale),
            "roughness_roll_off": length(0.6 * drawing.pitch),
        }
    return {
        "kind": "self-affine",
        "rms_height": length(height / _RZ_OVER_RA * 1.25 * scale),
        "roll_off": length(drawing.pitch),
    }


def case_of_drawing(drawing: Drawing) -> str:
    """Return the text of a case from the values of a drawing; the case can be run without changes.

    Parameters
    ----------
    drawing : Drawing
        Values of the drawing.

    Returns
    -------
    str
        Text of the case file.

    Raises
    ------
    InputError
        A value of the drawing is not allowed in a case.
    """
    size = _surface_size(drawing)
    scale = 1.0
    # The first pass scales the estimated heights; the second pass corrects the effect of rounding and filters.
    for _ in range(2):
        case = parse_case(_tables(drawing, size, scale))
        scale *= _scale_to_drawing(drawing, case)
    return _text(drawing, size, _tables(drawing, size, scale))


def _scale_to_drawing(drawing: Drawing, case: Case) -> float:
    """Return the factor by which the heights must be multiplied to obtain the Ra or Rz of the drawing."""
    surface = condition_surface(case).surface.shortest_patch
    spacing = spacing_of_periodic_marks(case.face[0])
    roughness = profile_roughness(surface, spacing, ra=drawing.ra, rz=drawing.rz)
    if drawing.ra is not None:
        return drawing.ra / roughness.ra
    assert drawing.rz is not None
    return drawing.rz / roughness.rz


def _tables(drawing: Drawing, size: _SurfaceSize, scale: float) -> dict[str, Any]:
    """Return the tables of the case, as nested dictionaries of texts and numbers.

    Parameters
    ----------
    drawing : Drawing
        Values of the drawing.
    size : _SurfaceSize
        Size of the generated surface.
    scale : float
        Factor by which the estimated heights of the surface are multiplied.
    """
    face: dict[str, Any] = _face_keys(drawing, scale)
    face["points"] = list(size.points)
    face["size"] = [to_text(side, "m", 6) for side in size.size]
    if drawing.ra is not None:
        face["ra"] = to_text(drawing.ra, "m", 6)
    if drawing.rz is not None:
        face["rz"] = to_text(drawing.rz, "m", 6)
    stochastic = {"length": to_text(drawing.length, "m", 5)}
    if size.breadth is not None:
        stochastic["breadth"] = to_text(size.breadth, "m", 5)
    lay: Any = {"circular": "x2", "radial": "x1"}.get(drawing.lay)
    if lay is None:
        lay = {"kind": "spiral", "lead": to_text(drawing.pitch, "m", 5)}
    material: dict[str, Any] = {
        "name": drawing.metal,
        "hardness": to_text(drawing.hardness, "Pa", 3),
    }
    if drawing.plating is not None:
        material["coating"] = _coating(drawing.plating, "plating_hardness" in drawing.assumed)
    tables: dict[str, Any] = {
        "title": "Seal from a drawing",
        "method": STOCHASTIC.name,
        "seed": 1,
        "face": face,
        "material": material,
        "counter_material": {"young": "210 GPa", "poisson": 0.3},
        "load": {
            "loading": [_force(drawing.force * fraction) for fraction in _LOADING],
            "unload_from": [_force(drawing.force)],
            "unloading": [_force(drawing.force * fraction) for fraction in _UNLOADING],
        },
        "fluid": {
            "name": drawing.fluid,
            "inlet_pressure": drawing.inlet,
            "outlet_pressure": drawing.outlet,
        },
        "seal": {"lay": lay},
        STOCHASTIC.table: stochastic,
    }
    if drawing.limit:
        tables["output"] = {"classes": [drawing.limit]}
        unit = LEAK_UNITS[find_leak_classes([drawing.limit])[0].unit]
        if not unit.per_length:
            tables["output"]["leakage_unit"] = unit.name
    return tables


def _coating(plating: Plating, hardness_is_typical: bool) -> dict[str, Any]:
    """Return the table `coating` of a case for a plated face.

    The table contains the name of the metal only if the hardness is typical of this metal. Platings are often much
    harder, and a case with a hardness that is not typical of the named metal leads to a warning.
    """
    thickness = to_text(plating.thickness, "m", 5)
    hardness = to_text(plating.hardness, "Pa", 3)
    if hardness_is_typical:
        return {"name": plating.metal, "thickness": thickness, "hardness": hardness}
    solid = named_solid(plating.metal)
    return {
        "thickness": thickness,
        "young": to_text(solid.young, "Pa", 3),
        "poisson": solid.poisson,
        "hardness": hardness,
    }


def _force(value: float) -> str:
    """Return a force as text with its unit."""
    return to_text(value, "N", 4)


def _text(drawing: Drawing, size: _SurfaceSize, tables: dict[str, Any]) -> str:
    """Return the tables as TOML text, with comments that explain the keys and say which values are assumed."""
    comments = _comments(drawing, size)
    lines = [
        f"# A case from a drawing: {drawing.process}, {_stated_roughness(drawing)}, ring of "
        f"{to_text(drawing.inner_diameter, 'm')} to {to_text(drawing.outer_diameter, 'm')}.",
        "# x1 is the direction of the leakage, x2 runs along the seal. 'assumed' marks what the drawing does not say.",
        "# First `femseal check` this file, then `femseal run` it: the first result takes about a minute.",
        "",
    ]
    for name, value in tables.items():
        if not isinstance(value, dict):
            lines.append(f"{name} = {as_toml(value)}")
            continue
        lines += ["", f"[{name}]"]
        for key, key_value in value.items():
            text = f"{key} = {as_toml(key_value)}"
            comment = comments.get((name, key), "")
            lines.append(f"{text:<48}  # {comment}" if comment else text)
    return "\n".join(lines) + "\n"


def _stated_roughness(drawing: Drawing) -> str:
    """Return the Ra or Rz of the drawing as text."""
    if drawing.ra is not None:
        return f"Ra {to_text(drawing.ra, 'm')}"
    assert drawing.rz is not None
    return f"Rz {to_text(drawing.rz, 'm')}"


def _process_comment(drawing: Drawing) -> str:
    """Return a comment for the key `kind` of the generated surface, or "" if no comment is needed."""
    if drawing.process == "turned":
        return "assumed" if "process" in drawing.assumed else ""
    if drawing.process == "ground":
        return "ground: irregular grooves"
    return f"{drawing.process}: isotropic"


def _vickers_text(hardness: float) -> str:
    """Return a hardness [Pa] as Vickers hardness, such as "45 HV"."""
    return f"{number_text(hardness / VICKERS_PRESSURE, 2)} HV"


def _comments(drawing: Drawing, size: _SurfaceSize) -> dict[tuple[str, str], str]:
    """Return the comments on keys of the case, by the pair (name of the table, name of the key)."""

    def assumed(*names: str) -> str:
        """Return "assumed: " if at least one of the values with the given names was assumed, and "" otherwise."""
        return "assumed: " if drawing.assumed & set(names) else ""

    better_points = as_toml(list(size.better_points))
    area = drawing.breadth * drawing.length
    pressure = drawing.force / area
    pressure_text = to_text(pressure, "Pa", 3)
    fraction = f"{100 * pressure / drawing.smallest_hardness:.2g} %"
    vickers = _vickers_text(drawing.hardness)
    scaled = "scaled so that the surface has the roughness of the drawing"
    compared = "as on the drawing; `femseal check` compares the surface with it"
    size_comment = "as wide as the contact area, and at least 24 spacings long"
    if size.breadth is not None:
        size_comment = "a part of the contact area"
    lay_comment = f"{assumed('lay')}{drawing.lay}"
    if drawing.process not in ("turned", "ground"):
        lay_comment = "without effect, because the surface is isotropic"
    points_comment = f"for the first result; {better_points} is more accurate, but takes four to six times as long"
    hardness_comment = f"{assumed('hardness')}{vickers}; measure it on the machined face"
    force_comment = f"{assumed('force')}{pressure_text}, {fraction} of the hardness"
    coating_comment = ""
    if drawing.plating is not None:
        hardness_comment = f"{assumed('hardness')}{vickers}, below the plating"
        if drawing.yields_in_plating:
            force_comment += " of the plating"
        plating_vickers = _vickers_text(drawing.plating.hardness)
        metal = drawing.plating.metal.partition(",")[0]
        coating_comment = f"{metal}, {assumed('plating_hardness')}{plating_vickers}"
    length_comment = f"{assumed('inner_diameter', 'outer_diameter')}mean circumference of the ring"
    return {
        ("face", "points"): points_comment,
        ("face", "size"): size_comment,
        ("face", "kind"): _process_comment(drawing),
        ("face", "pitch"): f"{assumed('pitch')}feed per revolution, or spacing of the marks",
        ("face", "roll_off"): f"{assumed('pitch')}spacing of the marks",
        ("face", "depth"): scaled,
        ("face", "rms_height"): scaled,
        ("face", "roughness"): "between the marks, a seventh of their depth",
        ("face", "feed_error"): "scatter from mark to mark, which no drawing states",
        ("face", "ra"): compared,
        ("face", "rz"): compared,
        (
            "material",
            "name",
        ): f"{assumed('metal')}gives Young's modulus, Poisson's ratio and yield stress",
        ("material", "hardness"): hardness_comment,
        ("material", "coating"): coating_comment,
        ("counter_material", "young"): "assumed: steel, harder than the other face",
        ("load", "unload_from"): force_comment,
        ("fluid", "name"): "assumed" if "fluid" in drawing.assumed else "",
        ("fluid", "inlet_pressure"): f"{assumed('inlet')}absolute pressure",
        ("fluid", "outlet_pressure"): f"{assumed('outlet')}absolute pressure",
        ("seal", "lay"): lay_comment,
        (STOCHASTIC.table, "length"): length_comment,
    }
