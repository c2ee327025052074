"""Write a case from the values of a drawing: roughness, machining marks, diameters, material, force and fluid.

The heights of the generated surface are scaled, so that the surface has the Ra or Rz of the drawing. The surface is as
wide as the seal. With equal widths, the cells of the seal have the same order as on the surface. The length of the
surface is at least 24 times the spacing of the machining marks. docs/evidence/drawing.md shows that the leakage of
longer surfaces differs little.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi, sqrt
from typing import Any, NamedTuple

import scipy.fft

from ..base import InputError, number_text, shown, to_si, to_text
from ..base.leak_rates import leak_classes
from ..base.leak_units import LEAK_UNITS
from ..case.case import Case
from ..case.reading import parse_case
from ..case.template import as_toml
from ..materials import METALS, VICKERS_PRESSURE, named_solid
from ..topography.profile_roughness import profile_roughness
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
#: Nominal pressure under the highest force, as a fraction of the hardness, if the force is not given.
_USUAL_PRESSURE = 0.3


class Question(NamedTuple):
    """Hold a question about a drawing, and the value that is assumed if the user does not answer the question.

    Attributes
    ----------
    text : str
        The question.
    assumed : str
        The assumed value as text. The text is "" if the user must answer the question, and also if the missing value is
        derived from other answers.
    """

    text: str
    assumed: str = ""


#: Questions by the name of the option on the command line, in the order in which they are asked.
QUESTIONS = {
    "ra": Question("Ra on the drawing, such as 1.6 um (empty if it states Rz)"),
    "rz": Question("Rz on the drawing, such as 8 um"),
    "process": Question("process: turned, ground, lapped or blasted", "turned"),
    "pitch": Question("feed per revolution, or mean spacing RSm of the marks, such as 0.15 mm"),
    "lay": Question("lay of the marks: circular, radial or spiral", "circular"),
    "inner_diameter": Question("inner diameter of the contact area", "50 mm"),
    "outer_diameter": Question("outer diameter of the contact area", "54 mm"),
    "metal": Question(
        f"metal of the softer or plated face, one of {'; '.join(METALS)}", "copper, soft"
    ),
    "hardness": Question("its hardness, such as 0.5 GPa or 45 HV (empty: typical)"),
    "plating": Question("metal of a plating on it, such as 'silver, annealed' (empty: none)"),
    "plating_thickness": Question("thickness of the plating, such as 20 um"),
    "plating_hardness": Question("hardness of the plating, such as 60 HV (empty: typical)"),
    "force": Question("highest force of the assembly, such as 80 kN (empty: 0.3 of the hardness)"),
    "fluid": Question("fluid", "helium"),
    "inlet": Question("absolute pressure at the inlet", "2 bar"),
    "outlet": Question("absolute pressure at the outlet", "1 bar"),
    "limit": Question("leakage class or largest leakage, such as '1e-3 mbar·L/s' (empty: none)"),
}
#: Spacing of the marks that is assumed for processes without a feed.
_USUAL_SPACING = {"ground": "60 um", "lapped": "40 um", "blasted": "100 um"}
_PROCESSES = ("turned", *_USUAL_SPACING)
_LAYS = ("circular", "radial", "spiral")


@dataclass(frozen=True)
class Plating:
    """Plating of the softer face: its metal, a name of `METALS`, its thickness [m], and its hardness [Pa]."""

    metal: str
    thickness: float
    hardness: float


@dataclass(frozen=True)
class Drawing:
    """Hold the values from a drawing and a specification, with lengths in m, pressures in Pa and forces in N.

    Attributes
    ----------
    ra, rz : float or None
        Roughness Ra or Rz [m]. Exactly one of the two values is given.
    process, lay : str
        Process that made the surface, one of `_PROCESSES`; direction of the machining marks, one of `_LAYS`.
    pitch : float
        Feed per revolution, or mean spacing of the machining marks [m].
    inner_diameter, outer_diameter : float
        Inner and outer diameter of the contact area [m].
    metal : str
        Metal of the softer face, a name of `METALS`.
    hardness, force : float
        Hardness of the softer face, below its plating [Pa], and highest force of the assembly [N].
    plating : Plating or None
        Plating of the softer face, if it has one.
    fluid, inlet, outlet : str
        Name of the fluid, and absolute pressures at inlet and outlet, as texts for the case file.
    limit : str
        Leakage class or largest allowed leakage; "" if the leakage is not limited.
    assumed : frozenset of str
        Names of the values that the user has not given and that were therefore assumed.
    """

    ra: float | None
    rz: float | None
    process: str
    pitch: float
    lay: str
    inner_diameter: float
    outer_diameter: float
    metal: str
    hardness: float
    plating: Plating | None
    force: float
    fluid: str
    inlet: str
    outlet: str
    limit: str
    assumed: frozenset[str]

    @property
    def surface_hardness(self) -> float:
        """Hardness at the surface of the softer face [Pa], which is the hardness of the plating if the face has one."""
        return self.hardness if self.plating is None else self.plating.hardness

    @property
    def breadth(self) -> float:
        """Width of the contact area along the radius [m]."""
        return (self.outer_diameter - self.inner_diameter) / 2

    @property
    def length(self) -> float:
        """Mean circumference of the contact area [m]."""
        return pi * (self.outer_diameter + self.inner_diameter) / 2


def read_drawing(given: Mapping[str, str | None], ask: Callable[[str, str], str] | None) -> Drawing:
    """Read the values of a drawing from texts, and ask the user for missing values.

    Parameters
    ----------
    given : mapping
        Text of each value; the keys are the keys of `QUESTIONS`. A missing value is None.
    ask : callable or None
        Function that asks the user; `ask(question, assumption)` returns the answer. If `ask` is None, the user is not
        asked.

    Raises
    ------
    InputError
        A value cannot be read, or the roughness or the feed per revolution is missing.
    """
    texts = {name: text.strip() for name, text in given.items() if text and text.strip()}
    if ask is not None:
        for name, question in QUESTIONS.items():
            if not _needs_answer(name, texts):
                continue
            assumed = question.assumed
            if name == "pitch":
                assumed = _USUAL_SPACING.get(texts.get("process", "turned"), "")
            answer = ask(question.text, assumed).strip()
            if answer:
                texts[name] = answer
    assumed_names = frozenset(QUESTIONS.keys() - texts.keys())
    for name, question in QUESTIONS.items():
        if question.assumed:
            texts.setdefault(name, question.assumed)
    return _drawing_of_texts(texts, assumed_names)


def _needs_answer(name: str, texts: dict[str, str]) -> bool:
    """Return whether the user should be asked for a value.

    texts : texts of the values that the user has already given.
    """
    if name in texts:
        return False
    if name in ("ra", "rz"):  # one of them is enough
        return not ("ra" in texts or "rz" in texts)
    if name == "lay":  # isotropic surfaces have none
        return texts.get("process") not in ("lapped", "blasted")
    if name in ("plating_thickness", "plating_hardness"):
        return "plating" in texts
    return True


def _drawing_of_texts(texts: dict[str, str], assumed: frozenset[str]) -> Drawing:
    """Convert the values of a drawing from texts to SI units, and check them.

    texts : text of each value; the keys are the keys of `QUESTIONS`.
    assumed : names of the values that are assumed.
    """
    process = _one_of("--process", texts["process"], _PROCESSES)
    lay = _one_of("--lay", texts["lay"], _LAYS)
    if ("ra" in texts) == ("rz" in texts):
        given = "both" if "ra" in texts else "neither Ra nor Rz"
        raise InputError("--ra, --rz", given, "one of the two options, such as --ra 1.6um")
    if process != "turned":
        texts.setdefault("pitch", _USUAL_SPACING[process])
    if "pitch" not in texts:
        raise InputError("--pitch", "nothing", "the feed per revolution, such as 0.15mm")
    lengths = {
        name: _positive(name, texts[name], "m")
        for name in ("ra", "rz", "pitch", "inner_diameter", "outer_diameter")
        if name in texts
    }
    inner, outer = lengths["inner_diameter"], lengths["outer_diameter"]
    if not inner < outer:
        expected = f"more than the inner diameter of {to_text(inner, 'm')}"
        raise InputError("--outer-diameter", texts["outer_diameter"], expected)
    breadth = (outer - inner) / 2
    if (
        lengths["pitch"] > breadth / 2
    ):  # at least two marks must lie side by side on the contact area
        expected = f"at most half the breadth of the contact area, {to_text(breadth / 2, 'm')}"
        raise InputError("--pitch", texts["pitch"], expected)
    metal = _metal_name("--metal", texts["metal"])
    hardness = _hardness("hardness", texts, metal)
    plating = _plating(texts)
    surface_hardness = hardness if plating is None else plating.hardness
    area = pi / 4 * (outer**2 - inner**2)
    if "force" in texts:
        force = _positive("force", texts["force"], "N")
    else:
        usual_force = _USUAL_PRESSURE * surface_hardness * area
        force = float(f"{usual_force:.2g}")  # rounded to two digits
    if force >= surface_hardness * area:
        given = f"{texts['force']}, which is {to_text(force / area, 'Pa', 3)} of nominal pressure"
        whose = "" if plating is None else " of the plating"
        expected = f"less than the hardness{whose}, {to_text(surface_hardness, 'Pa', 3)}"
        raise InputError("--force", given, expected)
    return Drawing(
        ra=lengths.get("ra"),
        rz=lengths.get("rz"),
        process=process,
        pitch=lengths["pitch"],
        lay=lay,
        inner_diameter=inner,
        outer_diameter=outer,
        metal=metal,
        hardness=hardness,
        plating=plating,
        force=force,
        fluid=texts["fluid"],
        inlet=texts["inlet"],
        outlet=texts["outlet"],
        limit=texts.get("limit", ""),
        assumed=assumed,
    )


def _one_of(name: str, text: str, choices: tuple[str, ...]) -> str:
    """Return a text in lower case; raise InputError unless the text is one of the allowed choices."""
    if text.lower() not in choices:
        raise InputError(name, shown(text), f"one of {', '.join(choices)}")
    return text.lower()


def _plating(texts: dict[str, str]) -> Plating | None:
    """Return the plating of the softer face, or None if there is none; see `_drawing_of_texts`."""
    if "plating" not in texts:
        for name in ("plating_thickness", "plating_hardness"):
            if name in texts:
                expected = (
                    f"the metal of the plating, such as 'silver, annealed', with {_option(name)}"
                )
                raise InputError("--plating", "nothing", expected)
        return None
    metal = _metal_name("--plating", texts["plating"])
    if "plating_thickness" not in texts:
        raise InputError("--plating-thickness", "nothing", "the thickness, such as 20um")
    thickness = _positive("plating_thickness", texts["plating_thickness"], "m")
    return Plating(metal, thickness, _hardness("plating_hardness", texts, metal))


def _metal_name(option: str, text: str) -> str:
    """Return the name of a metal as `METALS` spells it; raise InputError if the metal is unknown."""
    try:
        solid = named_solid(text)
    except InputError as error:
        raise InputError(option, error.given, error.expected) from None
    return next(name for name, (known, _) in METALS.items() if known is solid)


def _option(name: str) -> str:
    """Return the option on the command line for a name of `QUESTIONS`."""
    return f"--{name.replace('_', '-')}"


def _positive(name: str, text: str, unit: str) -> float:
    """Convert a text with a unit to a value in SI units; raise InputError unless the value is > 0."""
    option = _option(name)
    value = to_si(text, unit, option)
    if not value > 0:
        raise InputError(option, shown(text), f"a value > 0 in {unit}")
    return value


def _hardness(name: str, texts: dict[str, str], metal: str) -> float:
    """Return a hardness [Pa], or the typical hardness of a metal if the user gave none.

    The text of the user is a pressure with a unit, or a Vickers hardness such as "45 HV".

    name : key of the hardness in `texts`.
    """
    if name not in texts:
        solid = named_solid(metal)
        assert solid.hardness is not None
        return solid.hardness
    text = texts[name]
    number, is_vickers, _ = text.upper().partition("HV")
    if not is_vickers:
        return _positive(name, text, "Pa")
    try:
        vickers = float(number)
    except ValueError:
        vickers = 0.0
    if not 0 < vickers < inf:
        raise InputError(_option(name), shown(text), "such as '45 HV' or '0.5 GPa'")
    return vickers * VICKERS_PRESSURE


class _SurfaceSize(NamedTuple):
    """Hold the size of a generated surface and its numbers of points.

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

    The ratios of the returned values to each other are typical of the machining process. All heights are roughly
    estimated from the Ra or Rz of the drawing, and then multiplied by `scale`. The function `case_of_drawing` chooses
    `scale` so that the surface has the Ra or Rz of the drawing.
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
    spacing = drawing.pitch if drawing.process in ("turned", "ground") else None
    roughness = profile_roughness(surface, spacing)
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
        material["coating"] = {
            "name": drawing.plating.metal,
            "thickness": to_text(drawing.plating.thickness, "m", 5),
            "hardness": to_text(drawing.plating.hardness, "Pa", 3),
        }
    tables: dict[str, Any] = {
        "title": "Seal from a drawing",
        "method": "stochastic",
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
        "stochastic": stochastic,
    }
    if drawing.limit:
        tables["output"] = {"classes": [drawing.limit]}
        unit = LEAK_UNITS[leak_classes([drawing.limit])[0].unit]
        if not unit.per_length:
            tables["output"]["leakage_unit"] = unit.name
    return tables


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
    fraction = f"{100 * pressure / drawing.surface_hardness:.2g} %"
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
        force_comment += " of the plating"
        plating_vickers = _vickers_text(drawing.plating.hardness)
        coating_comment = (
            f"{assumed('plating_hardness')}{plating_vickers}; measure it on the plating"
        )
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
        ("stochastic", "length"): length_comment,
    }
