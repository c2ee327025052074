"""Fill the undefined values of a map by solving Laplace's equation."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from ..base import Array, Flags, Singles
from .grid import Stencil
from .solvers.elimination import eliminate
from .solvers.hierarchy import levels_of_operator
from .solvers.v_cycle import cycle

#: Largest fraction of undefined values for which Laplace's equation is solved by elimination. On filtered noise of
#: 128 × 256, 256 × 512 and 512² pixels, elimination takes 0.6 of the time of multigrid if a fifth of the values is
#: undefined, about the same time at three tenths, and 1 to 6 times as long at two fifths, because the undefined areas
#: grow together. Elimination also saves compiling the loops of multigrid for large grids.
_LARGEST_ELIMINATED = 0.3
#: Largest number of undefined values for which Laplace's equation is solved by elimination. A single compact area takes
#: 6 to 15 times as long as by multigrid, 1.2 s for 73,000 values.
_MOST_ELIMINATED = 2**15
#: The conjugate gradients stop at this relative residual, or after this number of iterations. The largest error is then
#: about 1e-4 of the range of the defined values.
_RTOL, _MOST_ITERATIONS = 9e-6, 100


def harmonic_fill(values: Array) -> Array:
    """Fill the undefined (NaN) values of a map by solving Laplace's equation with the defined values prescribed.

    The map (n1, n2) is periodic along x2 and has zero normal derivatives at the first row and at the last row. A map
    without any defined value is returned unchanged. Laplace's equation is discretised by a five-point stencil. If few
    values are undefined, it is solved by elimination. Otherwise, it is solved in single precision by conjugate
    gradients, and the preconditioner is one multigrid cycle.
    """
    unknown = np.isnan(values)
    if unknown.all() or not unknown.any():
        return values
    lowest = np.nanmin(values)
    height = np.nanmax(values) - lowest or 1.0
    known = np.where(unknown, 0.0, (values - lowest) / height)
    count = np.count_nonzero(unknown)
    if count <= min(_LARGEST_ELIMINATED * unknown.size, _MOST_ELIMINATED):
        filled = _eliminate_unknown(unknown, known)
    else:
        rhs = unknown * _sum_of_neighbours(known.astype(np.float32))
        filled = np.clip(_solve_laplace(unknown, rhs), 0.0, 1.0)
    return np.where(unknown, lowest + height * filled, values)


def _eliminate_unknown(unknown: Flags, known: Array) -> Array:
    """Solve Laplace's equation at the unknown pixels by elimination.

    known : array (n1, n2), values between 0 and 1 at all other pixels.
    """
    n1, n2 = known.shape
    # a network has an inlet before the first row and an outlet after the last row; here they have no links to the map
    along = np.ones((n1 + 1, n2))
    along[0] = 0.0
    along[-1] = 0.0
    network = Stencil(along, np.ones((n1, n2)), ring2=True)
    potential = np.zeros((n1 + 2, n2))
    potential[1:-1] = known
    eliminate(network, unknown, potential, 1 - potential)
    return potential[1:-1]


def _solve_laplace(unknown: Flags, rhs: Singles) -> Singles:
    """Solve A x = rhs for the discrete Laplace operator A at the unknown pixels, in single precision (n1, n2)."""
    n1, n2 = rhs.shape
    centre = unknown * _sum_of_neighbours(np.ones_like(rhs))
    # (diagonal, link to the right, link to the next row) of each pixel, with a border of one pixel
    operator = np.zeros((3, n1 + 2, n2 + 2))
    operator[0, 1:-1, 1:-1] = centre
    operator[1, 1:-1, 1:-1] = unknown & np.roll(unknown, -1, 1) & (n2 > 1)
    operator[2, 1:-2, 1:-1] = unknown[:-1] & unknown[1:]
    # the border along x2 continues the operator periodically
    operator[:, :, 0] = operator[:, :, -2]
    operator[:, :, -1] = operator[:, :, 1]
    levels, coarsest = levels_of_operator(operator, True)

    def apply_laplace(x: Singles) -> Any:
        """Multiply the values of all pixels, as a vector (n1 n2,), by A."""
        values = x.reshape(n1, n2)
        return (centre * values - unknown * _sum_of_neighbours(values)).ravel()

    def precondition(residual: Singles) -> Singles:
        """Apply one multigrid cycle to a residual (n1 n2,)."""
        # the cycle reads its right-hand side from `b` of the finest level, and writes its result to `r`
        levels[0].b[1:-1, 1:-1] = residual.reshape(n1, n2)
        cycle(levels, coarsest, True)
        return (unknown * levels[0].r[1:-1, 1:-1]).ravel()

    x, _ = cg(
        LinearOperator((rhs.size, rhs.size), apply_laplace, dtype=rhs.dtype),
        rhs.ravel(),
        rtol=_RTOL,
        maxiter=_MOST_ITERATIONS,
        M=LinearOperator((rhs.size, rhs.size), precondition, dtype=rhs.dtype),
    )
    return x.reshape(n1, n2).astype(np.float32, copy=False)


def _sum_of_neighbours(a: Singles) -> Singles:
    """Add up the values of the four neighbours of each pixel.

    The map is periodic along x2. Before the first row and after the last row of the map, the values are 0. In a map
    with a single column, a pixel has no neighbours along x2.
    """
    total = np.zeros_like(a)
    if a.shape[1] > 1:
        total += np.roll(a, 1, 1)
        total += np.roll(a, -1, 1)
    total[1:] += a[:-1]
    total[:-1] += a[1:]
    return total
