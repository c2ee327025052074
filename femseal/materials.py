"""Describe elastic-plastic solids, and list ten metals that are used for seals.

Symbols: E Young's modulus, ν Poisson's ratio, E* contact modulus, σ_y yield stress, H hardness.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from math import inf, nan, sqrt

from .base import InputError, shown, validate

#: Ratio of hardness to yield stress, for a fully plastic indentation (Johnson, Contact Mechanics, 1985, ch. 6).
HARDNESS_FACTOR = 2.8
#: Ratio of peak pressure to yield stress at which the solid below a line contact begins to yield, by the criterion of
#: von Mises for ν = 0.3. Yielding begins at a depth of 0.7 times the half-width of the contact (Johnson 1985, section
#: 6.1).
LINE_CONTACT_YIELD = 1.79
#: Ratio of mean pressure to yield stress at which a ring between two smooth flat faces yields as a whole. The ratio
#: 2/√3 is the yield pressure in plane strain by the criterion of von Mises; friction at the faces only raises the yield
#: pressure.
RING_YIELD = 2 / sqrt(3)
#: Mean contact pressure of an indentation of 1 HV [Pa]. The Vickers hardness is the force divided by the area of the
#: faces of the pyramid, 1 kgf/mm²; the contact pressure refers to the projected area, which is sin 68° = 0.9272 of the
#: area of the faces.
VICKERS_PRESSURE = 9.80665e6 / 0.9272
#: Range of the Young's moduli of metals and hard coatings [Pa].
YOUNG_LIMITS = (5e9, 1.2e12)


@dataclass(frozen=True)
class Solid:
    """Describe a linear elastic, perfectly plastic solid.

    A solid without `yield_stress` and `hardness` is purely elastic and has an infinite hardness.

    Parameters
    ----------
    young : float
        Young's modulus E [Pa], > 0.
    poisson : float
        Poisson's ratio ν [-], -1 < ν <= 0.5.
    yield_stress : float, optional
        Yield stress σ_y [Pa], from which the hardness H = `hardness_over_yield` · σ_y is computed.
    hardness : float, optional
        Hardness H [Pa], which is the largest contact pressure. Either the hardness or the yield stress can be given.
        The attribute `hardness` also contains a hardness that follows from the yield stress. To change the yield stress
        of a solid, use `dataclasses.replace(solid, yield_stress=..., hardness=None)`.
    hardness_over_yield : float
        Ratio H/σ_y > 0 of hardness to yield stress, 2.8 by default. The ratio that agrees best with von Mises
        plasticity depends on the roughness, see `docs/evidence/plastic_law.md`.

    Raises
    ------
    InputError
        A value is outside its range, or both `yield_stress` and `hardness` are given.

    Examples
    --------
    >>> Solid(young=210e9, poisson=0.3, yield_stress=500e6).hardness
    1400000000.0
    """

    young: float
    poisson: float
    yield_stress: float | None = None
    hardness: float | None = None
    hardness_over_yield: float = HARDNESS_FACTOR

    def __post_init__(self) -> None:
        validate.number("young", self.young, unit="Pa")
        _check_poisson(self.poisson)
        ratio = validate.number("hardness_over_yield", self.hardness_over_yield)
        if self.yield_stress is not None:
            yield_stress = validate.number("yield_stress", self.yield_stress, unit="Pa")
            hardness = ratio * yield_stress
            # `dataclasses.replace` passes the hardness that follows from the yield stress
            if self.hardness not in (None, hardness):
                expected = (
                    "yield_stress or hardness, not both; in dataclasses.replace, a new yield_stress "
                    "together with hardness=None"
                )
                raise InputError("hardness", shown(self.hardness), expected)
        elif self.hardness is None or (isinstance(self.hardness, float) and self.hardness == inf):
            hardness = inf
        else:
            hardness = validate.number("hardness", self.hardness, unit="Pa")
        object.__setattr__(self, "hardness", hardness)

    @property
    def plane_modulus(self) -> float:
        """Plane-strain modulus E/(1 − ν²) [Pa]."""
        return self.young / (1 - self.poisson**2)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E/(2(1 + ν)) [Pa]."""
        return self.young / (2 * (1 + self.poisson))


def _check_poisson(poisson: object) -> None:
    """Raise InputError if a Poisson's ratio is not a number above -1 and at most 0.5."""
    try:
        value = validate.number("poisson", poisson, above=-1.0)
    except InputError:
        value = nan
    if not value <= 0.5:
        raise InputError("poisson", shown(poisson), "a number in (-1, 0.5]")


@dataclass(frozen=True)
class Coated:
    """Describe a body with a coating, or a thin body: an elastic layer that is bonded to a thick substrate.

    Parameters
    ----------
    substrate : Solid or None
        Solid below the layer, which must be much thicker than the longest wavelength of the surface. None stands for a
        rigid substrate: the body is a plate of the layer material on a rigid bed.
    layer : Solid
        Material of the layer, which carries the rough surface.
    thickness : float
        Thickness d of the layer [m], > 0.

    Raises
    ------
    InputError
        A body is not a `Solid`, or the thickness is not > 0.

    Notes
    -----
    The elastic constants of both solids determine the compliance, see `femseal.contact.layered`. The yielding of a
    coated body is described by the contact law `CoatedLaw`.

    Examples
    --------
    >>> steel, silver = named_solid("steel 304/316, annealed"), named_solid("silver, annealed")
    >>> Coated(steel, silver, 20e-6).thickness
    2e-05
    """

    substrate: Solid | None
    layer: Solid
    thickness: float

    def __post_init__(self) -> None:
        if not (self.substrate is None or isinstance(self.substrate, Solid)):
            expected = "a Solid, or None for a rigid one; of several layers, only one can be given"
            raise InputError("substrate", shown(type(self.substrate).__name__), expected)
        if not isinstance(self.layer, Solid):
            raise InputError("layer", shown(type(self.layer).__name__), "a Solid")
        thickness = validate.number("thickness", self.thickness, unit="m")
        object.__setattr__(self, "thickness", thickness)


def contact_modulus(a: Solid, b: Solid | None = None) -> float:
    """Compute the contact modulus E* of two half-spaces, 1/E* = (1−ν1²)/E1 + (1−ν2²)/E2.

    The lubrication literature often uses E′ = 2E* instead; femseal always uses E*. Source: Johnson, Contact Mechanics,
    1985, eq. 4.20.

    Parameters
    ----------
    a : Solid
        First solid.
    b : Solid, optional
        Second solid; by default, the second body is rigid.

    Returns
    -------
    float
        Contact modulus E* [Pa].

    Examples
    --------
    >>> steel = Solid(210e9, 0.3)
    >>> round(contact_modulus(steel, steel) / 1e9, 2)
    115.38
    """
    if isinstance(a, Coated) or isinstance(b, Coated):
        expected = (
            "solids without a coating, because the contact modulus of a coated body depends on the wavelength: "
            "instead of the contact modulus, give the two bodies, such as HalfSpace(shape, spacing, (a, b))"
        )
        raise InputError("contact_modulus", "a coated body", expected)
    compliance = (1 - a.poisson**2) / a.young
    if b is not None:
        compliance += (1 - b.poisson**2) / b.young
    return 1 / compliance


_ELASTIC = "E, ν: Kaye & Laby, Tables of Physical and Chemical Constants"
_CALLISTER = "Callister, Materials Science and Engineering"


def _metal(young: float, poisson: float, yield_stress: float, vickers: float) -> Solid:
    """Return the solid for a metal, with a hardness converted from the Vickers hardness [HV].

    Parameters
    ----------
    young, poisson : Young's modulus [Pa] and Poisson's ratio.
    yield_stress : yield stress of the metal as delivered [Pa].
    vickers : typical Vickers hardness [HV] in data sheets of the metal as delivered. The hardness of an annealed metal
        is far above 2.8 times its yield stress, because the metal work-hardens under the Vickers indenter. An annealed
        metal work-hardens under the asperities of a seal face as well.
    """
    ratio = vickers * VICKERS_PRESSURE / yield_stress
    return Solid(young, poisson, yield_stress, hardness_over_yield=ratio)


#: Metals for seals at 20 °C, each with the source of its properties. Yield strengths are 0.2 % proof stresses of sheet
#: or bar as delivered, either specified minimum values ("least") or typical values.
METALS: dict[str, tuple[Solid, str]] = {
    "steel 304/316, annealed": (
        _metal(200e9, 0.3, 205e6, 160),
        "E: EN 10088-1; least yield strength: ASTM A240",
    ),
    "steel 1.4571, annealed": (
        _metal(200e9, 0.3, 200e6, 160),
        "E: EN 10088-1; least yield strength: EN 10088-3",
    ),
    "Inconel 718, aged": (
        _metal(200e9, 0.29, 1034e6, 420),
        "Special Metals SMC-045; least yield strength: AMS 5662",
    ),
    "copper, soft": (
        _metal(117e9, 0.343, 48e6, 45),
        "OFHC, annealed strip, typical: Smithells; ν: Kaye & Laby",
    ),
    "copper, half hard": (
        _metal(117e9, 0.343, 176e6, 85),
        "OFHC strip, typical: Smithells; ν: Kaye & Laby",
    ),
    "aluminium 1050, soft": (
        _metal(69e9, 0.33, 20e6, 20),
        "EN AW-1050A, temper O; least yield strength: EN 485-2",
    ),
    "aluminium 6061-T6": (_metal(69e9, 0.33, 276e6, 107), "typical: ASM Handbook, vol. 2"),
    "nickel 200, annealed": (_metal(204e9, 0.31, 148e6, 90), f"typical: {_CALLISTER}, appendix B"),
    "silver, annealed": (
        _metal(82.7e9, 0.367, 54e6, 25),
        f"typical: ASM Handbook, vol. 2; {_ELASTIC}",
    ),
    "soft iron": (
        _metal(211.4e9, 0.293, 130e6, 75),
        f"annealed, typical: {_CALLISTER}, table 6.2; {_ELASTIC}",
    ),
}


def named_solid(name: str) -> Solid:
    """Return a metal of `METALS` by its name, in upper or lower case.

    The hardness of the returned solid [Pa] is converted from a typical Vickers hardness of the metal as delivered.

    Parameters
    ----------
    name : str
        Name of the metal.

    Raises
    ------
    InputError
        The name is unknown. The message suggests the most similar name.

    Examples
    --------
    >>> copper = named_solid("Copper, soft")
    >>> copper.yield_stress, round(copper.hardness / 1e6)
    (48000000.0, 476)
    """
    known = {metal.casefold(): metal for metal in METALS}
    text = name.casefold().strip() if isinstance(name, str) else ""
    if text in known:
        solid, _source = METALS[known[text]]
        return solid
    similar = _similar_names(text, list(known))
    suggestion = f"; perhaps meant: {known[similar[0]]!r}" if similar else ""
    metals = ", ".join(map(repr, METALS))
    raise InputError("name", shown(name), f"one of {metals}{suggestion}")


def _similar_names(text: str, names: list[str]) -> list[str]:
    """Return the names that contain `text` or a number from it, such as "316", or else the most similar name."""
    parts = [part for part in (text, *re.findall(r"\d{3,}", text)) if part]
    with_part = [name for name in names if any(part in name for part in parts)]
    return with_part or get_close_matches(text, names, n=1, cutoff=0.4)
