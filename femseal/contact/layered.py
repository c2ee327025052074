"""Compute the compliance of coated bodies: an elastic layer that is bonded to a half-space of another material.

The index 1 denotes the layer, whose thickness is d, and the index 2 the substrate. The plane modulus of the layer is
E₁* = E₁/(1 − ν₁²). A pressure wave of amplitude 1 Pa and wave number q displaces the surface of the body by a wave of
amplitude C(q) = 2 S(qd)/(E₁* q). The factor S is the ratio of the compliance of the body to that of a half-space of the
layer's material. With t = qd and the ratio r = G₁/G₂ of the shear moduli,

    S = (1 + 4 m t e⁻²ᵗ − m n e⁻⁴ᵗ) / (1 − (m + n + 4 m t²) e⁻²ᵗ + m n e⁻⁴ᵗ)
    m = (r − 1)/(r + 3 − 4ν₁)        n = 1 − 4(1 − ν₁)/(1 + r (3 − 4ν₂))

For waves that are short compared with the thickness, S tends to 1. For long waves, C(q) tends to the compliance of the
substrate. For a rigid substrate, r = 0. If two bodies are in contact, their compliances C(q) add up.

A bonded layer under a frictionless pressure is also treated by O'Sullivan & King, J. Tribol. 110, 1988, and for rough
surfaces by Nogi & Kato, J. Tribol. 119, 1997, 493. The formula for S was verified against closed-form solutions and
finite elements (docs/evidence/coatings.md), but not against these two papers.

`layered_free_axes` computes the displacement along free axes.
"""

from __future__ import annotations

import numpy as np

from ..base import Array, InputError, validate
from ..materials import Coated, Solid, contact_modulus

#: The two bodies in contact; None is rigid.
Bodies = tuple[Solid | Coated | None, Solid | Coated | None]


def checked_modulus(modulus: object) -> float | Bodies:
    """Check a contact modulus, which is given as a number or as two bodies.

    Parameters
    ----------
    modulus : float or pair of bodies
        Contact modulus E* [Pa]; or the two bodies in contact, each a `Solid`, a `Coated`, or None for a rigid body.

    Returns
    -------
    float or pair of bodies
        The two bodies if at least one body is coated; otherwise the contact modulus [Pa].

    Raises
    ------
    InputError
        The value is neither a positive number nor a pair of bodies, or the two bodies are rigid.
    """
    if not isinstance(modulus, (tuple, list)):
        if isinstance(modulus, (Solid, Coated)):
            expected = "two bodies, such as (body, None) for contact with a rigid body"
            raise InputError("modulus", type(modulus).__name__, expected)
        return validate.number("modulus", modulus, unit="Pa")
    are_bodies = all(body is None or isinstance(body, (Solid, Coated)) for body in modulus)
    if len(modulus) != 2 or not are_bodies:
        given = ", ".join("None" if body is None else type(body).__name__ for body in modulus)
        raise InputError("modulus", given, "two bodies, each a Solid, a Coated, or None (rigid)")
    a, b = modulus
    if a is None and b is None:
        raise InputError("modulus", "two rigid bodies", "at least one elastic body")
    if isinstance(a, Coated) or isinstance(b, Coated):
        return a, b
    if a is None:
        a, b = b, a
    return contact_modulus(a, b)


def surface_modulus(modulus: float | Bodies) -> float:
    """Return the contact modulus E* [Pa] for waves much shorter than the thickness of the coatings.

    Parameters
    ----------
    modulus : float or pair of bodies
        Contact modulus [Pa], or the two bodies.
    """
    if isinstance(modulus, float):
        return modulus
    return 1 / sum(1 / _surface(body).plane_modulus for body in modulus if body is not None)


def modulus_of_waves(modulus: float | Bodies, q: Array) -> Array:
    """Compute the contact modulus E*(q) = 2/(q C(q)) [Pa] for waves q >= 0 [rad/m] of any shape.

    At q = 0, the modulus is that of the substrates. If this modulus is infinite, because the coated bodies have rigid
    substrates, the result is a very large number.

    Parameters
    ----------
    modulus : float or pair of bodies
        Contact modulus [Pa], or the two bodies.
    q : array
        Wave numbers >= 0 [rad/m].
    """
    if isinstance(modulus, float):
        return np.full(np.shape(q), modulus)
    total = np.zeros(np.shape(q))
    for body in modulus:
        if isinstance(body, Coated):
            total += layer_factor(body, q * body.thickness) / body.layer.plane_modulus
        elif body is not None:
            total += 1 / body.plane_modulus
    return 1 / np.maximum(total, np.finfo(float).tiny)


def scaled(modulus: Bodies, factor: float) -> Bodies:
    """Return two bodies whose Young's moduli are multiplied by a factor. The bodies returned have no yield stresses."""
    a, b = modulus
    return _scaled_body(a, factor), _scaled_body(b, factor)


def layer_factor(body: Coated, t: Array) -> Array:
    """Compute S(t), the ratio of the compliance of a coated body to that of a half-space of the layer's material.

    Parameters
    ----------
    body : Coated
        Layer on a substrate.
    t : array
        Wave number q times thickness d of the layer, t = qd >= 0.

    Returns
    -------
    array
        S(t), of the shape of t. For an incompressible layer on a rigid substrate, the relative error of S grows as
        1e-16/t² towards small t.
    """
    layer, substrate = body.layer, body.substrate
    if substrate is None:
        ratio = 0.0
        substrate_term = 0.0
    else:
        ratio = layer.shear_modulus / substrate.shear_modulus
        substrate_term = ratio * (3 - 4 * substrate.poisson)
    m = (ratio - 1) / (ratio + 3 - 4 * layer.poisson)
    n = 1 - 4 * (1 - layer.poisson) / (1 + substrate_term)
    e2 = np.exp(-2 * t)
    one_less_e4 = -np.expm1(-4 * t)
    # the constant part is apart, because it vanishes together with the rest for thin incompressible layers
    numerator = (1 - m * n) + m * (n * one_less_e4 + 4 * t * e2)
    denominator = 1 - (m + n + 4 * m * t**2) * e2 + m * n * e2**2
    return np.maximum(numerator / denominator, 0.0)


def _surface(body: Solid | Coated) -> Solid:
    """Return the solid at the surface of a body."""
    return body.layer if isinstance(body, Coated) else body


def _scaled_body(body: Solid | Coated | None, factor: float) -> Solid | Coated | None:
    """Return a copy of a body with its Young's moduli multiplied by a factor and without yield stresses."""
    if body is None:
        return None
    if isinstance(body, Solid):
        return Solid(body.young * factor, body.poisson)
    substrate = None
    if body.substrate is not None:
        substrate = Solid(body.substrate.young * factor, body.substrate.poisson)
    layer = Solid(body.layer.young * factor, body.layer.poisson)
    return Coated(substrate, layer, body.thickness)
