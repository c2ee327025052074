"""Evaluate the linear contact law H + h u of a single point, in compiled loops."""

from ..base.compiled import inlined
from .loop_decorators import EXACT, exact
from .point_arrays import HARDENING


@exact
def value_at(values, i):
    """Return the value of point i from an array with one value for all points (1,) or one for each point (n,)."""
    return values[i if values.size > 1 else 0]


@inlined(**EXACT)
def is_same_at_all_points(law):
    """Return whether a contact law has a single hardness and a single hardening modulus for all points."""
    return law.hardness.size == 1 and law.slope.size == 1


@exact
def hardness_and_slope(i, law, c):
    """Return the hardness H [Pa] of point i, and the slope t of its projected pressure above the hardness.

    Above the hardness, the projected pressure y rises with the trial pressure z at the rate dy/dz = t = h/(h + c). Here
    h is the hardening modulus [Pa/m] of the point, and c the length [Pa/m] of the projection step. Without hardening, t
    is 0.
    """
    modulus = value_at(law.slope, i)
    slope = modulus / (modulus + c) if modulus > 0.0 else 0.0
    return value_at(law.hardness, i), slope


@exact
def projected(z, H, t):
    """Project a trial pressure z onto the pressures that the contact law allows.

    The projected pressure is 0 for z < 0, z for z between 0 and the hardness H, and H + t (z − H) for larger z. The
    hardness H is positive.

    Returns the projected pressure, and the state of the point (see `point_arrays`).
    """
    y = min(max(z, 0.0), H)
    if t > 0.0 and y >= H:
        return H + t * (z - H), HARDENING
    state = (y > 0.0) + (y >= H)  # SEPARATED, ELASTIC or PLASTIC
    return y, state
