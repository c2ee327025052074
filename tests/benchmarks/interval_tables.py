"""Tabulate how often the intervals of stochastic seals contain the true leakage.

The intervals are tested on scenes that the calibration did not use, and on each kind of surface after it was
left out of the calibration. A row is a load step of a scene. It has the columns of the calibration set, and the
column "decades": the number of decades by which the true leakage lies below the true leakage at the first load.
The intervals are computed again from the contact state in each row. Rows need not be solved again if the
calibration changes.
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

    Parameters
    ----------
    rows : list of dict
        Load steps of scenes.
    widths : IntervalWidths
        Calibrated widths, from which the intervals are computed.

    Attributes
    ----------
    contained : array (row,)
        Whether the interval contains the true leakage.
    half_width : array (row,)
        Half of the distance between both ends in ln(leakage); NaN if the lower end is 0.
    decades : array (row,)
        Column "decades" of the rows.
    """

    def __init__(self, rows, widths):
        """Compute the intervals of rows from calibrated widths."""
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
        """Join several sets of judged rows into one."""
        result = cls.__new__(cls)
        result.rows = [row for judged in several for row in judged.rows]
        for name in ("contained", "half_width", "decades"):
            setattr(result, name, np.concatenate([getattr(judged, name) for judged in several]))
        return result

    def column(self, name):
        """Return the values of a column of all rows."""
        return np.array([row[name] for row in self.rows])


def of_patches(rows, single):
    """Select the rows of single patches, or the rows of two patches used together."""
    return [row for row in rows if (row["patch"] != "both") == single]


def with_kind_left_out(kind, rows, *, of_two=False):
    """Return the rows with intervals that were calibrated on all other kinds of surfaces."""
    judged = []
    for surface in sorted({row["surface"] for row in rows}):
        others = [row for row in rows if row["surface"] != surface]
        of_this_kind = [row for row in rows if row["surface"] == surface]
        judged.append(
            Judged(of_this_kind, IntervalWidths.calibrate(kind, others, two_patches=of_two))
        )
    return Judged.joined(judged)


def by_surface(kind, unseen):
    """Tabulate by kind of surface how often the intervals contain the true leakage.

    The groups are the calibration set, the calibration set with this kind left out, and unseen scenes.
    """
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
        for group in judged:
            chosen = (group.column("surface") == surface) | (surface == "all")
            scenes = len({row["scene"] for row, c in zip(group.rows, chosen, strict=True) if c})
            share = f"{group.contained[chosen].mean():.1%}" if chosen.any() else ""
            cells += [f"{scenes}, {chosen.sum()}", share] if group is not left_out else [share]
        lines.append(cells)
    head = ["surface", "scenes, loads", "contained", "contained, kind left out"]
    head += ["unseen scenes, loads", "contained"] if unseen else []
    return table(head, lines)


def by_half_decade(kind, rows):
    """Tabulate by half decade of the leakage how often the intervals contain the true leakage, and their half-widths."""
    widths = {
        of_two: IntervalWidths.calibrate(kind, calibration_rows(kind), two_patches=of_two)
        for of_two in (False, True)
    }
    lines = []
    judged = [Judged(of_patches(rows, single), widths[not single]) for single in (True, False)]
    for low, high in HALF_DECADES:
        cells = [f"{max(low, 0):g} to {high:g}" if high < 9 else f"from {low:g}"]
        for group in judged:
            chosen = (group.decades >= low) & (group.decades < high)
            if not chosen.any():
                cells += ["0", "", ""]
                continue
            width = group.half_width[chosen]
            factor = f"{np.exp(np.nanmedian(width)):.2f}" if np.isfinite(width).any() else "–"
            cells += [str(chosen.sum()), f"{group.contained[chosen].mean():.1%}", factor]
        lines.append(cells)
    heads = product(("one patch", "two patches"), ("loads", "contained", "half-width"))
    return table(["decades", *(f"{patch}: {head}" for patch, head in heads)], lines)
