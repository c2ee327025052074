"""Compile the loop that computes gap and plastic deformation from the pressure of a solved contact."""

from .law_at_points import value_at
from .loop_decorators import exact


@exact
def gap_and_deformation(first, end, p, v, delta, c, law, gap, deformation, plastic):
    """Compute gap, plastic deformation u and flags of plastic points in the rows `first` to `end` − 1.

    The plastic deformation u = (p − H − c g)/(s + c) follows from the projection of the trial pressure p − c g on the
    law H + s u. Here H is the hardness, s the hardening modulus, c the length of the projection step, and g = v − δ the
    raw gap, with the displacement plus undeformed gap v and the approach δ. For s = 0, p = H and the formula becomes
    u = −g. The rounding error of u is small for any hardening modulus s. If s is much larger than c, the term p − H
    determines u. If s is much smaller than c, the term −c g determines u.

    The arrays `deformation` and `plastic` must contain zeros at first. Most rows of a light contact have no plastic
    point, and need no memory in arrays made by `numpy.zeros` as long as nothing is written there.
    """
    hardness, slope = law.hardness, law.slope
    columns = p.size // v.shape[0]
    for row in range(first, end):
        start = row * columns
        n_plastic = 0
        for j in range(columns):  # this loop compiles to vector instructions
            i = start + j
            g = v[row, j] - delta
            gap[i] = 0.0 if (p[i] > 0.0) | (g < 0.0) else g
            n_plastic += p[i] >= value_at(hardness, i)
        if n_plastic == 0:
            continue
        for j in range(columns):
            i = start + j
            if p[i] >= value_at(hardness, i):
                plastic[i] = True
                g = v[row, j] - delta
                s = value_at(slope, i)
                u = -g if s == 0.0 else (p[i] - value_at(hardness, i) - c * g) / (s + c)
                if u > 0.0:
                    deformation[i] = u
