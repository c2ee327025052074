"""Small cases of drawn seals, from which designs are made."""

from small_cases import STRIP

from femseal.case import parse_case

#: Grooves along the seal, across the leakage.
GROOVED = {
    "kind": "turned",
    "points": [32, 32],
    "size": ["60 um", "60 um"],
    "pitch": "30 um",
    "depth": "1.5 um",
    "roughness": "0.3 um",
    "roughness_roll_off": "20 um",
}


def design_case(**tables):
    """Case of eight drawn seals of 2 × 2 cells, loaded up to 400 MPa and unloaded; with these tables in place of its own."""
    drawn = {"length": "300 um", "realisations": 8}
    load = {"loading": ["20 MPa", "100 MPa", "400 MPa"], "unload_from": ["400 MPa"]}
    own = {
        "face": STRIP["face"] | {"points": [32, 32], "size": ["60 um", "60 um"]},
        "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
        "load": load | {"unloading": ["100 MPa", "20 MPa"]},
        "cells": {"count": [2, 2]},
        "stochastic": drawn,
    }
    return parse_case(STRIP | own | tables)
