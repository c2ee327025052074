"""The case and its pressure drop as sentences: seal, solids, loads, fluid and methods, for the report and `check`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base import counted, to_text
from ..contact.hardness_curves import SMALLEST_DEPTH, NixGao
from ..materials import HARDNESS_FACTOR, METALS
from ..plots.maps import default_step, face_leakage
from ..results.results import Results
from ..results.selections import load_names, loads_as_given

if TYPE_CHECKING:
    import xarray

#: Ratio of the hardnesses of two faces up to which both are said to be close.
_CLOSE = 1.1


#: Kinds of fluids as text.
_KINDS = {
    "ideal-gas": "an ideal gas",
    "real-gas": "a real gas by CoolProp",
    "roelands-liquid": "a liquid by Roelands' law",
}


def fluid_text(fluid: Mapping[str, Any], fallback: str) -> str:
    """A fluid of a case, of its table in SI."""
    if "kind" not in fluid:
        return fallback
    kind = fluid["kind"]
    text = ", ".join(filter(None, (fluid.get("name"), _KINDS.get(kind, f"a {kind}"))))
    if "viscosity" in fluid:
        text += f" of viscosity {to_text(fluid['viscosity'], 'Pa·s')}"
    if "molar_mass" in fluid:
        text += f" and molar mass {1e3 * fluid['molar_mass']:.5g} g/mol"
    if "temperature" in fluid:
        text += f" at {fluid['temperature'] - 273.15:.4g} °C"
    if kind.endswith("gas"):
        without = "" if fluid.get("slip", True) else "out"
        text += f", with{without} slip and free molecular flow"
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
        return NixGao(
            hardness, solid["nix_gao_depth"], solid.get("smallest_depth", SMALLEST_DEPTH)
        ).mean_hardness
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
    facts += ["hardness by a table of depths"] if "hardness_table" in solid else []
    text = ", ".join(facts)
    names = {key.casefold(): key for key in METALS}
    if (key := str(solid.get("name") or "").casefold().strip()) not in names:
        return text
    metal, source = METALS[names[key]]
    keys = ("young", "poisson", "yield_stress", "hardness", "hardness_table")
    own = [k.replace("_", " ") for k in keys if k in solid and solid[k] != getattr(metal, k, None)]
    by_case = f"by the case: {', '.join(own)}; " if own else ""
    return f"{names[key]} ({by_case}{source}): {text}"


def case_sentences(results: Results) -> list[str]:
    """The case; sentences without data in the results are left out."""
    data, case = results.dataset, results.case
    attrs = data.attrs
    width, length = (to_text(float(side), "m") for side in attrs["seal_size_m"])
    sentences = [f"The seal is {attrs['seal']}, {width} wide along the leakage and {length} long."]
    if faces := " against ".join(_face_text(face) for face in case.get("face", [])):
        sentences.append(f"{faces[0].upper()}{faces[1:]}.")
    if surface_text := _surface_text(json.loads(attrs["surface"])):
        sentences.append(surface_text)
    if "young" in case.get("material", {}):
        sentences.append(f"The solids: {solids_text(case)}.")
    text = contact_text(float(attrs["contact_modulus_Pa"]), str(attrs["contact_law"]))
    sentences.append(f"{text[0].upper()}{text[1:]}.")
    if attrs.get("seat"):
        sentences.append(_seat_text(data))
    sentences += load_sentences(data, case)
    inlet, outlet = (
        to_text(float(attrs[f"{end}_pressure_Pa"]), "Pa") for end in ("inlet", "outlet")
    )
    fluid = fluid_text(case.get("fluid", {}), str(attrs["fluid"]))
    effect = f": {attrs['fluid_effect']}" if "fluid_effect" in attrs else ""
    sentences.append(f"The fluid, {fluid}, runs from {inlet} to {outlet}{effect}.")
    sentences += _method_sentences(results)
    return sentences


def _seat_text(data: xarray.Dataset) -> str:
    """The form of the seat, and the band on which it touches."""
    text = f"The seat is {data.attrs['seat']}"
    if "band_breadth" not in data or "left out" in text:
        return f"{text}."
    band, peak = (data[name].values for name in ("band_breadth", "largest_row_pressure"))
    least, most = (to_text(float(f(band)), "m", 3) for f in (np.nanmin, np.nanmax))
    highest = to_text(float(np.nanmax(peak)), "Pa", 3)
    return f"{text}; it touches on a band {least} to {most} broad, with at most {highest} as the mean of a row."


def _face_text(face: dict[str, Any]) -> str:
    """The kind of a face, or the files that it is measured in."""
    if face.get("kind") != "file":
        return f"a {face.get('kind')} face"
    paths = [str(place.get("path")) for place in face.get("places") or [face]]
    return f"a measured face from {', '.join(paths)}"


def _surface_text(surface: dict[str, Any]) -> str:
    """Roughness of the face that is solved, what was filled, and how its spectrum is continued."""
    if "rms_slope" not in surface or "rms_height" not in surface:
        return ""
    text = f"Its rms height is {to_text(surface['rms_height'], 'm', 3)}, its rms slope {surface['rms_slope']:.3g}"
    undefined, spikes = surface.get("undefined_fraction"), surface.get("spike_points")
    filled = [f"{100 * undefined:.2g} % undefined points"] if undefined else []
    filled += [f"{counted(spikes, 'point')} in spikes"] if spikes else []
    if filled:
        text += f"; {' and '.join(filled)} were filled"
    if continued := surface.get("continuation"):
        text += f". {continued['text'][0].upper()}{continued['text'][1:]}"
    return text + "."


def _method_sentences(results: Results) -> list[str]:
    """What drawn seals are of."""
    data = results.dataset
    if "leakage_median" not in data:
        return []
    pieces = f"{data.sizes['state_piece1']} × {data.sizes['state_piece2']} pieces"
    return [
        f"The median is of {counted(data.sizes['realisation'], 'seal')} of {data.attrs['tiles']}, which "
        f"draw from {pieces} of the whole face in {counted(data.sizes['state'], 'state')}."
    ]


def load_sentences(data: xarray.Dataset, case: dict[str, Any]) -> list[str]:
    """The load steps, and what a form of the seal or a map makes of the lowest and the highest."""
    given, shown = case.get("load", {}), loads_as_given(data)
    pressure, peaks = data["nominal_pressure"].values, data["unloaded_from"].values
    up, down = pressure[np.isnan(peaks)], pressure[~np.isnan(peaks)]
    ends = dict.fromkeys(shown(p) for p in (up.min(), up.max()))
    text = f"It is loaded in {counted(up.size, 'step')}, {' to '.join(ends)}"
    if down.size:
        tops = " and ".join(shown(p) for p in np.unique(peaks[~np.isnan(peaks)]))
        text += f", and unloaded from {tops} down to {shown(down.min())}"
    if given.get("relaxation"):
        text += f"; relaxation takes {100 * given['relaxation']:.3g} % of a load in assembly before service"
    sentences = [f"{text}."]
    name = "drawn_nominal_pressure" if "drawn_form" in data else "drawn_contact_pressure"
    if name in data and ("drawn_form" in data or given.get("map")):
        for s in dict.fromkeys((int(pressure.argmin()), int(pressure.argmax()))):
            at = data[name].values[s]
            low, high = (to_text(float(f(at)), "Pa", 3) for f in (np.nanmin, np.nanmax))
            text = f"At {load_names(data)[s]} the seal is pressed with {low} to {high}"
            sentences.append(f"{text}, and {(at == 0).mean():.0%} of it stands apart.")
    return sentences


def pressure_drop_sentences(results: Results) -> list[str]:
    """Number of pieces that carry half of the pressure drop at the step of the maps."""
    data = results.dataset
    s = default_step(data)
    if np.nan_to_num(face_leakage(data)[s]) == 0:
        return [f"At {load_names(data)[s]} nothing flows."]
    if "piece_drop_fraction" not in data or not data["piece_drop_fraction"][s].notnull().all():
        return []
    fraction = np.sort(data["piece_drop_fraction"].values[s].ravel())[::-1]
    half = int(np.searchsorted(np.cumsum(fraction), 0.5) + 1)
    return [f"Half of the pressure drops in {half} of {fraction.size} pieces."]
