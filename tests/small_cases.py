"""Parts of small cases for tests: their tables as text, and a case of a seal that is drawn from windows."""

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
#: A strip of windows in two rows, without its table [stochastic].
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
