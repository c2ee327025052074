"""Compile the loops that list the points near contact and the free points.

Most points of a rough surface are far from contact. Between two products with the compliance K of the half-space, the
solver therefore works on lists of the points near contact. The lists are made after each product, in the same loop that
adds the undeformed gap to the displacement.
"""

import numpy as np

from ..base.compiled import over, parts, summed, thread_count
from .law_at_points import value_at
from .loop_decorators import exact
from .point_arrays import FREE, HARDENING, SEPARATED, FreePoints, NearPoints

#: Approximate number of grid points from which one thread makes a list at a time.
PART = 2**19


@exact
def list_near(
    gap0, offset, law, points, near, free, values, store_v,
    value_factor, gap_factor, reach, first, end,
):  # fmt: skip
    """Compute v = value_factor · values + gap_factor · (h₁ − offset), and list the points near contact in some rows.

    A point is near contact if it is in contact or if v is below the threshold `reach`. The free points are listed, too.

    Parameters
    ----------
    gap0 : array (n,)
        Undeformed gap h₁ [m].
    offset : float
        Height [m] that is subtracted from h₁.
    law, points, near, free
        Groups of arrays, see `point_arrays`.
    values : array (n1, >= n2)
        Displacement or v of all points: `points.v` or, in single precision, `points.kd`.
    store_v : bool
        Whether to replace `values` by v.
    value_factor, gap_factor : float
        Factors of `values` and of h₁ − offset. If `values` is the displacement of a half-space of unit modulus,
        `value_factor` is 1/E* and `gap_factor` is 1. If `values` is already v and only a new list is needed,
        `value_factor` is 1 and `gap_factor` is 0.
    reach : float
        Threshold of v [m].
    first, end : int
        Range of the rows.

    Returns
    -------
    n_near : number of points near contact.
    n_free : number of free points.
    energy : energy ½⟨p, Kp⟩ + ⟨p, h₁⟩ + ½ Σ (p − H)²/h. The sum Σ includes only the points that harden.
    load : sum of p.
    total : sum of v over the points near contact.
    """
    energy = 0.0
    load = 0.0
    total = 0.0
    columns = points.p.size // values.shape[0]  # rows of `values` may be longer
    # reading the members of a group within a loop takes time
    all_p, all_states, dense = points.p, points.state, points.dense
    near_index, near_p, near_v = near.index, near.p, near.v
    free_index, free_position = free.index, free.position
    n_near = 0
    n_free = 0
    for row in range(first, end):
        start = row * columns
        row_values = values[row, :columns]
        p = all_p[start : start + columns]
        state = all_states[start : start + columns]
        heights = gap0[start : start + columns]
        for j in range(columns):
            h = heights[j] - offset
            vj = value_factor * row_values[j] + gap_factor * h
            if store_v:
                row_values[j] = vj
            if state[j] != SEPARATED or vj < reach:
                energy += 0.5 * p[j] * (vj + h)  # ½⟨p, Kp⟩ + ⟨p, h₁⟩ = ½⟨p, v + h₁⟩
                load += p[j]
                total += vj
                i = start + j
                near_index[n_near] = i
                near_p[n_near] = p[j]
                near_v[n_near] = vj
                if state[j] == HARDENING:
                    # its energy contains the term ψ = ½ (p − H)²/h
                    above_hardness = p[j] - value_at(law.hardness, i)
                    energy += 0.5 * above_hardness * above_hardness / value_at(law.slope, i)
                if state[j] & FREE:
                    free_index[n_free] = i
                    free_position[n_free] = n_near
                    n_free += 1
                else:
                    dense[i] = 0.0  # a product in single precision has written the pressure there
                n_near += 1
    return n_near, n_free, energy, load, total


def _empty_lists(size: int) -> tuple[NearPoints, FreePoints]:
    """Make the lists that `list_near` fills, for at most `size` points; the arrays it does not use are empty."""
    unused = np.empty(0)
    p, v = np.empty((2, size))
    near = NearPoints(np.empty(size, np.int32), p, v, trial=unused, response=unused)
    index, position = np.empty((2, size), np.int32)
    return near, FreePoints(index, position)


def list_near_in_parts(
    gap0, offset, law, points, near, free, values, store_v,
    value_factor, gap_factor, reach, _first, n_rows,
):  # fmt: skip
    """Make the lists of `list_near` on several threads.

    Each thread lists the points of some parts of the grid. Only a few parts are processed at a time, to keep the memory
    for their lists small. The points of all rows are listed. The argument `_first` is unused; it only keeps the
    signature the same as that of `list_near`.
    """
    columns = gap0.size // n_rows
    row_ranges = parts(n_rows, PART / columns)  # (first row, end) of each part
    n_at_a_time = 2 * thread_count()
    most_points = columns * max(end - first for first, end in row_ranges)
    part_lists = [_empty_lists(most_points) for _ in row_ranges[:n_at_a_time]]

    def list_part(row_range, lists):
        return list_near(
            gap0,
            offset,
            law,
            points,
            *lists,
            values,
            store_v,
            value_factor,
            gap_factor,
            reach,
            *row_range,
        )

    sums = []  # energy, load and total of each part
    n_near = 0
    n_free = 0
    for start in range(0, len(row_ranges), n_at_a_time):
        # the last round may have fewer parts than lists
        tasks = list(zip(row_ranges[start : start + n_at_a_time], part_lists, strict=False))
        results = over(tasks, list_part)
        # append the lists of each part to the lists of the grid, in the order of the rows
        for result, (_, (part_near, part_free)) in zip(results, tasks, strict=True):
            n_part_near, n_part_free, energy, load, total = result
            in_near = slice(n_near, n_near + n_part_near)
            in_free = slice(n_free, n_free + n_part_free)
            near.index[in_near] = part_near.index[:n_part_near]
            near.p[in_near] = part_near.p[:n_part_near]
            near.v[in_near] = part_near.v[:n_part_near]
            free.index[in_free] = part_free.index[:n_part_free]
            free.position[in_free] = part_free.position[:n_part_free] + n_near
            n_near += n_part_near
            n_free += n_part_free
            sums.append((energy, load, total))
    return n_near, n_free, *summed(sums)
