"""Compare fields of femseal with fields of other programs on the same problem."""

from __future__ import annotations

import numpy as np

from femseal import HalfSpace, cell_permeability, self_affine, solve_contact
from peers import CONTACTS, reynoldsflow

from .faces import MODULUS, SLOPE, rough

#: Tolerances of the peers, without and with a hardness.
TIGHT = {"Tamaas": (1e-12, 1e-10), "ContactMechanics": (1e-9, 1e-9)}


def contact_fields(peer, n=256, pressures=(200e6, 1e9), hardnesses=(np.inf, 4e9)):
    """Compare contact pressure and gap with a program.

    Each record contains the largest difference of the pressure over the largest pressure, the largest
    difference of the gap over the rms height, and the number of pixels that are in contact in one program only.
    """
    gap0, body = rough(n)
    records = []
    for hardness in hardnesses:
        solve = CONTACTS[peer](body.shape, body.spacing[0], MODULUS, hardness)
        for pressure in pressures:
            load = {"pressure": pressure, "hardness": hardness}
            contact = solve_contact(gap0, body, rtol=1e-10, **load)
            theirs, gap = solve(gap0, pressure, TIGHT[peer][int(np.isfinite(hardness))])
            records.append(
                load
                | {
                    "difference of pressure": np.abs(theirs - contact.pressure).max()
                    / contact.pressure.max(),
                    "of gap": np.abs(gap - contact.raw_gap).max() / gap0.std(),
                    "pixels otherwise": np.count_nonzero((theirs > 0) != (contact.pressure > 0)),
                }
            )
    return records


def flow_fields(n=128, refinements=(1, 2, 4)):
    """Compare the flow through a contact with reynoldsflow on finer and finer grids.

    In reynoldsflow, the gap is constant on each pixel.

    Each record contains the relative difference of the permeability, and the rms and the largest difference of
    the fluid pressure, divided by the pressure drop.
    """
    size = n * 1e-6
    records = []
    for refinement in refinements:
        m = refinement * n
        waves = {"roll_off": size / 8, "cut_off": 8e-6}
        face = self_affine((m, m), (size, size), hurst=0.8, rms_slope=SLOPE, rng=1, **waves)
        body = HalfSpace((m, m), face.spacing, MODULUS)
        load = {"pressure": 200e6, "hardness": 4e9}
        gap = solve_contact(-face.heights, body, rtol=1e-8, **load).gap
        value, theirs = reynoldsflow(gap)
        cell_flow = cell_permeability(
            gap, face.spacing, sides="periodic", rtol=1e-10, field_rtol=1e-8
        )
        # the inlet is at pressure 1 here, at 0 there
        ways = (p - theirs for p in (1 - cell_flow.fluid_pressure, cell_flow.fluid_pressure))
        difference = min(ways, key=lambda d: np.nanmean(np.abs(d)))
        records.append(
            {
                "pixels per shortest wave": 8 * refinement,
                "difference of permeability": cell_flow.value / value - 1,
                "of fluid pressure, rms": np.sqrt(np.nanmean(difference**2)),
                "at most": np.nanmax(np.abs(difference)),
            }
        )
    return records
