"""A material that is soft beside its slopes is cut off at the height whose bearing area is p̄/H."""

from __future__ import annotations

import numpy as np

from femseal import solve_contact

from .faces import MODULUS, SLOPE, rough


def bearing_area(n=256, ratios=(1.0, 0.1, 0.01, 1e-3, 1e-4), shares=(1 / 16, 1 / 4, 1 / 2, 3 / 4)):
    """Elastic-plastic contact for H/(E*h′) → 0 against the face cut off at a bearing area of
    p̄/H.

    Records with the contact area over p̄/H, the part of contact that is not the bearing area, and
    the largest difference of the gap to the truncated one over the rms height. Areas are whole
    numbers of pixels; the level is known to two neighbours among the sorted heights.
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
