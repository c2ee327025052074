"""Cases of one load that differ in their fluid."""

from small_cases import HARDENED

from femseal.case import parse_case

OIL = {"kind": "liquid", "viscosity": "50 mPa*s", "inlet_pressure": "10 bar"}


def case_with_fluid(fluid, seat=None, **face):
    """Case of a self-affine face of 1 mm under 25 MPa with this fluid, these keys of its face and, if given, a seat."""
    plain = {"kind": "self-affine", "points": [64, 64], "size": ["1 mm", "1 mm"], "hurst": 0.8}
    changed = {
        "seat": seat or {"kind": "flat"},
        "face": plain | face,
        "material": {"young": "210 GPa", "yield_stress": "1 GPa"},
        "load": {"loading": ["25 MPa"]},
        "fluid": fluid,
        "output": {"budget": False},
    }
    return parse_case(HARDENED | changed)
