"""What the compiled loops of the contact solver share: state, lists and fields of the points of a grid.

State of a point: 0 out of contact (p = 0), 1 elastic (0 < p < H), 2 perfectly plastic (p = H), 3 yielding on a slope
h > 0 (p = H + h u). Odd ones are free. Lists hold a number of points that a kernel returns or is given.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Rows of `Points.lists`: indices of the points near contact, of the free ones, and of these in the first list.
NEAR, FREE, PLACE = range(3)
#: Rows of `Points.near`: x = p − c v, p, v = Kp + h₁ and Kd of the points near contact, in the order of their list.
X, P, V, KD = range(4)
#: Rows of `Points.on_free`: residual r, preconditioned residual w, direction d and M1 of the free points, in the order
#: of their list; their compliance a (1/h in state 3, else 0) and scale s = 1/√(1 + a m), m the largest entry of the
#: stencil: a point that yields on a slope is softer by a, and the preconditioner is s M s.
R, W, D, ONES, SOFT, SCALE = range(6)


class Points(NamedTuple):
    """State (n,) of the points of a grid, lists (3, n) of some, and what belongs to these: near (4, n), on_free (6, n).

    dense : on all points of the grid, 0 where a point is not free: first what the stencil is applied to, then d.
    """

    state: NDArray[np.int8]
    lists: NDArray[np.int32]
    near: NDArray[np.float64]
    on_free: NDArray[np.float64]
    dense: NDArray[np.float32]


class Line(NamedTuple):
    """Hardness H and slope h, of one value or one per point, see `law.YieldLine`."""

    hardness: NDArray[np.float64]
    slope: NDArray[np.float64]


class Stencil(NamedTuple):
    """Weights of a stencil of 3 × 3 points or fewer; index of each row and column of the padded grid, −1 outside."""

    weights: NDArray[np.float64]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
