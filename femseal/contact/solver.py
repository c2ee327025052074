"""Solve the contact of an elastic-plastic half-space with a rough surface under a load.

Symbols: p pressure, H hardness, h₁ undeformed gap, K compliance of the half-space, v = Kp + h₁, δ approach,
g = v − δ raw gap, E* contact modulus, u plastic deformation. The problem is the convex programme

    min ½⟨p, Kp⟩ + ⟨p, h₁⟩,  0 ≤ p ≤ H,  mean p = p̄.

For a contact law with linear hardening, p ≤ H + h u, the upper bound p ≤ H is replaced by the additional energy
½⟨(p − H)₊, (p − H)₊⟩/h. Contacts with a linear law H + h u are solved in `nested_grids`, and those with a curved law
H(u) in `curved_law`.
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import ArrayLike

from ..base import Array, InputError, validate
from ..base.compiled import thread_count, using_threads
from .contact_fields import Contact
from .curved_law import solve_curved_law
from .half_space import HalfSpace
from .law import ContactLaw
from .linear_laws import contact_law
from .nested_grids import Level, solve_straight_law
from .workspace import workspace


@validate.removed_arguments(
    approach="give the pressure; the approach of the solved contact is Contact.approach"
)
def solve_contact(
    gap0: ArrayLike,
    half_space: HalfSpace,
    *,
    pressure: float,
    hardness: float | ArrayLike | ContactLaw = inf,
    deformation: ArrayLike | None = None,
    fluid_pressure: ArrayLike = 0.0,
    rtol: float = 1e-6,
    threads: int | None = None,
) -> Contact:
    """Compute pressure and gap for an elastic-plastic half-space pressed onto a rough surface.

    Parameters
    ----------
    gap0 : array (n1, n2)
        Undeformed gap h₁ [m], up to a constant.
    half_space : HalfSpace
        Elastic body, kinds of boundaries, and grid.
    pressure : float
        Nominal pressure p̄ [Pa] with 0 ≤ p̄ ≤ mean H. At p̄ = 0 the bodies just touch. At p̄ = mean H all points are
        plastic. If the points harden without limit, any nominal pressure can be carried. A fluid between the surfaces
        carries its mean pressure, and the contact carries p̄ minus the mean fluid pressure.
    hardness : float, array (n1, n2) or ContactLaw
        Hardness H [Pa] of perfect plasticity, infinite for an elastic body; or a contact law such as `LinearHardening`.
    deformation : array (n1, n2), optional
        Plastic deformation >= 0 [m] due to an earlier load. The plastic deformation in the returned `Contact` includes
        this earlier deformation.
    fluid_pressure : float or array (n1, n2)
        Pressure p_f of a fluid between the surfaces [Pa], relative to the surroundings. The contact with the fluid is
        equivalent to a dry contact with three changes. The undeformed gap becomes h₁ + K p_f, the mean contact pressure
        p̄ − mean p_f, and the pressure at which points yield H − p_f.
    rtol : float
        Complementarity residual ‖p − clip(p − c(v − δ), 0, H)‖/‖p‖ to reach, with c = πE*/(4Δ). Δ is the geometric mean
        of the pixel lengths along both axes; an axis with a single point is ignored. For contact laws with hardening,
        clip is replaced by the projection on the contact law.
    threads : int, optional
        Number of threads that share the work on grids of 512² points or more. By default, all threads left free by the
        current run, or a single thread outside of a run. The number of threads does not change the results.

    Returns
    -------
    Contact

    Raises
    ------
    InputError
        An array has a wrong shape or undefined points, the earlier deformation is negative, the contact law cannot
        carry the nominal pressure, or the surfaces separate because the nominal pressure is less than the mean fluid
        pressure.
    NotConverged
        The residual did not fall below `rtol`, or the tangents of a curved law still changed after 100 contacts.

    Notes
    -----
    The contact is solved by an inexact semismooth Newton method. The active sets of the method are the points in
    contact and the points at the hardness, as in gradient-projection conjugate gradients (Moré & Toraldo, SIAM J.
    Optim. 1, 1991, 93; Polonsky & Keer, Wear 231, 1999, 206). If the active sets still change after many iterations,
    the solver continues with steps that never increase the energy. The attribute `residual` of the returned `Contact`
    is the residual of the returned pressure.

    Examples
    --------
    >>> import femseal as fs
    >>> gap0 = 1e-6 * np.cos(2 * np.pi * np.arange(64) / 64) + np.zeros((64, 1))  # waves along x2
    >>> body = fs.HalfSpace((64, 64), (1e-6, 1e-6), modulus=1e11)
    >>> contact = solve_contact(gap0, body, pressure=1e9)
    >>> round(contact.area_fraction, 2), bool(contact.gap.min() == 0)
    (0.3, True)
    """
    shape = half_space.shape
    gap = validate.field("gap0", gap0, unit="m", shape=shape, copy=False)
    law = contact_law(hardness)
    if deformation is not None:
        deformation = validate.field("deformation", deformation, unit="m", shape=shape, copy=False)
        least = float(deformation.min())
        if least < 0:
            raise InputError("deformation", f"down to {least:g} m", "plastic deformations >= 0 [m]")
        gap = gap + deformation
        law = law.after(deformation)
    n_threads = thread_count() if threads is None else validate.count("threads", threads)
    with using_threads(n_threads):
        if np.ndim(fluid_pressure) or fluid_pressure != 0:
            gap, law, pressure = _as_dry_contact(gap, half_space, law, pressure, fluid_pressure)
        line = law.tangent(shape)
        mean_pressure = _checked_pressure(pressure, law)
        validate.tolerance("rtol", rtol)
        level = Level(gap, half_space, line, mean_pressure)
        if law.linear:
            contact = solve_straight_law(level, rtol)
        else:
            contact = solve_curved_law(law, level, rtol)
    if deformation is not None:
        np.add(contact.plastic_deformation, deformation, out=contact.plastic_deformation)
    return contact


def _as_dry_contact(
    gap: Array,
    half_space: HalfSpace,
    law: ContactLaw,
    pressure: float,
    fluid_pressure: ArrayLike,
) -> tuple[Array, ContactLaw, float]:
    """Convert a contact with a fluid between the surfaces to an equivalent contact without a fluid.

    Returns
    -------
    gap : array (n1, n2)
        Undeformed gap h₁ + K p_f [m], which includes the displacement due to the fluid pressure.
    law : ContactLaw
        Law of the contact pressure without the fluid pressure, H(u) − p_f.
    pressure : float
        Nominal pressure that the contact has to carry [Pa].
    """
    if np.ndim(fluid_pressure) == 0:
        value = validate.number("fluid_pressure", fluid_pressure, unit="Pa", above=-inf)
        fluid_pressure = np.full(half_space.shape, value)
    p_f = validate.field(
        "fluid_pressure", fluid_pressure, unit="Pa", shape=half_space.shape, copy=False
    )
    if np.any(p_f >= law.yield_pressure()):
        given = f"up to {p_f.max():g} Pa"
        expected = f"less than the hardness, {law.mean_hardness:g} Pa"
        raise InputError("fluid_pressure", given, expected)
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    mean = float(p_f.mean())
    if pressure < mean:
        given = f"{pressure:g} Pa, of which the fluid carries {mean:g} Pa"
        expected = "a load that is more than the fluid carries: below that the surfaces separate"
        raise InputError("pressure", given, expected)
    # a uniform fluid pressure is passed to the law as a number, so that the law remains the same for all points
    first_value = p_f.flat[0]
    is_uniform = np.all(p_f == first_value)
    reduced_law = law.less(first_value if is_uniform else p_f)
    grid = workspace(half_space)
    grid.pressure[:] = p_f
    return gap + grid.displacement(), reduced_law, pressure - mean


def _checked_pressure(pressure: float, law: ContactLaw) -> float:
    """Return the nominal pressure as a float; raise InputError if the contact law cannot carry this pressure."""
    pressure = validate.number("pressure", pressure, unit="Pa", inclusive=True)
    check_capacity("pressure", pressure, law)
    return pressure


def check_capacity(name: str, pressure: float, law: ContactLaw) -> None:
    """Raise InputError for the parameter `name` if a mean pressure [Pa] exceeds the capacity of a law."""
    if pressure > law.capacity * (1 + 1e-12):
        expected = f"at most {law.capacity:g} Pa, the largest mean pressure that points of this hardness carry"
        raise InputError(name, f"{pressure:g} Pa", expected)
