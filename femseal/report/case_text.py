"""Solids and fluid of a case in a sentence: what `femseal check` and the report say of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..base.quantities import to_text


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
    """The two solids of a case, of its tables in SI."""
    counter = case.get("counter_material")
    return f"{_solid_text(case['material'])} against {_solid_text(counter) if counter else 'a rigid flat'}"


def contact_text(modulus: float, law: str) -> str:
    """Contact modulus [Pa] and law."""
    return f"contact modulus {to_text(modulus, 'Pa')}, {law}"


def _solid_text(solid: Mapping[str, Any]) -> str:
    facts = [f"E = {to_text(solid['young'], 'Pa')}"]
    facts += [f"ν = {solid['poisson']:g}"] if "poisson" in solid else []
    for key, name in (("hardness", "hardness"), ("yield_stress", "yield stress")):
        facts += [f"{name} {to_text(solid[key], 'Pa')}"] if key in solid else []
    return ", ".join(facts)
