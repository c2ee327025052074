"""Compile the loop that projects pressures near contact onto a curved contact law, and finds the tangents.

The contact law of a point is H(u + u₀) − p_f. The curve H(w) consists of cubic pieces (`CurvePieces`), u₀ is the
plastic deformation from an earlier load, and p_f the pressure of a fluid. The trial pressure is z = x + cδ with
x = p − c v. If the point yields, its projected pressure y and its total plastic deformation w = u + u₀ satisfy

    H(w) + c w = z + p_f + c u₀,    y = H(w) − p_f.

Unless dH/dw < −c, H(w) + c w increases with w, and the equation has a single solution w. The curve of the point is
replaced by its tangent at u, or by a horizontal line where the law softens. The other loops of the contact solver work
with these straight lines instead of the curve.

If a steep tangent were extended back to u = 0, it would give a negative pressure there. A steep tangent is therefore
only used from a depth b > 0 on. The solver adds b to h₁ and v of the point, and works with the plastic deformation
u − b.
"""

from typing import Any, NamedTuple

import numpy as np

from .law_at_points import value_at
from .loop_decorators import exact, exact_loop
from .point_arrays import ELASTIC, HARDENING, PLASTIC

#: A steep tangent begins where its pressure is this fraction of the yield pressure below the point of tangency.
FROM_DEPTH = 0.5
#: Smallest slope of a tangent, relative to c. Points with a smaller slope are treated as perfectly plastic.
_FLAT = 1e-9
#: Newton's method ends after a step that is shorter than this fraction of a piece, and at the latest after this number
#: of steps. Because each step squares the error, the result after the last step is accurate to about 14 digits.
_CLOSE, _STEPS = 1e-7, 60
#: Line that replaces the curve of a point: the constant hardness at the beginning of the curve (if z is small), a
#: tangent, the constant hardness at the end of the curve, or a horizontal line where the curve falls or is flat.
FIRST, TANGENT, END, HORIZONTAL = 0, 1, 2, 3


class ShiftedCurve(NamedTuple):
    """Contact law H(u + u₀) − p_f of all points: the cubic pieces of the curve H(w), and u₀ and p_f of the points.

    depth : deformation w at the beginning of each cubic piece of the curve [m].
    levels : H(w) + c w at the beginning of each cubic piece [Pa].
    coefficients : coefficients of each cubic piece, see `CurvePieces`.
    has_end : whether the last piece of the curve is constant.
    constant_depth : depth [m] up to which H(w) is constant.
    earlier : earlier plastic deformation u₀ [m], with one value for all points (1,) or one for each point (n,).
    fluid : fluid pressure p_f [Pa], with one value for all points (1,) or one for each point (n,).
    first_hardness : hardness H(u₀) − p_f [Pa], (1,) or (n,).
    """

    depth: Any
    levels: Any
    coefficients: Any
    has_end: Any
    constant_depth: Any
    earlier: Any
    fluid: Any
    first_hardness: Any


class CurveLines(NamedTuple):
    """Line that replaces the curve of each point, as arrays (n,).

    kind : kind of the line: FIRST, TANGENT, END or HORIZONTAL.
    hardness, slope : hardness [Pa] and hardening modulus [Pa/m] of the line.
    begins : depth b [m] from which the tangent applies.
    gap0 : undeformed gap h₁ + b [m].
    """

    kind: Any
    hardness: Any
    slope: Any
    begins: Any
    gap0: Any


class PointLine(NamedTuple):
    """Line that replaces the curve of a single point.

    kind, hardness, slope : as in `CurveLines`.
    begin : depth b [m] from which a tangent applies; 0 for all other kinds of lines.
    """

    kind: Any
    hardness: Any
    slope: Any
    begin: Any


@exact
def deformation_at(z, c, curve):
    """Solve H(w) + c w = z for the deformation w by Newton's method within a bracket.

    Returns the deformation w, the hardness H(w) and the slope dH/dw.
    """
    depth = curve.depth
    levels = curve.levels
    coefficients = curve.coefficients
    # bisection: the last piece with `levels` <= z contains the solution
    piece = 0
    end = depth.size
    while end - piece > 1:
        middle = (piece + end) // 2
        if levels[middle] <= z:
            piece = middle
        else:
            end = middle
    # With s = w − depth[piece], the curve is H = a0 + a1 s + a2 s² + a3 s³, and the equation
    # s (c + a1 + a2 s + a3 s²) = z − levels[piece].
    a0 = coefficients[piece, 0]
    a1 = coefficients[piece, 1]
    a2 = coefficients[piece, 2]
    a3 = coefficients[piece, 3]
    rest = z - levels[piece]
    s = rest / (a1 + c)  # solution in a linear piece, otherwise the first guess
    if piece + 1 < depth.size and (a2 != 0.0 or a3 != 0.0):
        width = depth[piece + 1] - depth[piece]
        low = 0.0
        high = width
        s = min(max(s, low), high)
        for _ in range(_STEPS):
            excess = s * (c + a1 + s * (a2 + s * a3)) - rest
            if excess > 0.0:
                high = s
            else:
                low = s
            new = s - excess / (c + a1 + s * (2.0 * a2 + s * 3.0 * a3))
            if not low <= new <= high:  # outside the bracket: bisect
                new = 0.5 * (low + high)
            is_close = abs(new - s) <= _CLOSE * width
            s = new
            if is_close:
                break
    hardness = a0 + s * (a1 + s * (a2 + s * a3))
    slope = a1 + s * (2.0 * a2 + s * 3.0 * a3)
    return depth[piece] + s, hardness, slope


@exact
def line_at(w, y, slope, c, u0):
    """Return the `PointLine` that replaces the curve of a point: its tangent, or a horizontal line if the curve falls.

    w, y : deformation [m] and pressure H(w) − p_f [Pa] of the point.
    slope : slope dH/dw [Pa/m].
    u0 : earlier plastic deformation u₀ [m].
    """
    if slope < _FLAT * c:
        return PointLine(HORIZONTAL, y, 0.0, 0.0)
    # the tangent begins where its pressure is by `FROM_DEPTH` lower than y, or at u = 0
    begin = max(w - u0 - FROM_DEPTH * y / slope, 0.0)
    return PointLine(TANGENT, y - slope * (w - u0 - begin), slope, begin)


# Arrays are read and written in the loop itself and in `deformation_at`. With further functions between them, Numba
# counts the references to all arrays at each point, and the loop takes 1.5 to 2.5 times as long.
@exact_loop
def follow_curve(first, end, c, delta, points, near, curve, lines):
    """Project the trial pressures of some points near contact, compare p with the projections y, and set the tangents.

    points, near : groups of arrays, see `point_arrays`.
    curve : ShiftedCurve of the contact law.
    lines : CurveLines, which the function updates.

    Returns
    -------
    total : sum Σ y of the projected pressures.
    slopes : derivative of Σ y with respect to cδ. At points where the curve falls, dy/dz is taken as 0.
    n_tangents : number of points whose tangent has a positive slope.
    squared_difference, squared_projection : ‖p − y‖² and ‖y‖².
    n_changed : number of points whose state would change if p were set to y. Perfectly plastic points whose pressure
        differs from y are counted as well.
    squared_change : sum of (p − y)² over the points counted in `n_changed`; infinite if a point that has been hardening
        would stop hardening.
    """
    index = near.index[first:end]
    p = near.p[first:end]
    v = near.v[first:end]
    trial = near.trial[first:end]
    state = points.state
    v_of_grid = points.v.ravel()
    columns = state.size // points.v.shape[0]
    unused = points.v.shape[1] - columns  # unused values at the end of each row of v
    shift = c * delta
    is_uniform = curve.first_hardness.size + curve.earlier.size + curve.fluid.size == 3
    H = curve.first_hardness[0]
    u0 = curve.earlier[0]
    pf = curve.fluid[0]
    # trial pressure up to which the point remains within the part of the curve with constant hardness
    threshold = H + c * max(curve.constant_depth - u0, 0.0)
    end_hardness = curve.coefficients[curve.levels.size - 1, 0]
    end_level = curve.levels[curve.levels.size - 1]
    total = 0.0
    slopes = 0.0
    n_tangents = 0
    squared_difference = 0.0
    squared_projection = 0.0
    n_changed = 0
    squared_change = 0.0
    for j in range(end - first):
        i = index[j]
        former_kind = lines.kind[i]
        former_begin = lines.begins[i] if former_kind == TANGENT else 0.0
        # trial pressure; v of a point with a tangent has been increased by b, which is subtracted here
        x = p[j] - c * (v[j] - former_begin)
        z = x + shift
        if not is_uniform:
            H = value_at(curve.first_hardness, i)
            u0 = value_at(curve.earlier, i)
            pf = value_at(curve.fluid, i)
            threshold = H + c * max(curve.constant_depth - u0, 0.0)
        # projection on the constant hardness, and state of the point: SEPARATED, ELASTIC or PLASTIC
        y = min(max(z, 0.0), H)
        new_state = (z > 0.0) + (z >= H)
        if z > threshold or former_kind != FIRST:  # the line of the point may change
            if z > threshold:
                level = z + pf + c * u0  # right side of the equation for w
                if curve.has_end and level >= end_level:
                    y = end_hardness - pf
                    line = PointLine(END, y, 0.0, 0.0)
                else:
                    w, hardness, slope = deformation_at(level, c, curve)
                    y = hardness - pf
                    line = line_at(w, y, slope, c, u0)
            else:
                line = PointLine(FIRST, H, 0.0, 0.0)
            if line.kind == TANGENT:
                new_state = HARDENING
                n_tangents += 1
                slopes += line.slope / (line.slope + c)
            lines.kind[i] = line.kind
            lines.hardness[i] = line.hardness
            lines.slope[i] = line.slope
            if line.kind == TANGENT:
                lines.begins[i] = line.begin
            increase = line.begin - former_begin
            if increase != 0.0:  # the gap and v of the point are increased by b
                v[j] += increase
                lines.gap0[i] += increase
                v_of_grid[i + i // columns * unused] += increase
            x -= c * line.begin
        trial[j] = x
        slopes += new_state == ELASTIC  # dy/dz is 1 at an elastic point
        total += y
        difference = y - p[j]
        squared_difference += difference * difference
        squared_projection += y * y
        if new_state != state[i] or (new_state == PLASTIC and difference != 0.0):
            n_changed += 1
            squared_change += np.inf if state[i] == HARDENING else difference * difference
    return (
        total,
        slopes,
        n_tangents,
        squared_difference,
        squared_projection,
        n_changed,
        squared_change,
    )
