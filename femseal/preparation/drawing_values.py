"""Read what a drawing and a specification state about a seal, and ask the user for missing values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, pi
from typing import NamedTuple

from ..base import InputError, shown, to_si, to_text
from ..materials import METALS, VICKERS_PRESSURE, named_solid

#: Nominal pressure under the highest force, as a fraction of the hardness, if the force is not given.
_USUAL_PRESSURE = 0.3


class Question(NamedTuple):
    """A question about a drawing, and the value that is assumed if the user does not answer the question.

    Attributes
    ----------
    text : str
        The question.
    assumed : str
        The assumed value as text. The text is "" if the user must answer the question, or if the missing value is
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
    """Values from a drawing and a specification, with lengths in m, pressures in Pa and forces in N.

    Attributes
    ----------
    ra, rz : float or None
        Roughness Ra or Rz [m]. Exactly one of the two values is given.
    process, lay : str
        Machining process, one of `_PROCESSES`, and direction of the machining marks, one of `_LAYS`.
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
    def smallest_hardness(self) -> float:
        """Smallest hardness of the softer face and its plating [Pa], which the nominal pressure must not reach."""
        return _smallest_hardness(self.hardness, self.plating)

    @property
    def yields_in_plating(self) -> bool:
        """Whether the face has a plating that is softer than the metal below."""
        return self.smallest_hardness < self.hardness

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
    # at least two marks must lie side by side on the contact area
    if lengths["pitch"] > breadth / 2:
        expected = f"at most half the breadth of the contact area, {to_text(breadth / 2, 'm')}"
        raise InputError("--pitch", texts["pitch"], expected)
    metal = _metal_name("--metal", texts["metal"])
    hardness = _hardness("hardness", texts, metal)
    plating = _plating(texts)
    smallest_hardness = _smallest_hardness(hardness, plating)
    area = pi / 4 * (outer**2 - inner**2)
    if "force" in texts:
        force = _positive("force", texts["force"], "N")
    else:
        usual_force = _USUAL_PRESSURE * smallest_hardness * area
        force = float(f"{usual_force:.2g}")  # rounded to two digits
    if force >= smallest_hardness * area:
        given = f"{texts['force']}, which is {to_text(force / area, 'Pa', 3)} of nominal pressure"
        whose = " of the plating" if smallest_hardness < hardness else ""
        expected = f"less than the hardness{whose}, {to_text(smallest_hardness, 'Pa', 3)}"
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


def _smallest_hardness(hardness: float, plating: Plating | None) -> float:
    """Return the smaller hardness [Pa] of a face and its plating, if it has one."""
    return hardness if plating is None else min(hardness, plating.hardness)


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

    The user gives a pressure with a unit, or a Vickers hardness such as "45 HV".

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
