"""Fields continued over gaps in them by Laplace's equation: of what is known the smoothest, wherever the grid is cut.

Links of five points between unknown pixels, and to the known ones beside them; conjugate gradients with the cycle of
`solvers.multigrid`.
"""

import numpy as np

from ..base import Array, Flags, Singles
from .solvers.hierarchy import levels_of
from .solvers.multigrid import cycle

#: Error in the norm of the energy at which the iteration ends, over that of zeros, and most iterations.
_RTOL, _MOST = 1e-5, 100


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
    right_side = _beside(np.where(unknown, 0.0, (values - lowest) / height).astype(np.float32))
    first = ((start - lowest) / height).astype(np.float32)
    found = _solve(unknown, unknown * right_side, unknown * first)
    return np.where(unknown, lowest + height * np.clip(found, 0.0, 1.0), values)


def _solve(unknown: Flags, b: Singles, x: Singles) -> Singles:
    """Solve A x = b at the unknown pixels by conjugate gradients from x on."""
    n1, n2 = b.shape
    centre = unknown * _beside(np.ones_like(b))
    operator = np.zeros((3, n1 + 2, n2 + 2))
    operator[0, 1:-1, 1:-1] = centre
    operator[1, 1:-1, 1:-1] = unknown & np.roll(unknown, -1, 1) & (n2 > 1)
    operator[2, 1:-2, 1:-1] = unknown[:-1] & unknown[1:]
    operator[:, :, 0], operator[:, :, -1] = operator[:, :, -2], operator[:, :, 1]
    levels, coarsest = levels_of(operator, True)
    allowed = _RTOL**2 * float(np.vdot(b, b)) / 4
    r = b - centre * x + unknown * _beside(x)
    p, former = np.zeros_like(b), np.inf
    for _ in range(_MOST):
        levels[0].b[1:-1, 1:-1] = r
        cycle(levels, coarsest, True)
        z = unknown * levels[0].r[1:-1, 1:-1]
        product = float(np.vdot(r, z))
        if not product > allowed:
            break
        p = z + np.float32(product / former) * p
        flow = centre * p - unknown * _beside(p)
        step = np.float32(product / float(np.vdot(p, flow)))
        x, r, former = x + step * p, r - step * flow, product
    return x


def _beside(a: Singles) -> Singles:
    """Sum of a over the pixels beside each one."""
    total = np.zeros_like(a)
    if a.shape[1] > 1:
        total += np.roll(a, 1, 1)
        total += np.roll(a, -1, 1)
    total[1:] += a[:-1]
    total[:-1] += a[1:]
    return total
