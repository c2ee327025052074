"""A material that is soft beside its slopes is cut off at the height whose bearing area is p̄/H."""

from __future__ import annotations

import numpy as np

from .faces import MODULUS, SLOPE, rough


def bearing_area(n=256, ratios=(1.0, 0.1, 0.01, 1e-3, 1e-4), shares=(1 / 16, 1 / 4, 1 / 2, 3 / 4)):
    """Elastic-plastic contact for H/(E*h′) → 0 against the truncated face whose bearing area is p̄/H.

    Records with the contact area over p̄/H, the share of contact that is not the bearing area, and the largest
    difference of the gap to the truncated one over the rms height. The shares are whole numbers of pixels; the level
    is known to the difference of two neighbours among the sorted heights.
    """
    from femseal import solve_contact

    gap0, body = rough(n)
    ordered = np.sort(gap0, axis=None)
    records = []
    for share in shares:
        level = ordered[round(share * gap0.size) - 1]
        for ratio in ratios:
            hardness = ratio * MODULUS * SLOPE
            contact = solve_contact(gap0, body, pressure=share * hardness, hardness=hardness)
            wrong = np.count_nonzero((contact.pressure > 0) != (gap0 <= level))
            records.append(
                {
                    "share": share,
                    "ratio": ratio,
                    "area": contact.area_fraction / share,
                    "wrong": wrong / (share * gap0.size),
                    "gap": float(np.abs(contact.gap - np.maximum(gap0 - level, 0)).max() / gap0.std()),
                }
            )
    return records


def draw(records, ax):
    for share in sorted({r["share"] for r in records}):
        chosen = [r for r in records if r["share"] == share]
        ax.loglog([r["ratio"] for r in chosen], [r["gap"] for r in chosen], "o-", label=f"p̄/H = {share:g}")
    ax.set(
        xlabel="H / E*h′", ylabel="largest difference of the gap / rms height", title="gap against the truncated face"
    )
    ax.legend()


def line(records):
    soft = [r for r in records if r["ratio"] == min(q["ratio"] for q in records)]
    hard = [r for r in records if r["ratio"] == 0.1]

    def worst(chosen):
        return max(abs(r["area"] - 1) for r in chosen), max(r["gap"] for r in chosen)

    return [
        "A material without elasticity is cut off at the height whose bearing area is p̄/H",
        "limit of the model; test of ContactMechanics",
        f"area off by at most {worst(hard)[0]:.1e}, gap by {worst(hard)[1]:.1e} of the rms height at H/E*h′ = 0.1; "
        f"{worst(soft)[0]:.1e} and {worst(soft)[1]:.1e} at {soft[0]['ratio']:g}",
    ]
