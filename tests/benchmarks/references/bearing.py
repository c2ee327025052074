"""Test that a material whose elastic deformation is negligible is cut off at the height of the bearing area p̄/H."""

from __future__ import annotations

import numpy as np

from femseal import solve_contact

from .faces import MODULUS, SLOPE, rough


def bearing_area(n=256, ratios=(1.0, 0.1, 0.01, 1e-3, 1e-4), shares=(1 / 16, 1 / 4, 1 / 2, 3 / 4)):
    """Compare elastic-plastic contacts for H/(E*h′) → 0 with the surface cut off at a bearing area of p̄/H.

    Each record contains the contact area divided by p̄/H, the part of the contact that lies outside the bearing
    area, and the largest difference between the gap and the gap of the cut surface, divided by the rms height.
    Areas are whole numbers of pixels; the height of the cut lies between two neighbouring values of the sorted
    heights.
    """
    gap0, body = rough(n)
    ordered = np.sort(gap0, axis=None)
    records = []
    for share in shares:
        level = ordered[round(share * gap0.size) - 1]
        for ratio in ratios:
            hardness = ratio * MODULUS * SLOPE
            contact = solve_contact(gap0, body, pressure=share * hardness, hardness=hardness)
            wrong = np.mean((contact.pressure > 0) != (gap0 <= level))
            off = np.abs(contact.gap - np.maximum(gap0 - level, 0)).max()
            records.append(
                {
                    "p̄/H": share,
                    "H/E*h′": ratio,
                    "area": contact.area_fraction / share,
                    "wrong": wrong / share,
                    "gap": off / gap0.std(),
                }
            )
    return records
