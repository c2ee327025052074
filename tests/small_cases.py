"""Parts of small cases for tests: their tables as text, a case of a drawn seal, and a scene of a liquid."""

from femseal.fluids import Liquid
from femseal.studies.scene import Scene

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
#: A strip of pieces in two rows, without its table [stochastic].
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
    "load": {"loading": ["50 MPa", "300 MPa"], "unload_from": ["300 MPa"], "unloading": ["100 MPa"]},
    "fluid": {"kind": "liquid", "viscosity": "1 mPa*s", "inlet_pressure": "1 MPa"},
    "cells": {"count": [2, 4]},
}


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
