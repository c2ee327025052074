"""Fields continued over gaps in them by Laplace's equation: of what is known the smoothest, wherever the grid is cut.

Links of five points between unknown pixels, and to the known ones beside them; conjugate gradients with a cycle of
multigrid over blocks of 2 × 2 pixels, in single precision. The coarse links of a block are the sum of its own, halved
as those of a grid of twice the spacing. Source: Braess, Computing 55, 1995, 379 (over-correction).
"""

import numpy as np

from ..base import Array
from ..base.arrays import Flags, Singles
from ..base.compiled import REORDERED, compiled

#: Right and lower link, and sum of all links with those to known pixels, of every pixel (n1, n2); 0 where it is known.
Links = tuple[Singles, Singles, Singles]
#: Error in the norm of the energy at which the iteration ends, over that of zeros, and most iterations.
_RTOL, _MOST = 1e-5, 100
#: Fraction of the sum of links that coarse ones have.
_COARSE = np.float32(0.5)


def harmonic_fill(values: Array, start: Array) -> Array:
    """Values (n1, n2) with those that are NaN continued by Δp = 0 from those that are known.

    The grid is periodic along x2, and nothing passes its ends along x1. Without any known value all stay NaN. `start`
    (n1, n2) is near to the result, which does not depend on it but for the error of the iteration.
    """
    unknown = np.isnan(values)
    if unknown.all() or not unknown.any():
        return values
    known = values[~unknown]
    lowest, height = float(known.min()), float(np.ptp(known))
    if height == 0.0:
        return np.full(values.shape, lowest)
    links, right_side = _finest(
        unknown, np.where(unknown, 0.0, (values - lowest) / height).astype(np.float32)
    )
    first = np.where(unknown, (start - lowest) / height, 0.0).astype(np.float32)
    found = _solve(_levels(links), right_side, first)
    return np.where(unknown, lowest + height * np.clip(found, 0.0, 1.0), values)


def _levels(links: Links) -> list[Links]:
    """Links of all grids, down to one of a single block."""
    levels = [links]
    while levels[-1][0].size > 1:
        levels.append(_coarser(*levels[-1]))
    return levels


def _solve(levels: list[Links], b: Singles, x: Singles) -> Singles:
    """Solve A x = b by conjugate gradients from x on."""
    allowed = _RTOL**2 * float(np.vdot(b, _cycle(levels, b)))
    r = b - _flow_out(*levels[0], x)
    z, p, former = _cycle(levels, r), np.zeros_like(b), np.inf
    for _ in range(_MOST):
        product = float(np.vdot(r, z))
        if not product > allowed:
            break
        p = z + np.float32(product / former) * p
        flow = _flow_out(*levels[0], p)
        step = np.float32(product / float(np.vdot(p, flow)))
        x += step * p
        r -= step * flow
        z, former = _cycle(levels, r), product
    return x


def _cycle(levels: list[Links], b: Singles, k: int = 0) -> Singles:
    """About A⁻¹ b on grid k: a sweep, the correction of the next grid, and the sweep backwards."""
    x = np.zeros_like(b)
    _sweep(*levels[k], b, x, False)
    if k + 1 < len(levels):
        coarse = _summed(b - _flow_out(*levels[k], x), levels[k + 1][0].shape)
        _add(_cycle(levels, coarse, k + 1), levels[k][2], x)
        _sweep(*levels[k], b, x, True)
    return x


@compiled(**REORDERED)
def _finest(unknown: Flags, values: Singles) -> tuple[Links, Singles]:
    """Links of the pixels, and the sum of the known values beside each unknown one."""
    n1, n2 = unknown.shape
    right, below, total = np.zeros_like(values), np.zeros_like(values), np.zeros_like(values)
    known = np.zeros_like(values)
    for i in range(n1):
        for j in range(n2):
            for s in range(2):
                a, b = (i, (j + 1) % n2) if s == 0 else (i + 1, j)
                if a == n1 or (s == 0 and n2 == 1):
                    continue
                one, other = unknown[i, j], unknown[a, b]
                if one and other:
                    if s == 0:
                        right[i, j] = 1.0
                    else:
                        below[i, j] = 1.0
                if one:
                    total[i, j] += 1.0
                    known[i, j] += values[a, b]
                if other:
                    total[a, b] += 1.0
                    known[a, b] += values[i, j]
    return (right, below, total), known


@compiled(**REORDERED)
def _coarser(right: Singles, below: Singles, total: Singles) -> Links:
    """Links of blocks of 2 × 2."""
    n1, n2 = total.shape
    m1, m2 = (n1 + 1) // 2, (n2 + 1) // 2
    to_right, to_below, whole = np.zeros((3, m1, m2), np.float32)
    for i in range(n1):
        for j in range(n2):
            a, b = i // 2, j // 2
            whole[a, b] += _COARSE * total[i, j]
            if (j % 2 == 0 and j + 1 < n2) or m2 == 1:
                whole[a, b] -= 2 * _COARSE * right[i, j]
            else:
                to_right[a, b] += _COARSE * right[i, j]
            if i % 2 == 0:
                whole[a, b] -= 2 * _COARSE * below[i, j]
            else:
                to_below[a, b] += _COARSE * below[i, j]
    return to_right, to_below, whole


@compiled(**REORDERED)
def _flow_out(right: Singles, below: Singles, total: Singles, x: Singles) -> Singles:
    """A x: what flows out of every pixel."""
    n1, n2 = x.shape
    y = np.zeros_like(x)
    for i in range(n1):
        above, here, after = (
            x[i - 1],
            x[i],
            x[i + 1 if i + 1 < n1 else 0],
        )  # the last row has no links to the first
        up, down, beside, own, out = below[i - 1], below[i], right[i], total[i], y[i]
        for j in range(n2):
            if own[j] > 0.0:
                k, m = j - 1 if j > 0 else n2 - 1, j + 1 if j + 1 < n2 else 0
                out[j] = (
                    own[j] * here[j] - beside[j] * here[m] - beside[k] * here[k] - up[j] * above[j]
                )
                out[j] -= down[j] * after[j]
    return y


@compiled(**REORDERED)
def _sweep(
    right: Singles, below: Singles, total: Singles, b: Singles, x: Singles, back: bool
) -> None:
    """Solve for one pixel after the other, forwards or backwards."""
    n1, n2 = x.shape
    for row in range(n1):
        i = n1 - 1 - row if back else row
        above, here, after = x[i - 1], x[i], x[i + 1 if i + 1 < n1 else 0]
        up, down, beside, own, known = below[i - 1], below[i], right[i], total[i], b[i]
        for column in range(n2):
            j = n2 - 1 - column if back else column
            if own[j] > 0.0:
                k, m = j - 1 if j > 0 else n2 - 1, j + 1 if j + 1 < n2 else 0
                into = known[j] + up[j] * above[j] + down[j] * after[j]
                here[j] = (into + beside[j] * here[m] + beside[k] * here[k]) / own[j]


@compiled()
def _summed(r: Singles, shape: tuple[int, int]) -> Singles:
    """Sums over blocks."""
    found = np.zeros(shape, np.float32)
    for i in range(r.shape[0]):
        for j in range(r.shape[1]):
            found[i // 2, j // 2] += r[i, j]
    return found


@compiled()
def _add(coarse: Singles, total: Singles, x: Singles) -> None:
    """Add the correction of every block to its unknown pixels."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            if total[i, j] > 0.0:
                x[i, j] += coarse[i // 2, j // 2]
