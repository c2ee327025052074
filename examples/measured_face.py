"""A measured surface
==================

This script reads a surface from the file of an instrument, and computes its leakage at one load. The file was generated
by ``make_measured_face.py``.
"""

from __future__ import annotations

from pathlib import Path

import femseal as fs

FILE = Path(__file__).with_name("measured_face.x3p")
STEEL = fs.Solid(young=210e9, poisson=0.3, yield_stress=1.2e9)
OIL = fs.Liquid(viscosity=0.02, density=870)


def prepared() -> fs.Topography:
    """Prepare the surface as a run does.

    Undefined points are filled. Tilt, curvature and waves shorter than 10 µm are removed.
    """
    face = fs.read_topography(FILE)
    surface, _ = fs.condition(
        face, detrend=2, shortest_wave=10e-6, max_undefined=0.03, shape=(240, 480)
    )
    return surface


def leakage(surface: fs.Topography, pressure: float) -> tuple[fs.Contact, fs.Leakage]:
    """Solve the contact with a rigid flat under a nominal pressure [Pa], and compute the leakage from 10 MPa to 0."""
    body = fs.HalfSpace(
        surface.shape, surface.spacing, fs.contact_modulus(STEEL), ("mirror", "mirror")
    )
    contact = fs.solve_contact(
        surface.gap(), body, pressure=pressure, hardness=STEEL.hardness, rtol=1e-5
    )
    k = fs.cell_permeability(contact.gap, surface.spacing)
    seal = fs.RectangularSeal(surface.size, cells=(1, 1))
    return contact, fs.seal_leakage(seal, k.value, OIL, inlet_pressure=10e6)


if __name__ == "__main__":
    face = fs.read_topography(FILE)
    print("as measured:", face)
    surface = prepared()
    print("as solved:  ", surface)
    contact, result = leakage(surface, 2e8)
    print(
        f"at 200 MPa {contact.area_fraction:.1%} in contact, {result.per_length * 1e6:.3g} mL/(m·s)"
    )
    picture = contact.plot()
    picture.savefig("measured_contact.png")
