"""The equation of thin-film and Darcy flow, ∇·(K ∇p) = 0, in weak form, for scikit-fem.

Every operator of the flow, on a grid or a mesh, at the scale of a cell or of a seal, is assembled from these forms.
K is the permeability [m³] as a tensor (2, 2, …) at the quadrature points; of a thin film h³/12 times the unit tensor.
"""

from __future__ import annotations

from typing import Any

from skfem import BilinearForm
from skfem.helpers import dot, grad, mul


@BilinearForm
def darcy_flow(p: Any, q: Any, w: Any) -> Any:
    """∫ (K ∇p)·∇q of a pressure p and a test function q: the weak form of −∇·(K ∇p)."""
    return dot(mul(w.k, grad(p)), grad(q))


@BilinearForm
def flux_resistance(u: Any, v: Any, w: Any) -> Any:
    """∫ (K⁻¹ u)·v of a flux u and a test flux v: the mixed form, whose flux gives the lower bound."""
    return dot(mul(w.resistance, u), v)
