"""Perform the steps of the conjugate gradients on the rows of a grid, in the order in which `multigrid` calls them.

The potential and the residual are in double precision, the search direction and the result of a multigrid cycle in
single precision. The operator is applied to differences of the search direction. All fields have a border of one node
on each side, except for the potential, which only has a border along the first axis.
"""

from __future__ import annotations

import numpy as np

from ...base.compiled import REORDERED, by_rows, inner


@by_rows(**{**REORDERED, "fastmath": False})
def set_initial_potential(first, end, x, r, b, along, potential, inverse):
    """Set the initial potential x and its residual r, and copy r to the right-hand side b of the first cycle.

    The initial potential is constant along each row. Of all potentials that are constant along each row, the initial
    potential has the lowest energy.

    potential : tuple (row_drop, row_potential): the drop of the initial potential from each row of nodes to the next,
        and the initial potential of each row.
    """
    row_drop, row_potential = potential
    n2 = along.shape[1]
    for i in range(first, end):
        for j in range(n2):
            if inverse[i, j + 1] > 0.0:
                x[i, j] = row_potential[i]
        # flow to the next row, and flow from the previous row
        for j in range(n2):
            r[i, j + 1] -= along[i, j] * row_drop[i]
        for j in range(n2):
            r[i, j + 1] += along[i - 1, j] * row_drop[i - 1]
        for j in range(1, n2 + 1):
            b[i, j] = r[i, j]


@by_rows(**REORDERED)
def sum_products(first, end, z, r, field, ignored, sums):
    """Compute r·z for some rows, and also the largest |z| in each row if the potential itself has to be accurate.

    z is the result M⁻¹r of a multigrid cycle. Ignored nodes do not count for the largest |z|.
    """
    for i in range(first, end):
        total = 0.0
        largest = 0.0
        for j in range(1, z.shape[1] - 1):
            total += r[i, j] * z[i, j]
        if field < np.inf:
            for j in range(1, z.shape[1] - 1):
                if ignored.size == 0 or not ignored[i - 1, j - 1]:
                    largest = max(largest, abs(z[i, j]))
        sums[0, i] = total
        sums[1, i] = largest


@by_rows(**REORDERED)
def update_direction(first, end, p, z, scale, beta):
    """Compute the next search direction p = scale z + β p on some rows."""
    for i in range(first, end):
        for j in range(1, p.shape[1] - 1):
            p[i, j] = scale * z[i, j] + beta * p[i, j]


@by_rows(**REORDERED)
def sum_curvature(first, end, p, network, a_p, sums):
    """Compute p·A p for some rows, and store the result for each row in `sums[0]`.

    a_p : array for the product A p, of the shape of p; or an empty array if A p is not to be stored.
    """
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        row = a_p[i] if a_p.size > 0 else y
        _apply_to_row(network, p, i, flow_to_right, row)
        total = 0.0
        for j in range(1, n2 + 1):
            total += row[j] * p[i, j]
        sums[0, i] = total


@by_rows(**REORDERED)
def update_solution(first, end, x, fields, network, steps, sums):
    """Perform the step x += step p, r −= step A p on some rows, and compute b = r / scale.

    For each row, Σr is written to `sums[0]`, and Σ r x to `sums[1]`. The total of Σr over all rows is the difference
    between inflow and outflow. The total of Σ r x over all rows is the difference between flow and energy.

    fields : tuple of the residual r, the right-hand side b of the next cycle, the search direction p, and the product
        A p. If the array for A p is empty, A p is computed again.
    steps : tuple (step length, `scale`). The right-hand side b is r divided by `scale`.
    """
    r, b, p, a_p = fields
    step, scale = steps
    n2 = p.shape[1] - 2
    y = np.empty(n2 + 2)
    flow_to_right = np.empty(n2 + 1)
    for i in range(first, end):
        row = a_p[i] if a_p.size > 0 else y
        if a_p.size == 0:
            _apply_to_row(network, p, i, flow_to_right, row)
        x_row, r_row, p_row, b_row = x[i], r[i], p[i], b[i]
        sum_r = 0.0
        sum_rx = 0.0
        for j in range(1, n2 + 1):
            value = x_row[j - 1] + step * p_row[j]  # x has no border along the row
            residual = r_row[j] - step * row[j]
            x_row[j - 1] = value
            r_row[j] = residual
            sum_r += residual
            sum_rx += residual * value
        for j in range(1, n2 + 1):
            b_row[j] = r_row[j] / scale
        sums[0, i] = sum_r
        sums[1, i] = sum_rx


@inner(**REORDERED)
def _apply_to_row(network, p, i, flow_to_right, y):
    """Compute row i of the product A p from differences of p, and write the row to y.

    The arrays p and y have a border of one node on each side; the conductances have no border. At the inlet and at the
    outlet, the border of p is 0. The work array `flow_to_right` contains the flow from each node of the row to the next
    node. Separate loops over few arrays compile to vector instructions, and take a third of the time of a single loop.
    """
    along, across, ring = network
    n2 = along.shape[1]
    to_above, to_below, to_right = along[i - 1], along[i], across[i - 1]
    p_above, p_here, p_below = p[i - 1], p[i], p[i + 1]
    for j in range(1, n2):
        flow_to_right[j] = to_right[j - 1] * (np.float64(p_here[j]) - p_here[j + 1])
    # flow over the seam of a ring, which leaves the last node of the row and enters the first node
    seam = to_right[n2 - 1] * (np.float64(p_here[n2]) - p_here[1]) if ring else 0.0
    flow_to_right[0] = seam
    flow_to_right[n2] = seam
    for j in range(1, n2 + 1):
        value = np.float64(p_here[j])
        y[j] = (
            to_above[j - 1] * (value - p_above[j])
            + to_below[j - 1] * (value - p_below[j])
            + (flow_to_right[j] - flow_to_right[j - 1])
        )
