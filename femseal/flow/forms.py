"""Define the weak form of thin-film and Darcy flow, ∇·(K ∇p) = 0, for scikit-fem.

All flow operators, for cells and for seals, on grids and on meshes, are assembled from the bilinear forms in
`flow.forms`.
The permeability K [m³] is a tensor (2, 2, …) at the quadrature points. In a thin film with the gap h, K is h³/12 times
the unit tensor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any

import numpy as np
from skfem import BilinearForm
from skfem.helpers import dot, grad, mul

from ..base import InputError

#: Quadrature at the midpoints of the edges of the reference square: points (2, 4) and weights (4,). The edges along the
#: first axis come first. With this quadrature a bilinear element only couples corners that share an edge.
EDGE_MIDPOINTS = np.array([[0.5, 0.5, 0.0, 1.0], [0.0, 1.0, 0.5, 0.5]]), np.full(4, 0.5)
#: Quadrature at the corners of the reference square: points (2, 4) and weights (4,). With this quadrature the
#: Raviart-Thomas fluxes along the two axes of an element are not coupled.
CORNERS = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), np.full(4, 0.25)


def _with_docstring(form: Callable[..., Any]) -> BilinearForm:
    """Make a bilinear form of scikit-fem from a function; the form keeps the name and the docstring of the function."""
    return update_wrapper(BilinearForm(form), form)


@_with_docstring
def darcy_flow(p: Any, q: Any, w: Any) -> Any:
    """Evaluate (K ∇p)·∇q, the integrand of the weak form of −∇·(K ∇p).

    Parameters
    ----------
    p, q : pressure and test function of scikit-fem.
    w : form parameters of scikit-fem. `w.k` is the permeability K [m³]: one number, an array (…) with a number for each
        quadrature point, or an array (2, 2, …) with a tensor for each quadrature point.

    Raises
    ------
    InputError : K has another shape.

    Examples
    --------
    >>> from skfem import Basis, ElementTriP1, MeshTri
    >>> darcy_flow.assemble(Basis(MeshTri(), ElementTriP1()), k=2.0).diagonal()
    array([2., 2., 2., 2.])
    """
    return dot(_flux(w.k, grad(p)), grad(q))


def _flux(k: Any, gradient: Any) -> Any:
    """Multiply the permeability K by a gradient at the quadrature points.

    k : one number, an array (…) with a number for each quadrature point, or an array (2, 2, …) with a tensor for each.
    gradient : array (2, …), gradient at each quadrature point.
    """
    shape = np.shape(k)
    points = np.shape(gradient)[1:]
    is_isotropic = shape in ((), points)
    if is_isotropic:
        return np.asarray(k) * gradient
    if shape[:2] == (2, 2):
        return mul(k, gradient)
    raise InputError(
        "k",
        f"shape {shape}",
        "a number, or an array of numbers (…) or of tensors (2, 2, …) at the quadrature points [m³]",
    )


@_with_docstring
def flux_resistance(u: Any, v: Any, w: Any) -> Any:
    """Evaluate (K⁻¹ u)·v for a flux u and a test flux v.

    The integral of (K⁻¹ u)·u is the energy that the flux u dissipates. `flow.mesh` computes a lower bound of the flow
    from the energy of a conserved flux.
    """
    return dot(mul(w.resistance, u), v)
