"""Solids and fluid of a case in a sentence: what `femseal check` and the report say of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.quantities import to_text
from ..contact.hardness_curves import SMALLEST_DEPTH, NixGao
from ..materials import HARDNESS_FACTOR, METALS

#: Ratio of the hardnesses of two faces up to which both are said to be close.
_CLOSE = 1.1


def fluid_text(fluid: Mapping[str, Any], fallback: str) -> str:
    """A fluid of a case, of its table in SI."""
    rarefied = ", with" + ("" if fluid.get("slip", True) else "out") + " slip and free molecular flow"
    if fluid.get("kind") == "real-gas":
        return f"{fluid['name']}, a real gas by CoolProp at {fluid['temperature'] - 273.15:.4g} °C{rarefied}"
    if "viscosity" not in fluid:
        return fallback
    name = f"{fluid['name']}, " if fluid.get("name") else ""
    kind = {"ideal-gas": "an ideal gas", "roelands-liquid": "a liquid by Roelands' law"}
    named = kind.get(fluid.get("kind", ""), f"a {fluid.get('kind', 'fluid')}")
    text = f"{name}{named} of viscosity {to_text(fluid['viscosity'], 'Pa·s')}"
    if "molar_mass" in fluid:
        text += f" and molar mass {1e3 * fluid['molar_mass']:.5g} g/mol"
        text += f" at {fluid['temperature'] - 273.15:.4g} °C" if "temperature" in fluid else ""
    if fluid.get("kind") == "ideal-gas":
        text += rarefied
    if fluid.get("slip_length"):
        text += f", slip length {to_text(fluid['slip_length'], 'm')}"
    return text + (f" and density {fluid['density']:g} kg/m³" if "density" in fluid else "")


def solids_text(case: Mapping[str, Any]) -> str:
    """The two solids of a case, of its tables in SI, and which of them yields."""
    face, counter = case["material"], case.get("counter_material")
    if not counter:
        return f"{_solid_text(face)} against a rigid flat"
    text = f"{_solid_text(face)} against {_solid_text(counter)}"
    one, two = _first_hardness(face), _first_hardness(counter)
    if min(one, two) == np.inf:
        return text
    softer, pressures = ("face", (one, two)) if one <= two else ("counter-face", (two, one))
    low, high = (to_text(p, "Pa") if p < np.inf else "no pressure" for p in pressures)
    text += f"; the {softer} yields, at {low}, and the other at {high}"
    if max(one, two) <= _CLOSE * min(one, two):
        text += ": they are close, and the softer is taken to yield alone"
    return text


def _first_hardness(solid: Mapping[str, Any]) -> float:
    """Pressure at which a solid first yields [Pa]; inf is elastic."""
    if table := solid.get("hardness_table"):
        return float(table[0][1])
    hardness = float(solid.get("hardness", HARDNESS_FACTOR * solid.get("yield_stress", np.inf)))
    if "nix_gao_depth" in solid:
        return NixGao(hardness, solid["nix_gao_depth"], solid.get("smallest_depth", SMALLEST_DEPTH)).mean_hardness
    return hardness


def contact_text(modulus: float, law: str) -> str:
    """Contact modulus [Pa] and law."""
    return f"contact modulus {to_text(modulus, 'Pa')}, {law}"


def _solid_text(solid: Mapping[str, Any]) -> str:
    """A solid, with the name that it has, and which of its values are not those of the name."""
    facts = [f"E = {to_text(solid['young'], 'Pa')}"]
    facts += [f"ν = {solid['poisson']:g}"] if "poisson" in solid else []
    for key, name in (("hardness", "hardness"), ("yield_stress", "yield stress")):
        facts += [f"{name} {to_text(solid[key], 'Pa')}"] if key in solid else []
    facts += [f"hardness by a table of {len(solid['hardness_table'])} depths"] if "hardness_table" in solid else []
    text = ", ".join(facts)
    names = {key.casefold(): key for key in METALS}
    if (key := str(solid.get("name") or "").casefold().strip()) not in names:
        return text
    metal, source = METALS[names[key]]
    keys = ("young", "poisson", "yield_stress", "hardness", "hardness_table")
    own = [k.replace("_", " ") for k in keys if k in solid and solid[k] != getattr(metal, k, None)]
    return f"{names[key]} ({'by the case: ' + ', '.join(own) + '; ' if own else ''}{source}): {text}"
