"""Compile the loop that projects the pressure of the points near contact on a curved law, and finds their tangents.

The law of a point is H(u + u₀) − p_f, where the curve H(w) consists of cubic pieces (`CurvePieces`), u₀ is the plastic
deformation from an earlier load, and p_f the pressure of a fluid. With x = p − c v, the projection y of the trial
pressure z = x + cδ and the plastic deformation w = u + u₀ satisfy

    H(w) + c w = z + p_f + c u₀,    y = H(w) − p_f.

The left side increases with w, unless the law softens more steeply than −c. The point then gets the tangent of its law
at u, or a horizontal line if the law softens. The other loops of the solver only see these straight lines.

A steep tangent would have a negative pressure at u = 0. It therefore begins at a depth b, by which the gap of the point
and its v are increased; its plastic deformation is then u − b.
"""

import numpy as np

from .projection import exact, exact_loop, value_at

#: A steep tangent begins where its pressure is this fraction of the yield pressure below the point of tangency.
FROM_DEPTH = 0.5
#: Smallest slope of a tangent, relative to c. Points with a smaller slope are treated as perfectly plastic.
_FLAT = 1e-9
#: Steps of Newton's method end when they are shorter than this fraction of a piece. As the error is squared by each
#: step, the last step is accurate to about 14 digits.
_CLOSE, _STEPS = 1e-7, 60
#: Kind of the line of a point: first hardness (z was below the curved part), tangent, constant end of the curve, or
#: horizontal line on a part that softens or is flat.
FIRST, TANGENT, END, HORIZONTAL = 0, 1, 2, 3


@exact
def deformation_at(z, c, depth, levels, coefficients):
    """Solve H(w) + c w = z for the deformation w by Newton's method within a bracket.

    depth, coefficients : pieces of the curve.
    levels : H(w) + c w at the beginning of each piece.

    Returns w, H(w) and dH/dw.
    """
    piece = 0
    end = depth.size
    while end - piece > 1:
        middle = (piece + end) // 2
        if levels[middle] <= z:
            piece = middle
        else:
            end = middle
    a0 = coefficients[piece, 0]
    a1 = coefficients[piece, 1]
    a2 = coefficients[piece, 2]
    a3 = coefficients[piece, 3]
    rest = z - levels[piece]
    s = rest / (a1 + c)
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
            if not low <= new <= high:
                new = 0.5 * (low + high)
            is_close = abs(new - s) <= _CLOSE * width
            s = new
            if is_close:
                break
    hardness = a0 + s * (a1 + s * (a2 + s * a3))
    slope = a1 + s * (2.0 * a2 + s * 3.0 * a3)
    return depth[piece] + s, hardness, slope


@exact_loop
def follow_curve(
    first, end, c, delta, state, near, near_p, near_v, trial, v, columns, earlier, fluid, first_hardness,
    constant_depth, depth, levels, coefficients, has_end, kind, hardness, slope, begins, gap0,
):  # fmt: skip
    """Project some points near contact on the law, compare their pressures with the result, and set their tangents.

    Arrays are described in `projection`, and further ones are:

    columns : number of columns of the grid.
    earlier, fluid : u₀ [m] and p_f [Pa], with one value (1,) or one for each point (n,).
    first_hardness : hardness H(u₀) − p_f [Pa], (1,) or (n,).
    constant_depth : depth [m] up to which H(w) is constant.
    has_end : whether the last piece is constant.
    kind, begins : kind of the line of each point, and depth b [m] at which its tangent begins (n,).
    hardness, slope, gap0 : line of each point, and gap h₁ + b [m] (n,), which are updated.

    Returns
    -------
    total, slopes : Σ y, and its derivative with respect to cδ. Parts that soften are taken as flat.
    n_tangents : number of points with a tangent that rises.
    r2, y2 : ‖p − y‖² and ‖y‖².
    changed, changed_r2 : number of points whose state would change if p were y, and their ‖p − y‖². Perfectly plastic
        points whose pressure is not y are included. If a point does not harden any more, `changed_r2` is infinite.
    """
    listed = near[first:end]
    p = near_p[first:end]
    displacement = v.ravel()
    unused = v.shape[1] - columns  # unused values at the end of each row of v
    shift = c * delta
    is_uniform = first_hardness.size + earlier.size + fluid.size == 3
    H = first_hardness[0]
    u0 = earlier[0]
    pf = fluid[0]
    threshold = H + c * max(constant_depth - u0, 0.0)
    end_hardness = coefficients[levels.size - 1, 0]
    end_level = levels[levels.size - 1]
    total = 0.0
    slopes = 0.0
    n_tangents = 0
    r2 = 0.0
    y2 = 0.0
    changed = 0
    changed_r2 = 0.0
    for j in range(end - first):
        i = listed[j]
        former_kind = kind[i]
        former_begin = begins[i] if former_kind == TANGENT else 0.0
        x = p[j] - c * (near_v[first + j] - former_begin)
        z = x + shift
        if not is_uniform:
            H = value_at(first_hardness, i)
            u0 = value_at(earlier, i)
            pf = value_at(fluid, i)
            threshold = H + c * max(constant_depth - u0, 0.0)
        y = min(max(z, 0.0), H)
        s = (z > 0.0) + (z >= H)
        if z > threshold or former_kind != FIRST:
            h = 0.0
            begin = 0.0
            new_kind = FIRST
            if z > threshold:
                level = z + pf + c * u0
                if has_end and level >= end_level:
                    new_kind = END
                    y = end_hardness - pf
                else:
                    w, y, h = deformation_at(level, c, depth, levels, coefficients)
                    y -= pf
                    if h < _FLAT * c:
                        new_kind = HORIZONTAL
                        h = 0.0
                    else:
                        new_kind = TANGENT
                        n_tangents += 1
                        s = 3
                        slopes += h / (h + c)
                        begin = max(w - u0 - FROM_DEPTH * y / h, 0.0)
                        begins[i] = begin
                        y_begin = y - h * (w - u0 - begin)
            hardness[i] = y_begin if new_kind == TANGENT else (H if new_kind == FIRST else y)
            slope[i] = h
            kind[i] = new_kind
            if begin != former_begin:
                near_v[first + j] += begin - former_begin
                gap0[i] += begin - former_begin
                displacement[i + i // columns * unused] += begin - former_begin
            x -= c * begin
        trial[first + j] = x
        slopes += s == 1
        total += y
        e = y - p[j]
        r2 += e * e
        y2 += y * y
        if s != state[i] or (s == 2 and e != 0.0):
            changed += 1
            changed_r2 += np.inf if state[i] == 3 else e * e
    return total, slopes, n_tangents, r2, y2, changed, changed_r2
