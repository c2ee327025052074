"""Compile the loops that copy points and waves for the transforms in `convolution`, and multiply waves by weights."""

import numpy as np

from ..base.compiled import compiled

contracted = compiled(fastmath={"contract"})


@compiled(
    fastmath={"contract", "nnan", "nsz"}
)  # the imaginary parts of the weights, 0, are left out
def multiply(block, weights):
    """Multiply the waves in a block (columns, waves) by their weights (columns, waves)."""
    for j in range(block.shape[0]):
        for i in range(block.shape[1]):
            block[j, i] *= weights[j, i]


@compiled(fastmath={"contract", "nnan", "nsz"})
def multiply_mixing(block, n, first, count, weights, twisted, turn1, turn2):
    """Turn the pressure waves in a block into displacement waves, for a compliance K that mixes waves.

    Cosine coefficients C and waves V are related by C(k) = ē V(k) + e V(N − k), with e = exp(iπk/2N) and its complex
    conjugate ē, and by 2 V(k) = e (C(k) − i C(N − k)). If C(k) is multiplied by a symbol S(k), V(k) becomes

        V(k) ← ½(S(k) + S(N − k)) V(k) + ½(S(k) − S(N − k)) e² V(N − k).

    If both axes are mirrors, V(k1, N − k2) is the complex conjugate of V(N − k1, k2).

    Parameters
    ----------
    block : array (columns, >= n)
        Waves of some columns; the function overwrites them.
    n : int
        Number of waves of a column.
    first, count : int
        Index of the first column, and number of columns.
    weights : array
        Weights from `convolution.mixing_weights`.
    twisted : bool
        Whether each column has two rows in the block: even-numbered waves in the first half of the block, odd-numbered
        waves in the second half. In a row of odd-numbered waves, position n − 1 − k is paired with position k.
    turn1, turn2 : array
        Factors e² = exp(iπk/N) of the waves k: `turn1` along the first axis, `turn2` along the second axis.
    """
    has_mirror = len(weights) > 1
    # waves N − k of a column, for the waves k of its first half
    other = np.empty(n // 2 + 1, block.dtype)
    for odd in range(2 if twisted else 1):
        half = (n - odd) // 2 + 1  # number of waves k; the wave n − odd − k belongs to each of them
        # the weights of the odd waves come after those of the even waves
        first_weight = odd * (n // 2 + 1)
        in_weights = slice(first_weight, first_weight + half)
        first_paired = 1 - odd  # the mean, among the even waves, is its own conjugate
        for j in range(count):
            row = block[odd * (block.shape[0] // 2) + j]
            k = first + j  # number of the column, which is the wave along the second axis
            w0 = weights[0, k, in_weights]
            if not has_mirror:
                for i in range(half):
                    row[i] *= w0[i]
                for i in range(half, n):
                    row[i] *= w0[n - odd - i]
                continue
            w1 = weights[1, k, in_weights]
            w2 = weights[2, k, in_weights]
            w12 = weights[3, k, in_weights]
            turn = turn2[k]
            other[0] = row[0]
            for i in range(first_paired, half):
                other[i] = row[n - odd - i]
            for i in range(half):
                a = row[i]  # V(k)
                b = other[i]  # V(N − k)
                c = w0[i] * a
                d = w0[i] * b
                f = turn1[i] * b
                g = turn1[i] * a.conjugate()
                c += w1[i] * f + turn * (w2[i] * b.conjugate() + w12[i] * g)
                d += w1[i] * g.conjugate()
                d += turn * (w2[i] * a.conjugate() + w12[i] * f.conjugate())
                row[i] = c
                other[i] = d
            for i in range(first_paired, half):
                row[n - odd - i] = other[i]


@contracted
def copy_in_order(points, staged, order1, order2, first, end):
    """Copy the points to the rows `first` to `end` − 1 of `staged` in the order of the transform, and append zeros.

    Parameters
    ----------
    points : array (n1, n2)
        Values in the order of the grid.
    staged : array (n1, >= n2)
        Array to which the points are copied. The rows of `staged` are transformed afterwards.
    order1, order2 : array
        Grid indices of the rows, and of the points in each row, in the order of the transform.
    first, end : int
        Index of the first row, and index of the last row plus 1.
    """
    n2 = order2.size
    for i in range(first, end):
        row = points[order1[i]]
        for j in range(n2):
            staged[i, j] = row[order2[j]]
        staged[i, n2:] = 0


@contracted
def copy_back(staged, points, order1, order2, first, end):
    """Copy the rows `first` to `end` − 1 of `staged` back to the order of the grid: the inverse of `copy_in_order`.

    `staged` and `points` may share memory: each row of `staged` is buffered before the corresponding row of `points` is
    written.
    """
    staged_row = np.empty(order2.size, staged.dtype)
    for i in range(first, end):
        for j in range(order2.size):
            staged_row[j] = staged[i, j]
        row = points[order1[i]]
        for j in range(order2.size):
            row[order2[j]] = staged_row[j]


@contracted
def copy_columns(columns, block, twist, order):
    """Copy columns into the rows of a block, reordering the points for the transform.

    If the first axis is free, `twist` is not empty, and each column has two rows in the block. The row in the first
    half of the block contains the points, and its transform gives the even-numbered waves. The row in the second
    half contains the points multiplied by `twist`, and its transform gives the odd-numbered waves. Zeros are
    appended to both rows.

    columns : array (n1, columns), transforms of the rows of the grid.
    block : array (columns, >= n1), or (2 columns, >= n1) if `twist` is given.
    twist : array (n1,), factors exp(−iπj/m) of the points j, where 2m is the padded length; empty if the axis has a
        single transform.
    order : array (n1,), grid indices of the points in the order of the transform.
    """
    n1, count = columns.shape
    second_half = block.shape[0] // 2  # first row of the second half of the block
    for i in range(n1):
        row = columns[order[i]]
        for j in range(count):
            block[j, i] = row[j]
        if twist.size:
            for j in range(count):
                block[second_half + j, i] = row[j] * twist[i]
    if twist.size:  # only such axes are padded
        for j in range(count):
            block[j, n1:] = 0
            block[second_half + j, n1:] = 0


@contracted
def copy_columns_back(columns, block, twist, order):
    """Copy the rows of a block back to columns: the inverse of `copy_columns`.

    If `twist` is not empty, each point is the sum of two values. One is taken from the row in the first half of the
    block. The other is taken from the row in the second half, and multiplied by the complex conjugate of `twist`.
    """
    n1, count = columns.shape
    second_half = block.shape[0] // 2  # first row of the second half of the block
    for i in range(n1):
        row = columns[order[i]]
        if twist.size:
            for j in range(count):
                row[j] = block[j, i] + block[second_half + j, i] * np.conj(twist[i])
        else:
            for j in range(count):
                row[j] = block[j, i]
