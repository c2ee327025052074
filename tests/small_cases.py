"""Small cases for tests of several rooms: tables as text, whole cases, a leak test, and a scene of a liquid."""

import re
import tomllib
from pathlib import Path

from femseal.case import Case, case_template
from femseal.fluids import Liquid
from femseal.seal.layouts import LAYOUTS
from femseal.studies import Scene
from femseal.topography import self_affine

#: Contact modulus and hardness of the scenes [Pa], and their liquid.
E, H, OIL = 115e9, 3e9, Liquid(1e-3)
#: Material, load and fluid.
TABLES = """\
[material]
young = "210 GPa"
hardness = "3 GPa"
[load]
loading = ["100 MPa", "300 MPa"]
unload_from = ["300 MPa"]
unloading = ["100 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "1 MPa"
"""
#: A strip of cells in two rows, without its table [stochastic].
STRIP = {
    "method": "stochastic",
    "face": {
        "kind": "self-affine",
        "points": [32, 64],
        "size": ["30 um", "60 um"],
        "rms_slope": 0.2,
        "roll_off": "20 um",
    },
    "material": {"young": "210 GPa", "hardness": "3 GPa"},
    "load": {
        "loading": ["50 MPa", "300 MPa"],
        "unload_from": ["300 MPa"],
        "unloading": ["100 MPa"],
    },
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
    "cells": {"count": [2, 4]},
}
#: All three studies, small enough to be run again and again.
CASE = f"""
method = "stochastic"
compare = ["deterministic", "two-scale"]
seed = 2
[face]
kind = "self-affine"
points = [32, 32]
size = ["30 um", "30 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES}[contact]
boundary = ["periodic", "periodic"]
[cells]
count = [2, 2]
[stochastic]
length = "200 um"
realisations = 24
"""
#: A process that has not answered by then never will [s]: no measure of how quick it is.
HANG = 600
#: A face whose points harden, and its resolved flow.
HARDENED = {
    "method": "deterministic",
    "face": {
        "kind": "self-affine",
        "points": [32, 32],
        "size": ["32 um", "32 um"],
        "hurst": 0.8,
        "rms_slope": 0.2,
    },
    "material": {"young": "210 GPa", "hardness": "2 GPa", "hardening": "2 GPa/um"},
    "load": {"loading": ["100 MPa", "500 MPa"]},
    "fluid": {
        "kind": "liquid",
        "viscosity": "1 mPa*s",
        "inlet_pressure": "1 MPa",
        "outlet_pressure": "0 Pa",
    },
}
#: A case whose keys are swept.
SWEPT = f"""
method = "stochastic"
seed = 2
[face]
kind = "self-affine"
points = [32, 64]
size = ["30 um", "60 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES.replace('["100 MPa", ', '["50 MPa", ')}[cells]
count = [2, 4]
[stochastic]
length = "120 um"
realisations = 4
[output]
paraview = "none"
budget = false
"""
#: A case that a leak test calibrates, and rows of such a test.
CALIBRATED = """
method = "deterministic"
[face]
kind = "self-affine"
points = [64, 64]
size = ["64 um", "64 um"]
rms_slope = 0.2
roll_off = "30 um"
[material]
young = "210 GPa"
yield_stress = "1 GPa"
[load]
loading = ["50 MPa", "200 MPa", "400 MPa", "600 MPa"]
unload_from = ["400 MPa"]
unloading = ["200 MPa", "50 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "10 MPa"
[output]
budget = false
"""
HEAD = "pressure [MPa], branch, leakage [m²/s]\n"
ROWS = "50, loading, 3e-5\n400,loading,2e-6\n50,unloading,4e-6\n600,loading,sealed\n"


def steel_scene(surface, **changed):
    """A scene of a face of steel and a liquid that leaves the contact as it is."""
    given = {
        "surface": surface,
        "modulus": E,
        "hardness": H,
        "fluid": OIL,
        "inlet_pressure": 1e6,
        "outlet_pressure": 0.0,
        "fluid_pressure": "ignored",
    }
    return Scene(**(given | changed))


def scene_of_law(law, highest):
    """A face of 48 × 64 points under a contact law, loaded to a pressure [Pa] and back."""
    surface = self_affine(
        (48, 64), (48e-6, 64e-6), hurst=0.8, rms_slope=0.25, roll_off=24e-6, cut_off=8e-6, rng=1
    )
    loads = {"loading": (1e8, highest), "unload_from": (highest,), "unloading": (2e8,)}
    return Scene(surface, E, law, OIL, 1e6, 0.0, **loads, rtol=1e-4)


def scene_of_fluid(fluid, outlet_pressure):
    """A face of 64 × 128 points with a fluid from 1 MPa, loaded to 300 MPa and back."""
    surface = self_affine(
        (64, 128), (64e-6, 128e-6), hurst=0.8, rms_slope=0.1, roll_off=32e-6, cut_off=8e-6, rng=1
    )
    loads = {"loading": (50e6, 300e6), "unload_from": (300e6,), "unloading": (50e6,)}
    return Scene(surface, E, 2.8e9, fluid, 1e6, outlet_pressure, **loads)


def soft_cycle(points):
    """A soft face of so many points, loaded to half of its hardness and back."""
    surface = self_affine(points, (60e-6, 120e-6), hurst=0.8, rms_slope=0.15, roll_off=40e-6, rng=2)
    loads = {"loading": (50e6, 200e6, 700e6), "unload_from": (700e6,), "unloading": (300e6, 50e6)}
    return Scene(surface, E, 1.4e9, OIL, 1e6, 0.0, **loads)


def template_cases():
    """The case of `femseal new` with each of its tables as it is with all that it comments out."""
    text = case_template(Case)
    blocks = re.sub(r"^# (?=\[|\w+ = )", "", text, flags=re.MULTILINE).split("\n\n")
    for block in blocks[1:]:
        case, inside = tomllib.loads(text), re.match(r"\[\w+\.", block)
        for name, value in tomllib.loads(block).items():
            case[name] = case.get(name, {}) | value if inside else value
        kind = case.get("seal", {}).get("kind")
        if kind and not LAYOUTS[kind].has_length:
            del case["stochastic"]["length"]
        yield case


def small_turned_seal():
    """Tables of the case of a turned seal that is shipped, with a small face and few cells."""
    path = Path(__file__).parents[1] / "examples" / "turned_seal.toml"
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    tables["face"] |= {"points": [64, 96], "size": ["60 um", "120 um"], "pitch": "30 um"}
    return tables | {"cells": {"count": [2, 4]}}
