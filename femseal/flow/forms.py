"""The equation of thin-film and Darcy flow, ∇·(K ∇p) = 0, in weak form, for scikit-fem.

Every operator of the flow, on a grid or a mesh, at the scale of a cell or of a seal, is assembled from these forms.
K is the permeability [m³] as a tensor (2, 2, …) at the quadrature points; of a thin film h³/12 times the unit tensor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import update_wrapper
from typing import Any

import numpy as np
from skfem import BilinearForm
from skfem.helpers import dot, grad, mul

from ..base import InputError

#: Midpoints of the edges of the reference square, first of those along its first axis, and their weights: a quadrature
#: with which a bilinear element joins no corners but those of an edge.
EDGE_MIDPOINTS = np.array([[0.5, 0.5, 0.0, 1.0], [0.0, 1.0, 0.5, 0.5]]), np.full(4, 0.5)
#: Corners of the reference square, and their weights: a quadrature with which Raviart-Thomas fluxes through different
#: sides of an element do not act on each other.
CORNERS = np.array([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]]), np.full(4, 0.25)


def _with_docstring(form: Callable[..., Any]) -> BilinearForm:
    """A bilinear form of scikit-fem that tells what its function tells."""
    return update_wrapper(BilinearForm(form), form)


@_with_docstring
def darcy_flow(p: Any, q: Any, w: Any) -> Any:
    """∫ (K ∇p)·∇q of a pressure p and a test function q: the weak form of −∇·(K ∇p).

    w.k : K [m³], a tensor (2, 2, …) at the quadrature points; or a number, or (…) of it, times the unit tensor.

    Raises InputError: K of another shape.

    >>> from skfem import Basis, ElementTriP1, MeshTri
    >>> darcy_flow.assemble(Basis(MeshTri(), ElementTriP1()), k=2.0).diagonal()
    array([2., 2., 2., 2.])
    """
    return dot(_flux(w.k, grad(p)), grad(q))


def _flux(k: Any, gradient: Any) -> Any:
    """K times a gradient (2, …)."""
    shape, points = np.shape(k), np.shape(gradient)[1:]
    if shape in ((), points):
        return np.asarray(k) * gradient
    if shape[:2] == (2, 2):
        return mul(k, gradient)
    raise InputError(
        "k",
        f"shape {shape}",
        "a number, numbers or tensors (2, 2, …) at the quadrature points [m³]",
    )


@_with_docstring
def flux_resistance(u: Any, v: Any, w: Any) -> Any:
    """∫ (K⁻¹ u)·v of a flux u and a test flux v: the mixed form, whose flux gives the lower bound."""
    return dot(mul(w.resistance, u), v)
