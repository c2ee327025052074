"""What the intervals of drawn seals contain: on rows of other scenes, and with one kind of surface left out.

Rows are steps of scenes, with the columns of the calibration set and the decades of the truth below
that of the first load. Intervals are made again from the state of each row, so that rows need not
be solved again where the calibration changes.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from common import table
from femseal.studies.patch_interval import IntervalWidths, calibration_rows, state_of_rows

#: Decades of the truth below that of the first load, half by half.
HALF_DECADES = ((-9.0, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 9.0))


class Judged:
    """Rows with their intervals.

    contained : whether the interval contains the truth (rows,). half_width : half of the distance of
    ln(leakage) between both ends, NaN where the lower end is 0 (rows,).
    """

    def __init__(self, rows, widths):
        """Make the intervals of rows by widths of a calibration."""
        self.rows = rows
        leakage, truth = (np.array([float(row[n]) for row in rows]) for n in ("leakage", "truth"))
        lower, upper = widths.ends(leakage, state_of_rows(rows))
        self.contained = (lower <= truth) & (truth <= upper)
        with np.errstate(divide="ignore"):
            width = np.log(upper / lower) / 2
        self.half_width = np.where(lower > 0, width, np.nan)
        self.decades = np.array([float(row["decades"]) for row in rows])

    @classmethod
    def joined(cls, several):
        """Put judged rows together."""
        found = cls.__new__(cls)
        found.rows = [row for one in several for row in one.rows]
        for name in ("contained", "half_width", "decades"):
            setattr(found, name, np.concatenate([getattr(one, name) for one in several]))
        return found

    def column(self, name):
        """Values of a column (rows,)."""
        return np.array([row[name] for row in self.rows])


def of_patches(rows, single):
    """Rows of single patches, or those of two patches together."""
    return [row for row in rows if (row["patch"] != "both") == single]


def with_kind_left_out(kind, rows, *, of_two=False):
    """Rows with intervals that are calibrated on the other kinds of surfaces."""
    found = []
    for surface in sorted({row["surface"] for row in rows}):
        others = [row for row in rows if row["surface"] != surface]
        own = [row for row in rows if row["surface"] == surface]
        found.append(Judged(own, IntervalWidths.calibrate(kind, others, two_patches=of_two)))
    return Judged.joined(found)


def by_surface(kind, unseen):
    """Table of what is contained by kind of surface: in the calibration set, left out of it, unseen."""
    rows = calibration_rows(kind)
    widths = IntervalWidths.calibrate(kind, rows)
    single = of_patches(rows, True)
    inside, left_out = Judged(single, widths), with_kind_left_out(kind, single)
    judged = [inside, left_out]
    if unseen:
        judged.append(Judged(of_patches(unseen, True), widths))
    lines = []
    for surface in (*sorted({row["surface"] for row in single}), "all"):
        cells = [surface]
        for one in judged:
            chosen = (one.column("surface") == surface) | (surface == "all")
            scenes = len({row["scene"] for row, c in zip(one.rows, chosen, strict=True) if c})
            share = f"{one.contained[chosen].mean():.1%}" if chosen.any() else ""
            cells += [f"{scenes}, {chosen.sum()}", share] if one is not left_out else [share]
        lines.append(cells)
    head = ["surface", "scenes, loads", "contained", "contained, kind left out"]
    head += ["unseen scenes, loads", "contained"] if unseen else []
    return table(head, lines)


def by_half_decade(kind, rows):
    """Table of what is contained by half decade, and of half-widths as factors, of one patch and of two."""
    widths = {
        of_two: IntervalWidths.calibrate(kind, calibration_rows(kind), two_patches=of_two)
        for of_two in (False, True)
    }
    lines = []
    judged = [Judged(of_patches(rows, single), widths[not single]) for single in (True, False)]
    for low, high in HALF_DECADES:
        cells = [f"{max(low, 0):g} to {high:g}" if high < 9 else f"from {low:g}"]
        for one in judged:
            chosen = (one.decades >= low) & (one.decades < high)
            if not chosen.any():
                cells += ["0", "", ""]
                continue
            width = one.half_width[chosen]
            factor = f"{np.exp(np.nanmedian(width)):.2f}" if np.isfinite(width).any() else "–"
            cells += [str(chosen.sum()), f"{one.contained[chosen].mean():.1%}", factor]
        lines.append(cells)
    heads = product(("one patch", "two patches"), ("loads", "contained", "half-width"))
    return table(["decades", *(f"{patch}: {head}" for patch, head in heads)], lines)
