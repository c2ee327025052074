"""Group the arrays of the contact solver, so that its compiled loops take a few named groups instead of many arrays.

The state of a point is 0 out of contact (p = 0), 1 if it is elastic (0 < p < H), 2 if it is perfectly plastic (p = H),
and 3 if it yields and hardens (p = H + h u, h > 0). Points with an odd state are free: their pressure is unknown.

A point is near contact if it is in contact, or if v is below a threshold. The solver lists these points, and works on
the lists. The lists of a grid with n points have room for n points; the first `n_near` or `n_free` entries are used.
"""

from typing import Any, NamedTuple


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
    state : state, (n,).
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
    place : position of the point in the lists of `NearPoints`.
    """

    index: Any
    place: Any


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
