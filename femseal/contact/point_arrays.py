"""Group the arrays of the contact solver, so that its compiled loops take a few named groups instead of many arrays.

Points that are elastic or that harden are called free: their pressure is unknown. The pressure of all other points is
given by their state, 0 or the hardness H.

A point is near contact if it is in contact, or if v is below a threshold. The solver lists these points, and works on
the lists. The lists of a grid with n points have room for n points; the first `n_near` or `n_free` entries are used.
"""

from typing import Any, NamedTuple

#: States of a point: out of contact (p = 0), elastic (0 < p < H), perfectly plastic (p = H), or yielding and hardening
#: (p = H + h u, h > 0). The bit FREE is set in the states of free points.
SEPARATED, ELASTIC, PLASTIC, HARDENING = 0, 1, 2, 3
FREE = 1


class LinearLaw(NamedTuple):
    """Linear contact law H + h u, with one value for all points (1,) or one for each point (n,).

    hardness : hardness H [Pa].
    slope : hardening modulus h [Pa/m].
    """

    hardness: Any
    slope: Any


class GridPoints(NamedTuple):
    """Values of all points of a grid.

    p : pressure [Pa], (n,).
    v : displacement plus undeformed gap, v = Kp + h₁ [m], (n1, >= n2); each row may end with unused values.
    state : SEPARATED, ELASTIC, PLASTIC or HARDENING, (n,).
    dense : search direction d or other values to which the stencil of the preconditioner is applied, (n,) in single
        precision; 0 at points that are not free.
    kd : displacement due to the pressure `dense` for a half-space of unit modulus, (n1, >= n2) in single precision. It
        uses the same memory as v.
    """

    p: Any
    v: Any
    state: Any
    dense: Any
    kd: Any


class NearPoints(NamedTuple):
    """Lists of the points near contact, in the order of the grid.

    index : index of the point on the grid.
    p, v : pressure [Pa], and displacement plus undeformed gap [m].
    trial : x = p − c v, or the projected pressure [Pa].
    response : displacement Kd due to the search direction [m].
    """

    index: Any
    p: Any
    v: Any
    trial: Any
    response: Any


class FreePoints(NamedTuple):
    """Lists of the free points, in the order of the grid.

    index : index of the point on the grid.
    position : position of the point in the lists of `NearPoints`.
    """

    index: Any
    position: Any


class GradientLists(NamedTuple):
    """Values of the conjugate gradients at the free points, in the order of `FreePoints`.

    r, w, d : residual, preconditioned residual and search direction.
    ones : M1, the preconditioner applied to a vector of ones.
    hardening_compliance : compliance a = 1/h [m/Pa] of a point that yields and hardens, and 0 for an elastic point.
    scale : factor s = 1/√(1 + a m), where m is the middle weight of the stencil M. With hardening, the preconditioner
        is s M s; the factor s accounts for the compliance a.
    """

    r: Any
    w: Any
    d: Any
    ones: Any
    hardening_compliance: Any
    scale: Any


class Preconditioner(NamedTuple):
    """Stencil M that approximates the inverse of K, for grids of every kind of boundary.

    weights : weights of the stencil [Pa/m], (3, 3).
    rows : grid rows that correspond to the row numbers −1 to n1, (n1 + 2,). The row numbers −1 and n1 lie outside the
        grid. On a periodic or mirror axis they correspond to rows of the grid, on a free axis they are marked by −1.
    columns : grid columns that correspond to the column numbers −1 to n2, (n2 + 2,), defined like `rows`.
    """

    weights: Any
    rows: Any
    columns: Any
